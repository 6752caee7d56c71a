"""Frictionless contact of condensed bodies: pressures of cells that are pressed together by a given approach.

With the compliance C of both bodies together (the sum of theirs), m^3/Pa, areas A, m^2, undeformed gap g, m, and
approach delta, m, the pressures p minimise 1/2 p' C p - p' A (delta - g) subject to p >= 0; equivalently the opening
w = C p / A - (delta - g) obeys p >= 0, w >= 0, p w = 0. Solved by block principal pivoting (Portugal, Judice and
Vicente, Mathematics of Computation 63 (1994) 625), which is Newton's method on the active set; where the cells keep
changing sides it gives over to non-negative least squares (Lawson and Hanson 1974), which is slower and always ends.
delta is the rigid closing of the two bodies' supports along the contact normal beyond touching.

Where C is singular (cells finer than the facets) infinitely many pressures give the same displacement. A ridge of
``RIDGE`` times the mean diagonal, in variables weighted with sqrt(A), then picks nearly the smoothest; force and
approach do not depend on it within the stated residual, the pressure of single cells does: ``pressure_unique`` is
False.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.elastic import FeError
from models.fe.solid.sparse import cholesky_solve, non_negative, triangular_solve

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Share of the mean diagonal that is added to the diagonal.
RIDGE = 1e-12
# Largest complementarity error of a converged state, as a share of the approach (openings) and of the mean pressure.
TOLERANCE = 1e-8
# Relative error of the force that press_to_force aims at.
FORCE_TOLERANCE = 1e-9
# A compliance whose Cholesky diagonal spans more than this does not fix the pressure.
_SINGULAR = 1e-5
# Exchanges without fewer wrong cells before they are given up.
_PATIENCE = 10


@dataclass(frozen=True)
class ContactState:
    """Pressures under one approach, and what is known about them.

    Attributes:
        approach: m.
        pressure: Pa, shape (cells,), 0 where open.
        opening: mean distance of the surfaces over each cell, m, shape (cells,), 0 where pressed.
        force: sum of area times pressure, N.
        stiffness: d force / d approach, N/m.
        active: True where pressed, shape (cells,).
        iterations: exchanges of the active set, over all approaches tried.
        residual: largest of |opening of pressed cells|, - opening of open cells (both over the largest overlap
            delta - g) and - pressure over the mean pressure of pressed cells; 0 for bodies apart.
        force_error: relative difference of the force from the one asked for; 0 where an approach was given.
        pressure_unique: whether the compliance of the pressed cells is definite, so that their pressures are fixed.
        converged: whether the exchanges ended, the residual is at most ``TOLERANCE`` and the force within its own.
    """

    approach: float
    pressure: NDArray[np.float64]
    opening: NDArray[np.float64]
    force: float
    stiffness: float
    active: NDArray[np.bool_]
    iterations: int
    residual: float
    force_error: float
    pressure_unique: bool
    converged: bool


def press(
    compliance: NDArray[np.float64],
    gap: NDArray[np.float64],
    area: NDArray[np.float64],
    approach: float,
    *,
    start: NDArray[np.bool_] | None = None,
    max_iterations: int = 200,
) -> ContactState:
    """Return the contact under an approach.

    Args:
        compliance: of both bodies together, m^3/Pa, shape (cells, cells), symmetric, positive semi-definite.
        gap: mean distance of the undeformed surfaces over each cell when they just touch, m, shape (cells,).
        area: m^2, shape (cells,).
        approach: m; nothing is pressed below the smallest gap.
        start: cells believed to be pressed, such as those of a state nearby.
        max_iterations: exchanges of the active set at most; a state that needs more says that it did not converge.

    Raises:
        FeError: if shapes disagree, or a value is not finite, an area not positive or the compliance not symmetric.
    """
    _check(compliance, gap, area, approach)
    overlap = approach - gap
    scale = np.sqrt(area)
    if not np.any(overlap > 0.0):
        zero = np.zeros(len(area))
        return ContactState(approach, zero, -overlap, 0.0, 0.0, zero > 0.0, 0, 0.0, 0.0, True, True)
    weighted = compliance / np.outer(scale, scale)
    ridge = RIDGE * float(np.trace(weighted)) / len(area)
    load = scale * overlap
    active = (overlap > 0.0) if start is None else np.array(start, bool)
    solution, active, iterations, ended = _exchange(weighted, ridge, load, active, max_iterations)
    pressure = solution / scale
    opening = (compliance @ pressure) / area - overlap
    residual = _residual(pressure, opening, overlap, active)
    stiffness, unique = _tangent(weighted, ridge, scale, active)
    force = float(area @ pressure)
    return ContactState(
        approach, pressure, opening, force, stiffness, active, iterations, residual, 0.0, unique,
        ended and residual <= TOLERANCE,
    )  # fmt: skip


def press_to_force(
    compliance: NDArray[np.float64],
    gap: NDArray[np.float64],
    area: NDArray[np.float64],
    force: float,
    *,
    start: ContactState | None = None,
    max_iterations: int = 400,
) -> ContactState:
    """Return the contact under a force, N: Newton on the approach within bounds, to ``FORCE_TOLERANCE`` of the force.

    The force is piecewise linear in the approach, so that Newton ends exactly once the right cells are pressed. Other
    arguments and errors as of :func:`press`; a force must be positive and finite. A state nearby may be given to start.
    """
    if not (np.isfinite(force) and force > 0.0):
        raise FeError(f"contact: force must be positive and finite, N, got {force!r}")
    _check(compliance, gap, area, 0.0)
    low, high = float(gap.min()), np.inf
    # Rigid bodies would touch over all cells first where the mean compliance of one cell carries the whole force.
    approach = (
        low + force * float(np.diag(compliance).max()) / float(area.min()) ** 2 if start is None else start.approach
    )
    active = None if start is None else start.active
    iterations = 0
    while True:
        state = press(compliance, gap, area, approach, start=active, max_iterations=max_iterations - iterations)
        iterations += max(state.iterations, 1)
        error = state.force / force - 1.0
        if abs(error) <= FORCE_TOLERANCE or iterations >= max_iterations:
            done = state.converged and abs(error) <= FORCE_TOLERANCE
            return replace(state, iterations=iterations, force_error=error, converged=done)
        low, high = (approach, high) if error < 0.0 else (low, approach)
        approach = _next_approach(state, force, low, high)
        active = state.active if state.force > 0.0 else None


def _next_approach(state: ContactState, force: float, low: float, high: float) -> float:
    """Return Newton's next approach, or a bisection where it leaves the bounds."""
    if state.stiffness > 0.0:
        newton = state.approach + (force - state.force) / state.stiffness
        if low < newton < high:
            return newton
    return 0.5 * (low + high) if np.isfinite(high) else low + 2.0 * max(abs(low), 1e-9)


def _check(
    compliance: NDArray[np.float64], gap: NDArray[np.float64], area: NDArray[np.float64], approach: float
) -> None:
    """Raise if the data of a contact cannot be used."""
    cells = len(area)
    if compliance.shape != (cells, cells) or gap.shape != (cells,):
        raise FeError(
            f"contact: expected compliance ({cells}, {cells}) and gap ({cells},) for {cells} areas,"
            f" got {compliance.shape} and {gap.shape}"
        )
    for name, values in (("compliance", compliance), ("gap", gap), ("area", area), ("approach", np.array(approach))):
        if not np.all(np.isfinite(values)):
            raise FeError(f"contact: {name} is not finite")
    if not np.all(area > 0.0):
        raise FeError(f"contact: areas must be positive, m^2, the smallest is {area.min()!r}")
    if not np.allclose(compliance, compliance.T, rtol=0.0, atol=1e-10 * float(np.abs(compliance).max(initial=0.0))):
        raise FeError("contact: compliance must be symmetric")


def _exchange(
    matrix: NDArray[np.float64],
    ridge: float,
    load: NDArray[np.float64],
    active: NDArray[np.bool_],
    max_iterations: int,
) -> tuple[NDArray[np.float64], NDArray[np.bool_], int, bool]:
    """Return solution, active cells, exchanges made and whether they ended, of x >= 0, M x - load >= 0, x (..) = 0."""
    fewest, patience = len(load) + 1, _PATIENCE
    small = 1e-13 * float(np.abs(load).max())
    x = np.zeros(len(load))
    for iteration in range(1, max(max_iterations, 1) + 1):
        x = np.zeros(len(load))
        held = np.nonzero(active)[0]
        if len(held):
            x[held] = _solve(matrix, ridge, held, load[held])
        wrong = np.where(active, x < 0.0, matrix @ x - load < -small)
        count = int(wrong.sum())
        if count == 0:
            return x, active, iteration, True
        if count < fewest:
            fewest, patience = count, _PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            return *_one_by_one(matrix, ridge, load), iteration, True
        active = active ^ wrong
    return np.maximum(x, 0.0), active, max_iterations, False


def _one_by_one(
    matrix: NDArray[np.float64], ridge: float, load: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the solution and its active cells by non-negative least squares, which descends and cannot cycle."""
    factor = _cholesky(matrix, ridge, np.arange(len(load)))
    size = float(np.abs(load).max()) / float(factor[0, 0])
    x = non_negative(factor.T, triangular_solve(factor, load[:, None])[:, 0] / size) * size
    active = x > 0.0
    held = np.nonzero(active)[0]
    again = np.zeros(len(load))
    again[held] = _solve(matrix, ridge, held, load[held])
    return (x, active) if np.any(again < 0.0) else (again, active)


def _solve(
    matrix: NDArray[np.float64], ridge: float, held: NDArray[np.int64], right: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Solve the pressed cells' block for one or more right-hand sides."""
    return cholesky_solve(_cholesky(matrix, ridge, held), right)


def _cholesky(matrix: NDArray[np.float64], ridge: float, held: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the lower Cholesky factor of the pressed cells' block with the ridge, raised until it is definite."""
    block = matrix[np.ix_(held, held)]
    for _ in range(8):
        try:
            return np.asarray(np.linalg.cholesky(block + ridge * np.eye(len(held))), np.float64)
        except np.linalg.LinAlgError:
            ridge *= 10.0
    raise FeError("contact: the compliance of the pressed cells is not positive semi-definite")


def _tangent(
    matrix: NDArray[np.float64], ridge: float, scale: NDArray[np.float64], active: NDArray[np.bool_]
) -> tuple[float, bool]:
    """Return d force / d approach of the pressed cells, N/m, and whether their block is definite."""
    held = np.nonzero(active)[0]
    if not len(held):
        return 0.0, True
    factor = _cholesky(matrix, ridge, held)
    forward = triangular_solve(factor, scale[held][:, None])[:, 0]
    diagonal = np.diag(factor)
    return float(forward @ forward), bool(diagonal.min() > _SINGULAR * diagonal.max())


def _residual(
    pressure: NDArray[np.float64],
    opening: NDArray[np.float64],
    overlap: NDArray[np.float64],
    active: NDArray[np.bool_],
) -> float:
    """Return the largest relative violation of the contact conditions."""
    size = float(np.abs(overlap[overlap > 0.0]).max())
    mean = float(pressure[active].mean()) if np.any(active) else 0.0
    errors = [np.abs(opening[active]).max(initial=0.0) / size, np.max(-opening[~active], initial=0.0) / size]
    errors.append(0.0 if mean <= 0.0 else float(np.max(-pressure, initial=0.0)) / mean)
    return float(max(errors))
