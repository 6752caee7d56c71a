"""The inner ring of a bearing on a meshed solid shaft, which touches its bore and may part from it (thesis, 3.4.3).

The shaft is a disc as wide as the ring, loaded at its centre. Between both there is a pressure without friction or
clearance, linear between points around the bore and along it, never below zero. The elements stand symmetrically about
the load. What the ring yields under an element beyond the element law, which was computed with a fixed bore, is the
difference of both supports on one mesh.

Quarters of ring and shaft are solved, x >= 0 and z >= 0; pressures and forces are those of the whole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.checks import check_whole
from models.fe.balance import Balance, settle
from models.fe.elastic import ElasticBody
from models.fe.ring_bodies import INFLUENCE_RULE, RingBody, bore_traction, influence_load
from models.fe.shaft_mesh import ShaftMeshRule, Step, shaft_mesh
from models.fe.sizing import MeshRule
from models.fe.traction import BoundaryPoints, boundary_points, traction_loads

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.assembled import AssembledBearing
    from models.fe.geometry import FeGeometry

_TOLERANCE = 1e-9
_BALANCE = 1e-8
_EXCHANGES = 200
_SURFACE = "seat"


@dataclass(frozen=True)
class FitRule:
    """Sizes of what is computed.

    Attributes:
        angles, layers: points of the pressure over half the bore, and over half its width.
        ring: mesh of the ring.
        shaft: mesh of the shaft.
    """

    angles: int = 25
    layers: int = 3
    ring: MeshRule = INFLUENCE_RULE
    shaft: ShaftMeshRule = field(default_factory=lambda: ShaftMeshRule(eighth=6, size=0.2, finest=0.5))

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_whole(self.angles, "rule.angles", 3)
        check_whole(self.layers, "rule.layers", 2)


@dataclass(frozen=True, eq=False)
class FittedState:
    """A bearing on a solid shaft under a load.

    Attributes:
        load: N.
        angles: of the elements of one side, from the load, rad, shape (elements,).
        loads: on each of them, N.
        displacement: of the bore along the load, its first harmonic, m.
        bore_line: of the bore where the plane of the load meets it, m.
        pressure: at the points of the bore, Pa, shape (rule.angles, rule.layers).
        parted: angle from the load from which on the shaft does not touch the bore, rad; pi where it does all around.
        exchanges: of the active sets.
        converged: whether forces balance, and no pressure or force pulls where nothing overlaps.
    """

    load: float
    angles: NDArray[np.float64]
    loads: NDArray[np.float64]
    displacement: float
    bore_line: float
    pressure: NDArray[np.float64]
    parted: float
    exchanges: int
    converged: bool


@dataclass(frozen=True, eq=False)
class _Balanced:
    """A body that nothing holds: loads are balanced by a pressure cos(angle); its surface has no first harmonic."""

    body: ElasticBody
    cosine: NDArray[np.float64]

    @property
    def shift(self) -> NDArray[np.float64]:
        """A unit shift along the load, (3 nodes,)."""
        shift = np.zeros(self.body.nodes.size)
        shift[1::3] = 1.0
        return shift

    def solve(self, loads: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return displacements under loads, each (3 nodes, cases)."""
        shift = self.shift
        stiffness = float(self.cosine @ shift)
        u = self.body.solve(loads - np.outer(self.cosine, shift @ loads) / stiffness)
        return u - np.outer(shift, self.cosine @ u) / stiffness


class SolidShaft:
    """Inner ring and shaft of a bearing, factorised once; ``solve`` serves any law, load and symmetric place.

    Args:
        geometry: of the bearing.
        rule: of meshes and pressures.
    """

    def __init__(self, geometry: FeGeometry, rule: FitRule | None = None) -> None:
        """Mesh the ring; ring and shaft are factorised when they are first needed."""
        self.geometry = geometry
        self.rule = rule or FitRule()
        self.ring = RingBody.of(geometry, "inner", influence_load(geometry), self.rule.ring)

    @property
    def unknowns(self) -> dict[str, int]:
        """Unknowns of the factorised bodies."""
        return {"inner ring": self._free.body.unknowns, "shaft": self._disc.body.unknowns}

    @cached_property
    def _held(self) -> ElasticBody:
        return self.ring.held()

    @cached_property
    def _free(self) -> _Balanced:
        body = self.ring.free()
        return _Balanced(body, bore_traction(body, np.cos))

    @cached_property
    def _disc(self) -> _Balanced:
        steel, half = self.geometry, 0.5 * self.geometry.width
        mesh = shaft_mesh((Step(half, 2.0 * steel.bore_radius),), {_SURFACE: (0.0, half)}, self.rule.shaft)
        places = np.asarray(mesh.doflocs)
        lonely = int(np.argmin(places[1]))
        body = ElasticBody(mesh, steel.modulus, steel.poisson, {"x0": (0,), "first": (2,), lonely: (1,)})
        points = boundary_points(body, _SURFACE)
        return _Balanced(body, traction_loads(body, points, points.normals * points.normals[1]))

    @cached_property
    def _bore(self) -> _Bore:
        """What pressures on the bore and a newton at the shaft's centre do."""
        ring, disc = self._free, self._disc
        inside = boundary_points(ring.body, "bore")
        outside = boundary_points(disc.body, _SURFACE)
        push = self._pressures(ring.body, inside, -1.0)
        press = self._pressures(disc.body, outside, 1.0)
        # Both meshes meet the circle to third order: the resultants are made one.
        share = ring.shift @ push, disc.shift @ press
        press *= np.where(np.abs(share[1]) > 1e-12 * np.abs(share[1]).max(), share[0] / share[1], 1.0)
        centre = np.zeros(disc.body.nodes.size)
        axis = np.nonzero(np.hypot(*disc.body.nodes[:2]) < 1e-9 * self.geometry.bore_radius)[0]
        middle = axis[np.argmin(disc.body.nodes[2, axis])]
        centre[3 * int(middle) + 1] = 0.25
        u = disc.solve(np.column_stack((press, centre)))
        moved = press.T @ u
        return _Bore(push, ring.solve(push), moved[:, :-1], moved[:, -1], ring.shift @ push)

    def _pressures(self, body: ElasticBody, points: BoundaryPoints, sense: float) -> NDArray[np.float64]:
        """Return loads of unit pressures at the points of the bore, (3 nodes, P), N/Pa, linear between the points.

        ``sense`` is 1 for loads along the outward normal, -1 against it.
        """
        x, y, z = points.places
        around = np.arctan2(x, y) * ((self.rule.angles - 1) / math.pi)
        along = z * ((self.rule.layers - 1) / (0.5 * self.geometry.width))
        columns: list[NDArray[np.float64]] = []
        for i in range(self.rule.angles):
            for k in range(self.rule.layers):
                share = np.maximum(1.0 - np.abs(around - i), 0.0) * np.maximum(1.0 - np.abs(along - k), 0.0)
                columns.append(traction_loads(body, points, sense * share * points.normals))
        return np.stack(columns, axis=1)

    def solve(
        self, bearing: AssembledBearing, load: float, *, between: bool = False, bilateral: bool = False
    ) -> FittedState:
        """Return the state of a bearing under a load, N.

        Args:
            bearing: its law, clearance and outer ring; what it has for the inner ring is not used.
            between: whether the load is between two elements; by default one stands in its direction.
            bilateral: whether the shaft holds the bore where it would part from it.
        """
        problem = self._problem(bearing, load, between=between)
        return _finished(problem, _settle(problem, bilateral=bilateral), self.rule)

    def _problem(self, bearing: AssembledBearing, load: float, *, between: bool) -> _Problem:
        angles = bearing.angles(0.5 * bearing.spacing if between else 0.0)
        angles = angles[angles <= math.pi * (1.0 + 1e-9)]
        edge = (angles < 1e-9) | (angles > math.pi - 1e-9)
        many = np.where(edge, 1.0, 2.0)
        bore = self._bore
        readers = _readers(self.ring, self._held, angles)
        pushed = self._free.solve(readers * (0.25 * many))
        own = np.einsum("dj,dj->j", readers, self._held.solve(readers * (0.25 * many)))
        yields = readers.T @ pushed
        yields[np.diag_indices(len(angles))] -= own
        line = self.ring.bore_readers(self._free.body, np.zeros(1))[:, 0]
        return _Problem(
            bearing=bearing,
            load=load,
            angles=angles,
            many=many,
            resultant=bore.resultant,
            bodies=bore.push.T @ bore.ring + bore.disc,
            bore_by_elements=bore.push.T @ pushed,
            elements_by_bore=readers.T @ bore.ring,
            elements=yields + _outer(bearing, angles, many),
            centre=bore.centre,
            line=(line @ bore.ring, line @ pushed),
        )


@dataclass(frozen=True, eq=False)
class _Bore:
    """Loads of unit pressures on the ring and its displacement, (3 nodes, P); the shaft's yield; resultants along y."""

    push: NDArray[np.float64]
    ring: NDArray[np.float64]
    disc: NDArray[np.float64]
    centre: NDArray[np.float64]
    resultant: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is to be solved; P points of the bore, Z elements of one side.

    Attributes:
        many: elements that stand for each: 2, and 1 on the plane of the load, shape (Z,).
        resultant: force along y of a unit pressure at each point on a quarter of the bore, m2, shape (P,).
        bodies: by how much ring and shaft make room at the points, weighted, by unit pressures, m3/Pa, (P, P).
        bore_by_elements, elements_by_bore: the same by unit forces on elements, (P, Z); inwards yield of the race under
            elements by unit pressures, m/Pa, (Z, P).
        elements: inwards yield of both races under elements by unit forces, beyond the element law, m/N, (Z, Z).
        centre: room that a newton at the shaft's centre takes, m3/N, (P,).
        line: shift of the bore's line on the plane of the load by unit pressures and by unit forces.
    """

    bearing: AssembledBearing
    load: float
    angles: NDArray[np.float64]
    many: NDArray[np.float64]
    resultant: NDArray[np.float64]
    bodies: NDArray[np.float64]
    bore_by_elements: NDArray[np.float64]
    elements_by_bore: NDArray[np.float64]
    elements: NDArray[np.float64]
    centre: NDArray[np.float64]
    line: tuple[NDArray[np.float64], NDArray[np.float64]]

    def fitted(self, active: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return pressures and the shaft's shift against the ring over the forces, with the bore closed where active.

        Both (P + 1,) without forces on elements, and (P + 1, Z) by each of them; linear between.
        """
        on = np.nonzero(active)[0]
        count = len(on)
        matrix = np.zeros((count + 1, count + 1))
        unit = float(np.abs(self.bodies).max()) / float(np.abs(self.resultant).max())
        matrix[:count, :count] = self.bodies[np.ix_(on, on)]
        matrix[:count, count] = -unit * self.resultant[on]
        matrix[count, :count] = unit * 4.0 * self.resultant[on]
        right = np.zeros((count + 1, 1 + len(self.many)))
        right[:count, 0] = self.load * self.centre[on]
        right[:count, 1:] = -self.bore_by_elements[on]
        right[count, 0] = unit * self.load
        found = np.linalg.solve(matrix, right)
        whole = np.zeros((len(active) + 1, right.shape[1]))
        whole[on], whole[-1] = found[:count], unit * found[count]
        return whole[:, 0], whole[:, 1:]

    def room(self, pressure: NDArray[np.float64], shift: float, forces: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far shaft and bore are apart at the points, weighted, m3, shape (P,)."""
        taken = self.load * self.centre + shift * self.resultant
        return self.bodies @ pressure + self.bore_by_elements @ forces - taken


@dataclass(frozen=True, eq=False)
class _Found:
    """Pressures, Pa, (P,), forces on elements, N, (Z,), their balance, exchanges of the active set, and its end."""

    pressure: NDArray[np.float64]
    forces: NDArray[np.float64]
    balance: Balance
    exchanges: int
    settled: bool


def _readers(ring: RingBody, body: ElasticBody, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return columns for the inwards yield of the race under elements at angles, shape (3 nodes, Z)."""
    beside = angles > 1e-9
    columns = np.empty((body.nodes.size, len(angles)))
    columns[:, beside] = replace(ring, angle=np.minimum(angles[beside], math.pi)).readers(body)
    if not beside.all():
        # There the race is the patch of the contact; a quarter of its load is one of a quarter of the ring.
        columns[:, ~beside] = 4.0 * ring.element_load(body)[:, None]
    return columns


def _settle(problem: _Problem, *, bilateral: bool) -> _Found:
    """Return the state in which no pressure pulls and nothing overlaps, by exchange of the closed points."""
    active = np.ones(len(problem.resultant), dtype=bool) if bilateral else problem.resultant > 0.0
    exchanges = 0
    while True:
        pressure, shift, forces, balance = _closed(problem, active)
        room = problem.room(pressure, shift, forces)
        pulls = active & (pressure < -_TOLERANCE * float(np.abs(pressure).max()))
        overlaps = ~active & (room < -_TOLERANCE * float(np.abs(problem.load * problem.centre).max()))
        settled = bilateral or not (pulls.any() or overlaps.any())
        if settled or exchanges == _EXCHANGES:
            return _Found(pressure, forces, balance, exchanges, settled)
        active = (active & ~pulls) | overlaps
        exchanges += 1


def _closed(
    problem: _Problem, active: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], float, NDArray[np.float64], Balance]:
    """Return pressures, shift of the shaft, forces on elements and their balance with the bore closed where active."""
    alone, by_forces = problem.fitted(active)
    influence = problem.elements + problem.elements_by_bore @ by_forces[:-1]
    # Each pair of elements has one row and two columns.
    pairs = np.repeat(np.arange(len(problem.many)), problem.many.astype(int))
    balance = settle(
        np.cos(problem.angles[pairs])[:, None],
        problem.bearing.law,
        np.array([problem.load]),
        influence=(influence / problem.many)[np.ix_(pairs, pairs)],
        clearance=problem.bearing.clearance + (problem.elements_by_bore @ alone[:-1])[pairs],
    )
    forces = balance.forces[np.searchsorted(pairs, np.arange(len(problem.many)))]
    state = alone + by_forces @ forces
    return state[:-1], float(state[-1]), forces, balance


def _finished(problem: _Problem, found: _Found, rule: FitRule) -> FittedState:
    """Return the state with its checks."""
    pressure, forces = found.pressure, found.forces
    carried = float(problem.many * np.cos(problem.angles) @ forces)
    shown = 4.0 * float(problem.resultant @ pressure)
    off = max(abs(carried / problem.load - 1.0), abs(shown / problem.load - 1.0))
    displacement = float(found.balance.displacement[0])
    by_pressure, by_forces = problem.line
    grid = pressure.reshape(rule.angles, rule.layers)
    angles = np.linspace(0.0, math.pi, rule.angles)
    open_at = np.nonzero(~(grid > 0.0).any(axis=1))[0]
    return FittedState(
        load=problem.load,
        angles=problem.angles,
        loads=forces,
        displacement=displacement,
        bore_line=displacement + float(by_pressure @ pressure + by_forces @ forces),
        pressure=grid,
        parted=float(angles[open_at[0]]) if len(open_at) else math.pi,
        exchanges=found.exchanges,
        converged=found.settled and off < _BALANCE,
    )


def _outer(bearing: AssembledBearing, angles: NDArray[np.float64], many: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the yield of the outer race under elements of one side by those of both, m/N, (Z, Z)."""
    if bearing.outer is None:
        return np.zeros((len(angles), len(angles)))
    both = bearing.outer.matrix(np.concatenate((angles, -angles[many > 1.0])))
    count = len(angles)
    folded = both[:count, :count].copy()
    folded[:, many > 1.0] += both[:count, count:]
    return folded
