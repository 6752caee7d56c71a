"""Mesh of a ring with one fine patch: half the ring, or a sector, half as wide as the ring.

The point at angle t from the contact and radius r is (r sin t, r cos t, z): the contact is at t = 0, z = 0, the plane
x = 0 is one of symmetry. About the contact the section of angle and depth is a fan; from there plain rows follow the
longer of both. Layers along the shaft follow the grid of the contact and grow beyond it. A grooved race lowers or
raises the surface of each layer; columns of elements stay radial, and near the race they keep their depth.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.fe.meshes.grid import (
    Chooser,
    FeMesh,
    FeMeshError,
    HexBlock,
    Order,
    build,
    extrude,
    lattice,
    on_surface,
    within,
)
from models.fe.meshes.roller_mesh import fan_section, row_lines
from models.fe.meshes.sizing import ContactGrid, MeshRule, groove_reach, growing_lines

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race


# Rows far from the contact span this at most, rad.
MAX_ROW_ANGLE = 0.35


def ring_mesh(
    geometry: FeGeometry,
    race: Race,
    grid: ContactGrid,
    rule: MeshRule | None = None,
    order: Order = 2,
    *,
    angle: float = math.pi,
    half: bool = True,
) -> FeMesh:
    """Return a ring from the contact at angle zero to ``angle``, from its middle to its side.

    Args:
        geometry: of the bearing.
        race: which ring.
        grid: of its contact.
        rule: growth, and the largest elements away from the contact.
        order: 1 or 2, of the geometry.
        angle: pi for half the ring, which the plane x = 0 ends too; less for a sector, which ends at boundary "cut".
        half: False: at full width, from side to side.

    Boundaries: contact (the patch), race (the rest of it), shoulder (beside a groove), x0, z0, side, bore (inner ring)
    or outside (outer ring), cut.

    Raises:
        FeMeshError: the sizes do not fit the ring.
    """
    rule = rule or MeshRule()
    if not 0.0 < angle <= math.pi * (1.0 + 1e-12):
        raise FeMeshError(f"angle of a ring must be above 0 and up to pi, got {angle!r}")
    radius, back = geometry.race_radius(race), geometry.back_radius(race)
    thickness = abs(back - radius)
    rise = race_rise(geometry, race)
    lines = ring_lines(geometry, race, grid, rule)
    rows = min(rule.coarse * thickness, rule.max_size, MAX_ROW_ANGLE * radius)
    reference = _section(grid, radius * angle, thickness, rule, rows)
    place = _placed(geometry, race, rise, float(grid.x[-1]), angle)
    mesh_lines = lines if half else np.concatenate((-lines[:0:-1], lines))
    return build(
        [HexBlock(extrude(reference, mesh_lines), place)], _boundaries(geometry, race, grid, angle, half), order
    )


def race_rise(geometry: FeGeometry, race: Race) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return how far a race rises out of the ring at z over its bottom, m: 0 for a cylinder; a groove's shoulders.

    A spherical outer race rises towards its sides too.
    """
    groove = geometry.groove_radius(race)
    reach = groove_reach(geometry, race) if groove is not None else 0.0

    def rise(z: NDArray[np.float64]) -> NDArray[np.float64]:
        if groove is None:
            return 0.0 * z
        place = np.minimum(np.abs(z), reach)
        return groove - np.sqrt(groove**2 - place**2)

    return rise


def ring_lines(geometry: FeGeometry, race: Race, grid: ContactGrid, rule: MeshRule) -> NDArray[np.float64]:
    """Return the lines along half a ring's width, m: those of the contact, the shoulder's edge, growing sizes between.

    Raises:
        FeMeshError: the contact is longer than the ring is wide.
    """
    end, side = float(grid.z[-1]), 0.5 * geometry.width
    if end > side * (1.0 + 1e-9):
        raise FeMeshError(f"{geometry.designation}: half length of contact {end!r} m exceeds half the width {side!r} m")
    largest = min(rule.max_size, side / 3.0)
    stops = [side]
    if geometry.groove_radius(race) is not None:
        stops.insert(0, groove_reach(geometry, race))
    # Thin layers on a roller's rounded edge are as abrupt outside as inside.
    lines, size = grid.z, float(np.diff(grid.z)[-(rule.over + 1) :].max())
    for stop in stops:
        if stop - lines[-1] > 1e-3 * side:
            lines = np.concatenate((lines, growing_lines(float(lines[-1]), stop, size, rule.growth, largest)[1:]))
            size = max(size, float(lines[-1] - lines[-2]))
    return lines


def _section(grid: ContactGrid, length: float, thickness: float, rule: MeshRule, largest: float) -> NDArray[np.float64]:
    """Return quadrilaterals (2, 4, n) in length along the race and depth, m: in the rule's layout.

    A fan fills the smaller of both; rows follow along the longer."""
    if rule.layout == "rows":
        return lattice(row_lines(grid, length, rule), row_lines(grid, thickness, rule))
    size = min(length, thickness)
    section = fan_section(grid, size, rule)
    last = size * (1.0 - 1.0 / max(rule.growth, 1.2))
    parts = [size * section.quads]
    if length > size * (1.0 + 1e-6):
        lines = growing_lines(size, length, last, rule.growth, largest)
        parts.append(lattice(lines, size * section.far))
    if thickness > size * (1.0 + 1e-6):
        lines = growing_lines(size, thickness, last, rule.growth, largest)
        parts.append(lattice(size * section.deep, lines))
    return np.concatenate(parts, axis=2)


def _placed(
    geometry: FeGeometry,
    race: Race,
    rise: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    exact: float,
    angle: float,
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the map of length along the race, depth and z to places in the ring."""
    radius, back = geometry.race_radius(race), geometry.back_radius(race)
    inwards = -1.0 if race == "inner" else 1.0
    thickness = abs(back - radius)
    fade = min(4.0 * exact, radius * angle)

    def place(point: NDArray[np.float64]) -> NDArray[np.float64]:
        length, depth, z = point
        height = rise(z)
        # Near the race elements keep their depth; below, the height of the groove's side is spread.
        r = radius + inwards * (depth - height * (1.0 - (depth / thickness) ** 2))
        # On the grid of the contact the length is the tangent coordinate on the race, elsewhere an arc's.
        surface = radius - inwards * height
        tangent = np.arcsin(np.clip(length / surface, -1.0, 1.0))
        share = np.clip((fade - length) / max(fade - exact, 1e-9 * radius), 0.0, 1.0)
        smooth = share**2 * (3.0 - 2.0 * share)
        turn = smooth * tangent + (1.0 - smooth) * length / radius
        return np.array([r * np.sin(turn), r * np.cos(turn), z])

    return place


def _boundaries(geometry: FeGeometry, race: Race, grid: ContactGrid, angle: float, half: bool) -> dict[str, Chooser]:
    radius, back = geometry.race_radius(race), geometry.back_radius(race)
    rise = race_rise(geometry, race)
    inwards = -1.0 if race == "inner" else 1.0
    surface = on_surface(lambda p: np.hypot(p[0], p[1]) - (radius - inwards * rise(p[2])), radius)
    found: dict[str, Chooser] = {"contact": within(surface, float(grid.x[-1]), float(grid.z[-1]))}
    if geometry.groove_radius(race) is not None and groove_reach(geometry, race) < 0.5 * geometry.width * (1.0 - 1e-6):
        edge = groove_reach(geometry, race) * (1.0 - 1e-6)
        found["shoulder"] = lambda p: surface(p) & np.all(np.abs(p[2]) >= edge, axis=0)
    found["race"] = surface
    found["bore" if race == "inner" else "outside"] = on_surface(lambda p: np.hypot(p[0], p[1]) - back, radius)
    found["x0"] = on_surface(lambda p: p[0], radius)
    if half:
        found["z0"] = on_surface(lambda p: p[2], radius)
    found["side"] = on_surface(lambda p: np.abs(p[2]) - 0.5 * geometry.width, radius)
    found["cut"] = on_surface(lambda p: p[0] * math.cos(angle) - p[1] * math.sin(angle), radius)
    return found
