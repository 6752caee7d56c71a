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
    build,
    extrude,
    fan,
    lattice,
    on_surface,
    within,
)
from models.fe.meshes.sizing import ContactGrid, MeshRule

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry

# Where the three blocks of a quarter disc of radius one meet: on the arc at 45 degrees, on both straight sides, within.
_ARC = math.sqrt(0.5)
_SIDE, _MIDDLE = 0.5, 0.42


def roller_mesh(geometry: FeGeometry, grid: ContactGrid, rule: MeshRule | None = None) -> FeMesh:
    """Return the eighth of a roller.

    Boundaries: contact (the patch), race (the rest of the rolling surface), x0, y0, z0, side (the rounded edge and the
    end face).

    Raises:
        FeMeshError: the sizes do not fit the roller.
    """
    rule = rule or MeshRule()
    radius = geometry.element_radius
    if geometry.effective_length is None or geometry.roller_length is None:
        raise FeMeshError(f"{geometry.designation}: a ball has no roller mesh")
    end = 0.5 * geometry.roller_length
    # Those of the contact, and the end beyond the rounded edge.
    lines = grid.z if end <= grid.z[-1] * (1.0 + 1e-9) else np.append(grid.z, end)
    blocks = _disc(geometry, fan_section(grid, _ARC * radius, rule), inner_rows(grid), float(grid.x[-1]), lines)
    straight = 0.5 * geometry.effective_length * (1.0 + 1e-9)
    surface = on_surface(lambda p: np.hypot(p[0], p[1]) - radius * _disc_share(geometry, p[2]), radius)
    outside: dict[str, Chooser] = {
        "contact": within(surface, float(grid.x[-1]), float(grid.z[-1])),
        "race": lambda p: surface(p) & np.all(np.abs(p[2]) <= straight, axis=0),
        "x0": on_surface(lambda p: p[0], radius),
        "y0": on_surface(lambda p: p[1], radius),
        "z0": on_surface(lambda p: p[2], radius),
        "side": lambda p: np.all(np.abs(p[2]) > 0.5 * end, axis=0),
    }
    return build(blocks, outside)


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


def inner_rows(grid: ContactGrid) -> int:
    """Return how many rows the blocks away from the contact have."""
    return max(2, grid.columns // 2)


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
