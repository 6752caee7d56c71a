"""``[shaft]``: the shaft and rotor of a machine, as parameters of the models that have one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from models.machine.rig import RigParameters
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.rotor.rig import RotorRig
from monitor.config.fields import ConfigSection, Name, NotNegative, Positive

UNITS = {
    "_mm": 1e-3,
    "_um": 1e-6,
    "_gpa": 1e9,
    "_g_mm": 1e-6,
    "_kg_m2": 1.0,
    "_kg": 1.0,
    "_s": 1.0,
    "_newton_s_per_m": 1.0,
    "_newton_m_s": 1.0,
    "_newton_m": 1.0,
    "_newton_m_per_rad": 1.0,
    "_kg_per_m3": 1.0,
}
"""SI value of the units at the end of a key; the longest that fits counts, and without one a key has none."""

RIG_KEYS: Mapping[str, Mapping[str, str]] = {
    RotorRig.model: {
        "m": "disc_mass_kg",
        "j_p": "disc_polar_inertia_kg_m2",
        "j_t": "disc_transverse_inertia_kg_m2",
        "length": "length_mm",
        "a": "disc_from_a_mm",
        "shaft_diameter": "outer_diameter_mm",
        "modulus": "modulus_gpa",
        "end_mass": "end_mass_kg",
        "c_b": "contact_damping_newton_s_per_m",
        "c_n": "damping_newton_s_per_m",
        "c_t": "tilt_damping_newton_m_s",
        "internal_damping": "internal_damping_s",
    },
    AngularRig.model: {
        "length": "length_mm",
        "outer_diameter": "outer_diameter_mm",
        "inner_diameter": "inner_diameter_mm",
        "elements": "elements",
        "modulus": "modulus_gpa",
        "poisson": "poisson",
        "density": "density_kg_per_m3",
        "disc_mass": "disc_mass_kg",
        "disc_polar": "disc_polar_inertia_kg_m2",
        "disc_across": "disc_transverse_inertia_kg_m2",
        "coupling": "coupling_newton_m_per_rad",
        "end_inertia": "coupling_inertia_kg_m2",
        "load_torque": "load_torque_newton_m",
        "damping": "damping_ratio",
    },
    BallInertiaRig.model: {"m_rotor": "disc_mass_kg"},
}
"""By model, the key of each parameter that ``[shaft]`` gives."""

SCENE_KEYS = {"unbalance": "unbalance_g_mm", "couple_unbalance": "couple_unbalance_kg_m2", "bow": "bow_um"}
"""Keys of what a scene has of the shaft, by field of ``models.machine.scene.Scene``."""


class ShaftSection(ConfigSection):
    """Shaft and rotor between the bearings A and B; what is not given is that of the model.

    ``second_bearing`` is the name of the bearing at B; without it, B has that of A. ``calibrated = "declared"`` vouches
    for these numbers as those of the machine, as that of ``[rig]`` does for the model of the casing. A model of the
    shaft over its angle has the disc in the middle, whatever ``disc_from_a_mm`` says.
    """

    length_mm: Positive | None = None
    outer_diameter_mm: Positive | None = None
    inner_diameter_mm: NotNegative = 0.0
    elements: Annotated[int, Field(ge=2, le=64, multiple_of=2)] | None = None
    modulus_gpa: Positive | None = None
    poisson: Annotated[float, Field(ge=0, le=0.5)] | None = None
    density_kg_per_m3: Positive | None = None
    disc_mass_kg: Positive | None = None
    disc_polar_inertia_kg_m2: Positive | None = None
    disc_transverse_inertia_kg_m2: Positive | None = None
    disc_from_a_mm: Positive | None = None
    end_mass_kg: NotNegative | None = None
    contact_damping_newton_s_per_m: NotNegative | None = None
    damping_newton_s_per_m: NotNegative | None = None
    tilt_damping_newton_m_s: NotNegative | None = None
    internal_damping_s: NotNegative | None = None
    coupling_newton_m_per_rad: Positive | None = None
    coupling_inertia_kg_m2: Positive | None = None
    load_torque_newton_m: NotNegative | None = None
    damping_ratio: Annotated[float, Field(gt=0, lt=1)] | None = None
    unbalance_g_mm: NotNegative = 0.0
    couple_unbalance_kg_m2: NotNegative = 0.0
    bow_um: NotNegative = 0.0
    second_bearing: Name | None = None
    calibrated: Literal[False, "declared"] = False

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        place, length = self.disc_from_a_mm, self.length_mm
        if place is not None and length is None:
            raise ValueError("disc_from_a_mm needs length_mm, the distance of the bearings")
        if place is not None and length is not None and place >= length:
            raise ValueError(f"disc_from_a_mm must be less than length_mm, {length:g}, got {place:g}")
        if self.inner_diameter_mm > 0.0 and self.outer_diameter_mm is None:
            raise ValueError("inner_diameter_mm needs outer_diameter_mm")
        if self.outer_diameter_mm is not None and self.inner_diameter_mm >= self.outer_diameter_mm:
            raise ValueError(
                f"inner_diameter_mm must be less than outer_diameter_mm, {self.outer_diameter_mm:g}, "
                f"got {self.inner_diameter_mm:g}"
            )
        return self

    def parameters_of(self, kind: type[RigParameters]) -> dict[str, Any]:
        """Return the parameters, SI, that the section gives a model, without those that it leaves to it."""
        given = {name: self._si(key) for name, key in RIG_KEYS.get(kind.model, {}).items()}
        values: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        if "outer_diameter" not in values:
            values.pop("inner_diameter", None)
        if kind is RotorRig and "length" in values:
            values.setdefault("a", 0.5 * values["length"])
        if kind is RotorRig and "shaft_diameter" in values:
            # The full shaft of the same second moment: only bending matters there.
            inner = self.inner_diameter_mm * UNITS["_mm"]
            values["shaft_diameter"] = (values["shaft_diameter"] ** 4 - inner**4) ** 0.25
        if kind.model in RIG_KEYS:
            values["calibrated"] = self.calibrated
        return values

    def scene_values(self) -> dict[str, float]:
        """Return what the shaft adds to a scene, SI, by field of ``Scene``; zeros are left out."""
        found = {name: self._si(key) for name, key in SCENE_KEYS.items()}
        return {name: value for name, value in found.items() if value}

    def used_by(self) -> Iterator[tuple[str, list[str]]]:
        """Yield each model that takes parameters of the section with the keys that it takes, of those given."""
        given = self.model_fields_set
        for model, keys in RIG_KEYS.items():
            own = {*keys.values(), *(["inner_diameter_mm"] if "outer_diameter_mm" in keys.values() else [])}
            taken = [key for key in type(self).model_fields if key in given and key in own]
            if taken:
                yield model, taken

    def _si(self, key: str) -> float | None:
        value: float | None = getattr(self, key)
        unit = max((unit for unit in UNITS if key.endswith(unit)), key=len, default=None)
        return value if value is None or unit is None else value * UNITS[unit]
