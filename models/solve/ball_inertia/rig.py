"""Parameters of the bearing whose balls have inertia (Marin, Rubio, Garcia-Prada, Reinoso, JTE 42(1), 2014)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from models.machine.rig import Claim, RigParameters
from models.solve.ring_impact.rig import STEEL_DENSITY
from models.words.checks import check_choice, check_numbers

if TYPE_CHECKING:
    from models.machine.bearing import Bearing
    from models.words.request import Sensor

DefectShape = Literal["rectangle", "half_sine"]
DEFECT_SHAPES: tuple[DefectShape, ...] = ("rectangle", "half_sine")


@dataclass(frozen=True)
class BallInertiaRig(RigParameters):
    """A rotor and inner ring on balls that move radially between fixed outer ring and inner ring (Table 2, 6206).

    Attributes:
        m_rotor, m_i: mass of rotor and inner ring, kg; they move as one.
        m_b: mass of a ball, kg; None is a steel ball of the bearing's size (9.5 mm: the printed 3.5 g).
        k_ci, k_co: contact stiffness of one ball on inner and outer race, N/m^1.5 (Eq. 19).
        c_ci, c_co: damping of these contacts, N s/m; a contact pushes only.
        cage_angle: angle of the first ball from the load at the beginning, rad. The source prints none: by default
            the load stands between two balls, of three as of nine.
        defect_shape: depth of a defect along its extent: "rectangle" (section "Modeling of Located Defect"), or
            "half_sine", which begins and ends at zero.
        calibrated: "declared" where a person vouches for the parameters as those of the machine.
    """

    model: ClassVar[str] = "ball_inertia"
    first_sensor: ClassVar[Sensor] = "a"
    uncertain: ClassVar[tuple[str, ...]] = ("m_rotor", "m_i", "k_ci", "k_co", "c_ci", "c_co")

    m_rotor: float = 1.5
    m_i: float = 0.061
    m_b: float | None = None
    k_ci: float = 779180.0 * 1e3**1.5
    k_co: float = 897760.0 * 1e3**1.5
    c_ci: float = 200.0
    c_co: float = 200.0
    cage_angle: float = math.pi / 3.0
    defect_shape: DefectShape = "rectangle"
    calibrated: Claim = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "rig.", "positive", "m_rotor", "m_i", "k_ci", "k_co")
        check_numbers(self, "rig.", "positive", *(["m_b"] if self.m_b is not None else []))
        check_numbers(self, "rig.", "not negative", "c_ci", "c_co")
        check_numbers(self, "rig.", "finite", "cage_angle")
        check_choice(self.defect_shape, "rig.defect_shape", DEFECT_SHAPES)

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        if bearing.contact_angle != 0.0:
            raise ValueError(
                f"rig: balls move radially, {bearing.designation} has a contact angle of "
                f"{math.degrees(bearing.contact_angle):g} degrees"
            )

    def ball_mass(self, bearing: Bearing) -> float:
        """Return the mass of a ball, kg."""
        if self.m_b is not None:
            return self.m_b
        return STEEL_DENSITY * math.pi / 6.0 * bearing.element_diameter**3

    @property
    def mass(self) -> float:
        """Mass of what moves with the inner ring, kg."""
        return self.m_rotor + self.m_i
