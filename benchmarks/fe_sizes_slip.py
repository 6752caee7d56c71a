"""Bound of what friction takes off the approach of a contact, from the slip of the frictionless solution.

By Betti's theorem tangential tractions q on a contact under a force Q change its approach by - sum(q s A) / Q with the
slip s of the frictionless solution: first order in q, the pressed cells kept. Friction of coefficient mu has |q| up to
mu p, whatever sticks or slips, so that it takes off mu sum(p |s| A) / Q at most. Equal steels press nearly the same
tangential displacement into both surfaces (Dundurs' beta is 0); what is left comes from their different shapes, above
all along the shaft: a roller's free ends, a ball in its groove.
"""

from __future__ import annotations

import numpy as np

from models.fe.bearings.element import element_body, surface_gap
from models.fe.meshes.common_surface import common_slopes
from models.fe.meshes.geometry import FeGeometry, Race
from models.fe.meshes.ring_mesh import ring_mesh
from models.fe.meshes.sizing import MeshRule, contact_grid
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.contact import press_to_force
from models.fe.solid.elastic import ElasticBody
from models.fe.solid.surface import cut_facets, piece_points, surface_values
from models.fe.submodel.sector import sector_cells

FRICTION = 0.05


def slip_bound(geometry: FeGeometry, race: Race, force: float, rule: MeshRule) -> tuple[float, float]:
    """Return the largest slip of pressed cells and the bound of friction's effect, both by the approach.

    The back of the ring is rigid here (bore or outside), half the pitch wide.
    """
    grid = contact_grid(geometry, race, force, rule)
    cells = sector_cells(grid)
    back = "bore" if race == "inner" else "outside"
    mesh = ring_mesh(geometry, race, grid, rule, angle=np.pi / geometry.n_elements)
    fixed = {back: (0, 1, 2), "x0": (0,), "z0": (2,)}
    bodies = (element_body(geometry, grid, rule), ElasticBody(mesh, geometry.modulus, geometry.poisson, fixed))
    loads = [
        cell_loads(body, "contact", cells, slope=slope)
        for body, slope in zip(bodies, common_slopes(geometry, race), strict=True)
    ]
    compliance = sum(body.flexibility(load) for body, load in zip(bodies, loads, strict=True))
    state = press_to_force(np.asarray(compliance), surface_gap(geometry, race, cells), cells.area, 0.25 * force)
    slips = np.zeros((2, len(cells)))
    for body, load, sense in zip(bodies, loads, (1.0, -1.0), strict=True):
        slips += sense * _tangential(body, cells, body.solve(np.asarray(load @ state.pressure)))
    slip = np.hypot(*slips)
    bound = FRICTION * float(np.sum(state.pressure * slip * cells.area)) / (0.25 * force * state.approach)
    return float(slip[state.active].max()) / state.approach, bound


def _tangential(body: ElasticBody, cells: ContactCells, displacement: np.ndarray) -> np.ndarray:
    """Return the mean displacement of each cell along x and z, m, shape (2, cells)."""
    pieces, _ = cut_facets(body, "contact", cells, ContactFrame.aligned())
    points = piece_points(pieces)
    nodes, values = surface_values(body, points, ContactFrame.aligned())
    found = []
    for component in (0, 2):
        at = np.sum(values * np.asarray(displacement).ravel()[3 * nodes + component], axis=0)
        found.append(np.bincount(points.cell, at * points.weight, minlength=len(cells)) / cells.area)
    return np.array(found)
