"""Profile of a tooth that a basic rack generates: involute, trochoidal fillet, root.

All in the transverse section, with the tooth's centre line as x axis, outwards, and y the half thickness; the helix
stretches the rack's widths by 1 / cos(beta). The fillet is the envelope of the rack's tip arc: a point of the rack
touches the wheel where the normal of the rack goes through the pitch point.

Source: G. Niemann and H. Winter, Maschinenelemente II (1989), 21.1; F. L. Litvin, Gear Geometry (1994), ch. 6; names as
in ISO 53 and ISO 21771.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class BasicRack:
    """Basic rack, ISO 53 profile A by default; all factors are of the normal module.

    Attributes:
        addendum, dedendum: h_aP and h_fP.
        fillet_radius: rho_fP.
    """

    addendum: float = 1.0
    dedendum: float = 1.25
    fillet_radius: float = 0.38

    def __post_init__(self) -> None:
        """Raise a ValueError that names a factor which cannot be."""
        check_numbers(self, "rack ", "positive", "addendum", "dedendum")
        check_numbers(self, "rack ", "not negative", "fillet_radius")

    def check_fillet(self, pressure_angle: float) -> None:
        """Raise a ValueError where the tip arc does not fit the rack at a normal pressure angle, rad."""
        sine, tangent = math.sin(pressure_angle), math.tan(pressure_angle)
        room = math.pi / 4.0 - self.dedendum * tangent
        widest = room * math.cos(pressure_angle) / (1.0 - sine) if room > 0.0 else 0.0
        if self.fillet_radius * (1.0 - sine) > self.dedendum or self.fillet_radius > widest * (1.0 + 1e-12):
            raise ValueError(
                f"rack fillet_radius must be at most {widest:.4g} at this dedendum and pressure angle, "
                f"got {self.fillet_radius!r}"
            )


@dataclass(frozen=True)
class ToothProfile:
    """Half a tooth in the transverse section.

    Attributes:
        teeth: z.
        module: normal module m_n, m.
        pressure_angle, helix_angle: normal pressure angle and helix angle at the reference circle, rad.
        shift: profile shift factor x.
        rack: that generates the wheel.
        truncation: shortening of the tip, m.
    """

    teeth: int
    module: float
    pressure_angle: float
    helix_angle: float
    shift: float
    rack: BasicRack
    truncation: float = 0.0

    @cached_property
    def transverse_angle(self) -> float:
        """Transverse pressure angle alpha_t, rad."""
        return math.atan(math.tan(self.pressure_angle) / math.cos(self.helix_angle))

    @property
    def reference_radius(self) -> float:
        """Radius r of the reference circle, m."""
        return 0.5 * self.teeth * self.module / math.cos(self.helix_angle)

    @property
    def base_radius(self) -> float:
        """Radius r_b of the base circle, m."""
        return self.reference_radius * math.cos(self.transverse_angle)

    @property
    def tip_radius(self) -> float:
        """Radius r_a of the tip circle, m."""
        return self.reference_radius + self.module * (self.rack.addendum + self.shift) - self.truncation

    @property
    def root_radius(self) -> float:
        """Radius r_f of the root circle, m."""
        return self.reference_radius - self.module * (self.rack.dedendum - self.shift)

    @cached_property
    def form_radius(self) -> float:
        """Radius r_Ff at which the involute begins, m; below the base circle's where the tooth is undercut."""
        sine = math.sin(self.transverse_angle)
        return math.hypot(self.base_radius, self.reference_radius * sine - self._form_depth / sine)

    @property
    def undercut_margin(self) -> float:
        """Height by which the rack's straight flank stays clear of undercut, m; negative: the tooth is undercut."""
        return self.reference_radius * math.sin(self.transverse_angle) ** 2 - self._form_depth

    @property
    def _form_depth(self) -> float:
        """Depth of the end of the rack's straight flank below the rolling pitch line, m."""
        rounded = self.rack.fillet_radius * (1.0 - math.sin(self.pressure_angle))
        return self.module * (self.rack.dedendum - rounded - self.shift)

    @cached_property
    def base_half_angle(self) -> float:
        """Half of the tooth's angle on the base circle, rad."""
        thickness = math.pi / 2.0 + 2.0 * self.shift * math.tan(self.pressure_angle)
        return thickness / self.teeth + float(involute(self.transverse_angle))

    def half_angle(self, radius: Array | float) -> Array:
        """Return half of the tooth's angle at radii of the involute, rad."""
        return self.base_half_angle - involute(np.arccos(self.base_radius / np.asarray(radius, float)))

    def flank(self, roll: Array | float) -> tuple[Array, Array]:
        """Return x and y of the involute, m, at roll angles phi = tan(alpha), rad."""
        phi = np.asarray(roll, float)
        turn = phi - self.base_half_angle
        return (
            self.base_radius * (np.cos(turn) + phi * np.sin(turn)),
            self.base_radius * (phi * np.cos(turn) - np.sin(turn)),
        )

    def roll(self, radius: float) -> float:
        """Return the roll angle phi = tan(alpha) at a radius of the involute, rad."""
        return math.sqrt(max((radius / self.base_radius) ** 2 - 1.0, 0.0))

    def fillet(self, share: Array | float) -> tuple[Array, Array]:
        """Return x and y of the fillet, m, from the root circle (share 0) to the involute (1)."""
        rho, beta = self.rack.fillet_radius * self.module, math.cos(self.helix_angle)
        # Angle of the arc's normal from straight down; at the flank it is 90 deg less the pressure angle.
        gamma = np.asarray(share, float) * (math.pi / 2.0 - self.pressure_angle)
        depth = self.module * (self.rack.dedendum - self.shift)
        # Centre of the arc, from the centre line of the rack's own tooth space, which is the wheel's tooth.
        across = self.module * (math.pi / 4.0 + self.rack.dedendum * math.tan(self.pressure_angle))
        across += rho * (1.0 - math.sin(self.pressure_angle)) / math.cos(self.pressure_angle)
        u = (across - rho * np.sin(gamma)) / beta
        v = -depth + rho * (1.0 - np.cos(gamma))
        normal_u, normal_v = np.sin(gamma) * beta, np.cos(gamma)
        met = v * normal_u / normal_v
        # The rack stands at met - u: seen from the tooth's centre line the wheel has turned back by that over r.
        r = self.reference_radius
        turned, radial = (u - met) / r, r + v
        return (
            radial * np.cos(turned) - met * np.sin(turned),
            radial * np.sin(turned) + met * np.cos(turned),
        )

    @cached_property
    def root_half_angle(self) -> float:
        """Half of the angle between the ends of the tooth's fillets on the root circle, rad."""
        x, y = self.fillet(0.0)
        return math.atan2(float(y), float(x))


def involute(angle: Array | float) -> Array:
    """Return inv(alpha) = tan(alpha) - alpha."""
    return np.tan(angle) - angle
