"""Which priors an interval leans on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.identify.intervals import coordinate_derivatives

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.run import Identification

LEANS = 1.5
"""A parameter leans on a prior without which its standard deviation would be larger by this factor."""

# Information in units of the prior of a flat coordinate of the cube, so that none is infinite.
_FLAT = 12.0


def leaning(found: Identification) -> dict[str, tuple[str, ...]]:
    """Return the parameters whose uncertainty, by the information at the best fit, rests on priors, with these.

    Priors are named by their parameter. Limits of the space count as a uniform distribution between them.
    """
    problem, space = found.problem, found.space
    priors = problem.evidence.priors
    if not priors:
        return {}
    jacobian = problem.jacobian(space, found.best.point)
    transform = coordinate_derivatives(space, found.best)
    first = len(jacobian) - len(priors)
    whole = _deviations(jacobian, transform)
    leans: dict[str, list[str]] = {}
    for number, prior in enumerate(priors):
        without = _deviations(np.delete(jacobian, first + number, axis=0), transform)
        for name, before, after in zip(space.free, whole, without, strict=True):
            if after > LEANS * before:
                leans.setdefault(name, []).append(prior.name)
    return {name: tuple(priors) for name, priors in leans.items()}


def _deviations(jacobian: NDArray[np.float64], transform: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviations of the parameters from derivatives by coordinates and those of parameters."""
    information = jacobian.T @ jacobian + _FLAT * np.eye(jacobian.shape[1])
    return np.sqrt(np.diag(transform @ np.linalg.inv(information) @ transform.T))
