"""What recorded runs to failure say of the time to the end: a regression, its spread, and the levels at the end.

With u = ln(TT / elapsed time), "as long again as it has lasted" is P(TT > x) = T / (T + x), a logistic distribution of
u with centre 0 and scale 1: Jeffreys' prior of an unknown lifetime. The regression moves the centre and narrows the
scale; without runs it does neither.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, cast

import numpy as np

from monitor.health.rest.learned.history import INPUTS, Array

MARGIN = math.log(1.5)
"""Distance beyond the runs' elapsed times and levels up to which they are asked."""
LIBRARY_RUNS = 4.0
"""Prior weight of a library in a combination, in equivalent runs."""
MIN_RUNS = 2
"""A single run changes nothing: its errors could be told on no other."""
_LIMITED = 2
"""Inputs, from the first on, of which values beyond the runs are outside: elapsed time and level."""


@dataclass(frozen=True)
class EndLevels:
    """Levels at the end of the runs, natural logarithms; a Student distribution of n - 1 degrees of freedom."""

    count: int = 0
    mean: float = math.nan
    sd: float = math.nan

    def probability_beyond(self, level: float) -> float:
        """Return the probability that a further run ends at or below a level; NaN with fewer than two runs."""
        if self.count < 2 or not math.isfinite(level):
            return math.nan
        spread = self.sd * math.sqrt(1.0 + 1.0 / self.count)
        if spread == 0.0:
            return float(level >= self.mean)
        return student(self.count - 1, (level - self.mean) / spread)


def student(freedom: int, t: float) -> float:
    """Return the probability that a Student variable of ``freedom`` (1 or more) degrees of freedom is at most t.

    The finite sums of Abramowitz and Stegun, 26.7.3 and 26.7.4.
    """
    angle = math.atan(t / math.sqrt(freedom))
    squared = math.cos(angle) ** 2
    odd = freedom % 2
    term = math.cos(angle) if odd else 1.0
    total = term if freedom > 1 else 0.0
    for k in range(2 + odd, freedom - 1, 2):
        term *= squared * (k - 1) / k
        total += term
    between = math.sin(angle) * total
    if odd:
        between = 2.0 / math.pi * (angle + between)
    return 0.5 * (1.0 + between)


@dataclass(frozen=True)
class Distribution:
    """A logistic distribution of u = ln(TT / elapsed).

    Attributes:
        elapsed: s.
        centre, scale: of u.
        outside: the elapsed time or the level lies beyond those of the runs.
    """

    elapsed: float
    centre: float = 0.0
    scale: float = 1.0
    outside: bool = False

    def quantile(self, probability: float) -> float:
        """Return the TT, s, that is not exceeded with a probability."""
        u = self.centre + self.scale * (math.log(probability) - math.log1p(-probability))
        return self.elapsed * math.exp(min(u, 100.0))

    def probability(self, tt: float) -> float:
        """Return the probability that TT is at most a time, s."""
        if tt <= 0.0:
            return 0.0
        z = (math.log(tt / self.elapsed) - self.centre) / self.scale
        return 1.0 / (1.0 + math.exp(-z)) if z > -700.0 else 0.0


@dataclass(frozen=True, eq=False)
class LearnedModel:
    """A regression of u on the inputs of a history, centred; all of shape (len(INPUTS),), the covariance squared.

    Attributes:
        centre: mean of each input over runs, each run once; 0 where no run has it.
        lowest, highest: range of each input over the runs.
        coefficients: of the inputs less their centres.
        covariance: of the coefficients, in units of the squared scale.
        scale: of errors out of run, where the covariance adds nothing.
        runs: what was learned from, as plain values for JSON.
        left_out: what was not: {"run", "reason"}.
        end_levels: of ln(RMS / baseline).
        end_volumes: of ln V_eq in m2, where the runs have it.
        weights: of this model and of a physical forecast in a combination, by out-of-run scores.
        scores: out of run.
        settings: all numbers that the fit depends on.
    """

    centre: Array = field(default_factory=lambda: np.zeros(len(INPUTS)))
    lowest: Array = field(default_factory=lambda: np.full(len(INPUTS), -math.inf))
    highest: Array = field(default_factory=lambda: np.full(len(INPUTS), math.inf))
    coefficients: Array = field(default_factory=lambda: np.zeros(len(INPUTS)))
    covariance: Array = field(default_factory=lambda: np.zeros((len(INPUTS), len(INPUTS))))
    scale: float = 1.0
    runs: tuple[Mapping[str, Any], ...] = ()
    left_out: tuple[Mapping[str, str], ...] = ()
    end_levels: EndLevels = EndLevels()
    end_volumes: EndLevels = EndLevels()
    weights: Mapping[str, float] = field(default_factory=lambda: {"learned": 1.0})
    scores: Mapping[str, Any] = field(default_factory=dict[str, Any])
    settings: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def library_weight(self) -> float:
        """Weight of a library's forecast beside this one: by out-of-run scores, else that of four recorded runs."""
        return float(self.weights.get("library", LIBRARY_RUNS / (LIBRARY_RUNS + len(self.runs))))

    @property
    def prior(self) -> str:
        """What the forecasts rest on, as text."""
        if not self.runs:
            return "no recorded run: as long again as it has lasted"
        if len(self.runs) < MIN_RUNS:
            return f"{len(self.runs)} recorded run, fewer than {MIN_RUNS}: as long again as it has lasted"
        return (
            f"the time to the end as {len(self.runs)} recorded runs ended (not to a threshold of V_eq), drawn towards "
            "as long again as it has lasted"
        )

    def distribution(self, inputs: Array, elapsed: float) -> Distribution:
        """Return the distribution of TT for the inputs of a history; NaN inputs are not known."""
        if len(self.runs) < MIN_RUNS:
            return Distribution(elapsed)
        beyond = np.maximum(inputs - self.highest, 0.0)
        beyond[1] = max(float(beyond[1]), float(self.lowest[1] - inputs[1]))
        excess = float(np.nanmax(np.append(beyond[:_LIMITED], 0.0))) - MARGIN
        deviation = np.clip(inputs, self.lowest, self.highest) - self.centre
        deviation = np.where(np.isfinite(deviation), deviation, 0.0)
        centre = float(deviation @ self.coefficients)
        scale = self.scale * math.sqrt(1.0 + float(deviation @ self.covariance @ deviation))
        # Beyond the runs, gradually as long again as it has lasted.
        trust = math.exp(-max(excess, 0.0) / MARGIN)
        return Distribution(elapsed, centre * trust, scale**trust, outside=excess > 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain values for JSON, bit for bit; NaN and infinite numbers become None."""
        return {
            "inputs": list(INPUTS),
            **{name: _plain(getattr(self, name).tolist()) for name in _ARRAYS},
            "scale": self.scale,
            "runs": [dict(run) for run in self.runs],
            "left_out": [dict(run) for run in self.left_out],
            **{name: _plain(asdict(getattr(self, name))) for name in _ENDS},
            "weights": dict(self.weights),
            "scores": dict(self.scores),
            "settings": dict(self.settings),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> LearnedModel:
        """Restore a model written by :meth:`to_dict`.

        Raises:
            ValueError: other inputs, or arrays of another shape.
        """
        if list(stored["inputs"]) != list(INPUTS):
            raise ValueError(f"inputs {', '.join(INPUTS)} expected, got {', '.join(map(str, stored['inputs']))}")
        missing = {"lowest": -math.inf, "highest": math.inf}
        arrays = {name: np.array(_filled(stored[name], missing.get(name, 0.0)), dtype=np.float64) for name in _ARRAYS}
        for name, array in arrays.items():
            shape = (len(INPUTS),) * (2 if name == "covariance" else 1)
            if array.shape != shape:
                raise ValueError(f"{name} of shape {shape} expected, got {array.shape}")
        ends = {name: EndLevels(**{key: _number(value) for key, value in stored[name].items()}) for name in _ENDS}
        return cls(
            **arrays,
            scale=float(stored["scale"]),
            runs=tuple(stored["runs"]),
            left_out=tuple(stored["left_out"]),
            **ends,
            **{name: stored[name] for name in ("weights", "scores", "settings")},
        )

    @cached_property
    def hash(self) -> str:
        """Hash of the contents."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True, allow_nan=False).encode()).hexdigest()


_ARRAYS = ("centre", "lowest", "highest", "coefficients", "covariance")
_ENDS = ("end_levels", "end_volumes")


def _plain(value: Any) -> Any:
    """Return nested values with None in place of numbers that JSON has not."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        return [_plain(item) for item in cast("list[Any]", value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _filled(value: Any, missing: float) -> Any:
    if isinstance(value, list):
        return [_filled(item, missing) for item in cast("list[Any]", value)]
    return missing if value is None else value


def _number(value: float | None) -> Any:
    return math.nan if value is None else value
