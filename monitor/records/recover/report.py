"""The report of a recovery, for the log and the event log."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class BlockRange:
    """Consecutive blocks of a source: numbers of the first and the last."""

    source: str
    first: int
    last: int

    def __str__(self) -> str:
        """Return the blocks in words."""
        return f"{self.source} {self.first}" + (f" to {self.last}" if self.last > self.first else "")


@dataclass(frozen=True)
class SalvageReport:
    """Result of a recovery.

    Attributes:
        aside: the damaged database, or None where there was none; its write-ahead log has the same name and ``-wal``.
        reason: what was found.
        saved: number of records that are as they were committed.
        unchecked: those of them without a digest: of an older version, or the digest is lost.
        restored: those of them from the published files.
        emptied: blocks whose record is lost; the ledger entry is kept as ``unreadable``.
        missing: blocks without a ledger entry.
        unplaced: number of further lost blocks, of unknown sources.
        unreadable: published files that cannot be read.
        remarks: further sentences.
    """

    aside: Path | None
    reason: str
    saved: int
    unchecked: int = 0
    restored: int = 0
    emptied: tuple[BlockRange, ...] = ()
    missing: tuple[BlockRange, ...] = ()
    unplaced: int = 0
    unreadable: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def lost(self) -> int:
        """Number of records that are known to be lost."""
        return self.unplaced + sum(part.last - part.first + 1 for part in (*self.emptied, *self.missing))

    @property
    def text(self) -> str:
        """The report in sentences."""
        kept = "" if self.aside is None else f" and is kept as {self.aside.name}"
        parts = [f"the store was made again: {self.reason}{kept}", f"{self.saved} records were saved"]
        if self.restored:
            parts.append(f"{self.restored} of them from the published files; spectra come from the store alone")
        if self.unchecked:
            parts.append(f"{self.unchecked} of them cannot be proven to be unchanged")
        lost = [str(part) for part in (*self.emptied, *self.missing)]
        lost += [f"{self.unplaced} whose source is not known"] if self.unplaced else []
        parts.append(f"{self.lost} are known to be lost" + (f": {', '.join(lost)}" if lost else ""))
        if self.unreadable:
            parts.append(f"published files that cannot be read: {', '.join(self.unreadable)}")
        return "; ".join((*parts, *self.remarks))

    def notice(self) -> dict[str, Any]:
        """Return the notice for the event log."""
        return {
            "kind": "store_salvaged",
            "channel": None,
            "severity": "danger" if self.lost or self.unreadable else "alert",
            "text": self.text,
            "saved": self.saved,
            "restored": self.restored,
            "lost": self.lost,
            "missing": [[part.source, part.first, part.last] for part in self.missing],
            "emptied": [[part.source, part.first, part.last] for part in self.emptied],
            "unreadable": list(self.unreadable),
            "aside": None if self.aside is None else self.aside.name,
        }


def ranges_of(blocks: Iterable[tuple[str, int]]) -> tuple[BlockRange, ...]:
    """Join consecutive numbers."""
    parts: list[BlockRange] = []
    for source, numbers in groupby(sorted(blocks), key=lambda item: item[0]):
        for _, run in groupby(enumerate(number for _, number in numbers), key=lambda item: item[1] - item[0]):
            members = [number for _, number in run]
            parts.append(BlockRange(source, members[0], members[-1]))
    return tuple(parts)
