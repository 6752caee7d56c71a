"""Sub-model of section 3.3 of the thesis: one element between sectors of both races, one pitch of the elements wide.

The outside is fixed to a rigid body; the bore carries the cosine pressure of Fig. 21 over the sector; the sides of the
sectors are free. Three planes of symmetry leave an eighth of the element for each contact (the mid-plane of the element
across the contact normal moves as one) and a quarter of each sector. The displacement is the mean over the line of the
bore on the plane of the load, and k_c = Q / delta^n (Eq. 14).
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.element import RACES, common_slopes, surface_gap
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.sizing import ContactGrid, MeshRule, contact_grid
from models.fe.solid.condense import ContactCells, cell_loads
from models.fe.solid.contact import ContactState, press_to_force
from models.fe.solid.elastic import ElasticBody, NotConvergedError
from models.fe.submodel.two_contacts import bore_pressure, bore_reader
from models.machine.hertz import BALL_EXPONENT, ROLLER_EXPONENT

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race
    from models.fe.meshes.grid import FeMesh, Order
    from models.fe.solid.condense import Slope

# A quarter of the force is on the quarter x >= 0, z >= 0 of a contact.
_QUARTER = 0.25


@dataclass(frozen=True, eq=False)
class SectorContact:
    """One contact of the sector, condensed to its pressure cells; any load may be put on it.

    Attributes:
        race: which.
        cells: of the quarter x, z >= 0.
        gap: mean distance of the surfaces over each cell when they just touch, m, shape (cells,).
        element, ring: compliance of the half element, and of the race with what holds or loads it, m^3/Pa, shape
            (cells, cells).
        bore_line: of an inner ring: what the bore's line on the plane of the load moves beyond the mean that belongs to
            the pressure there, m/Pa, shape (cells,); zero for an outer one.
        unknowns: of the element and the ring.
        seconds: processor time of meshing, assembly, factorisation and condensation.
    """

    race: Race
    cells: ContactCells
    gap: NDArray[np.float64]
    element: NDArray[np.float64]
    ring: NDArray[np.float64]
    bore_line: NDArray[np.float64]
    unknowns: tuple[int, int]
    seconds: float

    def press(self, force: float) -> tuple[ContactState, float]:
        """Return the state under a force on the whole contact, N, and the approach of its back to the element, m.

        Raises:
            NotConvergedError: the active set does not converge.
        """
        state = press_to_force(self.element + self.ring, self.gap, self.cells.area, _QUARTER * force)
        if not state.converged:
            raise NotConvergedError(
                f"contact with the {self.race} race under {force:g} N: residual {state.residual:.2g}"
            )
        return state, state.approach + float(self.bore_line @ state.pressure)


@dataclass(frozen=True, eq=False)
class SectorState:
    """The sector under a load.

    Attributes:
        force: Q on the element, N.
        approach: delta of both contacts together, m.
        k_c: Q / delta^n, N/m^n with the analytic exponent n of the element.
        parts: approach of the half element and of the race at each contact, m: (element, race).
        peak_pressure: largest of all cells at each contact, Pa.
        unknowns: of all bodies together.
        seconds: processor time in all.
    """

    force: float
    approach: float
    k_c: float
    parts: Mapping[Race, tuple[float, float]]
    peak_pressure: Mapping[Race, float]
    unknowns: int
    seconds: float


def sector_contact(
    geometry: FeGeometry,
    race: Race,
    grid: ContactGrid,
    rule: MeshRule,
    *,
    order: Order = 2,
    cells: ContactCells | None = None,
    angle: float | None = None,
) -> SectorContact:
    """Return one condensed contact of the sector.

    Args:
        geometry: of the bearing.
        race: inner or outer.
        grid: of the contact, from ``contact_grid`` or any other.
        rule: growth and largest sizes.
        order: of geometry and displacement, 1 (8 nodes) or 2 (27 nodes).
        cells: that carry the pressure; by default one about each node of the contact's grid.
        angle: half the sector, rad; by default half a pitch of the elements.

    Raises:
        FeError, WrongInputError: the sizes do not fit the bodies.
    """
    start = time.process_time()
    element_slope, ring_slope = common_slopes(geometry, race)
    cells = sector_cells(grid, order) if cells is None else cells
    half = math.pi / geometry.n_elements if angle is None else angle
    element = _element(geometry, grid, rule, order)
    mesh = ring_mesh(geometry, race, grid, rule, order, angle=half)
    if race == "outer":
        fixed = {"outside": (0, 1, 2), "x0": (0,), "z0": (2,)}
        ring = ElasticBody(mesh, geometry.modulus, geometry.poisson, fixed)
        flexibility = ring.flexibility(cell_loads(ring, "contact", cells, slope=ring_slope))
        line = np.zeros(len(cells))
    else:
        node = _bore_node(mesh, geometry)
        ring = ElasticBody(mesh, geometry.modulus, geometry.poisson, {"x0": (0,), "z0": (2,), node: (1,)})
        flexibility, line = _under_bore_load(ring, cells, ring_slope)
    compliance = element.flexibility(cell_loads(element, "contact", cells, slope=element_slope))
    gap = surface_gap(geometry, race, cells)
    seconds = time.process_time() - start
    return SectorContact(race, cells, gap, compliance, flexibility, line, (element.unknowns, ring.unknowns), seconds)


def sector(
    geometry: FeGeometry,
    force: float,
    rules: MeshRule | Mapping[Race, MeshRule] | None = None,
    *,
    order: Order = 2,
    angle: float | None = None,
) -> SectorState:
    """Return the sector under a force on the element, N, on meshes made for this force; arguments as above.

    Raises:
        FeError, WrongInputError: the sizes do not fit the bodies.
        NotConvergedError: a contact does not converge.
    """
    rule_of = dict.fromkeys(RACES, rules or MeshRule()) if not isinstance(rules, Mapping) else dict(rules)
    contacts = [
        sector_contact(
            geometry, race, contact_grid(geometry, race, force, rule_of[race]), rule_of[race],
            order=order, angle=angle,
        )
        for race in RACES
    ]  # fmt: skip
    return pressed(geometry, contacts, force)


def pressed(geometry: FeGeometry, contacts: list[SectorContact], force: float) -> SectorState:
    """Return the state of condensed contacts with both races under a force, N."""
    start = time.process_time()
    parts: dict[Race, tuple[float, float]] = {}
    peak: dict[Race, float] = {}
    total = 0.0
    for contact in contacts:
        state, approach = contact.press(force)
        # Weighted with the pressure the surfaces of both bodies together yield the approach less the gap.
        weight = state.pressure / float(contact.cells.area @ state.pressure)
        of_element = float(weight @ contact.element @ state.pressure)
        parts[contact.race] = (of_element, approach - of_element)
        peak[contact.race] = float(state.pressure.max())
        total += approach
    exponent = BALL_EXPONENT if geometry.element == "ball" else ROLLER_EXPONENT
    unknowns = sum(sum(contact.unknowns) for contact in contacts)
    seconds = sum(contact.seconds for contact in contacts) + time.process_time() - start
    return SectorState(force, total, force / total**exponent, parts, peak, unknowns, seconds)


def _element(geometry: FeGeometry, grid: ContactGrid, rule: MeshRule, order: Order) -> ElasticBody:
    """Return an eighth of the element, held on its planes of symmetry."""
    if geometry.element == "roller":
        from models.fe.meshes.roller_mesh import roller_mesh as element_mesh
    else:
        from models.fe.meshes.ball_mesh import ball_mesh as element_mesh
    mesh = element_mesh(geometry, grid, rule, order)
    return ElasticBody(mesh, geometry.modulus, geometry.poisson, {"x0": (0,), "y0": (1,), "z0": (2,)})


def sector_cells(grid: ContactGrid, order: Order = 2, reach: float = math.inf) -> ContactCells:
    """Return cells about the nodes of a grid, across as far as the first line beyond ``reach``, m."""
    last = min(int(np.searchsorted(grid.x, reach)), grid.x.size - 1)
    return ContactCells.about_nodes(grid.x[: last + 1], grid.z, order=order)


def _bore_node(mesh: FeMesh, geometry: FeGeometry) -> int:
    """Return the node of the bore on the plane of the load and the mid-plane."""
    places = np.asarray(mesh.doflocs, float)
    away: NDArray[np.float64] = np.abs(places - np.array([[0.0], [geometry.bore_radius], [0.0]])).max(axis=0)
    return int(np.argmin(away))


def _under_bore_load(
    ring: ElasticBody, cells: ContactCells, slope: Slope
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the compliance against the bore's displacement as its pressure weights it, and ``bore_line``."""
    push = bore_pressure(ring)[:, 0]
    loads = cell_loads(ring, "contact", cells, slope=slope)
    # Each newton on the race is balanced by one on the bore: the reaction of the held node is zero.
    balanced = np.asarray(loads.toarray(), float) + np.outer(push, cells.area)
    displacement = ring.solve(balanced)
    flexibility = balanced.T @ displacement
    line = (bore_reader(ring)[:, 0] - push) @ displacement
    return 0.5 * (flexibility + flexibility.T), line
