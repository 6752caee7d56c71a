"""Points inside a surface, at which the sound outside continues to zero: they decide where resonances of the enclosed
space leave the surface's own equation undecided, and check a solution."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.gears.sound.panels import static_integrals

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.gears.sound.surface import Surface

GAPS = (1.0, 0.5, 0.25)
"""Distances from the surface's elements, by the root of their mean area, tried one after the other."""
_CANDIDATES, _ROUNDS = 64, 12
_PAIRS = 200_000


def enclosed(surface: Surface, x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each point (points, 3) lies inside, by the solid angle of the surface and its image."""
    panels = surface.panels
    sides = (panels, panels.mirrored()) if surface.over_plane else (panels,)
    angle = np.zeros(len(x))
    step = max(_PAIRS // len(surface), 1)
    for side in sides:
        for first in range(0, len(x), step):
            part = x[first : first + step]
            points, places = (found.ravel() for found in np.indices((len(part), len(surface))))
            static = static_integrals(part[points], part[points], side.corners[places], side.normal[places])
            angle[first : first + step] += static.double.reshape(len(part), -1).sum(axis=1)
    return angle < -2.0 * np.pi


def interior_points(surface: Surface, count: int, seed: int = 0) -> NDArray[np.float64]:
    """Return points inside, (at most count, 3) m, at random, away from the elements; none in a body too thin for it."""
    rng = np.random.default_rng(seed)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    size = float(np.sqrt(surface.area.mean()))
    found = np.empty((0, 3))
    for gap in GAPS:
        found = found[:0]
        for _ in range(_ROUNDS):
            x = rng.uniform(low, high, (max(_CANDIDATES, count), 3))
            x = x[_away(surface, x, gap * size)]
            found = np.concatenate((found, x[enclosed(surface, x)]))[:count]
            if len(found) == count:
                return found
        if 2 * len(found) >= count:
            return found
    return found


def _away(surface: Surface, x: NDArray[np.float64], gap: float) -> NDArray[np.bool_]:
    """Return whether points keep a distance from the middles of all elements and the planes of those beside them."""
    between = x[:, None] - surface.middle
    distance2 = np.sum(between**2, axis=2)
    beside = distance2 < surface.panels.longest**2
    height = np.abs(np.einsum("pex,ex->pe", between, surface.normal))
    return np.all((distance2 > gap**2) & ~(beside & (height < gap)), axis=1)
