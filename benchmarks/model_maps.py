"""V_eq on maps of each model, of simulated rigs of each model: what it costs to have the wrong one.

Run as ``python -m benchmarks.model_maps [--quick] [--json FILE]``. The bearing is a 6205 at 4000 N and 40 Hz, which all
models take that describe depth; the nominal parameters are those of ``models.solve.nominal_rigs``, the maps of smooth
floors. A life is one of ``rig:ferrara?model=NAME&bearing=6205``: its parameters are 2 to 5 % off, and its floor is
rough where the model has that. As in ``benchmarks.tracking``, blocks are not sampled: RMS and lines are those that the
model gives in the band of the map, at the speed and load which the rig has in that block, with the power of the rig's
background added and 2 % of scatter. Tracking begins at the true onset, and ends at the threshold. Tables:

1. cost of a node of each model, and how the maps are: RMS at two places, and the share of the nodes at which it falls
   with extent or depth, so that a level does not tell one defect;
2. tracked over true V_eq by rig and map, with the thesis' tracker (RMS) and the filter (RMS and lines): over the blocks
   from a quarter of the life on, with the share of blocks that have a value, and how many intervals of 80 % hold;
3. the same of growth, which an uncalibrated rig is left with: V_eq at the end over V_eq at a quarter of the life.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.tracking import BAND, LEAST, LOAD, SCATTER, SPEED, THRESHOLD, background_power
from models.maps.data import RmsMap
from models.maps.file import cached_map
from models.maps.nodes import simulate_node_row
from models.maps.plan import MapPlan
from models.solve.angular.rig import AngularRig
from models.solve.registry import IGNORES_DEPTH, RIGS
from models.solve.simulate import simulate
from monitor.health import tracker as damage
from monitor.health.tracker import TrackMethod
from monitor.service.setup import part_map
from streams.rig import INTERVAL, SimulatedRig
from streams.rig_machine import RADIAL_BEARING, machine_of

Floats = NDArray[np.float64]

METHODS: Mapping[TrackMethod, tuple[str, ...]] = {"thesis": ("rms",), "filter": ("rms", "harmonics")}
FIRST_SEED = 2001
SECONDS = 0.25
LEVEL = 0.8
BEGIN = 0.25
"""Share of a life from which on it is scored."""


@dataclass(frozen=True, eq=False)
class Heard:
    """The blocks of a life from the onset to the threshold: true V_eq, m2, (blocks,), and what is known of them."""

    v_true: Floats
    inputs: tuple[damage.DamageInput, ...]


@dataclass(frozen=True, eq=False)
class Followed:
    """V_eq and its bounds in the blocks of a life, m2, (blocks,); NaN where there is none."""

    v_eq: Floats
    lower: Floats
    upper: Floats


def models() -> list[str]:
    """Return the models that a map can be of, without that of the shaft over its angle: a second and more a node."""
    return [name for name in RIGS if name not in (*IGNORES_DEPTH, AngularRig.model)]


def plan_of(model: str, extents: int, depths: int) -> MapPlan:
    """Return the map of a model at nominal parameters, to 40 degrees and 20 um."""
    machine = machine_of(model, RADIAL_BEARING)
    return MapPlan(
        load=(LOAD,),
        speed=(SPEED,),
        h_d=tuple((np.linspace(0.0, 20.0, depths) * 1e-6).tolist()),
        dphi_d=tuple(np.radians(np.linspace(0.0, 40.0, extents)).tolist()),
        bearing=machine.bearing,
        rig=machine.nominal,
        model=model,
        rms_band=BAND,
    )


def map_row(model: str, rms_map: RmsMap) -> Row:
    """Return the cost of a node and the shape of a map."""
    plan, extents = rms_map.plan, np.radians([2.0, 5.0, 10.0, 20.0, 40.0])
    simulate_node_row(plan, LOAD, SPEED, 8e-6, extents)
    began = time.process_time()
    simulate_node_row(plan, LOAD, SPEED, 8e-6, extents)
    seconds = time.process_time() - began
    at = rms_map.slice_at(LOAD, SPEED)
    damaged = (len(at.dphi_d) - 1) * (len(at.h_d) - 1)
    small, wide = (float(at.interpolate(math.radians(extent), 8e-6)) for extent in (2.0, 20.0))
    return {
        "model": model,
        "node_ms": 1e3 * seconds / len(extents),
        "rms_2_deg_8_um": small,
        "rms_20_deg_8_um": wide,
        "falls_with_extent": float(np.count_nonzero(rms_map.falling("dphi_d")) / damaged),
        "falls_with_depth": float(np.count_nonzero(rms_map.falling("h_d")) / damaged),
        "between_nodes": float(rms_map.attributes["interpolation_error"]),
    }


def hear(model: str, seed: int, background: float) -> Heard:
    """Simulate one life from its onset to the threshold."""
    rig = SimulatedRig("rig", seed, load=LOAD, speed=SPEED, machine=machine_of(model, RADIAL_BEARING))
    rng = np.random.default_rng([seed, 3])
    found: list[damage.DamageInput] = []
    t = np.arange(0.0, rig.life.time_to(THRESHOLD), INTERVAL).tolist()
    for sequence, now in enumerate(t, start=rig.life.onset):
        # As the rig draws them.
        drawn = np.random.default_rng([seed, 2, sequence])
        speed = SPEED * (1.0 + 0.001 * float(drawn.standard_normal()))
        load = LOAD * (1.0 + 0.005 * float(drawn.standard_normal()))
        scene = rig.scene(sequence, speed, load)
        response = simulate(scene, band=BAND, lines_to=BAND[1], duration=SECONDS, accuracy=2e-3)
        scatter = 1.0 + SCATTER * rng.standard_normal(1 + len(response.harmonics))
        rms = math.sqrt(response.rms**2 + background) * float(scatter[0])
        found.append(damage.DamageInput(now, rms, tuple((response.harmonics * scatter[1:]).tolist()), LOAD, SPEED))
    return Heard(np.array([rig.life.v_eq(now) for now in t]), tuple(found))


def follow(heard: Heard, rms_map: RmsMap, method: TrackMethod) -> Followed:
    """Track one life on a map."""
    settings = damage.DamageSettings(
        track_method=method, forecast_method="thesis", maps={"outer": part_map(rms_map, METHODS[method], LEVEL)}
    )
    state, found = damage.DamageState(), []
    for one in heard.inputs:
        state, result, _ = damage.step(state, one, damage.DamageGate(), settings)
        found.append((result.v_eq, result.v_eq_lower, result.v_eq_upper))
    return Followed(*np.array(found).T)


def score(lives: Sequence[Heard], followed: Sequence[Followed]) -> tuple[Row, Row]:
    """Return the rows of volume and growth of some lives."""
    parts = [slice(int(BEGIN * len(life.inputs)), None) for life in lives]
    v_true = np.concatenate([life.v_true[part] for life, part in zip(lives, parts, strict=True)])
    v_eq, lower, upper = (
        np.concatenate([getattr(one, name)[part] for one, part in zip(followed, parts, strict=True)])
        for name in ("v_eq", "lower", "upper")
    )
    known = np.isfinite(v_eq)
    off = np.log(np.maximum(v_eq[known], LEAST) / v_true[known])
    bounded = np.isfinite(lower) & np.isfinite(upper)
    held = (lower <= v_true) & (v_true <= upper)
    volume = {
        **_ratio(off),
        "with_value": float(np.mean(known)),
        "interval_holds": float(np.mean(held[bounded])) if bounded.any() else None,
    }
    growth = [_growth(life, one, part) for life, one, part in zip(lives, followed, parts, strict=True)]
    return volume, _ratio(np.array(growth))


def _growth(life: Heard, found: Followed, part: slice) -> float:
    """Return the logarithm of found over true growth, over the blocks that have a value, NaN where too few have."""
    v_eq, v_true = np.maximum(found.v_eq[part], LEAST), life.v_true[part]
    known = np.flatnonzero(np.isfinite(v_eq))
    if len(known) < 2:
        return math.nan
    first, last = known[0], known[-1]
    return float(np.log(v_eq[last] / v_eq[first]) - np.log(v_true[last] / v_true[first]))


def _ratio(off: Floats) -> dict[str, float | None]:
    """Return median and spread of found over true from logarithms."""
    known = off[np.isfinite(off)]
    if not len(known):
        return dict.fromkeys(("ratio_p10", "ratio_median", "ratio_p90", "within_factor_2"))
    low, middle, high = (float(value) for value in np.exp(np.percentile(known, (10, 50, 90))))
    near = float(np.mean(np.abs(known) <= math.log(2.0)))
    return {"ratio_p10": low, "ratio_median": middle, "ratio_p90": high, "within_factor_2": near}


def main() -> None:
    """Run the tables and print them, and write them where asked."""
    options = arguments("V_eq on maps of each model, of simulated rigs of each model.")
    count, extents, depths = (1, 21, 6) if options.quick else (8, 81, 21)
    maps = {model: cached_map(plan_of(model, extents, depths)) for model in models()}
    background = background_power()
    figures: dict[str, list[Row]] = {"maps": [map_row(*item) for item in maps.items()], "v_eq": [], "growth": []}
    print_table("maps", figures["maps"])
    for rig in models():
        lives = [hear(rig, FIRST_SEED + k, background) for k in range(count)]
        for model, rms_map in maps.items():
            for method in METHODS:
                volume, growth = score(lives, [follow(life, rms_map, method) for life in lives])
                named = {"rig": rig, "map": model, "method": method, "lives": count}
                figures["v_eq"].append(named | dict(volume))
                figures["growth"].append(named | dict(growth))
    for title in ("v_eq", "growth"):
        print_table(title, figures[title])
    write_json(options.json, figures)


if __name__ == "__main__":
    main()
