"""What the choice among many valleys of the difference does to its least value.

The difference between model and tests has valleys along f_r that noise makes nearly equally deep. The least of all is
then lower than that of the true valley by more than the F distribution of one valley expects, so that intervals from it
would be too narrow. How much lower is found by simulation: the residuals of each valley are taken as linear in the
parameters at the fits that were met, noise of the tests is drawn at the best one, and all valleys are fitted to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.words.numerics import f_quantile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.problem import Fit, Problem

# Valleys are so far apart in f_r at least; and by how many variances one may be above the least cost to count.
_APART, _DEEP = 0.003, 25.0
_MOST_VALLEYS, _DRAWS = 40, 4000
# Singular values below this share of the largest are lost in rounding.
_LOST = 1e-8
# More degrees of freedom than this make F that of a known variance.
_MANY = 1e9


@dataclass(frozen=True, eq=False)
class ValleyChoice:
    """By how much the least of all valleys is below that of the true one, over the variance of the tests.

    Attributes:
        excess: draws, shape (n,); all zero where there is one valley.
    """

    excess: NDArray[np.float64]

    @property
    def freedom(self) -> float:
        """Degrees of freedom that the choice takes from the residuals."""
        return float(np.mean(self.excess))

    def widening(self, level: float) -> float:
        """Return by what factor a threshold at a level grows against that of one valley, at least 1.

        The difference of a held parameter in the true valley (chi-squared with one degree of freedom) and the excess
        are taken as independent.
        """
        single = f_quantile(1.0, _MANY, level)
        low, high = single, single + float(np.max(self.excess))
        while high - low > 1e-6 * high:
            middle = 0.5 * (low + high)
            left = np.maximum(middle - self.excess, 0.0)
            share = float(np.mean([math.erf(math.sqrt(0.5 * value)) for value in left.tolist()]))
            low, high = (middle, high) if share < level else (low, middle)
        return high / single


ONE_VALLEY = ValleyChoice(np.zeros(1))


def valley_choice(problem: Problem, best: Fit, seed: int) -> ValleyChoice:
    """Return what the choice among the valleys that were met does to the least cost.

    Args:
        problem: searched before.
        best: its best fit.
        seed: of the draws of noise.
    """
    if not np.any(problem.trials.damaged):
        return ONE_VALLEY
    space = problem.evaluator.space
    variance = max(best.cost / max(problem.observations - len(space.free), 1), 1e-12)
    valleys = _valleys(problem, best, variance)
    if len(valleys) < 2:
        return ONE_VALLEY
    levels = problem.evaluator.levels([fit.values for fit in valleys])
    residuals = [problem.residuals(level, fit.values) for level, fit in zip(levels, valleys, strict=True)]
    noise = np.zeros((_DRAWS, len(residuals[0])))
    # The second residuals of the features are the price of motions that do not repeat, and have no noise.
    noisy = np.r_[0 : problem.features, 2 * problem.features : noise.shape[1]]
    noise[:, noisy] = np.random.default_rng([seed, 38]).standard_normal((_DRAWS, len(noisy)))
    noise *= math.sqrt(variance)
    costs: list[NDArray[np.float64]] = []
    for fit, residual in zip(valleys, residuals, strict=True):
        apart = noise + (residual - residuals[0])
        tangent = _tangent(problem.jacobian(space, fit.point))
        costs.append(np.sum(apart**2, axis=1) - np.sum((apart @ tangent) ** 2, axis=1))
    return ValleyChoice((costs[0] - np.min(costs, axis=0)) / variance)


def _valleys(problem: Problem, best: Fit, variance: float) -> list[Fit]:
    """Return the best fit and the best of others in steps of f_r, as far as they are deep."""
    space = problem.evaluator.space

    def resonance(fit: Fit) -> float:
        return float(np.mean(space.resonances(fit.values)))

    found, taken = [best], [resonance(best)]
    for fit in sorted(problem.fits, key=lambda fit: fit.cost):
        if fit.cost > best.cost + _DEEP * variance or len(found) == _MOST_VALLEYS:
            break
        place = resonance(fit)
        if all(abs(place / other - 1.0) > _APART for other in taken):
            found.append(fit)
            taken.append(place)
    return found


def _tangent(jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an orthonormal basis of the columns of a Jacobian, shape (residuals, rank)."""
    basis, values, _ = np.linalg.svd(jacobian, full_matrices=False)
    return basis[:, values > _LOST * max(float(values[0]), 1e-300)]
