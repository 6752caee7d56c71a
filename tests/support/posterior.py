"""Makers and checks that tests of posterior share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.identify.evaluate import CandidateLevel, Evaluator
from models.identify.evidence import Evidence
from models.identify.limits import AdmissibleLimits
from models.identify.problem import Fit, Problem
from models.identify.trials import Condition, Trial, gather
from models.machine.rig import Rig
from tests.models.identify.cases import space_of

Law = Callable[[np.ndarray], np.ndarray]


"""Logarithms of the features, shape (2 * conditions,), at a point of the cube."""


NOISE, COUNT = 0.03, 5


CONDITIONS = tuple(Condition(2000.0, 40.0, 0.02 + 0.01 * n, 5e-4) for n in range(COUNT))


@dataclass(eq=False)
class Toy(Evaluator):
    """A model by its law; it refuses what Eq. 80 excludes, as the real one does."""

    law: Law = lambda point: point

    def levels(self, candidates: Sequence[Mapping[str, float]]) -> list[CandidateLevel]:
        found: list[CandidateLevel] = []
        for values in candidates:
            assert not self.space.violations(values)
            features = np.exp(self.law(self.space.encode(values))).reshape(COUNT, 2)
            found.append(CandidateLevel(features, np.zeros_like(features)))
        self.simulated += len(candidates)
        return found


def toy(
    law: Law,
    truth: Sequence[float],
    *free: str,
    noise: float = NOISE,
    limits: AdmissibleLimits | None = None,
    evidence: Evidence | None = None,
) -> Problem:
    """Return the problem of noisy tests of a truth, by its coordinates."""
    space = space_of(*free, rig=Rig(), limits=limits)
    drawn = np.random.default_rng(0).standard_normal(2 * COUNT)
    features = np.exp(law(np.array(truth)) + noise * drawn).reshape(COUNT, 2)
    trials = gather([Trial(c, rms, a) for c, (rms, a) in zip(CONDITIONS, features.tolist(), strict=True)])
    return Problem(trials, Toy(space, CONDITIONS, law=law), evidence=evidence or Evidence())


def fitted(problem: Problem, *starts: Sequence[float]) -> Fit:
    """Return the best of the fits from some points, all of which are kept."""
    space = problem.evaluator.space
    fits = [problem.fit(space, np.array(start), calls=40, ftol=1e-10, xtol=1e-10) for start in starts]
    problem.fits += [fit for fit in fits if fit is not None]
    return min(problem.fits, key=lambda fit: fit.cost)
