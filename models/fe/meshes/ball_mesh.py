"""Mesh of an eighth of a ball: x, y, z >= 0, contact at (0, R, 0), refined about it.

The octant is four blocks, one at each of its corners, that meet in its middle. That of the contact is the fan of angle
and depth extruded along the contact's long axis; the block beyond it along that axis continues the fan, the other two
take its border. Near the contact the grid lines are straight in the tangent plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.meshes.grid import (
    Chooser,
    FeMesh,
    FeMeshError,
    HexBlock,
    Mapper,
    Order,
    build,
    extrude,
    lattice,
    on_surface,
    within,
)
from models.fe.meshes.roller_mesh import contact_section, inner_rows
from models.fe.meshes.sizing import ContactGrid, MeshRule, growing_lines

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry

    # A curve over the unit interval: points (n,) to places (3, n).
    Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]

# How far from the centre the blocks of an octant of radius one meet: on the axes, in the plane faces, within.
_AXIS, _FACE, _WITHIN = 0.5, 0.6, 0.62
_DIAGONAL = math.sqrt(0.5)
# Share of the contact's block over which its lines turn from straight ones to great circles.
_FADE = 0.4
# The contact's block reaches this much further along the shaft than its grid, and this far at least and at most.
_BEYOND, _LEAST_REACH, _MOST_REACH = 1.1, _DIAGONAL, 0.88


def ball_mesh(
    geometry: FeGeometry, grid: ContactGrid, rule: MeshRule | None = None, order: Order = 2, *, half: bool = True
) -> FeMesh:
    """Return the eighth of a ball, or with ``half=False`` the quarter x, y >= 0.

    Boundaries: contact (the patch), race (the rest of the sphere), x0, y0, z0.

    Raises:
        FeMeshError: the sizes do not fit the ball.
    """
    rule = rule or MeshRule()
    radius = geometry.element_radius
    if geometry.element != "ball":
        raise FeMeshError(f"{geometry.designation}: a roller has no ball mesh")
    if grid.z[-1] > _MOST_REACH / 1.05 * radius:
        raise FeMeshError(f"{geometry.designation}: the contact reaches {grid.z[-1]!r} m along a ball of {radius!r} m")
    section = contact_section(grid, _DIAGONAL * radius, (1.0 - _AXIS) * radius, rule)
    reach = min(max(_BEYOND * float(grid.z[-1]) / radius, _LEAST_REACH), _MOST_REACH)
    lines = _along(grid, reach * radius, rule) / (reach * radius)
    steps = np.linspace(0.0, 1.0, inner_rows(grid, _AXIS * radius, rule) + 1)
    octant = _Octant(radius, reach, float(grid.x[-1]) / (_DIAGONAL * radius))
    blocks = [
        HexBlock(extrude(section.quads, lines), octant.contact),
        HexBlock(extrude(section.quads, steps), octant.beyond),
        HexBlock(extrude(lattice(steps, section.far), lines), octant.side),
        HexBlock(extrude(lattice(section.deep, steps), lines), octant.centre),
    ]
    sphere = on_surface(lambda p: np.sqrt(np.sum(p**2, axis=0)) - radius, radius)
    found: dict[str, Chooser] = {
        "contact": within(sphere, float(grid.x[-1]), float(grid.z[-1])),
        "race": sphere,
        "x0": on_surface(lambda p: p[0], radius),
        "y0": on_surface(lambda p: p[1], radius),
    }
    if half:
        return build(blocks, {**found, "z0": on_surface(lambda p: p[2], radius)}, order)
    return build([*blocks, *(HexBlock(block.corners, _mirrored(block.place)) for block in blocks)], found, order)


def _along(grid: ContactGrid, end: float, rule: MeshRule) -> NDArray[np.float64]:
    """Return the lines along the shaft, m: those of the contact, growing to the end of its block."""
    start, size = float(grid.z[-1]), float(grid.z[-1] - grid.z[-2])
    return np.concatenate((grid.z, growing_lines(start, end, size, rule.growth, min(rule.max_size, 0.5 * end))[1:]))


def _mirrored(place: Mapper) -> Mapper:
    def other(point: NDArray[np.float64]) -> NDArray[np.float64]:
        return place(point) * np.array([[1.0], [1.0], [-1.0]])

    return other


@dataclass(frozen=True)
class _Octant:
    """Maps of the four blocks into an octant.

    Attributes:
        radius: of the ball, m.
        reach: z of the border between the contact's block and the next on x = 0, by the radius.
        exact: share of the contact's block across, in which grid lines are straight in the tangent plane.
    """

    radius: float
    reach: float
    exact: float

    def contact(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map (u, depth, along) of the block at the contact."""
        u, v, w = point
        corner = self._corner()

        def on_axis(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([0.0 * t, np.sqrt(1.0 - (self.reach * t) ** 2), self.reach * t])

        def on_z0(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([_DIAGONAL * t, np.sqrt(1.0 - (_DIAGONAL * t) ** 2), 0.0 * t])

        # Great circles away from the contact, lines that are straight in the tangent plane about it.
        far = _arc(np.array([_DIAGONAL, _DIAGONAL, 0.0]), corner)
        beyond = _arc(np.array([0.0, math.sqrt(1.0 - self.reach**2), self.reach]), corner)
        circles = _patch(u, w, on_axis, far, on_z0, beyond)
        x, z = _DIAGONAL * u, self.reach * w
        share = np.clip((u - self.exact) / min(_FADE, 1.0 - self.exact), 0.0, 1.0)
        share = share**2 * (3.0 - 2.0 * share)
        x, z = x + share * (circles[0] - x), z + share * (circles[2] - z)
        surface = np.array([x, np.sqrt(1.0 - x**2 - z**2), z])
        return self._deep(surface, self._inner(u, np.ones_like(u), w), v)

    def side(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map (from the x axis to the contact's block, depth, along) of the block at the x axis."""
        n, v, w = point
        corner = self._corner()
        end = corner[2] / math.hypot(corner[0], corner[2])

        def at_contact(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return self._surface(np.ones_like(t), t)

        def at_y0(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([np.sqrt(1.0 - (end * t) ** 2), 0.0 * t, end * t])

        def at_z0(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([np.cos(0.25 * math.pi * t), np.sin(0.25 * math.pi * t), 0.0 * t])

        surface = _patch(n, w, at_y0, at_contact, at_z0, self._ridge)
        return self._deep(surface, self._inner(np.ones_like(n), n, w), v)

    def beyond(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map (u, depth, from the z axis to the contact's block) of the block beyond the contact along the shaft."""
        u, v, n = point
        corner = self._corner()
        end = corner[0] / math.hypot(corner[0], corner[2])
        turn = math.acos(self.reach)

        def at_contact(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return self._surface(t, np.ones_like(t))

        def at_y0(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([end * t, 0.0 * t, np.sqrt(1.0 - (end * t) ** 2)])

        def at_x0(t: NDArray[np.float64]) -> NDArray[np.float64]:
            return np.array([0.0 * t, np.sin(turn * t), np.cos(turn * t)])

        surface = _patch(u, n, at_x0, self._ridge, at_y0, at_contact)
        return self._deep(surface, self._inner(u, n, np.ones_like(u)), v)

    def centre(self, point: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map the block at the ball's centre."""
        return self.radius * self._inner(*point)

    def _surface(self, u: NDArray[np.float64], w: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.contact(np.array([u, 0.0 * u, w])) / self.radius

    def _ridge(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the border of the blocks at the x axis and the z axis on the sphere, from y = 0 to the contact's."""
        corner = self._corner()
        low = np.array([corner[0], 0.0, corner[2]]) / math.hypot(corner[0], corner[2])
        return _arc(low, corner)(t)

    def _corner(self) -> NDArray[np.float64]:
        """Return where the blocks at the three axes meet on the sphere."""
        corner = np.array([_DIAGONAL, math.sqrt(1.0 - self.reach**2), self.reach])
        return corner / float(np.linalg.norm(corner))

    def _inner(self, u: NDArray[np.float64], n: NDArray[np.float64], w: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the trilinear map of the cube at the centre, whose far faces the other blocks rest on."""
        corner = self._corner()
        low = np.array([corner[0], 0.0, corner[2]]) / math.hypot(corner[0], corner[2])
        side = np.array([0.0, math.sqrt(1.0 - self.reach**2), self.reach])
        a, b, c = 1.0 - u, 1.0 - n, 1.0 - w
        axes = np.array([u * b * c, a * n * c, a * b * w])
        faces = u * n * c * np.array([[_DIAGONAL], [_DIAGONAL], [0.0]]) + a * n * w * side[:, None]
        return _AXIS * axes + _FACE * (faces + u * b * w * low[:, None]) + _WITHIN * u * n * w * corner[:, None]

    def _deep(
        self, surface: NDArray[np.float64], inner: NDArray[np.float64], v: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return self.radius * (surface * (1.0 - v) + inner * v)


def _arc(start: NDArray[np.float64], end: NDArray[np.float64]) -> Curve:
    """Return the arc of a great circle between two points of the unit sphere."""

    def curve(t: NDArray[np.float64]) -> NDArray[np.float64]:
        chord = start[:, None] * (1.0 - t) + end[:, None] * t
        return chord / np.linalg.norm(chord, axis=0)

    return curve


def _patch(
    a: NDArray[np.float64], b: NDArray[np.float64], a0: Curve, a1: Curve, b0: Curve, b1: Curve
) -> NDArray[np.float64]:
    """Return Coons' patch on the unit sphere between curves over b at a = 0 and 1 and over a at b = 0 and 1."""
    zero, one = np.zeros(1), np.ones(1)
    place = (1.0 - a) * a0(b) + a * a1(b) + (1.0 - b) * b0(a) + b * b1(a)
    place -= (1.0 - a) * ((1.0 - b) * a0(zero) + b * a0(one)) + a * ((1.0 - b) * a1(zero) + b * a1(one))
    return place / np.linalg.norm(place, axis=0)
