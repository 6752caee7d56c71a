"""Frequency responses as CSV and as universal files, as other programs write them."""

from __future__ import annotations

import csv
import io
import itertools

import numpy as np
from numpy.typing import NDArray

from models.gears.transfer.frf import FrequencyResponses
from monitor.gears.frf_files import CSV_UNITS

_KIND_OF = {"m": (8, "Displacement"), "N": (13, "Force"), "m/s": (11, "Velocity"), "m/s2": (12, "Acceleration"),
            "Pa": (15, "Pressure")}  # fmt: skip
_RESPONSE_FUNCTION = 4
_AXES = ("x", "y", "z")


def frf_to_csv(frf: FrequencyResponses) -> str:
    """Return responses as CSV, numbers in full."""
    units = (frf.output_unit, frf.input_unit, 1.0)
    suffix = next(suffix for suffix, known in CSV_UNITS.items() if known == units)
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["frequency_hz", "output", "input", f"real_{suffix}", f"imag_{suffix}"])
    for o, output in enumerate(frf.outputs):
        for i, given in enumerate(frf.inputs):
            values = zip(frf.frequency.tolist(), frf.h[:, o, i].tolist(), strict=True)
            rows.writerows((f, output, given, value.real, value.imag) for f, value in values)
    return text.getvalue()


def frf_to_uff(frf: FrequencyResponses) -> bytes:
    """Return responses as a universal file: data set 164 (SI), then a data set 58 for each, double precision.

    Frequencies have six digits. A point whose name is a number is the node of it; others are entities by their names.
    """
    points = tuple(dict.fromkeys(_split(name)[0] for name in (*frf.outputs, *frf.inputs)))
    numbers = {point: int(point) for point in points if point.isdecimal()}
    unused = (number for number in itertools.count(1) if number not in set(numbers.values()))
    numbers |= {point: next(unused) for point in points if point not in numbers}
    parts = [_units_set()]
    for o, output in enumerate(frf.outputs):
        parts += [_uff_set(frf, (output, given), numbers, frf.h[:, o, i]) for i, given in enumerate(frf.inputs)]
    return "".join(parts).encode("latin-1")


def _split(name: str) -> tuple[str, int]:
    """Return point and direction of a name, 0 for a scalar."""
    point, _, axis = name.rpartition(".")
    return (point, _AXES.index(axis) + 1) if point and axis in _AXES else (name, 0)


def _units_set() -> str:
    factors = f"{f'{1.0:25.17e}' * 3}\n{0.0:25.17e}".replace("e", "D")
    return f"{-1:6d}\n{164:6d}\n{1:10d}{'Meter (newton)':20}{2:10d}\n{factors}\n{-1:6d}\n"


def _uff_set(frf: FrequencyResponses, pair: tuple[str, str], numbers: dict[str, int], h: NDArray[np.complex128]) -> str:
    """Return one function, lines as pairs of frequency and value unless they are even to the digits of the header."""
    steps = np.diff(frf.frequency)
    begin, step = (float(f"{value:.5e}") for value in (frf.frequency[0], steps[0]))
    even = np.allclose(begin + step * np.arange(len(h)), frf.frequency, rtol=0.0, atol=1e-9 * frf.band[1])
    ends = [(*_split(name), numbers[_split(name)[0]]) for name in pair]
    names = "".join(
        f" {'NONE' if point.isdecimal() else point:10}{number:10d}{direction:4d}" for point, direction, number in ends
    )
    head = [f"{f'{pair[0]} over {pair[1]}':80.80}", *(f"{'NONE':80}" for _ in range(4))]
    head.append(f"{_RESPONSE_FUNCTION:5d}{0:10d}{0:5d}{0:10d}{names}")
    starts = (begin, step) if even else (0.0, 0.0)
    head.append(f"{6:10d}{len(h):10d}{int(even):10d}" + "".join(f"{value:13.5e}" for value in (*starts, 0.0)))
    sides = ((18, "Frequency", "Hz"), *((*_KIND_OF[unit], unit) for unit in (frf.output_unit, frf.input_unit)))
    head += [
        f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:20} {unit:20}" for kind, label, unit in (*sides, (0, "NONE", "NONE"))
    ]
    cells = [f"{value.real:20.12e}{value.imag:20.12e}" for value in h.tolist()]
    if even:
        body = ["".join(cells[i : i + 2]) for i in range(0, len(cells), 2)]
    else:
        body = [f"{f:13.5e}{cell}" for f, cell in zip(frf.frequency.tolist(), cells, strict=True)]
    return "\n".join([f"{-1:6d}", f"{58:6d}{'':74}", *head, *body, f"{-1:6d}"]) + "\n"
