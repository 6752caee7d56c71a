"""Files with the same content: renamed ones, copies, and logs that were copied and continued."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from streams.files.load import Loader
from streams.folder.life import Entry
from streams.folder.reading import Raw, Result, is_more_of
from streams.folder.register import ARCHIVED, Register
from streams.types.listing import stat_file, unshown
from streams.types.samples import Samples
from streams.types.source import PENDING, FileProgress, Ledger


@dataclass(frozen=True)
class Copy:
    """What a file is of another: a "rename" of it, a "copy", or a "longer" one.

    ``samples`` are those of the other that are committed, ``original`` its name; ``known`` is its progress in the
    ledger, None where it is read but not committed.
    """

    kind: Literal["rename", "copy", "longer"]
    samples: int
    original: str
    known: FileProgress | None = None


@dataclass
class Copies:
    """Finds the file whose content another one has."""

    name: str
    loader: Loader
    ledger: Ledger
    register: Register
    grows: bool
    _waiting: dict[str, Entry] = field(default_factory=dict)

    def add(self, digest: str, entry: Entry) -> None:
        """Note the content of a file that is read but not committed as a whole."""
        self._waiting[digest] = entry

    def remove(self, digest: str, entry: Entry) -> None:
        """Forget a content that is committed."""
        if self._waiting.get(digest) is entry:
            del self._waiting[digest]

    def find(self, entry: Entry, raw: Raw, result: Result) -> Copy | None:
        """Return what a file is of another, or None; files of equal samples are no copies: a dead sensor."""
        digest = raw.progress.content_hash
        first = self._waiting_with(digest)
        if first is not None and first is not entry and not _is_constant(result):
            return Copy("copy", 0 if first.state.base is None else first.state.base.samples, first.key)
        for known in self.ledger.files_like(self.name, raw.progress.head_hash, digest):
            if known.path == entry.key or not known.samples or not is_more_of(raw, known):
                continue
            if known.verdict == PENDING and (known.content_hash != digest or self._is_gone(known)):
                continue
            original = known.path.partition(ARCHIVED)[0]
            if known.content_hash != digest:
                if self.grows:
                    return Copy("longer", known.samples, original, known)
                continue
            root, here = str(self.loader.root), unshown(known.path)
            if ARCHIVED not in known.path and known.inode == entry.state.stat.inode and stat_file(root, here) is None:
                return Copy("rename", known.samples, original, known)
            if not _is_constant(result):
                return Copy("copy", known.samples, original, known)
        return None

    def _is_gone(self, known: FileProgress) -> bool:
        waiting = self.register.waiting.get(unshown(known.path))
        return waiting is None or waiting.state.absent is not None

    def _waiting_with(self, digest: str) -> Entry | None:
        """Return the file with this content that is read but not committed as a whole, unless it is gone."""
        entry = self._waiting.get(digest)
        if entry is None:
            return None
        read = entry.state.read
        current = read is None or read.content_hash == digest
        if current and entry.state.absent is None and self.register.waiting.get(entry.path) is entry:
            return entry
        del self._waiting[digest]
        return None


def _is_constant(result: Result) -> bool:
    return isinstance(result, Samples) and result.is_constant
