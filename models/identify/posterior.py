"""Draws of the posterior of an identification.

The residuals are Gaussian with one unknown factor on their standard deviations, whose prior is 1 / factor; the prior of
the parameters is uniform in the coordinates of the cube, whose points all meet Eq. 80. Integrated over the factor, the
posterior of a point is the sum S of its squared residuals to the power -n/2, n being the number of features. For a
linear model it is Student's t with n - p degrees of freedom, whose intervals are the profile intervals with Fisher's F.
Where resonances or priors with stated uncertainties are among the evidence, the factor is that of the best fit.
Intervals are widened for the choice among valleys; the posterior has no counterpart, as it holds all of them.

Candidates are drawn from a mixture of Laplace approximations at the valleys that the search has visited, simulated and
weighted by posterior over density (importance sampling). The mixture is then fitted to the weighted candidates, and so
on, until the effective number of candidates is large enough; all candidates count, by the density of all mixtures
together (adaptive multiple importance sampling; Cornuet et al., Scand. J. Statist. 39, 2012). In coordinates that the
tests do not determine, a component is uniform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.identify.problem import Fit, Problem
from models.machine.rig import rounded

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.intervals import Threshold

    Floats = NDArray[np.float64]

DRAWS = 256
"""Draws that are kept."""
ENOUGH = 200.0
"""Effective number of candidates at which sampling ends."""

# Candidates simulated in a round: these, and so many more per free parameter; rounds at least and at most.
_ROUND, _ROUND_PER_FREE, _LEAST_ROUNDS, _MOST_ROUNDS = 64, 40, 2, 10
# Draws of the mixture for each candidate that is wanted: most of those outside the cube cost nothing.
_MOST_DRAWN = 60
# Valleys that components begin at, and their least distance in standard deviations.
_MOST_VALLEYS, _APART = 12, 2.0
# Precision of a uniform distribution on a coordinate; standard deviation from which on a component is uniform in it.
_PRIOR_PRECISION, _FLAT = 12.0, 0.2
# Degrees of freedom of the components: heavy tails.
_TAIL = 4.0
# Share that a component keeps of its weight of the round before, and least shares.
_KEPT, _LEAST_SHARE = 0.15, 0.01
# Weight of a candidate from which it begins a component, how many begin in a round, and their largest share.
_HEAVY, _MOST_BEGUN, _MOST_SHARE = 0.02, 4, 0.2
_SEED_WORD = 1506


@dataclass(frozen=True, eq=False)
class Drawn:
    """Draws of a posterior.

    Attributes:
        rows: values of the free parameters, SI, shape (draws, free), in random order.
        effective: effective number of independent candidates.
        candidates: that were simulated.
    """

    rows: Floats
    effective: float
    candidates: int


@dataclass(frozen=True, eq=False)
class _Component:
    """Uniform in some coordinates; in the others Student's t about a place that is linear in the former.

    Attributes:
        told: the coordinates that are not uniform, shape (free,).
        mean: of those where the uniform ones are 1/2, shape (told,).
        slope: their change with the uniform ones, shape (told, others).
        root: Cholesky factor of their scale matrix, shape (told, told).
    """

    told: NDArray[np.bool_]
    mean: Floats
    slope: Floats
    root: Floats

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        """Return points, shape (count, free), some of them outside the cube."""
        points = rng.uniform(size=(count, len(self.told)))
        normal = rng.standard_normal((count, len(self.mean)))
        tail = np.sqrt(_TAIL / rng.chisquare(_TAIL, (count, 1)))
        points[:, self.told] = self._centre(points) + tail * normal @ self.root.T
        return points

    def log_density(self, points: Floats) -> Floats:
        """Return the logarithm of the density at points of the cube, shape (count,)."""
        size = len(self.mean)
        if size == 0:
            return np.zeros(len(points))
        away = np.linalg.solve(self.root, (points[:, self.told] - self._centre(points)).T)
        constant = math.lgamma(0.5 * (_TAIL + size)) - math.lgamma(0.5 * _TAIL) - 0.5 * size * math.log(_TAIL * math.pi)
        constant -= float(np.sum(np.log(np.diag(self.root))))
        return constant - 0.5 * (_TAIL + size) * np.log1p(np.sum(away**2, axis=0) / _TAIL)

    def _centre(self, points: Floats) -> Floats:
        return self.mean + (points[:, ~self.told] - 0.5) @ self.slope.T


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Components and their shares, of sum 1."""

    components: tuple[_Component, ...]
    shares: Floats

    def draw(self, rng: np.random.Generator, count: int) -> Floats:
        numbers = rng.multinomial(count, self.shares)
        return np.concatenate([c.draw(rng, int(n)) for c, n in zip(self.components, numbers, strict=True)])

    def log_parts(self, points: Floats) -> Floats:
        """Return the logarithm of share times density of each component, shape (components, count)."""
        with np.errstate(divide="ignore"):
            return np.log(self.shares)[:, None] + np.array([c.log_density(points) for c in self.components])

    def log_density(self, points: Floats) -> Floats:
        """Return the logarithm of the density, shape (count,)."""
        return _log_sum(self.log_parts(points))


@dataclass(eq=False)
class _Sample:
    """Candidates of all rounds.

    Attributes:
        points: admissible ones, shape (count, free).
        values: their free parameters, shape (count, free).
        log_target: logarithm of the posterior at them.
        mixtures: of the rounds, each with the number of its draws, admissible or not.
    """

    points: Floats
    values: Floats
    log_target: Floats
    mixtures: list[tuple[_Mixture, int]]

    def weights(self) -> Floats:
        """Return the weights, of sum 1."""
        total = sum(count for _, count in self.mixtures)
        parts = [math.log(count / total) + mixture.log_density(self.points) for mixture, count in self.mixtures]
        log_weights = self.log_target - _log_sum(np.array(parts))
        weights = np.exp(log_weights - np.max(log_weights))
        return weights / np.sum(weights)


def draw_posterior(problem: Problem, best: Fit, limit: Threshold, *, seed: int, count: int = DRAWS) -> Drawn:
    """Return draws of the posterior; they depend on the problem with its fits and the seed only.

    Args:
        problem: searched and profiled before: components begin at those of its fits that are within the limit.
        best: its best fit.
        limit: of the profile intervals.
        count: draws that are returned.
    """
    space = problem.evaluator.space
    rng = np.random.default_rng([seed, _SEED_WORD])
    size = _ROUND + _ROUND_PER_FREE * len(space.free)
    mixture = _first_mixture(problem, best, limit)
    sample = _Sample(np.empty((0, len(space.free))), np.empty((0, len(space.free))), np.empty(0), [])
    weights, effective = np.empty(0), 0.0
    for number in range(_MOST_ROUNDS):
        _add_round(problem, sample, mixture, rng, size, (best, limit))
        weights = sample.weights()
        effective = 1.0 / float(np.sum(weights**2))
        if number + 1 >= _LEAST_ROUNDS and effective >= ENOUGH:
            break
        mixture = _begun(problem, _fitted(mixture, sample.points, _truncated(weights)), sample.points, weights, limit)
    weights = _truncated(weights)
    places = (rng.uniform() + np.arange(count)) / count
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)
    rows = sample.values[rng.permutation(chosen)]
    return Drawn(np.vectorize(rounded)(rows), effective, len(weights))


def _add_round(
    problem: Problem,
    sample: _Sample,
    mixture: _Mixture,
    rng: np.random.Generator,
    size: int,
    known: tuple[Fit, Threshold],
) -> None:
    """Draw from a mixture until so many candidates are admissible, and simulate these."""
    space, (best, limit) = problem.evaluator.space, known
    points: list[Floats] = []
    drawn = 0
    while len(points) < size and drawn < _MOST_DRAWN * size:
        proposed = mixture.draw(rng, size)
        drawn += size
        inside = np.all((proposed >= 0.0) & (proposed <= 1.0), axis=1)
        points += [point for point in proposed[inside] if space.decode(point) is not None]
    # Where nothing else is admissible, the best fit is.
    fits = [fit for fit in problem.costs(space, points) if fit is not None] or [best]
    costs = np.maximum([fit.cost for fit in fits], 1e-6 * best.cost + 1e-12)
    rows = np.array([[fit.values[name] for name in space.free] for fit in fits])
    sample.points = np.concatenate([sample.points, np.array([fit.point for fit in fits])])
    sample.values = np.concatenate([sample.values, rows])
    sample.log_target = np.concatenate([sample.log_target, _log_posterior(problem, costs, limit)])
    sample.mixtures.append((mixture, drawn))


def _log_posterior(problem: Problem, costs: Floats, limit: Threshold) -> Floats:
    """Return the logarithm of the posterior at sums of squares; with evidence the standard deviations are stated."""
    if problem.evidence.observations:
        return -0.5 * costs / limit.variance
    return -0.5 * problem.observations * np.log(costs)


def _first_mixture(problem: Problem, best: Fit, limit: Threshold) -> _Mixture:
    """Return Laplace approximations at the valleys within the limit, the best first.

    A fit that lies within a component already is none of its own. Shares are by the mass of each, and even by half: the
    approximation of a narrow valley is rough.
    """
    centres: list[tuple[Fit, Floats]] = []
    within = (fit for fit in problem.fits if fit.cost <= limit.cost)
    for fit in [best, *sorted(within, key=lambda fit: fit.cost)]:
        if len(centres) == _MOST_VALLEYS:
            break
        if all(_distance(fit.point - centre.point, information) > _APART for centre, information in centres):
            centres.append((fit, _information(problem, fit.point, limit)))
    components = tuple(_laplace(fit.point, information) for fit, information in centres)
    masses = np.array(
        [
            -0.5 * (fit.cost - limit.least) / limit.variance + float(np.sum(np.log(np.diag(component.root))))
            for (fit, _), component in zip(centres, components, strict=True)
        ]
    )
    shares = np.exp(masses - np.max(masses))
    return _Mixture(components, 0.5 * shares / np.sum(shares) + 0.5 / len(shares))


def _information(problem: Problem, point: Floats, limit: Threshold) -> Floats:
    """Return the Fisher information at a point, shape (free, free); none where rounding puts it outside Eq. 80."""
    jacobian = np.nan_to_num(problem.jacobian(problem.evaluator.space, point))
    return jacobian.T @ jacobian / limit.variance


def _distance(away: Floats, information: Floats) -> float:
    """Return a distance in standard deviations, that of the prior where the information has none."""
    return math.sqrt(float(away @ (information + _PRIOR_PRECISION * np.eye(len(away))) @ away))


def _laplace(point: Floats, information: Floats) -> _Component:
    """Return the component of a place by the information there; uniform where that determines nothing."""
    precision = information + _PRIOR_PRECISION * np.eye(len(point))
    told = np.sqrt(np.diag(np.linalg.inv(precision))) < _FLAT
    inner, cross = precision[np.ix_(told, told)], precision[np.ix_(told, ~told)]
    slope: Floats = np.asarray(-np.linalg.solve(inner, cross), dtype=np.float64)
    root: Floats = np.asarray(np.linalg.cholesky(np.linalg.inv(inner)), dtype=np.float64)
    mean = point[told] + slope @ (0.5 - point[~told])
    return _Component(told, mean, slope, root)


def _fitted(mixture: _Mixture, points: Floats, weights: Floats) -> _Mixture:
    """Return a mixture fitted to weighted points by one step of expectation and maximisation (Cappé et al., 2008).

    A component that few points belong to keeps its shape.
    """
    parts = mixture.log_parts(points)
    owned = weights * np.exp(parts - _log_sum(parts))
    shares = _KEPT * mixture.shares + (1.0 - _KEPT) * np.sum(owned, axis=1)
    shares = np.maximum(shares, _LEAST_SHARE)
    components = [_refitted(c, points, own) for c, own in zip(mixture.components, owned, strict=True)]
    return _Mixture(tuple(components), shares / np.sum(shares))


def _begun(problem: Problem, mixture: _Mixture, points: Floats, weights: Floats, limit: Threshold) -> _Mixture:
    """Return a mixture with components at the candidates of most weight: it has missed their valleys."""
    heavy = [i for i in np.argsort(-weights)[:_MOST_BEGUN].tolist() if weights[i] > _HEAVY]
    begun = [_laplace(points[i], _information(problem, points[i], limit)) for i in heavy]
    shares = np.concatenate([mixture.shares, np.minimum(weights[heavy], _MOST_SHARE)])
    return _Mixture((*mixture.components, *begun), shares / np.sum(shares))


def _truncated(weights: Floats) -> Floats:
    """Return weights none of which exceeds their mean by more than the root of their number (Ionides, 2008)."""
    kept = np.minimum(weights, np.mean(weights) * math.sqrt(len(weights)))
    return kept / np.sum(kept)


def _refitted(component: _Component, points: Floats, owned: Floats) -> _Component:
    size = len(component.mean)
    effective = float(np.sum(owned)) ** 2 / max(float(np.sum(owned**2)), 1e-300)
    others = int(np.count_nonzero(~component.told))
    if size == 0 or effective < 2.0 * (size + others + 1):
        return component
    shifts = np.column_stack([np.ones(len(points)), points[:, ~component.told] - 0.5])
    # As much of the old line and scale is kept as there are unknowns to the effective number.
    kept = (size + others) / (size + others + effective)
    share = owned / np.sum(owned)
    gram = shifts.T @ (share[:, None] * shifts) + 1e-6 * np.eye(others + 1)
    line = np.linalg.solve(gram, shifts.T @ (share[:, None] * points[:, component.told])).T
    away = points[:, component.told] - shifts @ line.T
    scale = (1.0 - kept) * away.T @ (share[:, None] * away) + kept * component.root @ component.root.T
    return replace(component, mean=line[:, 0], slope=line[:, 1:], root=np.linalg.cholesky(scale + 1e-12 * np.eye(size)))


def planned_candidates(free: int) -> int:
    """Return about how many candidates are simulated for a posterior."""
    return 3 * (_ROUND + _ROUND_PER_FREE * free)


def _log_sum(parts: Floats) -> Floats:
    """Return the logarithm of the sum of exponentials along the first axis."""
    most = np.max(parts, axis=0)
    return most + np.log(np.sum(np.exp(parts - most), axis=0))
