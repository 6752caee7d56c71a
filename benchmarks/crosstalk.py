"""Two bearings on one shaft, each with its sensor: whose damage is it?

Run as ``python -m benchmarks.crosstalk [--quick] [--json FILE]``. Each machine draws its bearings (a third of the
machines has two of one type, half of these with the same slip), the shaft speed, the damaged part of each bearing, the
bands of the sensors and what reaches the other sensor: a share of 0.05 to 0.5 at the resonance that impacts excite,
through a low-pass. After the learning, impacts grow from a tenth of the noise to thirty times it in 60 blocks of 5 s,
at the neighbour, at the bearing itself, at both (the own ones begin up to 20 blocks later), or nowhere. The same
samples go through all stages with and without the comparison of the sensors. Tables: what is said of the bearing
(``b``) after the last block, and of the neighbour that only hears ``b``. The first table has the processor time of a
block.

``--quick`` takes a few machines of another seed, on which the constants were tried.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, interleaved_ms, print_table, write_json
from models.machine.bearing import Kinematics
from monitor.health import onset as detect
from monitor.health.name.evidence import parts_of
from monitor.health.name.machine import BearingVerdict
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.waterfall import WaterfallSettings
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from monitor.health.step import step
from streams.block import Block
from tests.support.signals import RESONANCE, HealthyMachine, bearing_lines, impacts

HELD_OUT_SEED, TRIED_SEED = 20261124, 1
MACHINES = 40
RATE, SECONDS = 12800.0, 5.0
HEALTHY, DAMAGED, LATEST_BEGIN = 135, 60, 20
FIRST, LAST = 0.1, 30.0
BEARINGS = ("6205", "6206", "6305", "22207", "1205 ETN9", "PRONOSTIA")
BANDS = ((500.0, 6000.0), (2000.0, 6300.0), (1000.0, 4500.0))
PARTS = ("outer", "inner", "ball")
SCENES = {"neighbour": (True, False), "own": (False, True), "both": (True, True), "none": (False, False)}
Samples = NDArray[np.float64]
EACH_ALONE = partial(mock.patch, "monitor.health.step.beside_neighbours", lambda views, analysed: dict(analysed))


@dataclass(frozen=True, eq=False)
class TwoBearings:
    """A machine: of bearings ``a`` and ``b`` the types, lines, damaged parts, slips, bands; and what crosses over.

    Attributes:
        gains: share of the impacts of ``a`` at the sensor of ``b``, and the other way, at the resonance.
        corners: of the low-pass that they go through, Hz.
        begins: block of the damage from which each grows.
    """

    types: tuple[str, str]
    speed: float
    parts: tuple[str, str]
    slips: tuple[float, float]
    bands: tuple[tuple[float, float], tuple[float, float]]
    gains: tuple[float, float]
    corners: tuple[float, float]
    begins: tuple[int, int]

    @classmethod
    def draw(cls, rng: np.random.Generator, number: int) -> TwoBearings:
        """Draw a machine."""
        first, other = (str(name) for name in rng.choice(BEARINGS, 2, replace=False))
        alike, slip = number % 3 == 0, float(rng.uniform(0.0, 0.02))
        same_slip = slip + float(rng.uniform(-2e-4, 2e-4))
        band, other_band = (BANDS[int(i)] for i in rng.integers(0, len(BANDS), 2))
        low, high = np.exp(rng.uniform(np.log(0.05), np.log(0.5), 2)).tolist()
        part, other_part = (str(name) for name in rng.choice(PARTS, 2))
        return cls(
            (first, first if alike else other),
            float(rng.uniform(15.0, 45.0)),
            (part, other_part),
            (slip, same_slip if number % 6 == 0 else float(rng.uniform(0.0, 0.02))),
            (band, band if number % 2 else other_band),
            (low, high),
            (float(rng.uniform(2e3, 6e3)), float(rng.uniform(2e3, 6e3))),
            (0, int(rng.integers(0, LATEST_BEGIN + 1))),
        )

    def lines(self, place: int) -> Kinematics:
        """Return the lines of a bearing."""
        return bearing_lines(self.types[place], self.speed)[1]

    def damage(self, rng: np.random.Generator, place: int, block: int) -> Samples:
        """Return the impacts of a bearing in a block of the damage."""
        grown = (block - self.begins[place]) / (DAMAGED - 1)
        height = FIRST * (LAST / FIRST) ** grown if grown >= 0.0 else 0.0
        return impacts(
            rng,
            self.parts[place],
            self.lines(place),
            rate=RATE,
            duration=SECONDS,
            height=height,
            noise=0.0,
            slip=self.slips[place],
            jitter=0.003,
        )

    def crossed(self, x: Samples, place: int) -> Samples:
        """Return what reaches the sensor of the other bearing."""
        frequency = np.fft.rfftfreq(x.size, 1.0 / RATE)
        path = 1.0 / (1.0 + 1j * frequency / self.corners[place])
        at = abs(1.0 / (1.0 + 1j * RESONANCE / self.corners[place]))
        return np.fft.irfft(np.fft.rfft(x) * path * (self.gains[place] / at), x.size)

    def settings(self) -> SourceSettings:
        """Return the source."""
        channels = {
            name: ChannelSettings(
                name,
                bearing_lines(self.types[place], self.speed)[0],
                listens_to=name,
                bands=(self.bands[place],),
                condition=ConditionSettings(speed=self.speed),
                detect=detect.DetectSettings(),
                waterfall=WaterfallSettings(rows=0),
            )
            for place, name in enumerate("ab")
        }
        return SourceSettings("machine", channels, RATE)


@dataclass(frozen=True)
class Said:
    """What is said of a bearing after the last block, and which feature led its onset."""

    verdict: BearingVerdict
    known: int | None
    led_by: str | None

    def words(self, part: str | None) -> str:
        """Judge it; ``part`` is damaged, None: none is."""
        parts = parts_of(self.verdict.fault)
        if self.verdict.fault is not None and self.verdict.basis == "verdict":
            return "named" if part in parts else "named wrongly"
        if self.verdict.fault is not None:
            return "hint" if part in parts else "hint wrongly"
        if self.known is None:
            return "nothing"
        return "onset" if self.verdict.level_of is None else "level of the other"


def block_of(samples: NDArray[np.floating], sequence: int) -> Block:
    """Return a block of both channels, (channel, sample)."""
    return Block(
        samples=samples.astype(np.float32),
        rate=RATE,
        channels=("a", "b"),
        units=("m/s2", "m/s2"),
        source="machine",
        sequence=sequence,
        name=str(sequence),
        elapsed=300.0 * sequence,
        content_hash=str(sequence),
    )


def follow(state: SourceState, blocks: list[Block], settings: SourceSettings) -> dict[str, Said]:
    """Take blocks through all stages; return what is said of each bearing."""
    led: dict[str, tuple[int, str]] = {}
    bearings: dict[str, BearingVerdict] = {}
    for block in blocks:
        state, output = step(state, block, settings)
        bearings = dict(output.bearings)
        for event in output.record.events:
            if event["kind"] == "final_stage":
                led.setdefault(event["channel"], (block.sequence - HEALTHY, event["feature"]))
    return {name: Said(verdict, *led.get(name, (None, None))) for name, verdict in bearings.items()}


def examine(machine: TwoBearings, rng: np.random.Generator) -> dict[tuple[str, str], dict[str, Said]]:
    """Return by scene and rule what is said of the bearings of a machine."""
    settings = machine.settings()
    healthy = [HealthyMachine.draw(rng, machine.speed, machine.lines(place).bpfo) for place in (0, 1)]
    levels = [one.levels(rng, HEALTHY + DAMAGED) for one in healthy]
    n = round(RATE * SECONDS)

    def quiet(block: int) -> Samples:
        own = [one.block(rng, float(level[block]), RATE, n) for one, level in zip(healthy, levels, strict=True)]
        return np.stack(own)

    state = SourceState.begin(settings)
    for i in range(HEALTHY):
        state, _ = step(state, block_of(quiet(i), i + 1), settings)
    begun = state
    blocks: dict[str, list[Block]] = {scene: [] for scene in SCENES}
    for i in range(DAMAGED):
        base = quiet(HEALTHY + i)
        damage = [machine.damage(rng, place, i) for place in (0, 1)]
        sent = [machine.crossed(x, place) for place, x in enumerate(damage)]
        for scene, present in SCENES.items():
            x = base.copy()
            for place in (0, 1):
                if present[place]:
                    x[place] += damage[place]
                    x[1 - place] += sent[place]
            blocks[scene].append(block_of(x, HEALTHY + i + 1))
    found: dict[tuple[str, str], dict[str, Said]] = {}
    for scene, given in blocks.items():
        found[scene, "sensors compared"] = follow(begun, given, settings)
        with EACH_ALONE():
            found[scene, "each alone"] = follow(begun, given, settings)
    return found


def cost(rounds: int) -> list[Row]:
    """Return what a block of two sensors takes, ms, with and without the comparison."""
    rows: list[Row] = []
    for scene in ("none", "neighbour"):
        rng = np.random.default_rng(TRIED_SEED)
        machine = replace(TwoBearings.draw(rng, 1), parts=("outer", "outer"), gains=(0.3, 0.3))
        settings = machine.settings()
        x = rng.standard_normal((2, round(RATE * SECONDS)))
        if scene == "neighbour":
            damage = machine.damage(rng, 0, DAMAGED - 1)
            x += np.stack([damage, machine.crossed(damage, 0)])
        block, begun = block_of(x, HEALTHY), SourceState.begin(settings)
        learned = detect.Baseline(0.0, 0.1, dict.fromkeys(detect.LINES, (0.3, 0.1)))
        known = detect.DetectState(seen=HEALTHY, baseline=learned)
        channels = {name: replace(channel, detect=known) for name, channel in begun.channels.items()}
        state = replace(begun, channels=channels)

        def alone(state: SourceState = state, block: Block = block, settings: SourceSettings = settings) -> object:
            with EACH_ALONE():
                return step(state, block, settings)

        def compared(state: SourceState = state, block: Block = block, settings: SourceSettings = settings) -> object:
            return step(state, block, settings)

        rows.append({"damaged": scene, **interleaved_ms({"each alone": alone, "compared": compared}, rounds)})
    return rows


WORDS = ("named", "hint", "onset", "level of the other", "nothing", "named wrongly", "hint wrongly")


def tables(machines: int, seed: int) -> tuple[list[Row], list[Row]]:
    """Return the counts by scene and rule, and a row a machine."""
    counts: dict[tuple[str, str, str], Counter[str]] = {}
    each: list[Row] = []
    for number in range(machines):
        rng = np.random.default_rng([seed, number])
        machine = TwoBearings.draw(rng, number)
        row: dict[str, float | int | str | None] = {
            "machine": number,
            "types": " ".join(machine.types) + (" same slip" if number % 6 == 0 else ""),
            "parts": " ".join(machine.parts),
            "gains": " ".join(f"{gain:.2f}" for gain in machine.gains),
        }
        for (scene, rule), said in examine(machine, rng).items():
            for place, name in enumerate("ab"):
                part = machine.parts[place] if SCENES[scene][place] else None
                words = said[name].words(part)
                counts.setdefault((scene, name, rule), Counter())[words] += 1
                known = f" ({said[name].known}, {said[name].led_by})" if said[name].known is not None else ""
                row[f"{scene}: {name}, {rule}"] = words + known
        each.append(row)
    rows: list[Row] = [
        {
            "damaged": scene,
            "said of": name,
            "rule": rule,
            "machines": sum(found.values()),
            **{word: found[word] for word in WORDS},
        }
        for (scene, name, rule), found in counts.items()
    ]
    return rows, each


def main() -> None:
    """Print the tables."""
    asked = arguments(__doc__ or "")
    machines, seed = (12, TRIED_SEED) if asked.quick else (MACHINES, HELD_OUT_SEED)
    costs = cost(20 if asked.quick else 200)
    print_table("a block of two sensors, ms of processor time", costs)
    rows, each = tables(machines, seed)
    print_table(f"two bearings, {machines} machines, seed {seed}", rows)
    if asked.json:
        write_json(
            asked.json,
            {"machines": rows, "each": each, "cost_ms": costs, "drawn": {"seed": seed, "machines": machines}},
        )


if __name__ == "__main__":
    main()
