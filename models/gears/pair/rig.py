"""Parameters of a pair of gears on two shafts, one of which turns in the bearing that is looked at."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from models.machine.rig import Claim, RigParameters
from models.words.checks import check_choice, check_numbers, check_whole

if TYPE_CHECKING:
    from models.machine.bearing import Bearing, Element
    from models.words.request import Sensor


@dataclass(frozen=True)
class GearPairRig(RigParameters):
    """A driving shaft A in the bearing, a driven shaft B on springs, a pair of spur gears between them.

    The defaults are those of no machine in print. With them the gears are smooth: their stiffness is constant, and
    only the bearing drives the motion.

    Attributes:
        m, m_b: mass of each shaft with its wheel, kg.
        inertia, inertia_b: moments of inertia about the axes, kg m2.
        teeth, teeth_b: of the wheels.
        module: m.
        pressure_angle: working angle, rad.
        direction_b: direction from shaft A to shaft B, from the load, rad.
        torque: of the drive, on shaft A, N m; the load is on shaft B.
        k_mesh: mean stiffness of the mesh along the line of action, N/m.
        mesh_variation: amplitude of its first harmonic over the mean.
        mesh_damping: damping ratio of the mesh between the two inertias.
        backlash: along the line of action, m.
        eccentricity, eccentricity_b: of the wheels, m: error of the mesh once a turn.
        k_c: contact stiffness of one rolling element between both rings, N/m^1.5 of a ball, N/m^(10/9) of a roller.
        c_b: damping of one loaded element, N s/m.
        c_n: damping of shaft A against the casing, N s/m.
        k_b, c_nb: stiffness and damping of the support of shaft B, N/m and N s/m.
        cage_angle: angle of the first element from the load at the beginning, rad.
        element: the rolling element that ``k_c`` belongs to; a scene refuses a bearing with another.
        calibrated: "declared" where a person vouches for the parameters as those of the machine.
    """

    model: ClassVar[str] = "gear_pair"
    slow: ClassVar[bool] = True
    first_sensor: ClassVar[Sensor] = "a"
    uncertain: ClassVar[tuple[str, ...]] = ("m", "m_b", "inertia", "inertia_b", "k_mesh", "k_c", "c_b", "c_n", "k_b")

    m: float = 6.0
    m_b: float = 9.0
    inertia: float = 0.01
    inertia_b: float = 0.03
    teeth: int = 23
    teeth_b: int = 41
    module: float = 4e-3
    pressure_angle: float = math.radians(20.0)
    direction_b: float = 0.5 * math.pi
    torque: float = 20.0
    k_mesh: float = 4e8
    mesh_variation: float = 0.0
    mesh_damping: float = 0.05
    backlash: float = 1e-4
    eccentricity: float = 0.0
    eccentricity_b: float = 0.0
    k_c: float = 8.4484e9
    c_b: float = 1000.0
    c_n: float = 200.0
    k_b: float = 3e8
    c_nb: float = 3000.0
    cage_angle: float = math.pi / 7.0
    element: Element = "ball"
    calibrated: Claim = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        positive = ("m", "m_b", "inertia", "inertia_b", "module", "k_mesh", "k_c", "k_b")
        check_numbers(self, "rig.", "positive", *positive)
        damping = ("torque", "mesh_variation", "mesh_damping", "backlash", "c_b", "c_n", "c_nb")
        check_numbers(self, "rig.", "not negative", *damping)
        check_numbers(self, "rig.", "finite", "direction_b", "eccentricity", "eccentricity_b", "cage_angle")
        check_whole(self.teeth, "rig.teeth", 1)
        check_whole(self.teeth_b, "rig.teeth_b", 1)
        check_choice(self.element, "rig.element", ("ball", "roller"))
        if not 0.0 < self.pressure_angle < 0.5 * math.pi:
            raise ValueError(f"rig.pressure_angle must lie between 0 and pi / 2 rad, got {self.pressure_angle!r}")
        if not self.mesh_variation < 1.0:
            raise ValueError(f"rig.mesh_variation must be less than 1, got {self.mesh_variation!r}")

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        if self.element != bearing.element:
            raise ValueError(f"rig.k_c is that of a {self.element}, {bearing.designation} has {bearing.element}s")
        if bearing.contact_angle != 0.0:
            raise ValueError(
                f"rig: the bearing of a gear shaft is radial, {bearing.designation} has a contact angle of "
                f"{math.degrees(bearing.contact_angle):g} degrees"
            )

    @property
    def smooth(self) -> bool:
        """Whether the gears do not drive the motion."""
        return self.mesh_variation == self.eccentricity == self.eccentricity_b == 0.0
