"""Parameters of the rotor on two bearings (Ceruti, master thesis, Torino 2021), and the springs of its shaft."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from models.machine.rig import Claim, RigParameters
from models.words.checks import check_choice, check_numbers

if TYPE_CHECKING:
    from models.machine.bearing import Bearing, Element
    from models.words.request import Sensor


@dataclass(frozen=True)
class RotorRig(RigParameters):
    """A rigid disc C on a massless shaft between the bearings A and B (Ceruti, Tables 5.1 and 5.2).

    Attributes:
        m: mass of the disc, kg.
        j_p, j_t: its moments of inertia about the shaft and across it, kg m2.
        length: distance of the bearings, m.
        a: distance of the disc from bearing A, m; ``b`` is the rest.
        shaft_diameter, modulus: of the shaft, m and Pa; they matter where the shaft is elastic only.
        end_mass: mass of the inner ring and of its share of the shaft at either end, kg. The source has none; where the
            shaft is elastic, the ends have accelerations only with it (0.1 to 0.5 kg is usual for this rotor).
        k_c: contact stiffness of one rolling element of bearing A between both rings, N/m^1.5 of a ball, N/m^(10/9)
            of a roller. The source prints none: the default is elliptic Hertz with its Table 5.1 for the 6305.
        k_c_b: the same of bearing B, or None for that of A.
        c_b: damping of one loaded element, N s/m.
        c_n, c_t: damping of the disc against the ground, N s/m, and of its tilting, N m s.
        internal_damping: of the elastic shaft, as a multiple of its stiffness, s (the C_r of section 3.2.2).
        cage_angle_a, cage_angle_b: angle of the first ball of each bearing from the load at the beginning, rad.
        couple_angle, bow_angle: angles by which couple unbalance and bow lead the unbalance, rad.
        bow_slope: slope of the bowed shaft at the disc over its bow, 1/m; 0 where the disc stands in the middle.
        element: the rolling element that ``k_c`` belongs to; a scene refuses a bearing with another.
        calibrated: "declared" where a person vouches for the parameters as those of the machine.
    """

    model: ClassVar[str] = "rotor"
    first_sensor: ClassVar[Sensor] = "a"
    uncertain: ClassVar[tuple[str, ...]] = ("m", "j_p", "j_t", "shaft_diameter", "modulus", "k_c", "c_b", "c_n")

    m: float = 5.0
    j_p: float = 2.0
    j_t: float = 1.2
    length: float = 0.8
    a: float = 0.4
    shaft_diameter: float = 0.025
    modulus: float = 200e9
    end_mass: float = 0.0
    k_c: float = 8.4484e9
    k_c_b: float | None = None
    c_b: float = 1000.0
    c_n: float = 200.0
    c_t: float = 0.0
    internal_damping: float = 0.0
    cage_angle_a: float = math.pi / 7.0
    cage_angle_b: float = 0.0
    couple_angle: float = 0.0
    bow_angle: float = 0.0
    bow_slope: float = 0.0
    element: Element = "ball"
    calibrated: Claim = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "rig.", "positive", "m", "j_p", "j_t", "length", "a", "shaft_diameter", "modulus", "k_c")
        check_numbers(self, "rig.", "positive", *(["k_c_b"] if self.k_c_b is not None else []))
        check_numbers(self, "rig.", "not negative", "end_mass", "c_b", "c_n", "c_t", "internal_damping")
        check_numbers(self, "rig.", "finite", "cage_angle_a", "cage_angle_b", "couple_angle", "bow_angle", "bow_slope")
        check_choice(self.element, "rig.element", ("ball", "roller"))
        if not self.a < self.length:
            raise ValueError(f"rig.a must be less than rig.length, {self.length!r} m, got {self.a!r}")

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        if self.element != bearing.element:
            raise ValueError(f"rig.k_c is that of a {self.element}, {bearing.designation} has {bearing.element}s")
        if bearing.contact_angle != 0.0:
            raise ValueError(
                f"rig: the bearings of a rotor are radial, {bearing.designation} has a contact angle of "
                f"{math.degrees(bearing.contact_angle):g} degrees"
            )

    @property
    def b(self) -> float:
        """Distance of the disc from bearing B, m."""
        return self.length - self.a

    @property
    def shaft_stiffness(self) -> tuple[float, float]:
        """Springs 3 E I / a^3 and 3 E I / b^3 between disc and bearings, N/m.

        They are exact for a massless shaft on simple supports: K11 = k_A + k_B, K12 = a k_A - b k_B and
        K22 = a^2 k_A + b^2 k_B. The printed K_Aeq divides by a^2 - b^2.
        """
        bending = 3.0 * self.modulus * math.pi * self.shaft_diameter**4 / 64.0
        return bending / self.a**3, bending / self.b**3
