"""Tables of ``[gear]``: shafts, bearings, couplings, wheels and pairs.

The monitor needs names, teeth and which wheels sit on which shaft; all other keys are those of the model.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from models.gears.teeth.faults import Eccentricity, GearFault, PitchError, Pitting, ProfileError, ToothCrack, ToothSpall
from models.gears.teeth.geometry import TipRelief, ToothedWheel
from models.gears.teeth.rack import BasicRack
from monitor.config.fields import ConfigSection, Finite, Name, NotNegative, Positive

Directions = Positive | tuple[Positive, Positive]
"""A value of both directions across the shaft, or one of each, x and y."""


class GearShaftSection(ConfigSection):
    """A shaft with all that turns with it, as one rigid body of the model."""

    name: Name
    mass_kg: Positive | None = None
    inertia_kg_m2: Positive | None = None
    load_torque_newton_m: Positive | None = None
    beta_c_s: NotNegative | None = None
    speed_damping_newton_m_s: NotNegative = 0.0
    fixed_axis: bool = False
    constant_speed: bool = False


class GearSupportSection(ConfigSection):
    """A bearing of a shaft, between it and the casing."""

    name: Name
    shaft: Name
    stiffness_newton_per_m: Directions | None = None
    bearing: str | None = None
    clearance_um: NotNegative | None = None

    @model_validator(mode="after")
    def _one_stiffness(self) -> Self:
        if (self.stiffness_newton_per_m is None) == (self.bearing is None):
            raise ValueError("give stiffness_newton_per_m, or bearing, whose stiffness at the mean force is computed")
        if self.clearance_um is not None and self.bearing is None:
            raise ValueError("clearance_um belongs to bearing")
        return self

    @property
    def matrix(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Stiffness of the directions x and y, N/m; None where it is that of a bearing."""
        given = self.stiffness_newton_per_m
        if given is None:
            return None
        x, y = given if isinstance(given, tuple) else (given, given)
        return ((x, 0.0), (0.0, y))


class GearTorsionSection(ConfigSection):
    """A coupling or a slender shaft between two bodies that turn alike."""

    shafts: tuple[Name, Name]
    stiffness_newton_m_per_rad: Positive
    beta_c_s: NotNegative | None = None


class GearWheelSection(ConfigSection):
    """A wheel; without ``shaft`` it has one of its own, of the same name."""

    name: Name
    teeth: Annotated[int, Field(ge=4, le=2000)]
    shaft: Name | None = None
    face_width_mm: Positive | None = None
    bore_mm: Positive | None = None
    profile_shift: Annotated[float, Field(ge=-3, le=3)] = 0.0
    tip_truncation_mm: NotNegative = 0.0
    tip_relief_um: NotNegative = 0.0
    tip_relief_length_mm: Positive | None = None
    tip_relief_shape: Literal["linear", "parabolic"] = TipRelief.shape
    modulus_gpa: Positive = 206.0
    poisson: Annotated[float, Field(ge=0, lt=0.5)] = ToothedWheel.poisson

    @model_validator(mode="after")
    def _relieved(self) -> Self:
        if self.tip_relief_um and self.tip_relief_length_mm is None:
            raise ValueError("tip_relief_um needs tip_relief_length_mm, along the line of action")
        return self

    @property
    def on(self) -> str:
        """Name of its shaft."""
        return self.shaft or self.name


class GearPairSection(ConfigSection):
    """Two wheels in mesh: the driver, then the driven one."""

    wheels: tuple[Name, Name]
    module_mm: Positive | None = None
    pressure_angle_deg: Annotated[float, Field(ge=10, le=35)] = 20.0
    helix_angle_deg: Annotated[float, Field(ge=0, lt=60)] = 0.0
    addendum: Positive = BasicRack.addendum
    dedendum: Positive = BasicRack.dedendum
    fillet_radius: NotNegative = BasicRack.fillet_radius
    centre_distance_mm: Positive | None = None
    direction_deg: Finite = 0.0
    phase_pitches: Finite | None = None
    backlash_um: NotNegative | None = None
    contact_ratio: Annotated[float, Field(ge=1, le=10)] | None = None
    stiffness_newton_per_m: Positive | None = None
    stiffness_variation: Annotated[float, Field(ge=0, lt=2)] | None = None
    stiffness_csv: Path | None = None
    beta_c_s: NotNegative | None = None

    @property
    def words(self) -> str:
        """The wheels, for people."""
        return " and ".join(map(repr, self.wheels))

    @model_validator(mode="after")
    def _one_course(self) -> Self:
        if self.stiffness_variation is not None:
            if self.stiffness_csv is not None:
                raise ValueError("stiffness_variation and stiffness_csv both give the course over a pitch; give one")
            if self.stiffness_newton_per_m is None or self.contact_ratio is None:
                raise ValueError(
                    "stiffness_variation is a share of stiffness_newton_per_m over contact_ratio; give both"
                )
        return self


_MM, _UM = 1e-3, 1e-6
Kind = Literal["crack", "spall", "pitting", "pitch", "eccentricity", "profile"]
_KEYS: dict[str, tuple[set[str], set[str]]] = {
    "crack": ({"depth_mm"}, {"tooth", "angle_deg", "extent_mm"}),
    "spall": ({"depth_mm", "length_mm", "width_mm"}, {"tooth"}),
    "pitting": ({"share", "length_mm"}, {"tooth"}),
    "pitch": ({"error_um"}, {"tooth", "seed"}),
    "eccentricity": ({"error_um"}, {"phase_deg"}),
    "profile": (set(), {"tooth", "slope_um", "crown_um", "waviness_um", "waves"}),
}
"""Keys that each kind needs and may have."""


class GearFaultSection(ConfigSection):
    """A fault of a wheel. Teeth count from 0.

    ``error_um`` is the amount of an eccentricity, how far a tooth stands back, or with ``seed`` and without ``tooth``
    the standard deviation of the pitches of all teeth.
    """

    wheel: Name
    kind: Kind
    tooth: Annotated[int, Field(ge=0)] | None = None
    depth_mm: Positive | None = None
    angle_deg: Annotated[float, Field(gt=0, le=90)] | None = None
    extent_mm: Positive | None = None
    length_mm: Positive | None = None
    width_mm: Positive | None = None
    share: Annotated[float, Field(gt=0, lt=1)] | None = None
    error_um: Finite | None = None
    phase_deg: Finite | None = None
    seed: Annotated[int, Field(ge=0)] | None = None
    slope_um: Finite | None = None
    crown_um: Finite | None = None
    waviness_um: NotNegative | None = None
    waves: Positive | None = None

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        needed, allowed = _KEYS[self.kind]
        given = {name for name in type(self).model_fields if getattr(self, name) is not None} - {"wheel", "kind"}
        if wrong := sorted(given - needed - allowed):
            expected = ", ".join(sorted(needed | allowed))
            raise ValueError(f"{wrong[0]} is no key of kind = {self.kind!r}; expected {expected}")
        if missing := sorted(needed - given):
            raise ValueError(f"kind = {self.kind!r} needs {', '.join(missing)}")
        if self.kind == "profile" and not given - {"tooth", "waves"}:
            raise ValueError("kind = 'profile' needs slope_um, crown_um or waviness_um")
        if self.kind == "pitch" and (self.tooth is None) == (self.seed is None):
            raise ValueError("kind = 'pitch' needs tooth, or seed for errors of all teeth, not both")
        if self.kind == "eccentricity" and (self.error_um or 0.0) < 0.0:
            raise ValueError("error_um of an eccentricity must not be negative")
        return self

    @property
    def shapes_teeth(self) -> bool:
        """Whether the teeth must be known; an eccentricity displaces them all alike."""
        return self.kind != "eccentricity"

    def to_fault(self, teeth: int) -> GearFault:
        """Return the fault of a wheel with so many teeth, SI.

        Raises:
            ValueError: the wheel has no such tooth.
        """
        tooth = self.tooth or 0
        depth, length, width = (_MM * (value or 0.0) for value in (self.depth_mm, self.length_mm, self.width_mm))
        error = _UM * (self.error_um or 0.0)
        if tooth >= teeth:
            raise ValueError(f"tooth must be from 0 to {teeth - 1}, got {tooth}")
        if self.kind == "crack":
            angle = ToothCrack.angle if self.angle_deg is None else math.radians(self.angle_deg)
            return ToothCrack(tooth, depth, angle, None if self.extent_mm is None else _MM * self.extent_mm)
        if self.kind == "spall":
            return ToothSpall(tooth, length, width, depth)
        if self.kind == "pitting":
            return Pitting(tooth, self.share or 0.0, length)
        if self.kind == "pitch":
            if self.seed is not None:
                return PitchError.drawn(teeth, abs(error), self.seed)
            return PitchError.of_tooth(teeth, tooth, error)
        if self.kind == "eccentricity":
            return Eccentricity(error, math.radians(self.phase_deg or 0.0))
        return ProfileError(
            slope=_UM * (self.slope_um or 0.0),
            crown=_UM * (self.crown_um or 0.0),
            waviness=_UM * (self.waviness_um or 0.0),
            waves=ProfileError.waves if self.waves is None else self.waves,
            tooth=self.tooth,
        )

    @property
    def words(self) -> str:
        """The fault, for people."""
        where = "" if self.tooth is None else f" of tooth {self.tooth}"
        keys = (*sorted(_KEYS[self.kind][0]), "slope_um", "crown_um", "waviness_um")
        sizes: list[str] = []
        for key in keys:
            value: float | None = getattr(self, key)
            name, _, unit = key.rpartition("_")
            if value is not None:
                sizes.append(f"{name or unit} {value:g}" + (f" {unit.replace('um', 'µm')}" if name else ""))
        return f"{self.kind}{where} of wheel {self.wheel}, {', '.join(sizes)}"
