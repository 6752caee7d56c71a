"""Both contacts of a roller, with races and with rigid bars, solved at once on one disc in plane strain."""

from __future__ import annotations

import math

import numpy as np

from models.fe.bearings.cage import plane_bulge
from models.fe.extra import require_skfem
from models.fe.meshes.grid import FeMesh
from models.fe.solid.condense import ContactCells, ContactFrame, cell_loads
from models.fe.solid.contact import ContactState, press, press_to_force
from models.fe.solid.elastic import ElasticBody
from models.words.numerics import find_root


def plane_check(load: float, refinements: int = 7, start: int = 4) -> dict[str, float]:
    """Return both contacts of a roller, with races and with rigid bars, solved at once on one disc in plane strain.

    Beside it what the cage's model says: one squeeze law, one bulge, reciprocity. ``load`` is that of 5.6 mm, N.
    """
    radius, modulus, poisson = 2.75e-3, 210e9, 0.3
    plane, line = modulus / (1.0 - poisson**2), load / 5.6e-3
    body = ElasticBody(_quarter_disc(radius, refinements, start), modulus, poisson, {"x0": (0,), "y0": (1,)}, order=2)
    width = _flat_width(line, radius, plane)
    top = ContactCells.grid(np.linspace(0.0, 1.6 * width, 17))
    side = ContactCells.grid(np.linspace(-1.6 * _flat_width(0.15 * line, radius, plane), 0.0, 17))
    frames = (
        ContactFrame(np.array([0.0, radius]), np.eye(2)),
        ContactFrame(np.array([radius, 0.0]), np.array([[0.0, -1.0], [1.0, 0.0]])),
    )
    loads = [cell_loads(body, "arc", cells, frame) for cells, frame in zip((top, side), frames, strict=True)]
    u = np.column_stack([body.solve(part) for part in loads])
    c = np.vstack([part.T @ u for part in loads])
    c, n = 0.5 * (c + c.T), len(top)
    gaps = [(cells.x1**3 - cells.x0**3) / (6.0 * radius * (cells.x1 - cells.x0)) for cells in (top, side)]
    free = press_to_force(c[:n, :n], gaps[0], top.area, 0.5 * line)
    area = np.concatenate((top.area, side.area))

    def pressed(approach: float) -> ContactState:
        # The bars stay where they are: no approach there.
        return press(c, np.concatenate((gaps[0], approach + gaps[1])), area, approach)

    low, high = 0.5 * free.approach, 1.1 * free.approach
    half = find_root(lambda d: float(pressed(d).pressure[:n] @ top.area) - 0.5 * line, low, high, rtol=1e-12)
    bars = 2.0 * float(pressed(half).pressure[n:] @ side.area)
    bulge = plane_bulge(1.0, modulus, poisson)

    def missing(force: float) -> float:
        depth = 2.0 * force / (math.pi * plane)
        return depth * (2.0 * math.log(4.0 * radius / _flat_width(force, radius, plane)) - 1.0) - bulge * line

    model = find_root(missing, 1e-6 * line, line, rtol=1e-12)
    return {
        "load_newton": load, "bars_by_load": bars / line, "model_bars_by_load": model / line,
        "less_approach_percent": 100.0 * (1.0 - half / free.approach),
        "model_less_approach_percent": 50.0 * bulge * model / free.approach, "unknowns": body.unknowns,
    }  # fmt: skip


def _flat_width(line: float, radius: float, plane: float) -> float:
    """Return the half width of a roller on a rigid flat, m (Eq. 4 with one elastic body)."""
    return math.sqrt(4.0 * radius * line / (math.pi * plane))


def _quarter_disc(radius: float, refinements: int, start: int) -> FeMesh:
    """Return a quarter of a disc of triangles, fine about both ends of its arc."""
    skfem = require_skfem()
    mesh = skfem.MeshTri.init_circle(start)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    mesh = mesh.restrict(np.nonzero((middle[0] > 0.0) & (middle[1] > 0.0))[0])
    mesh = skfem.MeshTri(radius * mesh.p, mesh.t)
    for turn in range(refinements):
        x, y = mesh.p[:, mesh.t].mean(axis=1)
        near = np.minimum(np.hypot(x, y - radius), np.hypot(x - radius, y)) < 0.9 * radius * 0.55**turn
        mesh = mesh.refined(np.nonzero(near)[0])
        places, edge = mesh.p.copy(), np.unique(mesh.facets[:, mesh.boundary_facets()])
        arc = edge[(places[0, edge] > 1e-6 * radius) & (places[1, edge] > 1e-6 * radius)]
        places[:, arc] *= radius / np.hypot(*places[:, arc])
        mesh = skfem.MeshTri(places, mesh.t)
    return mesh.with_boundaries(
        {
            "x0": lambda x: x[0] < 1e-6 * radius,
            "y0": lambda x: x[1] < 1e-6 * radius,
            "arc": lambda x: (np.hypot(x[0], x[1]) > 0.9 * radius) & (x[0] > 1e-6 * radius) & (x[1] > 1e-6 * radius),
        }
    )
