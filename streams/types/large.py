"""Large files and large arrays: read piece by piece, kept on disk instead of in memory.

Below ``MAX_IN_MEMORY`` a file is ``bytes`` and an array is in memory. Above it a file is a :class:`FileBytes`, and an
array is a file of the temporary folder that is mapped; both have no name there and vanish with their last user.
"""

from __future__ import annotations

import errno
import io
import mmap
import os
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any, BinaryIO, overload

import numpy as np
from numpy.typing import DTypeLike, NDArray

from models.platform.portable import BINARY, DiskFile, read_at, reserve
from models.words.errors import SpallwatchError
from streams.types.limits import MAX_BYTES

MAX_IN_MEMORY = 32 << 20
"""Bytes of a file or array that are held in memory."""

PIECE_BYTES = 8 << 20
"""Bytes of what is read or computed at once."""


class FileBytes:
    """The bytes of an open regular file, read as they are needed; as far as readers need it, it acts like ``bytes``."""

    def __init__(self, handle: int, status: os.stat_result, path: str, disk: DiskFile | None = None) -> None:
        """Own a file descriptor, which is closed with this object.

        Args:
            handle: the descriptor.
            status: of the file, from which on it must not change; it has the size.
            path: by which this process and a child open the same file again.
            disk: owner of the descriptor in place of this object.
        """
        self._handle, self._size, self.path = handle, status.st_size, path
        self._stated = _state(status)
        if disk is None:
            weakref.finalize(self, os.close, handle)
        else:
            weakref.finalize(self, disk.close)

    @classmethod
    def opened(cls, path: str) -> FileBytes:
        """Open a file; OSError where that cannot be."""
        handle = os.open(path, os.O_RDONLY | BINARY)
        return cls(handle, os.fstat(handle), path)

    @classmethod
    def copied(cls, stream: Any, max_bytes: int, before: bytes = b"") -> FileBytes:
        """Copy what a stream gives, at most ``max_bytes``, to a file that vanishes with this object.

        ``before`` is what the stream has given already, and precedes it. NoRoomError as of :func:`array_on_disk`; what
        the stream raises is not caught.
        """
        with _disk_file(len(before)) as disk:
            size, part = 0, before
            while True:
                with _temporary(size + len(part)):
                    write_whole(disk.handle, part)
                size += len(part)
                part = stream.read(min(PIECE_BYTES, len(before) + max_bytes - size))
                if not part:
                    return cls(disk.handle, os.fstat(disk.handle), disk.path, disk)

    @property
    def is_changed(self) -> bool:
        """Whether the file is another one than when this was made."""
        return _state(os.fstat(self._handle)) != self._stated

    def __len__(self) -> int:
        """Return the size in bytes."""
        return self._size

    @overload
    def __getitem__(self, part: int) -> int: ...
    @overload
    def __getitem__(self, part: slice) -> bytes: ...
    def __getitem__(self, part: int | slice) -> int | bytes:
        """Return a byte, or a part without steps; EOFError where the file has become shorter."""
        if isinstance(part, int):
            return self[part : part + 1][0]
        begin, end, step = part.indices(self._size)
        if step != 1:
            raise ValueError(f"parts of a file have no steps, got {step}")
        found = bytearray()
        while len(found) < end - begin:
            more = read_at(self._handle, end - begin - len(found), begin + len(found))
            if not more:
                raise EOFError(f"{begin + len(found)} bytes instead of {self._size}")
            found += more
        return bytes(found)

    def pieces(self, begin: int = 0) -> Iterator[bytes]:
        """Yield the content from a place on."""
        for place in range(begin, self._size, PIECE_BYTES):
            yield self[place : place + PIECE_BYTES]

    def startswith(self, prefix: bytes | tuple[bytes, ...]) -> bool:
        """Return whether the file begins with the prefix, or one of several."""
        return self[:64].startswith(prefix)

    def find(self, part: bytes, begin: int = 0) -> int:
        """Return the first place of a short ``part`` at or behind ``begin``, -1 where there is none."""
        for place in range(begin, self._size, PIECE_BYTES):
            found = self[place : place + PIECE_BYTES + len(part) - 1].find(part)
            if found >= 0:
                return place + found
        return -1

    def mapped(self) -> mmap.mmap:
        """Return the file as read-only memory; a file that is cut off then ends the process that reads it."""
        return mmap.mmap(self._handle, self._size, access=mmap.ACCESS_READ)


Data = bytes | FileBytes
"""The content of a file."""


def stream_of(data: Data) -> BinaryIO:
    """Return an open file with the content, which the caller closes."""
    return Path(data.path).open("rb") if isinstance(data, FileBytes) else io.BytesIO(data)


def pieces_of(data: Data) -> Iterator[bytes]:
    """Yield the content in pieces; ``bytes`` in one."""
    return data.pieces() if isinstance(data, FileBytes) else iter((data,))


def shared_path(handle: int, path: str) -> str:
    """Return a path by which a child opens the very file that is open here, its own ``path`` where there is no such."""
    return f"/proc/{os.getpid()}/fd/{handle}" if hasattr(os, "memfd_create") else path


def write_whole(handle: int, part: bytes | memoryview) -> None:
    """Append a part to an open file."""
    view = memoryview(part)
    while view:
        view = view[os.write(handle, view) :]


def _state(status: os.stat_result) -> tuple[int, int]:
    return status.st_size, status.st_mtime_ns


def array_on_disk(shape: Sequence[int], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array in a file of the temporary folder.

    Raises:
        TooLargeError: it has more than ``MAX_BYTES``.
        NoRoomError: the folder cannot be written, or has no room.
        MemoryError: there is no address space for it.
    """
    kind = np.dtype(dtype)
    size = prod(shape) * kind.itemsize
    if size > MAX_BYTES:
        raise TooLargeError(size)
    with _disk_file(size) as disk:
        with _temporary(size):
            reserve(disk.handle, size)
        return mapped_array(disk, shape, kind)


class NoRoomError(SpallwatchError):
    """The temporary folder does not take the content of a large file, which says nothing about the file."""

    def __init__(self, size: int, reason: str) -> None:
        """Take the number of bytes, and what the system says."""
        where = _temporary_folder()
        super().__init__(f"{where}: no room for {size} bytes of a large file ({reason}); set TMPDIR to a larger disk")
        self.size, self.reason = size, reason


class TooLargeError(SpallwatchError):
    """The samples of a file have more than ``MAX_BYTES``: :mod:`streams.files.parse.worker` says ``refused``."""

    def __init__(self, size: int) -> None:
        """Take the number of bytes."""
        super().__init__(f"{size} bytes when loaded, {MAX_BYTES} are allowed")


NOT_OF_CONTENT = (NoRoomError, TooLargeError, MemoryError)
"""What a reader raises for lack of room; it never turns that into a verdict of its own on the content of its file."""


def _temporary_folder() -> str:
    try:
        return tempfile.gettempdir()
    except OSError:
        # None of the folders that it tries can be written.
        return os.environ.get("TMPDIR", "the temporary folder")


@contextmanager
def _temporary(size: int) -> Iterator[None]:
    """Raise NoRoomError for any failure of a file in the temporary folder; ``size`` bytes were to be in it."""
    try:
        yield
    except OSError as error:
        raise NoRoomError(size, error.strerror or type(error).__name__) from error


@contextmanager
def _disk_file(size: int) -> Iterator[DiskFile]:
    """Give a new file of the temporary folder, which is closed where the block fails; NoRoomError."""
    with _temporary(size):
        disk = DiskFile()
    try:
        yield disk
    except BaseException:
        disk.close()
        raise


def mapped_array(disk: DiskFile, shape: Sequence[int], dtype: DTypeLike) -> NDArray[Any]:
    """Return the array that a file holds; the file is closed with the last view of it, and not where this fails.

    Raises:
        MemoryError: there is no address space for it.
    """
    kind = np.dtype(dtype)
    try:
        memory = mmap.mmap(disk.handle, prod(shape) * kind.itemsize)
    except OSError as error:
        raise MemoryError(str(error)) if error.errno == errno.ENOMEM else error from error
    found = np.frombuffer(memory, kind, prod(shape)).reshape(shape)
    weakref.finalize(memory, disk.close)
    return found


def forget_pages(array: NDArray[Any]) -> None:
    """Give back the memory of an array in a file; what is used of it later is read again."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    if isinstance(base, memoryview):
        base = base.obj
    if isinstance(base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
        base.madvise(mmap.MADV_DONTNEED)


def empty_rows(shape: Sequence[int], dtype: DTypeLike) -> NDArray[Any]:
    """Return a new array, on disk where it is large."""
    large = prod(shape) * np.dtype(dtype).itemsize >= MAX_IN_MEMORY
    return array_on_disk(shape, dtype) if large else np.empty(shape, dtype)


def parts_along(shape: Sequence[int], itemsize: int, axis: int, least: int = 1) -> Iterator[tuple[slice, ...]]:
    """Yield the indices of pieces of an array along an axis, each but the last a multiple of ``least`` long."""
    step = max(1, PIECE_BYTES * shape[axis] // max(1, prod(shape) * itemsize) // least) * least
    for begin in range(0, shape[axis], step):
        yield (*(slice(None),) * axis, slice(begin, begin + step))


def longest_axis(shape: Sequence[int]) -> int:
    """Return the number of the longest axis, the last of equal ones."""
    return max(range(len(shape)), key=lambda place: (shape[place], place))


def elementwise(
    function: Callable[[NDArray[Any]], NDArray[Any]], array: NDArray[Any], axis: int | None = None
) -> NDArray[Any]:
    """Return a function of an array that works on each number alone; of a large array piece by piece, on disk.

    The pieces are cut along ``axis``, by default the longest.
    """
    if array.size * 8 < MAX_IN_MEMORY:
        return function(array)
    found: NDArray[Any] | None = None
    for part in parts_along(array.shape, 8, longest_axis(array.shape) if axis is None else axis):
        piece = function(array[part])
        if found is None:
            found = empty_rows(array.shape, piece.dtype)
        found[part] = piece
        forget_pages(array)
        forget_pages(found)
    return function(array) if found is None else found


def is_any(function: Callable[[NDArray[Any]], NDArray[np.bool]], array: NDArray[Any]) -> bool:
    """Return whether a function of each number alone is true of any; of a large array piece by piece."""
    if array.size * 8 < MAX_IN_MEMORY:
        return bool(function(array).any())
    for part in parts_along(array.shape, 8, longest_axis(array.shape)):
        found = bool(function(array[part]).any())
        forget_pages(array)
        if found:
            return True
    return False


def contiguous(array: NDArray[Any], dtype: DTypeLike) -> NDArray[Any]:
    """Return an array of a type with contiguous rows, itself where it is one; a large copy is on disk."""
    kind = np.dtype(dtype)
    if array.dtype == kind and array.flags.c_contiguous:
        return array
    if array.size * kind.itemsize < MAX_IN_MEMORY:
        return np.ascontiguousarray(array, dtype=kind)
    return elementwise(lambda piece: np.asarray(piece, dtype=kind), array)


def copy_into(target: NDArray[Any], source: NDArray[Any]) -> None:
    """Copy one row into another piece by piece, so that neither stays in memory where it is on disk."""
    step = max(1, PIECE_BYTES // target.dtype.itemsize)
    for begin in range(0, target.size, step):
        target[begin : begin + step] = source[begin : begin + step]
        forget_pages(source)
        forget_pages(target)


def chosen_rows(values: NDArray[Any], rows: Sequence[int]) -> NDArray[Any]:
    """Return rows of an array of shape (row, sample) with contiguous rows, in the order given; see :func:`contiguous`.

    Rows that follow each other in a large array are a view of it.
    """
    if len(rows) * values.shape[1] * values.dtype.itemsize < MAX_IN_MEMORY:
        return np.ascontiguousarray(values[list(rows)])
    if rows and list(rows) == list(range(rows[0], rows[-1] + 1)):
        return contiguous(values[rows[0] : rows[-1] + 1], values.dtype)
    found = empty_rows((len(rows), values.shape[1]), values.dtype)
    step = max(1, PIECE_BYTES // (len(rows) * values.dtype.itemsize))
    for begin in range(0, values.shape[1], step):
        found[:, begin : begin + step] = values[list(rows), begin : begin + step]
        forget_pages(values)
        forget_pages(found)
    return found
