"""Deflection of gear teeth by plane finite elements: an answer that shares only the shape of the tooth with the models.

A whole ring, held at its hub, with three teeth; six-node triangles by gmsh, plane stress by scikit-fem. The
force is a pressure over a short piece of the flank of the middle tooth. What is read is how far points move along the
force, for a face of unit width: the tooth's centre line where the force crosses it (what bends, shears and turns,
without the contact), and the same place of a neighbour.
"""

from __future__ import annotations

import importlib
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.sparse.linalg import splu

from models.fe.extra import require_gmsh, require_skfem
from models.gears.teeth.tooth import critical_section

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.gears.teeth.geometry import ToothedWheel
    from models.gears.teeth.rack import ToothProfile

    Array = NDArray[np.float64]

_OPENING = 2e-3  # of a crack's mouth, of the module
_PATCH = 0.05  # half width of the pressure, of the module


@dataclass(frozen=True)
class Deflections:
    """Compliances, m^2/N, and the size of the mesh.

    Attributes:
        structure: of the tooth's centre line where the force crosses it.
        neighbour: of the same place of the next tooth, along the force on it.
        unknowns: of the mesh.
    """

    structure: Array
    neighbour: Array
    unknowns: int


def deflections(
    profile: ToothProfile,
    wheel: ToothedWheel,
    rolls: Array,
    *,
    fineness: float = 12.0,
    crack: tuple[float, float] | None = None,
    neighbour: tuple[int, Array] | None = None,
) -> Deflections:
    """Return what a force at roll angles does to a spur gear.

    Args:
        profile, wheel: the gear.
        rolls: roll angles of the force, rad.
        fineness: edges of elements a module at the teeth; the outline has points for it.
        crack: length, m, and angle from the tooth's centre line, rad, of a crack of the middle tooth from the loaded
            side of its critical section; 90 deg is straight across, less goes towards the body.
        neighbour: which next tooth is read, 1 on the loaded flank's side or -1, and at which roll angles, rad; by
            default that on the other side, at the same ones.
    """
    skfem = require_skfem()
    help_with = importlib.import_module("skfem.helpers")
    mesh = _mesh(profile, wheel.hub_radius, fineness, crack)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()))
    nu, modulus = wheel.poisson, wheel.modulus
    shear = modulus / (2.0 * (1.0 + nu))
    bulk = modulus * nu / (1.0 - nu**2)

    @skfem.BilinearForm
    def energy(u: Any, v: Any, _: Any) -> Any:
        strain = help_with.sym_grad(u)
        stress = 2.0 * shear * strain + bulk * help_with.eye(help_with.trace(strain), 2)
        return help_with.ddot(stress, help_with.sym_grad(v))

    matrix = energy.assemble(basis)
    hub = basis.get_dofs(lambda x: np.hypot(*x) < wheel.hub_radius * (1.0 + 1e-6))
    free = basis.complement_dofs(hub)
    solve = splu(matrix[free][:, free].tocsc()).solve
    side, others = neighbour or (-1, rolls)
    own, other = [], []
    for roll, next_roll in zip(rolls, others, strict=True):
        load = _load(mesh, profile, float(roll))
        u = np.zeros(basis.N)
        u[free] = solve(load[free])
        for turn, place, kept in ((0.0, roll, own), (side * math.tau / profile.teeth, next_roll, other)):
            angle = place - profile.base_half_angle
            centre = np.array([profile.base_radius / math.cos(angle), 0.0])
            # The force presses on the flank at positive y: towards negative y and the root.
            force = np.array([-math.sin(angle), -math.cos(angle)])
            rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
            at = (rotation @ centre)[:, np.newaxis]
            kept.append(float(np.asarray(basis.probes(at) @ u).ravel() @ (rotation @ force)))
    return Deflections(np.array(own), np.array(other), int(basis.N))


def _load(mesh: Any, profile: ToothProfile, roll: float) -> Array:
    skfem = require_skfem()
    x, y = (float(value) for value in profile.flank(roll))
    angle = roll - profile.base_half_angle
    force = np.array([-math.sin(angle), -math.cos(angle)])
    half = _PATCH * profile.module
    facets = mesh.facets_satisfying(
        lambda p: (np.hypot(p[0] - x, p[1] - y) < half) & (p[1] > 0.5 * y), boundaries_only=True
    )
    basis = skfem.FacetBasis(mesh, skfem.ElementVector(skfem.ElementTriP2()), facets=facets)

    @skfem.LinearForm
    def traction(v: Any, w: Any) -> Any:
        weight = np.exp(-(((w.x[0] - x) ** 2 + (w.x[1] - y) ** 2) / (0.4 * half) ** 2))
        return weight * (force[0] * v[0] + force[1] * v[1])

    load = np.asarray(traction.assemble(basis))
    total = float(load[::2].sum() ** 2 + load[1::2].sum() ** 2) ** 0.5
    return load / total


def _mesh(profile: ToothProfile, hub: float, fineness: float, crack: tuple[float, float] | None) -> Any:
    gmsh, skfem = require_gmsh(), require_skfem()
    m = profile.module
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Verbosity", 1)
        gmsh.option.setNumber("General.NumThreads", 1)
        geo = gmsh.model.geo
        outline = _outline(profile, fineness, crack)
        scale = 1.0 / m
        size = 1.0 / fineness
        points = [geo.addPoint(scale * x, scale * y, 0.0, size * (0.25 if near else 1.0)) for x, y, near in outline]
        lines = [geo.addLine(a, b) for a, b in itertools.pairwise(points)]
        # The ring's outside beyond the three teeth, at the root circle.
        last, first = outline[-1], outline[0]
        start, stop = math.atan2(last[1], last[0]), math.atan2(first[1], first[0]) + math.tau
        far = [
            geo.addPoint(
                scale * profile.root_radius * math.cos(a), scale * profile.root_radius * math.sin(a), 0.0, 12.0 * size
            )
            for a in np.linspace(start, stop, 60)[1:-1]
        ]
        ends = [points[-1], *far, points[0]]
        lines += [geo.addLine(a, b) for a, b in itertools.pairwise(ends)]
        bore = [
            geo.addPoint(
                scale * hub * math.cos(a), scale * hub * math.sin(a), 0.0, min(12.0 * size, 0.06 * hub * scale * 2)
            )
            for a in np.linspace(0.0, math.tau, 91)[:-1]
        ]
        ring = [geo.addLine(a, b) for a, b in zip(bore, [*bore[1:], bore[0]], strict=True)]
        geo.addPlaneSurface([geo.addCurveLoop(lines), geo.addCurveLoop(ring)])
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        tags, nodes = (np.asarray(part) for part in gmsh.model.mesh.getNodes()[:2])
        kinds, _, corners = gmsh.model.mesh.getElements(2)
        if list(kinds) != [2]:
            raise RuntimeError(f"expected triangles, got element kinds {kinds}")
        place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        place[tags] = np.arange(len(tags))
        xy = nodes.reshape(-1, 3)[:, :2].T / scale
        triangles = np.ascontiguousarray(place[np.asarray(corners[0]).reshape(-1, 3)].T)
    finally:
        gmsh.finalize()
    used = np.unique(triangles)
    number = np.zeros(xy.shape[1], dtype=np.int64)
    number[used] = np.arange(len(used))
    # Nodes of the bore lie on a polygon; that is what is held.
    return skfem.MeshTri(np.ascontiguousarray(xy[:, used]), np.ascontiguousarray(number[triangles]))


def _outline(
    profile: ToothProfile, fineness: float, crack: tuple[float, float] | None
) -> list[tuple[float, float, bool]]:
    """Return x, y and whether it is near the loaded flank, counterclockwise over three teeth."""
    pitch = math.tau / profile.teeth
    fillet = np.stack(profile.fillet(np.linspace(0.0, 1.0, max(8, round(fineness)))))
    low, high = profile.roll(profile.form_radius), profile.roll(profile.tip_radius)
    flank = np.stack(profile.flank(np.linspace(low, high, max(24, round(3 * fineness)))))[:, 1:]
    half = np.concatenate((fillet, flank), axis=1)
    # Up one side at negative y, down the other at positive y.
    tooth = np.concatenate((half * np.array([[1.0], [-1.0]]), half[:, ::-1]), axis=1)
    found: list[tuple[float, float, bool]] = []
    for k in (-1, 0, 1):
        turn = k * pitch
        shape = _cracked(tooth, profile, crack) if k == 0 and crack else tooth
        x = shape[0] * math.cos(turn) - shape[1] * math.sin(turn)
        y = shape[0] * math.sin(turn) + shape[1] * math.cos(turn)
        found += [(float(a), float(b), k == 0 and bool(c > 0.0)) for a, b, c in zip(x, y, shape[1], strict=True)]
    return found


def _cracked(tooth: Array, profile: ToothProfile, crack: tuple[float, float]) -> Array:
    x, y = critical_section(profile)
    opening = 0.5 * _OPENING * profile.module
    depth, angle = crack
    mouth = np.array([[x + opening, x - depth * math.cos(angle), x - opening], [y, y - depth * math.sin(angle), y]])
    above = (tooth[1] < 0.0) | (tooth[0] > x + opening)
    below = (tooth[1] > 0.0) & (tooth[0] < x - opening)
    return np.concatenate((tooth[:, above], mouth, tooth[:, below]), axis=1)
