"""A fitted library of simulated lives, as arrays: regressions, and their errors on unseen lives.

It is fitted by ``fit.py`` and stored by ``monitor.records.library_file``.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.size.library.plausible import Limits
from monitor.health.size.library.regression import Regression, accelerated
from monitor.health.size.library.summaries import OFFSET, LevelHistory, extrapolations, summarise

Array = NDArray[np.float64]

LINES = {"rms": 0, "rms+harmonics": 3, "v_eq": 0}
"""The sets of features, and the number of BPFO lines of each."""

MIN_LEVEL = 1e-3
"""Levels are at least this, m/s2, so that the logarithm exists."""
NO_GROWTH = 0.5
"""Probability of no growth from which on there is no time to a threshold."""
_LEVEL_MARGIN = math.log(1.5)
"""Allowed distance of a ln level from those of the lives."""
_MAX_INTERVAL_FACTOR = 3.0
"""Allowed ratio of the block interval to the library's, either way."""
_CONDITION_TOLERANCE = 0.02
"""Allowed distance of load and speed from the library's range, relative."""
_SPREAD_TOLERANCE = (0.06, 0.01)
"""Allowed excess of the standard deviations of ln load and ln speed (10 %, 1.7 % peak)."""
_ELAPSED_WEIGHT = 0.15
"""Weight of a difference in ln elapsed time against one in the prediction, for similarity."""
_MIN_SURVIVORS = 5
_LIFETIME_POWER = 0.5
"""Weights of lifetimes go with this power of 1 / T: 0 counts each life once, 1 each moment of it."""
SPREAD = 0.8
"""Factor on the errors of ln TT: with accelerations and lifetimes beside them, the intervals would be too wide. Both
were found on the development lives of ``benchmarks.unseen.seeds``."""
_AGE_OFFSET = 6.0
"""Intervals in the logarithm of the elapsed time (summaries.summarise)."""
_STAND_WEIGHT = 4.0
"""The same of a difference in the prediction of a standstill, for V_eq: what stands still is smaller than it seems."""
_MOMENTS_PER_NEIGHBOUR, _MIN_NEIGHBOURS = 30, 60
_KNOTS = 12
_MIN_WIDTH = 1e-3
_LOAD, _SPEED = 4000.0, 30.0


@dataclass(frozen=True, eq=False)
class FeatureFit:
    """Fit for one set of features; targets are ln V_eq, for each threshold ln(TT + offset), and 1 at a standstill.

    TT is that of damage that grows: moments of lives that never reach a threshold are none of its target.

    Attributes:
        interval: usual block interval of the lives, s.
        thresholds: V_th, m2, shape (targets - 2,).
        knots: of ``conditions_row``, shape (12,).
        reference: coefficients of ``conditions_row`` that give each level from load and speed, shape (18, K).
        lowest: least level less reference over all lives, shape (K,).
        highest: largest, shape (K,).
        longest: longest elapsed time of a life, s.
        regression: from the summary of a history to the targets.
        said: out-of-fold prediction at each moment, shape (m, targets).
        error: truth less prediction, shape (m, targets); NaN where the threshold is never reached.
        crossed: whether each threshold had been reached, shape (m, targets - 2).
        standing: whether V_eq stood still, shape (m,).
        lifetimes: time from the first block to each threshold, s, inf where never, shape (lives, targets - 2).
        pool: share of those lifetimes in the sample of each threshold, shape (targets - 2,).
        ln_elapsed: logarithm of the elapsed time plus six intervals, in intervals, shape (m,).
        life: number of the life of each moment, shape (m,).
        shift: added to each prediction by the calibration, shape (targets,).
        stretch: factor of the calibration on the errors, shape (targets,).
        limits: of what a life can be, or None: not checked (a history of V_eq).
    """

    features: str
    interval: float
    thresholds: Array
    knots: Array
    reference: Array
    lowest: Array
    highest: Array
    longest: float
    regression: Regression
    said: Array
    error: Array
    crossed: NDArray[np.bool_]
    standing: NDArray[np.bool_]
    lifetimes: Array
    pool: Array
    ln_elapsed: Array
    life: NDArray[np.int64]
    shift: Array
    stretch: Array
    limits: Limits | None = None

    @property
    def channels(self) -> int:
        """Number of levels K."""
        return self.reference.shape[1]

    def relative_levels(self, levels: Array, load: Array, speed: Array) -> Array:
        """Return levels (n, K) less their reference; those of V_eq unchanged."""
        return levels if self.features == "v_eq" else levels - conditions_row(load, speed, self.knots) @ self.reference

    def bounded(self, relative: Array) -> tuple[Array, bool]:
        """Return relative levels (K,) clipped to the lives' range with its margin, and whether they were inside."""
        bounded = np.clip(relative, self.lowest - _LEVEL_MARGIN, self.highest + _LEVEL_MARGIN)
        return bounded, bool(np.array_equal(bounded, relative))

    def covers_pace(self, history: LevelHistory) -> bool:
        """Return whether the elapsed time and the block interval are covered by the lives."""
        if history.elapsed > self.longest:
            return False
        gaps = np.diff(history.recent[:, 0])
        gaps = gaps[gaps > 0.0]
        if not len(gaps):
            return True
        usual = float(np.sort(gaps)[len(gaps) // 2]) / self.interval
        return 1.0 / _MAX_INTERVAL_FACTOR <= usual <= _MAX_INTERVAL_FACTOR

    def inputs(self, history: LevelHistory, load: float, speed: float) -> Array:
        """Return the inputs of the regression, shape (d,)."""
        summary = summarise(history, self.interval)
        if self.features == "v_eq":
            return np.concatenate((summary, *(extrapolations(summary, float(v)) for v in self.thresholds)))
        return np.append(summary, (math.log(load), math.log(speed)))

    def nearest_moments(
        self,
        target: int,
        said: float,
        ln_elapsed: float,
        count: int,
        without: int | None = None,
        stand: float | None = None,
    ) -> NDArray[np.int64]:
        """Return the ``count`` moments with the nearest predictions and elapsed times.

        Args:
            target: 0 for V_eq, 1 and up for the thresholds, the last for a standstill.
            count: limited to one in thirty of all moments, but at least 60 (or all), so that the nearest stay similar.
            without: a life to leave out, for scores out of fold.
            stand: prediction of a standstill that has to be near too.
        """
        order, column, elapsed, life, stands = self._ascending[target]
        total = len(order)
        count = min(count, max(total // _MOMENTS_PER_NEIGHBOUR, _MIN_NEIGHBOURS), total)
        place, reach = int(np.searchsorted(column, said)), 4 * count
        while True:
            low, high = max(place - reach, 0), min(place + reach, total)
            distance = np.abs(column[low:high] - said)
            if 0 < target <= len(self.thresholds):
                distance += _ELAPSED_WEIGHT * np.abs(elapsed[low:high] - ln_elapsed)
            if stand is not None:
                distance += _STAND_WEIGHT * np.abs(stands[low:high] - stand)
            if without is not None:
                distance[life[low:high] == without] = np.inf
            nearest = np.argpartition(distance, count - 1)[:count] if len(distance) >= count else None
            # Moments outside the window differ in the prediction alone by at least as much as its ends.
            beyond = min(said - column[low - 1] if low else np.inf, column[high] - said if high < total else np.inf)
            if nearest is not None and distance[nearest].max() <= beyond:
                return order[low + nearest]
            reach *= 2

    @cached_property
    def _ascending(self) -> list[tuple[NDArray[np.int64], Array, Array, NDArray[np.int64], Array]]:
        """For each target the moments sorted by prediction: order, said, ln_elapsed, life, said of a standstill."""
        found: list[tuple[NDArray[np.int64], Array, Array, NDArray[np.int64], Array]] = []
        for said, error in zip(self.said.T, self.error.T, strict=True):
            order = np.argsort(said, kind="stable")
            order = order[np.isfinite(error[order])]
            found.append((order, said[order], self.ln_elapsed[order], self.life[order], self.said[order, -1]))
        return found

    @cached_property
    def _lifetimes(self) -> list[tuple[Array, Array]]:
        """For each threshold the lifetimes, s, ascending, and their weights."""
        ascending = [np.sort(times[np.isfinite(times)]) for times in self.lifetimes.T]
        return [(times, np.power(np.maximum(times, self.interval), -_LIFETIME_POWER)) for times in ascending]

    def sample_v_eq(
        self, said: float, ln_elapsed: float, stand: float, count: int, without: int | None = None
    ) -> Array:
        """Return an ascending sample of V_eq, m2; ``stand`` is the prediction of a standstill."""
        error = self.error[self.nearest_moments(0, said, ln_elapsed, count, without, stand), 0]
        return np.sort(np.exp(said + self.shift[0] + self.stretch[0] * error))

    def sample_tt(self, target: int, said: float, ln_elapsed: float, count: int, without: int | None = None) -> Array:
        """Return an ascending sample of the time to a target's threshold, s, if V_eq grows; zero where reached."""
        moments = self.nearest_moments(target, said, ln_elapsed, count, without)
        ln_tt = said + self.shift[target] + self.spread(target) * self.error[moments, target]
        tt = np.maximum(np.exp(ln_tt) - OFFSET, 0.0) * self.interval
        crossed = self.crossed[moments, target - 1]
        pooled = self._survivors(target, ln_elapsed, len(moments) - int(np.count_nonzero(crossed)))
        left = np.sort(np.concatenate((tt[~crossed], pooled)))
        return np.sort(np.concatenate((np.zeros(int(np.count_nonzero(crossed))), left, accelerated(left))))

    def spread(self, target: int) -> float:
        """Return the factor on the errors of a target's ln TT."""
        return SPREAD * float(self.stretch[target])

    def _survivors(self, target: int, ln_elapsed: float, beside: int) -> Array:
        """Return what is left of the longer lifetimes, s: so many quantiles that ``pool`` is their share.

        A growth law that the library does not hold misleads the regression; the elapsed time does not.
        """
        times, weights = self._lifetimes[target - 1]
        scale = math.exp(self.shift[target])
        now = (math.exp(ln_elapsed) - _AGE_OFFSET) * self.interval
        first = int(np.searchsorted(times, now / scale, side="right"))
        share = float(self.pool[target - 1])
        count = round(share / (1.0 - share) * beside)
        if count == 0 or len(times) - first < _MIN_SURVIVORS:
            return np.zeros(0)
        passed = np.cumsum(weights[first:])
        levels = (np.arange(count) + 0.5) / count * passed[-1]
        left: Array = scale * times[first:] - now
        return np.asarray(np.interp(levels, passed - 0.5 * weights[first:], left), dtype=np.float64)

    def p_no_growth(self, said: float, count: int, without: int | None = None) -> float:
        """Return the share of similar moments at which V_eq stood still."""
        moments = self.nearest_moments(len(self.thresholds) + 1, said, 0.0, count, without)
        return float(np.mean(self.standing[moments]))


@dataclass(frozen=True, eq=False)
class Library:
    """A fitted library of simulated lives.

    Attributes:
        thresholds: V_th, m2, ascending.
        load: range over its lives, N.
        speed: range over its lives, Hz.
        load_spread: largest standard deviation of ln load within a life.
        speed_spread: the same of the speed.
        prior: its assumptions, as text.
        made_of: all inputs of the fit, as plain values for JSON.
        scores: on lives outside the training folds.
        fits: one per set of features.
        calibration: what recorded runs changed; empty where there were none.
    """

    thresholds: tuple[float, ...]
    load: tuple[float, float]
    speed: tuple[float, float]
    load_spread: float
    speed_spread: float
    prior: str
    made_of: dict[str, Any]
    scores: dict[str, Any]
    fits: dict[str, FeatureFit]
    calibration: dict[str, Any]

    @cached_property
    def hash(self) -> str:
        """Hash of the contents."""
        return _hash(self)

    def at_interval(self, interval: float) -> Library:
        """Return a library whose lives have their blocks at another interval, s, and last as many of them."""
        fits: dict[str, FeatureFit] = {}
        for name, fit in self.fits.items():
            ratio = interval / fit.interval
            fits[name] = replace(fit, interval=interval, longest=ratio * fit.longest, lifetimes=ratio * fit.lifetimes)
        return replace(self, fits=fits)

    def covers_conditions(self, load: float, speed: float) -> bool:
        """Return whether the lives cover a load and a speed."""
        slack = _CONDITION_TOLERANCE
        return all(
            low * (1.0 - slack) <= value <= high * (1.0 + slack)
            for value, (low, high) in ((load, self.load), (speed, self.speed))
        )

    def covers_changes(self, load_spread: float, speed_spread: float) -> bool:
        """Return whether the lives cover these standard deviations of ln load and ln speed."""
        return (
            load_spread <= self.load_spread + _SPREAD_TOLERANCE[0]
            and speed_spread <= self.speed_spread + _SPREAD_TOLERANCE[1]
        )

    def target(self, threshold: float) -> int:
        """Return the index of the target of a threshold (m2).

        Raises:
            ValueError: the library was not fitted for it.
        """
        for number, known in enumerate(self.thresholds, 1):
            if math.isclose(known, threshold, rel_tol=1e-6):
                return number
        known_mm2 = ", ".join(f"{value * 1e6:g}" for value in self.thresholds)
        raise ValueError(f"threshold_mm2 {threshold * 1e6:g} is not in the library, which was fitted for {known_mm2}")

    def fit_for(self, features: str) -> FeatureFit:
        """Return the fit for a set of features.

        Raises:
            ValueError: there is none.
        """
        if features not in self.fits:
            raise ValueError(f"features must be one of {', '.join(self.fits)} in this library, got {features!r}")
        return self.fits[features]


def knots_between(lowest: float, highest: float) -> Array:
    """Return the knots of a range of speeds (Hz): logarithms, shape (12,)."""
    return np.linspace(math.log(lowest), math.log(highest), _KNOTS)


def conditions_row(load: Array, speed: Array, knots: Array) -> Array:
    """Return the regressors of the reference levels, shape (n, 6 + knots).

    1, a, b, a2, b2 and ab of the logarithms of load and speed, and a Gaussian around each knot: the lines of BPFO pass
    through resonances as the speed changes.
    """
    a, b = np.log(load / _LOAD), np.log(speed / _SPEED)
    width = max(float(knots[1] - knots[0]), _MIN_WIDTH)
    bells = np.exp(-0.5 * ((np.log(speed)[:, None] - knots) / width) ** 2)
    return np.concatenate((np.stack((np.ones_like(a), a, b, a * a, b * b, a * b), axis=1), bells), axis=1)


def levels_of(features: str, rms: Array, harmonics: Array, v_eq: Array) -> Array:
    """Return the logarithms of the levels of a set of features, shape (n, K).

    Args:
        rms: m/s2, shape (n,).
        harmonics: m/s2, shape (n, lines or more).
        v_eq: m2, shape (n,).
    """
    if features == "v_eq":
        return np.log(v_eq)[:, None]
    levels = np.concatenate((rms[:, None], harmonics[:, : LINES[features]]), axis=1)
    return np.log(np.maximum(levels, MIN_LEVEL))


def quantiles_of(sample: Array, levels: Sequence[float]) -> Array:
    """Return quantiles of an ascending sample, linear between its values."""
    return np.interp(levels, np.linspace(0.0, 1.0, len(sample)), sample)


def arrays_of(fit: FeatureFit) -> dict[str, NDArray[Any]]:
    """Return the arrays of a fit by name, those of its parts with a prefix."""
    found: dict[str, NDArray[Any]] = {}
    for field in fields(fit):
        value = getattr(fit, field.name)
        if isinstance(value, (Regression, Limits)):
            found |= {f"{field.name}.{part.name}": getattr(value, part.name) for part in fields(value)}
        elif isinstance(value, np.ndarray):
            found[field.name] = value
    return found


def header_of(library: Library) -> dict[str, Any]:
    """Return a library without its arrays, as plain values for JSON."""
    return {
        "thresholds": list(library.thresholds),
        "load": list(library.load),
        "speed": list(library.speed),
        "load_spread": library.load_spread,
        "speed_spread": library.speed_spread,
        "prior": library.prior,
        "made_of": library.made_of,
        "scores": library.scores,
        "calibration": library.calibration,
        "fits": {name: {"interval": fit.interval, "longest": fit.longest} for name, fit in library.fits.items()},
    }


def _hash(library: Library) -> str:
    digest = hashlib.sha256(json.dumps(header_of(library), sort_keys=True).encode())
    for name in sorted(library.fits):
        for key, value in sorted(arrays_of(library.fits[name]).items()):
            digest.update(f"{name} {key} {value.dtype.str} {value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()
