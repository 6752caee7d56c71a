"""Geometry of a pair of external involute gears: line of action, contact ratios, and what cannot be made or mesh.

Lengths along the line of action are counted in the transverse section from T1, where it touches the driver's base
circle, to T2; the driver's roll angle there is the length over its base radius. Names as in ISO 21771.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.gears.teeth.rack import BasicRack, ToothProfile, involute
from models.words.checks import check_choice, check_numbers, check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

# Teeth may be pointed to this thickness over the module.
MIN_TIP_THICKNESS = 0.02
_INVERSE_STEPS = 60
# Whether a length stays within a limit is decided to this share of the module.
_CLOSE = 1e-9


@dataclass(frozen=True)
class TipRelief:
    """Material taken from the flank towards the tip.

    Attributes:
        amount: at the tip, m, along the line of action.
        length: of the relieved part along the line of action, m.
        shape: "linear", or "parabolic" with no kink where it begins.
    """

    amount: float
    length: float
    shape: Literal["linear", "parabolic"] = "linear"

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        check_numbers(self, "tip relief ", "not negative", "amount")
        check_numbers(self, "tip relief ", "positive", "length")
        check_choice(self.shape, "tip relief shape", ("linear", "parabolic"))

    def removed(self, below_tip: Array) -> Array:
        """Return the material removed, m, at lengths along the line of action below the tip, m."""
        share = np.clip(1.0 - below_tip / self.length, 0.0, 1.0)
        return self.amount * (share if self.shape == "linear" else share**2)


@dataclass(frozen=True)
class ToothedWheel:
    """One wheel of a pair.

    Attributes:
        teeth: z.
        face_width: b, m.
        hub_radius: at which the body is held: the bore's or the shaft's radius, m.
        profile_shift: x, factor of the normal module.
        truncation: shortening of the tip, m.
        tip_relief: of both flanks, or None.
        modulus, poisson: Young's modulus, Pa, and Poisson's ratio.
    """

    teeth: int
    face_width: float
    hub_radius: float
    profile_shift: float = 0.0
    truncation: float = 0.0
    tip_relief: TipRelief | None = None
    modulus: float = 206e9
    poisson: float = 0.3

    def __post_init__(self) -> None:
        """Raise a ValueError that names a field which cannot be."""
        check_whole(self.teeth, "teeth", 5)
        check_numbers(self, "", "positive", "face_width", "hub_radius", "modulus")
        check_numbers(self, "", "finite", "profile_shift", "truncation")
        check_numbers(self, "", "not negative", "poisson")
        if self.poisson >= 0.5:
            raise ValueError(f"poisson must be below 0.5, got {self.poisson!r}")


@dataclass(frozen=True)
class GearPair:
    """Two external gears in mesh, of which the first drives.

    Attributes:
        driver, driven: the wheels.
        module: normal module m_n, m.
        pressure_angle, helix_angle: normal pressure angle and helix angle at the reference circle, rad.
        centre_distance: m; None for that without backlash.
        rack: basic rack of both wheels.
    """

    driver: ToothedWheel
    driven: ToothedWheel
    module: float
    pressure_angle: float = math.radians(20.0)
    helix_angle: float = 0.0
    centre_distance: float | None = None
    rack: BasicRack = field(default_factory=BasicRack)

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field which makes the pair impossible."""
        check_numbers(self, "", "positive", "module", "pressure_angle")
        check_numbers(self, "", "not negative", "helix_angle")
        if self.pressure_angle >= math.radians(45.0):
            raise ValueError(f"pressure_angle must be below 45 deg, got {math.degrees(self.pressure_angle):.4g} deg")
        if self.helix_angle >= math.radians(60.0):
            raise ValueError(f"helix_angle must be below 60 deg, got {math.degrees(self.helix_angle):.4g} deg")
        if self.centre_distance is not None:
            check_numbers(self, "", "positive", "centre_distance")
        self.rack.check_fillet(self.pressure_angle)
        for name, wheel, profile in self._sides:
            _check_wheel(name, wheel, profile)
        self._check_distance()
        self._check_mesh()

    @cached_property
    def profiles(self) -> tuple[ToothProfile, ToothProfile]:
        """Profiles of the driver's and of the driven wheel's teeth."""
        driver, driven = (
            ToothProfile(
                wheel.teeth,
                self.module,
                self.pressure_angle,
                self.helix_angle,
                wheel.profile_shift,
                self.rack,
                wheel.truncation,
            )
            for wheel in (self.driver, self.driven)
        )
        return driver, driven

    @property
    def wheels(self) -> tuple[ToothedWheel, ToothedWheel]:
        """Driver and driven wheel."""
        return self.driver, self.driven

    @property
    def _sides(self) -> tuple[tuple[str, ToothedWheel, ToothProfile], ...]:
        return tuple(zip(("driver", "driven"), self.wheels, self.profiles, strict=True))

    @property
    def face_width(self) -> float:
        """Common face width, m: the smaller one."""
        return min(self.driver.face_width, self.driven.face_width)

    @property
    def base_radii(self) -> tuple[float, float]:
        """Base radii r_b1 and r_b2, m."""
        return self.profiles[0].base_radius, self.profiles[1].base_radius

    @property
    def base_pitch(self) -> float:
        """Transverse base pitch p_bt, m."""
        return math.tau * self.base_radii[0] / self.driver.teeth

    @property
    def base_helix_angle(self) -> float:
        """Helix angle at the base circle, rad."""
        return math.asin(math.sin(self.helix_angle) * math.cos(self.pressure_angle))

    @cached_property
    def free_distance(self) -> float:
        """Centre distance without backlash, m."""
        shifts, teeth = self.driver.profile_shift + self.driven.profile_shift, self.driver.teeth + self.driven.teeth
        inverse = float(involute(self.profiles[0].transverse_angle))
        inverse += 2.0 * shifts * math.tan(self.pressure_angle) / teeth
        if inverse <= 0.0:
            raise ValueError(f"profile_shift: the sum {shifts:.4g} leaves no centre distance for {teeth} teeth in all")
        return sum(self.base_radii) / math.cos(inverse_involute(inverse))

    @property
    def distance(self) -> float:
        """Working centre distance a, m."""
        return self.free_distance if self.centre_distance is None else self.centre_distance

    @property
    def working_angle(self) -> float:
        """Transverse working pressure angle alpha_wt, rad."""
        return math.acos(sum(self.base_radii) / self.distance)

    @property
    def backlash(self) -> float:
        """Backlash along the line of action in the transverse section, m: what the centre distance leaves."""
        opened = float(involute(self.working_angle)) - float(
            involute(math.acos(sum(self.base_radii) / self.free_distance))
        )
        return 2.0 * sum(self.base_radii) * opened

    @property
    def tangent_length(self) -> float:
        """Length T1 T2 of the line of action between the base circles, m."""
        return self.distance * math.sin(self.working_angle)

    @cached_property
    def contact_path(self) -> tuple[float, float]:
        """Begin A and end E of contact on the line of action, m from T1."""
        first, second = (math.sqrt(profile.tip_radius**2 - profile.base_radius**2) for profile in self.profiles)
        return self.tangent_length - second, first

    @property
    def transverse_contact_ratio(self) -> float:
        """Transverse contact ratio eps_alpha."""
        begin, end = self.contact_path
        return (end - begin) / self.base_pitch

    @property
    def overlap_ratio(self) -> float:
        """Overlap ratio eps_beta."""
        return self.face_width * math.sin(self.helix_angle) / (math.pi * self.module)

    @property
    def contact_ratio(self) -> float:
        """Total contact ratio eps_gamma."""
        return self.transverse_contact_ratio + self.overlap_ratio

    @property
    def valid_foundation(self) -> tuple[bool, bool]:
        """Whether Sainsot's fits of the body's deflection cover the driver and the driven wheel."""
        covered = (
            1.4 <= p.root_radius / w.hub_radius <= 7.0 and 0.01 <= p.root_half_angle <= 0.12 for _, w, p in self._sides
        )
        first, second = covered
        return first, second

    def stations(self, samples: int) -> Array:
        """Return phases of a pitch at which the mesh is computed, shape (samples,): 0, 1 / samples ..."""
        check_whole(samples, "samples", 4)
        return np.arange(samples) / samples

    def _check_distance(self) -> None:
        least, distance = self.free_distance, self.distance
        if distance < least * (1.0 - 1e-12):
            raise ValueError(
                f"centre_distance must be at least {1e3 * least:.6g} mm, where these teeth have no backlash, "
                f"got {1e3 * distance:.6g} mm"
            )

    def _check_mesh(self) -> None:
        begin, end = self.contact_path
        lowest = (begin, self.tangent_length - end)
        for (name, _, profile), (other, mate, mating), low in zip(
            self._sides, reversed(self._sides), lowest, strict=True
        ):
            clearance = self.distance - mating.tip_radius - profile.root_radius
            if clearance < -_CLOSE * self.module:
                raise ValueError(
                    f"{other} truncation must leave the tip clear of the {name}'s root: they overlap by "
                    f"{-1e3 * clearance:.4g} mm, truncation is {1e3 * mate.truncation:.4g} mm"
                )
            formed = math.sqrt(profile.form_radius**2 - profile.base_radius**2)
            if low < formed - _CLOSE * self.module:
                raise ValueError(
                    f"{name} profile_shift or {other} truncation: interference, the mating tip reaches "
                    f"{1e3 * (formed - low):.4g} mm below the begin of the {name}'s involute"
                )
        if self.contact_ratio < 1.0:
            raise ValueError(
                f"centre_distance and truncation leave a contact ratio of {self.contact_ratio:.4g}; expected 1 at least"
            )


def inverse_involute(value: float) -> float:
    """Return the angle, rad, whose involute is a positive value, by Newton's method from above."""
    # The first angle is above the root, and the involute is convex: each step stays above.
    angle = math.atan(value + math.pi / 2.0)
    for _ in range(_INVERSE_STEPS):
        tangent = math.tan(angle)
        step = (tangent - angle - value) / tangent**2
        angle -= step
        if abs(step) <= 1e-15 * angle:
            break
    return angle


def _check_wheel(name: str, wheel: ToothedWheel, profile: ToothProfile) -> None:
    if profile.undercut_margin < -_CLOSE * profile.module:
        least = wheel.profile_shift - profile.undercut_margin / profile.module
        raise ValueError(
            f"{name} profile_shift must be at least {least:.4g} for {wheel.teeth} teeth, which would be undercut, "
            f"got {wheel.profile_shift!r}"
        )
    if wheel.hub_radius >= profile.root_radius:
        raise ValueError(
            f"{name} hub_radius must be below the root radius, {1e3 * profile.root_radius:.4g} mm, "
            f"got {1e3 * wheel.hub_radius:.4g} mm"
        )
    if profile.tip_radius <= profile.form_radius:
        raise ValueError(f"{name} truncation must leave some involute, got {1e3 * wheel.truncation:.4g} mm")
    thickness = 2.0 * profile.tip_radius * float(profile.half_angle(profile.tip_radius))
    if thickness < MIN_TIP_THICKNESS * profile.module:
        raise ValueError(
            f"{name} profile_shift must leave a tip of {MIN_TIP_THICKNESS} modules, got {wheel.profile_shift!r}, "
            f"with which it is {thickness / profile.module:.3g}"
        )
