"""The surface in which an element and a race touch: pressure acts at right angles to it.

Both surfaces yield alike where the moduli are the same, so that it lies midway between them: its slopes are the means
of theirs. It matters where a contact is long against the ball's radius: at a / R = 0.55 (6210 at 10 kN on a ball).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.fe.meshes.geometry import FeGeometry, Race

# (dy/dx, dy/dz) at (x, z) of the tangent plane, m.
Slopes = Callable[["NDArray[np.float64]", "NDArray[np.float64]"], tuple["NDArray[np.float64]", "NDArray[np.float64]"]]


def common_slopes(geometry: FeGeometry, race: Race) -> tuple[Slopes, Slopes]:
    """Return the slopes of the common surface in the element's frame and in the ring's (y from centre to contact).

    They are the ``slope`` of :func:`models.fe.solid.condense.compliance`. The element's mesh has its contact at +y with
    either race, so that the frames are mirrored for the inner race.
    """
    sense = -1.0 if race == "inner" else 1.0

    def of_element(x: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        element, ring = element_slopes(geometry, x, z), race_slopes(geometry, race, x, z)
        return 0.5 * (element[0] + sense * ring[0]), 0.5 * (element[1] + sense * ring[1])

    def of_ring(x: NDArray[np.float64], z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        along, across = of_element(x, z)
        return sense * along, sense * across

    return of_element, of_ring


def element_slopes(
    geometry: FeGeometry, x: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return dy/dx and dy/dz of an element's surface at (x, z), its contact at +y."""
    across = z if geometry.element == "ball" else 0.0 * z
    height = np.sqrt(geometry.element_radius**2 - x**2 - across**2)
    return -x / height, -across / height


def race_slopes(
    geometry: FeGeometry, race: Race, x: NDArray[np.float64], z: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return dy/dx and dy/dz of a race at (x, z), its contact at +y; z within the groove."""
    outwards = 1.0 if race == "inner" else -1.0
    groove = geometry.groove_radius(race)
    depth = np.zeros_like(z) if groove is None else np.sqrt(groove**2 - z**2)
    side = 0.0 * z if groove is None else z / depth
    radius = geometry.race_radius(race) + (0.0 if groove is None else outwards * (groove - depth))
    height = np.sqrt(radius**2 - x**2)
    return -x / height, outwards * side * radius / height
