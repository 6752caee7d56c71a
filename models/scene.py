"""The description of a simulated bearing: rig and its modes, defect, floor, slip, operating point.

All quantities are SI and radians. A field that is None or zero switches its effect off, at no cost of arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.bearing import Bearing, Element, from_catalogue
from models.checks import check_choice, check_numbers, check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

Part = Literal["outer", "inner", "ball"]
PARTS: tuple[Part, ...] = ("outer", "inner", "ball")
Race = Literal["outer", "inner"]
Calibration = bool | Literal["declared"]
"""Whether a rig's parameters are those of the machine: identified on it, or "declared" by a person."""

# What a scene may have beyond a healthy ball bearing without clearance whose inner ring turns; words for people.
EFFECTS: dict[str, str] = {
    "outer_defect": "a defect of the outer race",
    "inner_defect": "a defect of the inner race",
    "ball_defect": "a defect of a ball",
    "several_defects": "several defects",
    "first_row": "a damaged row other than the first",
    "rough_floor": "a rough floor",
    "clearance": "clearance",
    "roller": "rollers",
    "outer_ring_turns": "a turning outer ring",
    "waviness": "waviness of the outer race",
    "inner_waviness": "waviness of the inner race",
    "unbalance": "unbalance",
    "gravity": "gravity",
    "slip": "slip drawn per passage",
    "mean_force_slip": "slip as its mean force",
}


@dataclass(frozen=True)
class Rig:
    """Lumped parameters of the six-degree-of-freedom model (thesis, Table 18 and section 4.2.1).

    Attributes:
        m_i, m_o, m_r, m_b: masses of inner ring and shaft, of outer ring and casing, of the fictitious high-frequency
            resonator, and of one rolling element, kg.
        k_i, c_i: stiffness, N/m, and damping, N s/m, of the shaft to ground.
        k_r, c_r: the same between resonator and casing.
        k_c: contact stiffness of one rolling element between both rings, N/m^1.5 of a ball, N/m^(10/9) of a roller
            (Eq. 35).
        alpha_c: mass coefficient of the contact damping, 1/s (Eq. 39).
        beta_c: stiffness coefficient of the contact damping, s (Eq. 39).
        element: the rolling element that ``k_c`` belongs to; a scene refuses a bearing with another.
        calibrated: whether the parameters are those of the machine: true where they were identified on it, or where
            the machine is a simulation with them; "declared" where a person vouches for them.
        identification: hash of the identification that found them, "" for none.
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
    element: Element = "ball"
    calibrated: Calibration = False
    identification: str = ""

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        if self.calibrated not in (False, True, "declared"):
            raise ValueError(f"rig.calibrated must be False, True or 'declared', got {self.calibrated!r}")
        if self.identification and self.calibrated is not True:
            raise ValueError(f"rig.identification belongs to rig.calibrated = True, got {self.calibrated!r}")
        check_numbers(self, "rig.", "positive", "m_i", "m_o", "m_r", "k_i", "k_r", "k_c")
        check_choice(self.element, "rig.element", ("ball", "roller"))
        check_numbers(self, "rig.", "not negative", "m_b", "c_i", "c_r", "alpha_c", "beta_c")

    @property
    def is_default_bench(self) -> bool:
        """Whether masses and springs are those of the default test bench (thesis, Table 18)."""
        return all(getattr(self, name) == getattr(Rig, name) for name in _BENCH)

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values; ``Rig(**values)`` is the same rig."""
        values = asdict(self)
        if not self.identification:
            # As before there were identifications, so that maps and populations keep their hash.
            del values["identification"]
        return values


_BENCH = ("m_i", "m_o", "m_r", "k_i", "k_r")


def natural_frequencies(rig: Rig, k_xx: float, k_yy: float) -> NDArray[np.float64]:
    """Return the six natural frequencies of the undamped linearised rig, Hz, ascending (Eqs. 59 and 60).

    ``k_xx`` and ``k_yy`` are the stiffness of the bearing across and along the load, N/m.
    """
    from models.numerics import generalised_eigenvalues

    mass = np.diag([rig.m_i, rig.m_o, rig.m_r])
    values: list[NDArray[np.float64]] = []
    for k_b in (k_xx, k_yy):
        stiffness = np.array(
            [[k_b + rig.k_i, -k_b, 0.0], [-k_b, k_b + rig.k_r, -rig.k_r], [0.0, -rig.k_r, rig.k_r]], dtype=float
        )
        values.append(generalised_eigenvalues(stiffness, mass))
    return np.sort(np.sqrt(np.maximum(np.concatenate(values), 0.0))) / (2.0 * math.pi)


def resonator_stiffness(rig: Rig, k_b: float, frequency: float) -> float:
    """Return the k_r that gives the rig a natural frequency, N/m (Eq. 62).

    Source: Eqs. 62-65. Eq. 63 as printed misses k_b m_i in its bracket, which is Lambda of Eq. 65.

    Masses and k_i are the rig's; ``k_b`` is the bearing stiffness in the direction of the mode, N/m; frequency in Hz.
    """
    lam = (2.0 * math.pi * frequency) ** 2
    constant = lam**2 * rig.m_i * rig.m_o - lam * (rig.k_i * rig.m_o + k_b * rig.m_i + k_b * rig.m_o) + rig.k_i * k_b
    return lam * rig.m_r * constant / (lam * rig.m_r * (lam * rig.m_i - rig.k_i - k_b) + constant)


def stiffness_damping(zeta: float, frequency: float, stiffness: float) -> float:
    """Return the damping coefficient beta k, N s/m, that gives a damping ratio at a frequency in Hz (Eqs. 75, 76)."""
    return zeta * stiffness / (math.pi * frequency)


def contact_damping(zeta_1: float, zeta_2: float, f_1: float, f_2: float) -> tuple[float, float]:
    """Return alpha_c (1/s) and beta_c (s) that give two damping ratios at two frequencies, Hz (Eqs. 70, 73 and 74).

    Raises:
        ValueError: if the frequencies are not positive and ascending.
    """
    if not 0.0 < f_1 < f_2:
        raise ValueError(f"frequencies must be positive and ascending, got {f_1!r} and {f_2!r} Hz")
    omega_1, omega_2 = 2.0 * math.pi * f_1, 2.0 * math.pi * f_2
    span = omega_2**2 - omega_1**2
    beta_c = 2.0 * (omega_2 * zeta_2 - omega_1 * zeta_1) / span
    alpha_c = 2.0 * omega_1 * omega_2 * (omega_2 * zeta_1 - omega_1 * zeta_2) / span
    return alpha_c, beta_c


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

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_choice(self.kind, "floor.kind", ("smooth", "rough"))
        check_numbers(self, "floor.", "not negative", "sd")
        check_numbers(self, "floor.", "positive", "pitch", *(["cutoff"] if self.cutoff is not None else []))
        check_whole(self.seed, "floor.seed", 0)


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

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        if not 0.0 <= self.dphi_d <= 2.0 * math.pi:
            raise ValueError(f"dphi_d must lie between 0 and 2 pi rad, got {self.dphi_d!r}")
        if not self.h_d >= 0.0:
            raise ValueError(f"h_d must not be negative, got {self.h_d!r} m")
        check_numbers(self, "defect.", "finite", "position")
        check_choice(self.part, "defect.part", PARTS)
        check_whole(self.rows, "defect.rows", 1)
        check_whole(self.first_row, "defect.first_row", 0)

    @property
    def moves_balls(self) -> bool:
        """Whether it has extent and depth."""
        return self.dphi_d > 0.0 and self.h_d > 0.0

    def overlaps(self, other: Defect) -> bool:
        """Whether both damage the same place of the same part of a row."""
        rows = max(self.first_row, other.first_row) < min(self.first_row + self.rows, other.first_row + other.rows)
        if self.part != other.part or not rows or not (self.moves_balls and other.moves_balls):
            return False
        apart = abs(math.remainder(self.position - other.position, 2.0 * math.pi))
        return apart < 0.5 * (self.dphi_d + other.dphi_d)


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
    race: Race = "outer"
    phase: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "waviness.", "finite", "amplitude", "phase")
        check_whole(self.order, "waviness.order", 1)
        check_choice(self.race, "waviness.race", ("outer", "inner"))


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
        """Raise a ValueError that names the field of an unusable value."""
        if not 0.0 <= self.phi_slip < 0.5:
            raise ValueError(f"slip.phi_slip must lie between 0 and 0.5 rad, got {self.phi_slip!r}")
        check_choice(self.rule, "slip.rule", ("per_passage", "mean_force"))
        check_whole(self.seed, "slip.seed", 0)

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
        model: a key of ``models.registry.MODULES``, or "auto": the cheapest that has all effects.
        waviness: roundness errors of the races.
        unbalance: unbalance of the shaft (mass times eccentricity), kg m; at the load direction at time zero.
        gravity: acceleration of gravity that acts on the masses, m/s2.
        gravity_angle: angle of gravity from the direction of the load on the outer ring, rad.
        slip: deviation of balls from their place in the cage (Eq. 82), or None.
        more_defects: further defects, of any part; those of one part of one row lie apart. Where a ball meets two at
            once (one on either race, or its own), their depths add.
    """

    speed: float
    load: float
    bearing: Bearing = field(default_factory=lambda: from_catalogue("1205 ETN9"))
    rig: Rig = field(default_factory=Rig)
    defect: Defect | None = None
    clearance: float = 0.0
    model: str = "auto"
    waviness: tuple[Waviness, ...] = ()
    unbalance: float = 0.0
    gravity: float = 0.0
    gravity_angle: float = 0.0
    slip: Slip | None = None
    more_defects: tuple[Defect, ...] = ()

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "", "positive", "speed")
        check_numbers(self, "", "not negative", "load", "clearance", "unbalance", "gravity")
        check_numbers(self, "", "finite", "gravity_angle")
        if self.rig.element != self.bearing.element:
            raise ValueError(
                f"rig.k_c is that of a {self.rig.element}, {self.bearing.designation} has {self.bearing.element}s"
            )
        self._check_defects()

    def _check_defects(self) -> None:
        if self.defect is None and self.more_defects:
            raise ValueError("more_defects must be empty where defect is None")
        rows = self.bearing.rows
        for number, defect in enumerate(self.defects):
            name = "defect" if number == 0 else f"more_defects[{number - 1}]"
            if defect.first_row + defect.rows > rows:
                raise ValueError(
                    f"{name}.rows {defect.rows!r} from {name}.first_row {defect.first_row!r} on "
                    f"exceed the bearing's {rows}"
                )
            if any(defect.overlaps(other) for other in self.defects[:number]):
                raise ValueError(
                    f"{name}.position must lie apart from the other defects of that part ({defect.part}), "
                    f"got {defect.position!r} rad, where it overlaps one"
                )

    @property
    def defects(self) -> tuple[Defect, ...]:
        """All defects."""
        return () if self.defect is None else (self.defect, *self.more_defects)

    @cached_property
    def healthy(self) -> Scene:
        """The scene without its defects."""
        return self if self.defect is None else replace(self, defect=None, more_defects=())

    @property
    def _damage(self) -> tuple[Defect, ...]:
        return tuple(defect for defect in self.defects if defect.moves_balls)

    @property
    def _slips(self) -> bool:
        return self.slip is not None and self.slip.phi_slip > 0.0 and len(self._damage) > 0

    @property
    def repeats(self) -> bool:
        """Whether nothing but the passages of the balls drives the motion, with which it then repeats."""
        return (
            self.unbalance == 0.0
            and not (self._slips and self.slip is not None and self.slip.redraws)
            and all(wave.race == "outer" or wave.amplitude == 0.0 for wave in self.waviness)
            and all(defect.part == "outer" for defect in self._damage)
        )

    @cached_property
    def effects(self) -> tuple[str, ...]:
        """Names in EFFECTS of what the scene has."""
        damage, parts = self._damage, {defect.part for defect in self._damage}
        races = {wave.race for wave in self.waviness if wave.amplitude != 0.0}
        rule = self.slip.rule if self.slip is not None and self._slips else None
        named = {
            "outer_defect": "outer" in parts,
            "inner_defect": "inner" in parts,
            "ball_defect": "ball" in parts,
            "several_defects": len(damage) > 1,
            "first_row": any(defect.first_row != 0 for defect in damage),
            "rough_floor": any(defect.floor.kind == "rough" and defect.floor.sd > 0.0 for defect in damage),
            "clearance": self.clearance > 0.0,
            "roller": self.bearing.element == "roller",
            "outer_ring_turns": self.bearing.rotating_ring == "outer",
            "waviness": "outer" in races,
            "inner_waviness": "inner" in races,
            "unbalance": self.unbalance != 0.0,
            "gravity": self.gravity != 0.0,
            "slip": rule == "per_passage",
            "mean_force_slip": rule == "mean_force",
        }
        return tuple(name for name in EFFECTS if named[name])
