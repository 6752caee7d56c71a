"""Bytes as a file that lies in memory, for parsers that open files by name."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def write_all(handle: int, data: bytes | memoryview) -> None:
    """Make ``data`` the whole content of an open file; OSError where there is no room."""
    view, place = memoryview(data).cast("B"), 0
    while place < len(view):
        place += os.pwrite(handle, view[place:], place)
    os.ftruncate(handle, len(view))


def read_all(handle: int, size: int) -> bytes:
    """Return the first ``size`` bytes of an open file; EOFError where it is shorter."""
    data = os.pread(handle, size, 0)
    while len(data) < size:
        more = os.pread(handle, size - len(data), len(data))
        if not more:
            raise EOFError(f"{len(data)} bytes instead of {size}")
        data += more
    return data


def read_into(handle: int, target: memoryview) -> None:
    """Fill ``target`` with the first bytes of an open file; EOFError where it is shorter."""
    view, place = target.cast("B"), 0
    while place < len(view):
        got = os.preadv(handle, [view[place:]], place)
        if not got:
            raise EOFError(f"{place} bytes instead of {len(view)}")
        place += got


@contextmanager
def memory_file(data: bytes) -> Iterator[str]:
    """Give a path by which this process can open the bytes; nothing is written to any disk."""
    handle = os.memfd_create("recording", os.MFD_CLOEXEC)
    try:
        write_all(handle, data)
        yield f"/proc/self/fd/{handle}"
    finally:
        os.close(handle)
