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
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.fe.bearings.balance import descend
from models.machine.load_distribution import LoadDistribution, StiffnessPassage
from models.path.defect import wrap
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.element import FeContact
    from models.fe.bearings.law import ElementLaw
    from models.fe.bearings.rings import BoreLoad, RingInfluence
    from models.fe.meshes.geometry import Race

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


class PassingElements(ABC):
    """Elements that pass under a radial load: states, stiffness over a passage, and against the load."""

    law: ElementLaw
    n_elements: int

    @property
    def spacing(self) -> float:
        """Angle between neighbouring elements of a row, rad."""
        return 2.0 * math.pi / self.n_elements

    @abstractmethod
    def state(self, load: float, *, cage_angle: float = 0.0, start: FeState | None = None) -> FeState:
        """Return the equilibrium under a radial load, N, at a cage angle, rad.

        Args:
            start: state at a load and cage angle close by, from which an iteration may start.
        """

    def turns(self, points: int) -> NDArray[np.float64]:
        """Return cage angles that lie evenly over one spacing, rad, shape (points,)."""
        return np.asarray(self.spacing * np.arange(points) / points, dtype=np.float64)

    def stiffness_over_passage(self, load: float, *, points: int = 96) -> FePassage:
        """Return the stiffness while the cage turns by one spacing; ``points`` cage angles lie evenly over it."""
        turns = self.turns(points)
        states = list[FeState]()
        for turn in turns:
            states.append(self.state(load, cage_angle=float(turn), start=states[-1] if states else None))
        unknown = np.full((2, 2), math.nan)
        matrix = np.array([state.stiffness if state.converged else unknown for state in states])
        return FePassage(turns, matrix, tuple(states))

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

    def check(
        self,
        forces: NDArray[np.float64],
        approach: NDArray[np.float64],
        gap: NDArray[np.float64],
        imbalance: float,
    ) -> tuple[FeStatus, float]:
        """Return the status of a finished state and its contact error, m.

        Args:
            forces: of the elements, N.
            approach: of the races at each, m.
            gap: of each, what the displacement leaves less what its force needs, m.
            imbalance: of the forces, as a share of the load.
        """
        contact_error = float(np.where(forces > 0.0, np.abs(gap), np.maximum(gap, 0.0)).max())
        status: FeStatus = "converged"
        if not self.law.covers(float(forces.max())):
            status = "outside_law"
        elif not imbalance <= EQUILIBRIUM_TOLERANCE:
            status = "not_in_equilibrium"
        elif not contact_error <= CONTACT_TOLERANCE * float(np.abs(approach).max()):
            status = "contact_violated"
        return status, contact_error

    def below_law(self, forces: NDArray[np.float64], along: NDArray[np.float64]) -> float:
        """Return the force along the load, N, of elements below the law's lowest load; ``along`` are their cosines."""
        return float(along @ np.where(forces < self.law.lowest, forces, 0.0))


@dataclass(frozen=True, eq=False)
class FeBearing:
    """A bearing of finite elements with what it was made of.

    Attributes:
        assembled: valid from a quarter of the load to four times it, as far as the contacts stay on the races; a state
            beyond that is not converged.
        contacts: of the most loaded element under the load, one element standing in its direction; none where they
            are not kept.
        unknowns: largest number of unknowns of each body.
    """

    assembled: PassingElements
    contacts: Mapping[Race, FeContact]
    unknowns: Mapping[str, int]


@dataclass(frozen=True, eq=False)
class AssembledBearing(PassingElements):
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

    def _slack(self, gaps: NDArray[np.float64] | None) -> NDArray[np.float64]:
        """Return the clearance of each element, m, shape (elements,)."""
        slack = np.full(self.n_elements, self.clearance)
        if gaps is None:
            return slack
        if gaps.shape != slack.shape:
            raise WrongInputError(f"expected a gap of each of {self.n_elements} elements, got shape {gaps.shape}")
        return slack + gaps

    def _bore(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return by how much the races move apart for a load along and across, m/N, shape (elements, 2)."""
        if self.bore_load is None:
            return np.zeros((len(angles), 2))
        # The pressure turns with the load: a small load across turns it by the ratio of both.
        along, slope = self.bore_load.on_elements(angles)
        return np.stack((along, -slope), axis=1)

    def load_distribution(self, load: float, *, cage_angle: float = 0.0) -> LoadDistribution:
        """Return the loads of the elements at a cage angle; NaN where the state is not converged."""
        state = self.state(load, cage_angle=cage_angle)
        loads = state.loads if state.converged else np.full(self.n_elements, math.nan)
        return LoadDistribution(state.angles, loads, state.displacement)

    def state(
        self,
        load: float,
        *,
        cage_angle: float = 0.0,
        start: FeState | None = None,
        gaps: NDArray[np.float64] | None = None,
    ) -> FeState:
        """Return the equilibrium under a radial load, N, at a cage angle, rad.

        Its checks read the forces alone and not how the iteration ended.

        Args:
            gaps: further clearance of each element, m, shape (elements,): where it is over a defect, or is smaller.

        Raises:
            WrongInputError: the load is negative or not finite, or there are not as many gaps as elements.
        """
        if not (math.isfinite(load) and load >= 0.0):
            raise WrongInputError(f"expected a load that is finite and not negative, got {load!r} N")
        angles, wanted = self.angles(cage_angle), np.array([load, 0.0])
        normals = np.stack((np.cos(angles), np.sin(angles)))
        slack, influence, bore = self._slack(gaps), self.influence(angles), self._bore(angles)
        moved = bore @ wanted
        begin = None if start is None else start.displacement
        found = descend(normals.T, self.law, wanted, influence, slack + moved, begin)
        u, force, slope = found.displacement, *self.law.force(found.approach)
        imbalance = float(np.abs(normals @ force - wanted).max()) / load if load > 0.0 else 0.0
        # The approach comes from the inverse of the law, and the rest from the displacement: no part of the iteration.
        gap = u @ normals - slack - moved - influence @ force - self.law.approach_of(force)
        status, contact_error = self.check(force, found.approach, gap, imbalance)
        # dQ/d(reach), N/m, symmetric.
        tangent = np.linalg.solve(np.eye(len(slope)) + slope[:, None] * influence, np.diag(slope))
        # dQ = T (N' du - s dF) and dF = N dQ, so that (1 + N T s) dF = N T N' du.
        coupled = np.eye(2) + normals @ tangent @ bore
        stiffness = np.asarray(np.linalg.solve(coupled, normals @ tangent @ normals.T), dtype=np.float64)
        line, line_stiffness = float(u[0]), _along(stiffness)
        if self.bore_load is not None:
            under = self.bore_load.bore_line(np.arctan2(normals[1], normals[0]))
            at_load = self.bore_load.bore_at_load
            line = float(u[0] + at_load * load + under @ force)
            compliance = np.linalg.pinv(stiffness, rcond=1e-12)[:, 0]
            change = tangent @ (normals.T @ compliance - bore[:, 0])
            line_stiffness = 1.0 / float(compliance[0] + at_load + under @ change)
        return FeState(
            load=load,
            displacement=u,
            stiffness=stiffness,
            bore_line=line,
            bore_line_stiffness=line_stiffness,
            angles=wrap(np.arctan2(normals[1], normals[0])),
            loads=force,
            status=status,
            imbalance=imbalance,
            contact_error=contact_error,
            below_law=self.below_law(force, normals[0]) / load if load > 0.0 else 0.0,
            mesh_error=self.law.mesh_error,
        )


def _along(stiffness: NDArray[np.float64]) -> float:
    """Return dF/d delta along the load, the displacement across free to follow, N/m."""
    if stiffness[1, 1] <= 0.0:
        return float(stiffness[0, 0])
    return float(stiffness[0, 0] - stiffness[0, 1] * stiffness[1, 0] / stiffness[1, 1])
