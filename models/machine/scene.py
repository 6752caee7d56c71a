"""The description of a simulated bearing: rig, defect, floor, slip, operating point.

All quantities are SI and radians. A field that is None or zero switches its effect off, at no cost of arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, TypeVar

from models.machine.bearing import Bearing, from_catalogue
from models.machine.rig import Rig, RigParameters
from models.machine.speed_profile import SpeedProfile, ramp
from models.words.checks import check_choice, check_numbers, check_whole

Part = Literal["outer", "inner", "ball"]
PARTS: tuple[Part, ...] = ("outer", "inner", "ball")
Race = Literal["outer", "inner"]
Support = Literal["a", "b"]
T = TypeVar("T", bound=RigParameters)
# Relative difference at which a speed still lies at the end of the range of a profile.
_SAME_SPEED = 1e-9

# What a model may contain although nothing in a scene shows that it matters; ``Scene.physics`` asks for it.
PHYSICS: dict[str, str] = {
    "casing": "the motion of the casing",
    "ball_inertia": "the inertia of the balls",
    "gyroscopic": "the gyroscopic moment of the rotor",
    "elastic_shaft": "an elastic shaft",
    "ring_modes": "the bending of the rings",
    "centrifugal": "the centrifugal force of the balls",
    "torsion": "the torsion of the shaft",
}

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
    "defect_width": "a defect that does not take the whole width of the groove",
    "second_bearing": "a bearing at the other support",
    "axial_load": "an axial load",
    "couple_unbalance": "a couple unbalance",
    "bow": "a bowed shaft",
    "rotating_load": "a load that turns with the shaft",
    "changing_speed": "a speed that changes",
    **{f"with_{name}": words for name, words in PHYSICS.items()},
}


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
        width: extent across the groove, about the centre of its profile, rad; None for the whole groove.
        support: the bearing that has it: "a", or "b", the one at the other support.
    """

    dphi_d: float
    h_d: float
    floor: Floor = field(default_factory=Floor)
    position: float = 0.0
    rows: int = 1
    part: Part = "outer"
    first_row: int = 0
    width: float | None = None
    support: Support = "a"

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
        if self.width is not None and not 0.0 < self.width <= math.pi:
            raise ValueError(f"defect.width must lie between 0 and pi rad, got {self.width!r}")
        check_choice(self.support, "defect.support", ("a", "b"))

    @property
    def moves_balls(self) -> bool:
        """Whether it has extent and depth."""
        return self.dphi_d > 0.0 and self.h_d > 0.0

    def overlaps(self, other: Defect) -> bool:
        """Whether both damage the same place of the same part of a row."""
        rows = max(self.first_row, other.first_row) < min(self.first_row + self.rows, other.first_row + other.rows)
        same = (self.support, self.part) == (other.support, other.part) and rows
        if not (same and self.moves_balls and other.moves_balls):
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
        model: a key of ``models.solve.registry.MODELS``, or "auto": the cheapest that has all effects.
        waviness: roundness errors of the races.
        unbalance: unbalance of the shaft (mass times eccentricity), kg m; at the load direction at time zero.
        gravity: acceleration of gravity that acts on the masses, m/s2.
        gravity_angle: angle of gravity from the direction of the load on the outer ring, rad.
        slip: deviation of balls from their place in the cage (Eq. 82), or None.
        more_defects: further defects, of any part; those of one part of one row lie apart. Where a ball meets two at
            once (one on either race, or its own), their depths add.
        second_bearing: the bearing at the other support, or None where one bearing is all that is described.
        axial_load: force along the shaft, N, signed; positive towards the support A.
        couple_unbalance: of the rotor, the angle of its principal axis times the difference of its moments of inertia,
            kg m2.
        bow: deflection of the shaft at rest, which turns with it, m.
        load_turns: whether the load turns with the shaft.
        speed_slope: change of the speed, Hz/s, from ``speed`` at the first sample of a response.
        speed_profile: how the shaft turns, from the first sample of a response on; before, it turns at the first speed
            of the profile. ``speed`` then is the one that lines and conditions are named by, mostly the mean.
        physics: names in PHYSICS of what the answer must contain.
    """

    speed: float
    load: float
    bearing: Bearing = field(default_factory=lambda: from_catalogue("1205 ETN9"))
    rig: RigParameters = field(default_factory=Rig)
    defect: Defect | None = None
    clearance: float = 0.0
    model: str = "auto"
    waviness: tuple[Waviness, ...] = ()
    unbalance: float = 0.0
    gravity: float = 0.0
    gravity_angle: float = 0.0
    slip: Slip | None = None
    more_defects: tuple[Defect, ...] = ()
    second_bearing: Bearing | None = None
    axial_load: float = 0.0
    couple_unbalance: float = 0.0
    bow: float = 0.0
    load_turns: bool = False
    speed_slope: float = 0.0
    physics: tuple[str, ...] = ()
    speed_profile: SpeedProfile | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        check_numbers(self, "", "positive", "speed")
        check_numbers(self, "", "not negative", "load", "clearance", "unbalance", "gravity", "couple_unbalance", "bow")
        check_numbers(self, "", "finite", "gravity_angle", "axial_load", "speed_slope")
        for name in self.physics:
            check_choice(name, "physics", tuple(PHYSICS))
        self.rig.check_bearing(self.bearing)
        self._check_defects()
        self._check_profile()

    def _check_profile(self) -> None:
        if self.speed_profile is None:
            return
        if self.speed_slope != 0.0:
            raise ValueError(f"speed_slope must be 0 where there is a speed_profile, got {self.speed_slope!r} Hz/s")
        low, high = self.speed_profile.speed_range
        if not low * (1.0 - _SAME_SPEED) <= self.speed <= high * (1.0 + _SAME_SPEED):
            raise ValueError(f"speed must lie within the speed_profile, {low!r} to {high!r} Hz, got {self.speed!r} Hz")

    def _check_defects(self) -> None:
        if self.defect is None and self.more_defects:
            raise ValueError("more_defects must be empty where defect is None")
        for number, defect in enumerate(self.defects):
            name = "defect" if number == 0 else f"more_defects[{number - 1}]"
            bearing = self.bearing if defect.support == "a" else self.second_bearing
            if bearing is None:
                raise ValueError(f"{name}.support is 'b', but there is no second_bearing")
            if defect.first_row + defect.rows > bearing.rows:
                raise ValueError(
                    f"{name}.rows {defect.rows!r} from {name}.first_row {defect.first_row!r} on "
                    f"exceed the bearing's {bearing.rows}"
                )
            if any(defect.overlaps(other) for other in self.defects[:number]):
                raise ValueError(
                    f"{name}.position must lie apart from the other defects of that part ({defect.part}), "
                    f"got {defect.position!r} rad, where it overlaps one"
                )

    def rig_as(self, kind: type[T]) -> T:
        """Return the parameters of the machine, of the type that a model takes.

        Raises:
            ValueError: if they are those of another model.
        """
        if not isinstance(self.rig, kind):
            raise ValueError(
                f"rig: {kind.model} takes the parameters of {kind.__name__}, "
                f"got {type(self.rig).__name__}, those of {self.rig.model}"
            )
        return self.rig

    @property
    def defects(self) -> tuple[Defect, ...]:
        """All defects."""
        return () if self.defect is None else (self.defect, *self.more_defects)

    @property
    def first_part(self) -> Part:
        """The part of the first defect, whose passages lines are counted by; the outer race where there is none."""
        return "outer" if self.defect is None else self.defect.part

    @cached_property
    def healthy(self) -> Scene:
        """The scene without its defects."""
        return self if self.defect is None else replace(self, defect=None, more_defects=())

    def rotation(self, seconds: float) -> SpeedProfile | None:
        """Return how the shaft turns from the first sample of a response on, None where its speed is one.

        Raises:
            ValueError: if the slope stops the shaft within that time, s.
        """
        if self.speed_slope == 0.0:
            return self.speed_profile
        end = self.speed + self.speed_slope * seconds
        if not end > 0.0:
            raise ValueError(
                f"speed_slope {self.speed_slope!r} Hz/s stops the shaft within the {seconds:.3g} s that are simulated"
            )
        return ramp(self.speed, end, seconds)

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
            self.unbalance == self.couple_unbalance == self.bow == self.speed_slope == 0.0
            and self.speed_profile is None
            and not self.load_turns
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
            "defect_width": any(defect.width is not None for defect in damage),
            "second_bearing": self.second_bearing is not None,
            "axial_load": self.axial_load != 0.0,
            "couple_unbalance": self.couple_unbalance != 0.0,
            "bow": self.bow != 0.0,
            "rotating_load": self.load_turns,
            "changing_speed": self.speed_slope != 0.0 or self.speed_profile is not None,
            **{f"with_{name}": name in self.physics for name in PHYSICS},
        }
        return tuple(name for name in EFFECTS if named[name])
