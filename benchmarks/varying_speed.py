"""Simulated faults at a speed that varies within the block: the name and H over orders, beside one speed and Hz.

Run as ``python -m benchmarks.varying_speed [--quick] [--judged] [--json FILE]``. Each scene (a fault of some size, or a
healthy bearing, parameters 2 to 5 % off) runs up from 10 to 40 Hz in 5, 20 and 60 s and hunts by 5, 10 and 20 %; each
run is simulated once and cut into blocks of 5 s, with noise, lines of the shaft and a tacho. Every block is analysed

* over orders, by a tacho channel of 8 pulses a turn, and, of the middle sizes, by tachos with faults;
* in Hz at its mean speed, which is given exactly;
* and so is the same scene at one speed, of 15 the one nearest to the mean of the block.

Tables: names; H (sum of five lines of the fault's family) against two references; what the faults of the tacho cost;
the same by the angular model. ``--judged`` takes seeds that nothing was fitted to.

References of H. "same block": computed independently with the true angle at the full rate of 25.6 kHz: envelope by the
Hilbert transform, cubic spline to 2^18 steps of angle, Hann, the same reading of lines. "one speed": the mean of what
the scene gives at constant speeds, over the angle and with the same window. That leaves out that the envelope's lines
have other phases at other speeds, by the delay of impacts and by the resonances that their harmonics pass.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.common import Row, print_table, write_json
from benchmarks.varying_speed_blocks import (
    CLEAN,
    DEVELOPMENT,
    GRID,
    JUDGED,
    MEAN,
    RATE,
    SECONDS,
    TACHOS,
    Judged,
    Recorded,
    by_tacho,
    in_hertz,
    over_orders,
    recorded,
    reference_h,
    runs,
    scenes,
    verdict,
)
from models.machine.bearing import Bearing
from models.machine.scene import Defect, Scene
from models.machine.speed_profile import constant, hunt, ramp
from models.solve.angular.rig import AngularRig
from models.solve.angular.solver import solve
from models.solve.six_dof.time_domain import simulate_time
from models.words.request import Request

_STEP = 10e-6


@dataclass(frozen=True)
class Outcome:
    """Of one block: its run, fault and case, verdicts by way of analysis, and H by way."""

    case: str
    fault: str
    run: str
    verdicts: dict[str, str]
    h: dict[str, float]
    status: dict[str, str | None]


def at_one_speed(scene: Scene, case: str, fault: str, seed: int) -> dict[float, tuple[str, float]]:
    """Return verdict and H of a scene at constant speeds."""
    found: dict[float, tuple[str, float]] = {}
    for speed in GRID:
        still = replace(scene, speed=speed)
        response = simulate_time(still, SECONDS, RATE, step=_STEP)
        (one,) = recorded(response, still, (case, fault, f"{speed:g} Hz"), seed)
        judged = in_hertz(one)
        found[speed] = verdict(one, judged), judged.h
    return found


def outcome(one: Recorded, steady: dict[float, tuple[str, float]], tachos: bool) -> Outcome:
    """Return what all analyses of a block say."""
    ways: dict[str, Judged] = {CLEAN: over_orders(one), "hertz": in_hertz(one)}
    if tachos:
        ways |= {name: by_tacho(one, name) for name in TACHOS}
    nearest = min(steady, key=lambda speed: abs(speed - one.mean_speed))
    verdicts = {name: verdict(one, judged) for name, judged in ways.items()}
    h = {name: judged.h for name, judged in ways.items()}
    if one.fault != "healthy":
        h["same block"] = reference_h(one, ways[CLEAN])
        speeds = np.gradient(one.turns) * RATE
        at = np.array(sorted(steady))
        levels = np.interp(speeds, at, [steady[speed][1] for speed in at])
        weight = np.sin(math.pi * one.turns / one.turns[-1]) ** 2 * speeds
        h["one speed"] = float(np.sum(levels * weight) / np.sum(weight))
    status = {name: judged.status for name, judged in ways.items()}
    return Outcome(one.case, one.fault, one.run, {"one speed": steady[nearest][0], **verdicts}, h, status)


def outcomes(seed: int, sizes: int, *, only_tachos: bool = False) -> Iterator[Outcome]:
    """Yield what is said of all blocks by the six-degree-of-freedom model, or of those with all tachos."""
    for case, fault, scene in scenes(seed, sizes):
        if only_tachos and not case.endswith(("healthy", "2")):
            continue
        steady = at_one_speed(scene, case, fault, seed)
        for name, profile in runs(seed).items():
            turning = replace(scene, speed_profile=profile)
            response = simulate_time(turning, profile.duration, RATE, step=_STEP)
            for one in recorded(response, turning, (case, fault, name), seed):
                yield outcome(one, steady, tachos=sizes == 1 or case.endswith(("healthy", "2")))


def by_angular_model(seed: int) -> Iterator[Outcome]:
    """Yield what is said of blocks by the angular model: it has no damaged ball, and takes a second a second."""
    rng = np.random.default_rng([seed, 15])
    bearing = Bearing("", 11, 12.7e-3, 80e-3)
    rig = AngularRig(mode_limit=10e3)
    # At less load the passages of the balls alone are named, at one speed too: this bearing has 35 um of play.
    healthy = Scene(MEAN, 1500.0, axial_load=200.0, bearing=bearing, rig=rig)
    sized = Defect(0.02 * float(np.exp(rng.uniform(-0.3, 0.3))), 3e-6, width=0.2)
    of_fault = {
        "healthy": healthy,
        "outer": replace(healthy, defect=sized),
        "inner": replace(healthy, defect=replace(sized, part="inner")),
    }
    phase = float(rng.uniform(0.0, 2.0 * math.pi))
    turning = {
        "10 to 40 Hz in 5 s": ramp(10.0, 40.0, SECONDS),
        "10 to 40 Hz in 60 s": ramp(10.0, 40.0, 60.0).part(27.5, SECONDS),
        "±10 %": hunt(MEAN, 0.1, 0.3, SECONDS, phase=phase),
        "±20 %": hunt(MEAN, 0.2, 0.3, SECONDS, phase=phase),
    }
    for fault, scene in of_fault.items():
        found: dict[float, tuple[str, float]] = {}
        for name, profile in {"25 Hz": constant(MEAN, SECONDS), **turning}.items():
            at = replace(scene, speed_profile=None if name == "25 Hz" else profile)
            response = solve(at, Request(duration=SECONDS, rate=RATE, accuracy=0.1))
            (one,) = recorded(response, scene, (f"{seed} {fault}", fault, name), seed)
            if not found:
                judged = in_hertz(one)
                found[MEAN] = verdict(one, judged), judged.h
                continue
            yield outcome(one, found, tachos=False)


def name_rows(found: list[Outcome]) -> list[Row]:
    """Return how often blocks are named by way of analysis, those apart that are named at one speed."""
    rows: list[Row] = []
    for run in dict.fromkeys(one.run for one in found):
        own = [one for one in found if one.run == run]
        damaged = [one for one in own if one.fault != "healthy"]
        named = [one for one in damaged if one.verdicts["one speed"] == "right"]
        healthy = [one for one in own if one.fault == "healthy"]
        row: dict[str, float | int | str | None] = {
            "run": run,
            "blocks": len(damaged),
            "right at one speed": len(named),
            "wrong at one speed": sum(one.verdicts["one speed"] == "wrong" for one in own),
        }
        for way, words in ((CLEAN, "orders"), ("hertz", "Hz")):
            row[f"of these right, {words}"] = sum(one.verdicts[way] == "right" for one in named)
            row[f"right, {words}"] = sum(one.verdicts[way] == "right" for one in damaged)
            row[f"wrong, {words}"] = sum(one.verdicts[way] == "wrong" for one in own)
        row["healthy blocks"] = len(healthy)
        rows.append(row)
    return rows


def h_rows(found: list[Outcome], references: tuple[str, ...]) -> list[Row]:
    """Return H over its references, of blocks that are named."""
    rows: list[Row] = []
    for run in dict.fromkeys(one.run for one in found):
        own = [one for one in found if one.run == run and one.verdicts[CLEAN] == "right"]
        row: dict[str, float | int | str | None] = {"run": run, "blocks": len(own)}
        for reference in references:
            ratio = np.array([one.h[CLEAN] / one.h[reference] for one in own])
            hertz = np.array([one.h["hertz"] / one.h[reference] for one in own])
            row[f"over {reference}, median"] = float(np.median(ratio)) if own else None
            row[f"over {reference}, farthest"] = float(ratio[np.argmax(np.abs(ratio - 1.0))]) if own else None
            row[f"in Hz over {reference}, median"] = float(np.median(hertz)) if own else None
        rows.append(row)
    return rows


def tacho_rows(found: list[Outcome]) -> list[Row]:
    """Return what tachos with faults cost, of all runs together."""
    rows: list[Row] = []
    found = [one for one in found if all(way in one.status for way in TACHOS)]
    damaged = [one for one in found if one.fault != "healthy"]
    for way in (CLEAN, *TACHOS):
        known = [one for one in damaged if one.verdicts[CLEAN] == "right"]
        ratio = np.array([one.h[way] / one.h[CLEAN] for one in known if one.status[way] == "ok"])
        rows.append(
            {
                "tacho": way,
                "blocks": len(damaged),
                "refused": sum(one.status[way] != "ok" for one in damaged),
                "right by the clean one": len(known),
                "of these right": sum(one.verdicts[way] == "right" for one in known),
                "wrong": sum(one.verdicts[way] == "wrong" for one in found),
                "H over the clean one, median": float(np.median(ratio)) if ratio.size else None,
                "least": float(ratio.min()) if ratio.size else None,
                "largest": float(ratio.max()) if ratio.size else None,
            }
        )
    return rows


def refusals(found: list[Outcome]) -> list[Row]:
    """Return why blocks have no angle."""
    counts: Counter[tuple[str, str, str]] = Counter()
    for one in found:
        for way in (CLEAN, *TACHOS):
            if one.status.get(way, "ok") != "ok":
                counts[way, one.run, str(one.status[way])] += 1
    return [{"tacho": way, "run": run, "why": why, "blocks": n} for (way, run, why), n in sorted(counts.items())]


def main() -> None:
    """Print the tables, and write them if a file is named."""
    parser = argparse.ArgumentParser(description="simulated faults at a varying speed")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="one size of each fault, without the angular model")
    parser.add_argument("--judged", action="store_true", help="seeds that nothing was fitted to")
    parser.add_argument("--tachos", action="store_true", help="the table of tachos alone")
    options = parser.parse_args()
    seeds = JUDGED if options.judged else DEVELOPMENT
    began = time.process_time()
    sizes = 1 if options.quick else 3
    found = [one for seed in seeds for one in outcomes(seed, sizes, only_tachos=options.tachos)]
    tables: dict[str, list[Row]] = {}
    if not options.tachos:
        tables["names, six_dof"] = name_rows(found)
        tables["H, six_dof"] = h_rows(found, ("same block", "one speed"))
    tables["tachos, six_dof"] = tacho_rows(found)
    if refused := refusals(found):
        tables["without an angle, six_dof"] = refused
    if not (options.quick or options.tachos):
        angular = [one for seed in seeds[:1] for one in by_angular_model(seed)]
        tables |= {"names, angular": name_rows(angular), "H, angular": h_rows(angular, ("same block",))}
    for title, rows in tables.items():
        print_table(title, rows)
    tables["run"] = [{"seeds": ", ".join(map(str, seeds)), "processor s": time.process_time() - began}]
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
