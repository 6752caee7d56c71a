"""Naming of damaged wheels: false alarms of healthy geared machines, detection by kind and size of damage.

The machines are those of ``benchmarks/gears/machines.py``; no pulse is given, so that the angle comes from the mesh. Of
each machine the blocks of a baseline are learned, then healthy blocks are judged, and of the damaged seeds the blocks
after each damage begins. ``--training`` takes seeds on which constants may be fitted; without it the judged ones, which
were set aside before.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from benchmarks.common import Row, print_table, write_json
from benchmarks.gears.machines import BLOCK_S, DAMAGED, HEALTHY, RATE, SIZES, TRAINING, Fault, GearMachine
from monitor.health.gears.angle import angle_of_mesh
from monitor.health.gears.naming import (
    KINDS,
    MIN_LEARNED,
    GearNamingSettings,
    GearsInput,
    GearsOutput,
    GearsState,
    step,
)
from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel
from monitor.health.gears.stage import readings_of
from streams.rig.bench import open_rig
from streams.types.block import Rejected

RULES = GearNamingSettings()
LEARNED = 2 * MIN_LEARNED
HEALTHY_BLOCKS, DAMAGED_BLOCKS = 50, 2 * RULES.persist_blocks
RIG_SEED, RIG_SPEED, RIG_TEETH, RIG_SIZES = 44_100, 40.0, (23, 71), (0.5, 0.8)
RIG_FAULTS = ("crack", "driven:crack", "spall", "driven:spall", "pitch", "driven:pitch", "eccentric")
COUNTED = ("machines", "blocks", "judged", "above_threshold", "machines_named")
WHEELS: tuple[Literal["driver", "driven"], ...] = ("driver", "driven")
BEARING = (0.3, 1.0, 3.0)
ERROR = 0.02
"""Relative error of the stated speed within which the mesh is sought."""
HINTS = {"crack": "tooth", "spall": "tooth", "pitch": "tooth", "eccentric": "eccentric"}


@dataclass
class Course:
    """A machine and what is known of its wheels."""

    machine: GearMachine
    healthy: GearMachine
    state: GearsState

    def judge(self, blocks: Iterable[int], *, learning: bool = False, bearing: float = 0.0) -> list[GearsOutput]:
        """Return what is said of each block, the state carried on; ``bearing`` as ``GearMachine.block`` takes it."""
        found: list[GearsOutput] = []
        gears = self.machine.settings
        for number in blocks:
            samples = self.machine.block(number, self.healthy, bearing)
            rotation = angle_of_mesh(samples, RATE, self.machine.speed, ERROR, gears)
            wheels = readings_of(samples, RATE, rotation, gears)
            given = GearsInput(number, wheels, self.machine.speed, None, learning)
            self.state, said = step(self.state, given, gears, RULES)
            found.append(said)
        return found


def learned(seed: int) -> Course:
    """Return a machine after the blocks that are learned."""
    machine = GearMachine(seed)
    course = Course(machine, machine, GearsState())
    course.judge(range(LEARNED), learning=True)
    return course


def healthy_counts(seed: int) -> Counter[str]:
    """Return what is counted of one healthy machine."""
    outputs = learned(seed).judge(range(1000, 1000 + HEALTHY_BLOCKS))
    found = _counts(outputs)
    found.update(f"wheel {wheel.status}" for output in outputs for wheel in output.wheels.values())
    return found


def _counts(outputs: Sequence[GearsOutput]) -> Counter[str]:
    return Counter(
        {
            "machines": 1,
            "blocks": len(outputs),
            "judged": sum(bool(output.scores) for output in outputs),
            "above_threshold": sum(max(output.scores.values(), default=0.0) > 1.0 for output in outputs),
            "machines_named": int(any(output.named for output in outputs)),
        }
    )


def healthy_rows(machines: Iterable[Counter[str]]) -> list[Row]:
    """Return false alarms of healthy machines."""
    found = sum(machines, Counter[str]())
    withheld = {name.removeprefix("wheel "): n for name, n in sorted(found.items()) if name.startswith("wheel ")}
    row: dict[str, float | int | str] = {name: found[name] for name in COUNTED}
    row["per_1000"] = 1000.0 * found["above_threshold"] / max(1, found["judged"])
    row["withheld"] = ", ".join(f"{name} {n}" for name, n in withheld.items() if name != "ok") or "-"
    return [row]


def damaged_counts(seed: int) -> dict[tuple[str, float], Counter[str]]:
    """Return what is counted of one machine by damage: with a damaged bearing, then with each damage of a wheel."""
    course = learned(seed)
    found: dict[tuple[str, float], Counter[str]] = {}
    for place, level in enumerate(BEARING):
        first = 3000 + 100 * place
        beside = Course(course.machine, course.healthy, course.state)
        found["bearing", level] = _counts(beside.judge(range(first, first + DAMAGED_BLOCKS), bearing=level))
    for kind, sizes in SIZES.items():
        for size, wheel in itertools.product(sizes, WHEELS):
            damaged = GearMachine(seed, Fault(wheel, kind, size))
            outputs = Course(damaged, course.machine, course.state).judge(range(2000, 2000 + DAMAGED_BLOCKS))
            last = outputs[-1]
            counted = Counter(
                {
                    "cases": 1,
                    "right_wheel": int(last.named == wheel),
                    "other_wheel": int(last.named not in (None, wheel)),
                    "kind_right": int(last.named == wheel and last.kind == HINTS[kind]),
                    "blocks_above": sum(output.scores.get(wheel, 0.0) > 1.0 for output in outputs),
                    "blocks": len(outputs),
                }
            )
            found[kind, size] = found.get((kind, size), Counter()) + counted
    return found


def damaged_rows(machines: Iterable[dict[tuple[str, float], Counter[str]]]) -> tuple[list[Row], list[Row]]:
    """Return false names beside a damaged bearing by its level, and right names by kind and size of damage."""
    total: dict[tuple[str, float], Counter[str]] = {}
    for one in machines:
        for key, counted in one.items():
            total[key] = total.get(key, Counter()) + counted
    bearing: list[Row] = []
    wheels: list[Row] = []
    for (kind, size), found in total.items():
        if kind == "bearing":
            bearing.append({"bearing_over_gears": size, **{name: found[name] for name in COUNTED}})
            continue
        share = found["blocks_above"] / found["blocks"]
        counts = {name: found[name] for name in ("cases", "right_wheel", "other_wheel", "kind_right")}
        wheels.append({"kind": kind, "size": size, **counts, "share_of_blocks_above": share})
    return bearing, wheels


def rig_rows() -> list[Row]:
    """Return what is named on the simulated rig, whose faults of wheels have the sizes of real teeth."""
    driver, driven = RIG_TEETH
    wheels = (GearWheel("driver", driver, 1.0), GearWheel("driven", driven, driver / driven))
    gears = GearSettings(wheels, (GearPairing("driver", "driven"),))

    def judged(state: GearsState, options: str, first: int, count: int) -> tuple[GearsState, list[GearsOutput]]:
        url = f"rig:ferrara?seed={RIG_SEED}&healthy_blocks=200&blocks=210&gear={driver}/{driven}&gear_db=20{options}"
        found: list[GearsOutput] = []
        for number, block in enumerate(itertools.islice(open_rig(url, "rig"), first, first + count), start=1):
            if isinstance(block, Rejected):
                continue
            samples, speed = block.samples[0].astype(np.float64), block.speed or RIG_SPEED
            rotation = angle_of_mesh(samples, block.rate, speed, ERROR, gears)
            given = GearsInput(number, readings_of(samples, block.rate, rotation, gears), speed, learning=first == 0)
            state, said = step(state, given, gears, RULES)
            found.append(said)
        return state, found

    state, _ = judged(GearsState(), "", 0, LEARNED)
    rows: list[Row] = []
    for fault, size in (("none", 0.0), *itertools.product(RIG_FAULTS, RIG_SIZES)):
        options = "" if fault == "none" else f"&gear_fault={fault}&gear_fault_size={size}"
        outputs = judged(state, options, LEARNED, RULES.persist_blocks + 1)[1]
        last = outputs[-1]
        rows.append(
            {
                "fault": fault,
                "size": size,
                "named": last.named,
                "kind": last.kind,
                "score_driver": max(output.scores.get("driver", 0.0) for output in outputs),
                "score_driven": max(output.scores.get("driven", 0.0) for output in outputs),
            }
        )
    return rows


def angle_rows(seeds: Iterable[int]) -> list[Row]:
    """Return how well the mesh gives the angle of the shaft, and the processor time of the parts."""
    errors: list[float] = []
    stated: list[float] = []
    spent = np.zeros(2)
    blocks = 0
    for seed, number in itertools.product(seeds, range(5000, 5005)):
        machine = GearMachine(seed)
        samples = machine.block(number)
        begun = time.process_time()
        rotation = angle_of_mesh(samples, RATE, machine.speed, ERROR, machine.settings)
        found = time.process_time()
        readings_of(samples, RATE, rotation, machine.settings)
        spent += found - begun, time.process_time() - found
        blocks += 1
        if rotation is None:
            continue
        off = rotation.turns_at(np.arange(samples.size) / RATE) - machine.turns(number)
        tooth = 2.0 * np.pi * machine.teeth[0]
        errors.append(float(np.std(off)) * tooth)
        stated.append(rotation.turns_sd * tooth)
    return [
        {
            "blocks": blocks,
            "found": len(errors),
            "error_rad_median": statistics.median(errors),
            "error_rad_max": max(errors),
            "stated_sd_rad_median": statistics.median(stated),
            "angle_ms": 1e3 * float(spent[0]) / blocks,
            "averages_ms": 1e3 * float(spent[1]) / blocks,
        }
    ]


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description="Naming of damaged wheels.")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--quick", action="store_true", help="a few machines of the training seeds")
    parser.add_argument("--training", type=int, metavar="N", help="so many machines of the training seeds")
    parser.add_argument("--angle", action="store_true", help="error of the angle and cost alone, training seeds")
    parser.add_argument("--rig", action="store_true", help="the simulated rig alone")
    options = parser.parse_args()
    if options.rig:
        rows = rig_rows()
        print_table("On the simulated rig", rows)
        write_json(options.json, {"rig": rows})
        return
    if options.angle:
        rows = angle_rows(TRAINING[:10])
        print_table("Angle by the mesh, phase at the first mesh line", rows)
        write_json(options.json, {"angle": rows})
        return
    count = 2 if options.quick else options.training
    healthy = HEALTHY if count is None else TRAINING[:count]
    damaged = DAMAGED if count is None else TRAINING[: max(1, count // 3)]
    tables: dict[str, list[Row] | Row] = {
        "settings": {
            "block_s": BLOCK_S,
            "rate_hz": RATE,
            "learned_blocks": LEARNED,
            "false_alarms_per_1000_blocks": RULES.false_alarms_per_1000_blocks,
            "persist_blocks": RULES.persist_blocks,
            "hints": ", ".join(KINDS),
            "seeds": f"{healthy.start} to {healthy.stop - 1}, {damaged.start} to {damaged.stop - 1}",
        },
    }
    with ProcessPoolExecutor(2) as pool:
        later = list(pool.map(damaged_counts, damaged))
        tables["healthy"] = rows = healthy_rows(pool.map(healthy_counts, healthy))
    print_table("1. Healthy machines", rows)
    tables["bearing"], tables["damaged"] = bearing, wheels = damaged_rows(later)
    print_table("2. A damaged bearing beside healthy wheels", bearing)
    print_table("3. Damaged wheels", wheels)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
