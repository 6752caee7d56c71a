"""The difference between a candidate and the tests, as residuals, and fits that make it least."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from models.identify.evaluate import CandidateLevel, Evaluator, Values
from models.identify.evidence import Evidence
from models.identify.trials import FEATURES, Trials, global_deviation
from models.words.numerics import least_squares_in_cube

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.space import Space

DEFAULT_NOISE = 0.03
"""Relative standard deviation of one test that is assumed until residuals or repetitions say otherwise."""

# Repetitions weigh the features against each other where each has so many degrees of freedom.
_LEAST_FREEDOM = 6
# Difference of the coordinates in the Jacobian: the noise of the features is far below what it changes.
_STEP = 1e-3
_EDGE = 1e-6
# Residuals of a point that Eq. 80 excludes: it is not simulated.
_REFUSED = math.nan


@dataclass(frozen=True, eq=False)
class Fit:
    """A point of the space: coordinates, all parameters (SI), and the sum of its squared residuals."""

    point: NDArray[np.float64]
    values: dict[str, float]
    cost: float


@dataclass(eq=False)
class Problem:
    """Tests, the space that is searched, and the features that are compared.

    Attributes:
        trials: the tests.
        evaluator: of candidates.
        objectives: the features that are compared, of ``FEATURES``.
        evidence: what is known beside the tests.
    """

    trials: Trials
    evaluator: Evaluator
    objectives: tuple[str, ...] = FEATURES
    evidence: Evidence = field(default_factory=Evidence)
    fits: list[Fit] = field(default_factory=list[Fit])

    def __post_init__(self) -> None:
        """Weigh the features by the scatter of repetitions, where it is known."""
        self.columns = [FEATURES.index(name) for name in self.objectives]
        scatter = np.full(len(FEATURES), DEFAULT_NOISE)
        if all(self.trials.freedom[c] >= _LEAST_FREEDOM and self.trials.scatter[c] > 0.0 for c in self.columns):
            scatter = self.trials.scatter
        self.known = self.trials.known[:, self.columns]
        whole = scatter[self.columns] / np.sqrt(np.maximum(self.trials.count[:, self.columns], 1))
        self.deviation = whole[self.known]
        self._measured = np.log(self.trials.mean[:, self.columns][self.known])
        self._healthy = (self.known & ~self.trials.damaged[:, None])[self.known]

    @property
    def features(self) -> int:
        """Number of known features of the tests, of healthy machines too."""
        return int(np.count_nonzero(self.known))

    @property
    def observations(self) -> int:
        """Number of features, measured values and priors that are compared; upper and lower limits are not counted."""
        return int(np.count_nonzero(~self._healthy)) + self.evidence.observations

    def residuals(self, level: CandidateLevel, values: Values) -> NDArray[np.float64]:
        """Return the residuals of a candidate: two for each known feature, then those of the evidence.

        The first half are the logarithms of model over test, over their standard deviation: that of the test, and that
        of a motion that does not repeat beside it. The second half, zero for one that repeats, is the price of the
        latter: twice the logarithm of the likelihood is minus the sum of all squares. A healthy machine also has
        vibration that is not in the model, so its level is an upper limit.
        """
        model = np.log(level.features[:, self.columns][self.known])
        widened = np.square(level.doubt[:, self.columns][self.known] / self.deviation)
        difference = (model - self._measured) / self.deviation
        difference = np.where(self._healthy, np.maximum(difference, 0.0), difference)
        tests = np.concatenate([difference / np.sqrt(1.0 + widened), np.sqrt(np.log1p(widened))])
        return np.concatenate([tests, self.evidence.residuals(self.evaluator.space, values)])

    def cost(self, level: CandidateLevel, values: Values) -> float:
        """Return the sum of the squared residuals of a candidate."""
        return float(np.sum(np.square(self.residuals(level, values))))

    def deviations(self, level: CandidateLevel) -> dict[str, float]:
        """Return Delta RMS and Delta A*, as far as they are objectives, % (Eqs. 55 and 56); {} without tests."""
        damaged = self.trials.damaged
        return {
            name: global_deviation(level.features[damaged, c], self.trials.mean[damaged, c])
            for name, c in zip(self.objectives, self.columns, strict=True)
            if np.any(damaged)
        }

    def costs(self, space: Space, points: Sequence[NDArray[np.float64]]) -> list[Fit | None]:
        """Return the costs of points of a space, at most as large as the problem's own; None outside Eq. 80."""
        decoded = [space.decode(point) for point in points]
        levels = iter(self.evaluator.levels([values for values in decoded if values is not None]))
        return [
            None if values is None else Fit(point, values, self.cost(next(levels), values))
            for point, values in zip(points, decoded, strict=True)
        ]

    def fit(
        self,
        space: Space,
        begin: NDArray[np.float64],
        *,
        calls: int,
        ftol: float = 1e-3,
        xtol: float = 1e-5,
        held: dict[int, float] | None = None,
    ) -> Fit | None:
        """Return the least cost that is found from a point of a space.

        Args:
            space: the problem's own, or one in which some parameters are known.
            calls: limit of the iterations.
            ftol, xtol: relative change of the cost, and change of the point, that end the search.
            held: coordinates that keep their value, by their number.

        Returns:
            The fit, or None where the beginning is outside Eq. 80.
        """
        moved = [i for i in range(len(begin)) if i not in (held or {})]
        start = np.clip(begin, _EDGE, 1.0 - _EDGE)
        for i, value in (held or {}).items():
            start[i] = value

        def whole(part: NDArray[np.float64]) -> NDArray[np.float64]:
            point = start.copy()
            point[moved] = part
            return point

        def residuals(part: NDArray[np.float64]) -> NDArray[np.float64]:
            return self._residuals_of(space, [whole(part)])[0]

        def jacobian(part: NDArray[np.float64]) -> NDArray[np.float64]:
            return self.jacobian(space, whole(part))[:, moved]

        found = start
        if moved:
            if not np.all(np.isfinite(residuals(start[moved]))):
                return None
            if np.any(jacobian(start[moved])):
                part = least_squares_in_cube(residuals, jacobian, start[moved], ftol=ftol, xtol=xtol, calls=calls)
                found = whole(part)
        return self.costs(space, [found])[0]

    def jacobian(self, space: Space, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the derivatives of the residuals by the coordinates, shape (residuals, free)."""
        steps = np.where(point + _STEP <= 1.0, _STEP, -_STEP)
        moved = [point + step * unit for step, unit in zip(steps, np.eye(len(point)), strict=True)]
        base, *others = self._residuals_of(space, [point, *moved])
        columns: list[NDArray[np.float64]] = []
        for i, (other, step) in enumerate(zip(others, steps.tolist(), strict=True)):
            if not np.all(np.isfinite(other)):
                # On the other side; where both are outside Eq. 80, the coordinate stands still.
                back = self._residuals_of(space, [point - step * np.eye(len(point))[i]])[0]
                other, step = (back, -step) if np.all(np.isfinite(back)) else (base, step)
            columns.append((other - base) / step)
        return np.column_stack(columns)

    def _residuals_of(self, space: Space, points: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
        """Return the residuals at points; NaN for those outside Eq. 80, which are not simulated."""
        decoded = [space.decode(point) for point in points]
        levels = iter(self.evaluator.levels([values for values in decoded if values is not None]))
        refused = np.full(2 * self.features + self.evidence.size, _REFUSED)
        return [refused if values is None else self.residuals(next(levels), values) for values in decoded]
