"""Tables of ``[gear]``: shafts, bearings, couplings, wheels and pairs.

The monitor needs names, teeth and which wheels sit on which shaft; all other keys are those of the model.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from models.gears.teeth.geometry import TipRelief, ToothedWheel
from models.gears.teeth.rack import BasicRack
from monitor.config.fields import Finite, Name, NotNegative, Positive, Section

Directions = Positive | tuple[Positive, Positive]
"""A value of both directions across the shaft, or one of each, x and y."""


class GearShaftSection(Section):
    """A shaft with all that turns with it, as one rigid body of the model."""

    name: Name
    mass_kg: Positive | None = None
    inertia_kg_m2: Positive | None = None
    load_torque_newton_m: Positive | None = None
    beta_c_s: NotNegative | None = None
    speed_damping_newton_m_s: NotNegative = 0.0
    fixed_axis: bool = False
    constant_speed: bool = False


class GearSupportSection(Section):
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


class GearTorsionSection(Section):
    """A coupling or a slender shaft between two bodies that turn alike."""

    shafts: tuple[Name, Name]
    stiffness_newton_m_per_rad: Positive
    beta_c_s: NotNegative | None = None


class GearWheelSection(Section):
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


class GearPairSection(Section):
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
