"""One rolling element between both races, from finite elements: its contacts under a load, and its law over loads.

Each ring is half a ring with one contact at angle zero, its back (bore or outside) fixed; the element is an eighth,
supported on its mid-plane across the contact normal. Both contacts therefore take the two halves of the element: the
approach of the races is the sum of the approaches of both contacts, ring and half element each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.law import ElementLaw, LawTable
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.sizing import ContactGrid, MeshRule, contact_grid, half_sizes
from models.fe.solid.condense import ContactCells, compliance
from models.fe.solid.contact import ContactState, press_to_force
from models.fe.solid.elastic import ElasticBody, NotConvergedError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race
    from models.fe.solid.condense import Slope

# What is done, steps done, and steps in all.
Progress = Callable[[str, int, int], None]

RACES: tuple[Race, Race] = ("inner", "outer")
# Bodies of one load: a ring and half the element at either race.
ELEMENT_STEPS = 4
# The quarter x, z >= 0 of a contact carries a quarter of the force.
_QUARTER = 0.25
# Loads of a table by the load that its mesh was made for: the half width spans 0.45 to 1.14 (line) of the mesh's own.
MIN_SHARE, MAX_SHARE = 0.2, 1.3
TABLE_SHARES = tuple(np.geomspace(MIN_SHARE, MAX_SHARE, 6).tolist())


@dataclass(frozen=True, eq=False)
class FeContact:
    """One contact of an element with a race under a force.

    Attributes:
        cells: of the quarter x >= 0 (along rolling), z >= 0 (along the shaft).
        pressure: Pa, shape (cells,).
        force: on the whole contact, N.
        approach: of the race's back to the mid-plane of the element, m.
        half_length, half_width: of Hertz (Eqs. 4, 11, 12), m.
        found_half_length, found_half_width: those of the Hertzian pressure with the second moments of the one found,
            m; the length of a line contact is that of the pressed cells.
        state: of the active set.
    """

    cells: ContactCells
    pressure: NDArray[np.float64]
    force: float
    approach: float
    half_length: float
    half_width: float
    found_half_length: float
    found_half_width: float
    state: ContactState


@dataclass(frozen=True, eq=False)
class ElementMesh:
    """Condensed contacts of one element with both races, on meshes made for one load.

    Attributes:
        geometry: of the bearing.
        made_for: load of the meshes, N.
        cells, compliance, gap: of each race: quarter cells, m^3/Pa of ring and half element together, m.
        unknowns: of the bodies, by name.
    """

    geometry: FeGeometry
    made_for: float
    cells: Mapping[Race, ContactCells]
    compliance: Mapping[Race, NDArray[np.float64]]
    gap: Mapping[Race, NDArray[np.float64]]
    unknowns: Mapping[str, int]

    def contact(self, race: Race, load: float, start: ContactState | None = None) -> FeContact:
        """Return the contact with a race under a load on the element, N.

        Raises:
            NotConvergedError: the active set does not converge.
        """
        cells = self.cells[race]
        state = press_to_force(self.compliance[race], self.gap[race], cells.area, _QUARTER * load, start=start)
        if not state.converged:
            raise NotConvergedError(
                f"{self.geometry.designation}: the contact with the {race} race did not converge at {load:g} N: "
                f"residual {state.residual:.2g}, force off by {state.force_error:.2g}"
            )
        length, width = half_sizes(self.geometry, race, load)
        found = _found_sizes(self.geometry, cells, state.pressure)
        return FeContact(cells, state.pressure, load, state.approach, length, width, *found, state)

    def table(self, shares: Sequence[float] = TABLE_SHARES) -> LawTable:
        """Return the approach of the races under loads of given shares of the meshes' own, ascending.

        Raises:
            NotConvergedError: a contact does not converge.
        """
        loads = [share * self.made_for for share in shares]
        approach = np.zeros(len(loads))
        for race in RACES:
            state = None
            for i, load in enumerate(loads):
                contact = self.contact(race, load, state)
                approach[i] += contact.approach
                state = contact.state
        return LawTable(np.asarray(loads, dtype=np.float64), approach, self.made_for)


def ring_body(geometry: FeGeometry, race: Race, grid: ContactGrid, rule: MeshRule) -> ElasticBody:
    """Return half a ring with its back fixed to a rigid body."""
    back = "bore" if race == "inner" else "outside"
    mesh = ring_mesh(geometry, race, grid, rule)
    fixed = {back: (0, 1, 2), "x0": (0,), "z0": (2,)}
    return ElasticBody(mesh, geometry.modulus, geometry.poisson, fixed, name=f"{race} ring")


def element_body(geometry: FeGeometry, grid: ContactGrid, rule: MeshRule) -> ElasticBody:
    """Return an eighth of the rolling element, its mid-plane across the contact normal supported."""
    if geometry.element == "roller":
        from models.fe.meshes.roller_mesh import roller_mesh as element_mesh
    else:
        from models.fe.meshes.ball_mesh import ball_mesh as element_mesh
    mesh = element_mesh(geometry, grid, rule)
    fixed = {"x0": (0,), "y0": (1,), "z0": (2,)}
    return ElasticBody(mesh, geometry.modulus, geometry.poisson, fixed, name=geometry.element)


def surface_gap(geometry: FeGeometry, race: Race, cells: ContactCells) -> NDArray[np.float64]:
    """Return the mean distance of element and race over each cell while they just touch, m, shape (cells,).

    From the exact circles and the roller's profile, along the contact normal.
    """
    radius, groove, bottom = geometry.element_radius, geometry.groove_radius(race), geometry.race_radius(race)

    def gap(x: NDArray[np.float64], z: NDArray[np.float64]) -> NDArray[np.float64]:
        if groove is None:
            element, rise = radius - np.sqrt(radius**2 - x**2) + geometry.drop(z), np.zeros_like(z)
        else:
            element, rise = radius - np.sqrt(radius**2 - x**2 - z**2), groove - np.sqrt(groove**2 - z**2)
        if race == "inner":
            return element + bottom - np.sqrt((bottom + rise) ** 2 - x**2)
        return element + np.sqrt((bottom - rise) ** 2 - x**2) - bottom

    return cells.mean(gap)


def element_mesh(geometry: FeGeometry, load: float, rule: MeshRule, progress: Progress | None = None) -> ElementMesh:
    """Return the condensed contacts of one element on meshes made for a load, N.

    Raises:
        FeError, WrongInputError: the sizes do not fit the bodies.
    """
    grids: dict[Race, ContactGrid] = {race: contact_grid(geometry, race, load, rule) for race in RACES}
    cells: dict[Race, ContactCells] = {race: ContactCells.about_nodes(grid.x, grid.z) for race, grid in grids.items()}
    flexibility: dict[Race, NDArray[np.float64]] = {}
    unknowns: dict[str, int] = {}
    done = 0
    for race in RACES:
        # The element has a mesh for each contact: cells are facets of both bodies there.
        of_element, of_ring = common_slopes(geometry, race)
        parts = ((f"{race} ring", _ring_at(race), of_ring), (geometry.element, element_body, of_element))
        for name, make, slope in parts:
            if progress is not None:
                progress(f"{name} at {load:.4g} N", done, ELEMENT_STEPS)
            body = make(geometry, grids[race], rule)
            unknowns[name] = max(body.unknowns, unknowns.get(name, 0))
            found = compliance(body, "contact", cells[race], slope=slope)
            flexibility[race] = flexibility[race] + found if race in flexibility else found
            done += 1
    gap: dict[Race, NDArray[np.float64]] = {race: surface_gap(geometry, race, cells[race]) for race in RACES}
    return ElementMesh(geometry, load, cells, flexibility, gap, unknowns)


def _ring_at(race: Race) -> Callable[[FeGeometry, ContactGrid, MeshRule], ElasticBody]:
    return lambda geometry, grid, rule: ring_body(geometry, race, grid, rule)


def element_law(
    geometry: FeGeometry, loads: Sequence[float], rule: MeshRule | None = None, progress: Progress | None = None
) -> ElementLaw:
    """Return the law of one element from one set of meshes for each load, N, ascending.

    Each mesh serves loads from a fifth to 1.3 times its own; loads up to six times apart overlap, which gives the
    mesh error.

    Raises:
        LawError: the loads are not ascending, or the tables make no law.
        FeError, WrongInputError: the sizes do not fit the bodies.
        NotConvergedError: a contact does not converge.
    """
    rule = rule or MeshRule()
    return ElementLaw.from_tables([element_mesh(geometry, load, rule, progress).table() for load in loads])


def _found_sizes(geometry: FeGeometry, cells: ContactCells, pressure: NDArray[np.float64]) -> tuple[float, float]:
    """Return half length and half width of the pressure found, by the second moments of Hertz' ellipse, m."""
    weight = pressure * cells.area
    total = float(np.sum(weight))
    x2, z2 = (
        float(np.sum(weight * (low**2 + low * high + high**2))) / (3.0 * total)
        for low, high in ((cells.x0, cells.x1), (cells.z0, cells.z1))
    )
    if geometry.element == "roller":
        return float(np.max(cells.z1[pressure > 0.0])), math.sqrt(4.0 * x2)
    return math.sqrt(5.0 * z2), math.sqrt(5.0 * x2)


def common_slopes(geometry: FeGeometry, race: Race) -> tuple[Slope, Slope]:
    """Return the slopes of the surface in which element and race touch, in the element's frame and in the ring's.

    Pressure acts at right angles to it. Both surfaces yield alike where the moduli are the same, so that it lies midway
    between them: its slopes are the means of theirs. It matters where a contact is long against the ball's radius: at
    a / R = 0.55 (6210 at 10 kN on a ball). They are the ``slope`` of :func:`models.fe.solid.condense.compliance`;
    y goes from the centre to the contact. The element's mesh has its contact at +y with either race, so that the frames
    are mirrored for the inner race.
    """
    sense = -1.0 if race == "inner" else 1.0

    def of_element(x: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        element, ring = element_slopes(geometry, x, z), race_slopes(geometry, race, x, z)
        return 0.5 * (element[0] + sense * ring[0]), 0.5 * (element[1] + sense * ring[1])

    def of_ring(x: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        along, across = of_element(x, z)
        return sense * along, sense * across

    return of_element, of_ring


def element_slopes(
    geometry: FeGeometry, x: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return dy/dx and dy/dz of an element's surface at (x, z), its contact at +y."""
    across = z if geometry.element == "ball" else 0.0 * z
    height = np.sqrt(geometry.element_radius**2 - x**2 - across**2)
    return -x / height, -across / height


def race_slopes(
    geometry: FeGeometry, race: Race, x: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return dy/dx and dy/dz of a race at (x, z), its contact at +y; z within the groove."""
    outwards = 1.0 if race == "inner" else -1.0
    groove = geometry.groove_radius(race)
    depth = np.zeros_like(z) if groove is None else np.sqrt(groove**2 - z**2)
    side = 0.0 * z if groove is None else z / depth
    radius = geometry.race_radius(race) + (0.0 if groove is None else outwards * (groove - depth))
    height = np.sqrt(radius**2 - x**2)
    return -x / height, outwards * side * radius / height
