"""Resonances in recordings of a machine that is excited in a wide band, and in measured accelerances.

The power spectral density is averaged by Welch's method. A median over neighbouring bins hides lines (multiples of the
shaft's and the elements' rates); its prominent maxima are resonances, to each of which that of one mode on a background
is fitted, in logarithms, with little weight for lines. The excitation is taken as white near a resonance. What the
excitation, neighbouring modes and turning parts make of it is in the uncertainties, as a share.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.words.numerics import prominent_peaks, robust_fit, running_median

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_RESOLUTION = 4.0
"""Coarsest resolution of the density, Hz, where recordings are long enough."""
# Bins of the median: a line of a Hann window is narrower than half of it.
_MEDIAN = 7
# Least prominence of a resonance, in logarithms of power (3 dB), and in standard deviations of the density.
_PROMINENCE, _DEVIATIONS = 0.7, 4.0
# Half-power widths around a resonance, and least bins, over which it is fitted.
_WIDTHS, _LEAST_BINS = 3.0, 8
# Shares of frequency and damping ratio by which other modes and the excitation move a resonance.
FREQUENCY_SHARE, DAMPING_SHARE = 0.003, 0.1
# A background is in phase or not: with so many times its amplitude over that of the mode, the maximum moves by that
# share of its half width, and the damping ratio by that share of itself.
_FREQUENCY_PHASE, _DAMPING_PHASE = 1.5, 2.0
# Damping ratios of what is taken as a resonance, and the largest uncertainty of either.
_DAMPING, _MAX_UNCERTAINTY = (5e-4, 0.3), 0.5
# Bins of a density with a Hann window are correlated: so many times as much variance of what is fitted.
_CORRELATION = 2.0
_POWER_OF_HANN = (1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0)


@dataclass(frozen=True)
class Resonance:
    """A resonance: frequency, Hz; damping ratio; level at it in the unit of the spectrum, with standard uncertainties.

    ``share`` is the part of the power at the frequency that is the mode's, not the background's.
    """

    frequency: float
    frequency_sd: float
    damping: float
    damping_sd: float
    level: float
    share: float


@dataclass(frozen=True, eq=False)
class Density:
    """Power spectral density, one-sided.

    Attributes:
        frequency: Hz, shape (bins,), ascending.
        power: unit of the signal squared per Hz, shape (bins,).
        scatter: standard deviation of the logarithm of a bin.
        windowed: whether it is that of Hann-windowed segments, evenly spaced.
    """

    frequency: NDArray[np.float64]
    power: NDArray[np.float64]
    scatter: float
    windowed: bool = True


def welch(signals: Iterable[NDArray[np.float64]], rate: float) -> Density:
    """Return the density of recordings of one machine at one rate, Hz, averaged over half-overlapping segments.

    The first signal decides the resolution: MAX_RESOLUTION, or a quarter of it where that is shorter, and all of it
    where it is shorter than a second.

    Raises:
        ValueError: if there is no signal, or one is shorter than a segment.
    """
    total: NDArray[np.float64] | None = None
    length, segments = 0, 0
    window: NDArray[np.float64] = np.empty(0)
    for signal in signals:
        if total is None:
            length = min(signal.size if signal.size < rate else signal.size // 4, math.ceil(rate / MAX_RESOLUTION))
            window = np.hanning(length + 1)[:-1]
            total = np.zeros(length // 2 + 1)
        if signal.size < length:
            raise ValueError(f"recordings must hold at least {length} samples as the first, got {signal.size}")
        for begin in range(0, signal.size - length + 1, max(1, length // 2)):
            segment = signal[begin : begin + length]
            total += np.square(np.abs(np.fft.rfft(window * (segment - np.mean(segment)))))
            segments += 1
    if total is None:
        raise ValueError("there is no recording")
    power = total * 2.0 / (segments * rate * float(np.sum(np.square(window))))
    # Half-overlapping Hann segments count as 0.95 of independent ones.
    scatter = 1.0 / math.sqrt(max(1.0, 0.95 * segments))
    return Density(np.arange(total.size, dtype=np.float64) * (rate / length), power, scatter)


def find_resonances(
    density: Density, band: tuple[float, float] | None = None, *, most: int = 6
) -> tuple[Resonance, ...]:
    """Return the resonances of a density, ascending; of more than ``most`` those with the largest prominence.

    Args:
        band: in which they are sought, Hz. Default: all.
        most: number of them.
    """
    low, high = band or (0.0, math.inf)
    inside = np.flatnonzero(
        (density.frequency >= low) & (density.frequency <= high) & (density.power > 0.0) & (density.frequency > 0.0)
    )
    if inside.size < 3 * _LEAST_BINS:
        return ()
    frequency, logarithm = density.frequency[inside], np.log(density.power[inside])
    smooth = running_median(logarithm, _MEDIAN) if density.windowed else logarithm
    places, left, right, prominence = prominent_peaks(smooth, max(_PROMINENCE, _DEVIATIONS * density.scatter))
    found: list[tuple[float, Resonance]] = []
    for place, base, other, height in zip(
        places.tolist(), left.tolist(), right.tolist(), prominence.tolist(), strict=True
    ):
        part = _surroundings(smooth, place, (base, other))
        fitted = _fitted(frequency[part], logarithm[part], float(frequency[place]), density)
        if fitted is not None and not any(_same(fitted, earlier) for _, earlier in found):
            found.append((height, fitted))
    chosen = sorted(found, key=lambda pair: -pair[0])[:most]
    return tuple(sorted((resonance for _, resonance in chosen), key=lambda resonance: resonance.frequency))


def _same(one: Resonance, other: Resonance) -> bool:
    return abs(one.frequency - other.frequency) < one.damping * one.frequency + other.damping * other.frequency


def _surroundings(smooth: NDArray[np.float64], place: int, bases: tuple[int, int]) -> slice:
    """Return the bins around a maximum over which it is fitted: some half-power widths, not beyond its bases."""
    ends: list[int] = []
    for way, base in ((-1, bases[0]), (1, bases[1])):
        at = place
        while at != base and smooth[at] > smooth[place] - math.log(2.0):
            at += way
        reach = max(_LEAST_BINS, round(_WIDTHS * abs(at - place)))
        end = place + way * reach
        ends.append(max(end, base, 0) if way < 0 else min(end, base, len(smooth) - 1))
    return slice(min(ends[0], max(place - _LEAST_BINS, 0)), max(ends[1], min(place + _LEAST_BINS, len(smooth) - 1)) + 1)


def _fitted(
    frequency: NDArray[np.float64], logarithm: NDArray[np.float64], begin: float, density: Density
) -> Resonance | None:
    """Return the resonance in some bins, or None where one mode does not explain them."""
    top = float(np.max(logarithm))
    scale = max(density.scatter, 1e-3)

    def mode(parameters: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
        ratio = at / (begin * math.exp(float(parameters[0])))
        width = 2.0 * math.exp(float(parameters[1]))
        # One where the mode is at its natural frequency.
        return np.exp(parameters[2]) * width**2 * ratio**4 / ((1.0 - ratio**2) ** 2 + (width * ratio) ** 2)

    def model(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        power = mode(parameters, frequency)
        if density.windowed:
            power = np.convolve(np.pad(power, 1, mode="edge"), _POWER_OF_HANN, mode="valid")
        background = np.exp(parameters[3]) * (frequency / begin) ** np.clip(parameters[4], -8.0, 8.0)
        return np.log(power + background)

    def residuals(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        return (model(np.clip(parameters, -50.0, 50.0)) + top - logarithm) / scale

    width = _half_width(frequency, logarithm)
    base = float(np.min(logarithm)) - top
    start = np.array([0.0, math.log(np.clip(width / begin, *_DAMPING)), 0.0, max(base, -20.0), 0.0])
    parameters, left, jacobian = robust_fit(residuals, start)
    damping = math.exp(float(np.clip(parameters[1], -50.0, 5.0)))
    place = begin * math.exp(float(np.clip(parameters[0], -5.0, 5.0)))
    if not (_DAMPING[0] <= damping <= _DAMPING[1] and frequency[0] <= place <= frequency[-1]):
        return None
    variance = _CORRELATION * max(1.0, float(np.median(np.abs(left)) / 0.6745) ** 2)
    deviation = np.sqrt(np.maximum(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * variance, 0.0))
    strength, behind = math.exp(float(parameters[2])), math.exp(float(np.clip(parameters[3], -50.0, 50.0)))
    share = strength / (strength + behind)
    if not (deviation[1] <= _MAX_UNCERTAINTY and deviation[0] <= damping + 0.02 and share >= 0.5):
        return None
    amplitude = math.sqrt(1.0 - share)
    moved = math.hypot(FREQUENCY_SHARE, _FREQUENCY_PHASE * amplitude * damping)
    return Resonance(
        frequency=place,
        frequency_sd=place * math.hypot(float(deviation[0]), moved),
        damping=damping,
        damping_sd=damping * math.hypot(float(deviation[1]), DAMPING_SHARE, _DAMPING_PHASE * amplitude),
        level=math.exp(0.5 * (top + math.log(strength + behind))),
        share=share,
    )


def _half_width(frequency: NDArray[np.float64], logarithm: NDArray[np.float64]) -> float:
    """Return half of the half-power width around the highest bin, Hz, roughly."""
    near = frequency[logarithm > np.max(logarithm) - math.log(2.0)]
    return max(0.5 * float(near[-1] - near[0]), float(frequency[1] - frequency[0]))
