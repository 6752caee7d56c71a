"""Geometry and kinematics of rolling bearings, and the catalogue (bearings.toml)."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal


@dataclass(frozen=True)
class Bearing:
    """Geometry of a rolling bearing, SI units and radians.

    Attributes:
        n_elements: rolling elements in one row.
        element_diameter: diameter of a rolling element, m.
        pitch_diameter: diameter of the circle through the element centres, m.
        rotating_ring: the ring that turns with the shaft.
        outer_race_radius: r_o, radius of the outer race at the contact, m, or None where unknown.
        inner_race_radius: r_i, radius of the inner race at the contact, m, or None where unknown.
        inner_groove_radius: radius of curvature of the inner race across the rolling direction, m, or None.
        outer_groove_radius: the same of the outer race, m, or None; of a self-aligning race the sphere radius.
        effective_length: length of the line contact of a roller, m, or None.
        dynamic_load_rating: basic dynamic load rating C_r, N, or None.
    """

    designation: str
    n_elements: int
    element_diameter: float
    pitch_diameter: float
    contact_angle: float = 0.0
    rows: int = 1
    element: Literal["ball", "roller"] = "ball"
    rotating_ring: Literal["inner", "outer"] = "inner"
    outer_race_radius: float | None = None
    inner_race_radius: float | None = None
    inner_groove_radius: float | None = None
    outer_groove_radius: float | None = None
    effective_length: float | None = None
    dynamic_load_rating: float | None = None
    source: str = ""


@dataclass(frozen=True)
class Kinematics:
    """Kinematic frequencies at one shaft speed, Hz.

    ``ftf`` is the rotation of the cage relative to the ground, ``bpfo`` and ``bpfi`` the passages of elements over a
    point of the outer and inner race, ``bsf`` the spin of an element about its own axis. A defect of an element meets
    both races in one spin, so its line stands at twice ``bsf``.
    """

    speed: float
    ftf: float
    bpfo: float
    bpfi: float
    bsf: float


def kinematics(bearing: Bearing, speed: float) -> Kinematics:
    """Return the kinematic frequencies of pure rolling.

    ``speed`` is the rotation speed of the turning ring, Hz, positive.

    Source: thesis, Eqs. 33 and 81; Ceruti for BSF (misprint corrected: 1 - (d/D cos a)^2). With the outer ring
    turning, the cage follows it: FTF = f/2 (1 + d/D cos a), while the passages over either race, which depend on the
    relative motion alone, keep their formulas.

    Raises:
        ValueError: if the speed is not positive and finite.
    """
    if not (math.isfinite(speed) and speed > 0):
        raise ValueError(f"speed must be positive and finite, got {speed!r} Hz")
    ratio = bearing.element_diameter / bearing.pitch_diameter * math.cos(bearing.contact_angle)
    sign = -1.0 if bearing.rotating_ring == "inner" else 1.0
    return Kinematics(
        speed=speed,
        ftf=0.5 * speed * (1.0 + sign * ratio),
        bpfo=0.5 * speed * bearing.n_elements * (1.0 - ratio),
        bpfi=0.5 * speed * bearing.n_elements * (1.0 + ratio),
        bsf=0.5 * speed * bearing.pitch_diameter / bearing.element_diameter * (1.0 - ratio * ratio),
    )


_LENGTHS_MM = (
    "element_diameter",
    "pitch_diameter",
    "outer_race_radius",
    "inner_race_radius",
    "inner_groove_radius",
    "outer_groove_radius",
    "effective_length",
)


@cache
def catalogue() -> dict[str, Bearing]:
    """Return the bearings of ``models/bearings.toml`` by designation."""
    text = resources.files("models").joinpath("bearings.toml").read_text(encoding="utf-8")
    bearings: dict[str, Bearing] = {}
    for entry in tomllib.loads(text)["bearing"]:
        fields = dict(entry)
        for name in _LENGTHS_MM:
            if f"{name}_mm" in fields:
                fields[name] = fields.pop(f"{name}_mm") * 1e-3
        fields["contact_angle"] = math.radians(fields.pop("contact_angle_deg", 0.0))
        if "dynamic_load_rating_newton" in fields:
            fields["dynamic_load_rating"] = fields.pop("dynamic_load_rating_newton")
        bearings[fields["designation"]] = Bearing(**fields)
    return bearings


def from_catalogue(designation: str) -> Bearing:
    """Return one bearing of the catalogue.

    Raises:
        KeyError: if it is not there; the message lists the known ones.
    """
    known = catalogue()
    if designation not in known:
        raise KeyError(f"bearing {designation!r} is not in the catalogue; known are: {', '.join(sorted(known))}")
    return known[designation]
