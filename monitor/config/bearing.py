"""``[[bearing]]`` and ``[rig]``: geometry of the bearings, lumped parameters of the model."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, StrictBool, field_validator, model_validator

from models.machine.bearing import Bearing, CatalogueEntry, catalogue_entry
from models.machine.catalogue.series import GeometryOrigin
from models.machine.contact_estimates import element_mass, estimate_stiffness
from models.machine.rig import Calibration, Rig
from monitor.config.fields import ConfigSection, Name, NotNegative, Positive

RIG_KEYS = {
    "m_i": "m_i_kg",
    "m_o": "m_o_kg",
    "m_r": "m_r_kg",
    "m_b": "m_b_kg",
    "k_i": "k_i_newton_per_m",
    "k_r": "k_r_newton_per_m",
    "c_i": "c_i_newton_s_per_m",
    "c_r": "c_r_newton_s_per_m",
    "alpha_c": "alpha_c_per_s",
    "beta_c": "beta_c_s",
}
"""Keys of the parameters of the model, but of the contact stiffness k_c, which has one for each kind of element."""
STIFFNESS_KEYS = {"ball": "k_c_newton_per_m15", "roller": "k_c_newton_per_m109"}
"""Keys of the contact stiffness of one element."""

_IDENTIFICATION = r"^(sha256:)?[0-9a-f]{16,64}(-[0-9a-f]{8})?$"
_NO_DIMENSIONS = ("element", "rows", "rotating_ring")
_REQUIRED = ("n_elements", "element_diameter_mm", "pitch_diameter_mm")
RING_KEYS = ("bore_mm", "outside_mm", "width_mm")
"""Keys of the rings' dimensions, which finite elements alone need: no record depends on them."""


class BearingSection(ConfigSection):
    """A bearing, from the catalogue or by its geometry."""

    name: Name
    designation: str | None = None
    n_elements: Annotated[int, Field(ge=3, le=200)] | None = None
    element_diameter_mm: Positive | None = None
    pitch_diameter_mm: Positive | None = None
    contact_angle_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    rows: Literal[1, 2] | None = None
    outer_race_radius_mm: Positive | None = None
    inner_race_radius_mm: Positive | None = None
    inner_groove_radius_mm: Positive | None = None
    outer_groove_radius_mm: Positive | None = None
    element: Literal["ball", "roller"] | None = None
    element_length_mm: Positive | None = None
    bore_mm: Positive | None = None
    outside_mm: Positive | None = None
    width_mm: Positive | None = None
    rotating_ring: Literal["inner", "outer"] = "inner"
    clearance_um: NotNegative = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        self._check_rings()
        if self.designation is not None:
            try:
                entry = catalogue_entry(self.designation)
            except KeyError as error:
                raise ValueError(
                    f"designation: {error.args[0]}; or give n_elements, element_diameter_mm and pitch_diameter_mm"
                ) from None
            self._check_length(self.element or entry.bearing.element)
            return self
        self._check_length(self.element or "ball")
        missing = [key for key in _REQUIRED if getattr(self, key) is None]
        if missing:
            raise ValueError(
                f"without a designation it needs {', '.join(_REQUIRED)}; missing are {', '.join(missing)}, "
                f"found are {', '.join(key for key in _REQUIRED if key not in missing) or 'none of them'}"
            )
        if (self.element_diameter_mm or 0.0) >= (self.pitch_diameter_mm or 0.0):
            raise ValueError("element_diameter_mm must be smaller than pitch_diameter_mm")
        return self

    def _check_length(self, element: str) -> None:
        if self.element_length_mm is not None and element != "roller":
            raise ValueError("element_length_mm is the length of the contact of a roller; this bearing has balls")

    def _check_rings(self) -> None:
        given = [key for key in RING_KEYS if getattr(self, key) is not None]
        if given and len(given) < len(RING_KEYS):
            missing = ", ".join(key for key in RING_KEYS if key not in given)
            raise ValueError(f"{', '.join(RING_KEYS)} belong together; missing: {missing}")

    def to_bearing(self) -> Bearing:
        """Return the geometry in SI; keys of the configuration take precedence over the catalogue."""
        return self.to_entry().bearing

    def to_entry(self) -> CatalogueEntry:
        """Return the geometry in SI with the origin of each value; keys given here take precedence."""
        given = self._given()
        origins = {name: GeometryOrigin("configured") for name in given if name not in _NO_DIMENSIONS}
        if self.designation is None:
            bearing = Bearing(designation=self.name, source="configuration", **given)
            return CatalogueEntry(bearing, origins, ((bearing.n_elements, 1.0),), dimensions=self._dimensions())
        entry = catalogue_entry(self.designation)
        bearing = replace(entry.bearing, **given)
        counts = entry.counts if self.n_elements is None else ((bearing.n_elements, 1.0),)
        dimensions = self._dimensions() or entry.dimensions
        origins = {**entry.origins, **origins}
        return replace(entry, bearing=bearing, origins=origins, counts=counts, dimensions=dimensions)

    def _dimensions(self) -> tuple[float, float, float] | None:
        """Return bore, outside diameter and width, m, or None where they are not given."""
        if self.bore_mm is None or self.outside_mm is None or self.width_mm is None:
            return None
        return 1e-3 * self.bore_mm, 1e-3 * self.outside_mm, 1e-3 * self.width_mm

    def _given(self) -> dict[str, Any]:
        """Return the fields of a bearing that are given here, SI."""
        given: dict[str, Any] = {}
        for key, value in self:
            if value is None or key in ("name", "designation", "clearance_um", *RING_KEYS):
                continue
            if key == "element_length_mm":
                given["effective_length"] = value * 1e-3
            elif key.endswith("_mm"):
                given[key.removesuffix("_mm")] = value * 1e-3
            elif key.endswith("_deg"):
                given[key.removesuffix("_deg")] = math.radians(value)
            else:
                given[key] = value
        return given


class RigSection(ConfigSection):
    """Lumped parameters of the six-degree-of-freedom model (thesis, Table 18).

    Contact stiffness and mass of the elements belong to one bearing, by default the first; those of any other are
    estimated from its geometry.

    ``calibrated`` is true for numbers that were identified on this machine, with the hash of that identification, or
    "declared" where a person vouches for them. Without the hash true is no more than that: see ``claim``. Behind the
    hash may stand the check digits of the numbers (``sealed``); a table of other numbers is then refused.
    ``posterior`` is the file of draws that the identification wrote, from which maps and libraries take their spread.
    """

    bearing: Name | None = None
    m_i_kg: Positive = Rig.m_i
    m_o_kg: Positive = Rig.m_o
    m_r_kg: Positive = Rig.m_r
    m_b_kg: Positive = Rig.m_b
    k_i_newton_per_m: Positive = Rig.k_i
    k_r_newton_per_m: Positive = Rig.k_r
    k_c_newton_per_m15: Positive = Rig.k_c
    k_c_newton_per_m109: Positive | None = None
    c_i_newton_s_per_m: NotNegative = Rig.c_i
    c_r_newton_s_per_m: NotNegative = Rig.c_r
    alpha_c_per_s: NotNegative = Rig.alpha_c
    beta_c_s: NotNegative = Rig.beta_c
    calibrated: StrictBool | Literal["declared"] = False
    identification: Annotated[str, Field(pattern=_IDENTIFICATION)] | None = None
    posterior: Path | None = None

    @field_validator("calibrated", mode="before")
    @classmethod
    def _claimed(cls, value: object) -> object:
        if value is True or value is False or value == "declared":
            return value
        raise ValueError("expected true, false or 'declared'")

    @field_validator("identification", mode="before")
    @classmethod
    def _hashed(cls, value: object) -> object:
        if value is None or (isinstance(value, str) and re.fullmatch(_IDENTIFICATION, value)):
            return value
        raise ValueError("expected the hash that identify writes, of 16 to 64 hexadecimal digits")

    @model_validator(mode="after")
    def _vouched(self) -> Self:
        if self.calibrated is not True and self.identification is not None:
            raise ValueError(
                "identification is the hash of calibrated = true; remove it, or write calibrated = true "
                "if the numbers are those of the identification"
            )
        hash_, _, digits = (self.identification or "").partition("-")
        if digits and digits != _check_digits(hash_, self.numbers):
            raise ValueError(
                f"the numbers are not those of identification {hash_[:16]}: a value was changed afterwards; put back "
                "what identify wrote, identify again, or vouch for the numbers: calibrated = 'declared' without "
                "identification"
            )
        if self.posterior is not None and self.identification is None:
            raise ValueError("posterior is the file of an identification; give identification, its hash, or remove it")
        return self

    @property
    def numbers(self) -> dict[str, float]:
        """The values of the keys that are parameters of the model, without those that are not known."""
        keys = (*RIG_KEYS.values(), *STIFFNESS_KEYS.values())
        return {key: value for key in keys if (value := getattr(self, key)) is not None}

    @property
    def claim(self) -> Calibration:
        """What vouches for the numbers; true without the hash of an identification is "declared"."""
        return "declared" if self.calibrated is True and self.identification is None else self.calibrated

    def assumed_keys(self, *, geometric: bool) -> tuple[str, ...]:
        """Return the keys that are not given, so that their values are those of the default test bench.

        ``geometric`` leaves out contact stiffness and mass of an element: they follow from geometry for rollers, and
        for a bearing that is not the section's own.
        """
        keys = {*RIG_KEYS.values(), STIFFNESS_KEYS["ball"]}
        if geometric:
            keys -= {RIG_KEYS["m_b"], STIFFNESS_KEYS["ball"]}
        return tuple(key for key in RigSection.model_fields if key in keys - self.model_fields_set)

    def to_rig(self, entry: CatalogueEntry, *, own: bool) -> Rig:
        """Return the parameters in SI for a bearing, which is the section's ``own`` or another.

        Raises:
            ValueError: the geometry of the bearing does not give its contact stiffness.
        """
        element = entry.bearing.element
        k_c: float | None = getattr(self, STIFFNESS_KEYS[element])
        m_b: float | None = self.m_b_kg if element == "ball" or "m_b_kg" in self.model_fields_set else None
        if not own or k_c is None or m_b is None:
            estimate = estimate_stiffness(entry)
            k_c = k_c if own and k_c is not None else estimate.value
            m_b = m_b if own and m_b is not None else element_mass(estimate.bearing)
        values: dict[str, float] = {name: getattr(self, key) for name, key in RIG_KEYS.items()}
        return Rig(
            **{**values, "k_c": k_c, "m_b": m_b},
            element=element,
            calibrated=self.claim if own else False,
            identification=(self.identification or "").partition("-")[0] if own else "",
        )


def sealed(identification: str, numbers: Mapping[str, float]) -> str:
    """Return the hash of an identification with check digits of the numbers, by key of ``[rig]``, that it found."""
    return f"{identification}-{_check_digits(identification, numbers)}"


def _check_digits(identification: str, numbers: Mapping[str, float]) -> str:
    """Return eight hexadecimal digits that depend on a hash and on 12 digits of each number.

    Default values are left out, so that it does not matter whether they are written.
    """
    written = {key: f"{value:.12g}" for key, value in numbers.items() if value != RigSection.model_fields[key].default}
    text = identification + "".join(f" {key}={written[key]}" for key in sorted(written))
    return hashlib.sha256(text.encode()).hexdigest()[:8]
