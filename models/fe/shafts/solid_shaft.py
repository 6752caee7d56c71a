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

from models.fe.bearings.ring_bodies import INFLUENCE_RULE, BalancedBody, RingBody, influence_load
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.shaft_mesh import ShaftMeshRule, Step, shaft_mesh
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.fe.shafts.fit_contact import Fit, FitFound, FitProblem, settle_fit
from models.fe.solid.elastic import ElasticBody
from models.fe.solid.traction import BoundaryPoints, boundary_points, traction_loads
from models.words.checks import check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.bearings.assembly import AssembledBearing
    from models.fe.meshes.geometry import FeGeometry

_BALANCE = 1e-8
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
        parted: angle from the load from which on the shaft does not touch the bore, rad; the end of the ring where it
            touches all along.
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


class SolidShaft:
    """Inner ring and shaft of a bearing, factorised once; ``solve`` serves any law, load and symmetric place.

    Args:
        geometry: of the bearing.
        rule: of meshes and pressures.
        cut: whether only the half towards the load is there, as the thesis cuts its models (3.4.2); elements beyond it
            are left out.
    """

    def __init__(self, geometry: FeGeometry, rule: FitRule | None = None, *, cut: bool = False) -> None:
        """Mesh the ring; ring and shaft are factorised when they are first needed."""
        self.geometry = geometry
        self.rule = rule or FitRule()
        self.extent = 0.5 * math.pi if cut else math.pi
        grid = contact_grid(geometry, "inner", influence_load(geometry), self.rule.ring)
        mesh = ring_mesh(geometry, "inner", grid, self.rule.ring, angle=self.extent)
        # The angles are those of the elements, which differ from state to state.
        self.ring = RingBody(geometry, "inner", mesh, grid, np.array([self.extent]))

    @property
    def unknowns(self) -> dict[str, int]:
        """Unknowns of the factorised bodies."""
        return {"inner ring": self._free.body.unknowns, "shaft": self._disc.body.unknowns}

    @cached_property
    def _held(self) -> ElasticBody:
        return self.ring.held()

    @cached_property
    def _free(self) -> BalancedBody:
        return BalancedBody.ring(self.ring.free())

    @cached_property
    def _disc(self) -> BalancedBody:
        steel, half = self.geometry, 0.5 * self.geometry.width
        steps, seats = (Step(half, 2.0 * steel.bore_radius),), {_SURFACE: (0.0, half)}
        mesh = shaft_mesh(steps, seats, self.rule.shaft, upper=self.extent < math.pi)
        places = np.asarray(mesh.doflocs)
        lonely = int(np.argmin(places[1]))
        body = ElasticBody(mesh, steel.modulus, steel.poisson, {"x0": (0,), "first": (2,), lonely: (1,)})
        points = boundary_points(body, _SURFACE)
        return BalancedBody(body, traction_loads(body, points, points.normals * points.normals[1]))

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
        around = np.arctan2(x, y) * ((self.rule.angles - 1) / self.extent)
        along = z * ((self.rule.layers - 1) / (0.5 * self.geometry.width))
        columns: list[NDArray[np.float64]] = []
        for i in range(self.rule.angles):
            for k in range(self.rule.layers):
                share = np.maximum(1.0 - np.abs(around - i), 0.0) * np.maximum(1.0 - np.abs(along - k), 0.0)
                columns.append(traction_loads(body, points, sense * share * points.normals))
        return np.stack(columns, axis=1)

    def solve(
        self, bearing: AssembledBearing, load: float, *, between: bool = False, fit: Fit = "touching"
    ) -> FittedState:
        """Return the state of a bearing under a load, N.

        Args:
            bearing: its law, clearance and outer ring; what it has for the inner ring is not used.
            between: whether the load is between two elements; by default one stands in its direction.
            fit: whether the shaft touches the bore, holds it, or is a sinusoidal pressure.
        """
        problem = self._problem(bearing, load, between=between)
        return self._finished(problem, settle_fit(problem, fit))

    def _problem(self, bearing: AssembledBearing, load: float, *, between: bool) -> FitProblem:
        angles = bearing.angles(0.5 * bearing.spacing if between else 0.0)
        # An element at the end of a cut ring carries nothing.
        angles = angles[angles <= (self.extent * (1.0 - 1e-3) if self.extent < math.pi else math.pi * (1.0 + 1e-9))]
        edge = (angles < 1e-9) | (angles > math.pi - 1e-9)
        many = np.where(edge, 1.0, 2.0)
        bore = self._bore
        readers = _readers(self.ring, self._held, angles)
        pushed = self._free.solve(readers * (0.25 * many))
        own = np.einsum("dj,dj->j", readers, self._held.solve(readers * (0.25 * many)))
        yields = readers.T @ pushed
        yields[np.diag_indices(len(angles))] -= own
        line = self.ring.bore_readers(self._free.body, np.zeros(1))[:, 0]
        return FitProblem(
            bearing=bearing,
            load=load,
            angles=angles,
            many=many,
            cosine=np.cos(np.repeat(np.linspace(0.0, self.extent, self.rule.angles), self.rule.layers)),
            resultant=bore.resultant,
            bodies=bore.push.T @ bore.ring + bore.disc,
            bore_by_elements=bore.push.T @ pushed,
            elements_by_bore=readers.T @ bore.ring,
            elements=yields + _outer(bearing, angles, many),
            centre=bore.centre,
            line=(line @ bore.ring, line @ pushed),
        )

    def _finished(self, problem: FitProblem, found: FitFound) -> FittedState:
        """Return the state with its checks."""
        pressure, forces = found.pressure, found.forces
        carried = float(problem.many * np.cos(problem.angles) @ forces)
        shown = 4.0 * float(problem.resultant @ pressure)
        off = max(abs(carried / problem.load - 1.0), abs(shown / problem.load - 1.0))
        displacement = float(found.balance.displacement[0])
        by_pressure, by_forces = problem.line
        grid = pressure.reshape(self.rule.angles, self.rule.layers)
        angles = np.linspace(0.0, self.extent, self.rule.angles)
        open_at = np.nonzero(~(grid > 0.0).any(axis=1))[0]
        return FittedState(
            load=problem.load,
            angles=problem.angles,
            loads=forces,
            displacement=displacement,
            bore_line=displacement + float(by_pressure @ pressure + by_forces @ forces),
            pressure=grid,
            parted=float(angles[open_at[0]]) if len(open_at) else self.extent,
            exchanges=found.exchanges,
            converged=found.settled and off < _BALANCE,
        )


@dataclass(frozen=True, eq=False)
class _Bore:
    """Loads of unit pressures on the ring and its displacement, (3 nodes, P); the shaft's yield; resultants along y."""

    push: NDArray[np.float64]
    ring: NDArray[np.float64]
    disc: NDArray[np.float64]
    centre: NDArray[np.float64]
    resultant: NDArray[np.float64]


def _readers(ring: RingBody, body: ElasticBody, angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return columns for the inwards yield of the race under elements at angles, shape (3 nodes, Z)."""
    beside = angles > 1e-9
    columns = np.empty((body.nodes.size, len(angles)))
    columns[:, beside] = replace(ring, angle=np.minimum(angles[beside], math.pi)).readers(body)
    if not beside.all():
        # There the race is the patch of the contact; a quarter of its load is one of a quarter of the ring.
        columns[:, ~beside] = 4.0 * ring.element_load(body)[:, None]
    return columns


def _outer(bearing: AssembledBearing, angles: NDArray[np.float64], many: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the yield of the outer race under elements of one side by those of both, m/N, (Z, Z)."""
    if bearing.outer is None:
        return np.zeros((len(angles), len(angles)))
    both = bearing.outer.matrix(np.concatenate((angles, -angles[many > 1.0])))
    count = len(angles)
    folded = both[:count, :count].copy()
    folded[:, many > 1.0] += both[:count, count:]
    return folded
