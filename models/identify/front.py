"""Pareto fronts: those of the candidates that were simulated anyway, and those that NSGA-II looks for.

NSGA-II needs pymoo, the extra ``identify``; nothing else here does.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from models.identify.problem import Fit, Problem
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
