"""Frequency response functions in files: CSV and data set 58 of universal files, function type 4, in and out.

CSV, a line for each response and frequency, in any order of the pairs; "#" begins a comment::

    frequency_hz,output,input,real_m_per_s2_per_newton,imag_m_per_s2_per_newton
    100.0,acc1.x,left.x,0.021,-0.0004

or ``magnitude_...`` and ``phase_deg`` in place of the last two; what units there are stands in :data:`CSV_UNITS`.

Universal files name a direction at a point by node, entity and number: node 12 in +Z is ``12.z`` here, or ``acc1.z``
where the entity has a name. A response along -Z is that along +Z with the other sign. Frequencies have
six digits there.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.gears.transfer.frf import FrequencyResponses
from models.words.errors import WrongInputError
from streams.files.formats.uff import is_si, universal_file
from streams.files.statements import known_unit
from streams.types.samples import ReaderError

Complex = NDArray[np.complex128]
CSV_UNITS: dict[str, tuple[str, str, float]] = {
    "m_per_s2_per_newton": ("m/s2", "N", 1.0),
    "g_per_newton": ("m/s2", "N", 9.80665),
    "m_per_s_per_newton": ("m/s", "N", 1.0),
    "mm_per_s_per_newton": ("m/s", "N", 1e-3),
    "m_per_newton": ("m", "N", 1.0),
    "um_per_newton": ("m", "N", 1e-6),
    "pascal_per_newton": ("Pa", "N", 1.0),
    "pascal_per_m_per_s": ("Pa", "m/s", 1.0),
    "pascal_per_m_per_s2": ("Pa", "m/s2", 1.0),
}
"""Ends of the names of the columns: unit of the outputs, of the inputs, factor to them."""
_LABELS = {
    "m/s2": ("m/s2", 1.0), "g": ("m/s2", 9.80665), "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3), "m": ("m", 1.0),
    "mm": ("m", 1e-3), "um": ("m", 1e-6), "µm": ("m", 1e-6), "pa": ("Pa", 1.0), "n": ("N", 1.0), "kn": ("N", 1e3),
    "lbf": ("N", 4.4482216152605),
}  # fmt: skip
_KINDS = {8: "m", 9: "N", 11: "m/s", 12: "m/s2", 13: "N", 15: "Pa"}
"""SI unit of a specific data type."""
_KIND_OF = {"m": (8, "Displacement"), "N": (13, "Force"), "m/s": (11, "Velocity"), "m/s2": (12, "Acceleration"),
            "Pa": (15, "Pressure")}  # fmt: skip
_RESPONSE_FUNCTION, _COMPLEX = 4, (5, 6)
_AXES = ("x", "y", "z")
# Data set 58 has ten characters for the name of an entity.
_MAX_ENTITY = 10


class FrfError(WrongInputError):
    """A file of frequency responses cannot be used; the message names it, the place, and what was expected."""


@dataclass(frozen=True)
class _Response:
    """One response on its way into a set; ``where`` names it in messages."""

    output: str
    input: str
    units: tuple[str, str]
    frequency: NDArray[np.float64]
    h: Complex
    where: str


def read_frf(data: bytes, name: str) -> FrequencyResponses:
    """Read the responses of a CSV or universal file, told by its content.

    Raises:
        FrfError: the file cannot be used as a full set of responses over one band; ``name`` is in the message.
    """
    text = data[:4096].lstrip(b"\xef\xbb\xbf \r\n\t")
    universal = text.startswith(b"-1") and text[2:].split(b"\n", 1)[0].strip() == b""
    responses = list(_uff_responses(data, name) if universal else _csv_responses(data, name))
    return _as_set(responses, name)


def _as_set(responses: Sequence[_Response], name: str) -> FrequencyResponses:
    """Return single responses as one set, which has to be full."""
    if not responses:
        raise FrfError(f"{name}: expected frequency responses, found none")
    first = responses[0]
    outputs = tuple(dict.fromkeys(response.output for response in responses))
    inputs = tuple(dict.fromkeys(response.input for response in responses))
    found: dict[tuple[str, str], _Response] = {}
    for response in responses:
        pair = (response.output, response.input)
        if pair in found:
            raise FrfError(f"{response.where}: {pair[0]} over {pair[1]} was given before, at {found[pair].where}")
        if response.units != first.units:
            expected, got = (" over ".join(each.units) for each in (first, response))
            raise FrfError(f"{response.where}: expected {expected} as at {first.where}, found {got}")
        if not np.array_equal(response.frequency, first.frequency):
            raise FrfError(
                f"{response.where}: expected the frequencies of {first.where}, which are {_shown(first.frequency)}, "
                f"found {_shown(response.frequency)}"
            )
        found[pair] = response
    missing = [f"{o} over {i}" for o in outputs for i in inputs if (o, i) not in found]
    if missing:
        raise FrfError(f"{name}: expected each output over each input, missing: {', '.join(missing[:5])}")
    h = np.stack([np.stack([found[o, i].h for i in inputs], axis=-1) for o in outputs], axis=1)
    try:
        return FrequencyResponses(first.frequency, h, outputs, inputs, *first.units)
    except ValueError as error:
        raise FrfError(f"{name}: {error}") from error


def _shown(frequency: NDArray[np.float64]) -> str:
    return f"{frequency.size} from {frequency[0]:g} to {frequency[-1]:g} Hz" if frequency.size else "none"


def csv_rows(data: bytes, name: str) -> list[tuple[int, list[str]]]:
    """Return number and cells of the lines of a CSV file that are not empty and no comment.

    Raises:
        FrfError: it is not UTF-8, or not CSV.
    """
    try:
        rows = list(enumerate(csv.reader(data.decode("utf-8-sig").splitlines()), 1))
    except UnicodeDecodeError as error:
        raise FrfError(f"{name}: expected CSV as UTF-8, found byte {error.start} undecodable") from error
    except csv.Error as error:
        raise FrfError(f"{name}: expected CSV, found none ({error})") from error
    return [(number, row) for number, row in rows if row and not row[0].lstrip().startswith("#")]


def _csv_responses(data: bytes, name: str) -> Iterator[_Response]:
    """Yield the responses of a CSV file in the order in which they first appear."""
    rows = csv_rows(data, name)
    if not rows:
        raise FrfError(f"{name}: expected a line of column names, found none")
    polar, units, factor = _csv_head([cell.strip() for cell in rows[0][1]], f"{name}, line {rows[0][0]}")
    points: dict[tuple[str, str], list[tuple[float, complex]]] = {}
    begins: dict[tuple[str, str], int] = {}
    for number, row in rows[1:]:
        pair, frequency, h = _csv_point(row, f"{name}, line {number}", polar=polar)
        begins.setdefault(pair, number)
        points.setdefault(pair, []).append((frequency, factor * h))
    for (output, given), found in points.items():
        f, h = np.array([point[0] for point in found]), np.array([point[1] for point in found], np.complex128)
        yield _Response(output, given, units, f, h, f"{name}, from line {begins[output, given]}")


def _csv_head(head: list[str], where: str) -> tuple[bool, tuple[str, str], float]:
    """Return whether magnitudes and phases are given, the units, and the factor to them."""
    for polar, (first, second) in ((False, ("real_", "imag_")), (True, ("magnitude_", "phase_deg"))):
        for unit, (*units, factor) in CSV_UNITS.items():
            last = second if polar else second + unit
            if head == ["frequency_hz", "output", "input", first + unit, last]:
                return polar, (units[0], units[1]), factor
    raise FrfError(
        f"{where}: expected the columns frequency_hz,output,input,real_UNIT,imag_UNIT or ...,magnitude_UNIT,phase_deg "
        f"with UNIT one of {', '.join(CSV_UNITS)}, found {','.join(head)[:120]}"
    )


def _csv_point(row: list[str], where: str, *, polar: bool) -> tuple[tuple[str, str], float, complex]:
    """Return output and input, frequency, and response of a line."""
    try:
        frequency, first, second = (float(row[i]) for i in (0, 3, 4))
    except (ValueError, IndexError):
        frequency = first = second = math.nan
    names = tuple(cell.strip() for cell in row[1:3])
    if len(row) != 5 or not all(map(math.isfinite, (frequency, first, second))) or not all(names):
        raise FrfError(f"{where}: expected a frequency, two names and two finite numbers, found {','.join(row)[:80]!r}")
    h = (
        first * complex(math.cos(math.radians(second)), math.sin(math.radians(second)))
        if polar
        else complex(first, second)
    )
    return (names[0], names[1]), frequency, h


def frf_to_csv(frf: FrequencyResponses) -> str:
    """Return responses as CSV, numbers in full.

    Raises:
        ValueError: units for which there is no name of a column.
    """
    units = (frf.output_unit, frf.input_unit, 1.0)
    suffix = next((suffix for suffix, known in CSV_UNITS.items() if known == units), None)
    if suffix is None:
        raise ValueError(f"responses in {units[0]} over {units[1]} have no column name")
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["frequency_hz", "output", "input", f"real_{suffix}", f"imag_{suffix}"])
    for o, output in enumerate(frf.outputs):
        for i, given in enumerate(frf.inputs):
            values = zip(frf.frequency.tolist(), frf.h[:, o, i].tolist(), strict=True)
            rows.writerows((f, output, given, value.real, value.imag) for f, value in values)
    return text.getvalue()


def _uff_responses(data: bytes, name: str) -> Iterator[_Response]:
    """Yield the frequency response functions of a universal file; its other data sets are left."""
    try:
        with universal_file(data, name) as file:
            si = is_si(file)
            for index, kind in enumerate(file.get_set_types()):
                function: dict[str, Any] = file.read_sets(index) if int(kind) == 58 else {}
                if function and int(function["func_type"]) == _RESPONSE_FUNCTION:
                    yield _uff_response(function, f"{name}: data set {index + 1}", si=si)
    except ReaderError as error:
        raise FrfError(str(error)) from error


def _uff_response(function: dict[str, Any], where: str, *, si: bool) -> _Response:
    if int(function["ord_data_type"]) not in _COMPLEX:
        raise _told(where, f"expected complex numbers (type 5 or 6), found type {function['ord_data_type']}")
    if int(function.get("load_case_id") or 0) != 0:
        raise _told(where, f"expected one excitation (load case 0), found load case {function['load_case_id']}")
    h, promised = np.asarray(function["data"], np.complex128), int(function["num_pts"])
    if h.size != promised:
        raise _told(where, f"{promised} values promised, {h.size} there")
    output, sign = _uff_name(function, "rsp", where)
    given, other = _uff_name(function, "ref", where)
    (unit, factor), (below, divisor) = (_uff_unit(function, part, where, si=si) for part in ("ordinate", "orddenom"))
    frequency = np.asarray(function["x"], np.float64)
    where = f"{where} ({output} over {given})"
    return _Response(output, given, (unit, below), frequency, sign * other * factor / divisor * h, where)


def _told(where: str, what: str) -> ReaderError:
    """Return an error that passes through the context of the file."""
    return ReaderError("unreadable", f"{where}: {what}")


def _uff_name(function: dict[str, Any], side: str, where: str) -> tuple[str, float]:
    """Return the name of response or reference, and its sign."""
    direction, node = int(function.get(f"{side}_dir") or 0), int(function.get(f"{side}_node") or 0)
    entity = str(function.get(f"{side}_ent_name") or "").strip()
    point = str(node) if entity in ("", "NONE") else entity
    if abs(direction) > len(_AXES):
        raise _told(where, f"expected a direction from -3 to 3 at {point}, found {direction}, a rotation")
    return (f"{point}.{_AXES[abs(direction) - 1]}" if direction else point), -1.0 if direction < 0 else 1.0


def _uff_unit(function: dict[str, Any], part: str, where: str, *, si: bool) -> tuple[str, float]:
    """Return the SI unit of numerator or denominator and the factor to it."""
    kind = _KINDS.get(int(function.get(f"{part}_spec_data_type") or 0))
    label = known_unit(function.get(f"{part}_axis_units_lab"))
    side = "numerator" if part == "ordinate" else "denominator"
    if label is None:
        if kind is None or not si:
            raise _told(where, f"expected the unit of the {side}, found none and no data set 164 that says SI")
        return kind, 1.0
    unit, factor = _LABELS.get(label.lower(), (None, 1.0))
    if unit is None:
        raise _told(where, f"expected a {side} in one of {', '.join(_LABELS)}, found {label!r}")
    if kind not in (None, unit):
        raise _told(where, f"the {side} is said to be in {label!r} and of a type in {kind}")
    return unit, factor


def frf_to_uff(frf: FrequencyResponses) -> bytes:
    """Return responses as a universal file: data set 164 (SI), then a data set 58 for each, double precision.

    Frequencies have six digits. A point whose name is a number is the node of it; others are entities by their names.

    Raises:
        ValueError: a unit or the name of a point that data set 58 cannot hold, or lines nearer than six digits tell.
    """
    points = tuple(dict.fromkeys(_split(name)[0] for name in (*frf.outputs, *frf.inputs)))
    wrong = [point for point in points if not _fits(point)]
    if wrong:
        raise ValueError(f"points of a universal file need names of up to {_MAX_ENTITY} characters, got {wrong[0]!r}")
    unknown = [unit for unit in (frf.output_unit, frf.input_unit) if unit not in _KIND_OF]
    if unknown:
        raise ValueError(f"universal files know {', '.join(_KIND_OF)}, got {unknown[0]!r}")
    rounded = np.array([float(f"{f:.5e}") for f in frf.frequency])
    if not np.all(np.diff(rounded) > 0.0):
        raise ValueError("lines are too near to each other for the six digits of a universal file")
    numbers = {point: int(point) for point in points if point.isdecimal()}
    unused = (number for number in itertools.count(1) if number not in set(numbers.values()))
    numbers |= {point: next(unused) for point in points if point not in numbers}
    parts = [_units_set()]
    for o, output in enumerate(frf.outputs):
        parts += [_uff_set(frf, (output, given), numbers, frf.h[:, o, i]) for i, given in enumerate(frf.inputs)]
    return "".join(parts).encode("latin-1")


def _fits(point: str) -> bool:
    """Return whether the name of a point is printable ASCII that data set 58 can hold and give back."""
    plain = point.isascii() and point.isprintable() and point == point.strip() and point != "NONE"
    return plain and len(point) <= _MAX_ENTITY and not (point.isdecimal() and str(int(point)) != point)


def _split(name: str) -> tuple[str, int]:
    """Return point and direction of a name, 0 for a scalar."""
    point, _, axis = name.rpartition(".")
    return (point, _AXES.index(axis) + 1) if point and axis in _AXES else (name, 0)


def _units_set() -> str:
    factors = f"{f'{1.0:25.17e}' * 3}\n{0.0:25.17e}".replace("e", "D")
    return f"{-1:6d}\n{164:6d}\n{1:10d}{'Meter (newton)':20}{2:10d}\n{factors}\n{-1:6d}\n"


def _uff_set(frf: FrequencyResponses, pair: tuple[str, str], numbers: dict[str, int], h: Complex) -> str:
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
