"""``[[gear.fault]]``: a fault of a wheel that the model is to have."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from models.gears.teeth.faults import Eccentricity, GearFault, PitchError, Pitting, ProfileError, ToothCrack, ToothSpall
from monitor.config.fields import Finite, Name, NotNegative, Positive, Section

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


class GearFaultSection(Section):
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
