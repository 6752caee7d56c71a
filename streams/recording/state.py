"""One pass over a recording, and its state, from which another pass goes on without the files behind."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from streams.dates.dater import Dater
from streams.dates.dating import Dating
from streams.reblock import HeldSamples, Numbering, Reblocker
from streams.recording.repeats import Given, GivenState
from streams.types.block import Block, Rejected
from streams.types.source import Source

VERSION = 1
"""Of a state; one of another version is not used, and the recording is read from its beginning."""


@dataclass(frozen=True, eq=False)
class ReadingState:
    """State of a pass before the latest file that it read, and how much that file has given since.

    That file is read again, and the first ``items`` of what comes are left out.

    Attributes:
        data_set, endings: name of the data set or format, and endings of its files, as they were recognised.
        files: number of files behind, in order of acquisition.
        names: digest of their paths and that of the latest file, so that a folder with others is refused.
        items: blocks and rejections that the latest file has given.
        highest: number of the latest block before them; ``latest`` that of them too.
        began: start of the first dated block, s since 1970 UTC, or None.
        given: contents, numbers and counts of the files behind.
        held: samples of them that wait for more; None where each file is a block.
        repetitions: all that were met, also since.
        dating, remarks: what dates the files, and sentences about it.
    """

    data_set: str
    endings: tuple[str, ...]
    files: int
    names: str
    items: int
    highest: int
    latest: int
    began: float | None
    given: GivenState
    held: HeldSamples | None = None
    repetitions: tuple[Rejected, ...] = ()
    dating: Dating | None = None
    remarks: Mapping[str, str] = field(default_factory=dict[str, str])
    version: int = VERSION


@runtime_checkable
class ResumableSource(Source, Protocol):
    """A recording of which another pass can go on where one has ended."""

    def state(self) -> ReadingState | None:
        """Return the state after the latest item; None where a pass has to begin at the first file."""
        ...

    def has_blocks(self, count: int) -> bool:
        """Return whether there are so many blocks and rejections, without reading on behind them."""
        ...


class RecordingPass:
    """One pass over the files of a recording: numbers, repetitions, and samples that wait for more."""

    def __init__(
        self, source: str, dater: Dater | None, cutter: Reblocker | None, begin: ReadingState | None = None
    ) -> None:
        """Begin at the first file, or go on from a state."""
        place_time = None if dater is None else dater.place_time
        self.dater, self.cutter = dater, cutter
        self.given = Given() if begin is None else Given.of(begin.given)
        self.repetitions: list[Rejected] = [] if begin is None else [*begin.repetitions]
        highest, began = (0, None) if begin is None else (begin.highest, begin.began)
        self.numbers = Numbering(source, highest, began, place_time)
        self.files = 0 if begin is None else begin.files
        self._paths: Sequence[str] | None = None
        self._items = 0
        self._before: tuple[int, float | None, HeldSamples | None] | None = None
        if cutter is not None and begin is not None and begin.held is not None:
            cutter.restore(begin.held)
            self.given.note_held([piece.origin for piece in begin.held.pieces], begin.given.in_blocks)

    def begin_files(self, paths: Sequence[str]) -> None:
        """Note the paths of all files in order of acquisition."""
        self._paths = paths

    def begin_file(self, number: int) -> None:
        """Note the state before the file of a number, from 0."""
        self.files, self._items = number, 0
        held = None if self.cutter is None else self.cutter.held_samples()
        self.given.begin_file()
        self._before = (self.numbers.highest, self.numbers.began, held)

    def note(self, item: Block | Rejected) -> None:
        """Count an item of the latest file."""
        self._items += 1
        if not (isinstance(item, Rejected) and item.is_repetition):
            self.numbers.note(item)

    def state(self, data_set: str, endings: tuple[str, ...]) -> ReadingState | None:
        """Return the state after the latest item; None before the first, and of files in the order of an archive."""
        if self._before is None or self._paths is None:
            return None
        highest, began, held = self._before
        return ReadingState(
            data_set,
            endings,
            self.files,
            names_digest(self._paths[: self.files + 1]),
            self._items,
            highest,
            self.numbers.highest,
            began,
            self.given.state_before(() if held is None else [piece.origin for piece in held.pieces]),
            held,
            tuple(self.repetitions),
            None if self.dater is None else self.dater.choice,
            {} if self.dater is None else dict(self.dater.remarks),
        )


def names_digest(paths: Sequence[str]) -> str:
    """Return the digest of paths in their order."""
    text = "\0".join(paths).encode("utf-8", "surrogateescape")
    return hashlib.blake2b(text, digest_size=16).hexdigest()
