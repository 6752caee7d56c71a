"""The physical tracker on simulated lives: how wide its intervals must be, how far it is off, and what it costs.

Run as ``python -m benchmarks.filter [--quick] [--json FILE]``. Tables:

1. time of a block on a map of 33 by 101 nodes and size of the state, by particles and features;
2. the widening: lives of the library of ``benchmarks.forecast`` (loads of 3 to 5 kN, 20 to 45 Hz, slip), tracked on the
   map of a smooth floor without widening, each scored at 1/4, 1/2 and 3/4 of the time to the threshold; the factor on
   the half widths of ln V_eq with which the interval would have held the truth is found for every life and moment, and
   its quantile at the level of the interval is what ``monitor.health.size.filter.particle_filter`` has as
   ``WIDENING_RMS`` and ``WIDENING_HARMONICS``;
3. the figures with that widening on other lives of the library, which took no part in finding it;
4. the same at one load and speed, on the map of a smooth floor and on the mean of twelve rough floors;
5. the spread that is taken where a map has none: the standard deviation of ln X over rough floors and drawn rigs, at
   some depths, as the median over extents from 2 degrees on;
6. steps: the largest score of a rise and of a fall of the RMS over lives, and what a gain that becomes 3 or 0.3 times
   as large scores at once; from the first comes ``IMPLAUSIBLE_SD``.

Settings of the tracker were chosen by trying them on the first 60 lives of the library and on lives like those of
table 4 of another seed. No test life of ``benchmarks.forecast`` is used here.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import REFERENCE_MS, Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from benchmarks.forecast_lives import cached_lives
from benchmarks.forecast_population import FRACTIONS, LIBRARY, THRESHOLD
from benchmarks.forecast_thesis import map_plan
from models.lives.life import LifeHistory
from models.machine.scene import Floor
from models.maps.data import MapSlice, RmsMap
from models.maps.file import cached_map
from models.maps.plan import MapPlan
from monitor.health.size import DamageInput
from monitor.health.size.filter.particle_filter import FilterSettings, FilterState, step, step_score

Floats = NDArray[np.float64]
Slices = Callable[[LifeHistory], MapSlice]

FEATURES = {"rms": 0, "rms+harmonics": FilterSettings.lines}
STILL = replace(LIBRARY, load=(4000.0, 4000.0), speed=(40.0, 40.0), slip=(0.0, 0.0), seed=40041)
"""Lives at one load and speed, without slip."""


@dataclass(frozen=True, eq=False)
class Tracked:
    """Lives at their moments, shape (lives, moments): true V_eq, median and bounds (m2); ambiguous or not."""

    true: Floats
    v_eq: Floats
    lower: Floats
    upper: Floats
    ambiguous: Floats


def slices_of(rms_map: RmsMap) -> Slices:
    """Return what gives each life the map at its load and speed."""
    return lambda life: rms_map.slice_at(float(life.load[0]), float(life.speed[0]))


def follow(lives: Sequence[LifeHistory], slices: Slices, settings: FilterSettings) -> Tracked:
    """Track lives up to the last moment."""
    found = np.full((5, len(lives), len(FRACTIONS)), np.nan)
    for n, life in enumerate(lives):
        moments = np.array(FRACTIONS) * life.crossing(THRESHOLD)
        blocks = np.maximum(np.searchsorted(life.t, moments, side="right") - 1, 0)
        state, map_slice = FilterState(), slices(life)
        for k in range(int(blocks[-1]) + 1):
            heard = DamageInput(float(life.t[k]), float(life.rms[k]), tuple(life.harmonics[k].tolist()))
            state, result = step(state, heard, map_slice=map_slice, settings=settings)
            row = (life.v_eq[k], result.v_eq, result.v_eq_lower, result.v_eq_upper, result.status == "ambiguous")
            found[:, n, blocks == k] = np.array(row, dtype=float)[:, None]
    return Tracked(*found)


def needed_widening(tracked: Tracked) -> Floats:
    """Return the factor on the half width of ln V_eq with which each interval would just hold the truth."""
    off = np.log(tracked.true / tracked.v_eq)
    half = np.where(off > 0.0, np.log(tracked.upper / tracked.v_eq), np.log(tracked.lower / tracked.v_eq))
    return off / half


def widening_row(features: str, tracked: Tracked, level: float) -> Row:
    """Return the widening that lives ask for, each moment of each life once."""
    needed = needed_widening(tracked)
    row: dict[str, float | str | int | None] = {"features": features, "lives": len(needed)}
    row["widening"] = float(np.nanquantile(needed, level))
    for m, fraction in enumerate(FRACTIONS):
        row[f"at_{fraction:g}"] = float(np.nanquantile(needed[:, m], level))
    return row


def score_rows(name: str, features: str, tracked: Tracked) -> list[Row]:
    """Return error, coverage and width at each moment."""
    rows: list[Row] = []
    for m, fraction in enumerate(FRACTIONS):
        true, v_eq, lower, upper = (a[:, m] for a in (tracked.true, tracked.v_eq, tracked.lower, tracked.upper))
        error, known = np.log(v_eq / true), np.isfinite(v_eq)
        rows.append(
            {
                "map": name,
                "features": features,
                "at": fraction,
                "lives": true.size,
                "rms_ln": float(np.sqrt(np.nanmean(error**2))),
                "bias_ln": float(np.nanmean(error)),
                "coverage": float(np.mean((lower <= true) & (true <= upper))),
                "width_ln": float(np.nanmedian(np.log(upper / lower))),
                "ambiguous": float(np.nanmean(tracked.ambiguous[:, m])),
                "no_answer": float(np.mean(~known)),
            }
        )
    return rows


def time_rows(map_slice: MapSlice, radius: float, rounds: int) -> list[Row]:
    """Return the time of a block in the middle of a life, ms, and the bytes of the state as JSON."""
    lives = cached_lives(STILL, 1)
    kernel = interleaved_ms({"kernel": calibration_kernel()}, rounds)["kernel"]
    rows: list[Row] = []
    for features, lines in FEATURES.items():
        for particles in (FilterSettings.particles, 2 * FilterSettings.particles):
            settings = FilterSettings(radius, particles=particles, lines=lines)
            ms, size = _block_ms(lives[0], map_slice, settings, rounds)
            rows.append(
                {
                    "features": features,
                    "particles": particles,
                    "ms": ms,
                    "ms_on_reference": ms * REFERENCE_MS / kernel,
                    "target_ms": 5.0,
                    "state_kb": 1e-3 * size,
                }
            )
    return rows


def _block_ms(life: LifeHistory, map_slice: MapSlice, settings: FilterSettings, rounds: int) -> tuple[float, int]:
    """Return the mean over blocks of the median time of each, some of which resample, and the size of the state."""
    state, times = FilterState(), []
    for k in range(12):
        heard = DamageInput(float(life.t[k]), float(life.rms[k]), tuple(life.harmonics[k].tolist()))
        before = state

        def block(before: FilterState = before, heard: DamageInput = heard) -> tuple[FilterState, object]:
            return step(before, heard, map_slice=map_slice, settings=settings)

        if k > 1:
            times.append(interleaved_ms({"block": block}, rounds)["block"])
        state, _ = block()
    return float(np.mean(times)), len(json.dumps(state.to_dict()))


def step_rows(lives: Sequence[LifeHistory], slices: Slices, settings: FilterSettings, features: str) -> list[Row]:
    """Return quantiles over lives of the largest step that is sound, and of a changed gain at a third of the life."""
    sound = [max(map(abs, _steps(life, slices(life), settings, 1.0, _end(life)))) for life in lives]
    rows: list[Row] = [_step_row(features, "sound", sound, settings)]
    for gain in (3.0, 0.3):
        found = [abs(_steps(life, slices(life), settings, gain, _end(life) // 3)[-1]) for life in lives]
        rows.append(_step_row(features, f"gain x {gain:g}", found, settings))
    return rows


def _step_row(features: str, name: str, scores: Sequence[float], settings: FilterSettings) -> Row:
    low, middle, high = np.quantile(scores, (0.02, 0.5, 0.98)).tolist()
    refused = float(np.mean(np.array(scores) > settings.implausible_sd))
    return {
        "features": features,
        "lives": len(scores),
        "step": name,
        "2 %": low,
        "median": middle,
        "98 %": high,
        "largest": max(scores),
        "refused": refused,
    }


def _end(life: LifeHistory) -> int:
    return int(np.searchsorted(life.t, life.crossing(THRESHOLD), side="right"))


def _steps(life: LifeHistory, map_slice: MapSlice, settings: FilterSettings, gain: float, until: int) -> list[float]:
    """Return the scores of the first blocks of a life, the last of them louder by ``gain``."""
    state, scores = FilterState(), [0.0]
    for k in range(until):
        factor = gain if k == until - 1 else 1.0
        lines = tuple((factor * life.harmonics[k]).tolist())
        heard = DamageInput(float(life.t[k]), factor * float(life.rms[k]), lines)
        scores.append(step_score(state, heard, map_slice=map_slice, settings=settings))
        state, _ = step(state, heard, map_slice=map_slice, settings=settings)
    return scores


def spread_rows(rms_map: RmsMap) -> list[Row]:
    """Return the spread over floors and rigs at the depths that ``monitor.health.size.filter.prior`` tables."""
    at = rms_map.slice_at(4000.0, 40.0)
    wide = at.dphi_d >= math.radians(2.0)
    rows: list[Row] = []
    for h_d in (2e-6, 9e-6, 18e-6, 28e-6):
        j = int(np.argmin(np.abs(at.h_d - h_d)))
        rms = np.hypot(at.rms_std, at.rms_rig_std)[j, wide] / at.rms[j, wide]
        lines = np.hypot(at.harmonic_std, at.harmonic_rig_std)[j, wide] / at.harmonic_amplitude[j, wide]
        spread = np.sqrt(np.log1p(np.column_stack((rms, lines)) ** 2))
        row: dict[str, float | str | int | None] = {"h_d_um": 1e6 * h_d, "rms": float(np.median(spread[:, 0]))}
        row |= {f"line_{k}": float(np.median(spread[:, k])) for k in range(1, 4)}
        rows.append(row)
    return rows


def still_maps(quick: bool) -> Mapping[str, RmsMap]:
    """Return maps at one load and speed: of a smooth floor, and the mean of rough ones with drawn rigs."""
    plan = MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(1e-6 * i for i in range(33)),
        dphi_d=tuple(math.radians(0.5 * i) for i in range(101)),
        rms_band=(0.0, 9500.0),
    )
    count = 2 if quick else 12
    coarse = replace(plan, dphi_d=plan.dphi_d[::4], h_d=plan.h_d[::2]) if quick else plan
    rough = replace(coarse, floor=Floor("rough", sd=0.9e-6, seed=77), floors=count, rig_draws=count)
    return {"smooth floor": cached_map(plan), "rough floors": cached_map(rough)}


def main() -> None:
    """Run the tables and print them, and write them where asked."""
    options = arguments("The physical tracker on simulated lives: intervals, errors, cost.")
    fit, test, still = (8, 8, 6) if options.quick else (120, 150, 60)
    wide, maps = cached_map(map_plan(coarse=options.quick)), still_maps(options.quick)
    lives, radius = cached_lives(LIBRARY, fit + test), wide.part_radius
    settings = {features: FilterSettings(radius, lines=lines) for features, lines in FEATURES.items()}
    raw = {f: replace(s, widening_rms=1.0, widening_harmonics=1.0) for f, s in settings.items()}
    steady = cached_lives(STILL, still)
    tables: dict[str, Callable[[], list[Row]]] = {
        "time": lambda: time_rows(maps["smooth floor"].slice_at(4000.0, 40.0), radius, 5 if options.quick else 30),
        "widening": lambda: [
            widening_row(f, follow(lives[:fit], slices_of(wide), s), s.interval) for f, s in raw.items()
        ],
        "other_lives": lambda: [
            row
            for f, s in settings.items()
            for row in score_rows("smooth floor", f, follow(lives[fit:], slices_of(wide), s))
        ],
        "one_condition": lambda: [
            row
            for name, rms_map in maps.items()
            for f, s in settings.items()
            for row in score_rows(name, f, follow(steady, slices_of(rms_map), s))
        ],
        "steps": lambda: [row for f, s in settings.items() for row in step_rows(lives[fit:], slices_of(wide), s, f)],
        "spread": lambda: spread_rows(maps["rough floors"]),
    }
    figures: dict[str, list[Row]] = {}
    for title, table in tables.items():
        figures[title] = table()
        print_table(title, figures[title])
        write_json(options.json, figures)


if __name__ == "__main__":
    main()
