"""Spectra over the angle of the shaft: a periodic signal is resampled at equal steps of angle, then transformed.

The axis is in Hz of a shaft that turns at the mean speed of the block: a line of order ``o`` stands at ``o`` times that
speed, whatever the speed did (docs/decisions/0021). A line of order o at the speed s(t) sounds at o s(t): all that lies
above the highest order of interest times the highest speed is cut off before, and as many samples are taken over the
angle as keep the rest, at the lowest speed, from folding below that order.

A periodic signal between its samples, from its own Fourier coefficients.

They are divided by the transform of a short kernel, brought to ``OVERSAMPLING`` times the least rate by an inverse FFT,
and weighted by the kernel at the places wanted. With a Kaiser-Bessel kernel seven samples wide the error is 2e-6 of the
amplitude (Barnett, Magland and af Klinteberg, doi 10.1137/18M120885X).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.plans import FftPlan, Kind, Precision, kept_by_thread, next_smooth, planning
from monitor.health.signal.rotation.rotation import Rotation

Maker = Callable[[int, Precision], NDArray[np.floating]]
OVERSAMPLING = 2.0
"""Samples that are interpolated between, over the least number that holds the signal."""
_HALF_TAPS = 3
_TAPS = 2 * _HALF_TAPS + 1
_SHAPE = 0.97 * math.pi * _TAPS * (1.0 - 0.5 / OVERSAMPLING)
_DEGREE = 8
_CHUNK = 8192
_KEPT, _LONGEST_KEPT = 24, 1 << 19


def grid_bins(bins: NDArray[np.complexfloating]) -> tuple[NDArray[np.complexfloating], int]:
    """Return bins as ``between`` needs them, and the length of their inverse transform."""
    length = _grid_length(bins.size)
    return bins * _correction(length, precision_of(bins.real))[: bins.size], length


Sampled = TypeVar("Sampled", NDArray[np.floating], NDArray[np.complexfloating])


def between(period: Sampled, places: NDArray[np.float64]) -> Sampled:
    """Return a periodic signal at places between its samples.

    Args:
        period: (sample,) the inverse transform of what ``grid_bins`` gave, real or complex.
        places: (row, place) from 0 to the length of the period, in samples.
    """
    grid = np.concatenate((period[-_HALF_TAPS:], period, period[: _HALF_TAPS + 1]))
    kernel = _kernel()
    found = np.empty(places.shape, dtype=grid.dtype)
    rows = max(1, _CHUNK // places.shape[1])
    for begin in range(0, places.shape[0], rows):
        place = places[begin : begin + rows]
        nearest = np.rint(place)
        beside = (place - nearest).astype(grid.real.dtype)
        square = beside * beside
        index = nearest.astype(np.intp)
        total = grid.take(index + _HALF_TAPS, mode="clip")
        total *= _polynomial(kernel[0][0], square)
        for tap in range(1, _HALF_TAPS + 1):
            even, odd = (_polynomial(terms, square) for terms in kernel[tap])
            odd *= beside
            above = grid[_HALF_TAPS + tap :].take(index, mode="clip")
            below = grid[_HALF_TAPS - tap :].take(index, mode="clip")
            total += even * (above + below)
            total += odd * (above - below)
        found[begin : begin + rows] = total
    return found  # pyright: ignore[reportReturnType]  # of the type of the period


def precision_of(samples: NDArray[np.floating]) -> Precision:
    """Return the precision of an array."""
    return "float32" if samples.dtype == np.float32 else "float64"


def kept_by_length(make: Maker) -> Maker:
    """Keep what is made for lengths that blocks have."""
    keep = lru_cache(maxsize=_KEPT)(make)
    return lambda length, precision: (keep if length <= _LONGEST_KEPT else make)(length, precision)


def _polynomial(terms: tuple[float, ...], x: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return a polynomial, its highest term first."""
    value = x * x.dtype.type(terms[0])
    value += x.dtype.type(terms[1])
    for term in terms[2:]:
        value *= x
        value += x.dtype.type(term)
    return value


@lru_cache(maxsize=1)
def _kernel() -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
    """Return the kernel at ``tap - v``, v from -1/2 to 1/2, of each tap from 0: its parts even and odd in v.

    Both are polynomials in the square of v, the highest term first; the odd part is to be multiplied by v.
    """
    found: list[tuple[tuple[float, ...], tuple[float, ...]]] = []
    for tap in range(_HALF_TAPS + 1):
        series = np.polynomial.Chebyshev.interpolate(lambda v, tap=tap: _kaiser(tap - v), _DEGREE, domain=[-0.5, 0.5])
        terms = series.convert(kind=np.polynomial.Polynomial, domain=[-1.0, 1.0]).coef
        found.append((tuple(terms[0::2][::-1].tolist()), tuple(terms[1::2][::-1].tolist())))
    return tuple(found)


def _kaiser(distance: NDArray[np.float64]) -> NDArray[np.float64]:
    inside = 1.0 - np.square(distance * (2.0 / _TAPS))
    return np.i0(_SHAPE * np.sqrt(np.maximum(inside, 0.0))) / np.i0(_SHAPE)


@kept_by_length
def _correction(length: int, precision: Precision) -> NDArray[np.floating]:
    """Return one over the transform of the kernel at the bins of a grid that are used, real."""
    frequency = np.arange(math.ceil(0.5 * length / OVERSAMPLING) + 1) * (math.pi * _TAPS / length)
    root = np.sqrt(_SHAPE**2 - np.square(frequency))
    transform = _TAPS * np.sinh(root) / (root * np.i0(_SHAPE))
    return (1.0 / transform).astype(precision)


def _grid_length(n_bins: int) -> int:
    """Return the length of the grid for so many bins, one of four to the octave."""
    least = max(2.0 * OVERSAMPLING * n_bins, 64.0)
    octave = 1 << (math.ceil(math.log2(least)) - 3)
    return octave * math.ceil(least / octave)


MAX_SPEED_RATIO = 6.0
"""Highest over lowest speed of a block that is warped: the samples over the angle grow with it."""
SAMPLING_RATIO = 2.5
"""Samples over the angle for each period of the highest line that is read, at least."""
_MARGIN, _MARGIN_BINS = 1.02, 32
"""What is kept above the highest frequency that is needed: a line of varying frequency reaches beyond it."""
_MIN_NODES, _NODES_PER_SECOND, _MOST_PER_SECOND, _NODES_PER_KNOT = 1024, 200.0, 800.0, 2.0
_COMPARED, _SAME_TURNS = 129, 1e-3
_LEAST_SAMPLES = 64
_KEPT_PLANS, _KEPT_WARPS = 24, 8


@dataclass(frozen=True, eq=False)
class Warp:
    """When a shaft stood at equal steps of angle, over the used part of a block.

    Attributes:
        duration: of the used part, s.
        mean_speed: of the whole block, Hz: the speed of the axis.
        resolution: spacing of the bins on that axis, Hz: the mean speed over the revolutions of the used part.
        slowest, fastest: speeds in the used part, Hz.
        times: shape (node + 1,), s, from 0 to the duration.
        slopes: shape (node + 1,), s by which the time grows in one node.
    """

    duration: float
    mean_speed: float
    resolution: float
    slowest: float
    fastest: float
    times: NDArray[np.float64]
    slopes: NDArray[np.float64]

    @property
    def nodes(self) -> int:
        """Steps of angle at which the time is known exactly: a power of two."""
        return self.times.size - 1

    def points(self, count: int, scale: float) -> NDArray[np.float64]:
        """Return ``scale`` times the times at ``count`` equal steps of angle, a count that ``n_points`` gave.

        Shape (step in a node, node): the time is a cubic in each node.
        """
        nodes = self.nodes
        if count <= nodes:
            return np.asarray(self.times[None, : -1 : nodes // count] * scale, dtype=np.float64)
        begin, first, last = self.times[:-1] * scale, self.slopes[:-1] * scale, self.slopes[1:] * scale
        rise = np.diff(self.times) * scale
        u = (np.arange(count // nodes) / (count // nodes))[:, None]
        points = u * (first + last - 2.0 * rise)
        points += 3.0 * rise - 2.0 * first - last
        points *= u
        points += first
        points *= u
        points += begin
        return points

    def n_points(self, least: float) -> int:
        """Return a fast number of steps of angle from ``least``; there are few such numbers."""
        if least <= self.nodes:
            return self.nodes >> int(math.log2(self.nodes / max(least, 16.0)))
        return self.nodes * next_smooth(math.ceil(least / self.nodes))


@dataclass(frozen=True, eq=False)
class OrderSpectrum:
    """Single-sided amplitude spectrum over orders of the shaft, of a signal Hann-windowed over the angle.

    Attributes:
        step: spacing of the bins, events per revolution; bin k stands at k times it.
        amplitude: (bin,) in the unit of the signal; a line on a bin reads its amplitude.
        mean: of the signal over the angle.
        revolutions: of the shaft.
        mean_speed: Hz.
        complete: order up to which every part of the signal is below its Nyquist frequency.
    """

    step: float
    amplitude: NDArray[np.float64]
    mean: float
    revolutions: float
    mean_speed: float
    complete: float

    @property
    def order(self) -> NDArray[np.float64]:
        """(bin,) events per revolution."""
        return np.arange(self.amplitude.size, dtype=np.float64) * self.step


@lru_cache(maxsize=_KEPT_WARPS)
def warp_of(rotation: Rotation, duration: float) -> Warp | None:
    """Return the warp of the first ``duration`` seconds of a block; None beyond ``MAX_SPEED_RATIO``."""
    most = max(_MIN_NODES, _MOST_PER_SECOND * duration)
    wanted = max(_MIN_NODES, _NODES_PER_SECOND * duration, min(most, _NODES_PER_KNOT * rotation.time.size))
    nodes = 1 << math.ceil(math.log2(wanted))
    turned = float(np.diff(rotation.turns_at((0.0, duration)))[0])
    times = rotation.time_at(rotation.turns_at(0.0) + turned * np.arange(nodes + 1) / nodes)
    times[0], times[-1] = 0.0, duration
    speeds = rotation.speed_at(times)
    slowest, fastest = float(speeds.min()), float(speeds.max())
    if fastest > MAX_SPEED_RATIO * slowest:
        return None
    mean = rotation.mean_speed
    return Warp(duration, mean, mean / turned, slowest, fastest, times, (turned / nodes) / speeds)


def warp_or_error(rotation: Rotation, duration: float) -> Warp:
    """Return what ``warp_of`` does; ValueError where that is None."""
    warp = warp_of(rotation, duration)
    if warp is None:
        low, high = rotation.speed_range
        raise ValueError(f"the speed varies from {low:g} to {high:g} Hz, at most by a factor of {MAX_SPEED_RATIO:g}")
    return warp


def same_axis(one: Rotation | None, other: Rotation | None) -> bool:
    """Return whether spectra by two rotations, or over time by None, can be compared bin for bin."""
    if one is None or other is None or one is other:
        return one is other
    time = np.linspace(0.0, one.duration, _COMPARED)
    turned = [(rotation.turns_at(time) - rotation.turns_at(0.0)) / rotation.mean_speed for rotation in (one, other)]
    return float(np.abs(turned[0] - turned[1]).max()) * max(one.mean_speed, other.mean_speed) < _SAME_TURNS


def order_amplitude(
    bins: NDArray[np.complexfloating], n_samples: int, warp: Warp, limit: float
) -> tuple[NDArray[np.floating], float]:
    """Return the amplitude spectrum of a signal over the angle, Hann-windowed, and its mean over the angle.

    Args:
        bins: (bin,) real FFT of the signal over ``warp.duration``, not normalised; the last is below Nyquist's.
        n_samples: that were transformed.
        warp: times at equal steps of angle.
        limit: highest frequency that is read, Hz at the mean speed.

    Returns:
        Single-sided amplitudes at multiples of ``warp.resolution`` up to the limit, or as far as there is signal; a
        line on a bin reads its amplitude.
    """
    return angle_amplitude(order_samples(bins, n_samples, warp, limit), warp, limit)


def angle_amplitude(samples: NDArray[np.floating], warp: Warp, limit: float) -> tuple[NDArray[np.floating], float]:
    """Return what ``order_amplitude`` does of a signal that is at equal steps of angle already."""
    count = math.floor(limit / warp.resolution + 1e-9) + 1
    precision = precision_of(samples)
    mean = float(samples.mean())
    plan = _plan("real", samples.size, precision)
    np.subtract(samples, samples.dtype.type(mean), out=plan.input)
    plan.input[:] *= _hann(samples.size, precision)
    plan.execute()
    return np.abs(plan.output[: min(count, samples.size // 2)]), mean


def order_spectrum(
    samples: NDArray[np.floating], rate: float, rotation: Rotation, limit: float | None = None
) -> OrderSpectrum:
    """Return the order spectrum of a signal at its full rate.

    Up to 0.4 of ``rate`` over the highest speed, the least number of samples in a revolution, lines read their
    amplitude within 1e-4 of it, and what else the signal holds folds to less than that. Some 60 bytes of memory are
    needed for a sample.

    Args:
        samples: (sample,), any unit.
        rate: sampling rate, Hz.
        rotation: of the shaft over the samples.
        limit: highest order; by default all that are below the Nyquist frequency at every speed.

    Raises:
        ValueError: the samples last another time than the rotation, fewer than 64 samples, or the speed varies beyond
            ``MAX_SPEED_RATIO``.
    """
    if samples.size < _LEAST_SAMPLES or abs(rotation.duration * rate - samples.size) > 0.5:
        lasts = f"{samples.size / rate:g} s ({samples.size} samples)"
        raise ValueError(f"expected {_LEAST_SAMPLES} samples or more of {rotation.duration:g} s, got {lasts}")
    warp = warp_or_error(rotation, samples.size / rate)
    complete = 0.5 * rate / warp.fastest
    mean = float(samples.mean())
    bins = np.fft.rfft(samples.astype(np.float64) - mean)[: (samples.size + 1) // 2]
    highest = (complete if limit is None else min(limit, complete)) * warp.mean_speed
    over_angle = order_samples(bins, samples.size, warp, highest, plans=False)
    rest = float(over_angle.mean())
    amplitude = np.abs(np.fft.rfft((over_angle - rest) * _hann(over_angle.size, "float64")))
    count = math.floor(highest / warp.resolution + 1e-9) + 1
    step = warp.resolution / warp.mean_speed
    return OrderSpectrum(
        step, np.asarray(amplitude[:count], dtype=np.float64), mean + rest, 1.0 / step, warp.mean_speed, complete
    )


def order_samples(
    bins: NDArray[np.complexfloating],
    n_samples: int,
    warp: Warp,
    limit: float,
    *,
    plans: bool = True,
) -> NDArray[np.floating]:
    """Return a signal at equal steps of angle, without what lies above a frequency; arguments as ``order_amplitude``.

    There are at least ``SAMPLING_RATIO`` samples in a period of the limit, and so many that nothing folds below it.
    Without ``plans`` nothing is kept for the next signal.
    """
    kept = min(bins.size, math.ceil(limit * warp.fastest / warp.mean_speed * warp.duration * _MARGIN) + _MARGIN_BINS)
    highest = kept / warp.duration * warp.mean_speed / warp.slowest
    points = warp.n_points(max(SAMPLING_RATIO * limit, limit + highest) / warp.resolution)
    corrected, length = grid_bins(bins[:kept])
    corrected *= bins.real.dtype.type(1.0 / n_samples)
    if plans:
        plan = _plan("synthesis", length, precision_of(bins.real))
        plan.input[:kept] = corrected
        plan.input[kept:] = 0
        plan.execute()
        period = plan.output
    else:
        period = np.fft.irfft(corrected, length, norm="forward")
    return between(period, warp.points(points, length / warp.duration)).T.ravel()


@kept_by_length
def _hann(n_samples: int, precision: Precision) -> NDArray[np.floating]:
    """Return the Hann window with which the transform of a line of unit amplitude reads 1."""
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_samples) / n_samples)
    return (hann * (4.0 / n_samples)).astype(precision)


def _planned(kind: Kind, length: int, precision: Precision) -> FftPlan:
    with planning():
        return FftPlan(length, kind, precision)


_plan = kept_by_thread(_planned, _KEPT_PLANS)
