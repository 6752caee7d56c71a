"""What the tests determine: Fisher information at the best fit, and profile likelihoods.

The profile of a parameter is the least cost over all others while it is held. Where it exceeds the least cost of all by
a quantile of Fisher's F distribution times the residual variance, the value is outside the interval; the quantile is
widened by what the choice among valleys of nearly equal depth does to the least cost. The residual
variance is that of the best fit, so it holds the error of the model too. A profile begins at the fits of the global
search that are within the interval already, so it reaches valleys that the neighbourhood of the best fit does not show.

The difference between model and tests has valleys along f_r that noise makes nearly equally deep. The least of all is
then lower than that of the true valley by more than the F distribution of one valley expects, so that intervals from it
would be too narrow. How much lower is found by simulation: the residuals of each valley are taken as linear in the
parameters at the fits that were met, noise of the tests is drawn at the best one, and all valleys are fitted to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.identify.problem import Fit, Problem
from models.identify.search import resonance_axis, shifted
from models.identify.space import SpaceError
from models.words.errors import WrongInputError
from models.words.numerics import f_quantile, gamma_quantile

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.limits import Interval
    from models.identify.space import Space

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


MAX_SHARE = 0.5
"""A parameter is undetermined whose interval is a larger share of what the limits allow it."""
MAX_FACTOR = 4.0
"""A parameter is undetermined, too, whose ends differ by more than this factor: a factor of two either way."""

# First step of a profile over the standard deviation that the Fisher information gives, and growth of the steps.
_FIRST_STEP, _GROWTH = 1.0, 1.8
_MOST_STEPS = 14
# Halvings of the last step, and the root of the cost over that of the threshold from which on it is interpolated.
_HALVINGS, _NEAR = 4, 1.5
# Least and largest first step, as a share of the interval (or of its logarithm).
_LEAST_STEP, _LARGEST_STEP = 0.002, 0.15
_CALLS = 6
# A fit that begins at a limit leaves it slowly, so those of profiles begin so far inside.
_INSIDE = 0.03

Reason = Literal["", "wide", "within its limits"]


@dataclass(frozen=True)
class ParameterInterval:
    """What is known of one parameter, SI.

    Attributes:
        low, high: ends of the interval.
        sd: relative standard deviation by the Fisher information, of alpha_c and the clearance absolute; infinite where
            the features do not change with the parameter.
        at_limit: which ends are limits of Eq. 80, not of what the tests allow.
        reason: why the parameter is undetermined; "" where it is determined.
        profile: (value, cost) of the places that were visited, ascending.
    """

    low: float
    high: float
    sd: float
    at_limit: tuple[bool, bool]
    reason: Reason
    profile: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Threshold:
    """The cost up to which a value is within its interval: the least, and what is added to it."""

    least: float
    added: float
    variance: float

    @property
    def cost(self) -> float:
        """The largest cost within."""
        return self.least + self.added


def threshold(problem: Problem, least: float, level: float, choice: ValleyChoice = ONE_VALLEY) -> Threshold:
    """Return the threshold of profiles at a confidence level.

    Args:
        problem: the tests and the unknowns.
        least: the least cost.
        level: of the intervals.
        choice: what the choice among valleys did to the least cost.

    Raises:
        WrongInputError: if there are no more features than unknowns, so that nothing is left to judge by.
    """
    free = len(problem.evaluator.space.free)
    freedom = problem.observations - free
    if problem.evidence.observations:
        # Uncertainties of the evidence are stated: residuals can only widen them.
        variance = max(1.0, least / freedom) if freedom > 0 else 1.0
        return Threshold(least, 2.0 * variance * gamma_quantile(0.5, level) * choice.widening(level), variance)
    if freedom < 1:
        raise WrongInputError(
            f"{problem.observations} features of the tests cannot determine {free} parameters; "
            f"at least {free + 1} are needed: more conditions, or fewer free parameters"
        )
    left = max(freedom - choice.freedom, 1.0)
    variance = max(least / left, 1e-12)
    return Threshold(least, variance * f_quantile(1.0, left, level) * choice.widening(level), variance)


def fisher_deviations(problem: Problem, best: Fit, variance: float) -> dict[str, float]:
    """Return the standard deviations of the free parameters at a fit.

    They are relative, but absolute (SI) for those that are searched linearly. Infinite where the information about a
    parameter is lost in rounding.
    """
    space = problem.evaluator.space
    jacobian = problem.jacobian(space, best.point)
    transform = coordinate_derivatives(space, best)
    information = jacobian.T @ jacobian / variance
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    good = values > 1e-10
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(scale, scale)
    covariance = transform @ inverse @ transform.T
    lost = np.abs(vectors[:, ~good]).max(axis=1, initial=0.0) > 1e-3
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return {name: math.inf if lost[i] else float(deviation[i]) for i, name in enumerate(space.free)}


def coordinate_derivatives(space: Space, best: Fit) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """Return the derivatives of the parameters (their logarithms, unless linear) by the coordinates."""
    step, count = 1e-4, len(space.free)
    found = np.zeros((count, count))
    base = _scaled(space, best.values)
    for i in range(count):
        way = step if best.point[i] + step <= 1.0 else -step
        values = space.decode(best.point + way * np.eye(count)[i])
        if values is not None:
            found[:, i] = (_scaled(space, values) - base) / way
    return found


def _scaled(space: Space, values: dict[str, float]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.array([values[name] if space.is_linear(name) else math.log(values[name]) for name in space.free])


class _Profile:
    """The profile of one parameter."""

    def __init__(self, problem: Problem, name: str, limit: Threshold, sd: float) -> None:
        self._problem, self._space, self._name, self._limit = problem, problem.evaluator.space, name, limit
        self._linear = self._space.is_linear(name)
        self._low, self._high = (self._scale(end) for end in self._space.bounds(name))
        self._bounds = self._space.bounds(name)
        span = self._high - self._low
        self._step = min(max(_FIRST_STEP * sd if math.isfinite(sd) else math.inf, _LEAST_STEP * span), span)
        self._step = min(self._step, _LARGEST_STEP * span)
        self.visited: dict[float, float] = {}

    def _scale(self, value: float) -> float:
        return value if self._linear else math.log(value)

    def _value(self, scaled: float) -> float:
        return scaled if self._linear else math.exp(scaled)

    def end(self, start: Fit, way: int) -> tuple[float, bool]:
        """Return the end of the interval on one side, and whether it is a limit of the space.

        ``way`` is 1 upwards, -1 downwards.
        """
        inside, begin = self._scale(start.values[self._name]), start
        edge, limit = (self._high, self._bounds[1]) if way > 0 else (self._low, self._bounds[0])
        step = self._step
        for _ in range(_MOST_STEPS):
            if abs(edge - inside) <= 1e-9 * (self._high - self._low):
                return limit, True
            place = inside + way * step
            place = min(place, edge) if way > 0 else max(place, edge)
            found = self._least(place, begin)
            if found is None:
                # What is left of the space ends before the limit.
                edge = 0.5 * (inside + place)
                limit = self._value(edge)
                step *= 0.5
                continue
            if found.cost > self._limit.cost:
                return self._value(self._crossing(inside, begin, place, found.cost)), False
            inside, begin = place, found
            step *= _GROWTH
        return limit, True

    def _crossing(self, inside: float, within: Fit, outside: float, cost: float) -> float:
        """Return where the profile meets the threshold, between a place within and one of a cost outside.

        Near it the root of what the cost exceeds the least by is about linear.
        """
        limit = self._root(self._limit.cost)
        for _ in range(_HALVINGS):
            if self._root(cost) < _NEAR * limit:
                break
            middle = 0.5 * (inside + outside)
            found = self._least(middle, within)
            if found is None or found.cost > self._limit.cost:
                outside, cost = middle, self._limit.cost if found is None else found.cost
            else:
                inside, within = middle, found
        low, high = self._root(within.cost), self._root(cost)
        return inside + (outside - inside) * min(1.0, (limit - low) / max(high - low, 1e-12))

    def _root(self, cost: float) -> float:
        return math.sqrt(max(cost - self._limit.least, 0.0))

    def _least(self, place: float, begin: Fit) -> Fit | None:
        """Return the least cost with the parameter held at a place, from a fit nearby."""
        value = self._value(place)
        space = self._space.fix(self._name, value)
        try:
            point = np.clip(space.encode(begin.values), _INSIDE, 1.0 - _INSIDE)
        except SpaceError:
            return None
        fit = self._problem.fit(space, point, calls=_CALLS, ftol=1e-2, xtol=1e-4)
        axis = resonance_axis(space)
        if fit is not None and fit.cost > self._limit.cost and axis is not None:
            # Another valley of the resonance may be within.
            other = shifted(self._problem, space, fit.point, axis, calls=_CALLS)
            fit = fit if other is None or other.cost > fit.cost else other
        if fit is not None:
            self.visited[value] = min(fit.cost, self.visited.get(value, math.inf))
            self._problem.fits.append(replace(fit, point=self._space.encode(fit.values)))
        return fit


def profile_intervals(problem: Problem, best: Fit, limit: Threshold) -> dict[str, ParameterInterval]:
    """Return the intervals of all free parameters.

    Args:
        problem: searched before; what the profiles meet is added to its fits.
        best: its best fit.
        limit: of the costs within.
    """
    space = problem.evaluator.space
    deviations = fisher_deviations(problem, best, limit.variance)
    found: dict[str, ParameterInterval] = {}
    for name in space.free:
        within = [fit for fit in problem.fits if fit.cost <= limit.cost]
        profile = _Profile(problem, name, limit, deviations[name])
        lowest = min(within, key=lambda fit, name=name: fit.values[name])
        highest = max(within, key=lambda fit, name=name: fit.values[name])
        (low, low_limit), (high, high_limit) = profile.end(lowest, -1), profile.end(highest, 1)
        visited = {**profile.visited, **{fit.values[name]: fit.cost for fit in within}}
        found[name] = ParameterInterval(
            low=low,
            high=high,
            sd=deviations[name],
            at_limit=(low_limit, high_limit),
            reason=undetermined((low, high), space.bounds(name), linear=space.is_linear(name)),
            profile=tuple(sorted(visited.items())),
        )
    return found


def undetermined(interval: Interval, bounds: Interval, *, linear: bool) -> Reason:
    """Return why an interval determines nothing, "" where it does."""
    (low, high), (least, most) = interval, bounds
    if linear:
        return "within its limits" if high - low > MAX_SHARE * (most - least) else ""
    if math.log(high / low) > MAX_SHARE * math.log(most / least):
        return "within its limits"
    return "wide" if high > MAX_FACTOR * low else ""
