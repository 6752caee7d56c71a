"""Parameters of an elastic shaft on two ball bearings whose angular speed is watched (Thibault et al. 2022)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from models.machine.rig import Claim, RigParameters
from models.machine.shaft_beam import Coupling, Disc, Shaft
from models.words.checks import check_choice, check_numbers, check_whole

if TYPE_CHECKING:
    from models.machine.bearing import Bearing

Sensor = Literal["a", "b", "c"]


@dataclass(frozen=True)
class AngularRig(RigParameters):
    """A hollow shaft with a bearing at each end, a disc in the middle, a drive and a load on couplings (section II.1).

    The drive is at bearing A, the load at bearing B. The outer rings are held but for one, which floats along the
    shaft. Printed values are the defaults; where the source prints none, the default's reason stands here.

    Attributes:
        length, outer_diameter, inner_diameter: of the shaft, m.
        elements: beam elements, an even number, so that a node is in the middle.
        modulus, poisson, density: of shaft, races and balls, Pa, 1 and kg/m3.
        disc_mass, disc_polar, disc_across: mass, kg, and moments of inertia about the shaft and across it, kg m2, of
            the disc. Not printed: 8.5e-6 kg m2 give the printed second mode of torsion, 8480 Hz; the others are those
            of a ring that reaches 5 mm over the shaft and has this inertia.
        coupling: torsional stiffness of each coupling, N m/rad.
        end_inertia: of drive and of load, kg m2. Not printed: it gives the printed mode of the couplings, 130 Hz.
        load_torque: of the load at the nominal speed, N m, to which it is proportional. Not printed: 10 N m.
        governor: natural frequency, in turns of the shaft, with which the drive holds the nominal rotation, at a
            damping ratio of 0.7. The source has a constant torque, whose mean speed is not known before; slower than
            all lines of the bearings, it takes nothing but the mean from the result.
        damping: damping ratio of the modes. Not printed: 0.02.
        resistance: coefficient of rolling resistance C_r.
        ball_inertia: whether the balls' own acceleration resists that of the shaft (second terms of Eq. 12), as an
            inertia at each bearing. The source calls it small; with it the second mode of torsion is 8.1 kHz.
        groove: radius of both grooves over the diameter of the balls, of a bearing that does not name its own. Not
            printed: with ``play`` it meets four figures of the source (docs/evidence/models.md).
        play: diametral clearance, m, of a bearing without nominal contact angle, in a scene that names none.
        located: the bearing whose outer ring is held along the shaft too; it carries the axial load.
        slide_time: time in which the floating outer ring follows, s: its housing resists as a viscous film does. In
            the source it follows at once.
        encoder: where the angular speed is measured: the node of bearing "a", "b" or of the disc, "c", as in the
            source.
        mode_limit: modes beyond it, Hz, are slowed to it: they keep their flexibility and follow loads.
        cage_angle_a, cage_angle_b: angle of the first ball of each bearing from the load at the beginning, rad.
        calibrated: "declared" where a person vouches for the parameters as those of the machine.
    """

    model: ClassVar[str] = "angular"
    slow: ClassVar[bool] = True
    first_sensor: ClassVar[Literal["ias"]] = "ias"
    uncertain: ClassVar[tuple[str, ...]] = (
        "disc_mass",
        "disc_polar",
        "disc_across",
        "coupling",
        "end_inertia",
        "damping",
        "resistance",
        "play",
    )

    length: float = 0.4
    outer_diameter: float = 0.04
    inner_diameter: float = 0.03
    elements: int = 4
    modulus: float = 200e9
    poisson: float = 0.3
    density: float = 7800.0
    disc_mass: float = 0.017
    disc_polar: float = 8.5e-6
    disc_across: float = 4.3e-6
    coupling: float = 1300.0
    end_inertia: float = 1.91e-3
    load_torque: float = 10.0
    governor: float = 0.1
    damping: float = 0.02
    resistance: float = 0.0015
    ball_inertia: bool = False
    groove: float = 0.51
    play: float = 35e-6
    located: Literal["a", "b"] = "b"
    slide_time: float = 1e-4
    encoder: Sensor = "c"
    mode_limit: float = 30e3
    cage_angle_a: float = 0.0
    cage_angle_b: float = 0.0
    calibrated: Claim = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        _ = self.shaft
        check_whole(self.elements, "rig.elements", 2)
        if self.elements % 2:
            raise ValueError(f"rig.elements must be even, got {self.elements!r}")
        check_numbers(self, "rig.", "positive", "coupling", "end_inertia", "governor", "slide_time", "mode_limit")
        check_numbers(self, "rig.", "not negative", "disc_mass", "disc_polar", "disc_across", "load_torque", "play")
        check_numbers(self, "rig.", "not negative", "resistance")
        check_numbers(self, "rig.", "finite", "cage_angle_a", "cage_angle_b")
        if not 0.0 < self.damping < 1.0:
            raise ValueError(f"rig.damping must lie between 0 and 1, got {self.damping!r}")
        if not 0.5 < self.groove < math.inf:
            raise ValueError(f"rig.groove must exceed 0.5, got {self.groove!r}")
        check_choice(self.located, "rig.located", ("a", "b"))
        check_choice(self.encoder, "rig.encoder", ("a", "b", "c"))

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        if bearing.rows > 1 and bearing.contact_angle != 0.0:
            raise ValueError(f"rig: bearings have one row of balls, {bearing.designation} has {bearing.rows}")
        for radius in (bearing.inner_groove_radius, bearing.outer_groove_radius):
            if radius is not None and bearing.element == "ball" and radius <= 0.5 * bearing.element_diameter:
                raise ValueError(f"rig: grooves must exceed the balls, {bearing.designation} has one of {radius!r} m")

    @property
    def shaft(self) -> Shaft:
        """The shaft."""
        return Shaft(
            self.length,
            self.outer_diameter,
            self.inner_diameter,
            self.elements,
            self.modulus,
            self.poisson,
            self.density,
        )

    @property
    def disc(self) -> Disc:
        """The disc."""
        return Disc(self.elements // 2, self.disc_mass, self.disc_polar, self.disc_across)

    @property
    def couplings(self) -> tuple[Coupling, Coupling]:
        """Those of the drive and of the load."""
        return (
            Coupling(0, self.coupling, self.end_inertia),
            Coupling(self.elements, self.coupling, self.end_inertia),
        )

    def grooved(self, bearing: Bearing) -> Bearing:
        """Return a bearing with the groove radii that it lacks."""
        radius = self.groove * bearing.element_diameter
        return replace(
            bearing,
            inner_groove_radius=bearing.inner_groove_radius or radius,
            outer_groove_radius=bearing.outer_groove_radius or radius,
        )
