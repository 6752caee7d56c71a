"""Instantaneous angular speed: the speed of a shaft from mark to mark of its encoder, and its spectrum.

A counter gives the time that elapses between two marks: the mean of 1/speed over an equal step of angle. The spectrum
is that of its relative change with the sign turned. It is linear in the times: an error of one time enters two
neighbouring intervals with opposite signs, so that what white jitter and the rounding by the counter's clock add rises
with the order, and is small where the lines of a bearing are. To invert each interval first would bring the noise of
high orders down to them. A change of the speed by a share ``a`` reads wrong by ``a**2`` at most, relatively.

What varies over more than eight turns (:func:`.intervals.slow_course`) is divided out first: a run-up does not leak
into low orders, and an error of the marks stays on multiples of the shaft. Amplitudes are right within 2 % from 0.2
events per revolution on, within 0.1 % from 1 on, up to a quarter of the marks a turn. What the marks are off and what
turns with their wheel cannot be told apart.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing, kinematics
from monitor.health.signal.comb import FaultLines, LineSpectrum, beside_shaft, line_spectrum
from monitor.health.signal.lines import CombQuery, find_lines
from monitor.health.signal.rotation.encoder import Pattern, pattern_of
from monitor.health.signal.rotation.intervals import (
    Intervals,
    PulseTrain,
    TooFewPulsesError,
    UnevenPulsesError,
    intervals,
)
from monitor.health.signal.rotation.repair import Repaired, repaired
from monitor.health.signal.rotation.rotation import TachoSettings
from monitor.health.signal.search import FamilySearch, slip_searches
from monitor.health.signal.settings import N_HARMONICS, fundamentals
from monitor.health.signal.spectra import HIGHEST_BINS, MAX_FINE_LINES, BlockView, RawSpectra

FINE_ORDERS = 100.0
"""Events per revolution up to which each line is kept to be looked at."""
MIN_MARKS = 16
"""Marks a turn without which there is no spectrum: it ends at half of them."""
_HANN_POWER = 1.5
_SHAFT_BINS = 2


@dataclass(frozen=True, eq=False)
class IasSpectrum:
    """Spectrum of the relative change of a shaft's speed, times its mean.

    Attributes:
        resolution: spacing of the bins, events per revolution of the bearing's shaft.
        amplitude: (bin,) single-sided, through a Hann window, rad/s of the shaft with the marks; 0 in bin 0.
        per_revolution: marks of that shaft.
        ratio: turns of the bearing's shaft per turn of the shaft with the marks.
        turns: of the shaft with the marks that were used.
        mean_speed: of the shaft with the marks over them, Hz.
        filled: share of the intervals beside a missing mark.
        timing_noise: standard deviation of the time of a pulse, s, from the upper half of the spectrum: jitter, the
            clock, and what is off from mark to mark.
    """

    resolution: float
    amplitude: NDArray[np.float64]
    per_revolution: int
    ratio: float
    turns: int
    mean_speed: float
    filled: float
    timing_noise: float

    @property
    def orders(self) -> NDArray[np.float64]:
        """Events per revolution of the bearing's shaft at each bin, shape (bin,)."""
        return np.arange(self.amplitude.size, dtype=np.float64) * self.resolution

    def noise(self, order: float, timing_noise: float) -> float:
        """Return the root mean square that a bin reads where each pulse has an independent error, rad/s.

        Args:
            order: events per revolution of the bearing's shaft.
            timing_noise: standard deviation of the time of a pulse, s.
        """
        wheel, speed = order * self.ratio, 2.0 * math.pi * self.mean_speed
        samples = self.turns * self.per_revolution
        return speed * speed * wheel * timing_noise * math.sqrt(4.0 * _HANN_POWER / samples)


def clock_noise(clock: float) -> float:
    """Return the standard deviation of a time that is rounded to the ticks of a clock (Hz), s."""
    return 1.0 / (math.sqrt(12.0) * clock)


def interval_error(clock: float, per_revolution: int, speed: float) -> float:
    """Return the standard deviation of the speed of one interval, relative, by the rounding of both its times.

    It is ``marks a turn * speed / clock / sqrt(6)``, and at most ``marks a turn * speed / clock``.

    Args:
        clock: of the counter, Hz.
        per_revolution: marks a turn.
        speed: Hz.
    """
    return per_revolution * speed / (math.sqrt(6.0) * clock)


def ias_spectrum(found: Intervals, ratio: float = 1.0) -> IasSpectrum:
    """Return the spectrum of the angular speed over events per revolution.

    The mean over an interval takes ``sinc(order / marks)`` of a line, by which it is divided. The bin at half of the
    marks is left out.

    Args:
        found: elapsed times.
        ratio: turns of the bearing's shaft per turn of the shaft with the marks.

    Raises:
        TooFewPulsesError: fewer than ``MIN_MARKS`` marks a turn.
    """
    count, marks, turns = found.elapsed.size, found.per_revolution, found.turns
    if marks < MIN_MARKS:
        raise TooFewPulsesError(f"a spectrum of the angular speed needs {MIN_MARKS} marks a turn or more, got {marks}")
    speed = turns / float(found.elapsed.sum())
    window = _hann(count)
    change = found.longer
    change -= np.einsum("i,i->", change, window) / (0.5 * count)
    change *= window
    relative = np.abs(np.fft.rfft(change))[: (count + 1) // 2] * (4.0 / count)
    order = np.arange(relative.size) / turns
    relative[0] = 0.0
    upper = slice(relative.size // 2, None)
    # A white error of the times is taken from each end of an interval.
    gain = 2.0 * np.sin(np.pi * order[upper] / marks) * marks * speed
    power = np.median(np.square(relative[upper] / gain)) / math.log(2.0)
    noise = math.sqrt(float(power) * count / (4.0 * _HANN_POWER))
    relative *= 2.0 * math.pi * speed
    relative /= np.sinc(order / marks)
    return IasSpectrum(1.0 / (turns * ratio), relative, marks, ratio, turns, speed, found.filled, noise)


def beside_marks(spectrum: IasSpectrum, highest: float) -> LineSpectrum:
    """Return a spectrum prepared for the search of lines that are no multiple of either shaft.

    What stands at a multiple of the shaft with the marks may be their error: it is taken out.

    Args:
        spectrum: of the angular speed.
        highest: events per revolution of the bearing's shaft that are needed.
    """
    size = min(spectrum.amplitude.size, math.ceil(highest / spectrum.resolution) + 1)
    amplitude = spectrum.amplitude[:size].copy()
    # Whole turns were transformed: a multiple of the wheel stands on a bin, and nowhere else.
    at = np.arange(0, size + spectrum.turns, spectrum.turns)
    near = (at[:, None] + np.arange(-_SHAFT_BINS, _SHAFT_BINS + 1)).ravel()
    beyond = np.repeat(at, 2 * _SHAFT_BINS + 1) + np.tile(_BEYOND, at.size)
    inside = (near >= 0) & (near < size)
    amplitude[near[inside]] = amplitude[np.clip(np.abs(beyond[inside]), 0, size - 1)]
    prepared = line_spectrum(amplitude, spectrum.resolution, speed=1.0)
    return beside_shaft(prepared, 1.0, 0.0)


_BEYOND = np.array([-5, -4, 5, 4, 6])
"""Bins whose noise takes the place of those within ``_SHAFT_BINS`` of a multiple of the wheel."""


def ias_lines(spectrum: IasSpectrum, fundamentals: Mapping[str, float]) -> dict[str, FaultLines]:
    """Find the lines of fault families in a spectrum of the angular speed; amplitudes in rad/s.

    They are sought as at a known speed (:func:`monitor.health.signal.search.slip_searches`).

    Args:
        spectrum: of the angular speed.
        fundamentals: first line of each family, events per revolution of the bearing's shaft.
    """
    ranges = slip_searches()
    widest = max(fundamentals.values()) * N_HARMONICS
    prepared = beside_marks(spectrum, 1.1 * widest + 100.0 * spectrum.resolution)
    plain = FamilySearch()
    queries = [
        CombQuery(line, ranges.get(fault, plain).width, centre=ranges.get(fault, plain).centre)
        for fault, line in fundamentals.items()
    ]
    return dict(zip(fundamentals, find_lines(prepared, queries, N_HARMONICS), strict=True))


def ias_view(spectrum: IasSpectrum) -> RawSpectra:
    """Return what is kept of a spectrum to be looked at: where ``RawSpectra`` has Hz stand events per revolution."""
    lines = spectrum.amplitude
    fine = min(lines.size, MAX_FINE_LINES, math.floor(FINE_ORDERS / spectrum.resolution) + 1)
    each = max(1, math.ceil(lines.size / HIGHEST_BINS))
    starts = np.arange(0, lines.size, each)
    return RawSpectra(
        resolution=spectrum.resolution,
        amplitude=lines[:fine].astype(np.float32),
        width=each * spectrum.resolution,
        highest=np.maximum.reduceat(lines, starts).astype(np.float32),
    )


def view_of(train: PulseTrain, ratio: float, error: NDArray[np.float64] | None = None) -> RawSpectra | None:
    """Return what is kept of a block's angular speed to be looked at; None where its pulses have no spectrum.

    Args:
        train: repaired pulses.
        ratio: turns of the bearing's shaft per turn of the shaft with the marks.
        error: of the marks, as :func:`intervals` takes it.
    """
    try:
        return ias_view(ias_spectrum(intervals(train, error), ratio))
    except (TooFewPulsesError, UnevenPulsesError):
        return None


def with_ias(
    view: BlockView | None,
    pulses: Repaired | None,
    ratio: float,
    bearing: Bearing,
    error: NDArray[np.float64] | None = None,
) -> BlockView | None:
    """Return what is kept of a block with its angular speed, where its pulses can show a line of the bearing's balls.

    Args:
        view: of the block, or None.
        pulses: of the block, or None.
        ratio: turns of the bearing's shaft per turn of the shaft with the marks.
        bearing: whose slowest passage must stand below half of the marks.
        error: of the marks, as :func:`view_of` takes it.
    """
    if view is None or pulses is None or pulses.train is None:
        return view
    lines = fundamentals(kinematics(bearing, 1.0))
    slowest = min(order for fault, order in lines.items() if fault != "cage")
    if slowest * ratio > 0.5 * pulses.train.per_revolution:
        return view
    return replace(view, ias=view_of(pulses.train, ratio, error))


def _hann(count: int) -> NDArray[np.float64]:
    """Return the periodic Hann window, whose transform is zero but for three bins."""
    return 0.5 - 0.5 * np.cos(np.arange(count) * (2.0 * math.pi / count))


_REASONS = {
    "too_few": "fewer than four pulses",
    "irregular": "intervals between pulses do not follow one speed; are pulses_per_revolution and the level right?",
    "stopped": "pulses begin late or end early: the shaft did not turn all the time",
}


@dataclass(frozen=True, eq=False)
class IasStudy:
    """What a recording of pulses says.

    Attributes:
        train: repaired pulses.
        missing, extra: marks without a pulse, and pulses without a mark.
        spectrum: of the angular speed.
        wheel: what repeats each turn in this recording: error of the marks, and what turns with the shaft.
        removed: whether that was taken out of the spectrum.
    """

    train: PulseTrain
    missing: int
    extra: int
    spectrum: IasSpectrum
    wheel: Pattern
    removed: bool

    def lines(self, fundamentals: Mapping[str, float]) -> dict[str, FaultLines]:
        """Return :func:`monitor.health.signal.rotation.ias.ias_lines` of the spectrum."""
        return ias_lines(self.spectrum, fundamentals)


def study(
    times: NDArray[np.float64],
    tacho: TachoSettings,
    *,
    resolution: float = 0.0,
    remove_wheel: bool = False,
) -> IasStudy:
    """Return what the pulses of a recording say of the speed.

    Args:
        times: shape (pulse,), s, never falling.
        tacho: the wheel.
        resolution: to which the times are known, s.
        remove_wheel: take out what repeats each turn, where it does.

    Raises:
        ValueError: the pulses cannot be numbered, or are too few (see :func:`intervals`); the message says why.
    """
    if times.size < 2:
        raise ValueError(f"{times.size} pulses")
    from_first = times - times[0]
    found = repaired(from_first, float(from_first[-1]), tacho.per_revolution, tacho.missing_teeth, resolution)
    if found.train is None:
        raise ValueError(f"{times.size} pulses: {_REASONS.get(found.status, found.status)}")
    plain = intervals(found.train)
    wheel = pattern_of(plain)
    removed = remove_wheel and wheel.repeatable
    used = intervals(found.train, wheel.error) if removed else plain
    return IasStudy(found.train, found.missing, found.extra, ias_spectrum(used, tacho.ratio), wheel, removed)
