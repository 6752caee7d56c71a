"""Contacts of finite elements against Hertz and closed forms for the stated supports.

Each body is pressed by a rigid one; two bodies of one
kind are each other's mirror image. Bodies: a quarter of a block whose far sides move as those of a half space under
the same force do (a circular and two elliptical contacts), an eighth of a ball between its middle plane and the
contact, an eighth of a roller held along its axis (plane strain), and a block in plane strain as part of a half plane.
Ball and roller have the meshes of the bearing. The pressure cells lie about the nodes; the second table has other cells
at the bearings' size of elements: whole facets, halves and thirds.

Each mesh is loaded so that the half width is 0.85 to 1.15 of the one it was made for, which moves the contact's edge
through the cells: errors are root mean squares over these loads, "worst" the largest. Half width and length are those
of a Hertzian pressure with the second moments found, the peak is that of Hertz's profile p^2 = p0^2 - c x^2 - d z^2
fitted to the cells within 0.8 of the contact; "scatter" is the rms difference of the cells' pressure from Hertz's, by
the peak, where that exceeds half of it.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from models.fe.extra import require_skfem
from models.fe.meshes.ball_mesh import ball_mesh
from models.fe.meshes.geometry import FeGeometry
from models.fe.meshes.roller_mesh import roller_mesh
from models.fe.meshes.sizing import ContactGrid, MeshRule, growing_lines
from models.fe.solid.condense import ContactCells, cell_loads
from models.fe.solid.contact import ContactState, press_to_force
from models.fe.solid.elastic import ElasticBody
from tests.oracles.elastic_references import (
    MODULUS,
    PLANE_MODULUS,
    POISSON,
    Reference,
    boussinesq,
    cylinder_between_flats,
    flamant,
    half_plane_to_depth,
    hertz_line,
    hertz_point,
    sphere_between_flats,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

"""Elements over the patch of 1.6 half widths, in space and in plane strain; the rule of the bearings is 4."""
CELLS = {"facets": 1, "halves": 2, "thirds": 3}
RADIUS = 0.01
HALF_WIDTH = 0.02 * RADIUS
POINT_FORCE = 4.0 * HALF_WIDTH**3 * PLANE_MODULUS / (3.0 * RADIUS)
LINE_LOAD = math.pi * PLANE_MODULUS * HALF_WIDTH**2 / (4.0 * RADIUS)
PATCH, GROWTH, REACH = 1.6, 1.7, 25.0
SCALES = tuple(np.linspace(0.85, 1.15, 7))
"""Half widths of the contacts by the one that the mesh is made for."""


@dataclass(frozen=True)
class Pressed:
    """A body with its cells under a rigid body of two radii (None: a line), and the motion of its far sides per N."""

    body: ElasticBody
    cells: ContactCells
    radii: tuple[float, float | None]
    line: bool = False
    sphere: bool = False
    far: NDArray[np.float64] | None = None


# A body under its cells, the share of the whole force, or of the force a metre, on them, and references by the scale of
# the half width.
Case = tuple[Pressed, float, "Callable[[float], Reference]"]


def condensed(case: Pressed) -> NDArray[np.float64]:
    """Return the compliance of the cells; a far field is added to it, as it moves with the force."""
    loads = cell_loads(case.body, "contact", case.cells)
    compliance = case.body.flexibility(loads)
    if case.far is None:
        return compliance
    moved = np.outer(far_motion(case, loads), case.cells.area)
    return compliance + 0.5 * (moved + moved.T)


def far_motion(case: Pressed, loads: Any) -> NDArray[np.float64]:
    """Return how far the cells yield, m^3 per N on the cells, where the fixed far sides move as prescribed."""
    assert case.far is not None
    body = case.body
    fixed = case.far - body.admissible @ (body.admissible.T @ case.far)
    return np.asarray(loads.T @ (fixed - body.solve(body.stiffness @ fixed)))


def gaps(case: Pressed) -> NDArray[np.float64]:
    """Return the mean gap of each cell, m: exact for parabolas, by 3 x 3 Gauss points for a sphere."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    c = case.cells
    x = 0.5 * (c.x0 + c.x1) + 0.5 * (c.x1 - c.x0) * nodes[:, None]
    z = 0.5 * (c.z0 + c.z1) + 0.5 * (c.z1 - c.z0) * nodes[:, None]
    radius, other = case.radii
    if case.sphere:
        squares = x[:, None] ** 2 + z[None] ** 2
        height = radius - np.sqrt(radius**2 - squares)
    elif other is None:
        height = (radius - np.sqrt(radius**2 - x**2))[:, None] + 0.0 * z[None]
    else:
        height = (x**2 / (2.0 * radius))[:, None] + (z**2 / (2.0 * other))[None]
    return np.einsum("i,j,ijm->m", 0.5 * weights, 0.5 * weights, height)


def half_space(size: float, ratio: float) -> Case:
    """Return a quarter block, far sides moved as Boussinesq says, under a rigid body of radii R and ``ratio`` R."""
    skfem = require_skfem()
    reference = hertz_point(RADIUS, ratio * RADIUS, POINT_FORCE)
    x, z = (lines(half, size) for half in (reference.half_width, reference.half_length))
    reach = REACH * reference.half_length
    grow = (GROWTH, math.inf)
    across, along = (np.append(e, growing_lines(e[-1], reach, GROWTH * (e[-1] - e[-2]), *grow)[1:]) for e in (x, z))
    down = growing_lines(0.0, reach, x[1], *grow)
    mesh = skfem.MeshHex2.from_mesh(skfem.MeshHex1.init_tensor(across, -down[::-1], along))
    mesh = mesh.with_boundaries(
        {
            "contact": lambda p: np.abs(p[1]) < 1e-9 * reach,
            "x0": lambda p: np.abs(p[0]) < 1e-9 * reach,
            "z0": lambda p: np.abs(p[2]) < 1e-9 * reach,
            "far": lambda p: np.max(np.abs(p), axis=0) > (1.0 - 1e-9) * reach,
        }
    )
    body = ElasticBody(mesh, MODULUS, POISSON, {"x0": (0,), "z0": (2,), "far": (0, 1, 2)})
    # The force on the quarter is a quarter of that of the point load.
    field = far_field(body, lambda p: 4.0 * boussinesq(p), reach)
    case = Pressed(body, ContactCells.grid(x, z), (RADIUS, ratio * RADIUS), far=field)
    return case, 0.25, lambda scale: hertz_point(RADIUS, ratio * RADIUS, scale**3 * POINT_FORCE)


def far_field(
    body: ElasticBody, displacement: Callable[[NDArray[np.float64]], NDArray[np.float64]], reach: float
) -> NDArray[np.float64]:
    """Return a displacement at the nodes of the far sides, zero elsewhere, shape (dim * nodes,)."""
    far = np.max(np.abs(body.nodes), axis=0) > (1.0 - 1e-9) * reach
    values = np.zeros(body.nodes.shape)
    values[:, far] = displacement(body.nodes[:, far])
    return values.T.ravel()


def lines(half: float, size: float) -> NDArray[np.float64]:
    """Return grid lines over the patch of a contact, m."""
    return np.linspace(0.0, PATCH * half, round(PATCH / size) + 1)


def ball(size: float) -> Case:
    """Return an eighth of a ball between its middle plane and a rigid flat."""
    half = hertz_point(RADIUS, RADIUS, POINT_FORCE).half_width
    x = lines(half, size)
    grid = ContactGrid(half, half, len(x) - 1, one_more(x), one_more(x))
    mesh = ball_mesh(_bearing("ball"), grid, MeshRule(patch=PATCH, size=size, growth=GROWTH))
    body = ElasticBody(mesh, MODULUS, POISSON, {"x0": (0,), "y0": (1,), "z0": (2,)})
    case = Pressed(body, ContactCells.grid(grid.x, grid.z), (RADIUS, RADIUS), sphere=True)
    return case, 0.25, lambda scale: sphere_between_flats(RADIUS, scale**3 * POINT_FORCE)


def roller(size: float) -> Case:
    """Return an eighth of a roller of two layers, held along its axis, between its middle plane and a rigid flat."""
    length = 2.0 * HALF_WIDTH
    x = lines(HALF_WIDTH, size)
    grid = ContactGrid(HALF_WIDTH, 0.5 * length, len(x) - 1, one_more(x), np.linspace(0.0, 0.5 * length, 3))
    mesh = roller_mesh(_bearing("roller", length), grid, MeshRule(patch=PATCH, size=size, growth=GROWTH))
    body = ElasticBody(mesh, MODULUS, POISSON, {"x0": (0,), "y0": (1,), "z0": (2,), "side": (2,)})
    case = Pressed(body, ContactCells.grid(grid.x, grid.z), (RADIUS, None), line=True)
    flats = cylinder_between_flats(RADIUS)
    return case, 0.25 * length, lambda scale: hertz_line(RADIUS, scale**2 * LINE_LOAD, flats)


def one_more(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return lines with a larger cell beyond the patch, as the meshes of the bearings have."""
    return np.append(x, x[-1] + GROWTH * (x[-1] - x[-2]))


def half_plane(size: float) -> Case:
    """Return half a block in plane strain, far sides moved as Flamant says, under a rigid cylinder."""
    skfem = require_skfem()
    reach = REACH * HALF_WIDTH
    x = lines(HALF_WIDTH, size)
    across = np.append(x, growing_lines(x[-1], reach, GROWTH * x[1], GROWTH, math.inf)[1:])
    down = growing_lines(0.0, reach, x[1], GROWTH, math.inf)
    mesh = skfem.MeshQuad2.from_mesh(skfem.MeshQuad1.init_tensor(across, -down[::-1]))
    mesh = mesh.with_boundaries(
        {
            "contact": lambda p: np.abs(p[1]) < 1e-9 * reach,
            "x0": lambda p: np.abs(p[0]) < 1e-9 * reach,
            "far": lambda p: np.max(np.abs(p), axis=0) > (1.0 - 1e-9) * reach,
        }
    )
    body = ElasticBody(mesh, MODULUS, POISSON, {"x0": (0,), "far": (0, 1)})
    field = far_field(body, lambda p: 2.0 * flamant(p, reach), reach)
    case = Pressed(body, ContactCells.grid(x), (RADIUS, None), line=True, far=field)
    support = half_plane_to_depth(reach)
    return case, 0.5, lambda scale: hertz_line(RADIUS, scale**2 * LINE_LOAD, support)


def _bearing(element: Any, length: float | None = None) -> FeGeometry:
    """Return a bearing of which only the element is used."""
    groove = 1.04 * RADIUS if element == "ball" else None
    return FeGeometry(
        designation="benchmark", element=element, n_elements=8, rows=1, contact_angle=0.0, element_radius=RADIUS,
        inner_race_radius=2.0 * RADIUS, outer_race_radius=4.0 * RADIUS, bore_radius=RADIUS,
        outside_radius=5.0 * RADIUS, width=4.0 * RADIUS, inner_groove_radius=groove, outer_groove_radius=groove,
        shoulder_height=0.4 * RADIUS if groove else 0.0, effective_length=length, roller_length=length,
        modulus=MODULUS, poisson=POISSON,
    )  # fmt: skip


CASES: dict[str, Callable[[float], Case]] = {
    "half space, circle": lambda size: half_space(size, 1.0),
    "half space, ellipse, radii 1:4": lambda size: half_space(size, 4.0),
    "half space, ellipse, radii 1:25": lambda size: half_space(size, 25.0),
    "ball, middle plane to contact": ball,
    "roller, plane strain, middle to contact": roller,
    "half plane to depth 25 b": half_plane,
}


PLANE_STRAIN = ("roller, plane strain, middle to contact", "half plane to depth 25 b")


def cells_of(case: Pressed, kind: str) -> ContactCells:
    """Return the cells of a kind over the facets of a case; a line's stay whole facets along it."""
    x, z = (
        np.unique(np.concatenate(edges)) for edges in ((case.cells.x0, case.cells.x1), (case.cells.z0, case.cells.z1))
    )
    if kind == "about nodes":
        about = ContactCells.about_nodes(x, None if case.line else z)
        return ContactCells.grid(np.append(np.unique(about.x0), x[-1]), z) if case.line else about
    parts = CELLS[kind]
    return ContactCells.grid(cut(x, parts), z if case.line else cut(z, parts))


def cut(edges: NDArray[np.float64], parts: int) -> NDArray[np.float64]:
    """Return edges with each interval in equal parts."""
    steps = np.arange(len(edges) * parts - parts + 1) / parts
    return np.interp(steps, np.arange(len(edges)), edges)


def row(name: str, count: int, kind: str = "about nodes") -> dict[str, Any]:
    """Solve one case under all loads; return its errors against the references, percent."""
    began = time.process_time()
    size = PATCH / count
    case, share, reference_of = CASES[name](size)
    case = replace(case, cells=cells_of(case, kind))
    compliance, gap = condensed(case), gaps(case)
    states: list[ContactState] = []
    errors: list[dict[str, float]] = []
    for scale in SCALES:
        reference = reference_of(scale)
        force = share * (scale**2 * LINE_LOAD if case.line else scale**3 * POINT_FORCE)
        states.append(press_to_force(compliance, gap, case.cells.area, force))
        errors.append(differences(case, states[-1], reference))
    found = {name: np.array([error[name] for error in errors]) for name in errors[0]}
    return {
        "case": name,
        "size by b": size,
        "cells": kind,
        "unknowns": case.body.unknowns,
        **{f"{name} %": float(np.sqrt(np.mean(values**2))) for name, values in found.items()},
        **{f"worst {name} %": float(np.abs(found[name]).max()) for name in ("approach", "half width", "peak")},
        "residual": max(state.residual for state in states),
        "converged": str(all(state.converged for state in states)),
        "unique": str(all(state.pressure_unique for state in states)),
        "s": time.process_time() - began,
    }


def differences(case: Pressed, state: ContactState, reference: Reference) -> dict[str, float]:
    """Return the differences of a state from its reference, percent; those of the pressure are of its scatter."""
    x, z = case.cells.centre
    columns = [np.ones(len(x)), (x / reference.half_width) ** 2]
    if not case.line:
        columns.append((z / reference.half_length) ** 2)
    hertz = np.sqrt(np.maximum(2.0 - np.sum(columns, axis=0), 0.0))
    scatter = (state.pressure / reference.peak - hertz)[hertz > 0.5]
    fit, *_ = np.linalg.lstsq(np.stack(columns, axis=1)[hertz > 0.6], state.pressure[hertz > 0.6] ** 2, rcond=None)
    # Second moments of Hertz's pressure: b^2 / 4 of a line, b^2 / 5 of an ellipse.
    share = case.cells.area * state.pressure / state.force
    factor = 4.0 if case.line else 5.0
    widths = np.stack((case.cells.x1 - case.cells.x0, case.cells.z1 - case.cells.z0))
    axes = np.sqrt(factor * (np.stack((x, z)) ** 2 + widths**2 / 12.0) @ share)
    return {
        "approach": percent(state.approach, reference.approach),
        "half width": percent(axes[0], reference.half_width),
        "half length": 0.0 if case.line else percent(axes[1], reference.half_length),
        "peak": percent(math.sqrt(fit[0]), reference.peak),
        "scatter": 100.0 * math.sqrt(float(np.average(scatter**2, weights=case.cells.area[hertz > 0.5]))),
    }


def percent(value: float, reference: float) -> float:
    """Return the difference from a reference, percent."""
    return 100.0 * (value / reference - 1.0)
