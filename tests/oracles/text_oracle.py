"""The slow and obvious way to read lines of numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def parse_slowly(data: bytes, separator: str | None) -> NDArray[np.float64]:
    """Split each line and convert each field.

    Args:
        data: text of numbers in ASCII, no header.
        separator: between the fields, or None for blanks.

    Returns:
        Shape (column, line).
    """
    lines = [line for line in data.decode("ascii").splitlines() if line.strip()]
    return np.array([[float(field) for field in line.split(separator)] for line in lines]).T
