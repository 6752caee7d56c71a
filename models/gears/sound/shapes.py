"""Surfaces of simple bodies: a sphere of triangles and a box of rectangles, which may stand on the plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.gears.sound.panels import Panels
from models.gears.sound.surface import Surface
from models.words.checks import check_positive, check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

Point = tuple[float, float, float]


def sphere(radius: float, splits: int, centre: Point = (0.0, 0.0, 0.0), *, over_plane: bool = False) -> Surface:
    """Return 20 splits^2 triangles with their corners on a sphere a little larger, so that the volume is the sphere's.

    Args:
        radius: m.
        splits: edges into which each of an icosahedron's is split.
        centre: m.
        over_plane: whether z = 0 is a rigid plane.
    """
    check_positive(radius=radius)
    check_whole(splits, "splits", 1)
    corners, faces = _icosahedron()
    grid = [(i, j) for i in range(splits + 1) for j in range(splits + 1 - i)]
    places: list[NDArray[np.float64]] = []
    elements: list[tuple[int, int, int, int]] = []
    for a, b, c in faces:
        number = {place: len(places) + n for n, place in enumerate(grid)}
        places += [((splits - i - j) * corners[a] + i * corners[b] + j * corners[c]) / splits for i, j in grid]
        for i, j in grid:
            if i + j < splits:
                elements.append((number[i, j], number[i + 1, j], number[i, j + 1], number[i, j + 1]))
            if i + j < splits - 1:
                elements.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1], number[i, j + 1]))
    spread = np.array(places)
    vertices, numbers = _merged(spread / np.linalg.norm(spread, axis=1)[:, None], np.array(elements))
    panels = Panels(vertices[numbers])
    volume = float(np.sum(panels.area[:, None] * panels.normal * panels.middle)) / 3.0
    scale = radius * (4.0 * np.pi / 3.0 / volume) ** (1.0 / 3.0)
    return Surface(scale * vertices + np.array(centre), numbers, over_plane=over_plane)


def _icosahedron() -> tuple[NDArray[np.float64], list[tuple[int, int, int]]]:
    """Return its twelve corners at a distance of one, and its faces, counterclockwise from without."""
    golden = 0.5 * (1.0 + 5.0**0.5)
    quarter = np.array([(-1.0, golden, 0.0), (1.0, golden, 0.0), (-1.0, -golden, 0.0), (1.0, -golden, 0.0)])
    corners = np.concatenate([np.roll(quarter, turn, axis=1) for turn in range(3)])
    corners /= np.linalg.norm(corners[0])
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 1.1
    triples = ((a, b, c) for a in range(12) for b in range(a + 1, 12) for c in range(a + 1, 12) if b != c)
    touching = ((a, b, c) for a, b, c in triples if near[a, b] and near[b, c] and near[c, a])
    return corners, [face for face in touching if np.linalg.det(corners[list(face)]) > 0.0]


def box(size: Point, counts: tuple[int, int, int], base: Point = (0.0, 0.0, 0.0), *, on_plane: bool = False) -> Surface:
    """Return the rectangles of a box.

    Args:
        size: edges along x, y and z, m.
        counts: elements along each.
        base: middle of the lower face, m.
        on_plane: whether it stands on the rigid plane z = 0, open there; the base's height is then zero.
    """
    for edge, count in zip(size, counts, strict=True):
        check_positive(size=edge)
        check_whole(count, "counts", 1)
    if on_plane and base[2] != 0.0:
        raise ValueError(f"base must be at the height 0 on the plane, got {base[2]!r} m")
    places: list[NDArray[np.float64]] = []
    elements: list[NDArray[np.int64]] = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        rows, columns = counts[u] + 1, counts[v] + 1
        corner = np.arange(rows * columns).reshape(rows, columns)
        around = (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:])
        quads = np.stack([part.ravel() for part in around], axis=1)
        for side in (0, 1):
            if on_plane and axis == 2 and side == 0:
                continue
            place = np.empty((rows, columns, 3))
            place[..., axis] = side
            place[..., u] = np.linspace(0.0, 1.0, rows)[:, None]
            place[..., v] = np.linspace(0.0, 1.0, columns)
            elements.append((quads if side else quads[:, ::-1]) + sum(map(len, places)))
            places.append(place.reshape(-1, 3))
    vertices, numbers = _merged(np.concatenate(places), np.concatenate(elements))
    low = np.array(base) - (0.5 * size[0], 0.5 * size[1], 0.0)
    return Surface(low + vertices * np.array(size), numbers, over_plane=on_plane)


def _merged(
    vertices: NDArray[np.float64], elements: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertices without repetitions, and the elements by their new numbers."""
    numbers: dict[tuple[float, ...], int] = {}
    kept: list[NDArray[np.float64]] = []
    renamed = np.empty(len(vertices), np.int64)
    for place, vertex in enumerate(vertices):
        # Adding zero makes the negative zero the positive one.
        key = tuple(float(round(value, 9)) + 0.0 for value in vertex)
        if key not in numbers:
            numbers[key] = len(kept)
            kept.append(vertex)
        renamed[place] = numbers[key]
    return np.array(kept), renamed[elements]
