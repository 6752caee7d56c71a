"""Pareto fronts: those of the candidates that were simulated anyway, and those that NSGA-II looks for.

NSGA-II needs pymoo, the extra ``identify``; nothing else here does.
"""

from __future__ import annotations

import contextlib
import io
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import WrongInputError
from models.identify.problem import Fit, Problem

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
    rows = np.array([list(found.values()) for found in objectives])
    return [(dict(zip(names, kept[i][0], strict=True)), objectives[i]) for i in non_dominated(rows).tolist()]


def nsga2(problem: Problem, *, population: int, generations: int, seed: int) -> list[Fit]:
    """Return the candidates of the front that NSGA-II finds over the problem's objectives.

    Raises:
        WrongInputError: pymoo is not installed.
    """
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem as PymooProblem
        from pymoo.optimize import minimize
    except ImportError as error:
        raise WrongInputError(f"NSGA-II needs pymoo ({error}); install spallwatch[identify]") from None
    space = problem.evaluator.space
    free, objectives = len(space.free), len(problem.objectives)

    class Deviations(PymooProblem):  # pyright: ignore[reportUntypedBaseClass]
        """Delta of each objective over the unit cube."""

        def __init__(self) -> None:
            super().__init__(n_var=free, n_obj=objectives, xl=0.0, xu=1.0)

        def _evaluate(self, x: NDArray[np.float64], out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
            found = problem.costs(space, list(x))
            out["F"] = np.array(
                [
                    [_REFUSED] * objectives
                    if fit is None
                    else list(problem.deviations(problem.evaluator.levels([fit.values])[0]).values())
                    for fit in found
                ]
            )

    # Its banner and hints are not part of any output.
    with contextlib.redirect_stdout(io.StringIO()):
        result: Any = minimize(Deviations(), NSGA2(pop_size=population), ("n_gen", generations), seed=seed)
    points = np.atleast_2d(np.asarray(result.X, dtype=np.float64))
    return [fit for fit in problem.costs(space, list(points)) if fit is not None]
