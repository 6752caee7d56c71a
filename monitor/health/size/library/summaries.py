"""A history of any length in a bounded summary: the state and input of the library forecaster.

A history is a sequence of rows (time, one value per channel); a channel is the logarithm of a feature or derived from
one. The first few points are kept, the latest few dozen, and every n-th of all, with n doubled when there are too many;
extremes and turning points are counted as points come. Training and live use share :meth:`LevelHistory.add` and
:func:`summarise`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from monitor.health.codec import Float64Array, FloatOrNan, StoredState

RECENT = 48
FIRST = 6
WHOLE = 64
"""Points kept of the latest, of the first, and (at most) of all."""

SHARES = (0.2, 0.4, 0.6, 0.8)
"""Shares of the elapsed time at which the values are interpolated."""
SLOPES = (6, 12, 24, 48)
"""Numbers of latest points to which straight lines are fitted."""
_SMOOTH = 5
"""Points of the running mean whose turning points are counted."""

OFFSET = 6.0
"""Intervals added to a time to threshold before its logarithm is taken."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LevelHistory(StoredState):
    """State of a history, of bounded size.

    Attributes:
        t_first: time of the first point, s; NaN before it.
        recent: the latest points, oldest first: time since the first point in s, then the channels; shape (n, 1 + K).
        first: the first points, shape (n, 1 + K).
        whole: every ``stride``-th point, shape (n, 1 + K).
        most: largest value of each channel, shape (K,).
        least: smallest value of each channel, shape (K,).
        smooth: running mean over five points, shape (K,).
        heading: sign of its last change, 0.0 at first, shape (K,).
        variation: sum of its absolute changes, shape (K,).
        turns: number of its changes of sign, shape (K,).
    """

    t_first: FloatOrNan
    count: int
    recent: Float64Array
    first: Float64Array
    whole: Float64Array
    stride: int
    most: Float64Array
    least: Float64Array
    smooth: Float64Array
    heading: Float64Array
    variation: Float64Array
    turns: Float64Array

    @classmethod
    def empty(cls, channels: int) -> LevelHistory:
        """Return a history of ``channels`` channels without points."""
        rows, zeros = np.zeros((0, 1 + channels)), np.zeros(channels)
        high, low = np.full(channels, -np.inf), np.full(channels, np.inf)
        return cls(math.nan, 0, rows, rows, rows, 1, high, low, zeros, zeros, zeros, zeros)

    @property
    def channels(self) -> int:
        """Number of channels."""
        return self.recent.shape[1] - 1

    @property
    def elapsed(self) -> float:
        """Time from the first point to the latest, s; 0 before the first."""
        return float(self.recent[-1, 0]) if self.count else 0.0

    def add(self, t: float, values: Array) -> LevelHistory:
        """Return the history with one more point.

        Args:
            t: s; not before the latest.
            values: finite, shape (K,).

        Raises:
            ValueError: a time that goes back, or values of another shape or not finite.
        """
        if values.shape != (self.channels,) or not np.isfinite(values).all():
            raise ValueError(f"values must be {self.channels} finite numbers, got {values!r}")
        t_first = t if self.count == 0 else self.t_first
        since = t - t_first
        if not (math.isfinite(t) and since >= self.elapsed):
            latest = self.t_first + self.elapsed
            raise ValueError(f"t must be finite and not before the latest point ({latest} s), got {t} s")
        row = np.empty((1, 1 + self.channels))
        row[0, 0], row[0, 1:] = since, values
        recent = np.concatenate((self.recent[-(RECENT - 1) :], row))
        first = self.first if len(self.first) == FIRST else np.concatenate((self.first, row))
        whole, stride = self._thinned(row)
        smooth = _mean(recent[-_SMOOTH:, 1:])
        step = smooth - self.smooth if self.count else np.zeros(self.channels)
        heading = np.where(step == 0.0, self.heading, np.sign(step))
        return LevelHistory(
            t_first=t_first,
            count=self.count + 1,
            recent=recent,
            first=first,
            whole=whole,
            stride=stride,
            most=np.maximum(self.most, values),
            least=np.minimum(self.least, values),
            smooth=smooth,
            heading=heading,
            variation=self.variation + np.abs(step),
            turns=self.turns + (heading * self.heading < 0.0),
        )

    def _thinned(self, row: Array) -> tuple[Array, int]:
        if self.count % self.stride:
            return self.whole, self.stride
        whole = np.concatenate((self.whole, row))
        return (whole, self.stride) if len(whole) <= WHOLE else (whole[::2], 2 * self.stride)

    def __eq__(self, other: object) -> bool:
        """Compare bit for bit."""
        if not isinstance(other, LevelHistory):
            return NotImplemented
        return all(
            np.array_equal(getattr(self, f.name), getattr(other, f.name), equal_nan=True) for f in fields(LevelHistory)
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]  # holds arrays: equal, but not hashable


def summary_names(channels: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the numbers of :func:`summarise`, in their order."""
    kinds = ("last_6", "last_3", "first_6", "most", "least", "middle", "scatter_6", "roughness", "variation", "turns")
    kinds += tuple(f"slope_{n}" for n in SLOPES) + tuple(f"at_{share:g}" for share in SHARES)
    return ("ln_elapsed", *(f"{channel}:{kind}" for kind in kinds for channel in channels))


def summarise(history: LevelHistory, interval: float) -> Array:
    """Return the summary of a history up to its latest point, shape (1 + 18 K,).

    All times are multiples of ``interval``, so rigs with blocks every ten seconds and lives of hours, or every five
    minutes and days, look the same to a library.

    Args:
        history: at least one point.
        interval: usual block interval, s.
    """
    recent = history.recent[:, 1:]
    time = history.recent[:, 0] / interval
    elapsed = history.elapsed / interval
    whole_time, whole = history.whole[:, 0] / interval, history.whole[:, 1:]
    middle = whole[(whole_time >= 0.2 * elapsed) & (whole_time <= 0.8 * elapsed)]
    changes = np.diff(recent, axis=0)
    parts = [
        np.array([math.log(elapsed + 6.0)]),
        _mean(recent[-6:]),
        _mean(recent[-3:]),
        _mean(history.first[:, 1:]),
        history.most,
        history.least,
        _mean(middle if len(middle) else recent),
        _scatter(recent[-6:]),
        _scatter(changes) if len(changes) else np.zeros(history.channels),
        np.log1p(history.variation),
        np.log1p(history.turns),
        *(_slope(time[-n:], recent[-n:]) for n in SLOPES),
        *_values_at(whole_time, whole, [share * elapsed for share in SHARES]),
    ]
    return np.concatenate(parts)


def _mean(rows: Array) -> Array:
    """Return what ``rows.mean(axis=0)`` does, in a fifth of the time where rows are few."""
    return np.add.reduce(rows, axis=0) / len(rows)


def _scatter(rows: Array) -> Array:
    """Return what ``rows.std(axis=0)`` does."""
    centred = rows - _mean(rows)
    return np.sqrt(_mean(centred * centred))


def _slope(time: Array, values: Array) -> Array:
    """Return the slope of a fitted line, per interval; 0 where all times are equal."""
    centred = time - _mean(time)
    spread = float(centred @ centred)
    return centred @ values / spread if spread > 0.0 else np.zeros(int(values.shape[1]))


def _values_at(time: Array, values: Array, wanted: list[float]) -> list[Array]:
    """Return the values at some times, linear between the points and constant beyond them."""
    if len(time) == 1:
        return [values[0]] * len(wanted)
    moments = np.array(wanted)
    after = np.clip(np.searchsorted(time, moments, side="right"), 1, len(time) - 1)
    before = after - 1
    gap = time[after] - time[before]
    apart = gap > 0.0
    share = np.where(apart, np.clip((moments - time[before]) / np.where(apart, gap, 1.0), 0.0, 1.0), 1.0)
    return list(values[before] + share[:, None] * (values[after] - values[before]))


_NAMES = summary_names(("v",))
_LATEST, _POWER_PLACE = _NAMES.index("v:last_3"), _NAMES.index("v:slope_24")
_SLOPE_PLACES = [_NAMES.index(f"v:slope_{count}") for count in SLOPES]


def extrapolations(summary: Array, threshold: float) -> Array:
    """Return when curves through the latest V_eq reach a threshold, as ln(time + offset).

    Lines and exponentials with the slopes of the latest points, and a power of the elapsed time; used only where V_eq
    itself is the history, where it improves the scores out of fold.

    Args:
        summary: of a history of ln V_eq.

    Returns:
        Shape (2 len(SLOPES) + 1,).
    """
    elapsed = math.exp(float(summary[0])) - 6.0
    to_go = min(max(math.log(threshold) - float(summary[_LATEST]), 0.0), 9.0)
    slopes = np.maximum(summary[_SLOPE_PLACES], 1e-4)
    power = min(max(float(summary[_POWER_PLACE]) * elapsed, 0.2), 8.0)
    lines = math.expm1(min(to_go, 5.0)) / slopes
    return np.log(np.concatenate((lines, to_go / slopes, [elapsed * math.expm1(min(to_go / power, 4.0))])) + OFFSET)
