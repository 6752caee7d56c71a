"""Whether a block, and the history that ends with it, can be one of the lives of a library.

A sensor that lost its gain, noise, or a fault of another part give levels within the range of a library, and its
regression answers them all. Three checks refuse what hardly any life did:

- the step of the RMS from the latest blocks, over its own scatter. Damage only grows: the longer nothing was seen, the
  further the RMS may have risen, but it falls by scatter alone;
- the distance of the summary of the history from those of the lives (Mahalanobis);
- the lines of BPFO beside the RMS, means of the latest six blocks, likewise.

Limits are those that one life in 130 (a rise), 200 (a fall) and 100 (the distances) exceeds in any of its blocks; those
of the last two are measured on other lives than means and covariances.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from monitor.health.size.library.summaries import LevelHistory, summarise

Array = NDArray[np.float64]

LAGS = (1, 2, 4, 8, 16, 32, 64)
"""Intervals between blocks over which the lives' rise of the RMS is measured; beyond the last, any rise is possible."""
MAX_GAP = 12.0
"""Intervals. A longer gap counts as this in the age of a history, and refused blocks widen the limit this far."""
_RISE_EXCEEDED, _FALL_EXCEEDED, _DISTANCE_EXCEEDED = 0.0075, 0.005, 0.01
"""Shares of lives that exceed a limit in any block. Found on the development lives of ``benchmarks.unseen.seeds``:
sound lives are flagged as seldom as asked, and a gain and a fault of the inner race as often as that allows."""
_FEW = 10.0
"""What is added to the limits of the distances, relative, over the number of lives that they are measured on: the
largest of twenty is exceeded by one life in twenty."""
_LATEST, _MIN_BLOCKS = 5, 3
_CHANGES, _PRIOR_CHANGES, _PRIOR_SD = 12, 12.0, 0.3
"""The scatter of ln RMS: changes that it is read from, and the prior with its weight in changes. Found on 400 lives of
``benchmarks.forecast.population.LIBRARY``: a smaller prior calls jumps of smooth lives steps."""
_LIVES, _EVERY = 1000, 3
"""Lives and blocks from which distances are measured."""
_SHRINKAGE = 0.1


@dataclass(frozen=True, eq=False)
class Limits:
    """What the lives of a library did not exceed; d numbers in a summary, K levels.

    Attributes:
        rise: largest score of a rise of the RMS after each of ``LAGS``, shape (7,).
        fall: largest score of a fall, shape (1,).
        centre: mean of the summaries, shape (d,).
        scale: their standard deviations, shape (d,).
        precision: inverse of their shrunk correlation, shape (d, d).
        distance: largest root mean square distance of a summary, shape (1,).
        lines: coefficients of 1, a and a2 for the lines, where a is ln RMS, shape (3, K - 1).
        lines_precision: inverse covariance of the lines about them, shape (K - 1, K - 1).
        lines_distance: largest distance of the lines, shape (1,).
    """

    rise: Array
    fall: Array
    centre: Array
    scale: Array
    precision: Array
    distance: Array
    lines: Array
    lines_precision: Array
    lines_distance: Array

    def largest_rise(self, lag: float) -> float:
        """Return the largest score of a rise after ``lag`` intervals."""
        if lag > LAGS[-1]:
            return math.inf
        return float(np.interp(math.log(max(lag, 1.0)), np.log(LAGS), self.rise))

    def holds_step(self, score: float, lag: float) -> bool:
        """Return whether the lives had a step of this score after ``lag`` intervals."""
        return -float(self.fall[0]) <= score <= self.largest_rise(lag)

    def holds_summary(self, summary: Array) -> bool:
        """Return whether a summary, shape (d,) or longer, and the lines in it lie among those of the lives."""
        own = summary[: len(self.centre)]
        away, lines_away = self.distances(own[None])
        return bool(away[0] <= self.distance[0] and lines_away[0] <= self.lines_distance[0])

    def distances(self, summaries: Array) -> tuple[Array, Array]:
        """Return the distances of summaries (n, d) and of the lines in them, shape (n,) each."""
        z = (summaries - self.centre) / self.scale
        levels = 1 + self.lines.shape[1]
        rms, lines = summaries[:, 1], summaries[:, 2 : 1 + levels]
        about = lines - _quadratic(rms) @ self.lines
        return _distance(z, self.precision) / math.sqrt(z.shape[1]), _distance(about, self.lines_precision)


@dataclass(frozen=True)
class Watch:
    """What was seen of the blocks, used or refused; bounded.

    Attributes:
        seen: time of the latest block, s, or None.
        widest: widest gap between blocks since the latest used one, s.
        closed: time by which gaps were shortened in the age of the history, s.
    """

    seen: float | None = None
    widest: float = 0.0
    closed: float = 0.0

    def see(self, t: float, interval: float) -> Watch:
        """Return the watch with a block at ``t`` s, at blocks each ``interval`` s."""
        gap = 0.0 if self.seen is None else t - self.seen
        excess = max(gap - MAX_GAP * interval, 0.0)
        return Watch(t, max(self.widest, gap), self.closed + excess)

    def lag(self, since: float, interval: float) -> float:
        """Return the intervals over which a rise is judged, where the latest used block was ``since`` s ago."""
        return max(self.widest, min(since, MAX_GAP * interval)) / interval

    def use(self) -> Watch:
        """Return the watch after its latest block was used."""
        return replace(self, widest=0.0)


def step_score(latest: Sequence[float], level: float) -> float | None:
    """Return the step of a level from the median of the latest five, over the scatter of the changes before it.

    Args:
        latest: ln RMS of the latest blocks, oldest first; fewer than three have no score.
        level: ln RMS of the block.
    """
    if len(latest) < _MIN_BLOCKS:
        return None
    last = sorted(latest[-_LATEST:])
    half = len(last) // 2
    base = last[half] if len(last) % 2 else 0.5 * (last[half - 1] + last[half])
    tail = latest[-_CHANGES - 1 :]
    squares = sum((b - a) ** 2 for a, b in pairwise(tail))
    variance = (0.5 * squares + _PRIOR_CHANGES * _PRIOR_SD**2) / (len(tail) - 1 + _PRIOR_CHANGES)
    return (level - base) / math.sqrt(variance)


def fit_limits(times: Sequence[Array], levels: Sequence[Array], interval: float) -> Limits:
    """Return the limits of lives.

    Args:
        times: of each life, s, shape (n,).
        levels: its relative levels, RMS first, shape (n, K).
        interval: usual block interval, s.
    """
    rise, fall = _step_limits([rows[:, 0].tolist() for rows in levels])
    own = [_summaries(t, rows, interval) for t, rows in zip(times[:_LIVES], levels[:_LIVES], strict=True)]
    own = [rows for rows in own if len(rows)]
    known, judged = own[::2], own[1::2]
    limits = replace(_centred(np.concatenate(known), levels[0].shape[1]), rise=rise, fall=fall)
    largest = [np.array([part.max() for part in limits.distances(rows)]) for rows in judged or known]
    distance, lines = (1.0 + _FEW / len(largest)) * np.quantile(largest, 1.0 - _DISTANCE_EXCEEDED, axis=0)
    return replace(limits, distance=np.array([distance]), lines_distance=np.array([lines]))


def _centred(summaries: Array, levels: int) -> Limits:
    """Return limits with means and covariances only."""
    spread = summaries.std(axis=0)
    scale = np.where(spread > 1e-9, spread, 1.0)
    centre = summaries.mean(axis=0)
    z = (summaries - centre) / scale
    design, lines = _quadratic(summaries[:, 1]), summaries[:, 2 : 1 + levels]
    coefficients = np.asarray(np.linalg.lstsq(design, lines, rcond=None)[0], dtype=np.float64)
    about = lines - design @ coefficients
    covariance = about.T @ about / len(about) + 1e-6 * np.eye(levels - 1)
    none = np.zeros(1)
    return Limits(
        rise=none,
        fall=none,
        centre=centre,
        scale=scale,
        precision=_inverse(z.T @ z / len(z) + _SHRINKAGE * np.eye(z.shape[1])),
        distance=none,
        lines=coefficients,
        lines_precision=_inverse(covariance),
        lines_distance=none,
    )


def _step_limits(lives: Sequence[list[float]]) -> tuple[Array, Array]:
    """Return the limits of rises after each lag, and of falls, from ln RMS of lives."""
    rises, falls = [[0.0] for _ in LAGS], [0.0]
    for levels in lives:
        highest, lowest = [0.0] * len(LAGS), 0.0
        for number, lag in enumerate(LAGS):
            for block in range(lag + _MIN_BLOCKS - 1, len(levels), 1 if lag == 1 else _EVERY):
                end = block - lag + 1
                score = step_score(levels[max(0, end - _CHANGES - 1) : end], levels[block])
                highest[number] = max(highest[number], score or 0.0)
                lowest = min(lowest, score or 0.0) if lag == 1 else lowest
        falls.append(-lowest)
        for found, value in zip(rises, highest, strict=True):
            found.append(value)
    limits = np.maximum.accumulate([np.quantile(found, 1.0 - _RISE_EXCEEDED) for found in rises])
    return limits, np.array([np.quantile(falls, 1.0 - _FALL_EXCEEDED)])


def _summaries(t: Array, levels: Array, interval: float) -> Array:
    """Return the summaries of a life at each of its blocks 5 to 12 and every third beyond, shape (n, d).

    The slopes of the first blocks scatter most.
    """
    history = LevelHistory.empty(levels.shape[1])
    found: list[Array] = []
    for block, row in enumerate(levels):
        history = history.add(float(t[block]), row)
        if block >= _LATEST - 1 and (block < _CHANGES or block % _EVERY == 0):
            found.append(summarise(history, interval))
    return np.array(found)


def _inverse(a: Array) -> Array:
    return np.asarray(np.linalg.inv(a), dtype=np.float64)


def _quadratic(a: Array) -> Array:
    return np.stack((np.ones_like(a), a, a * a), axis=1)


def _distance(z: Array, precision: Array) -> Array:
    return np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", z, precision, z), 0.0))
