"""Kernel: force of a contact that lies partly over spalls, and its derivative, in closed form.

Source: Thibault et al. 2022, Eqs. 15-18, with the corrections that ``models.machine.spall_contact`` names. Over a spall
the pressure of the sound contact is replaced by that of a contact which is less deep by the depth of the spall; both
are half ellipsoids, whose parts over a rectangle are integrated here. The force grows with the deflection everywhere.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from models.platform.jit import inlined, kernel

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from models.platform.jit import Index

INNER, OUTER = 0, 1
# Columns of the races of a bearing, row INNER and row OUTER: stiffness, N/m^1.5, semi-axes along and across the race
# over the root of the deflection, m^0.5, radius of the race and of its groove, m.
R_STIFFNESS, R_ALONG, R_ACROSS, R_RADIUS, R_GROOVE = range(5)
R_SIZE = 5
# Columns of a spall: race, depth, half of its length and of its width, m, its angles around and across the race, rad.
S_RACE, S_DEPTH, S_HALF_LENGTH, S_HALF_WIDTH, S_POSITION, S_MIDDLE = range(6)
S_SIZE = 6
_TURN = 2.0 * math.pi


@inlined
def wrapped(angle: float, every: float) -> float:
    """Return an angle less the nearest multiple of another."""
    return angle - every * math.floor(angle / every + 0.5)


@inlined
def _corner(x: float, y: float) -> tuple[float, float]:
    """Return the integrals of w and of 1 / w, w^2 = 1 - u^2 - v^2, over the unit disc between (0, 0) and (x, y)."""
    x, y = max(-1.0, min(1.0, x)), max(-1.0, min(1.0, y))
    w = math.sqrt(max(0.0, 1.0 - x * x - y * y))
    a, b, c = math.atan2(y, w), math.atan2(x, w), math.atan2(x * y, w)
    return (
        x * y * w / 3.0 + x * (3.0 - x * x) / 6.0 * a + y * (3.0 - y * y) / 6.0 * b - c / 3.0,
        x * a + y * b - c,
    )


@inlined
def share_in_rectangle(x_0: float, x_1: float, y_0: float, y_1: float) -> tuple[float, float]:
    """Return the shares of a contact's force and of its stiffness within bounds in units of the semi-axes."""
    if x_0 >= 1.0 or x_1 <= -1.0 or y_0 >= 1.0 or y_1 <= -1.0:
        return 0.0, 0.0
    if x_0 <= -1.0 and x_1 >= 1.0 and y_0 <= -1.0 and y_1 >= 1.0:
        return 1.0, 1.0
    a, b, c, d = _corner(x_1, y_1), _corner(x_0, y_1), _corner(x_1, y_0), _corner(x_0, y_0)
    return 1.5 / math.pi * (a[0] - b[0] - c[0] + d[0]), 0.5 / math.pi * (a[1] - b[1] - c[1] + d[1])


@inlined
def _part(d: float, race: NDArray[np.float64], spall: NDArray[np.float64], x: float, y: float) -> tuple[float, float]:
    """Return force and stiffness of the part over a spall of a whole contact of deflection d > 0."""
    root = math.sqrt(d)
    b, a = race[R_ALONG] * root, race[R_ACROSS] * root
    half_length, half_width = spall[S_HALF_LENGTH], spall[S_HALF_WIDTH]
    share, steep = share_in_rectangle(
        (-half_length - x) / b, (half_length - x) / b, (-half_width - y) / a, (half_width - y) / a
    )
    force = race[R_STIFFNESS] * d * root
    return force * share, 1.5 * force / d * steep


@kernel
def pressed(
    d: float,
    place: Index,
    angle: float,
    contact_angle: float,
    races: NDArray[np.float64],
    spalls: NDArray[np.float64],
) -> tuple[float, float]:
    """Return force, N, and stiffness, N/m, of a contact of deflection d, m.

    Args:
        place: INNER or OUTER.
        angle: of the ball on that race, rad.
        contact_angle: of the ball on that race, rad.
        races: of the bearing, (2, R_SIZE).
        spalls: of both races, (spalls, S_SIZE).
    """
    if d <= 0.0:
        return 0.0, 0.0
    race = races[place]
    root = math.sqrt(d)
    force, stiffness = race[R_STIFFNESS] * d * root, 1.5 * race[R_STIFFNESS] * root
    for k in range(spalls.shape[0]):
        spall = spalls[k]
        if int(spall[S_RACE]) != place:
            continue
        x = race[R_RADIUS] * wrapped(angle - spall[S_POSITION], _TURN)
        if abs(x) >= spall[S_HALF_LENGTH] + race[R_ALONG] * root:
            continue
        y = race[R_GROOVE] * (contact_angle - spall[S_MIDDLE])
        covered = _part(d, race, spall, x, y)
        force, stiffness = force - covered[0], stiffness - covered[1]
        sunk = d - spall[S_DEPTH]
        if sunk > 0.0:
            reached = _part(sunk, race, spall, x, y)
            force, stiffness = force + reached[0], stiffness + reached[1]
    return max(force, 0.0), max(stiffness, 0.0)
