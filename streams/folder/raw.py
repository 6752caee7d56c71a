"""The bytes of a file of a watched folder, read under guard and compared with what is known of the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from models.errors import SpallwatchError
from streams.files import path_within, read_guarded
from streams.folder.listing import Stat, look_at
from streams.folder.register import Entry
from streams.ledger import HEAD_BYTES, FileProgress
from streams.load import content_hash
from streams.readers.complete import whole_part
from streams.samples import ReaderError

GROWS = ("csv", "tdms")
"""Formats whose files are written to for as long as they last."""


@dataclass(frozen=True, eq=False)
class Raw:
    """The bytes of a file and how they would be remembered.

    Attributes:
        data: as they are on the disk.
        progress: stat and digests, no samples yet.
    """

    data: bytes
    progress: FileProgress


class UnfinishedError(SpallwatchError):
    """A file was written to while it was read; it has to wait for its turn again.

    Attributes:
        stat: what it is like now, or None where it is gone.
    """

    def __init__(self, stat: Stat | None) -> None:
        """Keep what the file is like now."""
        super().__init__("changed while it was read")
        self.stat = stat


def read_raw(root: Path, entry: Entry, growing: str | None) -> Raw:
    """Read a file.

    Args:
        root: the resolved folder.
        entry: the file.
        growing: its format where it may be written to meanwhile, else None.

    Returns:
        Its bytes; of a growing file those whose samples are final.

    Raises:
        ReaderError: ``refused`` or ``unreadable``, see :func:`streams.files.read_guarded`.
        UnfinishedError: it is not what it was when its turn came.
    """
    if not entry.stat.regular:
        path_within(root, entry.path)
        raise ReaderError("refused", f"{entry.key}: a link, a pipe or a device, not a regular file")
    try:
        data = read_guarded(root, entry.path, may_grow=growing is not None)
    except ReaderError as error:
        after = look_at(str(root), entry.path)
        if error.status == "changed" or after is None:
            raise UnfinishedError(after) from error
        raise
    after = look_at(str(root), entry.path)
    if after is None or (after != entry.stat and growing is None):
        raise UnfinishedError(after)
    size = len(data)
    if growing is not None:
        data = whole_part(data, growing)
    digest = content_hash(data)
    head = content_hash(data[:HEAD_BYTES])
    return Raw(data, FileProgress(entry.key, size, after.mtime_ns, after.inode, head, digest, len(data)))


def is_more_of(raw: Raw, known: FileProgress) -> bool:
    """Tell whether a file begins with all that is known of another, or of itself before."""
    if known.content_hash == raw.progress.content_hash:
        return True
    longer = 0 < known.read_bytes < len(raw.data)
    return longer and content_hash(raw.data[: known.read_bytes]) == known.content_hash
