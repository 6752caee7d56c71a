"""Tests of a machine with known defects, and the features that are compared with the model (thesis, Eqs. 54 to 58)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.scene import Part

if TYPE_CHECKING:
    from numpy.typing import NDArray

FEATURES = ("rms", "a_star")
A_STAR_LINES = 5
"""Lines of the damaged part in A* (Eq. 57)."""


@dataclass(frozen=True)
class Condition:
    """A defect at an operating point: load, N; shaft speed, Hz; extent, rad; depth, m; the damaged part.

    Without extent the bearing is healthy.
    """

    load: float
    speed: float
    dphi_d: float
    h_d: float
    part: Part = "outer"

    @property
    def healthy(self) -> bool:
        """Whether there is no defect: the model's level is then the least that a machine can have."""
        return self.dphi_d == 0.0


@dataclass(frozen=True)
class Trial:
    """One repetition of a condition: RMS and A*, m/s2; NaN where a feature is not known."""

    condition: Condition
    rms: float
    a_star: float


@dataclass(frozen=True, eq=False)
class Trials:
    """Tests by condition.

    Attributes:
        conditions: in the order in which they were first met.
        mean: means over the repetitions (Eq. 54 with its missing 1/n_rep), m/s2, shape (conditions, features); NaN
            where no repetition has the feature.
        count: repetitions with the feature, shape (conditions, features).
        scatter: relative standard deviation of one repetition, pooled over all conditions, shape (features,); NaN
            where nothing was repeated.
        freedom: degrees of freedom of ``scatter``, shape (features,).
    """

    conditions: tuple[Condition, ...]
    mean: NDArray[np.float64]
    count: NDArray[np.int64]
    scatter: NDArray[np.float64]
    freedom: NDArray[np.int64]

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which features of which conditions are known, shape (conditions, features)."""
        return self.count > 0

    @property
    def damaged(self) -> NDArray[np.bool_]:
        """Which conditions have a defect, shape (conditions,)."""
        return np.array([not condition.healthy for condition in self.conditions], dtype=np.bool_)


def no_trials() -> Trials:
    """Return tests of no condition: a rig is then identified from other evidence."""
    shape, unknown = (0, len(FEATURES)), np.full(len(FEATURES), np.nan)
    count = np.zeros(shape, dtype=np.int64)
    return Trials((), np.empty(shape), count, unknown, np.zeros(len(FEATURES), dtype=np.int64))


def gather(tests: Iterable[Trial]) -> Trials:
    """Return tests by condition, with the means of Eq. 54.

    Raises:
        ValueError: if there is none, or a feature is not positive.
    """
    by_condition: dict[Condition, list[tuple[float, float]]] = {}
    for test in tests:
        for name in FEATURES:
            value = getattr(test, name)
            if not (math.isnan(value) or (value > 0.0 and math.isfinite(value))):
                raise ValueError(f"{name} must be positive and finite, got {value!r} m/s2")
        by_condition.setdefault(test.condition, []).append((test.rms, test.a_star))
    if not by_condition:
        raise ValueError("there are no tests")
    shape = len(by_condition), len(FEATURES)
    mean, count = np.full(shape, np.nan), np.zeros(shape, dtype=np.int64)
    squares, freedom = np.zeros(len(FEATURES)), np.zeros(len(FEATURES), dtype=np.int64)
    for k, repetitions in enumerate(by_condition.values()):
        for f, column in enumerate(zip(*repetitions, strict=True)):
            values = np.array([value for value in column if not math.isnan(value)])
            if values.size == 0:
                continue
            mean[k, f], count[k, f] = average(values.tolist()), values.size
            squares[f] += float(np.sum((values / mean[k, f] - 1.0) ** 2))
            freedom[f] += values.size - 1
    scatter = np.sqrt(np.where(freedom > 0, squares / np.maximum(freedom, 1), np.nan))
    return Trials(tuple(by_condition), mean, count, scatter, freedom)


def average(values: Sequence[float]) -> float:
    """Return the mean of a feature over the repetitions of a test (Eq. 54, in which 1/n_rep is missing)."""
    return math.fsum(values) / len(values)


def root_mean_square(signal: NDArray[np.float64]) -> float:
    """Return the RMS of a signal (Eq. 58)."""
    return float(np.sqrt(np.mean(np.square(signal))))


def a_star(lines: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return A* of the amplitudes of lines 1.. of the damaged part, shape (..., lines) (Eq. 57)."""
    return np.sqrt(np.sum(np.square(lines[..., :A_STAR_LINES]), axis=-1))


def a_star_above_noise(lines: NDArray[np.float64], floor: NDArray[np.float64]) -> float:
    """Return A* of measured amplitudes whose noise, of the amplitudes ``floor``, is taken off in power.

    NaN where no more is left of the five lines together.
    """
    power = float(np.sum(np.square(lines[:A_STAR_LINES]) - np.square(floor[:A_STAR_LINES])))
    return math.sqrt(power) if power > 0.0 else math.nan


def deviations(model: NDArray[np.float64], measured: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the differences of a feature between model and tests, %, of each condition (Eq. 55)."""
    return np.abs((model - measured) / measured) * 100.0


def global_deviation(model: NDArray[np.float64], measured: NDArray[np.float64]) -> float:
    """Return the mean difference over the conditions, %: Delta RMS or Delta A* (Eq. 56), without unknown features."""
    return float(np.nanmean(deviations(model, measured)))
