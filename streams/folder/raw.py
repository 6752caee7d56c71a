"""The bytes of a file of a watched folder, compared with the ledger."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from models.errors import SpallwatchError
from streams.files import path_within, read_guarded
from streams.folder.listing import Stat, stat_file
from streams.folder.register import Entry
from streams.ledger import HEAD_BYTES, FileProgress
from streams.load import content_hash
from streams.readers.complete import whole_part
from streams.samples import ReaderError

GROWS = ("csv", "tdms")
"""Formats whose files are appended to while they are read."""


@dataclass(frozen=True, eq=False)
class Raw:
    """The bytes of a file as stored, and its progress without samples."""

    data: bytes
    progress: FileProgress


class UnfinishedError(SpallwatchError):
    """A file changed while it was read; ``stat`` is its new status, None if removed."""

    def __init__(self, stat: Stat | None) -> None:
        """Keep the present status."""
        super().__init__("changed while it was read")
        self.stat = stat


def read_raw(root: Path, entry: Entry, growing: str | None) -> Raw:
    """Return the bytes of a file; of a growing one those whose samples are final.

    ``growing`` is the format of a file that may grow, else None.

    Raises:
        ReaderError: ``refused`` or ``unreadable``, see :func:`streams.files.read_guarded`.
        UnfinishedError: it has changed since it was selected.
    """
    if not entry.stat.regular:
        path_within(root, entry.path)
        raise ReaderError("refused", f"{entry.key}: a link, a pipe or a device, not a regular file")
    try:
        data = read_guarded(root, entry.path, may_grow=growing is not None)
    except ReaderError as error:
        after = stat_file(str(root), entry.path)
        if error.status == "changed" or after is None:
            raise UnfinishedError(after) from error
        raise
    after = stat_file(str(root), entry.path)
    if after is None or (after != entry.stat and growing is None):
        raise UnfinishedError(after)
    size = len(data)
    if growing is not None:
        data = whole_part(data, growing)
    digest = content_hash(data)
    head = content_hash(data[:HEAD_BYTES])
    return Raw(data, FileProgress(entry.key, size, after.mtime_ns, after.inode, head, digest, len(data)))


def is_more_of(raw: Raw, known: FileProgress) -> bool:
    """Return whether a file begins with all the known bytes of another, or equals it."""
    if known.content_hash == raw.progress.content_hash:
        return True
    longer = 0 < known.read_bytes < len(raw.data)
    return longer and content_hash(raw.data[: known.read_bytes]) == known.content_hash
