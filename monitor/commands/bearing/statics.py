"""Analytic statics of ``spallwatch bearing``: load distribution, stiffness and contact areas from a contact law."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Bearing
from models.machine.hertz import contact_patches, mean_bearing_stiffness
from models.machine.load_distribution import (
    StiffnessPassage,
    load_distribution,
    load_zone,
    stiffness_against_load,
    stiffness_over_passage,
)
from models.machine.rig import Rig, natural_frequencies
from models.machine.scene import Defect

LOAD_STEPS = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Multiples of the load at which the radial stiffness is printed."""
_STATICS = (
    "k_xx_newton_per_m",
    "k_yy_newton_per_m",
    "natural_frequencies_hz",
    "displacement_um",
    "load_zone_deg",
    "largest_element_load_newton",
    "load_distribution",
    "stiffness_over_passage",
    "stiffness_over_damaged_passage",
    "radial_stiffness",
)


def analytic_statics(
    bearing: Bearing, rig: Rig, load: float, k_c: float | None, clearance: float, defect: Defect | None
) -> dict[str, Any]:
    """Return what follows from the contact stiffness k_c; all None if it is unknown."""
    if k_c is None:
        return dict.fromkeys(_STATICS)
    mean = mean_bearing_stiffness(bearing, load, k_c, clearance=clearance)
    k_yy, k_xx = float(mean[0, 0]), float(mean[1, 1])
    shared = load_distribution(bearing, load, k_c, clearance=clearance)
    loads = [share * load for share in LOAD_STEPS]
    displacement, stiffness = stiffness_against_load(bearing, loads, k_c, clearance=clearance)
    values = (
        k_xx,
        k_yy,
        [float(f) for f in natural_frequencies(rig, k_xx, k_yy)],
        1e6 * float(shared.displacement[0]),
        math.degrees(load_zone(float(shared.displacement[0]), clearance)),
        float(shared.loads.max()),
        distribution_rows(shared.angles, shared.loads),
        passage_values(stiffness_over_passage(bearing, load, k_c, clearance=clearance)),
        defect and passage_values(stiffness_over_passage(bearing, load, k_c, clearance=clearance, defect=defect)),
        load_rows(loads, displacement, stiffness),
    )
    return dict(zip(_STATICS, values, strict=True))


def distribution_rows(angles: NDArray[np.float64], loads: NDArray[np.float64]) -> list[dict[str, float]]:
    """Return the loads of the elements, N, in the order of their angles, rad."""
    order = np.argsort(angles, kind="stable")
    return [{"angle_deg": math.degrees(angles[i]), "load_newton": float(loads[i])} for i in order]


def load_rows(
    loads: Sequence[float], displacement: NDArray[np.float64], stiffness: NDArray[np.float64]
) -> list[dict[str, float]]:
    """Return the displacement, m, (loads,), and stiffness, N/m, (loads, 2, 2), under each load, N."""
    return [
        {
            "load_newton": at,
            "displacement_um": 1e6 * float(u),
            "k_xx_newton_per_m": float(k[1, 1]),
            "k_yy_newton_per_m": float(k[0, 0]),
        }
        for at, u, k in zip(loads, displacement, stiffness, strict=True)
    ]


def passage_values(passage: StiffnessPassage) -> dict[str, float]:
    """Return the extremes of the stiffness, N/m, and the swing that they make, % of the mean."""
    low, high = passage.matrix.min(axis=0), passage.matrix.max(axis=0)
    return {
        "k_xx_least_newton_per_m": float(low[1, 1]),
        "k_xx_largest_newton_per_m": float(high[1, 1]),
        "k_xx_swing_percent": 100.0 * float(passage.swing[1]),
        "k_yy_least_newton_per_m": float(low[0, 0]),
        "k_yy_largest_newton_per_m": float(high[0, 0]),
        "k_yy_swing_percent": 100.0 * float(passage.swing[0]),
        "k_xy_largest_newton_per_m": passage.largest_coupling,
    }


def areas_known(bearing: Bearing, load: float, k_c: float, clearance: float) -> dict[str, dict[str, float]] | None:
    """Return ``_areas``, or None where a radius is unknown."""
    try:
        return _areas(bearing, load, k_c, clearance)
    except ValueError:
        return None


def _areas(bearing: Bearing, load: float, k_c: float, clearance: float) -> dict[str, dict[str, float]]:
    """Return half length and half width of the most loaded contacts, um."""
    patches = contact_patches(bearing, float(load_distribution(bearing, load, k_c, clearance=clearance).loads.max()))
    return {
        race: {"half_length": 1e6 * half_length, "half_width": 1e6 * half_width}
        for race, (half_length, half_width) in zip(("inner", "outer"), patches, strict=True)
    }


def static_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield the lines of the statics for people."""
    yield (
        f"radial stiffness    {values['k_xx_newton_per_m'] / 1e6:.1f} MN/m across the load, "
        f"{values['k_yy_newton_per_m'] / 1e6:.1f} MN/m along it; displacement {values['displacement_um']:.2f} um"
    )
    for key, words in (("stiffness_over_passage", "healthy"), ("stiffness_over_damaged_passage", "damaged")):
        if values[key] is not None:
            yield (
                f"swing of stiffness  {values[key]['k_xx_swing_percent']:.2f} % across, "
                f"{values[key]['k_yy_swing_percent']:.3f} % along, while the elements pass ({words})"
            )
    loaded = sum(element["load_newton"] > 0.0 for element in values["load_distribution"])
    yield (
        f"load distribution   {loaded} elements within {values['load_zone_deg']:.0f} deg, "
        f"{values['largest_element_load_newton']:.0f} N on the most loaded"
    )
    for row in values["radial_stiffness"]:
        yield (
            f"  at {row['load_newton']:8g} N     {row['k_xx_newton_per_m'] / 1e6:.1f} and "
            f"{row['k_yy_newton_per_m'] / 1e6:.1f} MN/m, {row['displacement_um']:.2f} um"
        )
    if values["contact_areas_um"] is not None:
        for race, area in values["contact_areas_um"].items():
            size = f"{2 * area['half_length']:.0f} x {2 * area['half_width']:.0f} um"
            yield f"contact area        {size} on the {race} race"
    yield "natural frequencies " + ", ".join(f"{f:.1f}" for f in values["natural_frequencies_hz"]) + " Hz"
