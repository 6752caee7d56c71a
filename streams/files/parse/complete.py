"""The size that a file's header declares: more than there is while it is written."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from typing import Any

import numpy as np

from streams.files.parse.riff import wav_sizes
from streams.types.large import Data, stream_of

_TDMS_LEAD = 28
_TDMS_UNKNOWN = 0xFFFFFFFFFFFFFFFF
_SUPERBLOCKS = {0: (13, 24), 1: (13, 28), 2: (9, 12), 3: (9, 12)}
"""By version of an HDF5 superblock: place of the width of addresses, bytes before the end of file but two of them."""

_MAX_NPY_HEADER_BYTES = 1024
_NPY_HEADER = re.compile(
    rb"\{'descr': '([<>|=][fiu]\d{1,2})', 'fortran_order': (False|True),"
    rb" 'shape': \((\d{1,12},|\d{1,12}, ?\d{1,12})\),? ?\} *\n"
)


def declared_size(data: Data, name: str) -> int | None:
    """Return the least size in bytes that a header promises, None where it does not.

    Known are WAV (RIFF, RF64), .npy, HDF5 with netCDF4 and MAT v7.3 (end-of-file address of the superblock) and TDMS.
    """
    ending = name.lower().rpartition(".")[2]
    sound = wav_sizes(data)
    if sound is not None:
        return sound.whole
    if data[:6] == b"\x93NUMPY":
        # Another header promises nothing here; the reader says what is missing.
        header = plain_npy_header(data)
        return None if header is None else header.end + header.promised
    if data[:4] == b"TDSm" and ending == "tdms":
        return _tdms_size(data)
    for base in (0, 512):
        if data[base : base + 8] == b"\x89HDF\r\n\x1a\n":
            return hdf5_size(data, base)
    return None


@dataclass(frozen=True)
class NpyHeader:
    """What the header of a .npy file states.

    Attributes:
        end: bytes of the header; the samples begin there.
        shape: of the array.
        fortran_order: whether its first index moves fastest.
        dtype: of its numbers.
    """

    end: int
    shape: tuple[int, ...]
    fortran_order: bool
    dtype: np.dtype[Any]

    @property
    def promised(self) -> int:
        """Bytes that must follow the header."""
        return prod(self.shape) * self.dtype.itemsize


def npy_header(data: Data) -> NpyHeader:
    """Return the header of a .npy file.

    A header that numpy would not write is evaluated as Python source; a damaged one raises any exception that source
    can.
    """
    plain = plain_npy_header(data)
    if plain is not None:
        return plain
    with stream_of(data) as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran_order, dtype = read(stream)
        return NpyHeader(stream.tell(), shape, fortran_order, dtype)


def plain_npy_header(data: Data) -> NpyHeader | None:
    """Return the header of a .npy file as numpy writes it, else None.

    Such a header is of numbers in at most two dimensions, and nothing in it has to be evaluated.
    """
    if data[:6] != b"\x93NUMPY" or data[6:8] not in (b"\x01\x00", b"\x02\x00"):
        return None
    begin = 10 if data[6] == 1 else 12
    end = begin + int.from_bytes(data[8:begin], "little")
    return _plain_npy_header(data[begin:end], end) if end - begin <= _MAX_NPY_HEADER_BYTES else None


@lru_cache(maxsize=64)
def _plain_npy_header(text: bytes, end: int) -> NpyHeader | None:
    """Return what a header of ``end`` bytes states, None for another than a plain one; equal files share it."""
    match = _NPY_HEADER.fullmatch(text)
    if match is None:
        return None
    try:
        dtype = np.dtype(match[1].decode("ascii"))
    except TypeError:
        return None
    return NpyHeader(end, tuple(int(size) for size in match[3].split(b",") if size), match[2] == b"True", dtype)


def hdf5_size(data: Data, base: int) -> int | None:
    """Return the end-of-file address of the superblock at ``base``, or None."""
    version = data[base + 8] if len(data) > base + 8 else 255
    if version not in _SUPERBLOCKS:
        return None
    width_at, fixed = _SUPERBLOCKS[version]
    width = data[base + width_at] if len(data) > base + width_at else 0
    place = base + fixed + 2 * width
    field = data[place : place + width]
    if width not in (2, 4, 8) or len(field) < width or field == b"\xff" * width:
        return None
    return int.from_bytes(field, "little")


def _tdms_segments(data: Data) -> tuple[int, int | None]:
    """Return the end of the last whole segment, and that declared by the next, or None."""
    end = 0
    while data[end : end + 4] == b"TDSm" and len(data) >= end + _TDMS_LEAD:
        (following,) = struct.unpack("<Q", data[end + 12 : end + 20])
        if following == _TDMS_UNKNOWN:
            return end, None
        target = end + _TDMS_LEAD + following
        if target > len(data):
            return end, target
        end = target
    return end, (end + _TDMS_LEAD if end < len(data) else None)


def _tdms_size(data: Data) -> int | None:
    end, promised = _tdms_segments(data)
    return promised if promised is not None else (end or None)


def whole_part(data: bytes, kind: str) -> bytes:
    """Return the part of a growing file whose samples are final.

    ``kind`` "csv": up to the last end of a line; "tdms": up to the end of the last whole segment.
    """
    if kind == "tdms":
        return data[: _tdms_segments(data)[0]]
    return data[: data.rfind(b"\n") + 1]
