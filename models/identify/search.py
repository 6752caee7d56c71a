"""Global search: a space-filling design, least squares from its best points, and a scan along the resonance.

The difference to the tests has many minima, nearly all along f_r: the lines k * BPFO pass the resonance one by one. So
the best fit is followed along the coordinate of the resonance, all other parameters adapted at each place, and the
valleys found there are fitted again, also with the lowest damping of the resonator, where they are narrow.

Pareto fronts: those of the candidates that were simulated anyway, and those that NSGA-II looks for.

NSGA-II needs pymoo, the extra ``identify``; nothing else here does.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from models.identify.problem import Fit, Problem
from models.identify.space import SpaceError
from models.words.errors import WrongInputError
from models.words.numerics import low_discrepancy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.space import Space

# Places of the resonance that are visited, so many apart on the coordinate that neighbours share a valley.
_PLACES = 64
# Fits from the design, from the scan, and iterations of each.
_STARTS, _VALLEYS = 8, 6
_CALLS, _SCAN_CALLS = 25, 6
# Shares of the interval of c_r from which a valley is fitted.
_DAMPINGS = (0.05, 0.4)
# Places on either side of a point, and their distance on the coordinate of the resonance, at which it is probed.
_PROBES, _PROBE_STEP = 12, 0.0015


def design_points(free: int) -> int:
    """Return the number of candidates of the design: a power of two that grows with the unknowns."""
    return 2 ** min(10, 4 + free - (free > 5))


def planned_evaluations(free: int) -> int:
    """Return about how many candidates a search simulates."""
    scan = _PLACES * 2 * free if free > 1 else 0
    return design_points(free) + (_STARTS + 2 * _VALLEYS) * 10 * (free + 1) + scan


def search(problem: Problem, seed: int, starts: Sequence[Fit] = ()) -> list[Fit]:
    """Return the fits that were found, best first; also kept in ``problem.fits``.

    Args:
        problem: with the space that is searched.
        seed: of the design.
        starts: points to begin at instead of the best of the design.

    Raises:
        SpaceError: if no candidate of the design is admissible.
    """
    space = problem.evaluator.space
    for start in starts or _designed(problem, seed):
        _keep(problem, problem.fit(space, start.point, calls=_CALLS))
    for _ in range(2):
        before = lowest(problem).cost
        axis = resonance_axis(space)
        if axis is not None:
            _scan(problem, space, axis)
        if lowest(problem).cost > before - 1.0:
            break
    return sorted(problem.fits, key=lambda fit: fit.cost)


def _designed(problem: Problem, seed: int) -> list[Fit]:
    """Return the best points of the design."""
    space = problem.evaluator.space
    design = low_discrepancy(design_points(len(space.free)), len(space.free), seed)
    candidates = [fit for fit in problem.costs(space, list(design)) if fit is not None]
    if not candidates:
        raise SpaceError("no candidate meets the constraints of Eq. 80; widen the limits or free other parameters")
    return sorted(candidates, key=lambda fit: fit.cost)[:_STARTS]


def lowest(problem: Problem) -> Fit:
    """Return the best fit so far."""
    return min(problem.fits, key=lambda fit: fit.cost)


def _keep(problem: Problem, fit: Fit | None) -> None:
    if fit is not None:
        problem.fits.append(fit)


def resonance_axis(space: Space) -> int | None:
    """Return the number of the coordinate that moves f_r most, or None."""
    return next((space.free.index(name) for name in ("k_r", "m_r") if name in space.free), None)


def _scan(problem: Problem, space: Space, axis: int) -> None:
    """Follow the best fit along a coordinate both ways, and fit the valleys that are met."""
    start = lowest(problem)
    places = np.linspace(0.0, 1.0, _PLACES)
    above, below = places[places >= start.point[axis]], places[places < start.point[axis]][::-1]
    met: list[Fit] = []
    for way in (above, below):
        point = start.point
        for place in way.tolist():
            fit = problem.fit(space, point, calls=_SCAN_CALLS, ftol=1e-2, xtol=1e-4, held={axis: place})
            if fit is not None:
                met.append(fit)
                point = fit.point
    problem.fits += met
    met.sort(key=lambda fit: float(fit.point[axis]))
    for valley in _valleys(met)[:_VALLEYS]:
        _keep(problem, problem.fit(space, valley.point, calls=_CALLS))
        if "c_r" in space.free:
            for damping in _DAMPINGS:
                _keep(problem, _narrow(problem, space, valley.point, axis, damping))


def _valleys(fits: list[Fit]) -> list[Fit]:
    """Return the fits of a scan, in its order, that are no worse than their neighbours, best first."""
    costs = [np.inf, *(fit.cost for fit in fits), np.inf]
    lowest = [fit for i, fit in enumerate(fits, 1) if costs[i] <= min(costs[i - 1], costs[i + 1])]
    return sorted(lowest, key=lambda fit: fit.cost)


def _narrow(problem: Problem, space: Space, point: NDArray[np.float64], axis: int, damping: float) -> Fit | None:
    """Return the fit from the best place around a valley with a low damping of the resonator."""
    damped = point.copy()
    damped[space.free.index("c_r")] = damping
    return shifted(problem, space, damped, axis, calls=_CALLS)


def shifted(problem: Problem, space: Space, point: NDArray[np.float64], axis: int, *, calls: int) -> Fit | None:
    """Return the fit from the best of some places around a point along a coordinate; None where none is admissible.

    Neighbouring valleys of the resonance are met, which least squares alone do not leave.
    """
    probes: list[NDArray[np.float64]] = []
    for step in range(-_PROBES, _PROBES + 1):
        probe = point.copy()
        probe[axis] = min(max(probe[axis] + step * _PROBE_STEP, 0.0), 1.0)
        probes.append(probe)
    found = [fit for fit in problem.costs(space, probes) if fit is not None]
    if not found:
        return None
    return problem.fit(space, min(found, key=lambda fit: fit.cost).point, calls=calls, ftol=1e-2, xtol=1e-4)


# Percent, for a candidate outside Eq. 80: it is not simulated, and any that is inside is better.
_REFUSED = 1e9


def non_dominated(objectives: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the rows, shape (candidates, objectives), that no other is better than in all, by their first column.

    Of rows that are equal, the first is given.
    """
    order = np.lexsort(objectives.T[::-1])
    kept: list[int] = []
    for i in order.tolist():
        if not any(np.all(objectives[k] <= objectives[i]) for k in kept):
            kept.append(i)
    return np.array(kept, dtype=np.intp)


def simulated_front(problem: Problem) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Return parameters (SI) and objectives (%) of the simulated candidates that no other dominates.

    Candidates whose motion does not repeat are not among them: one level says too little of them.
    """
    evaluator = problem.evaluator
    names = list(evaluator.space.known)
    kept = [(key, level) for key, level in evaluator.kept.items() if not np.any(level.doubt > 0.0)]
    if not kept:
        kept = list(evaluator.kept.items())
    objectives = [problem.deviations(level) for _, level in kept]
    rows = np.array([list(found.values()) for found in objectives], dtype=np.float64)
    return [(dict(zip(names, kept[i][0], strict=True)), objectives[i]) for i in map(int, non_dominated(rows))]


def nsga2(problem: Problem, *, population: int, generations: int, seed: int) -> list[Fit]:
    """Return the candidates of the front that NSGA-II finds over the problem's objectives.

    Raises:
        WrongInputError: pymoo is not installed.
    """
    pymoo = _pymoo()
    space = problem.evaluator.space
    cube = pymoo["core.problem"].Problem(n_var=len(space.free), n_obj=len(problem.objectives), xl=0.0, xu=1.0)
    algorithm = pymoo["algorithms.moo.nsga2"].NSGA2(pop_size=population)
    algorithm.setup(cube, termination=("n_gen", generations), seed=seed, verbose=False)
    while algorithm.has_next():
        asked = algorithm.ask()
        objectives = _objectives(problem, np.asarray(asked.get("X"), dtype=np.float64))
        pymoo["core.evaluator"].Evaluator().eval(pymoo["problems.static"].StaticProblem(cube, F=objectives), asked)
        algorithm.tell(infills=asked)
    points = np.atleast_2d(np.asarray(algorithm.result().X, dtype=np.float64))
    return [fit for fit in problem.costs(space, list(points)) if fit is not None]


def _pymoo() -> dict[str, Any]:
    """Return the modules of pymoo that are needed; it has no types."""
    names = ("core.problem", "core.evaluator", "problems.static", "algorithms.moo.nsga2")
    try:
        return {name: importlib.import_module(f"pymoo.{name}") for name in names}
    except ImportError as error:
        raise WrongInputError(f"NSGA-II needs pymoo ({error}); install spallwatch[identify]") from None


def _objectives(problem: Problem, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the deviations, %, at points, shape (points, objectives); those outside Eq. 80 are not simulated."""
    found = np.full((len(points), len(problem.objectives)), _REFUSED)
    for row, fit in zip(found, problem.costs(problem.evaluator.space, list(points)), strict=True):
        if fit is not None:
            row[:] = list(problem.deviations(problem.evaluator.levels([fit.values])[0]).values())
    return found
