"""Naming of damaged wheels: false alarms of healthy geared machines, detection by kind and size of damage.

The machines are those of ``benchmarks/gear_machines.py``; no pulse is given, so that the angle comes from the mesh. Of
each machine the blocks of a baseline are learned, then healthy blocks are judged, and of the damaged seeds the blocks
after each damage begins. ``--training`` takes seeds on which constants may be fitted; without it the judged ones, which
were set aside before.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.common import Row, print_table, write_json
from benchmarks.gear_machines import BLOCK_S, DAMAGED, HEALTHY, RATE, SIZES, TRAINING, Fault, GearMachine
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
from monitor.health.gears.stage import readings_of

RULES = GearNamingSettings()
LEARNED = 2 * MIN_LEARNED
HEALTHY_BLOCKS, DAMAGED_BLOCKS = 50, 2 * RULES.persist_blocks
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


def healthy_rows(seeds: Iterable[int]) -> list[Row]:
    """Return false alarms of healthy machines."""
    machines = named = blocks = judged = above = 0
    statuses: Counter[str] = Counter()
    spent = time.process_time()
    for seed in seeds:
        outputs = learned(seed).judge(range(1000, 1000 + HEALTHY_BLOCKS))
        machines += 1
        named += any(output.named for output in outputs)
        blocks += len(outputs)
        judged += sum(bool(output.scores) for output in outputs)
        above += sum(max(output.scores.values(), default=0.0) > 1.0 for output in outputs)
        statuses.update(wheel.status for output in outputs for wheel in output.wheels.values())
    spent = (time.process_time() - spent) / max(1, blocks + machines * LEARNED)
    return [
        {
            "machines": machines,
            "blocks": blocks,
            "judged": judged,
            "above_threshold": above,
            "per_1000": 1000.0 * above / max(1, judged),
            "machines_named": named,
            "withheld": ", ".join(f"{name} {count}" for name, count in sorted(statuses.items()) if name != "ok") or "-",
            "ms_per_block_with_the_signal": 1e3 * spent,
        }
    ]


def bearing_rows(seeds: Iterable[int]) -> list[Row]:
    """Return false names of wheels of machines with a damaged bearing, by the level of its impacts."""
    courses = [learned(seed) for seed in seeds]
    rows: list[Row] = []
    for place, level in enumerate(BEARING):
        outputs = [
            Course(course.machine, course.healthy, course.state).judge(
                range(3000 + 100 * place, 3000 + 100 * place + DAMAGED_BLOCKS), bearing=level
            )
            for course in courses
        ]
        said = [output for machine in outputs for output in machine]
        rows.append(
            {
                "bearing_over_gears": level,
                "machines": len(courses),
                "blocks": len(said),
                "judged": sum(bool(output.scores) for output in said),
                "above_threshold": sum(max(output.scores.values(), default=0.0) > 1.0 for output in said),
                "machines_named": sum(any(output.named for output in machine) for machine in outputs),
            }
        )
    return rows


def damaged_rows(seeds: Iterable[int]) -> list[Row]:
    """Return by kind and size of damage how many machines get the right name."""
    courses = [learned(seed) for seed in seeds]
    rows: list[Row] = []
    for kind, sizes in SIZES.items():
        for size in sizes:
            right = wrong = hints = blocks = 0
            for course, wheel in itertools.product(courses, ("driver", "driven")):
                damaged = GearMachine(course.machine.seed, Fault(wheel, kind, size))
                outputs = Course(damaged, course.machine, course.state).judge(range(2000, 2000 + DAMAGED_BLOCKS))
                last = outputs[-1]
                right += last.named == wheel
                wrong += last.named not in (None, wheel)
                hints += last.named == wheel and last.kind == HINTS[kind]
                blocks += sum(output.scores.get(wheel, 0.0) > 1.0 for output in outputs)
            cases = 2 * len(courses)
            rows.append(
                {
                    "kind": kind,
                    "size": size,
                    "cases": cases,
                    "right_wheel": right,
                    "other_wheel": wrong,
                    "kind_right": hints,
                    "blocks_above": blocks / (cases * DAMAGED_BLOCKS),
                }
            )
    return rows


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description="Naming of damaged wheels.")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--quick", action="store_true", help="a few machines of the training seeds")
    parser.add_argument("--training", type=int, metavar="N", help="so many machines of the training seeds")
    options = parser.parse_args()
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
    tables["healthy"] = rows = healthy_rows(healthy)
    print_table("1. Healthy machines", rows)
    tables["bearing"] = rows = bearing_rows(damaged)
    print_table("2. A damaged bearing beside healthy wheels", rows)
    tables["damaged"] = rows = damaged_rows(damaged)
    print_table("3. Damaged wheels", rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
