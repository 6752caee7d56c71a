"""What is known of a file of a watched folder: the one place that asks the ledger for files, contents and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from streams.folder.life import FileEntry
from streams.folder.reading import Raw, Result
from streams.recording.repeats import copy_error, taken_error
from streams.types.listing import shown, stat_file, unshown
from streams.types.samples import ReaderError, Samples
from streams.types.source import MAX_DEATHS, PENDING, FileProgress, Ledger

ARCHIVED = "\n"
"""Separates path and digest of the former content in the key of a file that was replaced."""


@dataclass(frozen=True)
class Match:
    """What has the content or the number of a file already.

    Attributes:
        samples: those of the file with its content, or its beginning, that are committed.
        renamed: progress of that file, where this is the same one under another name.
        error: with which it is rejected, None where it is renamed or goes on where that file ends.
        number: of the block with its content or number, None where it is not known.
    """

    samples: int = 0
    renamed: FileProgress | None = None
    error: ReaderError | None = None
    number: int | None = None


@dataclass
class Inquiry:
    """What the ledger of a source says of files by name, content and number; ``waiting``: those that wait, by path."""

    source: str
    ledger: Ledger
    waiting: Mapping[str, FileEntry]
    uncommitted: dict[int, str] = field(default_factory=dict)
    """Contents of the blocks and rejections that are delivered and not committed, by number."""
    _reading: dict[str, FileEntry] = field(default_factory=dict)

    def file(self, path: str) -> FileProgress | None:
        """Return what the ledger knows of a file by its name, or None."""
        return self.ledger.file(self.source, shown(path))

    def is_poisoned(self, key: str) -> bool:
        """Return whether the process died repeatedly while it handled a file."""
        return self.ledger.deaths(self.source, key) >= MAX_DEATHS

    def is_free(self, number: int | None) -> bool:
        """Return whether no block has a number, None: none is stated."""
        return number is None or (number not in self.uncommitted and self._holder(number) is None)

    def _holder(self, number: int) -> str | None:
        """Return the content of the block with a number, None where there is none."""
        return self.uncommitted.get(number) or self.ledger.content_of(self.source, number)

    def add(self, digest: str, entry: FileEntry) -> None:
        """Note the content of a file that is read but not committed as a whole."""
        self._reading[digest] = entry

    def remove(self, digest: str, entry: FileEntry) -> None:
        """Forget a content that is committed."""
        if self._reading.get(digest) is entry:
            del self._reading[digest]

    def match(
        self, entry: FileEntry, raw: Raw, result: Result, number: int | None, *, root: str, grows: bool
    ) -> Match | None:
        """Return what has the content of a file, or its ``number``; None for a new one.

        Files of equal samples are no copies: they are those of a dead sensor. ``root`` is the folder; ``grows``: a
        file may be continued under another name.
        """
        digest = raw.progress.content_hash
        other = self._other(entry, raw, result, root, grows)
        if other is not None:
            return other
        if number is None or self.is_free(number):
            return None
        return Match(error=taken_error(entry.key, number, same=self._holder(number) == digest), number=number)

    def _other(self, entry: FileEntry, raw: Raw, result: Result, root: str, grows: bool) -> Match | None:
        """Return the file whose content this one has or continues, or None; arguments as :meth:`match`."""
        digest = raw.progress.content_hash
        dead = isinstance(result, Samples) and result.is_constant
        first = self._reader_of(digest)
        if first is not None and first is not entry and not dead:
            committed = 0 if first.state.base is None else first.state.base.samples
            return self._copy(entry, digest, first.key, committed)
        for known in self.ledger.files_like(self.source, raw.progress.head_hash, digest):
            if known.path == entry.key or not known.samples or not raw.is_more_of(known):
                continue
            if known.verdict == PENDING and (known.content_hash != digest or self._is_gone(known)):
                continue
            if known.content_hash != digest:
                if grows:
                    return Match(known.samples)
                continue
            is_name = ARCHIVED not in known.path
            if is_name and known.inode == entry.state.stat.inode and stat_file(root, unshown(known.path)) is None:
                return Match(known.samples, known)
            if not dead:
                return self._copy(entry, digest, known.path.partition(ARCHIVED)[0], known.samples)
        return None

    def _copy(self, entry: FileEntry, digest: str, original: str, samples: int) -> Match:
        return Match(samples, error=copy_error(entry.key, original), number=self.ledger.known(self.source, digest))

    def _is_gone(self, known: FileProgress) -> bool:
        entry = self.waiting.get(unshown(known.path))
        return entry is None or entry.state.absent is not None

    def _reader_of(self, digest: str) -> FileEntry | None:
        """Return the file with this content that is read but not committed as a whole, unless it is gone."""
        entry = self._reading.get(digest)
        if entry is None:
            return None
        read = entry.state.read
        current = read is None or read.content_hash == digest
        if current and entry.state.absent is None and self.waiting.get(entry.path) is entry:
            return entry
        del self._reading[digest]
        return None
