"""The standard series: internal geometry of a bearing by its designation, and where each value comes from.

Rules of design from which the internal geometry follows where only boundary dimensions are known.

The constants are means and standard deviations over the bearings of even bore code of each series whose geometry
follows from published load ratings (models/machine/catalogue/*.csv); those of odd bore code were held out and measure
the error (docs/evidence/catalogue.md). ``python -m benchmarks.catalogue.ratings`` prints them; no spread is taken below
2 %. The series without ratings (64, 160) have rules that are not fitted: those of their neighbours with a wider spread.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Literal

from models.machine.catalogue.designation import BALLS, ROLLERS, Designation, Family, parse


@dataclass(frozen=True)
class DesignRule:
    """Proportions of a series; spreads are relative standard deviations.

    Attributes:
        share: element diameter over half the difference of outside and bore diameter.
        room: distance of neighbouring elements along the pitch circle over their diameter.
        pitch: pitch diameter over the mean of bore and outside diameter.
        length: effective length of a roller over the width.
        least_width: least width of the bearing over the diameter of a ball.
    """

    share: float
    share_spread: float
    room: float
    room_spread: float
    pitch: float = 1.0
    length: float | None = None
    least_width: float = 0.0


RULES = {
    "60": DesignRule(0.586, 0.026, 1.71, 0.02),
    "62": DesignRule(0.605, 0.078, 1.716, 0.032),
    "63": DesignRule(0.612, 0.046, 1.682, 0.02),
    "64": DesignRule(0.620, 0.06, 1.68, 0.04),
    "160": DesignRule(0.570, 0.08, 1.75, 0.04, least_width=1.5),
    "618": DesignRule(0.566, 0.051, 1.891, 0.028),
    "619": DesignRule(0.592, 0.056, 1.765, 0.033),
    "72": DesignRule(0.621, 0.034, 1.13, 0.022),
    "73": DesignRule(0.619, 0.041, 1.135, 0.022),
    "12": DesignRule(0.464, 0.082, 1.315, 0.055),
    "13": DesignRule(0.459, 0.026, 1.281, 0.066),
    "22": DesignRule(0.501, 0.063, 1.24, 0.026),
    "23": DesignRule(0.557, 0.05, 1.208, 0.021),
    "NU2": DesignRule(0.486, 0.028, 1.456, 0.02, 1.002, 0.457),
    "NU3": DesignRule(0.494, 0.027, 1.389, 0.048, 1.006, 0.495),
    "NU22": DesignRule(0.486, 0.028, 1.495, 0.056, 1.002, 0.559),
    "NU23": DesignRule(0.494, 0.027, 1.389, 0.048, 1.006, 0.523),
    "NU2E": DesignRule(0.551, 0.02, 1.239, 0.025, 1.011, 0.574),
    "NU3E": DesignRule(0.547, 0.026, 1.231, 0.02, 1.011, 0.6),
    "NU22E": DesignRule(0.551, 0.02, 1.239, 0.025, 1.011, 0.627),
    "NU23E": DesignRule(0.547, 0.026, 1.231, 0.02, 1.011, 0.636),
    "302": DesignRule(0.497, 0.048, 1.105, 0.02, 1.0, 0.621),
    "303": DesignRule(0.499, 0.035, 1.095, 0.03, 1.0, 0.67),
    "222": DesignRule(0.565, 0.035, 1.141, 0.02, 1.02, 0.371),
    "223": DesignRule(0.557, 0.025, 1.135, 0.024, 1.02, 0.375),
}

_LEAST_PROBABILITY = 0.02


@dataclass(frozen=True)
class Estimate:
    """Internal geometry by a rule: lengths in the unit of the dimensions.

    Attributes:
        counts: numbers of elements and their probabilities, the likeliest first; they sum to 1.
        size_spread: relative standard uncertainty of the element diameter.
    """

    counts: tuple[tuple[int, float], ...]
    element_diameter: float
    pitch_diameter: float
    effective_length: float | None
    size_spread: float


def estimate(series: str, bore: float, outside: float, width: float) -> Estimate:
    """Return the internal geometry that the rule of a series gives for boundary dimensions.

    The count is a discrete alternative: its probabilities are those of a normal distribution about the room that is
    left, integrated over each whole number.

    Raises:
        KeyError: if the series has no rule.
    """
    rule = RULES[series]
    pitch = rule.pitch * 0.5 * (bore + outside)
    size = rule.share * 0.5 * (outside - bore)
    if rule.least_width:
        size = min(size, width / rule.least_width)
    fitting = math.pi * pitch / (size * rule.room)
    counts = count_probabilities(fitting, fitting * math.hypot(rule.share_spread, rule.room_spread))
    size = min(size, 0.98 * pitch * math.sin(math.pi / counts[0][0]))
    return Estimate(counts, size, pitch, None if rule.length is None else rule.length * width, rule.share_spread)


def count_probabilities(mean: float, spread: float) -> tuple[tuple[int, float], ...]:
    """Return whole numbers and their probabilities under a normal distribution, the likeliest first.

    Numbers of a probability below 2 % are left out, and the rest normalised.
    """

    def below(edge: float) -> float:
        return 0.5 * (1.0 + math.erf((edge - mean) / (spread * math.sqrt(2.0))))

    centre = round(mean)
    weights = {n: below(n + 0.5) - below(n - 0.5) for n in range(max(3, centre - 5), centre + 6)}
    kept = {n: weight for n, weight in weights.items() if weight >= _LEAST_PROBABILITY}
    total = sum(kept.values())
    return tuple(sorted(((n, weight / total) for n, weight in kept.items()), key=lambda item: -item[1]))


Kind = Literal["measured", "table", "estimated", "configured"]
Row = dict[str, str]

JTEKT = "JTEKT (Koyo), general catalogue of standard bearings"
_DERIVED = f"derived by ISO 76 and ISO 281 from the load ratings of {JTEKT}; other makers differ"
_BY_RULE = "rule of design for the boundary dimensions"
_RIGHT_COUNT = {
    "deep_groove": 0.90,
    "angular_contact": 0.80,
    "self_aligning": 0.85,
    "cylindrical": 0.85,
    "tapered": 0.65,
    "spherical": 0.65,
}
"""Probability that another maker's bearing has the derived count, a judgement; the neighbours share the rest."""
_SIZE_SPREAD = {
    "deep_groove": 0.02,
    "angular_contact": 0.02,
    "self_aligning": 0.025,
    "cylindrical": 0.02,
    "tapered": 0.04,
    "spherical": 0.05,
}
"""Relative standard uncertainty of a derived element diameter against other makers' bearings."""
_PITCH_SPREAD, _ROLLER_PITCH_SPREAD = 0.005, 0.012
_LENGTH_SPREAD = 0.08
_ANGLE_SPREAD_RAD = {"tapered": 0.02, "spherical": 0.03, "self_aligning": 0.02, "angular_contact": 0.02}
_RULE_ANGLE_DEG = {"302": 14.5, "303": 13.0}
_UNLETTERED_ANGLE_DEG = 30.0
"""Contact angle of an angular contact bearing without a letter (JTEKT, NTN); other makers mean 40 degrees."""


@dataclass(frozen=True)
class GeometryOrigin:
    """Where a value comes from.

    Attributes:
        kind: "measured", "table" (published), "estimated" or "configured".
        spread: relative standard uncertainty (of a contact angle: rad); 0 where the value is taken as exact.
        note: the source or the rule.
    """

    kind: Kind
    spread: float = 0.0
    note: str = ""


@dataclass(frozen=True)
class Geometry:
    """Internal geometry of a bearing of a series, SI and rad.

    Attributes:
        base: its base number, such as "6205".
        bore, outside, width: boundary dimensions (ISO 15, ISO 355), m.
        counts: numbers of elements in a row and their probabilities, the likeliest first.
        origins: of each of ``n_elements``, ``element_diameter``, ``pitch_diameter``, ``contact_angle``,
            ``effective_length`` and ``dynamic_load_rating`` that is known.
        notes: what the suffixes mean.
        design_changed: whether a suffix stands for another internal design than that of the base number.
        count_uncertain: whether a suffix stands for a design that may hold another number of elements.
    """

    designation: str
    base: str
    family: Family
    bore: float
    outside: float
    width: float
    counts: tuple[tuple[int, float], ...]
    element_diameter: float
    pitch_diameter: float
    contact_angle: float
    rows: int
    effective_length: float | None
    dynamic_load_rating: float | None
    source: str
    origins: Mapping[str, GeometryOrigin]
    clearance_range: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()
    design_changed: bool = False
    count_uncertain: bool = False

    @property
    def n_elements(self) -> int:
        """The likeliest number of elements in a row."""
        return self.counts[0][0]


@cache
def families() -> Mapping[str, Family]:
    """Return the base numbers that the series hold, such as "6205" and "NU205", and their families."""
    found: dict[str, Family] = {}
    for family in (*BALLS, *ROLLERS):
        for number in _rows(family):
            if family != "cylindrical":
                found[number] = family
            elif not number.endswith("E"):
                found[f"NU{number}"] = found[f"NJ{number}"] = family
    return MappingProxyType(found)


@cache
def _rows(family: Family) -> dict[str, Row]:
    text = resources.files("models.machine.catalogue").joinpath(f"{family}.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    return {row["designation"]: row for row in csv.DictReader(lines)}


def series_of(base: str) -> str:
    """Return the series of a base number: "62" of "6205", "NU2" of "NJ205"."""
    return base[:-2].replace("NJ", "NU")


def read_designation(text: str) -> Designation:
    """Take a designation of the series apart.

    Raises:
        LookupError: if its base number is not in the series.
        ValueError: if a suffix is unknown.
    """
    return parse(text, families())


def geometry(text: str) -> Geometry:
    """Return the internal geometry of a designation of the series.

    Raises:
        LookupError: if its base number is not in the series.
        ValueError: if a suffix is unknown.
    """
    designation = read_designation(text)
    row, series = _row_of(designation)
    bore, outside, width = (float(row[key]) for key in ("bore", "outside", "width"))
    found = _derived(row, designation.family) if row["z"] else estimate(series, bore, outside, width)
    found = _with_design(found, designation)
    angle, angle_origin = _contact_angle(row, designation)
    return Geometry(
        designation=text,
        base=designation.base,
        family=designation.family,
        bore=1e-3 * bore,
        outside=1e-3 * outside,
        width=1e-3 * width,
        counts=found.counts,
        element_diameter=1e-3 * found.element_diameter,
        pitch_diameter=1e-3 * found.pitch_diameter,
        contact_angle=angle,
        rows=2 if designation.family in ("self_aligning", "spherical") else 1,
        effective_length=None if found.effective_length is None else 1e-3 * found.effective_length,
        dynamic_load_rating=1e3 * float(row["dynamic"]) if row["dynamic"] else None,
        source=_source(row, designation.family),
        origins=_origins(row, found, designation.family, angle_origin),
        clearance_range=clearance_range(designation, bore),
        notes=tuple(f"{suffix.text}: {suffix.meaning}" for suffix in designation.suffixes),
        design_changed=any(
            suffix.design in ("reinforced", "narrow") or suffix.angle_deg is not None for suffix in designation.suffixes
        ),
        count_uncertain=any(suffix.design == "count" for suffix in designation.suffixes),
    )


def published_row(text: str) -> Row:
    """Return what the table of its series holds for a designation, as text: mm, kN.

    Raises:
        LookupError: if its base number is not in the series.
        ValueError: if a suffix is unknown.
    """
    return _row_of(read_designation(text))[0]


def _row_of(designation: Designation) -> tuple[Row, str]:
    """Return the row of a designation and its series; a design of its own has another row."""
    designs = {suffix.design for suffix in designation.suffixes}
    reinforced = "E" if "reinforced" in designs else ""
    rows = _rows(designation.family)
    number = designation.base.removeprefix("NU").removeprefix("NJ")
    row, series = rows[number + reinforced], series_of(designation.base) + reinforced
    if "narrow" in designs and number.startswith("2"):
        narrow = "1" + number[1:]
        row, series = {**rows[narrow], "width": row["width"]}, series_of(narrow)
    return row, series


def _derived(row: Row, family: Family) -> Estimate:
    """Return the geometry that a row gives, lengths in mm, with the spread between makers."""
    bore, outside, count = float(row["bore"]), float(row["outside"]), int(row["z"])
    size = float(row["ball"] if family in BALLS else row["roller"])
    pitch = 0.5 * (bore + outside)
    if family == "cylindrical":
        pitch = float(row["inner"]) + size
    elif family == "spherical":
        pitch *= 1.02
    right = _RIGHT_COUNT[family]
    others = 0.5 * (1.0 - right)
    counts = ((count, right), (count - 1, others), (count + 1, others))
    length = float(row["length"]) if family in ROLLERS else None
    return Estimate(counts, size, pitch, length, _SIZE_SPREAD[family])


def _with_design(found: Estimate, designation: Designation) -> Estimate:
    """Return the geometry with a less certain count where a suffix stands for another internal design."""
    if not any(suffix.design == "count" for suffix in designation.suffixes):
        return found
    return replace(found, counts=uncertain_counts(found.counts[0][0]))


def uncertain_counts(count: int) -> tuple[tuple[int, float], ...]:
    """Return the alternatives of a count that a cage or a design of its own may change by one."""
    return ((count, 0.5), (count - 1, 0.25), (count + 1, 0.25))


def _contact_angle(row: Row, designation: Designation) -> tuple[float, GeometryOrigin]:
    family = designation.family
    stated = next((suffix for suffix in designation.suffixes if suffix.angle_deg is not None), None)
    spread = _ANGLE_SPREAD_RAD.get(family, 0.0)
    if stated is not None and stated.angle_deg is not None:
        return math.radians(stated.angle_deg), GeometryOrigin("table", spread, f"suffix {stated.text}")
    if family == "angular_contact":
        note = "no letter: 30 degrees by JTEKT and NTN, 40 degrees by others"
        return math.radians(_UNLETTERED_ANGLE_DEG), GeometryOrigin("estimated", math.radians(5.0), note)
    if row.get("e"):
        return math.atan(float(row["e"]) / 1.5), GeometryOrigin("estimated", spread, f"e = 1.5 tan(angle), {JTEKT}")
    if family == "tapered":
        return math.radians(_RULE_ANGLE_DEG[series_of(designation.base)]), GeometryOrigin("estimated", 0.03, _BY_RULE)
    return 0.0, GeometryOrigin("table", 0.0, "radial bearing")


def _source(row: Row, family: Family) -> str:
    standard = "ISO 355" if family == "tapered" else "ISO 15"
    rest = f"internal geometry {_DERIVED}" if row["z"] else f"internal geometry estimated by a {_BY_RULE}"
    return f"{standard} boundary dimensions {row['bore']} x {row['outside']} x {row['width']} mm; {rest}"


def _origins(row: Row, found: Estimate, family: Family, angle: GeometryOrigin) -> Mapping[str, GeometryOrigin]:
    note = _DERIVED if row["z"] else _BY_RULE
    count = found.counts[0][0]
    variance = sum(probability * (n / count - 1.0) ** 2 for n, probability in found.counts)
    pitch = _ROLLER_PITCH_SPREAD if family in ("tapered", "spherical") else _PITCH_SPREAD
    origins = {
        "n_elements": GeometryOrigin("estimated", math.sqrt(variance), note),
        "element_diameter": GeometryOrigin("estimated", found.size_spread, note),
        "pitch_diameter": GeometryOrigin("estimated", pitch, "mean of bore and outside diameter, or of both raceways"),
        "contact_angle": angle,
    }
    if found.effective_length is not None:
        origins["effective_length"] = GeometryOrigin("estimated", _LENGTH_SPREAD, note)
    if row["dynamic"]:
        origins["dynamic_load_rating"] = GeometryOrigin("table", 0.0, JTEKT)
    return MappingProxyType(origins)


def clearance_range(designation: Designation, bore_mm: float) -> tuple[float, float] | None:
    """Return the least and the largest radial internal clearance of the class, m (ISO 5753-1), or None.

    It is the play between the rings, twice the clearance of each element in the models. None for bearings whose
    clearance is set at mounting (angular contact, tapered), for tapered bores, and outside the table.
    """
    if any(suffix.meaning.startswith("tapered bore") for suffix in designation.suffixes):
        return None
    for row in _clearances():
        if row["family"] == designation.family and float(row["over"]) < bore_mm <= float(row["to"]):
            named = designation.clearance_class
            return 1e-6 * float(row[f"{named}_low"]), 1e-6 * float(row[f"{named}_high"])
    return None


@cache
def _clearances() -> tuple[Row, ...]:
    text = resources.files("models.machine.catalogue").joinpath("clearance.csv").read_text(encoding="utf-8")
    return tuple(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
