"""What made an RMS map, in words."""

from __future__ import annotations

import math

import numpy as np

from models.maps.data import RmsMap
from models.maps.plan import STATUSES, MapPlan
from monitor.words.numbers import count, figure
from streams.block import STANDARD_GRAVITY


def lead_of(rms_map: RmsMap) -> str:
    """Return the sentence that says most of a map: the range of its levels, and whether they are absolute."""
    low, high = (value / STANDARD_GRAVITY for value in span_of(rms_map.rms))
    trust = (
        "the rig's parameters were calibrated on this machine"
        if rms_map.plan.rig.calibrated
        else "the rig's parameters were not calibrated on this machine, so that levels and volumes are relative"
    )
    level = f"RMS {figure(low)} to {figure(high)} g" if math.isfinite(low) else "No simulation ended well: no RMS"
    return f"{level} in {_band(rms_map.plan)}; {trust}."


def span_of(values: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest finite value, NaN where there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (math.nan, math.nan)


def facts_of(rms_map: RmsMap) -> list[tuple[str, str]]:
    """Return names and texts of what made a map and of how wrong it is."""
    plan, said = rms_map.plan, rms_map.attributes
    found = [
        ("Bearing", f"{plan.bearing.designation}, clearance {figure(1e6 * plan.clearance)} µm"),
        ("Condition", f"{_axis(rms_map.load, 'N')}; {_axis(rms_map.speed, 'Hz')}"),
        ("Grid", f"{count(len(rms_map.dphi_d), 'extent')}, {count(len(rms_map.h_d), 'depth')}"),
        ("Floor", _floor(plan)),
        ("Rig", _rig(plan)),
        ("Band of the RMS", _band(plan)),
        ("Numerical error", _numerical(rms_map)),
        ("Between nodes", _error(said, "interpolation")),
    ]
    if plan.slip is not None:
        found.append(("Slip", f"up to {figure(math.degrees(plan.slip.phi_slip), 2)}°, {plan.slip.rule}"))
    if said.get("condition_error") is not None:
        found.append(("Between loads and speeds", _error(said, "condition")))
    states = [f"{np.count_nonzero(rms_map.status == code):,} {name}" for code, name in enumerate(STATUSES)]
    found.append(("Simulations", ", ".join(text for text in states if not text.startswith("0 "))))
    found.append(("Hash", rms_map.hash[:16]))
    return found


def _band(plan: MapPlan) -> str:
    return "full bandwidth" if plan.rms_band is None else f"{plan.rms_band[0]:g} to {plan.rms_band[1]:g} Hz"


def _axis(values: np.ndarray, unit: str) -> str:
    if len(values) < 5:
        return ", ".join(f"{value:g}" for value in values) + f" {unit}"
    return f"{values[0]:g} to {values[-1]:g} {unit} ({len(values)} nodes)"


def _floor(plan: MapPlan) -> str:
    if plan.floor.kind == "smooth":
        return "smooth" if plan.floors == 1 else f"smooth, mean of {plan.floors} records"
    floors = "one floor" if plan.floors == 1 else f"mean of {plan.floors} floors"
    return f"rough, {figure(1e6 * plan.floor.sd)} µm, {floors}, from seed {plan.floor.seed}"


def _rig(plan: MapPlan) -> str:
    drawn = "" if plan.rig_draws == 0 else f"; {plan.rig_draws} rigs drawn, {figure(100 * plan.rig_spread)} % apart"
    return ("calibrated" if plan.rig.calibrated else "not calibrated on this machine") + drawn


def _numerical(rms_map: RmsMap) -> str:
    known = np.isfinite(rms_map.rms) & np.isfinite(rms_map.rms_error)
    level = float(np.sum(rms_map.rms[known] ** 2))
    if level == 0.0:
        return "unknown"
    return f"{figure(100.0 * math.sqrt(float(np.sum(rms_map.rms_error[known] ** 2)) / level), 2)} % (rms)"


def _error(said: dict[str, object], name: str) -> str:
    values = [said.get(f"{name}_error"), said.get(f"{name}_error_max")]
    known = [float(value) for value in values if isinstance(value, int | float | np.number)]
    if len(known) < 2 or not all(math.isfinite(value) for value in known):
        return "not measured"
    rms, most = (figure(100.0 * value, 2) for value in known)
    return f"wrong by {rms} % of the largest RMS (rms), {most} % at most"
