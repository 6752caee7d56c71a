"""A radially loaded bearing put together of an element law and of the influence of its rings: loads and stiffness.

The approach of both races at element j is lambda(Q_j); the races leave it by what the forces on the others and the
load on the bore move them:

    n_j . u - h - sum over k of S_jk Q_k - s_j F = lambda(Q_j) where Q_j > 0, not above 0 where Q_j = 0,
    sum of Q_j n_j = F.

Angles and axes as in ``models.machine.hertz``: axis 1 along the load, which is along angle zero. SI units. The matrix S
and the law are properties of the meshes; all else costs milliseconds, at any cage angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.fe.bearings.balance import descend
from models.machine.load_distribution import LoadDistribution, StiffnessPassage
from models.path.defect import wrap
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.law import ElementLaw
    from models.fe.bearings.rings import BoreLoad, RingInfluence

# Why a state is not "converged": the forces of the elements do not balance the load; an element is neither loaded with
# closed contacts nor free with open ones; an element carries more than the law was computed for.
FeStatus = Literal["converged", "not_in_equilibrium", "contact_violated", "outside_law"]

# Of the load, and of the largest approach. Rounding leaves 1e-13; these are checked on the finished state.
EQUILIBRIUM_TOLERANCE = 1e-9
CONTACT_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class FeState:
    """Equilibrium of the bearing at one load and cage angle.

    Attributes:
        load: N, along axis 1.
        displacement: of the inner against the outer ring, m, shape (2,): the bore's first harmonic, which is the motion
            of the shaft where that is rigid.
        stiffness: dF/du of it, N/m, shape (2, 2); [0, 0] is k_yy of the thesis (along the load), [1, 1] its k_xx.
        bore_line: displacement along the load of the bore where the plane of the load meets it, m, as in the thesis.
        bore_line_stiffness: its dF/d delta (Eq. 28), N/m.
        angles: of the elements within -pi and pi, rad, shape (elements,).
        loads: on the elements, N, shape (elements,).
        status: "converged" only where equilibrium, contact conditions and the range of the law were checked and hold.
        imbalance: largest component of sum of Q_j n_j - F over the load.
        contact_error: largest violation of the conditions of contact, m.
        below_law: share of the load that elements below the lowest load of the law carry, on its continuation.
        mesh_error: of the law, relative, of the approach; NaN where unknown.
    """

    load: float
    displacement: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    bore_line: float
    bore_line_stiffness: float
    angles: NDArray[np.float64]
    loads: NDArray[np.float64]
    status: FeStatus
    imbalance: float
    contact_error: float
    below_law: float
    mesh_error: float

    @property
    def converged(self) -> bool:
        """Whether the status is "converged"."""
        return self.status == "converged"


@dataclass(frozen=True, eq=False)
class FePassage(StiffnessPassage):
    """Stiffness over a passage, with the state at each cage angle; NaN in ``matrix`` where one is not converged."""

    states: tuple[FeState, ...] = field(default=())

    @property
    def converged(self) -> bool:
        """Whether all states are."""
        return all(state.converged for state in self.states)


@dataclass(frozen=True, eq=False)
class AssembledBearing:
    """Bearing of a single row: the law of its elements, and how its rings yield.

    Attributes:
        law: of one element between both races.
        n_elements: elements in the row.
        clearance: radial clearance h of Eq. 20, m; below zero where the elements are pressed without a load.
        inner, outer: influence of the rings; None where a ring yields at the contact alone.
        bore_load: of an inner ring whose bore carries a given pressure; None where a shaft moves it.
    """

    law: ElementLaw
    n_elements: int
    clearance: float = 0.0
    inner: RingInfluence | None = None
    outer: RingInfluence | None = None
    bore_load: BoreLoad | None = None

    def __post_init__(self) -> None:
        """Refuse what is no bearing."""
        if self.n_elements < 3:
            raise WrongInputError(f"expected three elements at least, got n_elements {self.n_elements!r}")
        if not math.isfinite(self.clearance):
            raise WrongInputError(f"expected a finite clearance, got {self.clearance!r} m")

    @property
    def spacing(self) -> float:
        """Angle between neighbouring elements, rad."""
        return 2.0 * math.pi / self.n_elements

    def angles(self, cage_angle: float = 0.0) -> NDArray[np.float64]:
        """Return the angles of the elements from the load, rad, shape (elements,)."""
        return np.asarray(cage_angle + self.spacing * np.arange(self.n_elements), dtype=np.float64)

    def influence(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return S of both rings, m/N, shape (elements, elements)."""
        matrix = np.zeros((len(angles), len(angles)))
        for ring in (self.inner, self.outer):
            if ring is not None:
                matrix += ring.matrix(angles)
        return matrix

    def state(
        self,
        load: float,
        *,
        cage_angle: float = 0.0,
        gaps: NDArray[np.float64] | None = None,
        start: FeState | None = None,
    ) -> FeState:
        """Return the equilibrium under a radial load, N, at a cage angle, rad.

        Args:
            gaps: further clearance of each element, m, shape (elements,): where it is over a defect, or is smaller.
            start: state at a load and cage angle close by, from which the iteration starts.

        Raises:
            WrongInputError: the load is negative or not finite, or there are not as many gaps as elements.
        """
        if not (math.isfinite(load) and load >= 0.0):
            raise WrongInputError(f"expected a load that is finite and not negative, got {load!r} N")
        angles = self.angles(cage_angle)
        slack = np.full(self.n_elements, self.clearance)
        if gaps is not None:
            if gaps.shape != slack.shape:
                raise WrongInputError(f"expected a gap of each of {self.n_elements} elements, got shape {gaps.shape}")
            slack = slack + gaps
        problem = _Problem.of(self, angles, slack, load)
        moved = slack + problem.bore @ problem.load
        begin = None if start is None else start.displacement
        found = descend(problem.normals.T, self.law, problem.load, problem.influence, moved, begin)
        return _finished(self, problem, found.displacement, found.approach)

    def load_distribution(self, load: float, *, cage_angle: float = 0.0) -> LoadDistribution:
        """Return the loads of the elements at a cage angle; NaN where the state is not converged."""
        state = self.state(load, cage_angle=cage_angle)
        loads = state.loads if state.converged else np.full(self.n_elements, math.nan)
        return LoadDistribution(state.angles, loads, state.displacement)

    def stiffness_over_passage(self, load: float, *, points: int = 96) -> FePassage:
        """Return the stiffness while the cage turns by one spacing; ``points`` cage angles lie evenly over it."""
        turns = self.spacing * np.arange(points) / points
        states = list[FeState]()
        for turn in turns:
            states.append(self.state(load, cage_angle=float(turn), start=states[-1] if states else None))
        return FePassage(turns, np.array([_or_nan(state) for state in states]), tuple(states))

    def stiffness_against_load(
        self, loads: Sequence[float], *, points: int = 64
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return displacement along the load, m, (loads,), and stiffness, N/m, (loads, 2, 2): means over a passage.

        Both are NaN where a state of the passage is not converged.
        """
        displacement, stiffness = np.empty(len(loads)), np.empty((len(loads), 2, 2))
        for i, load in enumerate(loads):
            passage = self.stiffness_over_passage(load, points=points)
            stiffness[i] = passage.mean
            displacement[i] = np.mean([s.displacement[0] if s.converged else math.nan for s in passage.states])
        return displacement, stiffness


@dataclass(frozen=True, eq=False)
class _Problem:
    """One equilibrium to solve: N (2, Z), slack (Z,), S (Z, Z), ds/dF (Z, 2), F (2,)."""

    law: ElementLaw
    normals: NDArray[np.float64]
    slack: NDArray[np.float64]
    influence: NDArray[np.float64]
    bore: NDArray[np.float64]
    load: NDArray[np.float64]

    @classmethod
    def of(
        cls, bearing: AssembledBearing, angles: NDArray[np.float64], slack: NDArray[np.float64], load: float
    ) -> _Problem:
        bore = np.zeros((len(angles), 2))
        if bearing.bore_load is not None:
            # The pressure turns with the load: a small load across turns it by the ratio of both.
            along, slope = bearing.bore_load.on_elements(angles)
            bore = np.stack((along, -slope), axis=1)
        normals = np.stack((np.cos(angles), np.sin(angles)))
        return cls(bearing.law, normals, slack, bearing.influence(angles), bore, np.array([load, 0.0]))

    def reach(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the approach of the races at each element without the forces on the elements, m."""
        return u @ self.normals - self.slack - self.bore @ self.load

    def tangent(self, slope: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dQ/d(reach), N/m, shape (Z, Z), symmetric, of dQ/d delta of the law (Z,)."""
        return _solve(np.eye(len(slope)) + slope[:, None] * self.influence, np.diag(slope))


def _finished(
    bearing: AssembledBearing, problem: _Problem, u: NDArray[np.float64], delta: NDArray[np.float64]
) -> FeState:
    """Return the state with its checks, which read the forces alone and not how the iteration ended."""
    force, slope = problem.law.force(delta)
    load = float(problem.load[0])
    imbalance = float(np.abs(problem.normals @ force - problem.load).max()) / load if load > 0.0 else 0.0
    # The approach comes from the inverse of the law, and the rest from the displacement: no part of the iteration.
    gap = problem.reach(u) - problem.influence @ force - problem.law.approach_of(force)
    wrong = np.where(force > 0.0, np.abs(gap), np.maximum(gap, 0.0))
    contact_error = float(wrong.max())
    status: FeStatus = "converged"
    if not problem.law.covers(float(force.max())):
        status = "outside_law"
    elif not imbalance <= EQUILIBRIUM_TOLERANCE:
        status = "not_in_equilibrium"
    elif not contact_error <= CONTACT_TOLERANCE * float(np.abs(delta).max()):
        status = "contact_violated"
    stiffness, line, line_stiffness = _stiffness(bearing, problem, u, force, slope)
    weak = force < problem.law.lowest
    return FeState(
        load=load,
        displacement=u,
        stiffness=stiffness,
        bore_line=line,
        bore_line_stiffness=line_stiffness,
        angles=wrap(np.arctan2(problem.normals[1], problem.normals[0])),
        loads=force,
        status=status,
        imbalance=imbalance,
        contact_error=contact_error,
        below_law=float(problem.normals[0] @ np.where(weak, force, 0.0)) / load if load > 0.0 else 0.0,
        mesh_error=problem.law.mesh_error,
    )


def _stiffness(
    bearing: AssembledBearing,
    problem: _Problem,
    u: NDArray[np.float64],
    force: NDArray[np.float64],
    slope: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float, float]:
    """Return dF/du (2, 2), the displacement of the bore's line along the load, and dF over that (implicit derivative).

    dQ = T (N' du - s dF) and dF = N dQ, so that (1 + N T s) dF = N T N' du.
    """
    tangent = problem.tangent(slope)
    normals = problem.normals
    stiffness = _solve(np.eye(2) + normals @ tangent @ problem.bore, normals @ tangent @ normals.T)
    if bearing.bore_load is None:
        along = _along(stiffness)
        return stiffness, float(u[0]), along
    line = bearing.bore_load.bore_line(np.arctan2(normals[1], normals[0]))
    at_load, load = bearing.bore_load.bore_at_load, float(problem.load[0])
    displacement = float(u[0] + at_load * load + line @ force)
    compliance = np.linalg.pinv(stiffness, rcond=1e-12)[:, 0]
    change = tangent @ (normals.T @ compliance - problem.bore[:, 0])
    return stiffness, displacement, 1.0 / float(compliance[0] + at_load + line @ change)


def _along(stiffness: NDArray[np.float64]) -> float:
    """Return dF/d delta along the load, the displacement across free to follow, N/m."""
    if stiffness[1, 1] <= 0.0:
        return float(stiffness[0, 0])
    return float(stiffness[0, 0] - stiffness[0, 1] * stiffness[1, 0] / stiffness[1, 1])


def _solve(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def _or_nan(state: FeState) -> NDArray[np.float64]:
    return state.stiffness if state.converged else np.full((2, 2), math.nan)
