"""Files made to cost a reader far more than their size."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
from collections.abc import Callable
from functools import partial
from typing import Any

import h5py
import numpy as np
import scipy.io
import soundfile

Maker = Callable[[float], bytes]
"""From a share of the full size to the bytes of a file."""


def wide_text(share: float, lines: int = 3, columns: int = 1_000_000) -> bytes:
    """Return lines of very many columns."""
    return (b",".join([b"1.5"] * round(share * columns)) + b"\n") * lines


def row_text(count: int = 128_000) -> bytes:
    """Return a block as one line."""
    return b",".join(b"%.4f" % value for value in np.sin(np.arange(count) * 0.1)) + b"\n"


# One digit is packed as tightly as by the default, in a third of the time.
_XZ = partial(lzma.compress, preset=0)


def bomb(pack: Callable[[bytes], bytes], share: float) -> bytes:
    """Return 1 GiB of one digit, packed."""
    return pack(b"0" * round(share * (1 << 30)))


def hdf5_of(fill: Callable[[Any], object]) -> bytes:
    """Return an HDF5 file."""
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        fill(file)
    return stream.getvalue()


def tiny_sets(share: float) -> bytes:
    """Return an HDF5 file of up to 9,900 data sets of two numbers, of 4,200 at least."""

    def fill(file: Any) -> None:
        for number in range(max(4_200, round(share * 9_900))):
            file[f"d{number}"] = np.array([0.5, 1.5])

    return hdf5_of(fill)


def packed_zeros(share: float) -> bytes:
    """Return an HDF5 file of 130 million packed zeros."""
    size = round(share * 130_000_000)
    return hdf5_of(lambda file: file.create_dataset("x", data=np.zeros(size), chunks=(10_000,), compression="gzip"))


def npy_header(text: bytes, data: bytes = b"") -> bytes:
    """Return a .npy file with any header."""
    text = text.ljust(54) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


def nested_mat(share: float) -> bytes:
    """Return a MAT file of cells in cells."""
    value: Any = np.zeros(4)
    for _ in range(round(share * 400)):
        cell = np.empty((1, 1), dtype=object)
        cell[0, 0] = value
        value = cell
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"x": value})
    return stream.getvalue()


def wide_sound(share: float) -> bytes:
    """Return a WAV file of a thousand channels, in its head forty thousand."""
    stream = io.BytesIO()
    soundfile.write(stream, np.zeros((10, 1000)), 25600, format="WAV", subtype="PCM_16")
    data = bytearray(stream.getvalue())
    data[22:24] = (40_000).to_bytes(2, "little")
    return bytes(data)


_DIMENSIONS = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%s), }"
ATTACKS: dict[str, tuple[str, Maker, set[str]]] = {
    "columns.csv": ("csv", wide_text, {"refused"}),
    "columns_twice.csv": ("csv", lambda share: wide_text(share, columns=2_000_000), {"refused"}),
    "row.csv": ("csv", lambda share: wide_text(share, lines=1, columns=2_000_000), {"read"}),
    "bad_row.csv": ("csv", lambda share: wide_text(share, lines=1)[:-1] + b",x\n", {"unreadable"}),
    "header.csv": ("csv", lambda share: wide_text(share).replace(b"1.5", b"abc", round(share * 1e6)), {"refused"}),
    "bomb.csv.gz": ("csv", lambda share: bomb(gzip.compress, share), {"refused"}),
    "bomb.csv.xz": ("csv", lambda share: bomb(_XZ, share), {"refused"}),
    "bomb.csv.bz2": ("csv", lambda share: bomb(bz2.compress, share), {"refused"}),
    "bomb.npy.gz": ("npy", lambda share: bomb(gzip.compress, share), {"refused"}),
    "tiny.h5": ("hdf5", tiny_sets, {"refused"}),
    "zeros.h5": ("hdf5", packed_zeros, {"refused"}),
    "dimensions.npy": ("npy", lambda share: npy_header(_DIMENSIONS % (b"1," * 30), bytes(8)), {"wrong_shape"}),
    "more_dimensions.npy": ("npy", lambda share: npy_header(_DIMENSIONS % (b"1," * 99), bytes(8)), {"wrong_shape"}),
    "brackets.npy": ("npy", lambda share: npy_header(b"(" * 9_000), {"unreadable"}),
    "minus.npy": ("npy", lambda share: npy_header(b"-" * 9_000 + b"1"), {"unreadable"}),
    "nested.mat": ("mat", nested_mat, {"wrong_shape", "unreadable", "reader_crashed"}),
    "channels.wav": ("wav", wide_sound, {"refused", "unreadable", "incomplete", "empty"}),
}
"""By the name of the file: its format, how it is made, and the verdicts that it may get."""
