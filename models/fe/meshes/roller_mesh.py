"""Mesh of an eighth of a cylindrical roller: x, y, z >= 0, contact at (0, R, z), refined about it.

The quarter disc is three blocks that meet in its middle: the fan about the contact, one at the far end of the arc and
one at the axis, so that no corner of an element is flat. The layers along the roller follow the grid of the contact;
its rounded edge is one layer more. A profile (crown, logarithm) is micrometres and belongs to the gap, not to the mesh.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.fe.meshes.grid import (
    Chooser,
    FanSection,
    FeMesh,
    FeMeshError,
    HexBlock,
    Order,
    build,
    extrude,
    fan,
    lattice,
    on_surface,
    tensor_section,
    within,
)
from models.fe.meshes.sizing import ContactGrid, MeshRule, growing_lines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry

# Where the three blocks of a quarter disc of radius one meet: on the arc at 45 degrees, on both straight sides, within.
_ARC = math.sqrt(0.5)
_SIDE, _MIDDLE = 0.5, 0.42


def roller_mesh(
    geometry: FeGeometry, grid: ContactGrid, rule: MeshRule | None = None, order: Order = 2, *, half: bool = True
) -> FeMesh:
    """Return the eighth of a roller, or with ``half=False`` the quarter x, y >= 0 at its full length.

    Boundaries: contact (the patch), race (the rest of the rolling surface), x0, y0, z0, side (the rounded edge and the
    end face).

    Raises:
        FeMeshError: the sizes do not fit the roller.
    """
    rule = rule or MeshRule()
    radius = geometry.element_radius
    if geometry.effective_length is None or geometry.roller_length is None:
        raise FeMeshError(f"{geometry.designation}: a ball has no roller mesh")
    section = contact_section(grid, _ARC * radius, (1.0 - _SIDE) * radius, rule)
    rows = inner_rows(grid, _SIDE * radius, rule)
    blocks = _disc(geometry, section, rows, float(grid.x[-1]), roller_lines(geometry, grid, half=half))
    end = 0.5 * geometry.roller_length
    straight = 0.5 * geometry.effective_length * (1.0 + 1e-9)
    surface = on_surface(lambda p: np.hypot(p[0], p[1]) - radius * _disc_share(geometry, p[2]), radius)
    outside: dict[str, Chooser] = {
        "contact": within(surface, float(grid.x[-1]), float(grid.z[-1])),
        "race": lambda p: surface(p) & np.all(np.abs(p[2]) <= straight, axis=0),
        "x0": on_surface(lambda p: p[0], radius),
        "y0": on_surface(lambda p: p[1], radius),
        "side": lambda p: np.all(np.abs(p[2]) > 0.5 * end, axis=0),
    }
    if half:
        outside = {"z0": on_surface(lambda p: p[2], radius), **outside}
    return build(blocks, outside, order)


def roller_lines(geometry: FeGeometry, grid: ContactGrid, *, half: bool = True) -> NDArray[np.float64]:
    """Return the lines along a roller, m: those of the contact and the end beyond the rounded edge."""
    assert geometry.roller_length is not None
    end = 0.5 * geometry.roller_length
    lines = grid.z if end <= grid.z[-1] * (1.0 + 1e-9) else np.append(grid.z, end)
    return lines if half else np.concatenate((-lines[:0:-1], lines))


def fan_section(grid: ContactGrid, size: float, rule: MeshRule) -> FanSection:
    """Return the fan about a contact in a square of a given size, m; its coordinates go from 0 to 1.

    Raises:
        FeMeshError: the square cannot hold the patch.
    """
    inner = float(grid.x[grid.columns])
    first = float(grid.x[grid.columns + 1])
    if first > 0.9 * size:
        raise FeMeshError(f"the patch reaches {first!r} m from the contact, the body holds {size!r} m")
    layers = math.ceil(math.log(size / first) / math.log(rule.growth) - 1e-9)
    outer = first * (size / first) ** (np.arange(1, layers + 1) / max(layers, 1))
    return fan(grid.columns, np.concatenate(([inner, first], outer)) / size)


def contact_section(grid: ContactGrid, width: float, depth: float, rule: MeshRule) -> FanSection:
    """Return the section about a contact, of a given width and depth, m, in the rule's layout.

    Raises:
        FeMeshError: the section cannot hold the patch.
    """
    if rule.layout == "fan":
        return fan_section(grid, width, rule)
    return tensor_section(row_lines(grid, width, rule) / width, row_lines(grid, depth, rule) / depth)


def row_lines(grid: ContactGrid, end: float, rule: MeshRule) -> NDArray[np.float64]:
    """Return the lines of the contact's grid and growing ones from there to ``end``, m.

    Raises:
        FeMeshError: the patch is larger.
    """
    start = float(grid.x[-1])
    if start > 0.95 * end:
        raise FeMeshError(f"the patch reaches {start!r} m from the contact, the body holds {end!r} m")
    size = min(rule.growth * (start - float(grid.x[-2])), rule.max_size)
    return np.concatenate((grid.x, growing_lines(start, end, size, rule.growth, rule.max_size)[1:]))


def inner_rows(grid: ContactGrid, length: float, rule: MeshRule) -> int:
    """Return how many rows the blocks away from the contact have over a length, m."""
    return max(2, grid.columns // 2 if rule.layout == "fan" else 1, math.ceil(length / rule.max_size))


def _disc(
    geometry: FeGeometry, section: FanSection, rows: int, exact: float, lines: NDArray[np.float64]
) -> list[HexBlock]:
    """Return the three blocks of a quarter disc, extruded along lines; ``exact`` ends the grid of the contact, m."""
    steps = np.linspace(0.0, 1.0, rows + 1)
    radius, held = geometry.element_radius, exact / (_ARC * geometry.element_radius)
    side, low, middle = np.array([0.0, _SIDE]), np.array([_SIDE, 0.0]), np.array([_MIDDLE, _MIDDLE])

    def deep(
        top: NDArray[np.float64], bottom: NDArray[np.float64], point: NDArray[np.float64], disc: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        plane = radius * (top * (1.0 - point[1]) + disc * bottom * point[1])
        return np.concatenate((plane, point[2:]))

    def contact(point: NDArray[np.float64]) -> NDArray[np.float64]:
        u, disc = point[0], _disc_share(geometry, point[2])
        # The surface has its tangent coordinate for u: exact lines of the contact's grid, on the rounded edge too.
        fade = np.clip((u - held) / (1.0 - held), 0.0, 1.0)
        x = _ARC * u * (1.0 - (1.0 - disc) * fade)
        top = np.array([x, np.sqrt(disc**2 - x**2)])
        return deep(top, side[:, None] * (1.0 - u) + middle[:, None] * u, point, disc)

    def far(point: NDArray[np.float64]) -> NDArray[np.float64]:
        u, disc = point[0], _disc_share(geometry, point[2])
        angle = 0.25 * math.pi * (1.0 - u)
        top = disc * np.array([np.cos(angle), np.sin(angle)])
        return deep(top, middle[:, None] * (1.0 - u) + low[:, None] * u, point, disc)

    def axis(point: NDArray[np.float64]) -> NDArray[np.float64]:
        u, disc = point[0], _disc_share(geometry, point[2])
        top = disc * (side[:, None] * (1.0 - u) + middle[:, None] * u)
        return deep(top, np.array([u * low[0], 0.0 * u]), point, disc)

    return [
        HexBlock(extrude(section.quads, lines), contact),
        HexBlock(extrude(lattice(steps, section.far), lines), far),
        HexBlock(extrude(lattice(section.deep, steps), lines), axis),
    ]


def _disc_share(geometry: FeGeometry, z: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radius of a roller at z by its largest, below one at the rounded edge."""
    assert geometry.effective_length is not None
    rounded = geometry.edge_radius
    over = np.clip(np.abs(z) - 0.5 * geometry.effective_length, 0.0, rounded)
    return 1.0 - (rounded - np.sqrt(rounded**2 - over**2)) / geometry.element_radius
