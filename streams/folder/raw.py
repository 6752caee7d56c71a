"""The bytes of a file of a watched folder, and how they continue those read before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from models.words.errors import SpallwatchError
from streams.files.container import read_guarded, refuse_special
from streams.files.digest import content_hash
from streams.files.parse.complete import whole_part
from streams.folder.life import Entry
from streams.reblock import Cut
from streams.types.listing import Stat, stat_file
from streams.types.samples import ReaderError
from streams.types.source import ACCEPTED, HEAD_BYTES, PENDING, FileProgress


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
    """Return the bytes of a file; of a ``growing`` format those whose samples are final.

    Raises:
        ReaderError: as :func:`streams.files.container.read_guarded`, but for a file that changes.
        UnfinishedError: it has changed since it was selected.
    """
    refuse_special(entry.state.stat, root, entry.path)
    try:
        data = read_guarded(root, entry.path, may_grow=growing is not None)
    except ReaderError as error:
        after = stat_file(str(root), entry.path)
        if error.status == "changed" or after is None:
            raise UnfinishedError(after) from error
        raise
    after = stat_file(str(root), entry.path)
    if after is None or (after != entry.state.stat and growing is None):
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


def count_block(cut: Cut) -> Iterator[tuple[Entry, FileProgress]]:
    """Give the files of which a block has samples, each with its progress once the block is committed."""
    for entry, end in cut.used:
        if not isinstance(entry, Entry) or entry.state.read is None:
            continue
        read, state, verdict = entry.state.read, entry.state, PENDING
        if end >= state.total and not read.is_part:
            in_blocks = state.blocks or not cut.missing or (state.base and state.base.samples)
            verdict = ACCEPTED if in_blocks else "short"
        yield entry, replace(read, path=entry.key, samples=end, verdict=verdict)
