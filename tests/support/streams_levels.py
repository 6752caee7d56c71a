"""Makers and checks that tests of streams levels share."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable
from typing import Any

import h5py
import numpy as np
import soundfile
from numpy.typing import NDArray

RATE = 1000.0


FULL = 1 << 15


COUNTS = np.round(np.random.default_rng(1).uniform(-0.9, 0.9, 1000) * FULL).astype(np.int16)


Integers = NDArray[np.int16]


def npy(counts: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    np.save(stream, counts)
    return stream.getvalue()


def sound(kind: str) -> Callable[[Integers], bytes]:
    def make(counts: Integers) -> bytes:
        stream = io.BytesIO()
        soundfile.write(stream, counts, int(RATE), format=kind, subtype="PCM_16")
        return stream.getvalue()

    return make


def open_wav(counts: Integers, size: int, tail: bytes = b"", magic: bytes = b"RIFF", before: bytes = b"") -> bytes:
    """Return a WAV file whose header has ``size`` for the sizes of file and samples, with chunks around the samples."""
    form = struct.pack("<4sIHHIIHH", b"fmt ", 16, 1, 1, 1000, 2000, 2, 16)
    head = struct.pack("<4sI4s", magic, size, b"WAVE") + before + form + struct.pack("<4sI", b"data", size)
    return head + counts.astype("<i2").tobytes() + tail


def hdf5(counts: NDArray[Any], **stated: Any) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file.create_dataset("x", data=counts).attrs.update(stated)
    return stream.getvalue()
