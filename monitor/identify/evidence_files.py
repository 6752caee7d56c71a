"""Evidence of ``identify`` beside tests at known defects: peaks, accelerances, recordings of a run-up, priors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

import click
import numpy as np

from models.identify.evidence import DIRECTIONS, Direction, Evidence, Peak, Prior, geometry_priors
from models.identify.resonances import Density, Resonance, find_resonances, welch
from models.machine.bearing import CatalogueEntry
from models.machine.rig import Rig
from monitor.commands import option
from monitor.commands.common import InputError
from monitor.identify.trial_files import Cells, HealthyRecording, Measuring, recorded_samples, table_rows

F = TypeVar("F", bound=Callable[..., Any])

GEOMETRY = "geometry"
_UNKNOWN = "unknown"
# Resonances are sought between here, Hz, and this share of the rate.
_LOWEST, _HIGHEST = 50.0, 0.45
_PEAK_COLUMNS = ("load_newton", "frequency_hz", "frequency_sd_hz")
_PEAK_PAIRS = (("damping", "damping_sd"), ("accelerance_m_s2_per_newton", "accelerance_sd_m_s2_per_newton"))
_RESPONSE_COLUMNS = ("load_newton", "frequency_hz", "accelerance_m_s2_per_newton")
_FEWEST_ROWS = 32


class _PriorValue(click.ParamType):
    """NAME:VALUE:SD, NAME:rig:SD or geometry."""

    name = "geometry|NAME:VALUE:SD|NAME:rig:SD"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return "geometry", or (name, value or None, sd)."""
        if isinstance(value, tuple) or value == GEOMETRY:
            return value
        parts = str(value).split(":")
        try:
            name, given, deviation = parts
            return name, None if given == "rig" else float(given), float(deviation)
        except ValueError:
            self.fail(f"{value!r} is not {self.name}, such as m_o:5.8:0.1 (SI, relative SD)", param, ctx)


class _Shaft(click.ParamType):
    """DIAMETER:LENGTH in mm."""

    name = "DIAMETER:LENGTH"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return (diameter, length), m."""
        if isinstance(value, tuple):
            return value
        try:
            diameter, length = (1e-3 * float(part) for part in str(value).split(":"))
        except ValueError:
            self.fail(f"{value!r} is not DIAMETER:LENGTH in mm, such as 30:250", param, ctx)
        if not (0.0 < diameter < math.inf and 0.0 < length < math.inf):
            self.fail(f"{value!r}: expected positive lengths in mm", param, ctx)
        return diameter, length


def options(function: F) -> F:
    """Add the options of the evidence."""
    directions = click.Choice([*DIRECTIONS, _UNKNOWN])
    for add in (
        click.option("--direction", type=directions, default="along", help="Of the sensor of recordings to the load."),
        click.option("--load-newton", type=option.POSITIVE, help="During the run-up. Default: that of [operating]."),
        click.option("--shaft-mm", type=_Shaft(), help="Shaft that belongs to this bearing, for --prior geometry."),
        click.option("--prior", "priors", type=_PriorValue(), multiple=True, help="What is known; may be repeated."),
        click.option("--run-up", type=option.FILE, multiple=True, help="Recording of a run-up; may be repeated."),
        click.option("--frf", type=option.FILE, multiple=True, help="CSV of a measured accelerance; may be repeated."),
        click.option("--peaks", type=option.FILE, multiple=True, help="CSV of resonances; may be repeated."),
    ):
        function = add(function)
    return function


@dataclass(frozen=True)
class EvidenceSubject:
    """What evidence is read for: machine and channel, its bearing, and the configured rig."""

    measuring: Measuring
    entry: CatalogueEntry
    rig: Rig


def read_evidence(
    source: EvidenceSubject,
    given: Mapping[str, Any],
    healthy: Sequence[HealthyRecording],
    names: Callable[[str], str],
) -> Evidence:
    """Return the evidence of the command's options, and the resonances of healthy recordings.

    ``names`` turns the name of a parameter or its key in the configuration into the former.

    Raises:
        InputError: naming option, file, line or column.
    """
    peaks = [peak for path in given["peaks"] for peak in read_peaks(path)]
    peaks += [peak for path in given["frf"] for peak in read_accelerance(path)]
    direction: Direction = "" if given["direction"] == _UNKNOWN else given["direction"]
    if given["run_up"]:
        load = given["load_newton"] or source.measuring.config.operating.load_newton
        if not load:
            raise InputError("--run-up needs the load: --load-newton, or load_newton in [operating]")
        recordings = [HealthyRecording(load, path, None) for path in given["run_up"]]
        peaks += _recorded_peaks("--run-up", recordings, source.measuring, direction)
    for load in sorted({each.load for each in healthy}):
        recordings = [each for each in healthy if each.load == load]
        peaks += _recorded_peaks("healthy recordings", recordings, source.measuring, direction)
    return Evidence(tuple(peaks), tuple(_priors(source, given, names)))


def _priors(source: EvidenceSubject, given: Mapping[str, Any], names: Callable[[str], str]) -> Iterable[Prior]:
    if given["shaft_mm"] is not None and GEOMETRY not in given["priors"]:
        raise InputError("--shaft-mm belongs to --prior geometry")
    for each in given["priors"]:
        if each == GEOMETRY:
            yield from geometry_priors(source.entry, given["shaft_mm"])
            continue
        name, value, deviation = each
        parameter = names(name)
        if value is None:
            value = getattr(source.rig, parameter, None)
            if value is None:
                raise InputError(f"--prior {name}:rig: {name!r} is no parameter of [rig]")
            yield Prior(parameter, value, deviation, "[rig]")
        else:
            yield Prior(parameter, value, deviation, "given")


def read_peaks(path: Path) -> list[Peak]:
    """Read a table of resonances.

    Columns: load_newton, frequency_hz, frequency_sd_hz; direction (along, across or nothing); damping with damping_sd,
    accelerance_m_s2_per_newton (that of casing over force on it, at the peak) with its _sd_; cells may be empty.

    Raises:
        InputError: naming file, line and column, what was expected and what was found.
    """
    rows = list(table_rows(path))
    _check_columns(
        path, rows[0][1].keys(), _PEAK_COLUMNS, ("direction", *(name for pair in _PEAK_PAIRS for name in pair))
    )
    peaks: list[Peak] = []
    for line, row in rows:
        cells = Cells(path, line, row)
        load, frequency, deviation = (cells.positive(name) for name in _PEAK_COLUMNS)
        (damping, damping_sd), (level, level_sd) = (_pair(cells, *names) for names in _PEAK_PAIRS)
        peaks.append(Peak(load, _direction(cells), frequency, deviation, damping, damping_sd, level, level_sd))
    return peaks


def _pair(cells: Cells, name: str, deviation: str) -> tuple[float | None, float | None]:
    """Return a value and its uncertainty, both or neither."""
    given = [bool(cells.row.get(key)) for key in (name, deviation)]
    if not any(given):
        return None, None
    if not all(given):
        missing = deviation if given[0] else name
        raise InputError(
            f"{cells.path}: line {cells.line}: {missing} is missing beside {name if given[0] else deviation}"
        )
    return cells.positive(name), cells.positive(deviation)


def _direction(cells: Cells) -> Direction:
    found = cells.row.get("direction", "")
    if found not in (*DIRECTIONS, ""):
        raise cells.wrong("direction", f"{', '.join(DIRECTIONS)}, or nothing where it is not known")
    return cast("Direction", found)


def read_accelerance(path: Path) -> list[Peak]:
    """Read a measured accelerance of the casing (absolute value), and return its resonances.

    Columns: load_newton, frequency_hz, accelerance_m_s2_per_newton; direction. Several loads and directions may follow
    each other.

    Raises:
        InputError: naming file, line and column, or a part of the table in which there is no resonance.
    """
    rows = list(table_rows(path))
    _check_columns(path, rows[0][1].keys(), _RESPONSE_COLUMNS, ("direction",))
    parts: dict[tuple[float, Direction], list[tuple[float, float]]] = {}
    for line, row in rows:
        cells = Cells(path, line, row)
        load, frequency, level = (cells.positive(name) for name in _RESPONSE_COLUMNS)
        part = parts.setdefault((load, _direction(cells)), [])
        if part and frequency <= part[-1][0]:
            raise cells.wrong(
                "frequency_hz", f"more than {part[-1][0]:g}: frequencies of one load and direction ascend"
            )
        part.append((frequency, level))
    peaks: list[Peak] = []
    for (load, direction), values in parts.items():
        where = f"{path}: {load:g} N" + (f" {direction} it" if direction else "")
        if len(values) < _FEWEST_ROWS:
            raise InputError(f"{where}: {len(values)} rows; expected {_FEWEST_ROWS} at least")
        table = np.array(values)
        found = find_resonances(Density(table[:, 0], np.square(table[:, 1]), _scatter(table[:, 1]), windowed=False))
        if not found:
            raise InputError(f"{where}: no resonance stands out")
        peaks += [_peak(resonance, load, direction, absolute=True) for resonance in found]
    return peaks


def _scatter(levels: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    """Return the standard deviation of the logarithm of a power, from the second differences."""
    bends = np.diff(2.0 * np.log(levels), 2)
    return max(1e-3, float(np.median(np.abs(bends))) / 0.6745 / math.sqrt(6.0))


def _recorded_peaks(
    what: str, recordings: Sequence[HealthyRecording], measuring: Measuring, direction: Direction
) -> list[Peak]:
    """Return the resonances of recordings under one load.

    Raises:
        InputError: if none stands out.
    """
    signals, rates = list[np.ndarray[tuple[int], np.dtype[np.float64]]](), set[float]()
    load = recordings[0].load
    for each in recordings:
        if not each.path.exists():
            raise InputError(f"{what}: no such file ({each.path})")
        for samples, rate in recorded_samples(each.path, measuring, where=f"{what}: {each.path}", rate=each.rate):
            signals.append(samples)
            rates.add(rate)
    if len(rates) > 1:
        raise InputError(f"{what}: sampling rates differ: {', '.join(f'{rate:g}' for rate in sorted(rates))} Hz")
    rate = rates.pop()
    try:
        density = welch(signals, rate)
    except ValueError as error:
        raise InputError(f"{what}: {error}") from None
    found = find_resonances(density, (_LOWEST, _HIGHEST * rate))
    if not found:
        raise InputError(f"{what}: no resonance stands out under {load:g} N")
    return [_peak(resonance, load, direction, absolute=False) for resonance in found]


def _peak(found: Resonance, load: float, direction: Direction, *, absolute: bool) -> Peak:
    level = found.level if absolute else None
    # The level at a resonance is as uncertain as its damping ratio.
    level_sd = found.level * found.damping_sd / found.damping if absolute else None
    return Peak(
        load,
        direction,
        found.frequency,
        found.frequency_sd,
        found.damping,
        found.damping_sd,
        level,
        level_sd,
        extracted=True,
    )


def _check_columns(path: Path, header: Iterable[str], needed: Sequence[str], optional: Sequence[str]) -> None:
    found = set(header)
    for name in needed:
        if name not in found:
            raise InputError(f"{path}: column {name} is missing; found {', '.join(sorted(found))}")
    unknown = found - {*needed, *optional}
    if unknown:
        allowed = ", ".join((*needed, *optional))
        raise InputError(f"{path}: column {min(unknown)} is not known; allowed are {allowed}")
