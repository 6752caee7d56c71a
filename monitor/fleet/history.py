"""Recordings that continue each other as one source, and the store of records between two parts of them."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from models.words.errors import WrongInputError
from models.work.codec import decode, encode
from monitor.config.load import ConfigError
from monitor.health.signal.bands import VOTES_NEEDED
from monitor.records.compact import rebuild
from monitor.records.condense import condense
from monitor.records.database import MAGIC
from monitor.records.queries import first_start, has_undated, refusals_of
from monitor.records.store import Store
from streams.recording.state import VERSION, ReadingState, ResumableSource
from streams.types.block import Block, Rejected
from streams.types.source import Source

_FULL_S = 86400.0
"""Full records stay in the store for a day of record time: the day that the next part completes."""
_ALL = 1 << 40

Opener = Callable[[str, ReadingState | None], AbstractContextManager[Source]]


@dataclass(frozen=True)
class Position:
    """Where the next part of a history begins.

    Attributes:
        part: number of the part, from 0.
        recording: number of recordings that are behind.
        blocks: highest number of a block in them.
    """

    part: int = 0
    recording: int = 0
    blocks: int = 0


class HistorySource:
    """Recordings in their order as one source: blocks are numbered on, and time counts from the first block.

    A recording that cannot be opened, or has no dates although it continues another, ends it: see ``problem``.
    """

    def __init__(
        self,
        name: str,
        recordings: Sequence[str],
        begin: Position,
        opener: Opener,
        reading: ReadingState | None = None,
    ) -> None:
        """Take recordings from a position on.

        ``opener`` opens one for the time of a ``with`` statement, the first one to go on from ``reading``.
        """
        self.name = name
        self._recordings, self._begin, self._open, self._reading = recordings, begin, opener, reading
        self._source: Source | None = None
        self._began: float | None = None
        self._undated = False
        self._refused: tuple[Rejected, ...] = ()
        self._length: int | None = None
        self.reached = begin
        """Where the next part begins, as of the latest block."""
        self.problem: str | None = None

    def after(self, store: Path) -> None:
        """Continue the blocks of a store."""
        with Store.open(store, read_only=True) as found:
            undated, first = has_undated(found, self.name), first_start(found, self.name)
            refused = refusals_of(found, self.name)
        repetitions = (
            Rejected(
                self.name, item.sequence, item.name, item.status, f"{item.name}: in an earlier part", item.content_hash
            )
            for item in refused
            for _ in range(item.times)
        )
        self.continues(first, repetitions, undated=undated)

    def state(self) -> ReadingState | None:
        """Return the state of the recording being read, as :meth:`streams.recording.state.ResumableSource.state`."""
        return self._source.state() if isinstance(self._source, ResumableSource) else None

    def continues(self, began: float | None, repetitions: Iterable[Rejected], *, undated: bool = False) -> None:
        """Continue blocks of which the first dated one ``began`` then; ``undated``: some have no date."""
        self._began, self._undated = began, undated
        # Those in the recording that is under way are met again.
        self._refused = tuple(item for item in repetitions if item.sequence <= self._begin.blocks)

    def __iter__(self) -> Iterator[Block | Rejected]:
        """Iterate over the blocks from the position on."""
        self.problem, began, undated = None, self._began, self._undated
        yield from self._refused
        blocks, reading = self._begin.blocks, self._reading
        for place, recording in enumerate(self._recordings, self._begin.recording):
            self.reached = Position(self._begin.part + 1, place, blocks)
            highest = blocks if reading is None else blocks + reading.latest
            try:
                with self._open(recording, reading) as source:
                    self._source = source
                    for found in source:
                        item = _continued(found, blocks, began, undated=undated) if place else found
                        if isinstance(item, Block):
                            began = item.start if began is None else began
                            undated = undated or item.start is None
                        if not (isinstance(item, Rejected) and item.is_repetition):
                            highest = max(highest, item.sequence)
                        yield item
            except WrongInputError as error:
                self.problem = str(error)
                return
            blocks, reading, self._source = highest, None, None
        self.reached = Position(self._begin.part + 1, self._begin.recording + len(self._recordings), blocks)

    def __len__(self) -> int:
        """Return the number of blocks, or ``VOTES_NEEDED`` where there are more."""
        if self._length is None:
            reached, problem = self.reached, self.problem
            self._length = sum(1 for _ in islice(self, VOTES_NEEDED))
            self.reached, self.problem, self._source = reached, problem, None
        return self._length


def end_of(store: Path, source: str) -> int | None:
    """Return the highest number of a block of a source, None where a longer history would not go on from this store.

    Blocks without a date cannot be continued; and a history too short to learn its bands chooses them from all of it.
    """
    with Store.open(store, read_only=True) as found:
        last = found.last(source)
        return None if last < VOTES_NEEDED or has_undated(found, source) else last


def _continued(item: Block | Rejected, blocks: int, began: float | None, *, undated: bool) -> Block | Rejected:
    """Return an item numbered after ``blocks``, its time from the first block of the history.

    Raises:
        ConfigError: it has no date, or those before have none.
    """
    if isinstance(item, Rejected):
        return replace(item, sequence=item.sequence + blocks)
    if item.start is None or undated:
        without = "it has no date" if item.start is None else "blocks before it have no date"
        raise ConfigError(
            f"{item.name}: {without}, so it cannot continue another recording; "
            'state what dates it (time_from), or set history = "each"'
        )
    return replace(item, sequence=item.sequence + blocks, elapsed=item.start - (item.start if began is None else began))


@dataclass(frozen=True, eq=False)
class KeptState:
    """What the next part of a recording or history begins from: a store of records, and how far its files were read.

    ``reading`` is None where they are read from the first one on.
    """

    store: bytes
    reading: ReadingState | None = None


def packed_state(path: Path, reading: ReadingState | None) -> bytes:
    """Return a store for the next part, without what the published days hold, and the state of reading as bytes.

    Without ``reading`` they are those of the SQLite file alone, which later versions read too.

    Full records older than a day leave it, as they leave the store of a daemon, unless a record has no date: then all
    stay, since all are in one file.
    """
    with Store.open(path) as store:
        if not has_undated(store):
            while condense(store, _FULL_S, _ALL):
                pass
    rebuild(path)
    store = path.read_bytes()
    return zlib.compress(store if reading is None else encode(KeptState(store, reading)), 1)


def unpack_state(data: bytes, path: Path) -> ReadingState | None:
    """Write the store that :func:`packed_state` gave, and return the state of reading."""
    raw = zlib.decompress(data)
    kept = KeptState(raw) if raw.startswith(MAGIC) else decode(raw)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(kept.store)
    return kept.reading if kept.reading is not None and kept.reading.version == VERSION else None
