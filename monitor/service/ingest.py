"""From live sources to the store: each delivery is judged, committed, and only then acknowledged."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

from monitor.config.load import Config, ConfigError
from monitor.health.record import Record, storable
from monitor.records.ledger import StoreLedger, write_progress
from monitor.records.store import Store, StoreError, UnstorableError
from monitor.service.recording import rejected_record
from monitor.service.setup import channel_setups, source_spec
from monitor.service.watcher import Memory, UnfitError, Watcher
from streams.block import Block, Rejected
from streams.open import open_live
from streams.source import Backlog, Delivery, LiveSource
from streams.spec import SourceError

_LOG = logging.getLogger(__name__)
_TURN = 0.2
_RETRY = 1.0
_LONGEST_REASON = 500


class Ingest:
    """Takes deliveries from sources in turn and commits them, in one thread.

    A block whose number the ledger has already is counted as ``duplicate`` or ``changed`` and never judged. Where the
    store cannot commit (a full disk, say), nothing is acknowledged and the same block is tried again until it can. A
    block that the analysis cannot bear is committed as ``unreadable``, as if it had never been heard.
    """

    def __init__(
        self,
        store: Store,
        ledger: StoreLedger,
        sources: Sequence[LiveSource],
        watchers: Mapping[str, Watcher],
        clock: Callable[[], float] = time.time,
        idle: Callable[[], object] = lambda: None,
    ) -> None:
        """Take what others have opened.

        Args:
            store: open for writing, in this thread.
            ledger: on that store; the sources were opened with it.
            sources: open; they are closed with the ingest.
            watchers: by the name of the source that their blocks bear.
            clock: UTC seconds since 1970.
            idle: called in this thread each time that the store was in vain asked to commit.
        """
        self.sources = tuple(sources)
        self.watchers = dict(watchers)
        self._store, self._ledger, self._clock, self._idle = store, ledger, clock, idle
        self._trouble: str | None = None
        self._failures: dict[str, str] = {}
        self._deaf: dict[str, str] = {}
        self._resting: dict[str, float] = {}
        self._turn = 0

    @classmethod
    def open(
        cls,
        config: Config,
        store: Store,
        clock: Callable[[], float] = time.time,
        idle: Callable[[], object] = lambda: None,
    ) -> Self:
        """Open all sources of a configuration where the store ends.

        Args:
            config: the machine.
            store: open for writing.
            clock: UTC seconds since 1970.
            idle: called in this thread each time that the store was in vain asked to commit.

        Raises:
            ConfigError: a source cannot be opened as configured.
            StoreError: the store cannot be read, or its states are of another version.
        """
        try:
            with ExitStack() as opened:
                ledger = opened.enter_context(StoreLedger(store))
                watchers: dict[str, Watcher] = {}
                states = store.load_states()
                for section in config.source:
                    watcher = Watcher(section.name, channel_setups(config, section), section.rate_hz)
                    latest = store.record(section.name, store.last(section.name))
                    try:
                        watcher.restore(states, latest)
                    except (KeyError, TypeError, ValueError) as error:
                        raise StoreError(f"{store.path}: a state in it is of another version ({error})") from error
                    watchers[section.name] = watcher
                specs = [source_spec(config, section) for section in config.source]
                sources = [opened.enter_context(source) for source in open_live(specs, ledger)]
                # All are open: from here on the ingest closes them.
                opened.pop_all()
        except SourceError as error:
            raise ConfigError(str(error)) from None
        return cls(store, ledger, sources, watchers, clock, idle)

    def run(self, stop: threading.Event, seen: Callable[[Record], None] | None = None) -> None:
        """Take deliveries until told to stop; a delivery that was begun is finished first if the store lets it.

        Args:
            stop: set by whoever wants an end.
            seen: called with each record after its commit.
        """
        while not stop.is_set():
            record = self.step(stop)
            if record is not None and seen is not None:
                seen(record)

    def step(self, stop: threading.Event) -> Record | None:
        """Wait a moment for a delivery and commit it.

        Args:
            stop: set by whoever wants an end; ends the attempts to commit.

        Returns:
            The committed record, or None where nothing came or the block was refused.
        """
        # Whoever has something is served before anyone is waited for: a quiet source does not slow down a busy one.
        for timeout in (0.0, _TURN / len(self.sources)):
            for _ in self.sources:
                source = self.sources[self._turn]
                self._turn = (self._turn + 1) % len(self.sources)
                delivery = self._next(source, timeout, stop)
                if delivery is not None:
                    return self._take(source, delivery, stop)
        return None

    def _next(self, source: LiveSource, timeout: float, stop: threading.Event) -> Delivery | None:
        if time.monotonic() < self._resting.get(source.name, 0.0):
            stop.wait(timeout)
            return None
        found: list[Delivery | None] = []
        try:
            # A source that asks the ledger meets the same full disk as a commit does.
            self._insist(lambda: found.append(source.next(timeout)), stop)
        except Exception as error:  # A fault of one source must not take the others with it.
            known = source.name in self._deaf
            self._deaf[source.name] = f"it fails: {type(error).__name__}: {error}"
            self._resting[source.name] = time.monotonic() + _RETRY
            _LOG.error("%s: %s", source.name, self._deaf[source.name], exc_info=None if known else error)
            return None
        self._deaf.pop(source.name, None)
        return found[0] if found else None

    def _take(self, source: LiveSource, delivery: Delivery, stop: threading.Event) -> Record | None:
        item = self._with_place(delivery.item)
        record: Record | None = None
        if isinstance(item, Rejected) and item.status in ("duplicate", "changed"):
            refused = item
            done = self._insist(lambda: self._ledger.refuse(refused, delivery.progress), stop)
        else:
            record, done = self._committed(self.watchers[item.source], item, delivery, stop)
        if not done:
            return None
        source.acknowledge(delivery)
        return record

    def _committed(
        self, watcher: Watcher, item: Block | Rejected, delivery: Delivery, stop: threading.Event
    ) -> tuple[Record, bool]:
        """Judge and commit one block; return its record, and whether it was committed before the end came."""
        before = watcher.remembered()
        try:
            record = self._judged(watcher, item, before)
            done = self._commit(watcher, record, delivery, stop)
            if record.accepted and self._failures.pop(record.source, None) is not None:
                _LOG.warning("%s: blocks can be analysed again", record.source)
        except Exception as error:  # Whatever one block does to the analysis, the blocks after it are heard.
            record = self._failed(watcher, item, before, error)
            done = self._commit(watcher, record, delivery, stop, final=True)
        return record, done

    def _commit(
        self, watcher: Watcher, record: Record, delivery: Delivery, stop: threading.Event, *, final: bool = False
    ) -> bool:
        states, spectra = watcher.states(), watcher.spectra

        def write() -> None:
            self._store.commit(
                record,
                states,
                lambda connection: write_progress(connection, record.source, delivery.progress),
                spectra,
            )

        return self._insist(write, stop, final=final)

    def _with_place(self, item: Block | Rejected) -> Block | Rejected:
        """Return the item, or the rejection of one whose number is taken."""
        if isinstance(item, Rejected) and item.status in ("duplicate", "changed"):
            return item
        had = self._ledger.content_of(item.source, item.sequence)
        if had is None:
            # A file that a salvaged ledger has lost sight of is read again, and its blocks get new numbers.
            number = self._ledger.number_of(item.source, item.name, item.content_hash) if item.content_hash else None
            if number is None:
                return item
            reason = f"is block {number} read once more"
            return Rejected(item.source, number, item.name, "duplicate", reason, item.content_hash)
        status = "duplicate" if had == item.content_hash else "changed"
        reason = f"block {item.sequence} is there already"
        return Rejected(item.source, item.sequence, item.name, status, reason, item.content_hash)

    def _judged(self, watcher: Watcher, item: Block | Rejected, before: Memory) -> Record:
        now = self._clock()
        try:
            return watcher.process(item, now=now)
        except UnfitError as error:
            # A recording would be given up here; of a live source the next block may be better.
            watcher.go_back(before)
            return watcher.process(_in_its_place(item, error.status, str(error)), now=now)

    def _failed(self, watcher: Watcher, item: Block | Rejected, before: Memory, error: Exception) -> Record:
        """Return the record of a block that cannot be analysed, or stored; its states are those before the block."""
        reason = f"the analysis failed: {type(error).__name__}: {error}"
        known = item.source in self._failures
        _LOG.error("%s: block %d: %s", item.source, item.sequence, reason, exc_info=None if known else error)
        refused = _in_its_place(item, "unreadable", reason)
        self._failures[item.source] = f"block {item.sequence}: {refused.reason}"
        watcher.go_back(before)
        try:
            return watcher.process(refused, now=self._clock())
        except Exception:
            # Not even a rejection gets through the stages: it is put down, and they stay as they were.
            watcher.go_back(before)
            return rejected_record(refused)

    def _insist(self, action: Callable[[], Any], stop: threading.Event, *, final: bool = True) -> bool:
        """Do what needs the database, however often it takes; return False where the end came first.

        Raises:
            UnstorableError: no attempt can succeed, and it is not ``final``: something else can be stored instead.
        """
        while True:
            try:
                action()
            except StoreError as error:
                if isinstance(error, UnstorableError) and not final:
                    raise
                if self._trouble is None:
                    _LOG.error("the store fails, nothing is committed: %s", error)
                self._trouble = str(error)
                self._idle()
                if stop.wait(_RETRY):
                    return False
                continue
            if self._trouble is not None:
                _LOG.warning("the store works again")
            self._trouble = None
            return True

    def backlogs(self) -> dict[str, Backlog]:
        """Return how far each source has come, by name."""
        return {source.name: source.backlog() for source in self.sources}

    def problems(self) -> dict[str, str]:
        """Return what is wrong, by the name of the source, and under "store" why nothing can be committed."""
        found = {source.name: problem for source in self.sources if (problem := source.problem()) is not None}
        for name, failure in (*self._deaf.items(), *self._failures.items()):
            found[name] = f"{found[name]}; {failure}" if name in found else failure
        return found | ({"store": self._trouble} if self._trouble is not None else {})

    def close(self) -> None:
        """Close the sources and the ledger; the store stays open."""
        for source in self.sources:
            source.close()
        self._ledger.close()

    def __enter__(self) -> Self:
        """Return the ingest itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the ingest."""
        self.close()


def _in_its_place(item: Block | Rejected, status: str, reason: str) -> Rejected:
    """Return the rejection that stands in the place of a block; texts that come from outside are made storable."""
    said = storable(" ".join(reason.split())[:_LONGEST_REASON])
    return Rejected(item.source, item.sequence, storable(item.name), status, said, item.content_hash)
