"""What every reader returns, and the one error that it raises."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.errors import SpallwatchError

MAX_BYTES = 1 << 30
"""No file, unpacked or loaded, may be larger: 1 GiB, about 45 min of eight float64 channels at 48 kHz."""


class ReaderError(SpallwatchError):
    """A file cannot be read.

    Attributes:
        status: the rejection status of the interface that says so (``unreadable``, ``wrong_shape``, ...).
    """

    def __init__(self, status: str, reason: str) -> None:
        """Keep the status beside the sentence for people."""
        super().__init__(reason)
        self.status = status


@dataclass(frozen=True, eq=False)
class Reading:
    """The rows of one file, and what the file itself says about them.

    Attributes:
        samples: shape (row, sample), float32 or float64, each row contiguous.
        names: name of each row in the file: header, variable, or ``column_1`` and so on.
        columns: 1-based number of each row in the file.
        channels: what the data set calls each row; the names where it does not.
        rate: sampling rate in Hz, or None where the file is silent; likewise what follows.
        unit: of every row, "g", "m/s2", "V" or None; another one, such as "Pa", as the file spells it.
        speed: shaft speed in Hz.
        load: radial load in N.
        start: seconds since 1970 UTC of the first sample.
        units: unit of each row where the file states them one by one, else empty.
        scaled: whether a side-car has said what the numbers mean, so that the configuration must not scale them again.
    """

    samples: NDArray[np.floating]
    names: tuple[str, ...]
    columns: tuple[int, ...]
    channels: tuple[str, ...]
    rate: float | None = None
    unit: str | None = None
    speed: float | None = None
    load: float | None = None
    start: float | None = None
    units: tuple[str | None, ...] = ()
    scaled: bool = False


def plain_reading(
    samples: NDArray[np.floating], names: tuple[str, ...] | None = None, rate: float | None = None
) -> Reading:
    """Make a reading whose rows are numbered from 1.

    Args:
        samples: shape (row, sample).
        names: name of each row; ``column_1`` and so on by default.
        rate: sampling rate in Hz where the file states it.

    Returns:
        The reading.
    """
    columns = tuple(range(1, samples.shape[0] + 1))
    names = tuple(f"column_{column}" for column in columns) if names is None else names
    return Reading(samples, names, columns, names, rate)


def stack_rows(rows: Sequence[NDArray[np.floating]]) -> NDArray[np.floating]:
    """Join rows of equal length to shape (row, sample); a single one is not copied."""
    return np.ascontiguousarray(rows[0])[np.newaxis] if len(rows) == 1 else np.stack(rows)


def rows_of(array: NDArray[np.generic], where: str) -> NDArray[np.floating]:
    """Turn a stored array into rows of samples: the longer axis is time.

    Args:
        array: one or two dimensions, real numbers.
        where: what is being read, for the message.

    Returns:
        Shape (row, sample); float32 for float32 and for integers of at most 16 bits, else float64.

    Raises:
        ReaderError: ``wrong_shape`` for other dimensions or a square array, ``empty``, ``unreadable`` for other types.
    """
    if array.dtype.kind not in "fiu":
        raise ReaderError("unreadable", f"{where}: expected real numbers, got type {array.dtype}")
    squeezed = array[np.newaxis, :] if array.ndim == 1 else array
    if squeezed.ndim != 2:
        raise ReaderError("wrong_shape", f"{where}: expected one or two dimensions, got shape {array.shape}")
    if squeezed.size == 0:
        raise ReaderError("empty", f"{where}: holds no samples (shape {array.shape})")
    if squeezed.shape[0] == squeezed.shape[1] > 1:
        raise ReaderError("wrong_shape", f"{where}: cannot tell samples from channels in shape {array.shape}")
    rows = squeezed.T if squeezed.shape[0] > squeezed.shape[1] else squeezed
    exact = array.dtype.itemsize <= (4 if array.dtype.kind == "f" else 2)
    return np.ascontiguousarray(rows, dtype=np.float32 if exact else np.float64)
