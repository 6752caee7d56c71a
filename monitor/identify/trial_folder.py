"""Input of ``identify``: a folder of recordings whose names state the tests.

The tests are stated in one of three ways: by a table ``tests.csv`` in the folder, which
:mod:`monitor.identify.trial_files` reads; by a declared pattern of the names; or by the words of the published
stationary tests (A. Gabrielli and others, Mendeley Data, doi 10.17632/8wdzm5gwng: 3 defects on 3 bearings each, 1000
and 2000 N, 20, 30 and 40 Hz). The names of those 54 recordings could not be established, so the last way takes D1 to
D3, ``1000N`` and ``20Hz`` wherever they stand in a path. It was tested on recordings written to look alike, not on the
published ones.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from models.identify.trials import Condition, Trial
from models.machine.bearing import Bearing
from models.machine.scene import PARTS, Part
from models.path.contour import part_radius
from models.published.thesis import EXTENTS_DEG
from monitor.commands.common import InputError
from monitor.identify.trial_files import Measuring, TrialFile, measure, read_trials
from streams.files.datasets import FerraraName, ferrara_name
from streams.files.recognise import FORMATS
from streams.types.listing import unpacked_name, walk_files

INDEX = "tests.csv"
_NUMBER = r"\d+(?:[.,]\d+)?"
_FIELDS = {
    "defect": r"[Dd][123]",
    "specimen": r"[A-Za-z0-9]+",
    "repetition": r"[A-Za-z0-9]+",
    "fault": "|".join(PARTS),
    **dict.fromkeys(("load_newton", "load_kn", "speed_hz", "speed_rpm", "defect_deg", "defect_mm"), _NUMBER),
}
"""Fields of a pattern of names, and what each matches."""
_NEEDED = (("load_newton", "load_kn"), ("speed_hz", "speed_rpm"), ("defect", "defect_deg", "defect_mm"))
_ENDINGS = tuple(ending for endings in FORMATS.values() for ending in endings)
_MAX_RECORDINGS = 5000


@dataclass(frozen=True)
class Stated:
    """What the name of a recording states: its test, and its sampling rate in Hz where the name decides it.

    ``radius`` is that by which a width of the defect was divided, m; None where its extent is known.
    """

    condition: Condition
    rate: float | None
    radius: float | None = None


def read_tests(
    path: Path, measuring: Measuring, names: str | None = None, note: Callable[[int, int], None] | None = None
) -> TrialFile:
    """Read the tests of a table, or of a folder of recordings.

    Args:
        path: a CSV table, or a folder.
        measuring: how the features of recordings are taken.
        names: pattern of the names in a folder, such as ``{defect}{specimen}_{load_newton}N_{speed_hz}Hz.txt``.
        note: called with the tests done and their number.

    Raises:
        InputError: naming file or pattern, what was expected and what was found.
    """
    if not path.is_dir():
        if names is not None:
            raise InputError(f"--names is for a folder of recordings; {path} is none")
        return read_trials(path, measuring, note)
    if (path / INDEX).exists():
        if names is not None:
            raise InputError(f"{path}: --names and {INDEX} both say what the recordings are; leave one out")
        return read_trials(path / INDEX, measuring, note)
    stated = _from_pattern(path, names, measuring.bearing) if names is not None else _published(path, measuring.bearing)
    trials: list[Trial] = []
    missing = 0
    for number, (file, one) in enumerate(stated.items(), 1):
        measured = measure(path / file, one.condition, measuring, rate=one.rate)
        trials.append(measured.trial)
        missing += not measured.detected
        if note is not None:
            note(number, len(stated))
    radii = {one.radius for one in stated.values() if one.radius is not None}
    return TrialFile(tuple(trials), max(radii, default=None), len(trials), missing)


def recordings_in(folder: Path) -> list[str]:
    """Return the paths of the recordings below a folder, in order; those of readme files are not among them.

    Raises:
        InputError: the folder cannot be read, holds none, or too many.
    """
    try:
        files = sorted(path for path, _ in walk_files(str(folder)) if _is_recording(path))
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror or error}") from None
    if not files:
        raise InputError(f"{folder}: holds no recordings; expected files that end in {', '.join(_ENDINGS)}")
    if len(files) > _MAX_RECORDINGS:
        raise InputError(f"{folder}: holds {len(files)} recordings; at most {_MAX_RECORDINGS} are read")
    return files


def _is_recording(path: str) -> bool:
    name = unpacked_name(path.rpartition("/")[2]).lower()
    return name.endswith(_ENDINGS) and "readme" not in name and not name.startswith(".")


def _published(folder: Path, bearing: Bearing) -> dict[str, Stated]:
    """Return what the names of published stationary tests state, by path.

    The extents are the means of Table 2 over the three bearings of a defect, as the thesis compares them; the bearings
    are its repetitions.

    Raises:
        InputError: naming the recordings whose names do not state defect, load and speed.
    """
    found = {file: ferrara_name(f"{folder.name}/{file}") for file in recordings_in(folder)}
    unclear = {file: missing for file, name in found.items() if (missing := _missing(name))}
    if unclear:
        file, missing = next(iter(unclear.items()))
        raise InputError(
            f"{folder}: the names of {len(unclear)} of {len(found)} recordings do not state a test ({file!r} has no "
            f"{', no '.join(missing)}); give --names PATTERN with {', '.join(f'{{{name}}}' for name in _FIELDS)}, or a "
            f"table {INDEX} in the folder"
        )
    return {file: _of_published(name, bearing) for file, name in found.items()}


def _missing(name: FerraraName) -> list[str]:
    facts = (("defect (D1, D2, D3)", name.defect), ("load (1000N)", name.load), ("speed (20Hz)", name.speed))
    return [words for words, value in facts if value is None]


def _of_published(name: FerraraName, bearing: Bearing) -> Stated:
    assert name.defect is not None
    assert name.load is not None
    assert name.speed is not None
    extent = math.radians(EXTENTS_DEG[name.defect])
    return Stated(Condition(name.load, name.speed, extent, bearing.element_diameter), name.rate)


def _from_pattern(folder: Path, names: str, bearing: Bearing) -> dict[str, Stated]:
    """Return what the names of recordings state by a pattern, by path; others are refused.

    Raises:
        InputError: of the pattern, or naming the first recording that it does not match.
    """
    pattern = compile_names(names)
    found: dict[str, Stated] = {}
    for file in recordings_in(folder):
        match = pattern.fullmatch(file)
        if match is None:
            raise InputError(f"{folder}: {file!r} does not match --names {names!r}")
        found[file] = _of_fields(match.groupdict(), bearing, f"{folder}: {file!r}")
    return found


def compile_names(names: str) -> re.Pattern[str]:
    """Return the regular expression of a pattern of names.

    ``{field}`` is one of the fields, ``*`` any text within a name; folders above those of the pattern do not matter.

    Raises:
        InputError: a field is not known, is given twice or is missing.
    """
    pieces = re.split(r"(\{[^{}]*\}|\*)", names)
    fields = [piece[1:-1] for piece in pieces if piece.startswith("{")]
    for field in fields:
        if field not in _FIELDS:
            raise InputError(f"--names {names!r}: {{{field}}} is not known; expected {', '.join(_FIELDS)}")
        if fields.count(field) > 1:
            raise InputError(f"--names {names!r}: {{{field}}} is given twice")
    for group in _NEEDED:
        if len(set(group) & set(fields)) != 1:
            raise InputError(f"--names {names!r}: expected one of {', '.join(f'{{{name}}}' for name in group)}")
    return re.compile("(?:.*/)?" + "".join(map(_piece, pieces)))


def _piece(piece: str) -> str:
    if piece == "*":
        return "[^/]*"
    if not piece.startswith("{"):
        return re.escape(piece)
    return f"(?P<{piece[1:-1]}>{_FIELDS[piece[1:-1]]})"


def _of_fields(fields: Mapping[str, str], bearing: Bearing, where: str) -> Stated:
    """Return what the fields of a name state."""
    numbers = {name: float(text.replace(",", ".")) for name, text in fields.items() if _FIELDS[name] == _NUMBER}
    if any(value <= 0.0 for value in numbers.values()):
        raise InputError(f"{where}: expected positive numbers, found {', '.join(fields.values())}")
    load = numbers.get("load_newton", 1e3 * numbers.get("load_kn", 0.0))
    speed = numbers.get("speed_hz", numbers.get("speed_rpm", 0.0) / 60.0)
    part = cast("Part", fields.get("fault", "outer"))
    radius, rate = None, None
    if "defect" in fields:
        named = ferrara_name(f"{fields['defect'].upper()}{fields.get('specimen', '')}")
        extent, rate = math.radians(EXTENTS_DEG[fields["defect"].upper()]), named.rate
    elif "defect_deg" in numbers:
        extent = math.radians(numbers["defect_deg"])
    else:
        radius = part_radius(bearing, part)
        extent = 1e-3 * numbers["defect_mm"] / radius
    if not extent <= 2.0 * math.pi:
        raise InputError(f"{where}: the defect is wider than the whole circumference")
    return Stated(Condition(load, speed, extent, bearing.element_diameter, part), rate, radius)
