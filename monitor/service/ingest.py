"""Live sources in turn: each gives the pipeline its next block, and one that keeps up is not delayed by the others."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from statistics import median_low
from typing import Any, Self

from models.platform.supervision import Restarts
from monitor.config.load import Config, ConfigError
from monitor.health.record import Record
from monitor.health.state import SourceSettings
from monitor.pipeline import ConditionOf, Pipeline, PipelineOptions
from monitor.records.database import Closing
from monitor.records.failures import StoreDamagedError
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.progress import SourceProgress
from monitor.service.setup import source_settings, source_spec
from streams.dates.pairs import clocks_apart
from streams.open import open_live
from streams.types.source import Backlog, Delivery, LiveSource
from streams.types.spec import SourceError

_LOG = logging.getLogger(__name__)
_POLL_S = 0.2
"""Wait for a delivery, over all sources."""
_RETRY_S = 1.0
_PROMPT_S = 0.1
"""A source whose waiting blocks take less time than this keeps up."""
_LEVEL = 2.0
"""Sources whose waiting blocks take up to this many times as long as the shortest of a level are of the same level."""
_UNKNOWN_S = 0.01
"""Time that a block of a source takes of which none was served yet."""
_SHARE = 0.2
"""Share of the time, at least, of the sources that are behind, while others are served before them."""
_RECENT_BLOCKS = 5
"""Blocks whose median is the time that a block of a source takes: the first one may load libraries."""
_MAX_FACTOR = 4.0
"""A block counts as at most this many times the median: one during which the disk was full says nothing of the next."""


class Ingest(Pipeline, Closing):
    """Takes deliveries from sources in turn and commits them, in one thread."""

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

        ``timer`` measures, in s, what a block takes, by which the sources get their turns. The others are those of
        :class:`PipelineOptions`.

        Raises:
            StoreError: the store cannot be read, or its states are of another version.
        """
        super().__init__(settings, store, PipelineOptions(clock, condition, idle=idle), ledger)
        self.sources = tuple(sources)
        self._live_ledger, self._timer = ledger, timer
        self._source_errors: dict[str, str] = {}
        self._retry_at: dict[str, float] = {}
        self._turns = Turns(len(self.sources))
        self.progress = SourceProgress(timer)
        self._held: tuple[int, Delivery] | None = None

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
            raise ConfigError(str(error)) from error
        return ingest

    def interval(self, source: str) -> float | None:
        """Return the usual interval of the blocks of a source, s; None where it is unknown or only assumed."""
        if any(live.name == source and live.assumes_interval() for live in self.sources):
            return None
        return self._states[source].order.clock.interval

    def run(self, stop: threading.Event, seen: Callable[[Record], None] | None = None) -> None:
        """Take deliveries until ``stop`` is set, and call ``seen`` with each committed record."""
        while not stop.is_set():
            record = self.step(stop)
            if record is not None and seen is not None:
                seen(record)

    def step(self, stop: threading.Event) -> Record | None:
        """Wait a moment for a delivery and commit it; return its record, None without one or for a refused block.

        After an exception, which is none of a source or a block, the next call goes on with the same delivery.
        """
        if self._held is not None:
            return self._deliver_held(stop)
        # First a round without waiting: a quiet source does not slow down a busy one.
        for timeout in (0.0, _POLL_S / len(self.sources)):
            for number in self._turns.order([source.queued_blocks() for source in self.sources]):
                source, began = self.sources[number], self._timer()
                delivery = self._next_delivery(source, timeout, stop)
                if delivery is None:
                    self._turns.missed(number, max(0.0, self._timer() - began - timeout))
                    continue
                self._held = number, delivery
                record = self._deliver_held(stop)
                self._turns.served(number, self._timer() - began)
                return record
        return None

    def _deliver_held(self, stop: threading.Event) -> Record | None:
        assert self._held is not None
        number, delivery = self._held
        record = self.deliver(self.sources[number], delivery, stop)
        self.progress.note(self.sources[number].name)
        self._held = None
        return record

    def _next_delivery(self, source: LiveSource, timeout: float, stop: threading.Event) -> Delivery | None:
        if time.monotonic() < self._retry_at.get(source.name, 0.0):
            stop.wait(timeout)
            return None
        found: list[Delivery | None] = []
        try:
            # A source that reads the ledger meets the same full disk as a commit does.
            self.retry(lambda: found.append(source.next(timeout)), stop)
        except StoreDamagedError:
            raise
        except Exception as error:  # A fault of one source must not stop the others.
            known = source.name in self._source_errors
            self._source_errors[source.name] = f"it fails: {type(error).__name__}: {error}"
            self._retry_at[source.name] = time.monotonic() + _RETRY_S
            _LOG.error("%s: %s", source.name, self._source_errors[source.name], exc_info=None if known else error)
            return None
        self._source_errors.pop(source.name, None)
        return found[0] if found else None

    def tend(self) -> None:
        """Start again what has ended of the sources; LostThreadError where a thread hangs."""
        for source in self.sources:
            source.tend()
        self.progress.look({source.name: source.ready_blocks() for source in self.sources})

    def stalled(self) -> list[str]:
        """Return the sources whose blocks wait for no known reason."""
        return self.progress.stalled({*self._source_errors, *({"store"} if self.store_fails else ())})

    def restarts(self) -> dict[str, Restarts]:
        """Return what is known of the failures of threads of the sources, by the name of the thread."""
        return {found.name: found for source in self.sources for found in source.restarts()}

    def listeners(self) -> dict[str, Mapping[str, Any]]:
        """Return the counts of connections of each source that listens, by name."""
        found = {source.name: source.listener() for source in self.sources}
        return {name: counts for name, counts in found.items() if counts is not None}

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
        return self._live_ledger.poisoned()

    def problems(self) -> dict[str, str]:
        """Return the present problems, by the name of the source, and under "store" why no block can be committed."""
        found = clocks_apart({source.name: self._states[source.name].order.clock for source in self.sources})
        found |= {source.name: problem for source in self.sources if (problem := source.problem()) is not None}
        for name, failure in (*self._source_errors.items(), *super().problems().items()):
            found[name] = f"{found[name]}; {failure}" if name in found else failure
        return found

    def notices(self) -> list[dict[str, Any]]:
        """Return what is new of the sources for the event log."""
        return [notice for source in self.sources for notice in source.notices()]

    def close(self) -> None:
        """Close the sources and the ledger; the store stays open."""
        for source in self.sources:
            source.close()
        self._live_ledger.close()


class Turns:
    """The source whose waiting blocks take least time comes first; within a level, the one served least recently.

    Sources with about as much waiting share the turns. Sources behind others have a fifth of the time at least. Shares
    of turns would not do: a source that keeps up and needs more than an equal share of them, on a busy machine or with
    a block every 50 ms, would fall behind, and be delayed by the others for as long as these take.
    """

    def __init__(self, count: int) -> None:
        """Begin with ``count`` sources of which nothing is known."""
        self._queue = list(range(count))
        self._in_succession = [0] * count
        self._recent: list[deque[float]] = [deque(maxlen=_RECENT_BLOCKS) for _ in range(count)]
        self._block_s = [_UNKNOWN_S] * count
        self._levels: list[int | None] = [None] * count
        self._owed_s = 0.0

    def order(self, waiting: Sequence[float | None]) -> list[int]:
        """Return the numbers of all sources in the order in which to ask them.

        ``waiting`` is about how many blocks of each source wait; where it is None, as many as came in succession.
        """
        work = {number: self._work(number, blocks) for number, blocks in enumerate(waiting)}
        known = {number: seconds for number, seconds in work.items() if seconds is not None}
        self._levels = [None] * len(self._levels)
        level, limit = -1, -1.0
        for number, seconds in sorted(known.items(), key=lambda item: item[1]):
            if seconds > limit:
                level, limit = level + 1, max(_LEVEL * seconds, _PROMPT_S)
            self._levels[number] = level
        ordered = sorted(self._queue, key=lambda number: self._levels[number] or 0)
        behind = [number for number in self._queue if self._is_behind(number)]
        if not behind or self._owed_s < self._block_s[behind[0]]:
            return ordered
        return [*behind, *(number for number in ordered if number not in behind)]

    def missed(self, number: int, seconds: float) -> None:
        """Note that a source had no block, and how long it took to ask it."""
        if self._is_behind(number):
            self._owed_s -= seconds
        self._in_succession[number] = 0
        self._levels[number] = None

    def served(self, number: int, seconds: float) -> None:
        """Note that a block of a source was served, and how long that took."""
        recent = self._recent[number]
        recent.append(seconds)
        self._block_s[number] = median_low(recent)
        seconds = min(seconds, _MAX_FACTOR * self._block_s[number])
        self._levels[number] = self._levels[number] or 0
        if self._is_behind(number):
            self._owed_s -= seconds
        elif any(map(self._is_behind, self._queue)):
            self._owed_s += seconds * _SHARE / (1.0 - _SHARE)
        else:
            self._owed_s = 0.0
        self._in_succession[number] += 1
        self._queue.remove(number)
        self._queue.append(number)

    def _work(self, number: int, waiting: float | None) -> float | None:
        """Return the time that the waiting blocks of a source take, s; None where it seems to have no block."""
        blocks = self._in_succession[number] if waiting is None else waiting
        if not blocks and not self._in_succession[number]:
            return None
        return blocks * self._block_s[number]

    def _is_behind(self, number: int) -> bool:
        """Return whether others that have blocks, as of the latest order, come before this source."""
        level = self._levels[number]
        return level is not None and level > min(other for other in self._levels if other is not None)
