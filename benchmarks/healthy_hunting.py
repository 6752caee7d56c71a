"""Onsets of healthy machines whose speed hunts and whose load steps, and the delay of real ones.

Run as ``python -m benchmarks.healthy_hunting [--quick] [--json FILE]``. Machines are those of
``benchmarks.hunting_machines``, of held-out seeds. Tables:

1. false alarms over 20,000 healthy blocks at constant speed and load and under hunting and load steps, with levels
   relative to their learned dependence (``levels_by`` "auto") and as they are ("none");
2. blocks from the beginning of damage that grows to its detection, by the same;
3. the surrogate against 200 blocks of the model six_dof with a wavy race: mean speeds within ±20 %, hunting by ±5 %
   within each block, two loads, taken through the features over the angle: how RMS and lines follow the conditions, and
   what the learned dependence leaves, learned on the first half and judged on the second.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.hunting_machines import LOAD, MOMENTS, SPEED, Duty, HuntingMachine
from models.machine.bearing import kinematics
from models.machine.scene import Scene, Waviness
from models.machine.speed_profile import hunt
from models.solve.simulate import simulate
from monitor.health import onset as detect
from monitor.health.channel import ChannelBlock, detect_input
from monitor.health.onset.dependence import condition_of, learn_dependence
from monitor.health.signal.condition import Quantity
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.signal.quality import Verdict
from monitor.health.signal.rotation.rotation import Rotation
from tests.support.signals import record_of

HELD_OUT_SEED = 20261125
"""Judged once. The constants were set with seed 1 in view; 20261124, judged before, showed one false alarm, after which
the margin beyond the learned speeds was narrowed."""
DUTIES = {
    "constant": Duty(),
    "±5 %": Duty(0.05),
    "±10 %": Duty(0.10),
    "±20 %": Duty(0.20),
    "load steps": Duty(steps=True),
    "±5 %, load steps": Duty(0.05, steps=True),
    "±10 %, load steps": Duty(0.10, steps=True),
    "±20 %, load steps": Duty(0.20, steps=True),
}
METHODS: tuple[detect.LevelsBy, ...] = ("auto", "none")
BLOCKS, MACHINES = 800, 50
ONSET, GROWN = 400, 300
RATE, SECONDS, BAND = 25600.0, 2.0, (500.0, 10000.0)


@dataclass
class Course:
    """What the detector said of a machine."""

    judged: int = 0
    over: int = 0
    outside: int = 0
    learned: int = 0
    alarm: int | None = None


def follow(blocks: Sequence[detect.DetectInput], settings: detect.DetectSettings) -> Course:
    """Take blocks through the detector until it tells an onset."""
    state, found = detect.DetectState(), Course()
    for block in blocks:
        state, output = detect.step(state, block, settings)
        found.learned += output.stage == detect.LEARNING
        found.judged += output.score is not None
        found.outside += output.outside
        found.over += output.score is not None and output.score > output.threshold
        if output.alarm:
            found.alarm = block.sequence
            break
    return found


def drawn(seed: int, machines: int) -> Iterator[tuple[HuntingMachine, np.random.Generator]]:
    """Yield machines with the random numbers of their course: the same for each duty and method."""
    for number in range(machines):
        rng = np.random.default_rng([seed, number])
        yield HuntingMachine.draw(rng), rng


def healthy_table(seed: int, machines: int) -> list[Row]:
    """Table 1."""
    rows: list[Row] = []
    for name, duty in DUTIES.items():
        blocks = [machine.blocks(rng, duty, BLOCKS) for machine, rng in drawn(seed, machines)]
        for method in METHODS:
            settings = detect.DetectSettings(levels_by=method)
            courses = [follow(one, settings) for one in blocks]
            judged, alarms = sum(one.judged for one in courses), sum(one.alarm is not None for one in courses)
            # Poisson's upper limit at 95 %; exact without an event.
            upper = 3.0 if alarms == 0 else alarms + 1.645 * math.sqrt(alarms) + 1.5
            rows.append(
                {
                    "duty": name,
                    "levels_by": method,
                    "machines": machines,
                    "learning, blocks (median)": float(np.median([one.learned for one in courses])),
                    "healthy blocks judged": judged,
                    "not judged: outside": sum(one.outside for one in courses),
                    "over, per 1000": 1e3 * sum(one.over for one in courses) / judged,
                    "false alarms": alarms,
                    "per 1000": 1e3 * alarms / judged,
                    "at most": 1e3 * upper / judged,
                }
            )
    return rows


def growth_table(seed: int, machines: int) -> list[Row]:
    """Table 2: from block 400 on, ln RMS grows by ln 4 in 300 blocks; the outer race's lines by twice that, or not."""
    growth = np.concatenate((np.zeros(ONSET), np.linspace(0.0, math.log(4.0), GROWN)))
    rows: list[Row] = []
    for (name, duty), lines in product(DUTIES.items(), (2.0, 0.0)):
        blocks = [machine.blocks(rng, duty, ONSET + GROWN, growth, lines) for machine, rng in drawn(seed, machines)]
        for method in METHODS:
            courses = [follow(one, detect.DetectSettings(levels_by=method)) for one in blocks]
            counts = Counter("missed" if c.alarm is None else "late" if c.alarm > ONSET else "early" for c in courses)
            delays = [c.alarm - ONSET for c in courses if c.alarm is not None and c.alarm > ONSET]
            rows.append(
                {
                    "duty": name,
                    "grows": "RMS and lines" if lines else "RMS",
                    "levels_by": method,
                    "machines": machines,
                    "false before": counts["early"],
                    "found": counts["late"],
                    "missed": counts["missed"],
                    "blocks after (median)": float(np.median(delays)) if delays else None,
                    "90 %": float(np.quantile(delays, 0.9)) if delays else None,
                }
            )
    return rows


def model_blocks(seed: int, count: int) -> list[detect.DetectInput]:
    """Return blocks of six_dof: a wavy outer race, hunting speeds and two loads, in noise of half the level."""
    rng = np.random.default_rng(seed)
    orders = range(2, 41)
    waves = tuple(
        Waviness(2e-6 / order * float(rng.uniform(0.5, 1.5)), order, "outer", float(rng.uniform(0.0, 2.0 * math.pi)))
        for order in orders
    )
    found: list[detect.DetectInput] = []
    for number in range(count):
        speed = SPEED * (1.0 + 0.2 * math.sin(2.0 * math.pi * rng.uniform()))
        load = LOAD * float(rng.choice((0.6, 1.0)))
        profile = hunt(speed, 0.05, float(rng.uniform(0.3, 1.0)), SECONDS, phase=float(rng.uniform(0.0, 2.0 * math.pi)))
        scene = Scene(speed=speed, load=load, waviness=waves, speed_profile=profile)
        signal = record_of(simulate(scene, duration=SECONDS, rate=RATE)).of()
        time, turns, speeds = (np.array(values) for values in (profile.time, profile.turns, profile.speed))
        rotation = Rotation(time, turns, speeds, SECONDS)
        noise = 0.15 * (speed / SPEED) ** 1.5 * rng.standard_normal(signal.size)
        samples = ((signal + noise) * np.exp(0.025 * rng.standard_normal())).astype(np.float32)
        mean = rotation.mean_speed
        lines = fundamentals(kinematics(scene.bearing, mean))
        asked = FeatureSettings(RATE, (BAND,), lines, speed=mean, speed_sd=0.0, rotation=rotation)
        stated = Quantity(mean, "tacho"), Quantity(load, "channel")
        block = ChannelBlock(samples, RATE, number + 1, 10.0 * number, Verdict(), *stated, rotation=rotation)
        found.append(detect_input(block_features(samples, RATE, asked), block, absolute=True, usable=True))
    return found


def surrogate_blocks(seed: int, count: int) -> list[detect.DetectInput]:
    """Return blocks of one surrogate machine at such conditions, without drift, run-in and knocks."""
    rng = np.random.default_rng(seed)
    machine = HuntingMachine.draw(rng)
    still = replace(machine.levels, drift=0.0, scatter=0.025, burst_rate=0.0, run_in=0.0)
    machine = replace(machine, levels=still, period=math.e, dwell=1.0)
    blocks = machine.blocks(rng, Duty(0.2, steps=True), count * MOMENTS)[::MOMENTS]
    return [replace(block, sequence=number + 1) for number, block in enumerate(blocks)]


def check_row(what: str, blocks: Sequence[detect.DetectInput]) -> Row:
    """Return how the levels of blocks follow speed and load, and what the dependence leaves of the second half."""
    row: dict[str, float | int | str | None] = {"blocks of": what, "blocks": len(blocks)}
    conditions = [condition_of(block.speed, block.speed_range, block.load) for block in blocks]
    half = len(blocks) // 2
    for name in ("rms", *detect.LINES):
        values = [block.rms if name == "rms" else block.prominence.get(name, 0.0) for block in blocks]
        if min(values) <= 0.0:
            continue
        ln = np.log(values)
        if name == "rms":
            speed = np.array([math.log(block.speed or math.nan) for block in blocks])
            load = np.array([math.log(block.load or math.nan) for block in blocks])
            powers, *_ = np.linalg.lstsq(np.stack((speed, load, np.ones_like(ln)), axis=1), ln, rcond=None)
            row |= {"power of speed": float(powers[0]), "of load": float(powers[1])}
        found = learn_dependence(ln[:half].tolist(), conditions[:half], ("speed", "load"), always=True)
        assert found is not None
        shapes = [found.at(condition) for condition in conditions]
        left = np.array([v - s[0] for v, s in zip(ln[half:], shapes[half:], strict=True) if s is not None])
        row |= {f"sd of ln {name}": float(np.std(ln)), f"{name}, left": float(np.std(left))}
        if name == "rms":
            row["not predicted"] = float(sum(shape is None for shape in shapes[half:]))
    return row


def check_table(*, quick: bool) -> list[Row]:
    """Table 3."""
    count = 40 if quick else 200
    machines = 2 if quick else 10
    rows = [check_row("six_dof", model_blocks(HELD_OUT_SEED, count))]
    surrogates = [check_row("", surrogate_blocks(HELD_OUT_SEED + 1 + i, count)) for i in range(machines)]
    numbers = [key for key, value in surrogates[0].items() if isinstance(value, float)]
    for word, level in (("least", 0.0), ("median", 0.5), ("highest", 1.0)):
        values = {key: float(np.quantile([float(row[key] or 0.0) for row in surrogates], level)) for key in numbers}
        rows.append(
            {**dict.fromkeys(rows[0]), "blocks of": f"{machines} surrogates, {word}", "blocks": count, **values}
        )
    return rows


def main() -> None:
    """Run, print, write."""
    options = arguments("Healthy machines under hunting speed and load steps.")
    machines = 4 if options.quick else MACHINES
    seed = 1 if options.quick else HELD_OUT_SEED
    tables = {
        "healthy": healthy_table(seed, machines),
        "growth": growth_table(seed + 1, machines),
        "check": check_table(quick=options.quick),
    }
    print_table("1. Healthy machines", tables["healthy"])
    print_table("2. Damage that grows", tables["growth"])
    print_table("3. The surrogate and the model", tables["check"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
