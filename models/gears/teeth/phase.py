"""Where the teeth of a pair stand when a tooth begins its mesh, and so which phase two meshes of one wheel have.

A tooth of the driver begins its mesh where the tip of its mate reaches the line of action, at A. At that moment the
centre lines of both teeth have known directions. A wheel that meshes twice, an idler, has its teeth at equal steps:
what one mesh says of them gives the phase of the other. R. Parker and J. Lin, Mesh phasing relationships in planetary
and epicyclic gears, J. Mech. Des. 126 (2004) 365, derive the same for planets.
"""

from __future__ import annotations

import math

from models.gears.teeth.geometry import GearPair


def begin_of_mesh(pair: GearPair, to_driven: float, *, counterclockwise: bool) -> tuple[float, float]:
    """Return the directions of the centre lines of both teeth when they begin their mesh, rad, from x towards y.

    Args:
        pair: whose flanks touch without backlash on the driving side.
        to_driven: direction from the centre of the driver to that of the driven wheel, rad.
        counterclockwise: whether the driver turns from x towards y.
    """
    driver, driven = pair.profiles
    begin = pair.contact_path[0]
    left = pair.tangent_length - begin
    # Of each tooth from the line of centres, in the sense in which its wheel turns.
    ahead = math.atan(begin / driver.base_radius) - pair.working_angle
    ahead -= float(driver.half_angle(math.hypot(driver.base_radius, begin)))
    behind = pair.working_angle - math.atan(left / driven.base_radius)
    behind += float(driven.half_angle(math.hypot(driven.base_radius, left)))
    sense = 1.0 if counterclockwise else -1.0
    return to_driven + sense * ahead, to_driven + math.pi - sense * behind


def turns_between(first: float, second: float, *, counterclockwise: bool) -> float:
    """Return the turns of a wheel from where a tooth stands in the direction ``first`` to ``second``, rad, -1 to 1."""
    turns = (second - first) / math.tau
    return math.fmod(turns if counterclockwise else -turns, 1.0)
