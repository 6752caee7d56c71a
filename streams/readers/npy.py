"""NumPy's .npy files: plain arrays, never pickles."""

from __future__ import annotations

import io
from math import prod

import numpy as np

from streams.samples import MAX_BYTES, ReaderError, Samples, rows_of


def read_npy(data: bytes, name: str) -> Samples:
    """Read an array of one or two dimensions, the longer axis being time.

    Returns:
        Samples of shape (row, sample).

    Raises:
        ReaderError: ``empty``; ``unreadable`` for pickled objects and for what is no .npy file; ``incomplete``
            where the header promises more than there is; ``refused`` above ``MAX_BYTES``; ``wrong_shape``.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = header(stream)
    except Exception as error:  # The header is Python source, and a damaged one fails in any way that source can.
        raise ReaderError("unreadable", f"{name}: not a .npy file ({error})") from error
    if dtype.hasobject:
        raise ReaderError("unreadable", f"{name}: holds pickled objects, which are never loaded")
    declared = prod(shape) * dtype.itemsize
    if declared > MAX_BYTES:
        raise ReaderError("refused", f"{name}: claims {declared} bytes when loaded, {MAX_BYTES} are allowed")
    present = len(data) - stream.tell()
    if declared > present:
        raise ReaderError("incomplete", f"{name}: the header promises {declared} bytes, {present} are there")
    if declared < present:
        raise ReaderError("unreadable", f"{name}: the header promises {declared} bytes, {present} follow it")
    array = np.load(io.BytesIO(data), allow_pickle=False)
    return Samples(rows_of(array, name))
