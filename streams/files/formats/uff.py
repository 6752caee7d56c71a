"""Universal files through pyuff: data set 58, functions at nodes, text and binary."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from streams.files.judge import Start, StatedRow, judged
from streams.files.keys import TIME_UNITS
from streams.files.parse.worker import from_disk, library, memory_file, readable
from streams.files.statements import Facts, StatedNumber, known_unit, plain_unit
from streams.files.successive import recordings_of
from streams.types.large import Data, FileBytes
from streams.types.samples import ReaderError, Samples
from streams.types.stamps import read_stamp

_TIME_RESPONSES = (0, 1)
_REAL = (2, 4)
_UNITS_SI = {11: "m/s", 12: "m/s2"}
"""Of velocity and acceleration in a file in SI."""
_STEP_DIGITS = 1e-5
"""Relative uncertainty of a step, of which the header holds six digits."""
_DIRECTIONS = {1: "+X", -1: "-X", 2: "+Y", -2: "-Y", 3: "+Z", -3: "-Z"}
Function = dict[str, Any]
_TAG = b"    -1"


@from_disk
def read_uff(
    data: Data, name: str, patterns: Sequence[str] = (), zone: str = "UTC", disregard: Sequence[str] = ()
) -> Samples:
    """Read the time responses of a universal file, a row for each.

    The rate is that of the abscissa (which must be even), in the unit of its label; the unit that of the ordinate's
    label, else m/s2 for accelerations where data set 164 says SI; the time of the first sample is ID line 3 plus the
    first value of the abscissa.

    Args:
        patterns: of ID line 1, or of ``NODE:DIRECTION`` such as ``12:+Z``; none: all time responses.
        zone: IANA name of the zone of the stamp.
        disregard: patterns of the keys that are not believed.

    Raises:
        ReaderError: ``empty``; ``incomplete`` where a data set is not closed or too short; ``wrong_shape`` where
            nothing matches or lengths differ; ``wrong_rate`` for uneven abscissas and different rates; ``unreadable``.
    """
    with universal_file(data, name, torn=True) as file:
        functions = _functions(file, name, patterns)
        si = is_si(file)
    samples = _described(functions, si, name, zone, disregard) if functions else None
    if _count_tags(data) % 2 and not (samples and samples.torn):
        raise ReaderError("incomplete", f"{name}: breaks off within a data set, after {len(data)} bytes")
    if samples is None:
        raise ReaderError(
            "wrong_shape", f"{name}: no time response of data set 58 matches {', '.join(patterns) or '*'}"
        )
    return samples


@contextmanager
def universal_file(data: Data, name: str, *, torn: bool = False) -> Iterator[Any]:
    """Give the bytes as a ``pyuff.UFF``; whatever goes wrong with it inside the context is a ReaderError.

    ``torn``: also with a last data set that is not closed.

    Raises:
        ReaderError: ``empty``, ``incomplete`` where a data set is not closed, or ``unreadable``.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    tags = _count_tags(data)
    if not tags:
        raise ReaderError("unreadable", f"{name}: not a universal file")
    if tags % 2 and not torn:
        raise ReaderError("incomplete", f"{name}: breaks off within a data set, after {len(data)} bytes")
    if tags % 2:
        # What is there of the last data set shows whether it is a recording of its own.
        data = data[: data[:].rfind(b"\n") + 1] + f"{_TAG.decode():80}\n".encode()
    pyuff = library("pyuff", "uff", f"{name}: needs")
    with readable(name, "a readable universal file"):
        if isinstance(data, FileBytes):
            yield pyuff.UFF(data.path)
            return
        with memory_file(data) as path:
            yield pyuff.UFF(path)


def _functions(file: Any, name: str, patterns: Sequence[str]) -> list[Function]:
    """Read the wanted functions; pyuff does not compare lengths with the header."""
    found: list[Function] = []
    for index, kind in enumerate(file.get_set_types()):
        if int(kind) != 58:
            continue
        function = file.read_sets(index)
        titles = (str(function.get("id1", "")).strip(), _node(function))
        if int(function["func_type"]) not in _TIME_RESPONSES:
            continue
        if patterns and not any(fnmatchcase(title, pattern) for title in titles for pattern in patterns):
            continue
        where = f"{name}: {titles[0][:40]}"
        if int(function["ord_data_type"]) not in _REAL:
            kind = function["ord_data_type"]
            raise ReaderError("unreadable", f"{where}: expected real numbers, found data type {kind}")
        if int(function["abscissa_spacing"]) != 1:
            raise ReaderError("wrong_rate", f"{where}: the samples are not evenly spaced")
        found.append(function)
    return found


def _count_tags(data: Data) -> int:
    """Count the lines that open and close data sets."""
    held = data.mapped() if isinstance(data, FileBytes) else data
    count, place = 0, held.find(_TAG)
    while place >= 0:
        alone = place == 0 or held[place - 1] in b"\r\n"
        rest = held[place + len(_TAG) : place + 82].partition(b"\n")[0]
        count += alone and not rest.strip()
        place = held.find(_TAG, place + 1)
    return count


def _node(function: Function) -> str:
    direction = int(function.get("rsp_dir") or 0)
    return f"{int(function.get('rsp_node') or 0)}:{_DIRECTIONS.get(direction, direction)}"


def is_si(file: Any) -> bool:
    """Return whether the first data set 164 of a ``pyuff.UFF`` says SI; False without one."""
    for index, kind in enumerate(file.get_set_types()):
        if int(kind) == 164:
            return int(file.read_sets(index).get("units_code", 0)) == 1
    return False


def _described(functions: list[Function], si: bool, name: str, zone: str, disregard: Sequence[str]) -> Samples:
    rows, titles, nodes = [], [], []
    facts: list[Facts] = []
    rates: list[StatedNumber] = []
    short: dict[int, str] = {}
    for function in functions:
        promised, values = int(function["num_pts"]), np.asarray(function["data"], dtype=np.float64)
        title = str(function.get("id1", "")).strip()
        if len(values) < promised:
            short[len(rows)] = f"{name}: {title[:40]}: {promised} samples promised, {len(values)} there"
            values = values[:0]
        if len(values) > promised:
            raise ReaderError("unreadable", f"{name}: {title[:40]}: {promised} samples promised, {len(values)} there")
        if not promised:
            raise ReaderError("empty", f"{name}: {title[:40]}: holds no samples")
        rows.append(values)
        size = _size_of_abscissa(function, f"{name}: {title[:40]}")
        rates.append(_rate(float(function["abscissa_inc"]), size, f"{name}: {title[:40]}"))
        unit = known_unit(function.get("ordinate_axis_units_lab"))
        unit = unit or (_UNITS_SI.get(int(function.get("ordinate_spec_data_type") or 0)) if si else None)
        begins = float(function.get("abscissa_min") or 0.0) * size
        facts.append({"unit": unit, "id3": str(function.get("id3", "")), "begins": begins})
        titles.append(title)
        nodes.append(_node(function))

    def joined(some: Sequence[StatedRow]) -> Samples:
        return judged(some, name, "functions", zone, called=lambda row: row.name, dated=_dated, disregard=disregard)

    times = [nodes[:place].count(node) + 1 for place, node in enumerate(nodes)]
    of_node = [len({title for title, other in zip(titles, nodes, strict=True) if other == node}) for node in nodes]
    repeated = [
        StatedRow(values, f"{time}/{title if alike == 1 and title not in ('', 'NONE') else node}", node, stated, rate)
        for values, time, title, alike, node, stated, rate in zip(
            rows, times, titles, of_node, nodes, facts, rates, strict=True
        )
    ]
    torn = {str(times[place]): reason for place, reason in short.items()}
    several = recordings_of(repeated, name, zone, joined, parted=_parted, dated=_dated, kind="set", torn=torn)
    if several is not None:
        return several
    if torn:
        raise ReaderError("incomplete", next(iter(torn.values())))
    names = [title if title and title != "NONE" and titles.count(title) == 1 else node
             for title, node in zip(titles, nodes, strict=True)]  # fmt: skip
    if (again := next((title for title in names if names.count(title) > 1), None)) is not None:
        raise ReaderError(
            "wrong_shape",
            f"{name}: {names.count(again)} functions are called {again}: sensors recorded at the same time need titles "
            "of their own in ID line 1, recordings one after another a start of their own in ID line 3",
        )
    return joined(list(map(StatedRow, rows, names, nodes, facts, rates)))


def _parted(row: StatedRow) -> tuple[str, str]:
    time, _, title = row.name.partition("/")
    return time, title


def _size_of_abscissa(function: Function, where: str) -> float:
    """Return the unit of the abscissa in s, by its label; ReaderError ``wrong_rate`` for another quantity than time."""
    label = plain_unit(str(function.get("abscissa_axis_units_lab") or ""))
    size = 1.0 if label in ("", "none") else TIME_UNITS.get(label)
    if size is None:
        raise ReaderError("wrong_rate", f"{where}: expected an abscissa of times, its label is {label[:20]!r}")
    return size


def _rate(step: float, size: float, where: str) -> StatedNumber:
    """Return what the step of an abscissa states; the header holds six digits of it."""
    seconds = step * size
    if not 1e-12 < seconds < 1e12:
        raise ReaderError("wrong_rate", f"{where}: the step between samples is {seconds:g} s")
    return StatedNumber("the step of the abscissa", f"{step:g}", (1.0 / seconds,), _STEP_DIGITS / seconds)


def _dated(facts: Facts, zone: str) -> list[Start]:
    """Return ID line 3, moved by the first value of the abscissa, which is below 0 where a trigger was waited for."""
    stamp, begins = read_stamp(facts["id3"], zone), facts["begins"]
    if stamp is None or stamp.open or not isinstance(begins, float):
        return []
    return [Start("ID line 3 and the abscissa", stamp.later(begins))]
