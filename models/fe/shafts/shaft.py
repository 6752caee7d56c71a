"""Stiffness of a shaft on its support bearings: a meshed shaft, condensed to its seats, on springs that are not linear.

The model is that of the thesis, section 4.4.1 and Fig. 35: every point of a seat of a support moves with the seat's
centre as if the seat were rigid, the centre is held by a spring that has the radial stiffness of the bearing, and the
seat of the test bearing is under a sinusoidal pressure. The shaft itself is linear, so that it is factorised once; what
is left for each load are the motions of the seats: shift along the load, shift along the shaft and tilt of each.

z runs along the shaft from its first end, y along the load. SI units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.fe.meshes.shaft_mesh import ShaftMeshRule, Step, check_shaft, shaft_mesh
from models.fe.shafts.spring import RadialSpring
from models.fe.solid.elastic import ElasticBody
from models.fe.solid.traction import boundary_points, mean_weights, traction_loads
from models.words.checks import check_numbers

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

PER_SEAT = 3
"""Motions of a seat: shift along the load, shift along the shaft, tilt about the axis across both."""
# Of the shift of the seats: how far each spring's displacement may be from the seat's.
_TOLERANCE = 1e-10
# Of the largest force or moment on a seat: what may be left of the balance.
_BALANCE = 1e-8
_STEPS = 60
_NO_FORCE = 1e-9


@dataclass(frozen=True)
class ShaftSeat:
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
class ShaftSupport:
    """A support bearing: its rigid seat, its radial spring, and its stiffness against tilting, N m/rad.

    A self-aligning bearing has no stiffness against tilting.
    """

    seat: ShaftSeat
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
    loaded: ShaftSeat
    supports: tuple[ShaftSupport, ...]
    modulus: float = 210e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        """Raise a ValueError that names what is missing."""
        if not self.supports or (len(self.supports) == 1 and self.supports[0].tilt_stiffness == 0.0):
            raise ValueError("a shaft needs two supports, or one that withstands tilting")
        if not self.steps:
            raise ValueError("a shaft needs one step at least, got none")

    @property
    def seats(self) -> dict[str, ShaftSeat]:
        """Seats by the names of their surfaces: "loaded", "support0", "support1" and so on."""
        return {"loaded": self.loaded} | {f"support{i}": support.seat for i, support in enumerate(self.supports)}

    def check_seats(self) -> None:
        """Raise a ValueError where steps do not touch, a seat is not on one step, or two of them overlap."""
        check_shaft(self.steps, {name: (seat.begin, seat.end) for name, seat in self.seats.items()})

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
        volume: m3.
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
        converged: whether the forces balance and each spring is displaced as its seat is.
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
    shaft.check_seats()
    seats = shaft.seats
    mesh = shaft_mesh(shaft.steps, {name: (seat.begin, seat.end) for name, seat in seats.items()}, rule)
    held = [name for name in seats if name != "loaded"]
    body = ElasticBody(mesh, shaft.modulus, shaft.poisson, {"x0": (0,)} | dict.fromkeys(held, (0, 1, 2)))
    motions = np.concatenate([_rigid_motions(body, name, seats[name].middle) for name in held], axis=1)
    push = _sinusoidal_push(body, "loaded")
    observe = np.stack(
        [mean_weights(body, boundary_points(body, name), 1) for name in (shaft.loaded_end, "loaded")], axis=1
    )
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
        volume=sum(math.pi * step.length * (step.diameter**2 - step.bore**2) / 4.0 for step in shaft.steps),
    )


def settle_shaft(condensed: CondensedShaft, supports: Sequence[ShaftSupport], load: float) -> ShaftState:
    """Return the state of a condensed shaft on its springs under a load, N.

    Newton's method on motions and spring forces together: each spring gives a displacement for a force, which is
    defined within its play too, where a force for a displacement has no slope. The first support holds the shaft along
    its axis; the others let it slide.
    """
    count, motions = len(supports), PER_SEAT * len(supports)
    shift = PER_SEAT * np.arange(count)
    # The shift of the first seat along the shaft is zero; that of the others costs nothing.
    kept = np.setdiff1d(np.arange(motions), [1])
    base = np.zeros((motions + count, motions + count))
    base[:motions, :motions] = condensed.stiffness
    base[shift + 2, shift + 2] += [support.tilt_stiffness for support in supports]
    base[shift, motions + np.arange(count)] = base[motions + np.arange(count), shift] = 1.0
    known = np.concatenate((load * condensed.carried, np.zeros(count)))
    used = np.concatenate((kept, motions + np.arange(count)))
    forces = np.full(count, load)
    # In units of a stiffness of the supports, both kinds of unknowns are displacements.
    unit = load / supports[0].spring.displacement_at(load)
    scale = np.concatenate((np.ones(motions), np.full(count, unit)))[used]
    q, miss, iterations = np.zeros(motions), math.inf, 0
    while miss > _TOLERANCE and iterations < _STEPS:
        springs = [_spring_shift(support.spring, float(r), load) for support, r in zip(supports, forces, strict=True)]
        matrix, right = base.copy(), known.copy()
        at = motions + np.arange(count)
        # q - u(R) = 0 is linear in R about the forces so far.
        matrix[at, at] = [-slope for _, slope in springs]
        right[at] = [u - slope * r for (u, slope), r in zip(springs, forces, strict=True)]
        scaled = matrix[np.ix_(used, used)] * scale
        solution = scale * np.linalg.solve(scaled, right[used])
        q[kept] = solution[: len(kept)]
        forces = solution[len(kept) :]
        found = np.array([_spring_shift(s.spring, float(r), load)[0] for s, r in zip(supports, forces, strict=True)])
        miss = float(np.abs(q[shift] - found).max() / np.abs(q[shift]).max())
        iterations += 1
    end, seat = (load * condensed.observed_flexibility + condensed.observed_motion @ q).tolist()
    left = (base[:motions] @ np.concatenate((q, forces)) - known[:motions])[kept]
    balanced = float(np.abs(left).max()) <= _BALANCE * float(np.abs(known).max())
    converged = bool(miss <= _TOLERANCE) and balanced
    return ShaftState(load, q.reshape(-1, PER_SEAT), forces, end, seat, iterations, converged)


def _spring_shift(spring: RadialSpring, force: float, load: float) -> tuple[float, float]:
    """Return the displacement of a spring under a force of either sign, m, and its slope, m/N.

    Within a billionth of the load the displacement goes evenly through the play, so that it is one of the force.
    """
    least = _NO_FORCE * load
    size = max(abs(force), least)
    shift = spring.displacement_at(size)
    if abs(force) < least:
        return force / least * shift, shift / least
    return math.copysign(shift, force), 1.0 / spring.force(shift)[1]


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


def _sinusoidal_push(body: ElasticBody, name: str) -> NDArray[np.float64]:
    """Return the loads, (3 nodes,), of a pressure of 1 N along y on the whole shaft, 1/2 N on its meshed half.

    The pressure goes with the cosine of the angle from the load, over the half that faces it (thesis, Fig. 21).
    """
    points = boundary_points(body, name)
    facing = -points.normals[1]
    pressure = np.maximum(facing, 0.0)
    pressure *= 0.5 / float(np.sum(pressure * facing * points.weights))
    return traction_loads(body, points, -pressure * points.normals)
