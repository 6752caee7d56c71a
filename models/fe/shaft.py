"""Stiffness of a shaft on its support bearings: a meshed shaft, condensed to its seats, on springs that are not linear.

The model is that of the thesis, section 4.4.1 and Fig. 35: every point of a seat of a support moves with the seat's
centre as if the seat were rigid, the centre is held by a spring that has the radial stiffness of the bearing, and the
seat of the test bearing is under a sinusoidal pressure. The shaft itself is linear, so that it is factorised once; what
is left for each load are the motions of the seats: shift along the load, shift along the shaft and tilt of each.

z runs along the shaft from its first end, y along the load. SI units.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from models.checks import check_numbers
from models.fe.elastic import ElasticBody
from models.fe.extra import require_skfem
from models.fe.shaft_mesh import ShaftMeshRule, Step, shaft_mesh
from models.fe.spring import RadialSpring

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

PER_SEAT = 3
"""Motions of a seat: shift along the load, shift along the shaft, tilt about the axis across both."""
_TOLERANCE = 1e-10
_STEPS = 60


@dataclass(frozen=True)
class Seat:
    """A cylindrical surface of a shaft, from a first to a last place along it, m."""

    begin: float
    end: float

    def __post_init__(self) -> None:
        """Raise a ValueError for places that are not in order."""
        if not (math.isfinite(self.begin) and math.isfinite(self.end) and 0.0 <= self.begin < self.end):
            raise ValueError(
                f"a seat goes from a place along the shaft to a later one, got {self.begin!r}, {self.end!r} m"
            )

    @property
    def middle(self) -> float:
        """Place of the centre, m."""
        return 0.5 * (self.begin + self.end)


@dataclass(frozen=True)
class Support:
    """A support bearing: its rigid seat, its radial spring, and its stiffness against tilting, N m/rad.

    A self-aligning bearing has no stiffness against tilting.
    """

    seat: Seat
    spring: RadialSpring
    tilt_stiffness: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError for an unusable stiffness."""
        check_numbers(self, "support.", "not negative", "tilt_stiffness")


@dataclass(frozen=True)
class SteppedShaft:
    """A shaft, where it is loaded and what holds it.

    Attributes:
        steps: lengths of one diameter, from the first end.
        loaded: seat of the test bearing.
        supports: two at least, unless the one withstands tilting; the first one holds the shaft along its axis.
        modulus, poisson: Young's modulus, Pa, and Poisson's ratio.
    """

    steps: tuple[Step, ...]
    loaded: Seat
    supports: tuple[Support, ...]
    modulus: float = 210e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        """Raise a ValueError that names what is missing."""
        if not self.supports or (len(self.supports) == 1 and self.supports[0].tilt_stiffness == 0.0):
            raise ValueError("a shaft needs two supports, or one that withstands tilting")
        if not self.steps:
            raise ValueError("a shaft needs one step at least, got none")

    @property
    def length(self) -> float:
        """Whole length, m."""
        return sum(step.length for step in self.steps)

    @property
    def loaded_end(self) -> str:
        """The end of the shaft that is nearer to the load: "first" or "last"."""
        return "first" if self.loaded.middle <= 0.5 * self.length else "last"


@dataclass(frozen=True, eq=False)
class CondensedShaft:
    """A shaft reduced to the motions of its seats; the whole shaft, not the half that is meshed.

    Attributes:
        stiffness: forces on the seats' centres over their motions, shape (3 seats, 3 seats): N/m, N, N m/rad.
        carried: what a load of 1 N at the loaded seat sends to the seats held still, shape (3 seats,).
        observed_flexibility: mean shift along the load of the observed surfaces per newton, seats held still, m/N,
            shape (2,): the end of the shaft next to the load, the loaded seat.
        observed_motion: the same over the motions of the seats, shape (2, 3 seats).
        unknowns: of the factorised body.
        volume: of the mesh, m3.
    """

    stiffness: NDArray[np.float64]
    carried: NDArray[np.float64]
    observed_flexibility: NDArray[np.float64]
    observed_motion: NDArray[np.float64]
    unknowns: int
    volume: float


@dataclass(frozen=True, eq=False)
class ShaftState:
    """A shaft under one load.

    Attributes:
        load: N.
        seats: motions of the supports' seats, shape (supports, 3): along the load, along the shaft, m, tilt, rad.
        reactions: force of each spring on the shaft against the load, N, shape (supports,).
        end, seat: mean shift of the end next to the load, and of the loaded seat, m.
        iterations: of Newton's method.
        converged: whether the forces balance to 1e-10 of the load.
    """

    load: float
    seats: NDArray[np.float64]
    reactions: NDArray[np.float64]
    end: float
    seat: float
    iterations: int
    converged: bool

    @property
    def stiffness(self) -> float:
        """Load over the mean shift of the shaft's end, N/m: k_i as the thesis takes it (Table 15)."""
        return self.load / self.end

    @property
    def seat_stiffness(self) -> float:
        """Load over the mean shift of the loaded seat, N/m."""
        return self.load / self.seat


@dataclass(frozen=True)
class ShaftModel:
    """A shaft with the mesh it is computed on; meshed and factorised when it is first needed."""

    shaft: SteppedShaft
    rule: ShaftMeshRule = field(default_factory=ShaftMeshRule)

    @cached_property
    def condensed(self) -> CondensedShaft:
        """The shaft reduced to the motions of its seats."""
        return condense_shaft(self.shaft, self.rule)

    def solve(self, load: float) -> ShaftState:
        """Return the state under a load, N.

        Raises:
            ValueError: if the load is not positive.
        """
        if not (math.isfinite(load) and load > 0.0):
            raise ValueError(f"load must be positive and finite, got {load!r}")
        return settle_shaft(self.condensed, self.shaft.supports, load)


def condense_shaft(shaft: SteppedShaft, rule: ShaftMeshRule | None = None) -> CondensedShaft:
    """Return a shaft reduced to the motions of its rigid seats, by static condensation (Guyan).

    Raises:
        ValueError: if a seat is not on one step, or two of them overlap.
        MissingExtraError: scikit-fem is missing.
    """
    seats = {"loaded": shaft.loaded} | {f"support{i}": s.seat for i, s in enumerate(shaft.supports)}
    ordered = sorted(seats.values(), key=lambda seat: seat.begin)
    if any(after.begin < before.end for before, after in itertools.pairwise(ordered)):
        raise ValueError(f"seats of the shaft overlap: {ordered!r}")
    mesh = shaft_mesh(shaft.steps, {name: (seat.begin, seat.end) for name, seat in seats.items()}, rule)
    held = [name for name in seats if name != "loaded"]
    body = ElasticBody(mesh, shaft.modulus, shaft.poisson, {"x0": (0,)} | dict.fromkeys(held, (0, 1, 2)))
    motions = np.concatenate([_rigid_motions(body, name, seats[name].middle) for name in held], axis=1)
    push = _sinusoidal_push(body, "loaded")
    observe = np.stack([_mean_shift(body, shaft.loaded_end), _mean_shift(body, "loaded")], axis=1)
    # The whole shaft is twice the half that is meshed.
    pulled = body.stiffness @ motions
    moved = motions - body.solve(pulled)
    pushed = body.solve(push)
    stiffness = 2.0 * np.asarray(moved.T @ (body.stiffness @ moved))
    return CondensedShaft(
        stiffness=0.5 * (stiffness + stiffness.T),
        carried=2.0 * np.asarray(moved.T @ push),
        observed_flexibility=np.asarray(observe.T @ pushed),
        observed_motion=np.asarray(observe.T @ moved),
        unknowns=body.unknowns,
        volume=_volume(body),
    )


def settle_shaft(condensed: CondensedShaft, supports: Sequence[Support], load: float) -> ShaftState:
    """Return the state of a condensed shaft on its springs under a load, N.

    Newton's method on the balance of the seats, each step halved until the imbalance falls. The first support holds
    the shaft along its axis; the others let it slide.
    """
    shift = np.arange(len(supports)) * PER_SEAT
    slide, tilt = shift + 1, shift + 2
    # The axial shift of the first seat is zero; that of the others costs nothing.
    free = np.setdiff1d(np.arange(PER_SEAT * len(supports)), slide[:1])
    tilting = np.array([support.tilt_stiffness for support in supports])
    target = load * condensed.carried

    def balance(q: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what is missing to equilibrium (3 seats,) and its derivative."""
        held = [support.spring.force(float(q[i])) for support, i in zip(supports, shift, strict=True)]
        missing, slope = target - condensed.stiffness @ q, condensed.stiffness.copy()
        missing[shift] -= [force for force, _ in held]
        missing[tilt] -= tilting * q[tilt]
        slope[shift, shift] += [stiffness for _, stiffness in held]
        slope[tilt, tilt] += tilting
        return missing, slope

    q = _start(condensed, supports, load, free)
    missing, slope = balance(q)
    # Moments are weighed against forces by the distance between the seats, which the stiffness itself holds.
    scale = np.sqrt(np.diag(condensed.stiffness))[free]
    level = float(np.linalg.norm(missing[free] / scale))
    goal = _TOLERANCE * float(np.linalg.norm(target[free] / scale))
    iterations = 0
    while level > goal and iterations < _STEPS:
        step = np.zeros_like(q)
        step[free] = np.linalg.solve(slope[np.ix_(free, free)], missing[free])
        share = 1.0
        while True:
            trial = q + share * step
            missing, slope = balance(trial)
            reached = float(np.linalg.norm(missing[free] / scale))
            if reached < level or share < 1e-6:
                break
            share *= 0.5
        q, level = trial, reached
        iterations += 1
    end, seat = (load * condensed.observed_flexibility + condensed.observed_motion @ q).tolist()
    reactions = np.array([s.spring.force(float(q[i]))[0] for s, i in zip(supports, shift, strict=True)])
    return ShaftState(load, q.reshape(-1, PER_SEAT), reactions, end, seat, iterations, bool(level <= goal))


def _start(
    condensed: CondensedShaft, supports: Sequence[Support], load: float, free: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the motions on linear springs, those of the supports under a load of this size."""
    slope = condensed.stiffness.copy()
    for number, support in enumerate(supports):
        slope[PER_SEAT * number, PER_SEAT * number] += load / support.spring.displacement_at(load)
        slope[PER_SEAT * number + 2, PER_SEAT * number + 2] += support.tilt_stiffness
    q = np.zeros(len(slope))
    q[free] = np.linalg.solve(slope[np.ix_(free, free)], load * condensed.carried[free])
    return q


def _rigid_motions(body: ElasticBody, name: str, middle: float) -> NDArray[np.float64]:
    """Return what unit motions of a seat do to its nodes, (3 nodes, 3): along y, along z, about x."""
    facets = np.asarray(body.mesh.boundaries[name])
    nodes = np.unique(np.asarray(body.dofs.get_facet_dofs(facets).flatten()))
    motions = np.zeros((body.nodes.shape[1], 3, PER_SEAT))
    motions[nodes, 1, 0] = 1.0
    motions[nodes, 2, 1] = 1.0
    motions[nodes, 1, 2] = -(body.nodes[2, nodes] - middle)
    motions[nodes, 2, 2] = body.nodes[1, nodes]
    return motions.reshape(-1, PER_SEAT)


def _facet_basis(body: ElasticBody, name: str) -> tuple[Any, NDArray[np.float64]]:
    """Return scikit-fem's basis on a boundary, and the values of the shape functions (functions, facets, points)."""
    basis = require_skfem().FacetBasis(
        body.mesh, body.element, facets=np.asarray(body.mesh.boundaries[name]), intorder=6
    )
    return basis, np.stack([np.asarray(basis.basis[i][0]) for i in range(basis.Nbfun)])


def _sinusoidal_push(body: ElasticBody, name: str) -> NDArray[np.float64]:
    """Return the loads, (3 nodes,), of a pressure of 1 N along y on the whole shaft, 1/2 N on its meshed half.

    The pressure goes with the cosine of the angle from the load, over the half that faces it (thesis, Fig. 21).
    """
    basis, values = _facet_basis(body, name)
    normals = np.asarray(basis.normals)
    pressure = np.maximum(-normals[1], 0.0) * np.asarray(basis.dx)
    pressure *= 0.5 / float(np.sum(-normals[1] * pressure))
    push = np.zeros((body.nodes.shape[1], 3))
    for component in range(3):
        shares = np.einsum("afq,fq->af", values, -normals[component] * pressure)
        np.add.at(push[:, component], np.asarray(basis.element_dofs), shares)
    return push.ravel()


def _mean_shift(body: ElasticBody, name: str) -> NDArray[np.float64]:
    """Return the weights of the mean shift along y of a boundary, (3 nodes,)."""
    basis, values = _facet_basis(body, name)
    weights = np.zeros((body.nodes.shape[1], 3))
    shares = np.einsum("afq,fq->af", values, np.asarray(basis.dx))
    np.add.at(weights[:, 1], np.asarray(basis.element_dofs), shares / float(np.sum(basis.dx)))
    return weights.ravel()


def _volume(body: ElasticBody) -> float:
    """Return the volume of the whole shaft, m3."""
    basis = require_skfem().Basis(body.mesh, body.element, intorder=4)
    return 2.0 * float(np.sum(basis.dx))
