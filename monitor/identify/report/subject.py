"""What a report of an identification shows: parameters with their words, candidates as arrays, defects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.identify.limits import Interval
from models.identify.problem import Problem
from models.identify.run import Identification, IdentifyOptions
from models.identify.trials import FEATURES, Condition, Trial
from models.machine.scene import Part
from monitor.words.numbers import count, figure
from monitor.words.statuses import FAULT_NAMES

Values = NDArray[np.float64]

# Of alpha_c, 1/s, and the clearance, um.
_AS_GOOD_AS_ZERO = 1e-4
_CONTACT_UNITS = {"ball": "N/m^1.5", "roller": "N/m^1.09"}
TITLES = {"rms": "RMS", "a_star": "A*"}
"""Words of the features."""
ENDS = ("lower", "upper")


@dataclass(frozen=True)
class Parameter:
    """A parameter as it is shown, what it is in words, and ``factor``, which takes it from SI to ``unit``."""

    name: str
    symbol: str
    unit: str
    factor: float
    meaning: str

    @property
    def label(self) -> str:
        """Symbol and unit."""
        return f"{self.symbol} ({self.unit})"

    def number(self, value: float) -> str:
        """Return a value (SI) in its unit, without it; 0 for what is as good as zero, where zero is a value."""
        shown = self.factor * value
        return "0" if self.name in ("alpha_c", "clearance") and shown < _AS_GOOD_AS_ZERO else figure(shown)

    def write(self, value: float) -> str:
        """Return a value (SI) with its unit."""
        return f"{self.number(value)} {self.unit}"


_PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter("m_i", "m_i", "kg", 1.0, "mass of shaft and inner ring"),
        Parameter("m_o", "m_o", "kg", 1.0, "mass of outer ring and casing"),
        Parameter("m_r", "m_r", "kg", 1.0, "mass of the resonator"),
        Parameter("m_b", "m_b", "kg", 1.0, "mass of a rolling element"),
        Parameter("k_i", "k_i", "MN/m", 1e-6, "stiffness of the shaft"),
        Parameter("k_r", "k_r", "GN/m", 1e-9, "stiffness of the resonator"),
        Parameter("k_c", "k_c", "", 1.0, "contact stiffness"),
        Parameter("c_i", "c_i", "N\u00a0s/m", 1.0, "damping of the shaft"),
        Parameter("c_r", "c_r", "N\u00a0s/m", 1.0, "damping of the resonator"),
        Parameter("alpha_c", "α_c", "1/s", 1.0, "contact damping by mass"),
        Parameter("beta_c", "β_c", "µs", 1e6, "contact damping by stiffness"),
        Parameter("clearance", "clearance", "µm", 1e6, "radial clearance"),
    )
}


@dataclass(frozen=True)
class Extent:
    """A defect of the tests, whatever load and speed: extent in rad, depth in m."""

    part: Part
    dphi_d: float
    h_d: float

    @classmethod
    def of(cls, condition: Condition) -> Extent:
        """Return the defect of a condition."""
        return cls(condition.part, condition.dphi_d, condition.h_d)


@dataclass(frozen=True, eq=False)
class Candidates:
    """All candidates that the run simulated.

    Attributes:
        values: of each parameter, SI, shape (candidates,).
        cost: sum of squared residuals, shape (candidates,).
        objectives: differences, %, shape (candidates, objectives).
        features: m/s2, shape (candidates, conditions, features).
        sharp: whether the motion repeats at all conditions, shape (candidates,).
        near: whether the cost is within the intervals, shape (candidates,).
        least: what costs are counted from.
        added: what is added to ``least`` at the ends of the intervals.
    """

    values: Mapping[str, Values]
    cost: Values
    objectives: Values
    features: NDArray[np.float64]
    sharp: NDArray[np.bool_]
    near: NDArray[np.bool_]
    least: float
    added: float

    @property
    def excess(self) -> Values:
        """Cost over the least, 1 at the ends of the intervals."""
        return (self.cost - self.least) / self.added

    def values_of(self, row: int) -> dict[str, float]:
        """Return all parameters of a candidate, SI."""
        return {name: float(column[row]) for name, column in self.values.items()}


@dataclass(frozen=True, eq=False)
class Subject:
    """An identification and what its report needs beside it.

    Attributes:
        trials: one a test, with its repetitions; those that ``found`` rests on.
        keys: names of the free parameters in the configuration.
        reasons: why a parameter is undetermined, in words, by the reason.
        machine: its name.
        recordings: tests whose features were taken from recordings.
        race_radius: by which widths of defects were divided, m; None where extents are given.
        rig_file: file with the identified ``[rig]``, "" for none.
        calibrated: whether the model meets the tests well enough to be called calibrated.
        warnings: what speaks against the result, in sentences.
    """

    found: Identification
    options: IdentifyOptions
    trials: Sequence[Trial]
    keys: Mapping[str, str]
    reasons: Mapping[str, str]
    machine: str
    recordings: int = 0
    race_radius: float | None = None
    rig_file: str = ""
    calibrated: bool = True
    warnings: tuple[str, ...] = ()

    @property
    def problem(self) -> Problem:
        """The tests with all that was simulated."""
        return self.found.problem

    @property
    def objectives(self) -> tuple[str, ...]:
        """Names of the features that are compared."""
        return self.problem.objectives

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The free parameters, in the order of the search."""
        return tuple(self.parameter(name) for name in self.found.space.free)

    def parameter(self, name: str) -> Parameter:
        """Return how a parameter is shown."""
        if name == "k_c":
            return replace(_PARAMETERS[name], unit=_CONTACT_UNITS[self.found.space.rig.element])
        return _PARAMETERS[name]

    def bounds(self, name: str) -> Interval:
        """Return what the limits allow a free parameter, SI."""
        return self.found.space.bounds(name)

    @cached_property
    def candidates(self) -> Candidates:
        """All candidates, in the order in which they were simulated."""
        evaluator, found = self.problem.evaluator, self.found
        levels = list(evaluator.kept.values())
        names = list(found.space.known)
        table = np.array(list(evaluator.kept), dtype=np.float64).reshape(len(levels), len(names))
        cost = np.array(
            [
                self.problem.cost(level, dict(zip(names, row, strict=True)))
                for level, row in zip(levels, table.tolist(), strict=True)
            ]
        )
        return Candidates(
            values={name: table[:, i] for i, name in enumerate(names)},
            cost=cost,
            objectives=np.array([list(self.problem.deviations(level).values()) for level in levels]),
            features=np.array([level.features for level in levels]),
            sharp=np.array([not np.any(level.doubt > 0.0) for level in levels]),
            near=cost <= found.limit.cost,
            least=found.limit.least,
            added=found.limit.added,
        )

    @cached_property
    def draws(self) -> dict[str, Values]:
        """The draws of the posterior of each free parameter, SI, shape (draws,)."""
        posterior = self.found.posterior
        table = np.array(posterior.rows, dtype=np.float64).reshape(-1, len(posterior.names))
        return {name: table[:, i] for i, name in enumerate(posterior.names)}

    def middle(self, values: Values) -> Interval:
        """Return the ends of what the level of the intervals leaves of draws, as much beyond either."""
        beyond = 50.0 * (1.0 - self.options.level)
        low, high = np.percentile(values, (beyond, 100.0 - beyond)).tolist()
        return low, high

    @cached_property
    def drawn_modes(self) -> Values:
        """The mean of f_r over loads and directions of each draw of the posterior, Hz, shape (draws,)."""
        rows = zip(*self.draws.values(), strict=True)
        best = self.found.best.values
        found = [self.found.space.resonances({**best, **dict(zip(self.draws, row, strict=True))}) for row in rows]
        return np.mean(found, axis=1)

    @cached_property
    def highest_modes(self) -> tuple[float, float]:
        """The extremes of f_r over loads, directions and all candidates within the intervals, Hz."""
        near = np.flatnonzero(self.candidates.near)
        found = [f for row in near for f in self.found.space.resonances(self.candidates.values_of(int(row)))]
        found += list(self.found.resonances)
        return min(found), max(found)

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions of the tests."""
        return self.problem.trials.conditions

    @property
    def damaged(self) -> tuple[Condition, ...]:
        """The conditions with a defect."""
        return tuple(condition for condition in self.conditions if not condition.healthy)

    @cached_property
    def extents(self) -> tuple[Extent, ...]:
        """The defects, by part, extent and depth; a healthy machine is none."""
        found = {Extent.of(c) for c in self.damaged}
        return tuple(sorted(found, key=lambda e: (e.part, e.dphi_d, e.h_d)))

    def extent_words(self, extent: Extent) -> str:
        """Return a defect as text: its extent, and what tells it from the others; or "healthy"."""
        if extent.dphi_d == 0.0:
            return "healthy"
        words = f"{figure(math.degrees(extent.dphi_d))}°"
        if len({e.h_d for e in self.extents}) > 1:
            words += f" × {figure(extent.h_d * 1e6)} µm"
        if len({e.part for e in self.extents}) > 1 or extent.part != "outer":
            words += f", {FAULT_NAMES[extent.part]}"
        return words

    def rows_of(self, extent: Extent) -> NDArray[np.intp]:
        """Return the numbers of the conditions of a defect."""
        return np.flatnonzero([Extent.of(c) == extent for c in self.conditions])

    def measured(self, feature: str) -> Values:
        """Return the mean of a feature over the repetitions, m/s2, shape (conditions,); NaN where it is not known."""
        return self.problem.trials.mean[:, FEATURES.index(feature)]

    def modelled(self, feature: str) -> Values:
        """Return a feature of the best fit, m/s2, shape (conditions,)."""
        return self.found.features[:, FEATURES.index(feature)]

    def repetitions(self, feature: str) -> list[tuple[Condition, float]]:
        """Return condition and value, m/s2, of all tests that have a feature."""
        found = [(trial.condition, float(getattr(trial, feature))) for trial in self.trials]
        return [(condition, value) for condition, value in found if math.isfinite(value)]

    @property
    def tests_words(self) -> str:
        """How many tests at how many conditions, and what else was given."""
        words = f"{count(len(self.trials), 'test')} at {count(len(self.conditions), 'condition')}"
        healthy, evidence = len(self.conditions) - len(self.damaged), self.problem.evidence
        if healthy:
            words += f" ({healthy} of the healthy machine)"
        for number, noun in ((len(evidence.peaks), "resonance"), (len(evidence.priors), "prior")):
            words += f", {count(number, noun)}" if number else ""
        return words
