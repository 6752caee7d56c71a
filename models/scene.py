"""The description of a simulated bearing: rig, defect, floor, slip, operating point.

All quantities are SI and radians. A field that is None or zero switches its effect off, at no cost of arithmetic.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from models.bearing import Bearing, from_catalogue

Part = Literal["outer", "inner", "ball"]


@dataclass(frozen=True)
class Rig:
    """Lumped parameters of the six-degree-of-freedom model (thesis, Table 18 and section 4.2.1).

    Attributes:
        m_i: mass of inner ring and shaft, kg.
        m_o: mass of outer ring and casing, kg.
        m_r: mass of the fictitious high-frequency resonator, kg.
        m_b: mass of one rolling element, kg.
        k_i: stiffness of the shaft to ground, N/m.
        k_r: stiffness between resonator and casing, N/m.
        k_c: contact stiffness of one rolling element between both rings, N/m^1.5 (Eq. 35).
        c_i: damping of the shaft to ground, N s/m.
        c_r: damping between resonator and casing, N s/m.
        alpha_c: mass coefficient of the contact damping, 1/s (Eq. 39).
        beta_c: stiffness coefficient of the contact damping, s (Eq. 39).
        calibrated: whether the parameters were identified on the machine itself.
    """

    m_i: float = 3.48
    m_o: float = 5.79
    m_r: float = 3.01
    m_b: float = 1.47e-3
    k_i: float = 75e6
    k_r: float = 4.25e9
    k_c: float = 5927e6
    c_i: float = 2834.1
    c_r: float = 186.0
    alpha_c: float = 154.9
    beta_c: float = 2.5e-5
    calibrated: bool = False


@dataclass(frozen=True)
class Floor:
    """The bottom of an extended defect.

    Attributes:
        kind: "smooth" (Eq. 83) or "rough" (Eq. 88).
        sd: standard deviation of the rough profile after filtering, m.
        pitch: spacing of the profile's independent samples along the race, rad; independent of speed and rate.
        cutoff: spatial low-pass cut-off of the profile, cycles per metre (Eq. 87 with R = 10 um by default).
        seed: seed of the profile; the same seed is the same race.
    """

    kind: Literal["smooth", "rough"] = "smooth"
    sd: float = 1e-6
    pitch: float = 2e-3
    cutoff: float | None = None
    seed: int = 0


@dataclass(frozen=True)
class Defect:
    """A defect of the outer race, the inner race or one ball of each damaged row.

    Attributes:
        dphi_d: angular extent about the axis of the race, or about the ball's own axis, rad (Eqs. 49-50).
        h_d: depth of the floor, m; deeper than the ball can reach is the localised defect of Eq. 51.
        position: angle of the centre, rad, at the beginning: from the load direction (races), or of a ball's spot from
            the contact with the outer race.
        rows: number of damaged rows of the bearing, from ``first_row`` on.
        part: "outer" (stands still), "inner" (turns with the shaft) or "ball" (turns with the first ball of a row).
        first_row: the first damaged row, counted from 0.
    """

    dphi_d: float
    h_d: float
    floor: Floor = field(default_factory=Floor)
    position: float = 0.0
    rows: int = 1
    part: Part = "outer"
    first_row: int = 0


@dataclass(frozen=True)
class Waviness:
    """One harmonic of a race's roundness error: it recedes from the balls by amplitude * cos(order * phi + phase).

    Attributes:
        amplitude: half the distance from crest to trough, m.
        order: waves around the race, at least 1.
        race: "outer" or "inner"; phi is measured on it, from the load direction at the beginning.
        phase: phase at phi = 0, rad.
    """

    amplitude: float
    order: int
    race: Literal["outer", "inner"] = "outer"
    phase: float = 0.0


@dataclass(frozen=True)
class Slip:
    """Deviation of balls from their place in the cage (Eq. 82): sigma is uniform between -phi_slip and phi_slip.

    As printed, sigma is white noise and the result depends on how often it is redrawn; ``rule`` chooses. Sigma is not
    differentiated.

    Attributes:
        phi_slip: largest angle, rad; the standard deviation is phi_slip / sqrt(3).
        rule: "per_passage": every ball keeps one sigma for one passage of the loaded zone. "mean_force": the limit of
            sigma redrawn ever faster, in which only the mean of the contact force over sigma acts; deterministic and
            periodic, for comparison with Figs. 49 to 51 of the thesis.
        seed: seed of the draws.
    """

    phi_slip: float
    rule: Literal["per_passage", "mean_force"] = "per_passage"
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: naming the field.
        """
        if not 0.0 <= self.phi_slip < 0.5:
            raise ValueError(f"slip.phi_slip must lie between 0 and 0.5 rad, got {self.phi_slip!r}")
        if self.rule not in ("per_passage", "mean_force"):
            raise ValueError(f"slip.rule must be 'per_passage' or 'mean_force', got {self.rule!r}")

    @property
    def redraws(self) -> bool:
        """Whether the motion is random."""
        return self.rule == "per_passage" and self.phi_slip > 0.0


@dataclass(frozen=True)
class Scene:
    """One bearing at one operating point with one state of damage.

    Attributes:
        speed: shaft speed, Hz.
        load: radial load, N.
        defect: the damage, or None for a healthy bearing.
        clearance: radial clearance h of Eq. 34, m.
        waviness: roundness errors of the races.
        unbalance: unbalance of the shaft (mass times eccentricity), kg m; at the load direction at time zero.
        gravity: acceleration of gravity that acts on the masses, m/s2.
        gravity_angle: angle of gravity from the direction of the load on the outer ring, rad.
        slip: deviation of balls from their place in the cage (Eq. 82), or None.
    """

    speed: float
    load: float
    bearing: Bearing = field(default_factory=lambda: from_catalogue("1205 ETN9"))
    rig: Rig = field(default_factory=Rig)
    defect: Defect | None = None
    clearance: float = 0.0
    model: str = "six_dof"
    waviness: tuple[Waviness, ...] = ()
    unbalance: float = 0.0
    gravity: float = 0.0
    gravity_angle: float = 0.0
    slip: Slip | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that ``models.dynamics.time_domain`` models (of slip, ``models.dynamics.lanes`` too);
        without any, the motion is periodic with the ball passage and ``models.simulate.simulate`` solves it.
        """
        named = {
            "waviness": any(w.amplitude != 0.0 for w in self.waviness),
            "unbalance": self.unbalance != 0.0,
            "gravity": self.gravity != 0.0,
        }
        if self.defect is not None:
            named["slip"] = self.slip is not None and self.slip.phi_slip != 0.0
            named["defect.part"] = self.defect.part != "outer"
            named["defect.first_row"] = self.defect.first_row != 0
        return tuple(name for name, is_named in named.items() if is_named)
