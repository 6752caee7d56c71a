"""Shaft speed from the signal: the speed at which shaft, cage and fault lines agree.

Each candidate speed is scored on the whitened raw and envelope spectra: heights at the multiples of the shaft, less
those half way between (lines there show that the true shaft turns at half or twice the speed), plus the best comb of
cage or race passages with their slip. A speed is given only if its score exceeds that of any other by a margin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing, kinematics
from monitor.health.signal.floor import MIN_FLOOR_BINS, noise_floor
from monitor.health.signal.transform import AmplitudeSpectrum, get_transform

SHAFT_ORDERS = 8
FAULT_ORDERS = 4
_SLIP = np.linspace(-0.02, 0.01, 13)
"""Slip of cage and passages against pure rolling."""
_MAX_HEIGHT = 4.0
"""Limit of one line, ln of power over the floor, so that a comb needs several lines."""
_STEP = 0.3
"""Step of the search, in bins at the highest multiple of the shaft."""
_SAME_SPEED = 0.015
"""Candidates within this relative distance of the best one are the same answer."""
MIN_SCORE = 12.0
MIN_MARGIN = 4.0
"""Score that the best speed must reach, and its margin over any other (``python -m benchmarks.rotation.speed``)."""
_PIECE = 512
"""Candidate speeds whose combs of the bearing are looked at together."""
_SHAFT_PRESENT = 6.0
"""Score from which the lines of a slower shaft count as present."""
_MIN_LINE_HEIGHT = 1.0
_BIN_SD, _SLIP_SD = 0.3, 0.01
"""Error of a line's maximum, in bins, and of a speed from cage or passages, relative."""
_MIN_BIN = 8
"""Least bin of the lowest candidate, so that its lines are resolved."""


class SpeedStatus(StrEnum):
    """Whether a speed was found."""

    OK = "ok"
    CANNOT_TELL = "cannot_tell"
    TOO_SHORT = "too_short"


@dataclass(frozen=True)
class SpeedEstimate:
    """A speed with its uncertainty.

    Attributes:
        status: "ok", or why there is no speed.
        speed: shaft speed, Hz, or NaN.
        sd: standard deviation of its error, Hz, or NaN.
        score: of the best candidate.
        margin: excess over the best other one.
    """

    status: SpeedStatus
    speed: float = math.nan
    sd: float = math.nan
    score: float = math.nan
    margin: float = math.nan


def whitened(spectrum: AmplitudeSpectrum) -> NDArray[np.float64]:
    """Return ln(power over local floor) of each bin less its mean in noise, limited to 0 to ``_MAX_HEIGHT``."""
    power = np.square(spectrum.amplitude, dtype=np.float64)
    tiny = np.finfo(np.float64).tiny
    floor = np.maximum(noise_floor(spectrum.amplitude, MIN_FLOOR_BINS), tiny)
    height = np.clip(np.log(np.maximum(power, tiny) / floor) - math.log(3.0), 0.0, _MAX_HEIGHT)
    height[:3] = 0.0
    return height


def _at(height: NDArray[np.float64], resolution: float, frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the heights at some frequencies, 0 beyond the spectrum."""
    position = frequency / resolution
    below = position.astype(np.intp)
    inside = (position >= 0.0) & (below < height.size - 1)
    below = np.where(inside, below, 0)
    first = height.take(below)
    found = (height.take(below + 1) - first) * (position - below) + first
    return np.where(inside, found, np.where(position == height.size - 1, height[-1], 0.0))


def estimate_speed(
    samples: NDArray[np.floating], rate: float, bearing: Bearing, limits: tuple[float, float]
) -> SpeedEstimate:
    """Estimate the shaft speed of a block.

    Args:
        samples: shape (sample,), any unit.
        bearing: its kinematics give the lines.
        limits: lowest and highest possible speed, Hz.

    Raises:
        ValueError: the limits are not 0 < low < high.
    """
    low, high = limits
    if not (0.0 < low < high < math.inf):
        raise ValueError(f"limits of the speed must satisfy 0 < low < high, got {low} to {high} Hz")
    # A tenth to nine tenths of the Nyquist frequency.
    band = (0.05 * rate, 0.45 * rate)
    if samples.size < 64 or samples.size / rate * low < _MIN_BIN:
        return SpeedEstimate(SpeedStatus.TOO_SHORT)
    spectra = get_transform(samples.size, rate, (band,), raw_limit=min(highest_line(bearing, high), 0.5 * rate))(
        samples
    )
    return speed_of_spectra(spectra.raw, spectra.envelopes[0], bearing, limits)


def highest_line(bearing: Bearing, speed: float) -> float:
    """Return the highest frequency that the estimate looks at, Hz."""
    return max(SHAFT_ORDERS, FAULT_ORDERS * kinematics(bearing, 1.0).bpfi) * speed


def speed_of_spectra(
    raw: AmplitudeSpectrum,
    envelope: AmplitudeSpectrum,
    bearing: Bearing,
    limits: tuple[float, float],
    orders: Sequence[float] = tuple(range(1, SHAFT_ORDERS + 1)),
) -> SpeedEstimate:
    """Estimate the shaft speed from the spectra of the signal and of its envelope, which have one resolution.

    Args:
        limits: lowest and highest speed, Hz; the bin of the lowest is at least ``_MIN_BIN``.
        orders: lines of the shaft that are looked for, per revolution, rising.
    """
    low, high = limits
    resolution = raw.resolution
    count = max(2, math.ceil((high - low) * orders[-1] / (_STEP * resolution)))
    speeds = np.linspace(low, high, count)
    heights = whitened(raw), whitened(envelope)
    shaft = _shaft_score(heights, resolution, speeds, orders)
    score, best, other = _best_two(heights[1], resolution, speeds, shaft, bearing)
    margin = score - other
    mistaken = _may_be_a_fault_line(float(speeds[best]), speeds, shaft, bearing)
    if score < MIN_SCORE or margin < MIN_MARGIN or mistaken:
        return SpeedEstimate(SpeedStatus.CANNOT_TELL, score=score, margin=margin)
    speed, sd = _refined((raw, envelope), heights, float(speeds[best]), orders)
    return SpeedEstimate(SpeedStatus.OK, speed, sd, score, margin)


def _best_two(
    height: NDArray[np.float64],
    resolution: float,
    speeds: NDArray[np.float64],
    shaft: NDArray[np.float64],
    bearing: Bearing,
) -> tuple[float, int, float]:
    """Return the best score, its place, and the best score of another speed, at least 0.

    The combs of the bearing add no more than ``_MAX_HEIGHT`` a line: they are looked at for the speeds of the highest
    shaft scores, in pieces, until no other speed can be better than the best two.
    """
    falling = np.argsort(-shaft, kind="stable")
    score = np.full(speeds.size, -np.inf)
    most = _MAX_HEIGHT * FAULT_ORDERS
    best, other = 0, 0.0
    for begin in range(0, falling.size, _PIECE):
        piece = falling[begin : begin + _PIECE]
        if begin and float(shaft[piece[0]]) + most < other:
            break
        score[piece] = shaft[piece] + _fault_score(height, resolution, speeds[piece], bearing)
        best = int(np.argmax(score))
        apart = np.abs(speeds / speeds[best] - 1.0) > _SAME_SPEED
        other = float(np.max(score, where=apart, initial=0.0))
    return float(score[best]), best, other


def _shaft_score(
    heights: tuple[NDArray[np.float64], ...],
    resolution: float,
    speeds: NDArray[np.float64],
    orders: Sequence[float],
) -> NDArray[np.float64]:
    """Return the heights at the multiples of each speed less those half way below each."""
    score = np.zeros(speeds.size)
    for height in heights:
        for order in orders:
            weight = 1.0 if order <= 0.5 * orders[-1] else 0.5
            score += weight * _at(height, resolution, order * speeds)
            score -= weight * _at(height, resolution, (order - 0.5 * orders[0]) * speeds)
    return score


def _fault_score(
    height: NDArray[np.float64], resolution: float, speeds: NDArray[np.float64], bearing: Bearing
) -> NDArray[np.float64]:
    """Return the best comb of cage, passages or spin for each speed; seldom more than one is present."""
    lines = kinematics(bearing, 1.0)
    best = np.zeros(speeds.size)
    for line in (lines.ftf, lines.bpfo, lines.bpfi, 2.0 * lines.bsf):
        for slip in _SLIP:
            comb = np.zeros(speeds.size)
            for order in range(1, FAULT_ORDERS + 1):
                comb += _at(height, resolution, order * line * (1.0 + slip) * speeds)
            np.maximum(best, comb, out=best)
    return best


def _may_be_a_fault_line(
    speed: float, speeds: NDArray[np.float64], shaft: NDArray[np.float64], bearing: Bearing
) -> bool:
    """Return whether the best candidate may be the passages of a slower shaft that is present as well."""
    lines = kinematics(bearing, 1.0)
    for line in (lines.bpfo, lines.bpfi, 2.0 * lines.bsf):
        slower = (speeds * line * (1.0 + _SLIP[0]) <= speed) & (speed <= speeds * line * (1.0 + _SLIP[-1]))
        if np.max(shaft[slower], initial=0.0) >= _SHAFT_PRESENT:
            return True
    return False


def _refined(
    spectra: tuple[AmplitudeSpectrum, ...],
    heights: tuple[NDArray[np.float64], ...],
    speed: float,
    orders: Sequence[float],
) -> tuple[float, float]:
    """Return the speed by the maxima of its shaft lines, and the standard deviation of its error.

    A line of order k determines the speed k times as exactly as the first one. With fewer than two lines of the shaft,
    the speed rests on cage or passages and is as uncertain as their slip.
    """
    found: list[float] = []
    weights: list[float] = []
    for spectrum, height in zip(spectra, heights, strict=True):
        for order in orders:
            middle = round(order * speed / spectrum.resolution)
            if middle + 3 >= height.size or middle < 4:
                continue
            top = middle - 2 + int(np.argmax(spectrum.amplitude[middle - 2 : middle + 3]))
            if height[top] < _MIN_LINE_HEIGHT:
                continue
            before, at, after = np.log(np.maximum(spectrum.amplitude[top - 1 : top + 2], np.finfo(np.float64).tiny))
            curve = before - 2.0 * at + after
            shift = float(np.clip(0.5 * (before - after) / curve, -0.5, 0.5)) if curve < 0.0 else 0.0
            found.append((top + shift) * spectrum.resolution / order)
            weights.append(float(order * order))
    if len(found) < 2:
        return speed, _SLIP_SD * speed
    values, weight = np.array(found), np.array(weights)
    mean = float(np.average(values, weights=weight))
    # Lines of other origin may be near: outliers do not count.
    spread = spectra[0].resolution / np.sqrt(weight)
    near = np.abs(values - speed) <= 2.0 * spread
    if np.count_nonzero(near) >= 2:
        values, weight = values[near], weight[near]
        mean = float(np.average(values, weights=weight))
    scatter = float(np.average((values - mean) ** 2, weights=weight)) / (values.size - 1)
    floor = (_BIN_SD * spectra[0].resolution) ** 2 / float(weight.sum())
    return mean, math.sqrt(scatter + floor)
