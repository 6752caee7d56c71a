"""Where the values of a bearing come from, for ``spallwatch bearing``: keys of the answer, and lines of text."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from models.bearing import CatalogueEntry, kinematics
from models.catalogue.series import Origin
from models.kinematic_uncertainty import kinematics_uncertainty
from monitor.health.spectrum.features import fundamentals
from monitor.health.spectrum.search import family_searches, overlapping

_SHOWN = {
    "n_elements": ("number of elements", 1.0, ""),
    "element_diameter": ("element diameter", 1e3, "mm"),
    "pitch_diameter": ("pitch diameter", 1e3, "mm"),
    "contact_angle": ("contact angle", 180.0 / math.pi, "deg"),
    "effective_length": ("roller length", 1e3, "mm"),
    "outer_race_radius": ("outer race radius", 1e3, "mm"),
    "inner_race_radius": ("inner race radius", 1e3, "mm"),
    "outer_groove_radius": ("outer groove radius", 1e3, "mm"),
    "inner_groove_radius": ("inner groove radius", 1e3, "mm"),
    "dynamic_load_rating": ("load rating C", 1e-3, "kN"),
}
_RATES = {"bpfo": "BPFO", "bpfi": "BPFI", "ftf": "FTF", "bsf": "BSF"}


def origin_values(entry: CatalogueEntry) -> dict[str, Any]:
    """Return the keys of the answer that say where its values come from and how certain they are."""
    uncertainty = kinematics_uncertainty(entry)
    lines = fundamentals(kinematics(entry.bearing, 1.0))
    return {
        "geometry": {name: _value(entry, name, origin) for name, origin in entry.origins.items() if name in _SHOWN},
        "count_probabilities": {str(count): probability for count, probability in entry.counts},
        "bpfo_uncertainty": uncertainty.bpfo,
        "bpfi_uncertainty": uncertainty.bpfi,
        "ftf_uncertainty": uncertainty.ftf,
        "bsf_uncertainty": uncertainty.bsf,
        "families_not_separable": ["|".join(pair) for pair in overlapping(lines, family_searches(uncertainty))],
        "dimensions_mm": None if entry.dimensions is None else [1e3 * value for value in entry.dimensions],
        "clearance_range_um": None
        if entry.clearance_range is None
        else [1e6 * value for value in entry.clearance_range],
        "suffixes": list(entry.notes),
    }


def _value(entry: CatalogueEntry, name: str, origin: Origin) -> dict[str, Any]:
    _, factor, unit = _SHOWN[name]
    known = getattr(entry.bearing, name)
    # The spread of an angle is absolute, the others are relative.
    spread = origin.spread * (1.0 if name == "contact_angle" else known)
    return {
        "value": known * factor,
        "unit": unit,
        "source": origin.kind,
        "uncertainty": spread * factor,
        "note": origin.note,
    }


def origin_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of text for the keys of ``origin_values``."""
    for name, found in values["geometry"].items():
        uncertain = f" ± {found['uncertainty']:.2g}" if found["uncertainty"] else ""
        yield f"{_SHOWN[name][0]:19s} {found['value']:9.5g}{uncertain} {found['unit']} ({found['source']})".replace(
            "  (", " ("
        )
    alternatives = list(values["count_probabilities"].items())
    if len(alternatives) > 1:
        yield "elements of a row   " + ", ".join(f"{count} ({100 * share:.0f} %)" for count, share in alternatives)
        uncertain = ", ".join(f"{label} {100 * values[f'{name}_uncertainty']:.1f} %" for name, label in _RATES.items())
        yield f"uncertainty         {uncertain} for this number of elements"
    if values["families_not_separable"] and len(alternatives) > 1:
        yield f"not separable       {', '.join(values['families_not_separable'])}: naming may answer with both"
    if values["clearance_range_um"] is not None:
        low, high = values["clearance_range_um"]
        yield f"radial play         {low:.0f} to {high:.0f} um by ISO 5753-1, unmounted; half of it is --clearance-um"
    for note in values["suffixes"]:
        yield f"suffix              {note}"
