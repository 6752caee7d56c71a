"""Sets of modes as CSV, such as an experimental modal analysis gives: a line for each mode and place.

::

    frequency_hz,damping_percent,name,real,imag
    828.0,7.6,acc1.x,0.31,0.02

``damping_percent`` is of critical damping, empty where it is not known; lines of one frequency are one mode.
"""

from __future__ import annotations

import math

import numpy as np

from models.gears.transfer.mode_sets import ModeSet
from monitor.gears.frf_files import FrfError, csv_rows

_HEAD = ["frequency_hz", "damping_percent", "name", "real", "imag"]


def read_mode_set(data: bytes, name: str) -> ModeSet:
    """Read a set of modes; each needs the same places.

    Raises:
        FrfError: the file cannot be used; the message has ``name``, the line, and what was expected.
    """
    rows = [(number, [cell.strip() for cell in row]) for number, row in csv_rows(data, name)]
    if not rows or rows[0][1] != _HEAD:
        found = f"line {rows[0][0]}: {','.join(rows[0][1])[:80]}" if rows else "nothing"
        raise FrfError(f"{name}: expected the columns {','.join(_HEAD)}, found {found}")
    modes: dict[float, tuple[float, dict[str, complex]]] = {}
    for number, row in rows[1:]:
        frequency, damping, place, value = _row(row, f"{name}, line {number}")
        known, shape = modes.setdefault(frequency, (damping, {}))
        if place in shape or not (known == damping or (math.isnan(known) and math.isnan(damping))):
            what = f"{place} twice" if place in shape else "two values of damping"
            raise FrfError(f"{name}, line {number}: the mode at {frequency:g} Hz has {what}")
        shape[place] = value
    if not modes:
        raise FrfError(f"{name}: expected modes, found none")
    order = sorted(modes)
    names = tuple(modes[order[0]][1])
    for frequency in order:
        different = set(names) ^ set(modes[frequency][1])
        if different:
            raise FrfError(
                f"{name}: expected all modes at the same places, {min(different)} is not in both the mode at "
                f"{order[0]:g} Hz and that at {frequency:g} Hz"
            )
    shapes = np.array([[modes[frequency][1][place] for frequency in order] for place in names])
    return ModeSet(np.array(order), names, shapes, np.array([modes[frequency][0] for frequency in order]))


def _row(row: list[str], where: str) -> tuple[float, float, str, complex]:
    """Return frequency, Hz, share of critical damping or NaN, name and displacement of a line."""
    try:
        frequency, real, imag = (float(row[i]) for i in (0, 3, 4))
        damping = 0.01 * float(row[1]) if row[1] else math.nan
    except (ValueError, IndexError):
        frequency = real = imag = damping = math.inf
    usable = math.isfinite(frequency) and frequency > 0.0 and math.isfinite(real) and math.isfinite(imag)
    if len(row) != len(_HEAD) or not usable or math.isinf(damping) or damping < 0.0 or not row[2]:
        raise FrfError(
            f"{where}: expected a frequency above 0, a damping or nothing, a name and two finite numbers, "
            f"found {','.join(row)[:80]!r}"
        )
    return frequency, damping, row[2], complex(real, imag)
