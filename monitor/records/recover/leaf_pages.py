"""Rows from the leaf pages of an SQLite database, independent of the pages above them.

SQLite reaches a page through those above it; where one of these is damaged, all below is lost to it. Here all leaves of
a database file and of its write-ahead log are read without SQLite, as its documentation of the file format says
(sections 1.3 to 1.6, 2.1, 4.1; pages without reserved bytes). The log is read up to its last commit; the caller checks
the rows by their digests.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import BinaryIO, NamedTuple

from models.errors import SpallwatchError

Value = None | int | float | str | bytes

_PAGE_SIZE = 4096
_TABLE_LEAF, _INDEX_LEAF = 0x0D, 0x0A
_MOST_PAYLOAD = 1 << 26
_WAL_MAGIC = (0x377F0682, 0x377F0683)
_WAL_HEAD, _FRAME_HEAD = 32, 24
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}


class Row(NamedTuple):
    """A stored row; ``rowid`` is None in an index and in a table without rowid."""

    rowid: int | None
    values: tuple[Value, ...]


def leaf_rows(database: Path) -> Iterator[Row]:
    """Yield each readable row of each leaf page, of all tables and indices, also of old versions of pages.

    Args:
        database: the file; its write-ahead log is expected beside it.

    Raises:
        OSError: the file cannot be read.
    """
    with ExitStack() as opened:
        main = _Bytes(opened.enter_context(database.open("rb")))
        log = None
        with suppress(OSError):
            log = _Bytes(opened.enter_context(database.with_name(f"{database.name}-wal").open("rb")))
        size = _page_size(main, log)
        logged = [] if log is None else _logged_pages(log, size)
        pages = _Pages(main, log, size, dict(logged))
        for number in range(main.length // size):
            yield from pages.rows(main.read(number * size, size), first=number == 0)
        for number, start in logged:
            assert log is not None
            yield from pages.rows(log.read(start, size), first=number == 1)


class _Bytes:
    """A file with unreadable sectors, which read as empty."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.length = file.seek(0, os.SEEK_END)

    def read(self, start: int, length: int) -> bytes:
        """Return bytes: fewer at the end of the file, none where they are unreadable."""
        try:
            self._file.seek(start)
            return self._file.read(length)
        except OSError:
            return b""


def _page_size(main: _Bytes, log: _Bytes | None) -> int:
    """Return the page size of the log or the header, or the usual one where both are invalid."""
    candidates = []
    head = b"" if log is None else log.read(0, 12)
    if len(head) == 12 and struct.unpack(">I", head[:4])[0] in _WAL_MAGIC:
        candidates.append(struct.unpack(">I", head[8:12])[0])
    head = main.read(16, 2)
    if len(head) == 2:
        (stated,) = struct.unpack(">H", head)
        candidates.append(65536 if stated == 1 else stated)
    sensible = (size for size in candidates if 512 <= size <= 65536 and size & (size - 1) == 0)
    return next(sensible, _PAGE_SIZE)


def _logged_pages(log: _Bytes, size: int) -> list[tuple[int, int]]:
    """Return number and offset of each page in the log that belongs to a committed transaction."""
    head = log.read(0, _WAL_HEAD)
    if len(head) < _WAL_HEAD or struct.unpack(">I", head[:4])[0] not in _WAL_MAGIC:
        return []
    found: list[tuple[int, int]] = []
    committed = 0
    for start in range(_WAL_HEAD, log.length - _FRAME_HEAD - size + 1, _FRAME_HEAD + size):
        frame = log.read(start, _FRAME_HEAD)
        if len(frame) < _FRAME_HEAD or frame[8:16] != head[16:24]:
            # From before a restart of the log, or damaged: later frames may be valid.
            continue
        number, pages = struct.unpack(">II", frame[:8])
        found.append((number, start + _FRAME_HEAD))
        if pages:
            committed = len(found)
    return found[:committed]


class _Pages:
    """The newest version of each page by number, and the rows of pages."""

    def __init__(self, main: _Bytes, log: _Bytes | None, size: int, latest: dict[int, int]) -> None:
        self._main, self._log, self._size, self._latest = main, log, size, latest

    def rows(self, page: bytes, *, first: bool) -> Iterator[Row]:
        """Yield the rows of a leaf; none of other or damaged pages."""
        head = 100 if first else 0
        if len(page) < self._size:
            return
        kind = page[head]
        if kind not in (_TABLE_LEAF, _INDEX_LEAF):
            return
        (cells,) = struct.unpack(">H", page[head + 3 : head + 5])
        if head + 8 + 2 * cells > self._size:
            return
        for place in struct.unpack(f">{cells}H", page[head + 8 : head + 8 + 2 * cells]):
            with suppress(_DamagedError, IndexError, struct.error, UnicodeDecodeError):
                yield self._row(page, place, table=kind == _TABLE_LEAF)

    def _row(self, page: bytes, place: int, *, table: bool) -> Row:
        length, place = _varint(page, place)
        rowid = None
        if table:
            rowid, place = _varint(page, place)
        if length > _MOST_PAYLOAD:
            raise _DamagedError
        usable = self._size
        most = usable - 35 if table else (usable - 12) * 64 // 255 - 23
        local = length
        if length > most:
            least = (usable - 12) * 32 // 255 - 23
            local = least + (length - least) % (usable - 4)
            local = local if local <= most else least
        payload = page[place : place + local]
        if len(payload) != local:
            raise _DamagedError
        if local < length:
            (following,) = struct.unpack(">I", page[place + local : place + local + 4])
            payload += self._overflow(following, length - local)
        return Row(_signed(rowid), _values(payload))

    def _overflow(self, number: int, length: int) -> bytes:
        parts: list[bytes] = []
        while length > 0:
            page = self._page(number)
            (number,) = struct.unpack(">I", page[:4])
            part = page[4 : min(self._size, 4 + length)]
            parts.append(part)
            length -= len(part)
        return b"".join(parts)

    def _page(self, number: int) -> bytes:
        start = self._latest.get(number)
        if start is not None and self._log is not None:
            page = self._log.read(start, self._size)
        else:
            page = self._main.read((number - 1) * self._size, self._size) if number else b""
        if len(page) != self._size:
            raise _DamagedError
        return page


class _DamagedError(SpallwatchError):
    """Bytes do not follow the file format."""


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """Return a number of one to nine bytes, and the place after it."""
    value = 0
    for step in range(8):
        byte = data[place + step]
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, place + step + 1
    return value << 8 | data[place + 8], place + 9


def _signed(value: int | None) -> int | None:
    return value if value is None or value < 1 << 63 else value - (1 << 64)


def _values(payload: bytes) -> tuple[Value, ...]:
    """Return the columns of a record."""
    length, place = _varint(payload, 0)
    kinds: list[int] = []
    while place < length:
        kind, place = _varint(payload, place)
        kinds.append(kind)
    if place != length:
        raise _DamagedError
    values: list[Value] = []
    for kind in kinds:
        size = _INTEGER_BYTES.get(kind, 8 if kind == 7 else (kind - 12) // 2 if kind >= 12 else 0)
        part = payload[place : place + size]
        if len(part) != size or kind in (10, 11):
            raise _DamagedError
        values.append(_value(kind, part))
        place += size
    if place != len(payload):
        raise _DamagedError
    return tuple(values)


def _value(kind: int, part: bytes) -> Value:
    if kind == 0:
        return None
    if kind in _INTEGER_BYTES:
        return int.from_bytes(part, "big", signed=True)
    if kind == 7:
        return struct.unpack(">d", part)[0]
    if kind < 12:
        return kind - 8
    return part.decode("utf-8") if kind % 2 else part
