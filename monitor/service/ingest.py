"""From live sources to the store: each block is analysed, committed, and only then acknowledged."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Self

from monitor.config.load import Config, ConfigError
from monitor.health.alarms import AlarmAcknowledgement, acknowledged
from monitor.health.record import Record
from monitor.health.spectrum.plans import load_fftw
from monitor.health.state import SourceSettings, SourceState
from monitor.health.step import SourceOutput, rejected_record, rejection_of, step
from monitor.records.database import Closing, StoreError, UnstorableError
from monitor.records.filing import MAX_BLOCK
from monitor.records.ledger import StoreLedger, write_progress
from monitor.records.store import Store
from monitor.service.neighbours.condition import ConditionOf
from monitor.service.resume import resumed_state
from monitor.service.setup import source_settings, source_spec
from monitor.service.turns import Turns
from streams.block import Block, Rejected
from streams.open import open_live
from streams.source import Backlog, Delivery, LiveSource
from streams.spec import SourceError

_LOG = logging.getLogger(__name__)
_POLL_S = 0.2
"""Wait for a delivery, over all sources."""
_RETRY_S = 1.0

Result = tuple[SourceState, SourceOutput]


class Ingest(Closing):
    """Takes deliveries from sources in turn and commits them, in one thread.

    A block whose number the ledger has already is counted as ``duplicate`` or ``changed`` and is not analysed. Where
    the store cannot commit (a full disk, say), no delivery is acknowledged and the same block is tried again until it
    can. A block on which the analysis raises is committed as ``unreadable``, with the states before it.
    """

    def __init__(
        self,
        store: Store,
        ledger: StoreLedger,
        sources: Sequence[LiveSource],
        settings: Mapping[str, SourceSettings],
        clock: Callable[[], float] = time.time,
        idle: Callable[[], object] = lambda: None,
        timer: Callable[[], float] = time.monotonic,
        condition: ConditionOf | None = None,
    ) -> None:
        """Continue with the states at which the store ends; own the ledger and the sources, opened with it.

        ``settings`` are by the name of the source in blocks, ``clock`` gives UTC seconds since 1970, ``idle`` is called
        after each failed attempt to use the store, which is open for writing in this thread. ``timer`` measures, in s,
        what a block takes, by which the sources get their turns. ``condition`` gives blocks the speed and load that
        they do not state themselves.

        Raises:
            StoreError: the store cannot be read, or its states are of another version.
        """
        self.sources = tuple(sources)
        self.settings = dict(settings)
        self._states = {name: stored_state(store, found) for name, found in self.settings.items()}
        self._acknowledgements: dict[str, tuple[AlarmAcknowledgement, ...]] = {}
        self._store, self._ledger, self._clock, self._idle = store, ledger, clock, idle
        self._timer, self._condition = timer, condition
        self._store_error: str | None = None
        self._analysis_errors: dict[str, str] = {}
        self._source_errors: dict[str, str] = {}
        self._retry_at: dict[str, float] = {}
        self._turns = Turns(len(self.sources))

    @classmethod
    def open(
        cls,
        config: Config,
        store: Store,
        clock: Callable[[], float] = time.time,
        idle: Callable[[], object] = lambda: None,
        settings: Mapping[str, SourceSettings] | None = None,
        condition: ConditionOf | None = None,
    ) -> Self:
        """Open all sources of a configuration where the store ends; arguments as in :class:`Ingest`.

        ``settings`` are made of the configuration where they are not given.

        Raises:
            ConfigError: a source cannot be opened as configured.
            StoreError: the store cannot be read, or its states are of another version.
        """
        try:
            with ExitStack() as opened:
                ledger = opened.enter_context(StoreLedger(store))
                if settings is None:
                    settings = {section.name: source_settings(config, section) for section in config.source}
                specs = [source_spec(config, section) for section in config.source]
                sources = [opened.enter_context(source) for source in open_live(specs, ledger)]
                ingest = cls(store, ledger, sources, settings, clock, idle, condition=condition)
                # From here on the ingest closes ledger and sources.
                opened.pop_all()
        except SourceError as error:
            raise ConfigError(str(error)) from None
        return ingest

    def state(self, source: str) -> SourceState:
        """Return the state of a source as committed, with the latches released that were acknowledged since."""
        state = self._states[source]
        return replace(state, alarms=acknowledged(state.alarms, self._acknowledgements.get(source, ())))

    def interval(self, source: str) -> float | None:
        """Return the usual interval of the blocks of a source, s; None where it is unknown or only assumed."""
        if any(live.name == source and live.assumes_interval() for live in self.sources):
            return None
        return self._states[source].order.interval

    def acknowledge(self, source: str, given: AlarmAcknowledgement) -> bool:
        """Release a latched alarm with the next block; return whether there was one."""
        before = self.state(source).alarms
        if acknowledged(before, (given,)) == before:
            return False
        self._acknowledgements[source] = (*self._acknowledgements.get(source, ()), given)
        return True

    def run(self, stop: threading.Event, seen: Callable[[Record], None] | None = None) -> None:
        """Take deliveries until ``stop`` is set, and call ``seen`` with each committed record."""
        while not stop.is_set():
            record = self.step(stop)
            if record is not None and seen is not None:
                seen(record)

    def step(self, stop: threading.Event) -> Record | None:
        """Wait a moment for a delivery and commit it; return its record, None without one or for a refused block."""
        # First a round without waiting: a quiet source does not slow down a busy one.
        for timeout in (0.0, _POLL_S / len(self.sources)):
            for number in self._turns.order([source.queued_blocks() for source in self.sources]):
                source, began = self.sources[number], self._timer()
                delivery = self._next_delivery(source, timeout, stop)
                if delivery is None:
                    self._turns.missed(number, max(0.0, self._timer() - began - timeout))
                    continue
                record = self._take(source, delivery, stop)
                self._turns.served(number, self._timer() - began)
                return record
        return None

    def _next_delivery(self, source: LiveSource, timeout: float, stop: threading.Event) -> Delivery | None:
        if time.monotonic() < self._retry_at.get(source.name, 0.0):
            stop.wait(timeout)
            return None
        found: list[Delivery | None] = []
        try:
            # A source that reads the ledger meets the same full disk as a commit does.
            self._retry(lambda: found.append(source.next(timeout)), stop)
        except Exception as error:  # A fault of one source must not stop the others.
            known = source.name in self._source_errors
            self._source_errors[source.name] = f"it fails: {type(error).__name__}: {error}"
            self._retry_at[source.name] = time.monotonic() + _RETRY_S
            _LOG.error("%s: %s", source.name, self._source_errors[source.name], exc_info=None if known else error)
            return None
        self._source_errors.pop(source.name, None)
        return found[0] if found else None

    def _take(self, source: LiveSource, delivery: Delivery, stop: threading.Event) -> Record | None:
        item = self._unless_known(delivery.item)
        record: Record | None = None
        if isinstance(item, Rejected) and item.is_repetition:
            refused = item
            done = self._retry(lambda: self._ledger.refuse(refused, delivery.progress), stop)
        else:
            record = self._analyse(item, delivery, stop)
            done = record is not None
        if done:
            self._retry(lambda: self._ledger.survive(source.name, delivery.progress), stop)
            source.acknowledge(delivery)
        return record

    def _unless_known(self, item: Block | Rejected) -> Block | Rejected:
        """Return the item, or the rejection of one whose number the ledger has."""
        if isinstance(item, Rejected) and item.is_repetition:
            return item
        known = self._ledger.content_of(item.source, item.sequence)
        if known is None:
            # A file that a salvaged ledger has lost is read again, and its blocks get new numbers.
            number = self._ledger.number_of(item.source, item.name, item.content_hash) if item.content_hash else None
            if number is None:
                return item
            reason = f"is block {number} read once more"
            return Rejected(item.source, number, item.name, "duplicate", reason, item.content_hash)
        status = "duplicate" if known == item.content_hash else "changed"
        reason = f"block {item.sequence} is there already"
        return Rejected(item.source, item.sequence, item.name, status, reason, item.content_hash)

    def _analyse(self, item: Block | Rejected, delivery: Delivery, stop: threading.Event) -> Record | None:
        """Analyse and commit one block; return its record, or None where ``stop`` came before the commit."""
        try:
            if self._condition is not None and isinstance(item, Block):
                item = self._condition(item)
            files = [progress.path for progress in delivery.progress]
            state, output = result = self._step(item, files)
            done = self._commit(result, delivery, stop)
            if output.record.accepted and self._analysis_errors.pop(item.source, None) is not None:
                _LOG.warning("%s: blocks can be analysed again", item.source)
        except Exception as error:  # A block on which the analysis raises must not stop the next ones.
            state, output = result = self._failed(item, error)
            done = self._commit(result, delivery, stop, final=True)
        if not done:
            return None
        if state is not self._states[item.source]:
            self._states[item.source] = state
            self._acknowledgements.pop(item.source, None)
        return output.record

    def _step(self, item: Block | Rejected, files: Sequence[str] = ()) -> Result:
        """Analyse a block; its files are noted meanwhile, should the process die of it."""
        given = self._acknowledgements.get(item.source, ())
        before, settings = self._states[item.source], self.settings[item.source]
        if not files:
            return step(before, item, settings, now=self._clock(), acknowledgements=given)
        size = item.samples.nbytes if isinstance(item, Block) else 0
        # A death while this loads is not that of the first file, which comes first after each start.
        load_fftw()
        self._ledger.analyse(item.source, files, size)
        try:
            return step(before, item, settings, now=self._clock(), acknowledgements=given)
        finally:
            self._ledger.analyse(item.source, ())

    def _failed(self, item: Block | Rejected, error: Exception) -> Result:
        """Return the result of a block that cannot be analysed or stored: that of a rejection in its place."""
        reason = f"the analysis failed: {type(error).__name__}: {error}"
        known = item.source in self._analysis_errors
        _LOG.error("%s: block %d: %s", item.source, item.sequence, reason, exc_info=None if known else error)
        rejection = rejection_of(item, "unreadable", reason)
        self._analysis_errors[item.source] = f"block {item.sequence}: {rejection.reason}"
        try:
            return self._step(rejection)
        except Exception:
            # The stages raise even on a rejection: it is recorded, and they keep their states.
            return self._states[item.source], SourceOutput(rejected_record(rejection))

    def _commit(self, result: Result, delivery: Delivery, stop: threading.Event, *, final: bool = False) -> bool:
        state, output = result
        stored, record = state.to_stored(), output.record

        def write() -> None:
            self._store.commit(
                record,
                stored,
                lambda connection: write_progress(connection, record.source, delivery.progress),
                output.spectra,
            )

        return self._retry(write, stop, final=final)

    def _retry(self, action: Callable[[], Any], stop: threading.Event, *, final: bool = True) -> bool:
        """Repeat an action until the database allows it; return False where ``stop`` is set first.

        Raises:
            UnstorableError: no attempt can succeed, and it is not ``final``: something else can be stored instead.
        """
        while True:
            try:
                action()
            except StoreError as error:
                if isinstance(error, UnstorableError) and not final:
                    raise
                if self._store_error is None:
                    _LOG.error("the store fails, nothing is committed: %s", error)
                self._store_error = str(error)
                self._idle()
                if stop.wait(_RETRY_S):
                    return False
                continue
            if self._store_error is not None:
                _LOG.warning("the store works again")
            self._store_error = None
            return True

    def backlogs(self) -> dict[str, Backlog]:
        """Return the progress of each source, by name."""
        return {source.name: source.backlog() for source in self.sources}

    def ignored(self) -> dict[str, str]:
        """Return why files are ignored, by name, which begins with the source where there are several."""
        several = len(self.sources) > 1
        return {
            f"{source.name}/{name}" if several else name: reason
            for source in self.sources
            for name, reason in source.ignored().items()
        }

    def poisoned(self) -> list[tuple[str, str]]:
        """Return source and path of the files that are set aside; StoreError where the ledger cannot be read."""
        return self._ledger.poisoned()

    def problems(self) -> dict[str, str]:
        """Return the present problems, by the name of the source, and under "store" why no block can be committed."""
        found = {source.name: problem for source in self.sources if (problem := source.problem()) is not None}
        for name, failure in (*self._source_errors.items(), *self._analysis_errors.items()):
            found[name] = f"{found[name]}; {failure}" if name in found else failure
        return found | ({"store": self._store_error} if self._store_error is not None else {})

    def notices(self) -> list[dict[str, Any]]:
        """Return what is new of the sources for the event log."""
        return [notice for source in self.sources for notice in source.notices()]

    def close(self) -> None:
        """Close the sources and the ledger; the store stays open."""
        for source in self.sources:
            source.close()
        self._ledger.close()


def stored_state(store: Store, settings: SourceSettings) -> SourceState:
    """Return the state of a source at which a store ends; StoreError where it is of another version."""
    try:
        state = resumed_state(store, settings)
        if state.order.sequence > MAX_BLOCK:
            # All later blocks would be late.
            state = replace(state, order=replace(state.order, sequence=store.last(settings.name)))
        return state
    except (KeyError, TypeError, ValueError) as error:
        raise StoreError(f"{store.path}: a state in it is of another version ({error})") from error
