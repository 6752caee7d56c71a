"""A given mesh stiffness as CSV: its course over one pitch, or its harmonics.

The first line names the columns, "#" begins a comment:

* ``pitch,stiffness_newton_per_m[,error_um]``: phase from 0 to below 1, ascending, any spacing; periodic, linear between
  the lines. A last line at 1 is allowed where it repeats the first.
* ``order,stiffness_newton_per_m[,phase_deg]``: amplitude of the cosine of each mesh order, order 0 is the mean; k is
  the sum of amplitude * cos(2 pi order * pitch - phase).
"""

from __future__ import annotations

import csv
import math
from typing import TYPE_CHECKING

import numpy as np

from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_COURSE, _ORDERS = ("pitch", "stiffness_newton_per_m"), ("order", "stiffness_newton_per_m")
_HEADS = (_COURSE, (*_COURSE, "error_um"), _ORDERS, (*_ORDERS, "phase_deg"))


class GearTableError(WrongInputError):
    """A table of a mesh cannot be used; the message names the file, the line, and what was expected."""


def read_stiffness(content: str, name: str, samples: int) -> tuple[Array, Array | None]:
    """Return stiffness over one pitch, N/m, shape (samples,), and the error, m, in that shape where it is given.

    Raises:
        GearTableError: where the text cannot be used.
    """
    lines = [(number, line) for number, line in enumerate(content.lstrip("\ufeff").splitlines(), 1) if _counts(line)]
    if not lines:
        raise GearTableError(f"{name}: expected a line of column names, got an empty file")
    head = tuple(cell.strip() for cell in lines[0][1].split(","))
    if head not in _HEADS:
        expected = " or ".join(",".join(known) for known in _HEADS)
        raise GearTableError(f"{name}, line {lines[0][0]}: expected the columns {expected}, got {lines[0][1].strip()}")
    if len(lines) == 1:
        raise GearTableError(f"{name}: expected lines of numbers below the column names, got none")
    rows = np.array([_numbers(name, number, line, head) for number, line in lines[1:]])
    numbers = [number for number, _ in lines[1:]]
    if head[0] == "order":
        return _from_orders(name, numbers, rows, samples), None
    return _from_course(name, numbers, rows, samples)


def _counts(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _numbers(name: str, number: int, line: str, head: tuple[str, ...]) -> list[float]:
    cells = next(csv.reader([line]))
    try:
        values = [float(cell) for cell in cells]
    except ValueError:
        values = []
    if len(values) != len(head) or not all(map(math.isfinite, values)):
        raise GearTableError(f"{name}, line {number}: expected {len(head)} finite numbers, got {line.strip()!r}")
    return values


def _from_course(name: str, numbers: list[int], rows: Array, samples: int) -> tuple[Array, Array | None]:
    pitch = rows[:, 0]
    if len(rows) > 1 and pitch[-1] == 1.0 and pitch[0] == 0.0:
        if not np.array_equal(rows[-1, 1:], rows[0, 1:]):
            raise GearTableError(f"{name}, line {numbers[-1]}: expected at pitch 1 what stands at pitch 0")
        rows, pitch = rows[:-1], pitch[:-1]
    for place, number in enumerate(numbers[: len(rows)]):
        if not 0.0 <= pitch[place] < 1.0 or (place and pitch[place] <= pitch[place - 1]):
            raise GearTableError(
                f"{name}, line {number}: expected pitch to ascend from 0 to below 1, got {pitch[place]!r}"
            )
        if rows[place, 1] < 0.0:
            raise GearTableError(f"{name}, line {number}: expected a stiffness not below zero, got {rows[place, 1]!r}")
    if not rows[:, 1].any():
        raise GearTableError(f"{name}: expected a stiffness that is not zero throughout")
    grid = np.arange(samples) / samples
    columns: list[Array] = [np.interp(grid, pitch, column, period=1.0) for column in rows[:, 1:].T]
    return columns[0], 1e-6 * columns[1] if len(columns) > 1 else None


def _from_orders(name: str, numbers: list[int], rows: Array, samples: int) -> Array:
    course, seen = np.zeros(samples), set[int]()
    phase = math.tau * np.arange(samples) / samples
    for number, row in zip(numbers, rows, strict=True):
        order = int(row[0])
        if order != row[0] or order < 0 or order in seen or 2 * order >= samples:
            raise GearTableError(
                f"{name}, line {number}: expected whole orders from 0 to below {samples / 2:g}, each once, "
                f"got {row[0]!r}"
            )
        seen.add(order)
        course += row[1] * np.cos(order * phase - (math.radians(row[2]) if row.size > 2 else 0.0))
    if 0 not in seen or course.min() < 0.0:
        got = "no order 0" if 0 not in seen else f"a least value of {course.min():.4g} N/m"
        raise GearTableError(f"{name}: expected order 0 and a stiffness that is never below zero, got {got}")
    return course
