"""Geometry and kinematics of rolling bearings, and the catalogue: bearings.toml, then models/catalogue.

Uncertainty of the fault frequencies from that of the geometry.

Given the number of elements N, all fault frequencies depend on one ratio g = D_w cos(alpha) / D_pw (``Kinematics``):
BPFO and FTF (inner ring turning) with 1 - g, BPFI with 1 + g, BSF with (1 - g^2) / g. So their relative uncertainties
follow from that of g to first order. The number is a discrete alternative: another one does not widen BPFO and BPFI but
adds another place for each. Fewer elements are larger ones: over the series, the diameter falls with the square root of
the number (``with_count``). FTF and BSF do not depend on the number itself.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from typing import Any, Literal

from models.machine.catalogue.designation import compact
from models.machine.catalogue.series import Geometry, GeometryOrigin, Kind, families, geometry, uncertain_counts

Element = Literal["ball", "roller"]


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
    element: Element = "ball"
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


@dataclass(frozen=True)
class CatalogueEntry:
    """A bearing of the catalogue, and where its values come from.

    Attributes:
        origins: by field of ``Bearing``, of the values that are known; a count of uncertain spread is estimated.
        counts: numbers of elements in a row and their probabilities, the likeliest first.
        clearance_range: least and largest play between the rings of its clearance class, m (ISO 5753-1), or None; half
            of it is the clearance of the models.
        notes: what the suffixes mean.
        dimensions: bore, outside diameter and width, m, or None where they are not known.
        series_length: effective length of a roller that its series has, m, or None; for bearings without one.
    """

    bearing: Bearing
    origins: Mapping[str, GeometryOrigin]
    counts: tuple[tuple[int, float], ...]
    clearance_range: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()
    dimensions: tuple[float, float, float] | None = None
    series_length: float | None = None

    @property
    def estimated(self) -> bool:
        """Whether the fault frequencies rest on an estimate."""
        return any(
            origin.kind == "estimated"
            for name, origin in self.origins.items()
            if name in ("n_elements", "element_diameter", "pitch_diameter", "contact_angle")
        )


_ORIGIN_FIELDS = (
    "n_elements",
    "contact_angle",
    "dynamic_load_rating",
    *_LENGTHS_MM,
)


@cache
def _entries() -> tuple[dict[str, Bearing], dict[str, Kind]]:
    """Return the bearings of ``models/bearings.toml`` by designation, and the kinds of their values."""
    text = resources.files("models").joinpath("bearings.toml").read_text(encoding="utf-8")
    bearings: dict[str, Bearing] = {}
    kinds: dict[str, Kind] = {}
    for entry in tomllib.loads(text)["bearing"]:
        fields: dict[str, Any] = dict(entry)
        kinds[fields["designation"]] = fields.pop("origin")
        for name in _LENGTHS_MM:
            if f"{name}_mm" in fields:
                fields[name] = fields.pop(f"{name}_mm") * 1e-3
        fields["contact_angle"] = math.radians(fields.pop("contact_angle_deg", 0.0))
        if "dynamic_load_rating_newton" in fields:
            fields["dynamic_load_rating"] = fields.pop("dynamic_load_rating_newton")
        bearings[fields["designation"]] = Bearing(**fields)
    return bearings, kinds


def catalogue() -> dict[str, Bearing]:
    """Return the bearings of ``models/bearings.toml`` by designation."""
    return _entries()[0]


def from_catalogue(designation: str) -> Bearing:
    """Return one bearing of the catalogue (see ``catalogue_entry``).

    Raises:
        KeyError: if it is not there or has an unknown suffix; the message lists the known ones.
    """
    return catalogue_entry(designation).bearing


@cache
def catalogue_entry(designation: str) -> CatalogueEntry:
    """Return one bearing of the catalogue with the origins of its values.

    The bearings of ``models/bearings.toml`` come first, in any spelling and with suffixes that leave the internal
    design alone; then the standard series.

    Raises:
        KeyError: if it is not there or has an unknown suffix; the message lists the known ones.
    """
    known, kinds = _entries()
    spelled = {compact(name): name for name in known}
    exact = spelled.get(compact(designation))
    whole = exact is not None
    try:
        found = geometry(designation)
    except ValueError as error:
        if exact is None:
            raise KeyError(str(error)) from None
        found = None
    except LookupError:
        found = None
    if exact is None and found is not None and not found.design_changed:
        exact = spelled.get(found.base)
    if exact is not None:
        entry = _known_entry(known[exact], kinds[exact], found)
        return entry if whole or found is None or not found.count_uncertain else _with_uncertain_count(entry)
    if found is None:
        raise KeyError(
            f"bearing {designation!r} is not in the catalogue; known are: {', '.join(sorted(known))}; and the series "
            f"{', '.join(_series_ranges())}"
        )
    return _series_entry(found)


def _known_entry(bearing: Bearing, kind: Kind, found: Geometry | None) -> CatalogueEntry:
    """Return the entry of a bearing of ``models/bearings.toml``; estimated ones have the spreads of their series."""
    note = bearing.source
    origins = {
        name: GeometryOrigin(kind, _spread(name, kind, found), note)
        for name in _ORIGIN_FIELDS
        if getattr(bearing, name) is not None
    }
    counts: tuple[tuple[int, float], ...] = ((bearing.n_elements, 1.0),)
    if kind == "estimated" and found is not None:
        shift = bearing.n_elements - found.n_elements
        counts = tuple((count + shift, probability) for count, probability in found.counts)
    if found is None:
        return CatalogueEntry(bearing, origins, counts)
    dimensions = (found.bore, found.outside, found.width)
    return CatalogueEntry(
        bearing, origins, counts, found.clearance_range, found.notes, dimensions, found.effective_length
    )


def _with_uncertain_count(entry: CatalogueEntry) -> CatalogueEntry:
    """Return the entry where a suffix stands for a cage or a design that may hold another number of elements."""
    counts = uncertain_counts(entry.bearing.n_elements)
    spread = math.sqrt(sum(share * (count / counts[0][0] - 1.0) ** 2 for count, share in counts))
    note = "a suffix stands for a cage or design that may hold another number"
    origins = {**entry.origins, "n_elements": GeometryOrigin("estimated", spread, note)}
    return replace(entry, counts=counts, origins=origins)


def _spread(name: str, kind: Kind, found: Geometry | None) -> float:
    if kind != "estimated" or found is None or name not in found.origins:
        return 0.0
    return found.origins[name].spread


def _series_entry(found: Geometry) -> CatalogueEntry:
    bearing = Bearing(
        designation=found.designation,
        n_elements=found.n_elements,
        element_diameter=found.element_diameter,
        pitch_diameter=found.pitch_diameter,
        contact_angle=found.contact_angle,
        rows=found.rows,
        element="ball" if found.effective_length is None else "roller",
        effective_length=found.effective_length,
        dynamic_load_rating=found.dynamic_load_rating,
        source=found.source,
    )
    dimensions = (found.bore, found.outside, found.width)
    return CatalogueEntry(bearing, found.origins, found.counts, found.clearance_range, found.notes, dimensions)


def _series_ranges() -> list[str]:
    """Return the series with their first and last number, such as "6200 to 6221"."""
    bounds: dict[str, list[str]] = {}
    for base in families():
        bounds.setdefault(base[:-2], []).append(base)
    return [f"{min(numbers)} to {max(numbers)}" for numbers in bounds.values()]


_LEAST_PROBABILITY = 0.02
_SIZE_EXPONENT = -0.5
"""Of the element diameter with the number of elements: -0.54 over 92 bearings of even bore code whose number differs
from that of the rule of their series (docs/evidence/catalogue.md)."""


@dataclass(frozen=True)
class KinematicUncertainty:
    """Relative standard uncertainties of the fault frequencies, given the number of elements, and its alternatives.

    Attributes:
        bpfo_places: factors of BPFO that other numbers of elements give, of those that are at least as likely as 2 %,
            the likeliest first; empty where the number is known.
        bpfi_places: the same of BPFI.
    """

    bpfo: float = 0.0
    bpfi: float = 0.0
    ftf: float = 0.0
    bsf: float = 0.0
    bpfo_places: tuple[float, ...] = ()
    bpfi_places: tuple[float, ...] = ()

    @property
    def known(self) -> bool:
        """Whether the frequencies are taken as exact."""
        return self == KinematicUncertainty()


KNOWN = KinematicUncertainty()


def kinematics_uncertainty(entry: CatalogueEntry) -> KinematicUncertainty:
    """Return the relative standard uncertainties of the fault frequencies of a catalogue entry; they fit any speed.

    The spreads of element diameter, pitch diameter and contact angle are taken as independent.
    """
    bearing, origins = entry.bearing, entry.origins

    def spread(name: str) -> float:
        return origins[name].spread if name in origins else 0.0

    sine, cosine = math.sin(bearing.contact_angle), math.cos(bearing.contact_angle)
    size, pitch, angle = spread("element_diameter"), spread("pitch_diameter"), spread("contact_angle")
    ratio = bearing.element_diameter / bearing.pitch_diameter * cosine
    # d(ln g) of each; the angle enters g through its cosine, BSF also through D_pw / D_w without it.
    relative = math.hypot(size, pitch, sine / cosine * angle)
    toward, away = ratio / (1.0 - ratio), ratio / (1.0 + ratio)
    proportion = (1.0 + ratio * ratio) / (1.0 - ratio * ratio)
    inclination = 2.0 * ratio * ratio / (1.0 - ratio * ratio) * sine / cosine * angle
    lines = kinematics(bearing, 1.0)
    others = [
        kinematics(with_count(bearing, count), 1.0)
        for count, probability in entry.counts[1:]
        if probability >= _LEAST_PROBABILITY
    ]
    inner = bearing.rotating_ring == "inner"
    return KinematicUncertainty(
        bpfo=toward * relative,
        bpfi=away * relative,
        ftf=(toward if inner else away) * relative,
        bsf=math.hypot(proportion * math.hypot(size, pitch), inclination),
        bpfo_places=tuple(other.bpfo / lines.bpfo for other in others),
        bpfi_places=tuple(other.bpfi / lines.bpfi for other in others),
    )


def with_count(bearing: Bearing, count: int) -> Bearing:
    """Return a bearing with another number of elements, and of the diameter that usually goes with it."""
    size = bearing.element_diameter * (count / bearing.n_elements) ** _SIZE_EXPONENT
    return replace(bearing, n_elements=count, element_diameter=size)
