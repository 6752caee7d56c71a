"""Stiffness and damping of an oil film, from the theory of short journal bearings, in the direction of the load.

Source: Sassi, Badri and Thomas 2007, Eqs. 19-23. The dimensionless factors are lost in print; they follow from the
theory itself. The clearance is radial there: the printed "diametral clearance" would make the eccentricity wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Film:
    """Stiffness, N/m, and damping, N s/m, of a film along the load."""

    stiffness: float
    damping: float


def short_bearing_film(load: float, speed: float, *, thickness: float, clearance: float) -> Film:
    """Return the film that carries a load between surfaces which turn against each other.

    With e = 1 - thickness / clearance and tan(a) = pi sqrt(1 - e^2) / (4 e), in units of load / clearance:
    K w = e s^2 / (1 - e^2)^2 + 3 pi e^2 s c / (4 (1 - e^2)^2.5) + 2 e (1 + e^2) c^2 / (1 - e^2)^3, and divided by the
    angular speed C w = pi s^2 / (2 (1 - e^2)^1.5) + 4 e s c / (1 - e^2)^2 + pi (1 + 2 e^2) c^2 / (2 (1 - e^2)^2.5),
    where s and c are sine and cosine of a and w = e sqrt(16 e^2 + pi^2 (1 - e^2)) / (4 (1 - e^2)^2).

    Args:
        load: N, positive.
        speed: angular speed of the surfaces, rad/s, positive.
        thickness: least thickness of the film, m.
        clearance: radial clearance, m, more than the thickness.

    Raises:
        ValueError: if load or speed is not positive, or the thickness not between zero and the clearance.
    """
    if not (load > 0.0 and speed > 0.0):
        raise ValueError(f"a film needs a load and a speed, got {load!r} N and {speed!r} rad/s")
    if not 0.0 < thickness < clearance:
        raise ValueError(f"film_thickness must lie between 0 and film_clearance, got {thickness!r} and {clearance!r} m")
    e = 1.0 - thickness / clearance
    # 1 - e^2 without cancellation where the film is thin.
    gap = thickness / clearance * (2.0 - thickness / clearance)
    angle = math.atan2(math.pi * math.sqrt(gap), 4.0 * e)
    s, c = math.sin(angle), math.cos(angle)
    carried = e * math.sqrt(16.0 * e * e + math.pi**2 * gap) / (4.0 * gap**2)
    stiffness = (
        e / gap**2 * s * s + 3.0 * math.pi * e * e / (4.0 * gap**2.5) * s * c + 2.0 * e * (1.0 + e * e) / gap**3 * c * c
    )
    damping = (
        math.pi / (2.0 * gap**1.5) * s * s
        + 4.0 * e / gap**2 * s * c
        + math.pi * (1.0 + 2.0 * e * e) / (2.0 * gap**2.5) * c * c
    )
    return Film(load / clearance * stiffness / carried, load / (clearance * speed) * damping / carried)
