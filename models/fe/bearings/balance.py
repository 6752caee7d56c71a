"""Equilibrium of a ring on elements that are pressed along given normals by a law, and yield to each other's forces.

Any number of dimensions: two for a radial bearing, three where the normals have an axial part. The ring translates
and does not tilt, which is exact where all normals meet in one point, as those of a self-aligning bearing do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

RESIDUAL = 1e-10
"""Largest unbalanced force in equilibrium, as a share of the load or, without one, of the largest force."""
_MOST_DAMPING = 1e12
_OUTER_STEPS = 200
_INNER_STEPS = 60
_HALVINGS = 30


class Law(Protocol):
    """Force of one element over its approach; both are zero or positive and grow together."""

    def force(self, approach: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return force, N, and tangent, N/m, of approaches, m, of any sign; both are zero where it is negative."""
        ...


@dataclass(frozen=True)
class PowerLaw:
    """Force k delta^n of Hertz, N, with k in N/m^n."""

    stiffness: float
    exponent: float = 1.5

    def force(self, approach: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return force, N, and tangent, N/m, of approaches, m."""
        pressed = np.maximum(approach, 0.0)
        tangent = np.zeros_like(pressed)
        inside = pressed > 0.0
        tangent[inside] = self.exponent * self.stiffness * pressed[inside] ** (self.exponent - 1.0)
        return self.stiffness * pressed**self.exponent, tangent


@dataclass(frozen=True, eq=False)
class Balance:
    """A ring in equilibrium.

    Attributes:
        displacement: of the ring, m, shape (dimensions,).
        forces: of the elements along their normals, N, shape (elements,).
        approach: of each by which its law is pressed, m, negative where it does not touch, shape (elements,).
        stiffness: derivative of the load by the displacement, N/m, symmetric, shape (dimensions, dimensions).
        residual: largest unbalanced force, N.
        settled: whether that is ``RESIDUAL`` of the load at most.
    """

    displacement: NDArray[np.float64]
    forces: NDArray[np.float64]
    approach: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    residual: float
    settled: bool


def settle(
    normals: NDArray[np.float64],
    law: Law,
    load: NDArray[np.float64],
    *,
    influence: NDArray[np.float64] | None = None,
    clearance: float | NDArray[np.float64] = 0.0,
    begin: NDArray[np.float64] | None = None,
) -> Balance:
    """Return the equilibrium of the ring under a load.

    Element j is pressed by normals_j . u - clearance_j - sum_k influence_jk Q_k. The forces are the gradient of a
    convex energy of u as long as the influence is smaller than the elements' own compliance, so one equilibrium exists;
    it is found by a damped Newton method in u with the elements' approaches solved within each step.

    Args:
        normals: unit vectors from the axis to the elements, shape (elements, dimensions).
        load: on the ring, N, shape (dimensions,).
        influence: normal displacement at element j under a unit force on element k, m/N, symmetric, positive where the
            displacement takes the load off j; the element's own compliance is in the law. None is none.
        clearance: gap of each element before any is pressed, m.
        begin: displacement with which to begin, m, shape (dimensions,).

    Raises:
        ValueError: if shapes do not fit, a value is not finite, or the influence is not symmetric.
        RuntimeError: if the load leaves a direction in which nothing holds the ring, or the iteration does not settle.
    """
    normals = np.asarray(normals, dtype=np.float64)
    count = len(normals)
    gaps = np.broadcast_to(np.asarray(clearance, dtype=np.float64), (count,))
    mutual = np.zeros((count, count)) if influence is None else np.asarray(influence, dtype=np.float64)
    load = np.asarray(load, dtype=np.float64)
    _check(normals, load, gaps, mutual)
    u = None if begin is None else np.array(begin, dtype=np.float64)
    balance = descend(normals, law, load, mutual, gaps, u)
    if balance.settled:
        return balance
    if not np.any(balance.forces > 0.0):
        raise RuntimeError("the load presses no element: the ring is not held in its direction")
    size = float(np.abs(load).max())
    raise RuntimeError(
        f"no equilibrium found for load {load.tolist()!r}: {balance.residual:.3g} N of {size:.3g} N are not balanced"
    )


def descend(
    normals: NDArray[np.float64],
    law: Law,
    load: NDArray[np.float64],
    mutual: NDArray[np.float64],
    gaps: NDArray[np.float64],
    begin: NDArray[np.float64] | None,
) -> Balance:
    """Return what :func:`settle` does, unchecked, and also where the iteration ends out of equilibrium."""
    if begin is None:
        begin = _first_guess(normals, law, load, gaps)
    damping, unit = 1e-6, np.eye(normals.shape[1])
    balance = _state(normals, law, mutual, gaps, load, begin, normals @ begin - gaps)
    for _ in range(_OUTER_STEPS):
        scale = float(np.trace(balance.stiffness))
        if balance.settled or scale == 0.0 or damping > _MOST_DAMPING:
            break
        missing = load - normals.T @ balance.forces
        step = np.linalg.solve(balance.stiffness + damping * scale * unit, missing)
        tried = _state(normals, law, mutual, gaps, load, balance.displacement + step, balance.approach)
        still = load - normals.T @ tried.forces
        # Along the step the energy falls while the missing force still points along it: convexity needs no energy.
        if float(step @ still) >= -0.5 * float(step @ missing) and np.any(tried.forces > 0.0):
            balance, damping = tried, max(0.1 * damping, 1e-15)
        elif tried.residual < balance.residual:
            balance = tried
        else:
            damping *= 10.0
    return balance


def condensed(stiffness: NDArray[np.float64], free: int) -> NDArray[np.float64]:
    """Return the stiffness of all other coordinates while one of them follows without load.

    Raises:
        ValueError: if nothing holds that coordinate.
    """
    kept = [i for i in range(len(stiffness)) if i != free]
    own = float(stiffness[free, free])
    if not own > 0.0:
        raise ValueError(f"coordinate {free} has no stiffness, it cannot be left free")
    return stiffness[np.ix_(kept, kept)] - np.outer(stiffness[kept, free], stiffness[free, kept]) / own


def _check(
    normals: NDArray[np.float64], load: NDArray[np.float64], gaps: NDArray[np.float64], mutual: NDArray[np.float64]
) -> None:
    count, dimensions = normals.shape
    if load.shape != (dimensions,) or mutual.shape != (count, count):
        raise ValueError(
            f"expected a load ({dimensions},) and an influence ({count}, {count}), got {load.shape}, {mutual.shape}"
        )
    for name, values in (("normals", normals), ("load", load), ("clearance", gaps), ("influence", mutual)):
        if not bool(np.all(np.isfinite(values))):
            raise ValueError(f"{name} must be finite")
    if not np.allclose(mutual, mutual.T, rtol=1e-6, atol=1e-6 * float(np.abs(mutual).max(initial=0.0))):
        raise ValueError("influence must be symmetric: the displacement at j by a force at k is that at k by one at j")


def _first_guess(
    normals: NDArray[np.float64], law: Law, load: NDArray[np.float64], gaps: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a displacement along the load at which the elements carry more than it, without mutual influence."""
    size = math.hypot(*load.tolist())
    if size == 0.0:
        return np.zeros(len(load))
    direction = load / size
    along = normals @ direction
    if float(along.max()) <= 0.0:
        raise RuntimeError("the load presses no element: none lies in its direction")
    reach = 1e-9
    while reach < 1.0:
        forces = law.force(np.asarray(along * reach - gaps))[0]
        if float(along @ forces) >= size:
            return direction * reach
        reach *= 1.5
    raise RuntimeError(
        f"a displacement of 1 m does not carry {size!r} N: the law is too soft, or the clearance too large"
    )


def _state(
    normals: NDArray[np.float64],
    law: Law,
    mutual: NDArray[np.float64],
    gaps: NDArray[np.float64],
    load: NDArray[np.float64],
    u: NDArray[np.float64],
    begin: NDArray[np.float64],
) -> Balance:
    """Return the forces and the stiffness at one displacement."""
    wanted = normals @ u - gaps
    approach = pressed_together(law, mutual, wanted, begin)
    forces, tangent = law.force(approach)
    coupled = np.linalg.solve(np.eye(len(tangent)) + tangent[:, None] * mutual, tangent[:, None] * normals)
    stiffness = normals.T @ coupled
    residual = float(np.abs(load - normals.T @ forces).max())
    size = float(np.abs(load).max()) or float(forces.max())
    return Balance(u, forces, approach, 0.5 * (stiffness + stiffness.T), residual, residual <= RESIDUAL * size)


def pressed_together(
    law: Law, mutual: NDArray[np.float64], wanted: NDArray[np.float64], begin: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the approaches c, m, that solve c + mutual Q(c) = wanted, shape (elements,); ``begin`` is a guess."""
    if not mutual.any():
        return wanted
    approach = begin
    forces, tangent = law.force(approach)
    missing = wanted - approach - mutual @ forces
    tolerance = 1e-14 * (float(np.abs(wanted).max()) + float(np.abs(mutual).max()) * float(forces.max()))
    for _ in range(_INNER_STEPS):
        size = float(np.abs(missing).max())
        if size <= tolerance:
            return approach
        step = np.linalg.solve(np.eye(len(wanted)) + mutual * tangent[None, :], missing)
        share = 1.0
        for _ in range(_HALVINGS):
            tried = approach + share * step
            forces, tangent = law.force(tried)
            left = wanted - tried - mutual @ forces
            if float(np.abs(left).max()) < size:
                break
            share *= 0.5
        else:
            return approach
        approach, missing = tried, left
    return approach
