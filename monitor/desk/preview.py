"""What a drafted configuration makes of the first file: levels, fault lines, a second of signal and its spectrum."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.desk.answers import bearing_of, channel_names
from monitor.desk.desk import ImportDesk
from monitor.desk.questions import unit_of
from monitor.desk.text import Draft, level_in_g, scale_of
from monitor.words.parts import PARTS
from streams.files.survey import SurveyedRow
from streams.types.block import VELOCITY

N_LINES = 5
"""Lines of each part that are shown."""
_MAX_SPECTRUM_SAMPLES = 1 << 18
_SECOND = 1.0


@dataclass(frozen=True)
class Curve:
    """Lowest and highest value in equal steps of an axis that begins at 0.

    Attributes:
        step: s or Hz.
        low, high: shape (n,), in the unit of the channel.
    """

    step: float
    low: NDArray[np.float64]
    high: NDArray[np.float64]


@dataclass(frozen=True)
class ChannelPreview:
    """What a channel shows in the first file.

    Attributes:
        bearing: its name for people.
        unit: "g", "mm/s" of a velocity, or "" where the unit does not give the level, in stored numbers then.
        rms: without the mean, ``peak`` the largest magnitude.
        lines: the first lines of each part of the bearing, Hz, empty where the speed is not known.
        signal: the first second, ``spectrum`` of the amplitude over all of the file, at most 2^18 samples.
    """

    name: str
    bearing: str
    unit: str
    rms: float
    peak: float
    lines: dict[str, tuple[float, ...]]
    signal: Curve
    spectrum: Curve


def channels_of(desk: ImportDesk, points: int = 400, limit: int | None = None) -> tuple[ChannelPreview, ...]:
    """Return what each channel, or the first ones, shows, curves in at most so many points; the rate must be known."""
    return tuple(islice(_channels(desk, desk.draft(), points), limit))


def _channels(desk: ImportDesk, draft: Draft, points: int) -> Iterator[ChannelPreview]:
    seen, rows = desk.seen, desk.seen.vibration
    speed = desk.answers.speed_hz or seen.speed or _speed_by_row(desk)
    for row, name in zip(rows, channel_names(rows), strict=True):
        bearing, level = bearing_of(draft.survey, row, name, desk.answers)[1], level_in_g(row, draft)
        values, factor = _values(desk, row), 1.0
        stored = row.level
        if level is not None and stored.rms > 0.0:
            factor = level.rms / stored.rms * row.factor
        elif level is None:
            factor, level = (scale_of(row, draft) or 1.0) * row.factor, stored.times(scale_of(row, draft) or 1.0)
        unit = "" if level_in_g(row, draft) is None else "g"
        if unit_of(row, desk.answers.of(row, desk.seen)) == VELOCITY:
            unit = VELOCITY
        lines = {}
        if bearing is not None and speed is not None and speed > 0.0:
            found = kinematics(bearing.geometry(), speed)
            lines = {part.name: tuple(k * part.frequency(found) for k in range(1, N_LINES + 1)) for part in PARTS}
        yield ChannelPreview(
            name=name,
            bearing="" if bearing is None else bearing.designation or "by its geometry",
            unit=unit,
            rms=level.rms,
            peak=level.peak,
            lines=lines,
            signal=_signal(values * factor, draft.rate, points),
            spectrum=_spectrum(values * factor, draft.rate, points),
        )


def _values(desk: ImportDesk, row: SurveyedRow) -> NDArray[np.float64]:
    """Return the samples of a row, those that are no numbers as 0."""
    at = next(at for at, own in enumerate(desk.seen.rows) if own.column == row.column)
    values = np.asarray(desk.seen.values.values[at][:_MAX_SPECTRUM_SAMPLES], dtype=np.float64)
    return np.where(np.isfinite(values), values, 0.0)


def _speed_by_row(desk: ImportDesk) -> float | None:
    from monitor.desk.questions import speed_factor, speed_row

    row = speed_row(desk.seen)
    factor = None if row is None else speed_factor(row, desk.answers)
    return None if row is None or factor is None else abs(row.level.mean) * factor


def _signal(values: NDArray[np.float64], rate: float, points: int) -> Curve:
    return _condensed(values[: max(2, round(_SECOND * rate))], 1.0 / rate, points)


def _spectrum(values: NDArray[np.float64], rate: float, points: int) -> Curve:
    """Return the amplitude of a sine by a Hann window, the mean removed."""
    window = np.hanning(values.size)
    amplitude = 2.0 * np.abs(np.fft.rfft((values - values.mean()) * window)) / max(1.0, float(window.sum()))
    return _condensed(amplitude, rate / values.size, points)


def _condensed(values: NDArray[np.float64], step: float, points: int) -> Curve:
    """Return the extremes of equal parts."""
    length = max(1, -(-values.size // points))
    begins = np.arange(0, values.size, length)
    return Curve(step * length, np.minimum.reduceat(values, begins), np.maximum.reduceat(values, begins))
