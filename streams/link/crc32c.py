"""CRC-32C (Castagnoli), the checksum of the wire; the standard library has CRC-32 only, which is another polynomial.

A CRC is linear over the bits of the message: a 32-bit word may be moved to a later place in it by multiplying with a
power of x, and added there. The message is therefore folded onto its own end row by row with numpy table look-ups, then
by halves, until one word is left. :mod:`benchmarks.streams` prints how fast that is.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

_POLYNOMIAL = 0x82F63B78
"""Castagnoli's polynomial, bits reversed (RFC 3720, section B.4 has test values)."""

_ROW = 4096
"""Words folded at a time: rows and tables stay in the cache."""


def _table() -> NDArray[np.uint32]:
    """Return what one byte does to an empty register, shape (256,)."""
    values = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        values = (values >> 1) ^ np.where(values & 1, np.uint32(_POLYNOMIAL), np.uint32(0))
    return values.astype(np.uint32)


_BYTE = _table()


def _spread(columns: NDArray[np.uint32], bits: int) -> NDArray[np.uint32]:
    """Return a map of 32 bits, given by its columns, as tables over ``bits`` bits each, shape (32 / bits, 2**bits)."""
    tables = np.zeros((32 // bits, 1 << bits), dtype=np.uint32)
    for part, table in enumerate(tables):
        for bit in range(bits):
            size = 1 << bit
            table[size : 2 * size] = table[:size] ^ columns[bits * part + bit]
    return tables


@cache
def _move(exponent: int) -> NDArray[np.uint32]:
    """Return the map that moves words by 2**exponent words towards the end, as four tables over bytes."""
    if exponent:
        half = _move(exponent - 1)
        return _spread(_moved(half, _moved(half, _UNIT)), 8)
    words = _UNIT
    for _ in range(4):
        words = (words >> np.uint32(8)) ^ _BYTE[words & np.uint32(255)]
    return _spread(words, 8)


_UNIT = np.uint32(1) << np.arange(32, dtype=np.uint32)


def _moved(tables: NDArray[np.uint32], words: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Apply a map, given as four tables over bytes, to some words."""
    result = tables[3][words >> np.uint32(24)]
    for part in range(3):
        result ^= tables[part][words >> np.uint32(8 * part) & np.uint32(255)]
    return result


@cache
def _row_tables() -> NDArray[np.uint32]:
    """Return the map that moves words by a row, as two tables over 16 bits."""
    return _spread(_moved(_move(_ROW.bit_length() - 1), _UNIT), 16)


def crc32c(data: Any) -> int:
    """Return the CRC-32C of bytes.

    Args:
        data: any contiguous buffer of bytes.

    Returns:
        The checksum; of ``b"123456789"`` it is 0xE3069283.
    """
    view = np.frombuffer(data, dtype=np.uint8)
    if view.size < 4:
        register = 0xFFFFFFFF
        for byte in view.tolist():
            register = register >> 8 ^ int(_BYTE[(register ^ byte) & 255])
        return register ^ 0xFFFFFFFF
    # The register starts with ones, which is the same as inverting the first four bytes; zeros in front change nothing.
    head = bytearray(view[: 4 + (view.size - 4) % 4].tobytes())
    head[:4] = bytes(byte ^ 255 for byte in head[:4])
    head = head.rjust(-(-len(head) // 4) * 4, b"\0")
    rest = view[4 + (view.size - 4) % 4 :].view("<u4")
    return int(_fold(np.frombuffer(head, dtype="<u4"), rest)) ^ 0xFFFFFFFF


def _fold(first: NDArray[np.uint32], rest: NDArray[np.uint32]) -> np.uint32:
    """Return the register after some words and then many."""
    row = np.zeros(_ROW, dtype=np.uint32)
    filled = (first.size + rest.size - 1) % _ROW + 1
    taken = filled - first.size
    if taken < 0:
        # One row holds one word only, and the first two are not both in it.
        row[-filled:] = first[:filled]
        rest = np.concatenate([first[filled:], rest])
        taken = 0
    else:
        row[_ROW - filled : _ROW - taken] = first
        row[_ROW - taken :] = rest[:taken]
    low, high = _row_tables()
    part = np.empty_like(row)
    for start in range(taken, rest.size, _ROW):
        np.take(low, row & np.uint32(0xFFFF), out=part, mode="clip")
        np.bitwise_xor(part, rest[start : start + _ROW], out=part)
        row = part ^ high[row >> np.uint32(16)]
    size = _ROW
    while size > 1:
        size //= 2
        row = _moved(_move(size.bit_length() - 1), row[:size]) ^ row[size:]
    return _moved(_move(0), row)[0]
