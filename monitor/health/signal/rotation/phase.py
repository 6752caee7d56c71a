"""The angle by the phases of its orders: what a coarse path of the speed leaves is read from lines that nearly stand.

Signal and envelope are read at equal steps of the coarse angle. A line of order k with phase p(j) in the window j says
that the shaft is ahead of the coarse angle by p / (2 pi k) turns, but for a constant. Differences of phase over growing
numbers of windows are fitted by a smooth correction, all orders at once, each with the weight of its signal over noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.plans import next_smooth
from monitor.health.signal.rotation.plane import LowRows
from monitor.health.signal.rotation.rotation import Rotation

_OVERLAP = 4
"""Windows that a window overlaps with on either side, itself counted."""
_END = 0.25
"""From the end of a block to the middle of the window next to it, in windows."""
_LAGS = (1, 1, 2, 4, 8, 16)
"""Windows between the phases that are compared, pass by pass."""
_ROUNDS = 2
"""Passes over the phases themselves, after the first."""
MAX_KNOTS = 400
"""Greatest number of the knots of a correction."""
_NOISE_WINDOWS = 21
"""Windows over which the noise beside a line is averaged."""
_LINE_WINDOWS = 5
_PRESENT = 2.0
"""Power over noise, over so many windows, above which a line counts."""
_MAX_SNR = 300.0
"""Limit of signal over noise: a line is not trusted to better than this, for paths of transmission change its phase."""


_MORE_THAN_NOISE = 1.5
"""Error over what noise alone would give (``python -m benchmarks.rotation.ridge``)."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What the phases add to a coarse angle.

    Attributes:
        turn: shape (knot,), turns of the coarse angle.
        ahead: shape (knot,), turns by which the shaft is ahead of it, joined linearly.
        sd: standard deviation of its error over the block, turns, a steady drift left out.
        drift_sd: relative standard deviation of the error of the mean speed.
    """

    turn: NDArray[np.float64]
    ahead: NDArray[np.float64]
    sd: float
    drift_sd: float


def rows_by_angle(signals: LowRows, rotation: Rotation, per_turn: float) -> tuple[NDArray[np.float32], float]:
    """Return signal and envelope at equal steps of the angle, shape (2, sample), and the samples per turn."""
    count = next_smooth(max(2, int(rotation.turned * per_turn)))
    per_turn = count / rotation.turned
    begin = float(rotation.turns_at(0.0))
    time = rotation.time_at(begin + (np.arange(count) + 0.5) / per_turn)
    position = np.clip(time * signals.rate, 0.0, signals.rows.shape[1] - 2.0)
    below = position.astype(np.intp)
    part = (position - below).astype(np.float32)
    first = signals.rows[:, below]
    return (first + (signals.rows[:, below + 1] - first) * part).astype(np.float32, copy=False), per_turn


def correct(
    signals: LowRows,
    rotation: Rotation,
    orders: NDArray[np.float64],
    window: float,
    spacing: float,
    roughness: float,
) -> Correction:
    """Return the correction of a coarse angle by the phases of its orders.

    Args:
        signals: they hold the highest order at the highest speed.
        rotation: coarse angle, in turns of which ``orders`` are multiples.
        orders: shape (order,).
        window: length of a window, turns; what turns steadily within it is read.
        spacing: of the knots of the correction, turns.
        roughness: standard deviation of the second difference of the correction from knot to knot, turns.
    """
    rows, per_turn = rows_by_angle(signals, rotation, 2.5 * float(orders[-1] + 1.0))
    lines, snr = _lines(rows, per_turn, orders, window)
    windows = _centres(rotation.turned, window)
    knot = np.linspace(0.0, rotation.turned, int(np.clip(rotation.turned / spacing, 4, MAX_KNOTS)))
    fit = _Fit(lines, snr, np.tile(orders, 2)[:, None], _hat_functions(windows, knot), _prior(knot.size, roughness))
    ahead = np.zeros(knot.size)
    for lag in _LAGS:
        if lag < lines.shape[1] // 2:
            ahead = fit.by_differences(ahead, lag)
    ahead, normal, scatter = fit.by_phases(ahead)
    for _ in range(_ROUNDS):
        ahead, normal, scatter = fit.by_phases(ahead)
    return Correction(knot, ahead - ahead[0], *_uncertainty(normal, knot, max(1.0, scatter)))


def _prior(knots: int, roughness: float) -> NDArray[np.float64]:
    """Return the normal matrix of second differences of that standard deviation, shape (knot, knot)."""
    bend = np.diff(np.eye(knots), 2, axis=0)
    return bend.T @ bend / roughness**2


@dataclass(frozen=True, eq=False)
class _Fit:
    """A smooth correction to phases of lines.

    Attributes:
        lines, snr: see ``_lines``, shape (line, window).
        order: of each line, shape (line, 1).
        basis: weights of the knots in each window, shape (window, knot).
        prior: shape (knot, knot).
    """

    lines: NDArray[np.complex128]
    snr: NDArray[np.float64]
    order: NDArray[np.float64]
    basis: NDArray[np.float64]
    prior: NDArray[np.float64]

    def by_differences(self, ahead: NDArray[np.float64], lag: int) -> NDArray[np.float64]:
        """Return the correction improved by the changes of phase over so many windows."""
        difference = self.basis[lag:] - self.basis[:-lag]
        change = self.lines[:, lag:] * np.conj(self.lines[:, :-lag])
        first, last = self.snr[:, :-lag], self.snr[:, lag:]
        weight = self.order**2 * first * last / (1.0 + first + last)
        mean, total, _ = self._residual(change, weight, difference @ ahead, False)
        # Windows overlap, and pairs of a longer lag share their windows: each counts for a part.
        total *= 1.0 / max(0.5 * _OVERLAP, lag)
        return self._solved(difference, total, mean, ahead)[0]

    def by_phases(self, ahead: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the correction improved by the phases themselves, its normal matrix, and the scatter over noise."""
        weight = self.order**2 * self.snr
        at = self.basis @ ahead
        turned = self.lines * np.exp(-2j * np.pi * self.order * at)
        steady = np.sum(turned * weight / np.maximum(np.abs(turned), 1e-30), axis=1, keepdims=True)
        still = self.lines * np.conj(steady / np.maximum(np.abs(steady), 1e-30))
        mean, total, scatter = self._residual(still, weight, at, True)
        total *= 2.0 / _OVERLAP
        ahead, normal = self._solved(self.basis, total, mean, ahead)
        return ahead, normal, scatter

    def _residual(
        self, lines: NDArray[np.complex128], weight: NDArray[np.float64], predicted: NDArray[np.float64], steady: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the mean of what the lines say beyond a prediction, turns, its weight, and the scatter over noise."""
        left = np.angle(lines * np.exp(-2j * np.pi * self.order * predicted)) / (2.0 * np.pi * self.order)
        weight = weight * (2.0 * np.pi) ** 2
        total = weight.sum(axis=0)
        mean = (weight * left).sum(axis=0) / np.maximum(total, 1e-30)
        if steady:
            # A line that wanders against the others, by a path of transmission or a neighbour, counts for less.
            expected = np.minimum(weight / (2.0 * np.pi * self.order) ** 2, 1.0).sum(axis=1, keepdims=True)
            found = (weight * (left - mean) ** 2).sum(axis=1, keepdims=True)
            weight = weight * np.minimum(1.0, expected / np.maximum(found, 1e-30))
            total = weight.sum(axis=0)
            mean = (weight * left).sum(axis=0) / np.maximum(total, 1e-30)
        counted = np.minimum(weight / (2.0 * np.pi * self.order) ** 2, 1.0).sum()
        return mean, total, float((weight * (left - mean) ** 2).sum() / max(1.0, counted))

    def _solved(
        self, basis: NDArray[np.float64], weight: NDArray[np.float64], mean: NDArray[np.float64],
        ahead: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:  # fmt: skip
        weighted = basis * weight[:, None]
        normal = weighted.T @ basis + self.prior
        # The constant is free: it is held at zero on the whole.
        normal = np.asarray(normal + 1e-3 * float(np.trace(normal)) / normal.shape[0] ** 2, dtype=np.float64)
        left = np.asarray(weighted.T @ mean - self.prior @ ahead, dtype=np.float64)
        return ahead + np.linalg.solve(normal, left), normal


def corrected(rotation: Rotation, correction: Correction) -> Rotation:
    """Return a rotation with a correction added; knots are those of the correction."""
    begin = float(rotation.turns_at(0.0))
    turn = correction.turn
    time = rotation.time_at(begin + turn)
    ahead_slope = np.gradient(correction.ahead, turn)
    turns = turn + correction.ahead
    speed = rotation.speed_at(time) * np.maximum(1.0 + ahead_slope, 0.2)
    return Rotation(time, turns, speed, rotation.duration, "phase", correction.sd, correction.drift_sd)


def _lines(
    rows: NDArray[np.float32], per_turn: float, orders: NDArray[np.float64], window: float
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return the complex amplitude of each line in each window, and its power over the noise beside it.

    Returns:
        Both of shape (row and order, window).
    """
    count = rows.shape[1]
    padded = next_smooth(count + int(2 * window * per_turn))
    spectrum = np.fft.fft(rows, padded, axis=1)
    resolution = per_turn / padded
    half = int(2.0 / window / resolution)
    # A Hann window of so many turns, centred on its window: the transform of the low-pass it is.
    span: NDArray[np.int64] = np.arange(-half, half + 1)
    taper = _hann_response(span.astype(np.float64) * (resolution * window))
    centre = _centres(count / per_turn, window)
    n_windows = centre.size
    turn = np.exp(2j * np.pi * np.outer(span * resolution, centre))

    def demodulated(at: NDArray[np.float64]) -> NDArray[np.complex128]:
        middle = np.rint(at / resolution).astype(np.intp)
        bins = (middle[:, None] + span) % padded
        lines = (spectrum[:, bins] * taper) @ turn / padded
        # The bin is not quite the order: what is left turns slowly.
        shift = np.exp(2j * np.pi * np.outer(middle * resolution - at, centre))
        return (lines * shift).reshape(-1, n_windows)

    lines = demodulated(orders)
    beside = 0.5 * (np.abs(demodulated(orders - 0.5)) ** 2 + np.abs(demodulated(orders + 0.5)) ** 2)
    width = min(_NOISE_WINDOWS, n_windows)
    kernel = np.ones(width) / width
    counts = np.convolve(np.ones(n_windows), kernel, mode="same")
    noise = np.array([np.convolve(row, kernel, mode="same") for row in beside]) / counts
    power = np.abs(lines) ** 2 / np.maximum(noise, 1e-30)
    # Noise alone reads 1 in the mean; what stands above it for several windows is a line.
    kernel = np.ones(min(_LINE_WINDOWS, n_windows))
    local = np.array([np.convolve(row, kernel, mode="same") for row in power])
    local /= np.convolve(np.ones(n_windows), kernel, mode="same")
    snr = np.clip(np.minimum(local, power) - _PRESENT, 0.0, _MAX_SNR)
    return lines, snr


def _centres(turned: float, window: float) -> NDArray[np.float64]:
    """Return the centres of the windows, turns; the first and the last stand out of the block by a part."""
    inside = _END * window
    count = max(2, int((turned - 2.0 * inside) / (window / _OVERLAP)) + 1)
    return np.linspace(inside, turned - inside, count)


def _hann_response(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transform of a Hann window over its length times the frequency; 1 at zero."""
    return np.sinc(x) + 0.5 * np.sinc(x - 1.0) + 0.5 * np.sinc(x + 1.0)


def _hat_functions(at: NDArray[np.float64], knot: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights of linear interpolation between knots, shape (place, knot)."""
    step = knot[1] - knot[0]
    return np.maximum(0.0, 1.0 - np.abs(at[:, None] - knot) / step)


def _uncertainty(normal: NDArray[np.float64], knot: NDArray[np.float64], scatter: float) -> tuple[float, float]:
    """Return the standard deviations of the correction without its drift, turns, and of the drift, relative."""
    covariance = np.linalg.inv(normal) * scatter
    line = np.stack((np.ones(knot.size), knot - knot.mean()))
    fit = np.linalg.solve(line @ line.T, line)
    without = np.eye(knot.size) - line.T @ fit
    variance = float(np.trace(without @ covariance @ without.T)) / knot.size
    drift = float(fit[1] @ covariance @ fit[1])
    return _MORE_THAN_NOISE * math.sqrt(max(0.0, variance)), _MORE_THAN_NOISE * math.sqrt(max(0.0, drift))
