"""Input of ``identify``: a CSV table of tests with known defects, their features given or taken from recordings."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from models.identify.trials import Condition, Trial, a_star_above_noise
from models.machine.bearing import Bearing, kinematics
from models.machine.scene import PARTS, Part
from models.path.contour import part_radius
from monitor.commands.common import InputError, find_source
from monitor.config.load import Config
from monitor.config.source import ChannelSection
from monitor.health.signal.comb import line_spectrum
from monitor.health.signal.features import N_HARMONICS, fundamentals
from monitor.health.signal.lines import fault_lines
from monitor.health.signal.transform import Band, get_transform
from monitor.service.setup import open_configured
from streams.types.block import STANDARD_GRAVITY, Block, Rejected, to_si

_CONDITION = ("load_newton", "speed_hz")
_FEATURES = ("rms_g", "a_star_g")
_DEFECT = ("defect_deg", "defect_mm")
HEALTHY = "none"
"""The fault of a healthy machine."""
_OPTIONAL = ("h_d_um", "fault", "repetition", "rate_hz")
_MAX_MIB = 16
# Bins above the highest line that the floor under it needs.
_MARGIN_BINS = 210


@dataclass(frozen=True)
class HealthyRecording:
    """A recording of the healthy machine: load, N; file; sampling rate, Hz, where the table states it."""

    load: float
    path: Path
    rate: float | None


@dataclass(frozen=True)
class TrialFile:
    """The tests of a table.

    Attributes:
        trials: one a row.
        race_radius: by which widths of defects were divided, m; None where they are given as angles.
        recordings: number of tests whose features were taken from recordings.
        lines_not_found: number of recordings in which the lines of the damaged part are not detected.
        healthy: recordings of the healthy machine.
    """

    trials: tuple[Trial, ...]
    race_radius: float | None
    recordings: int
    lines_not_found: int = 0
    healthy: tuple[HealthyRecording, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What speaks against the tests, in sentences."""
        if not self.lines_not_found:
            return ()
        return (
            f"{self.lines_not_found} of {self.recordings} recordings do not show the lines of the damaged part; "
            "compare the sampling rate and speed_hz",
        )


@dataclass(frozen=True)
class Measured:
    """A test of a recording, and whether the lines of the damaged part are detected in it."""

    trial: Trial
    detected: bool


@dataclass(frozen=True)
class Measuring:
    """How the features of a recording are taken: machine, tracked channel, its bearing, and band of the RMS, Hz."""

    config: Config
    channel: ChannelSection
    bearing: Bearing
    band: Band | None


def read_trials(path: Path, measuring: Measuring, note: Callable[[int, int], None] | None = None) -> TrialFile:
    """Read a table of tests; the path of a recording is relative to it.

    ``note`` is called with the rows done and their number.

    Raises:
        InputError: naming file, line and column, what was expected and what was found.
    """
    rows = list(table_rows(path))
    header = rows[0][1].keys()
    _check_header(path, set(header), healthy=all(row.get("fault") == HEALTHY for _, row in rows))
    radius: float | None = None
    trials: list[Trial] = []
    missing = 0
    healthy: list[HealthyRecording] = []
    for number, (line, row) in enumerate(rows, 1):
        cells = Cells(path, line, row)
        condition, used = _condition(cells, measuring.bearing)
        radius = used if used is not None else radius
        if "recording" in row:
            measured = _recorded(cells, condition, measuring)
            trials.append(measured.trial)
            missing += not measured.detected
            if condition.healthy:
                healthy.append(HealthyRecording(condition.load, path.parent / row["recording"], _rate(cells)))
        else:
            rms, a_star = (_level(cells, name, condition) for name in _FEATURES)
            trials.append(Trial(condition, rms, a_star))
        if note is not None:
            note(number, len(rows))
    return TrialFile(tuple(trials), radius, len(rows) if "recording" in header else 0, missing, tuple(healthy))


def _level(cells: Cells, name: str, condition: Condition) -> float:
    """Return a feature, m/s2; A* of a healthy machine may be left out and is NaN then."""
    if condition.healthy and name == "a_star_g" and not cells.row[name]:
        return math.nan
    return cells.positive(name) * STANDARD_GRAVITY


def table_rows(path: Path) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Yield line number and cells of each row."""
    try:
        size = path.stat().st_size
        if size > _MAX_MIB * 2**20:
            raise InputError(f"{path}: has {size / 2**20:.0f} MiB, a table of tests at most {_MAX_MIB}")
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text in UTF-8; expected a CSV table") from None
    reader = csv.reader(io.StringIO(text))
    header = [name.strip() for name in next(reader, [])]
    if len(header) == 1 and (other := next((sign for sign in ";\t" if sign in header[0]), None)):
        raise InputError(f"{path}: line 1: cells are separated by {other!r}; expected commas, and points in numbers")
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise InputError(f"{path}: line 1: column {twice[0]} is given twice")
    found = False
    for cells in reader:
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(header):
            raise InputError(f"{path}: line {reader.line_num}: expected {len(header)} cells, found {len(cells)}")
        found = True
        yield reader.line_num, dict(zip(header, (cell.strip() for cell in cells), strict=True))
    if not found:
        raise InputError(f"{path}: no rows below the header")


def _check_header(path: Path, header: set[str], *, healthy: bool) -> None:
    """Raise an InputError that names a column; a table of ``healthy`` machines alone needs none of the defect."""
    found = ", ".join(sorted(header))
    for name in _CONDITION:
        if name not in header:
            raise InputError(f"{path}: column {name} is missing; found {found}")
    if len(header & set(_DEFECT)) != 1 and not (healthy and not header & set(_DEFECT)):
        raise InputError(f"{path}: expected one of the columns {' and '.join(_DEFECT)}; found {found}")
    features = header & set(_FEATURES)
    if ("recording" in header) == bool(features) or len(features) == 1:
        raise InputError(f"{path}: expected the columns {' and '.join(_FEATURES)}, or recording; found {found}")
    unknown = header - {*_CONDITION, *_DEFECT, *_FEATURES, *_OPTIONAL, "recording"}
    if unknown:
        allowed = ", ".join((*_CONDITION, *_DEFECT, "recording", *_FEATURES, *_OPTIONAL))
        raise InputError(f"{path}: column {min(unknown)} is not known; allowed are {allowed}")


@dataclass(frozen=True)
class Cells:
    """The cells of a row, checked as they are read."""

    path: Path
    line: int
    row: Mapping[str, str]

    def wrong(self, name: str, expected: str) -> InputError:
        """Return the error that a cell is not what was expected."""
        return InputError(f"{self.path}: line {self.line}: {name} is {self.row[name]!r}, expected {expected}")

    def positive(self, name: str, most: float = math.inf) -> float:
        """Return a positive number up to ``most``."""
        expected = "a positive number" if math.isinf(most) else f"a positive number up to {most:g}"
        try:
            value = float(self.row[name])
        except ValueError:
            raise self.wrong(name, expected) from None
        if not (0.0 < value <= most and math.isfinite(value)):
            raise self.wrong(name, expected)
        return value


def _condition(cells: Cells, bearing: Bearing) -> tuple[Condition, float | None]:
    """Return the condition of a row, and the radius by which a width was divided, m."""
    part = cells.row.get("fault") or "outer"
    if part == HEALTHY:
        for name in _DEFECT:
            if cells.row.get(name, "") not in ("", "0"):
                raise cells.wrong(name, f"nothing, or 0: fault is {HEALTHY}")
        load, speed = cells.positive("load_newton"), cells.positive("speed_hz")
        return Condition(load, speed, 0.0, bearing.element_diameter), None
    if part not in PARTS:
        raise cells.wrong("fault", f"one of {', '.join((*PARTS, HEALTHY))}")
    part = cast("Part", part)
    # Deeper than a rolling element reaches: the localised defect of Eq. 51.
    h_d = cells.positive("h_d_um") * 1e-6 if cells.row.get("h_d_um") else bearing.element_diameter
    load, speed = cells.positive("load_newton"), cells.positive("speed_hz")
    if "defect_deg" in cells.row:
        return Condition(load, speed, math.radians(cells.positive("defect_deg", 360.0)), h_d, part), None
    radius = part_radius(bearing, part)
    width = cells.positive("defect_mm", 2e3 * math.pi * radius) * 1e-3
    return Condition(load, speed, width / radius, h_d, part), radius


def _recorded(cells: Cells, condition: Condition, measuring: Measuring) -> Measured:
    """Return the features of the recording that a row names; of a healthy machine the RMS alone."""
    if not cells.row["recording"]:
        raise cells.wrong("recording", "a file")
    where = f"{cells.path}: line {cells.line}"
    path = cells.path.parent / cells.row["recording"]
    if not path.exists():
        raise InputError(f"{where}: recording {cells.row['recording']!r}: no such file ({path})")
    return measure(path, condition, measuring, where=where, rate=_rate(cells))


def _rate(cells: Cells) -> float | None:
    return cells.positive("rate_hz") if cells.row.get("rate_hz") else None


def measure(
    path: Path, condition: Condition, measuring: Measuring, *, where: str = "", rate: float | None = None
) -> Measured:
    """Return the features of a recording.

    Args:
        path: of the recording.
        condition: at which it was made.
        measuring: how its features are taken.
        where: begins messages, "" for the path alone.
        rate: sampling rate, Hz, in place of that of the configuration.

    Raises:
        InputError: the band is not known, or the recording cannot be used.
    """
    if measuring.band is None:
        raise InputError(
            f"{where or path}: recordings need the band of the RMS: give rms_band_hz of channel "
            f"{measuring.channel.name!r}, or --rms-band-hz"
        )
    where = f"{where}: {path}" if where else str(path)
    found = [
        _features(samples, sampled, condition, measuring, where)
        for samples, sampled in recorded_samples(path, measuring, where=where, rate=rate)
    ]
    levels = [(rms, a_star) for rms, a_star, _ in found]
    trial = Trial(condition, *np.sqrt(np.mean(np.square(levels), axis=0)).tolist())
    return Measured(trial, all(detected for _, _, detected in found))


def recorded_samples(
    path: Path, measuring: Measuring, *, where: str, rate: float | None = None
) -> Iterator[tuple[NDArray[np.float64], float]]:
    """Yield the samples of the channel, m/s2, and their rate, Hz, of each block of a recording, at least one.

    Raises:
        InputError: beginning with ``where``, if there is no block, or one is of no use.
    """
    changes: dict[str, object] = {"block_s": "file"}
    if rate is not None:
        changes["rate_hz"] = rate
    section = find_source(measuring.config, measuring.channel.source).model_copy(update=changes)
    found = False
    for block in open_configured(measuring.config, section, str(path)):
        found = True
        yield _samples(block, measuring, where)
    if not found:
        raise InputError(f"{where}: holds no block")


def _samples(block: Block | Rejected, measuring: Measuring, where: str) -> tuple[NDArray[np.float64], float]:
    if isinstance(block, Rejected):
        raise InputError(f"{where}: {block.reason} ({block.status})")
    row = block.channels.index(measuring.channel.name)
    channel, unit = measuring.channel, block.units[row]
    scale = 1.0 if channel.scale is None else channel.scale
    samples, unit = to_si(block.samples[row], unit, scale, channel.sensitivity_mv_per_g)
    if unit != "m/s2":
        raise InputError(f"{where}: channel {channel.name!r} has the unit {unit}; absolute levels are needed")
    if not np.all(np.isfinite(samples)):
        raise InputError(f"{where}: holds samples that are no finite numbers")
    return np.asarray(samples, dtype=np.float64), block.rate


def _features(
    samples: NDArray[np.float64], rate: float, condition: Condition, measuring: Measuring, where: str
) -> tuple[float, float, bool]:
    """Return RMS and A* of a block, m/s2, and whether the lines are detected, which a healthy machine need not have.

    A* is NaN where its power is not above that of the noise, or nothing is damaged.
    """
    band = measuring.band or (0.0, 0.5 * rate)
    fault = condition.part
    line = fundamentals(kinematics(measuring.bearing, condition.speed))[fault]
    limit = (N_HARMONICS + 1) * line + _MARGIN_BINS * rate / samples.size
    try:
        spectra = get_transform(samples.size, rate, (), precision="float64", rms_band=band, raw_limit=limit)(samples)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if condition.healthy:
        return spectra.band_rms or 0.0, math.nan, True
    spectrum = line_spectrum(spectra.raw.amplitude, spectra.raw.resolution, speed=condition.speed)
    lines = fault_lines(spectrum, line, n_harmonics=N_HARMONICS)
    if not lines.resolved.all():
        raise InputError(
            f"{where}: {samples.size} samples at {rate:g} Hz do not resolve {N_HARMONICS} lines of {line:.4g} Hz"
        )
    low, high = band
    places = lines.fundamental * np.arange(1, N_HARMONICS + 1)
    inside = (places >= low) & (places <= high)
    amplitude = a_star_above_noise(lines.amplitude * inside, lines.floor * inside)
    return spectra.band_rms or 0.0, amplitude, lines.detected


def tracked_channel(config: Config, name: str | None) -> ChannelSection:
    """Return the channel of a name, else the one that is tracked, else the only one.

    Raises:
        InputError: there is none of that name, or several.
    """
    channels = {channel.name: channel for channel in config.channel}
    if name is not None:
        if name not in channels:
            raise InputError(f"--channel {name}: expected one of {', '.join(channels)}")
        return channels[name]
    chosen = [channel for channel in config.channel if channel.track] or list(config.channel)
    if len(chosen) > 1:
        raise InputError(f"--channel is missing: {', '.join(channel.name for channel in chosen)} are to choose from")
    return chosen[0]


def with_race_radius(bearing: Bearing, radius: float | None) -> Bearing:
    """Return the bearing with another radius of its outer race, m, for widths of defects alone; None: as it is."""
    return bearing if radius is None else replace(bearing, outer_race_radius=radius)
