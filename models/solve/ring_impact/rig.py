"""Parameters of the model of impacts on rings (Sassi, Badri and Thomas 2007, "BEAT"; JVC 13(11), 1603-1628)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from models.machine.rig import Claim, RigParameters
from models.words.checks import check_choice, check_numbers, check_whole

if TYPE_CHECKING:
    from models.machine.bearing import Bearing
    from models.words.request import Sensor

Pulse = Literal["rectangle", "half_sine"]
STEEL_DENSITY = 7800.0
"""Of rolling elements, kg/m3."""


@dataclass(frozen=True)
class RingSection:
    """A ring as a curved beam.

    Attributes:
        modulus: Young's modulus, Pa.
        second_moment: of the cross-section, about the axis of bending, m4.
        mass_per_length: kg/m.
        radius: of the neutral axis, m.
    """

    modulus: float
    second_moment: float
    mass_per_length: float
    radius: float

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "ring.", "positive", "modulus", "second_moment", "mass_per_length", "radius")

    @property
    def mass(self) -> float:
        """Mass of the ring, kg."""
        return 2.0 * math.pi * self.radius * self.mass_per_length

    def frequency(self, order: int = 2) -> float:
        """Return the natural frequency of a flexural mode, Hz (Eq. 17); 0 and 1 move the ring as a whole.

        Raises:
            ValueError: if the order is not a whole number of at least 2.
        """
        check_whole(order, "order", 2)
        beam = math.sqrt(self.modulus * self.second_moment / (self.mass_per_length * self.radius**4))
        return order * (order**2 - 1) / math.sqrt(1.0 + order**2) * beam / (2.0 * math.pi)

    @property
    def stiffness(self) -> float:
        """Stiffness of the elliptic mode, N/m: M (2 pi f_2)^2 (Eq. 18)."""
        return self.mass * (2.0 * math.pi * self.frequency()) ** 2


@dataclass(frozen=True)
class RingImpactRig(RigParameters):
    """Lumped parameters of a bearing whose rings bend under the impacts of a defect.

    The stiffnesses of both rings are printed, their masses follow from these and the printed frequencies of 10,593 and
    4102 Hz (6206). Films, pulse and noise are not printed; their defaults are those of a study of this model.

    Attributes:
        m_o, m_i: modal masses of outer and inner ring, kg.
        k_o, k_i: modal stiffnesses of the rings' elliptic modes, N/m (Eq. 18).
        m_b: mass of the rolling element between them, kg; None is a steel element of the bearing's size.
        k_of, k_if: stiffness of the oil films at outer and inner race, N/m.
        c_of, c_if: damping of these films, N s/m; nothing else is damped.
        film_thickness: least thickness of an oil film, m. With it both films are those of a short journal bearing
            under the largest load of an element (models.solve.ring_impact.hits), and the four fields above are not
            used.
        film_clearance: radial clearance of that journal, m.
        k_c: contact stiffness of an element, N/m^n, for clearance and axial load; None is that of the geometry.
        load_factor: load factor eps of Eq. 5; None is that of clearance and axial load
            (models.machine.load_distribution).
        k_impact: impacting coefficient K_imp of Eq. 16.
        pulse: shape of the force of one impact.
        pulse_width: its duration, s; two samples at 48 kHz by default.
        fixed_sensor: whether the ring's motion is turned to the direction of the sensor (Eq. 30); without it, it is
            that along the line through the defect.
        gain: of the path to the sensor and of what the model lacks (section 7); all impacts are multiplied by it. One
            is that of no measurement (``models.solve.ring_impact.solver.calibrate``): levels then have no unit.
        slip_noise: K_N of Eq. 32: RMS of the noise, m/s2, at a slip speed of 1 m/s and a contact pressure of 1 GPa.
        slip_ratio: slip speed over the speed with which a race passes the cage.
        noise_weights: coefficients of f, the polynomial of defect size over element diameter, lowest power first.
        noise_seed: seed of the noise.
        calibrated: "declared" where a person vouches for the parameters as those of the machine.
    """

    model: ClassVar[str] = "ring_impact"
    first_sensor: ClassVar[Sensor] = "mo"
    ignores_depth: ClassVar[str] = "its impacts follow the extent of a defect, not its depth"
    uncertain: ClassVar[tuple[str, ...]] = ("m_o", "m_i", "k_o", "k_i", "k_of", "k_if", "c_of", "c_if", "gain")

    m_o: float = 0.0897
    m_i: float = 0.0560
    k_o: float = 5.96e7
    k_i: float = 2.48e8
    m_b: float | None = None
    k_of: float = 1e8
    k_if: float = 1e8
    c_of: float = 30.0
    c_if: float = 30.0
    film_thickness: float | None = None
    film_clearance: float | None = None
    k_c: float | None = None
    load_factor: float | None = None
    k_impact: float = 1.0
    pulse: Pulse = "rectangle"
    pulse_width: float = 2.0 / 48000.0
    fixed_sensor: bool = True
    gain: float = 1.0
    slip_noise: float = 0.0
    slip_ratio: float = 0.01
    noise_weights: tuple[float, ...] = (1.0,)
    noise_seed: int = 0
    calibrated: Claim = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "rig.", "positive", "m_o", "m_i", "k_o", "k_i", "k_of", "k_if", "c_of", "c_if")
        check_numbers(self, "rig.", "positive", "pulse_width", "slip_ratio")
        check_numbers(self, "rig.", "not negative", "k_impact", "gain", "slip_noise")
        optional = ("m_b", "film_thickness", "film_clearance", "k_c", "load_factor")
        check_numbers(self, "rig.", "positive", *(name for name in optional if getattr(self, name) is not None))
        check_choice(self.pulse, "rig.pulse", ("rectangle", "half_sine"))
        check_whole(self.noise_seed, "rig.noise_seed", 0)
        if (self.film_thickness is None) != (self.film_clearance is None):
            raise ValueError("rig.film_thickness and rig.film_clearance belong together, got one of them")
        thickness, clearance = self.film_thickness, self.film_clearance
        if thickness is not None and clearance is not None and thickness >= clearance:
            raise ValueError(
                f"rig.film_thickness must be less than rig.film_clearance, got {thickness!r} and {clearance!r} m"
            )
        if not self.noise_weights or not all(math.isfinite(weight) for weight in self.noise_weights):
            raise ValueError(f"rig.noise_weights must hold finite numbers, got {self.noise_weights!r}")

    @property
    def scaled(self) -> bool:
        """Whether levels have the unit of an acceleration: the gain was set by a measurement, or is vouched for."""
        return self.gain != 1.0 or self.calibrated is not False

    def check_bearing(self, bearing: Bearing) -> None:
        """Raise a ValueError that says why the parameters cannot belong to a bearing."""
        if bearing.element == "roller" and bearing.effective_length is None and self.m_b is None:
            raise ValueError(f"rig.m_b must be given: the length of the rollers of {bearing.designation} is unknown")

    def with_rings(self, outer: RingSection, inner: RingSection) -> RingImpactRig:
        """Return the parameters with masses and stiffnesses of rings of known section (Eqs. 17 and 18)."""
        return replace(self, m_o=outer.mass, k_o=outer.stiffness, m_i=inner.mass, k_i=inner.stiffness)

    def element_mass(self, bearing: Bearing) -> float:
        """Return the mass of a rolling element, kg."""
        if self.m_b is not None:
            return self.m_b
        radius = 0.5 * bearing.element_diameter
        if bearing.effective_length is not None:
            return STEEL_DENSITY * math.pi * radius**2 * bearing.effective_length
        return STEEL_DENSITY * 4.0 / 3.0 * math.pi * radius**3
