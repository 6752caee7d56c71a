"""Force of a ball whose contact ellipse lies partly over a spall: pressures of race and floor, integrated.

Source: Thibault et al. 2022, Eqs. 15-18. Misprints mended: the exponent of Eq. 15 is 3/2, the force over the floor is
zero where the ball does not reach it, and with the E* of Eq. 10 the factor in Eq. 17 is 3 (6 belongs to E' = 2 E*, as
in models.machine.hertz). The pressure at the edges of the spall is left out there too. SI units and radians.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from models.machine.hertz import known_length, point_contact_semi_axes
from models.words.checks import check_numbers

if TYPE_CHECKING:
    from models.machine.ball_statics import BallStatics


@dataclass(frozen=True)
class Spall:
    """A rectangular pit of even depth in a race.

    Attributes:
        depth: m.
        extent: along the race, as an angle about the bearing's axis, rad.
        width: across the race, as an angle about the groove's centre of curvature, rad.
        position: of its middle along the race, rad.
        contact_angle: of its middle across the race, rad.
    """

    depth: float
    extent: float
    width: float
    position: float = 0.0
    contact_angle: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "spall.", "positive", "depth", "extent", "width")
        check_numbers(self, "spall.", "finite", "position", "contact_angle")


def force_over_spall(
    statics: BallStatics,
    spall: Spall,
    deflection: float,
    angle: float,
    contact_angle: float,
    race: Literal["inner", "outer"] = "outer",
) -> float:
    """Return the normal force on a ball, N, at a deflection of its contact with the damaged race, m.

    Args:
        angle: of the ball about the bearing's axis, from where the spall's position is counted, rad.
        contact_angle: of the ball on that race, rad.
    """
    races = statics.races()
    k = races.k_i if race == "inner" else races.k_o
    side = -1.0 if race == "inner" else 1.0
    rolling, across = statics.conforming_radii[0 if race == "inner" else 1]
    race_radius = statics.pitch_radius + side * statics.ball_radius
    along = race_radius * math.remainder(angle - spall.position, 2.0 * math.pi)
    groove = known_length(statics.bearing, f"{race}_groove_radius")
    aside = groove * (contact_angle - spall.contact_angle)
    half_length, half_width = 0.5 * race_radius * spall.extent, 0.5 * groove * spall.width

    def part(depth: float) -> tuple[float, float]:
        """Return the force of a whole contact so much deeper, and the share of it that lies over the spall."""
        force = k * max(deflection - depth, 0.0) ** 1.5
        if force == 0.0:
            return 0.0, 0.0
        # The longer semi-axis lies across the race, whose groove conforms to the ball.
        a, b = point_contact_semi_axes(rolling, across, force, "elliptic", modulus=statics.effective_modulus)
        x, y = (-half_length - along) / b, (-half_width - aside) / a
        return force, share_in_rectangle((x, (half_length - along) / b), (y, (half_width - aside) / a))

    sound, covered = part(0.0)
    sunk, reached = part(spall.depth)
    return sound * (1.0 - covered) + sunk * reached


def share_in_rectangle(x: tuple[float, float], y: tuple[float, float]) -> float:
    """Return the share of a Hertzian force that acts within a rectangle, given by its bounds in units of the semi-axes.

    In closed form: the pressure is half an ellipsoid.
    """
    corners = [(1.0, x[1], y[1]), (-1.0, x[0], y[1]), (-1.0, x[1], y[0]), (1.0, x[0], y[0])]
    return 1.5 / math.pi * sum(sign * _quarter(u, v) for sign, u, v in corners)


def _quarter(x: float, y: float) -> float:
    """Return the integral of sqrt(1 - u^2 - v^2) over the part of the unit disc between (0, 0) and (x, y), signed."""
    x, y = max(-1.0, min(1.0, x)), max(-1.0, min(1.0, y))
    w = math.sqrt(max(0.0, 1.0 - x * x - y * y))
    return (
        x * y * w / 3.0
        + x * (3.0 - x * x) / 6.0 * math.atan2(y, w)
        + y * (3.0 - y * y) / 6.0 * math.atan2(x, w)
        - math.atan2(x * y, w) / 3.0
    )
