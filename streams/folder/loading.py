"""One file of a watched folder: read under guard, told from others by its content, and taken apart."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.errors import SpallwatchError
from streams.blocks import agreed_rate, choose_rows, content_hash
from streams.datasets.description import DataSet, FileFacts
from streams.files import path_within, read_guarded, unpack
from streams.folder.listing import Stat, look_at
from streams.folder.register import Entry
from streams.ledger import HEAD_BYTES, FileProgress
from streams.readers.complete import declared_size, whole_part
from streams.readers.reading import ReaderError, Reading
from streams.spec import SourceSpec

_LOG = logging.getLogger(__name__)
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


@dataclass(frozen=True, eq=False)
class Parsed:
    """The samples of a file and what is known about them.

    Attributes:
        samples: shape (channel, sample).
        rate: sampling rate in Hz.
        channels, units: of each row.
        start: seconds since 1970 UTC of the first sample, or None.
        elapsed: seconds from the first sample of the source where the name says it and no stamp does, or None.
        speed, load: shaft speed in Hz, radial load in N, or None.
    """

    samples: NDArray[np.floating]
    rate: float
    channels: tuple[str, ...]
    units: tuple[str, ...]
    start: float | None
    elapsed: float | None
    speed: float | None
    load: float | None


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


def parse(raw: Raw, entry: Entry, facts: FileFacts, data_set: DataSet, spec: SourceSpec) -> Parsed:
    """Take the samples out of the bytes of a file.

    Args:
        raw: the bytes.
        entry: the file.
        facts: what its name says.
        data_set: what it is.
        spec: configuration of the source.

    Returns:
        The samples of the configured channels.

    Raises:
        ReaderError: with the rejection status and a sentence.
    """
    name = entry.key
    promised = declared_size(raw.data, entry.path)
    if promised is not None and promised > len(raw.data):
        raise ReaderError("incomplete", f"{name}: {len(raw.data)} bytes are there, its header promises {promised}")
    try:
        data = unpack(raw.data, entry.path)
        if not data:
            raise ReaderError("incomplete", f"{name}: nothing of it is there yet")
        reading = data_set.read(data, entry.path)
    except ReaderError:
        raise
    except Exception as error:
        # Parsers of other people raise whatever they like at damaged files; one file must not stop the others.
        _LOG.warning("%s: the reader failed", name, exc_info=True)
        raise ReaderError("unreadable", f"{name}: the reader failed ({type(error).__name__})") from error
    return _chosen(reading, name, facts, data_set, spec)


def _chosen(reading: Reading, name: str, facts: FileFacts, data_set: DataSet, spec: SourceSpec) -> Parsed:
    rows = choose_rows(reading, spec.channels, data_set.unit, name)
    rate = agreed_rate((reading.rate, facts.rate), spec.rate, name)
    start = facts.start if facts.start is not None else reading.start
    elapsed = facts.elapsed if start is None else None
    if spec.start is not None and elapsed is not None:
        start = spec.start + elapsed
    return Parsed(
        samples=reading.samples[[row.index for row in rows]],
        rate=rate,
        channels=tuple(row.channel for row in rows),
        units=tuple(row.unit for row in rows),
        start=start,
        elapsed=elapsed,
        speed=reading.speed if reading.speed is not None else facts.speed,
        load=reading.load if reading.load is not None else facts.load,
    )
