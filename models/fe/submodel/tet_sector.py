"""The sub-model of section 3.3 of the thesis in tetrahedra for a bearing and a force: bodies, cells and gaps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.element import common_slopes, surface_gap
from models.fe.meshes.sizing import groove_reach, growing_lines, half_sizes
from models.fe.meshes.tet_bodies import RaceSector, tet_ball, tet_race, tet_roller
from models.fe.meshes.tetrahedra import MeshingError
from models.fe.solid.condense import ContactCells
from models.fe.solid.elastic import ElasticBody
from models.fe.submodel.two_contacts import BoreSpread, GappedCells, TwoContacts, nearest_node

if TYPE_CHECKING:
    from collections.abc import Mapping

    from models.fe.meshes.geometry import FeGeometry, Race
    from models.fe.meshes.tetrahedra import TetPatch, TetRule
    from models.fe.solid.shape import FeMesh

# Cells across one Hertz half width and how far they reach, in half sizes; finer ones move k_c by 0.1 % at most.
COLUMNS = 6
REACH = 4.0 / 3.0
LAYERS = 12
# Layers on the rounding of a roller's edge, as shares of its radius.
_EDGE_LAYERS = (0.1, 0.25, 0.5)
_GROOVE_SHARE = 0.98


@dataclass(frozen=True, eq=False)
class TetSector:
    """The bodies of the sub-model; each is factorised when it is first condensed."""

    geometry: FeGeometry
    element: ElasticBody
    inner: ElasticBody
    outer: ElasticBody

    @property
    def nodes(self) -> int:
        """Nodes of all three meshes."""
        return sum(int(body.nodes.shape[1]) for body in (self.element, self.inner, self.outer))

    @property
    def unknowns(self) -> int:
        """Unknowns of all three bodies."""
        return self.element.unknowns + self.inner.unknowns + self.outer.unknowns

    def condensed(self, force: float, spread: BoreSpread = "cosine") -> TwoContacts:
        """Return the sub-model on cells made for a force on the element, N.

        Raises:
            FeError: a contact reaches beyond its surface, or memory does not suffice.
        """
        contacts = (gapped_cells(self.geometry, "inner", force), gapped_cells(self.geometry, "outer", force))
        return TwoContacts(self.element, self.inner, self.outer, contacts, spread=spread)


def tet_sector(
    geometry: FeGeometry, patches: Mapping[Race, TetPatch], rule: TetRule, *, corner_radius: float = 0.0
) -> TetSector:
    """Return the bodies of the sub-model.

    Args:
        geometry: of the bearing; a straight roller or a ball.
        patches: sizes at the inner and the outer contact.
        rule: sizes elsewhere, and order.
        corner_radius: of the roundings between bore or outside and side, m.

    Raises:
        MissingExtraError: gmsh or scikit-fem cannot be imported.
        WrongInputError: sizes or dimensions that have no mesh, or more nodes than ``rule.max_nodes``.
        MeshingError: gmsh fails, or the geometry is of a kind that has no tetrahedra here.
    """
    element, inner, outer = tet_meshes(geometry, patches, rule, corner_radius=corner_radius)
    planes = {"x0": (0,), "z0": (2,)}
    centre = nearest_node(element.doflocs, (0.0, 0.0, 0.0))
    in_bore = nearest_node(inner.doflocs, (0.0, geometry.bore_radius, 0.0))
    modulus, poisson = geometry.modulus, geometry.poisson
    return TetSector(
        geometry,
        ElasticBody(element, modulus, poisson, planes | {centre: (1,)}),
        ElasticBody(inner, modulus, poisson, planes | {in_bore: (1,)}),
        ElasticBody(outer, modulus, poisson, planes | {"outside": (0, 1, 2)}),
    )


def tet_meshes(
    geometry: FeGeometry, patches: Mapping[Race, TetPatch], rule: TetRule, *, corner_radius: float = 0.0
) -> tuple[FeMesh, FeMesh, FeMesh]:
    """Return the meshes of element, inner and outer sector; arguments and errors as of ``tet_sector``."""
    both = (patches["inner"], patches["outer"])
    if geometry.contact_angle != 0.0 or geometry.rows != 1 or geometry.spherical_outer:
        raise MeshingError(f"{geometry.designation}: tetrahedra are of bearings of one row without a contact angle")
    if geometry.element == "roller":
        if geometry.profile != "straight" or geometry.roller_length is None:
            raise MeshingError(f"{geometry.designation}: tetrahedra are of straight rollers, not {geometry.profile}")
        element = tet_roller(geometry.element_radius, geometry.roller_length, geometry.edge_radius, both, rule)
    else:
        element = tet_ball(geometry.element_radius, both, rule)
    races: tuple[Race, Race] = ("inner", "outer")
    inner, outer = (
        tet_race(_race_sector(geometry, race, corner_radius), patch, rule)
        for race, patch in zip(races, both, strict=True)
    )
    return element, inner, outer


def gapped_cells(geometry: FeGeometry, race: Race, force: float, columns: int = COLUMNS) -> GappedCells:
    """Return the cells of a contact under a force, N, ``columns`` on a Hertz half width, and their gaps."""
    half_length, half_width = half_sizes(geometry, race, force)
    x = np.arange(round(REACH * columns) + 1) * half_width / columns
    if geometry.element == "roller":
        inward = growing_lines(0.0, half_length, min(0.5 * half_width, 0.1 * half_length), 1.6, 0.2 * half_length)
        beyond = half_length + geometry.edge_radius * np.asarray(_EDGE_LAYERS)
        z = np.concatenate((np.sort(half_length - inward), beyond if geometry.edge_radius > 0.0 else []))
        z[0] = 0.0
    else:
        end = min(REACH * half_length, _GROOVE_SHARE * groove_reach(geometry, race))
        z = np.linspace(0.0, end, LAYERS + 1)
    cells = ContactCells.grid(x, z)
    return GappedCells(cells, surface_gap(geometry, race, cells), common_slopes(geometry, race))


def _race_sector(geometry: FeGeometry, race: Race, corner_radius: float) -> RaceSector:
    grooved = geometry.element == "ball"
    return RaceSector(
        geometry.race_radius(race),
        geometry.back_radius(race),
        0.5 * geometry.width,
        math.pi / geometry.n_elements,
        groove_radius=geometry.groove_radius(race) if grooved else None,
        groove_depth=geometry.shoulder_height if grooved else None,
        corner_radius=corner_radius,
    )
