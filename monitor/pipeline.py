"""The one loop around the step of the stages: a block in, its record committed, the state after it kept.

Live sources (:mod:`monitor.service.ingest`), replays and parts of archives (:mod:`monitor.service.replay`) and single
signals (:mod:`spallwatch.analysis`) are callers. What differs between them is :class:`PipelineOptions`; the
callers supply the blocks and use the outputs.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol

from monitor.config.load import ConfigError
from monitor.health.alarms import AlarmAcknowledgement, acknowledged
from monitor.health.record import Record
from monitor.health.retrace import AVERAGED_SPECTRA, BAND_VOTES, Retraced, retrace
from monitor.health.signal.plans import load_fftw
from monitor.health.signal.recording_bands import recording_bands
from monitor.health.signal.waterfall import SpectrumChange
from monitor.health.state import SourceSettings, SourceState
from monitor.health.step import SourceOutput, rejected_record, rejection_of, step
from monitor.records.events import EventLog
from monitor.records.failures import Failures, Kind, StoreDamagedError, StoreError, UnstorableError, error_text, kind_of
from monitor.records.filing import MAX_BLOCK
from monitor.records.ledger import StoreLedger, write_progress
from monitor.records.queries import state_block
from monitor.records.recover.loss import damage_in_use
from monitor.records.store import Store
from streams.dates.best import latest_of
from streams.types.block import Block, Rejected
from streams.types.source import Delivery, FileProgress, LiveSource, Source

_LOG = logging.getLogger(__name__)
_FIRST_RETRY_S, _RETRY_S = 0.05, 1.0
"""Seconds before the second attempt to use the store, which double up to the second number."""
_ANALYSIS_PAUSES_S = (0.05, 0.5)
_BATCH_BLOCKS = 64
"""Blocks to a transaction: a replay that is cut off begins again at the last batch, as the recording is still there."""
_MISSING = {
    AVERAGED_SPECTRA: "its average of spectra, from which the damaged part is named, begins again",
    BAND_VOTES: "the choice of its band begins again",
}


class ConditionOf(Protocol):
    """Gives blocks the speed and load that they do not state themselves."""

    def __call__(self, block: Block) -> Block:
        """Return the block with what is known besides; the same block where nothing is."""
        ...


@dataclass(frozen=True)
class PipelineOptions:
    """What differs between callers.

    Attributes:
        clock: UTC s since 1970 where the sources are live; None in a replay.
        condition: gives blocks the speed and load that they do not state themselves.
        refuse_misfits: whether a block that does not fit the configuration raises ConfigError.
        idle: called after each failed attempt to use the store.
    """

    clock: Callable[[], float] | None = None
    condition: ConditionOf | None = None
    refuse_misfits: bool = False
    idle: Callable[[], object] = lambda: None


class RecordingStep(NamedTuple):
    """A block of a recording, its output, and the state after it."""

    item: Block | Rejected
    output: SourceOutput
    state: SourceState


class Pipeline:
    """The states of sources, and the loop that takes their blocks: :meth:`play` recordings, :meth:`deliver` live ones.

    A live block on which the analysis raises is committed as ``unreadable``, with the states before it; where the store
    cannot commit (a full disk, say), the same block is tried again until it can. In a recording both raise.
    """

    def __init__(
        self,
        settings: Mapping[str, SourceSettings],
        store: Store | None = None,
        options: PipelineOptions | None = None,
        ledger: StoreLedger | None = None,
    ) -> None:
        """Begin with the states at which the store ends; ``settings`` are by the name of the source in blocks.

        The store is open for writing in this thread; without one, outputs are returned only. ``ledger`` notes which
        files are under analysis, and knows the blocks of before.

        Raises:
            StoreError: the store cannot be read, or its states are of another version.
        """
        self.settings = dict(settings)
        self._options = options or PipelineOptions()
        self._store, self._ledger = store, ledger
        self._states = {
            name: SourceState.begin(found) if store is None else resumed_state(store, found)
            for name, found in self.settings.items()
        }
        self._acknowledgements: dict[str, tuple[AlarmAcknowledgement, ...]] = {}
        # Of the blocks since the latest commit.
        self._ahead: dict[str, SourceState] = {}
        self._pending: list[tuple[Record, tuple[SpectrumChange, ...]]] = []
        self.reasons: dict[str, str] = {}
        """The first reason of each kind of rejection, of recordings."""
        damage = (lambda: None) if store is None else partial(damage_in_use, store.path)
        self.failures = Failures("the store fails, nothing is committed", "the store works again", damage)
        self._analysis_errors: dict[str, str] = {}

    def state(self, source: str) -> SourceState:
        """Return the state of a source as committed, with the latches released that were acknowledged since."""
        state = self._states[source]
        return replace(state, alarms=acknowledged(state.alarms, self._acknowledgements.get(source, ())))

    def fix_bands(self, source: str, blocks: Sequence[Block]) -> None:
        """Fix the bands of a source to those chosen from a recording as a whole; ValueError where none fits."""
        for name, band in recording_bands(blocks, self.settings[source]).items():
            self._states[source] = self._states[source].with_band(name, band)

    def acknowledge(self, source: str, given: AlarmAcknowledgement) -> bool:
        """Release a latched alarm with the next block; return whether there was one."""
        before = self.state(source).alarms
        if acknowledged(before, (given,)) == before:
            return False
        self._acknowledgements[source] = (*self._acknowledgements.get(source, ()), given)
        return True

    def play(self, source: Source, limit: int | None = None, pace: float | None = None) -> Iterator[RecordingStep]:
        """Take the blocks of a recording after those of the store, at most ``limit``.

        What is yielded is committed with its batch, the last one at the end. Repetitions are counted in the store.

        Args:
            pace: times real time, or None for full speed, then in batches.

        Raises:
            ConfigError: a misfit, where these are refused.
        """
        name = source.name
        last = 0 if self._store is None else self._store.last(name)
        batch = _BATCH_BLOCKS if pace is None else 1
        truth_of = getattr(source, "truth", None)
        repetitions: list[Rejected] = []
        started, first, left = time.monotonic(), None, limit
        for item in source:
            if isinstance(item, Rejected) and item.is_repetition:
                repetitions.append(item)
                self.reasons.setdefault(item.status, item.reason)
            elif item.sequence > last:
                if pace is not None and isinstance(item, Block) and item.elapsed is not None:
                    first = item.elapsed if first is None else first
                    time.sleep(max(0.0, started + (item.elapsed - first) / pace - time.monotonic()))
                truth = None if truth_of is None else truth_of(item.sequence, self.settings[name].thresholds)
                output = self.take(item, truth=truth)
                record, state = output.record, self._ahead[item.source]
                if not record.accepted:
                    self.reasons.setdefault(record.status, f"block {record.sequence}: {record.reason}")
                if len(self._pending) >= batch:
                    self._write()
                yield RecordingStep(item, output, state)
                left = None if left is None else left - 1
            if left == 0:
                break
        self._write()
        if self._store is not None:
            self._store.recount_refusals(name, repetitions)

    def deliver(self, source: LiveSource, delivery: Delivery, stop: threading.Event) -> Record | None:
        """Take what a live source delivers, and acknowledge it once it is committed; return its record, if it has one.

        A block whose number the ledger has already is counted as ``duplicate`` or ``changed`` and is not analysed.
        Where ``stop`` is set before the commit, nothing is acknowledged.
        """
        ledger = self._ledger
        assert ledger is not None
        known: list[Block | Rejected] = []
        if not self.retry(lambda: known.append(_unless_known(ledger, delivery.item)), stop):
            return None
        item, record = known[0], None
        if isinstance(item, Rejected) and item.is_repetition:
            refused = item
            done = self.retry(lambda: ledger.refuse(refused, delivery.progress), stop)
        else:
            record = self._take_live(item, delivery.progress, stop)
            done = record is not None
        if done:
            self.retry(lambda: ledger.survive(source.name, delivery.progress), stop)
            try:
                source.acknowledge(delivery)
            except OSError as error:
                # It is committed: the next acknowledgement counts for this block, too, or its sender repeats it.
                _LOG.error("%s: block %d cannot be acknowledged: %s", source.name, delivery.item.sequence, error)
        return record

    def _take_live(
        self, item: Block | Rejected, progress: Sequence[FileProgress], stop: threading.Event
    ) -> Record | None:
        """Analyse and commit one block; return its record, or None where ``stop`` came before the commit."""
        try:
            output = self._take_patiently(item, [file.path for file in progress], stop)
            done = self.retry(lambda: self._write(progress), stop, final=False)
            if output.record.accepted and self._analysis_errors.pop(item.source, None) is not None:
                _LOG.warning("%s: blocks can be analysed again", item.source)
        except StoreDamagedError:
            self._roll_back()
            raise
        except Exception as error:  # A block on which the analysis raises must not stop the next ones.
            self._roll_back()
            output = self._failed(item, error)
            done = self.retry(lambda: self._write(progress), stop)
        if not done:
            self._roll_back()
            return None
        return output.record

    def _take_patiently(self, item: Block | Rejected, files: Sequence[str], stop: threading.Event) -> SourceOutput:
        """Take a block as :meth:`take`, once more where memory or another thing of the system was short."""
        for pause in _ANALYSIS_PAUSES_S:
            try:
                return self.take(item, files)
            except (OSError, MemoryError) as error:
                if kind_of(error) is not Kind.TRANSIENT:
                    raise
                _LOG.warning("%s: block %d is analysed once more: %s", item.source, item.sequence, error_text(error))
                stop.wait(pause)
        return self.take(item, files)

    def take(
        self, item: Block | Rejected, files: Sequence[str] = (), truth: Mapping[str, Any] | None = None
    ) -> SourceOutput:
        """Take a block through the stages; it is committed with its batch.

        Its files are noted meanwhile, should the process die of it. Raises ConfigError as :meth:`play`.
        """
        options, source = self._options, item.source
        if options.condition is not None and isinstance(item, Block):
            item = options.condition(item)
        before, given = self._ahead.get(source, self._states[source]), self._acknowledgements.get(source, ())
        noted = self._ledger if files else None
        if noted is not None:
            # A death while this loads is not that of the first file, which comes first after each start.
            load_fftw()
            noted.analyse(source, files, item.samples.nbytes if isinstance(item, Block) else 0)
        try:
            now = None if options.clock is None else options.clock()
            latest = None if now is not None else latest_of(time.time())
            state, output = step(
                before, item, self.settings[source], now=now, latest=latest, acknowledgements=given, truth=truth
            )
        finally:
            if noted is not None:
                noted.analyse(source, ())
        if options.refuse_misfits and output.misfit is not None:
            raise ConfigError(output.misfit)
        self._ahead[source] = state
        # Not the output, whose features of many blocks would fill the memory.
        self._pending.append((output.record, output.spectra))
        return output

    def _failed(self, item: Block | Rejected, error: Exception) -> SourceOutput:
        """Return the output of a block that cannot be analysed or stored: that of a rejection in its place."""
        status, reason = "unreadable", f"the analysis failed: {type(error).__name__}: {error}"
        known = item.source in self._analysis_errors
        if isinstance(error, MemoryError) and isinstance(item, Block):
            status, known = "refused", True  # Where it ran out says nothing.
            reason = f"there is not enough memory to analyse its {item.samples.nbytes} bytes of samples"
        _LOG.error("%s: block %d: %s", item.source, item.sequence, reason, exc_info=None if known else error)
        rejection = rejection_of(item, status, reason)
        self._analysis_errors[item.source] = f"block {item.sequence}: {rejection.reason}"
        try:
            return self.take(rejection)
        except Exception:
            # The stages raise even on a rejection: it is recorded, and they keep their states.
            output = SourceOutput(rejected_record(rejection))
            self._ahead, self._pending = {item.source: self._states[item.source]}, [(output.record, ())]
            return output

    def _write(self, progress: Sequence[FileProgress] = ()) -> None:
        """Commit the blocks since the latest commit, the states after the last of them, and the progress of files."""
        if not self._pending:
            return
        if self._store is not None:
            records = [record for record, _ in self._pending]
            source = records[-1].source
            batch: list[tuple[Record, Mapping[str, Any]]] = [(record, {}) for record in records]
            batch[-1] = (records[-1], self._ahead[source].to_stored())
            spectra = [change for _, changes in self._pending for change in changes]
            beside = partial(write_progress, source=source, progress=progress) if progress else None
            self._store.commit_many(batch, beside, spectra)
        for source, state in self._ahead.items():
            if state is not self._states[source]:
                self._states[source] = state
                self._acknowledgements.pop(source, None)
        self._roll_back()

    def _roll_back(self) -> None:
        """Leave out the blocks since the latest commit."""
        self._ahead, self._pending = {}, []

    def retry(self, action: Callable[[], Any], stop: threading.Event, *, final: bool = True) -> bool:
        """Repeat an action until the database allows it; return False where ``stop`` is set first.

        Raises:
            UnstorableError: no attempt can succeed, and it is not ``final``: something else can be stored instead.
            StoreDamagedError: the store is damaged, as two checks found.
        """
        pause = _FIRST_RETRY_S
        while True:
            try:
                action()
            except StoreError as error:
                if isinstance(error, UnstorableError) and not final:
                    raise
                self.failures.note(error)
                self._options.idle()
                pause = min(pause, _RETRY_S)
                if stop.wait(pause):
                    return False
                pause *= 2.0
                continue
            if self.failures.problem is not None:
                self.failures.end()
            return True

    @property
    def store_fails(self) -> bool:
        """Whether the latest attempt to use the store failed."""
        return self.failures.problem is not None

    def problems(self) -> dict[str, str]:
        """Return why the latest block of a source could not be analysed, and under "store" why none is committed."""
        problem = self.failures.problem
        return self._analysis_errors | ({"store": problem} if problem is not None else {})


def _unless_known(ledger: StoreLedger, item: Block | Rejected) -> Block | Rejected:
    """Return the item, or the rejection of one whose number the ledger has."""
    if isinstance(item, Rejected) and item.is_repetition:
        return item
    known = ledger.content_of(item.source, item.sequence)
    if known is None:
        # A file that a salvaged ledger has lost is read again, and its blocks get new numbers.
        number = ledger.number_of(item.source, item.name, item.content_hash) if item.content_hash else None
        if number is None:
            return item
        reason = f"is block {number} read once more"
        return Rejected(item.source, number, item.name, "duplicate", reason, item.content_hash)
    status = "duplicate" if known == item.content_hash else "changed"
    reason = f"block {item.sequence} is there already"
    return Rejected(item.source, item.sequence, item.name, status, reason, item.content_hash)


def resumed_state(store: Store, settings: SourceSettings) -> SourceState:
    """Return the state of a source after its last block, which a store that is open for writing then has.

    Where only an older state is left, it is taken on over the records since.

    Raises:
        StoreError: the store cannot be read or written, or a state in it is of another version.
    """
    source = settings.name
    block = state_block(store, f"source:{source}")
    try:
        state = SourceState.begin(settings, store.load_states(), store.record(source, store.last(source)))
        records = store.records_after(source, block)
        after = retrace(state, records, settings)
    except (KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{store.path}: a state in it is of another version ({error})") from error
    state = after.state
    if after.blocks and store.writable:
        store.replace_states(source, state.to_stored())
        notice = _notice(source, after)
        _LOG.warning("%s", notice["text"])
        with EventLog(store.path) as log:
            log.notice(time.time(), notice)
    if state.order.sequence > MAX_BLOCK:
        # All later blocks would be late.
        state = replace(state, order=replace(state.order, sequence=store.last(source)))
    return state


def _notice(source: str, after: Retraced) -> Mapping[str, Any]:
    text = f"{source}: the state was made again from {after.blocks} records"
    missing = "; ".join(f"{name}: {_MISSING[part]}" for name, parts in after.missing.items() for part in parts)
    return {
        "kind": "state_retraced",
        "channel": None,
        "text": f"{text}; {missing}" if missing else f"{text}, without loss",
        "records": after.blocks,
        "missing": {name: list(parts) for name, parts in after.missing.items()},
    }
