"""Rows from the pages of an SQLite database, whatever the pages above them look like.

SQLite finds a page through those above it; where one of these is damaged, all below is out of reach. But the leaves
that hold the rows say by themselves what they are. Read here are all leaves of a database file and of its write-ahead
log, without SQLite, as its documentation of the file format says (database file format, sections 1.3 to 1.6, 2.1, 4.1).
The log is believed up to its last commit; what a page says is checked by whoever knows its digest.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import NamedTuple

Value = None | int | float | str | bytes

_PAGE_SIZE = 4096
_TABLE_LEAF, _INDEX_LEAF = 0x0D, 0x0A
_MOST_PAYLOAD = 1 << 26
_WAL_MAGIC = (0x377F0682, 0x377F0683)
_WAL_HEAD, _FRAME_HEAD = 32, 24
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}


class Row(NamedTuple):
    """A row as it lies on a page.

    Attributes:
        rowid: its number, or None in an index and in a table without rowid.
        values: its columns in the order in which they are stored.
    """

    rowid: int | None
    values: tuple[Value, ...]


def leaf_rows(database: Path) -> Iterator[Row]:
    """Yield each row of each leaf page that can be made out, of all tables and indices; old versions of pages too.

    Args:
        database: the file; its write-ahead log is looked for beside it.

    Raises:
        OSError: the file cannot be read.
    """
    with ExitStack() as opened:
        main = _map(database, opened)
        log = b""
        with suppress(OSError):
            log = _map(database.with_name(f"{database.name}-wal"), opened)
        size = _page_size(main, log)
        logged = _logged_pages(log, size)
        latest = dict(logged)
        pages = _Pages(main, log, size, latest)
        for number in range(len(main) // size):
            yield from pages.rows(main[number * size : (number + 1) * size], first=number == 0)
        for number, start in logged:
            yield from pages.rows(log[start : start + size], first=number == 1)


def _map(path: Path, opened: ExitStack) -> mmap.mmap | bytes:
    file = opened.enter_context(path.open("rb"))
    if not path.stat().st_size:
        return b""
    return opened.enter_context(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


def _page_size(main: mmap.mmap | bytes, log: mmap.mmap | bytes) -> int:
    """Return the size of a page as the log or the header says, or the usual one where both make no sense."""
    candidates = []
    if len(log) >= _WAL_HEAD and struct.unpack(">I", log[:4])[0] in _WAL_MAGIC:
        candidates.append(struct.unpack(">I", log[8:12])[0])
    if len(main) >= 18:
        stated = struct.unpack(">H", main[16:18])[0]
        candidates.append(65536 if stated == 1 else stated)
    sensible = (size for size in candidates if 512 <= size <= 65536 and size & (size - 1) == 0)
    return next(sensible, _PAGE_SIZE)


def _logged_pages(log: mmap.mmap | bytes, size: int) -> list[tuple[int, int]]:
    """Return number and place of each page in the log that belongs to a committed transaction."""
    if len(log) < _WAL_HEAD or struct.unpack(">I", log[:4])[0] not in _WAL_MAGIC:
        return []
    salt = log[16:24]
    found: list[tuple[int, int]] = []
    committed = 0
    for start in range(_WAL_HEAD, len(log) - _FRAME_HEAD - size + 1, _FRAME_HEAD + size):
        number, pages = struct.unpack(">II", log[start : start + 8])
        if log[start + 8 : start + 16] != salt:
            # Either from before the log was begun anew, or damaged: what comes after it may still be good.
            continue
        found.append((number, start + _FRAME_HEAD))
        if pages:
            committed = len(found)
    return found[:committed]


class _Pages:
    """Pages by number, the newest version of each, and rows made of them."""

    def __init__(self, main: mmap.mmap | bytes, log: mmap.mmap | bytes, size: int, latest: dict[int, int]) -> None:
        self._main, self._log, self._size, self._latest = main, log, size, latest
        reserved = main[20] if len(main) > 20 else 0
        self._usable = size - (reserved if reserved <= size - 480 else 0)

    def rows(self, page: bytes, *, first: bool) -> Iterator[Row]:
        """Yield the rows of a leaf; none of a page that is something else, or damaged."""
        head = 100 if first else 0
        kind = page[head]
        if kind not in (_TABLE_LEAF, _INDEX_LEAF):
            return
        (cells,) = struct.unpack(">H", page[head + 3 : head + 5])
        if head + 8 + 2 * cells > self._usable:
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
        usable = self._usable
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
            part = page[4 : min(self._usable, 4 + length)]
            parts.append(part)
            length -= len(part)
        return b"".join(parts)

    def _page(self, number: int) -> bytes:
        start = self._latest.get(number)
        page = (
            self._log[start : start + self._size]
            if start is not None
            else self._main[(number - 1) * self._size : number * self._size]
        )
        if number < 1 or len(page) != self._size:
            raise _DamagedError
        return page


class _DamagedError(Exception):
    """Bytes are not what they should be."""


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
