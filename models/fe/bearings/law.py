"""Law of one rolling element between both races: the force over the approach of the races, from computed tables.

Each table comes from one mesh, which serves loads about the one that it was made for. Tables that overlap say how far
two meshes disagree at the same load: that is the mesh error of the law.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from models.words.errors import WrongInputError
from models.words.numerics import smooth_curve

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Local exponents n of Q = k delta^n beyond these are not those of a contact of two races: Hertz has 1.5, a line contact
# 1.05 to 1.1, rings that yield lessen both towards 1. Conforming races and the noise of a mesh add to the range.
MIN_EXPONENT, MAX_EXPONENT = 0.8, 2.5
_SAMPLES_PER_INTERVAL = 16
_KNOTS_PER_TABLE = 6
_MAX_INVERSION_STEPS = 60


class LawError(WrongInputError):
    """Tables from which no law can be made: what was expected and what came."""


@dataclass(frozen=True, eq=False)
class LawTable:
    """Approach of the races over the force on an element, from one mesh.

    Attributes:
        loads: N, positive, strictly ascending, shape (n,), two at least.
        approach: of the races, m, positive, strictly ascending, shape (n,).
        made_for: load for which the mesh was made, N.
    """

    loads: NDArray[np.float64]
    approach: NDArray[np.float64]
    made_for: float

    def __post_init__(self) -> None:
        """Refuse tables that do not ascend."""
        _check(self.loads, self.approach)

    def at(self, loads: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the approach, m, under loads, N, of the table's range; logarithmic and smooth between its own."""
        return np.exp(smooth_curve(np.log(self.loads), np.log(self.approach))(np.log(loads)))


@dataclass(frozen=True, eq=False)
class ElementLaw:
    """Force on an element over the approach of both races, twice continuously differentiable between its loads.

    A cubic spline of ln(force) over ln(approach), which reproduces a power law. Below the lowest load and above the
    highest it continues as the power law of its value and slope there: below, that is close to Hertz' own law and
    valid; above, it serves iterations only (``covers``).

    Attributes:
        loads, approach: knots, N and m, ascending, shape (n,).
        mesh_error: largest relative difference of the approach of two meshes at one load, or of a mesh and the law; NaN
            where no two meshes overlap.

    Raises:
        LawError: the knots are not ascending, or their local exponent is not that of a contact.
    """

    loads: NDArray[np.float64]
    approach: NDArray[np.float64]
    mesh_error: float = math.nan

    def __post_init__(self) -> None:
        """Refuse knots that are not those of a contact."""
        _check(self.loads, self.approach)
        x = np.log(self.approach)
        within = np.linspace(0.0, 1.0, _SAMPLES_PER_INTERVAL)
        exponent = self._exponent((x[:-1, None] + np.diff(x)[:, None] * within).ravel())
        low, high = float(np.min(exponent)), float(np.max(exponent))
        if not (low >= MIN_EXPONENT and high <= MAX_EXPONENT):
            raise LawError(
                f"expected a local exponent of the force within {MIN_EXPONENT} and {MAX_EXPONENT}, "
                f"got {low:.3g} to {high:.3g}: loads too far apart, or a mesh too coarse"
            )

    @classmethod
    def from_power(cls, k_c: float, exponent: float, lowest: float, highest: float) -> ElementLaw:
        """Return the analytic law Q = k_c delta^exponent between two loads, N."""
        loads = np.array([lowest, highest])
        return cls(loads, (loads / k_c) ** (1.0 / exponent), 0.0)

    @classmethod
    def from_tables(cls, tables: Sequence[LawTable]) -> ElementLaw:
        """Return the law nearest to tables in ascending order of their loads.

        As cells come into contact one after the other, the approach on one mesh waves about a smooth curve by some
        0.1 %, and its slope by ten times that. A polynomial of ln(approach) over ln(force) of degree two, or three for
        more than two tables, is fitted to all loads; what it leaves over is part of the mesh error.

        Raises:
            LawError: no table, tables out of order, or no law as of the class.
        """
        if not tables:
            raise LawError("expected one table of an element's approach at least, got none")
        errors = [_difference(before, after) for before, after in itertools.pairwise(tables)]
        loads, approach = (np.concatenate([getattr(t, name) for t in tables]) for name in ("loads", "approach"))
        degree = min(3 if len(tables) > 2 else 2, len(loads) - 1)
        fit = np.polynomial.Polynomial.fit(np.log(loads), np.log(approach), degree)
        knots = np.geomspace(float(loads.min()), float(loads.max()), _KNOTS_PER_TABLE * len(tables))
        error = max([float(np.max(np.abs(np.expm1(fit(np.log(loads)) - np.log(approach))))), *errors])
        return cls(knots, np.exp(fit(np.log(knots))), math.nan if not errors or any(map(math.isnan, errors)) else error)

    @property
    def lowest(self) -> float:
        """Lowest load of the tables, N; below it the law is a continuation."""
        return float(self.loads[0])

    @property
    def highest(self) -> float:
        """Highest load of the tables, N; above it the law is not valid."""
        return float(self.loads[-1])

    def covers(self, load: float) -> bool:
        """Return whether the law is valid for a load, N."""
        return 0.0 <= load <= self.highest * (1.0 + 1e-9)

    def force(self, approach: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return forces, N, and their derivatives, N/m, of approaches, m; zero for those not above zero."""
        force, slope = np.zeros_like(approach), np.zeros_like(approach)
        pressed = approach > 0.0
        if np.any(pressed):
            delta = approach[pressed]
            x = np.log(delta)
            force[pressed] = np.exp(self._log_force(x))
            slope[pressed] = force[pressed] * self._exponent(x) / delta
        return force, slope

    def approach_of(self, force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the approach, m, under forces, N, none below zero."""
        approach = np.zeros_like(force)
        loaded = force > 0.0
        if np.any(loaded):
            y = np.log(force[loaded])
            x = np.interp(y, np.log(self.loads), np.log(self.approach))
            for _ in range(_MAX_INVERSION_STEPS):
                step = (y - self._log_force(x)) / self._exponent(x)
                x = x + step
                if float(np.abs(step).max()) <= 1e-14 * (1.0 + float(np.abs(x).max())):
                    break
            approach[loaded] = np.exp(x)
        return approach

    @cached_property
    def _ends(self) -> tuple[float, float]:
        return math.log(float(self.approach[0])), math.log(float(self.approach[-1]))

    @cached_property
    def _curve(self) -> tuple[Any, Any]:
        curve = smooth_curve(np.log(self.approach), np.log(self.loads))
        return curve, curve.derivative()

    def _log_force(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        inside = np.clip(x, *self._ends)
        return self._curve[0](inside) + self._curve[1](inside) * (x - inside)

    def _exponent(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return self._curve[1](np.clip(x, *self._ends))


def _difference(before: LawTable, after: LawTable) -> float:
    """Return the largest relative difference of two tables at loads of both; NaN where they do not overlap."""
    if after.loads[0] <= before.loads[0] or after.loads[-1] <= before.loads[-1]:
        raise LawError(
            f"expected tables in ascending order, got {after.loads[0]:g} to {after.loads[-1]:g} N "
            f"after {before.loads[0]:g} to {before.loads[-1]:g} N"
        )
    low, high = float(after.loads[0]), float(before.loads[-1])
    if low > high:
        return math.nan
    shared = np.geomspace(low, high, _KNOTS_PER_TABLE)
    return float(np.max(np.abs(after.at(shared) / before.at(shared) - 1.0)))


def _check(loads: NDArray[np.float64], approach: NDArray[np.float64]) -> None:
    if loads.ndim != 1 or loads.shape != approach.shape or len(loads) < 2:
        raise LawError(f"expected two or more loads and as many approaches, got {loads.shape} and {approach.shape}")
    for name, values in (("loads", loads), ("approach", approach)):
        if not (np.all(np.isfinite(values)) and values[0] > 0.0 and np.all(np.diff(values) > 0.0)):
            raise LawError(f"expected {name} that are finite, positive and strictly ascending, got {values.tolist()!r}")
