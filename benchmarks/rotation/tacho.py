"""Error of the angle that is found from pulses: marks a turn, faults of the pulses, shafts of varying speed.

Run as ``python -m benchmarks.rotation.tacho [--quick] [--json FILE]``. The pulses are those of shafts of known angle,
in blocks of 5 s: one speed, run-ups from 10 to 40 Hz in 5, 20 and 60 s, speeds that hunt by 5, 10 and 20 %. Each fault
is put on every shaft with seeds (``HELD_OUT``) that were set before the constants of
``monitor/health/signal/rotation``. Errors of the angle are without their mean: where a block begins on the shaft is not
known. The second table reads the pulses from a channel; the third is the processor time of a block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, interleaved_ms, print_table, write_json
from models.machine.speed_profile import SpeedProfile, hunt, ramp
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.rotation.rotation import TachoSettings
from monitor.health.signal.rotation.shaft_angle import FoundRotation, find_rotation
from streams.turns.pulses import Pulses
from streams.types.block import Block

HELD_OUT = 9000
"""First of the seeds; ``--quick`` takes those from 0 on, with which the constants were chosen."""
BLOCKS = 6
"""Seeds of each fault on each shaft."""
SECONDS, RATE = 5.0, 25_600.0
MARKS = (1, 4, 16, 60, 256, 1024)
MISSING_TEETH = {60: 2}
_CHECKED = np.linspace(0.0, SECONDS, 4001)


@dataclass(frozen=True)
class Fault:
    """What is wrong with pulses.

    Attributes:
        missing: share of pulses that do not come.
        doubled: share of pulses after which another one comes before the next.
        jitter: standard deviation of their times, s.
        encoder: rms of the error of the marks, degrees: an eccentricity, and a tenth of it at random.
    """

    missing: float = 0.0
    doubled: float = 0.0
    jitter: float = 0.0
    encoder: float = 0.0


FAULTS = {
    "none": Fault(),
    "1 % missing": Fault(missing=0.01),
    "1 % doubled": Fault(doubled=0.01),
    "jitter 1 us": Fault(jitter=1e-6),
    "jitter 10 us": Fault(jitter=1e-5),
    "marks 0.1 deg": Fault(encoder=0.1),
    "missing and doubled": Fault(missing=0.01, doubled=0.01, jitter=1e-6),
    "all, 10 us": Fault(0.01, 0.01, 1e-5, 0.1),
    "5 % missing": Fault(missing=0.05, jitter=1e-6),
    "20 % missing": Fault(missing=0.2, jitter=1e-6),
}


def shafts() -> dict[str, SpeedProfile]:
    """Return the speeds over a block by name."""
    found = {"30 Hz": ramp(30.0, 30.0 + 1e-9, SECONDS), "10-40 Hz in 5 s": ramp(10.0, 40.0, SECONDS)}
    for seconds, begin in ((20.0, 0.0), (20.0, 10.0), (60.0, 0.0), (60.0, 30.0)):
        found[f"10-40 Hz in {seconds:.0f} s, from {begin:.0f} s"] = ramp(10.0, 40.0, seconds).part(begin, SECONDS)
    for share in (0.05, 0.1, 0.2):
        found[f"30 Hz, hunting {100.0 * share:.0f} %"] = hunt(30.0, share, 0.5, SECONDS)
    return found


def pulses_of(shaft: SpeedProfile, marks: int, fault: Fault, seed: int) -> NDArray[np.float64]:
    """Return the times of the pulses of a block, s."""
    rng = np.random.default_rng(seed)
    before, turned = rng.random(), float(shaft.turns_at(SECONDS)) - float(shaft.turns_at(0.0))
    numbers = np.arange(int(turned * marks) + 2)
    place = rng.integers(marks)
    error = np.sqrt(2.0) * np.sin(2.0 * np.pi * (np.arange(marks) / marks + rng.random()))
    error = fault.encoder / 360.0 * (error + 0.1 * rng.standard_normal(marks)) * (marks > 1)
    teeth = (numbers + place) % marks
    numbers, teeth = (x[teeth < marks - MISSING_TEETH.get(marks, 0)] for x in (numbers, teeth))
    turns = (numbers + before) / marks + error[teeth]
    times = shaft.time_at(turns[(turns > 0.0) & (turns < turned)] + float(shaft.turns_at(0.0)))
    lost, twice = rng.random(times.size) < fault.missing, rng.random(times.size) < fault.doubled
    step = np.diff(times, append=SECONDS)
    extra = times[twice] + rng.random(int(np.count_nonzero(twice))) * step[twice]
    times = times + fault.jitter * rng.standard_normal(times.size)
    times = np.sort(np.concatenate((times[~lost], extra)))
    return times[(times >= 0.0) & (times < SECONDS)]


@dataclass(frozen=True)
class Judged:
    """How far the angle of a block was off: revolutions, and both in stated standard deviations."""

    status: str
    rms: float = 0.0
    highest: float = 0.0
    angle: float = 0.0
    speed: float = 0.0


def judged(found: FoundRotation, shaft: SpeedProfile) -> Judged:
    """Compare the angle of a block with the true one."""
    if found.rotation is None:
        return Judged(str(found.status))
    true = shaft.turns_at(_CHECKED)
    away = found.rotation.turns_at(_CHECKED) - true
    drift = (away[-1] - away[0]) / (true[-1] - true[0])
    free = away - away.mean()
    left = free - np.polyval(np.polyfit(_CHECKED, free, 1), _CHECKED)
    return Judged(
        "ok",
        float(np.sqrt(np.mean(np.square(free)))),
        float(np.max(np.abs(free))),
        float(np.sqrt(np.mean(np.square(left)))) / max(found.rotation.turns_sd, 1e-9),
        abs(float(drift)) / max(found.rotation.speed_sd, 1e-9),
    )


def row_of(results: Sequence[Judged]) -> Row:
    """Return the errors of some blocks, and how many were refused."""
    ok = [result for result in results if result.status == "ok"]
    refused = sorted({result.status for result in results} - {"ok"})
    row: dict[str, float | int | str | None] = {"blocks": len(results), "refused": len(results) - len(ok)}
    row["as"] = ", ".join(refused)
    for name in ("rms", "highest", "angle", "speed"):
        row[name] = None
    if ok:
        row["rms"] = float(np.median([result.rms for result in ok]))
        row["highest"] = max(result.highest for result in ok)
        row["angle"] = float(np.mean([result.angle <= 2.0 for result in ok]))
        row["speed"] = float(np.mean([result.speed <= 2.0 for result in ok]))
    return row


def of_times(seeds: range) -> list[Row]:
    """Judge pulses whose times are given, by faults and marks, all shafts together; then by shafts, without a fault."""
    rows: list[Row] = []
    profiles = shafts()
    for name, fault in FAULTS.items():
        for marks in MARKS:
            settings = ConditionSettings(tacho=TachoSettings(None, None, marks, MISSING_TEETH.get(marks, 0)))
            results = [
                judged(find_rotation(_block(pulses_of(shaft, marks, fault, seed)), settings), shaft)
                for shaft in profiles.values()
                for seed in seeds
            ]
            rows.append({"fault": name, "marks": marks, **row_of(results)})
    return rows


def of_shafts(seeds: range) -> list[Row]:
    """Judge pulses with 1 us of jitter by the shaft, for one mark and for 256 a turn."""
    rows: list[Row] = []
    for name, shaft in shafts().items():
        for marks in (1, 256):
            settings = ConditionSettings(tacho=TachoSettings(per_revolution=marks))
            times = (pulses_of(shaft, marks, FAULTS["jitter 1 us"], seed) for seed in seeds)
            rows.append(
                {
                    "shaft": name,
                    "marks": marks,
                    **row_of([judged(find_rotation(_block(t), settings), shaft) for t in times]),
                }
            )
    return rows


def _block(times: NDArray[np.float64]) -> Block:
    return Block(
        np.zeros((1, round(SECONDS * RATE)), np.float32), RATE, ("x",), ("g",), "s", 1, "n", pulses=Pulses(times)
    )


Signal = Callable[[NDArray[np.float64], np.random.Generator], NDArray[Any]]
"""Samples of a channel at some turns of its wheel (marks passed)."""


def _filtered(samples: NDArray[Any]) -> NDArray[np.float64]:
    """Return what an anti-aliasing filter leaves of steps: a mean over three samples."""
    return np.convolve(samples, np.full(3, 1.0 / 3.0), mode="same")


SIGNALS: dict[str, Signal] = {
    "digital": lambda turns, _: (turns % 1.0 < 0.5) * 1.0,
    "keyphasor, noise 2 %": lambda turns, rng: (
        _filtered((turns % 1.0 < 0.1) * -5.0) - 8.0 + 0.1 * rng.standard_normal(turns.size)
    ),
    "pick-up, noise 2 %": lambda turns, rng: (
        np.gradient(turns) * (np.sin(2.0 * np.pi * turns) + 0.02 * rng.standard_normal(turns.size))
    ),
    "pick-up, noise 10 %": lambda turns, rng: (
        np.gradient(turns) * (np.sin(2.0 * np.pi * turns) + 0.1 * rng.standard_normal(turns.size))
    ),
    "keyphasor, drift": lambda turns, rng: (
        _filtered((turns % 1.0 < 0.1) * 5.0)
        + np.linspace(0.0, 8.0, turns.size)
        + 0.05 * rng.standard_normal(turns.size)
    ),
    "counter": lambda turns, _: np.floor(turns) % 65536.0,
}


def of_channels(seeds: range) -> list[Row]:
    """Judge pulses that are read from a channel at 25.6 kHz, by kind of signal and marks."""
    rows: list[Row] = []
    time = np.arange(round(SECONDS * RATE)) / RATE
    for name, signal in SIGNALS.items():
        for marks in (1, 4, 16) if name.startswith("keyphasor") else (1, 16, 60, 128):
            settings = ConditionSettings(tacho=TachoSettings("t", per_revolution=marks))
            results: list[Judged] = []
            for shaft in shafts().values():
                for seed in seeds[:2]:
                    rng = np.random.default_rng(seed)
                    samples = signal(shaft.turns_at(time) * marks + rng.random(), rng).astype(np.float32)
                    block = Block(samples[np.newaxis], RATE, ("t",), ("unknown",), "s", 1, "n")
                    results.append(judged(find_rotation(block, settings), shaft))
            rows.append({"signal": name, "marks": marks, **row_of(results)})
    return rows


def costs(rounds: int) -> list[Row]:
    """Return the processor time of the angle of a block of 128,000 samples, ms."""
    shaft, functions = shafts()["10-40 Hz in 5 s"], {}
    time = np.arange(round(SECONDS * RATE)) / RATE
    for name, marks in (("digital", 1), ("pick-up, noise 2 %", 1), ("digital", 60), ("counter", 60)):
        samples = SIGNALS[name](shaft.turns_at(time) * marks, np.random.default_rng(0)).astype(np.float32)
        block = Block(samples[np.newaxis], RATE, ("t",), ("unknown",), "s", 1, "n")
        settings = ConditionSettings(tacho=TachoSettings("t", per_revolution=marks))
        functions[f"channel: {name}, {marks} a turn"] = lambda b=block, s=settings: find_rotation(b, s)
    for marks in (1, 60, 1024, 5000):
        block = _block(pulses_of(shaft, marks, FAULTS["missing and doubled" if marks < 1000 else "none"], 0))
        settings = ConditionSettings(tacho=TachoSettings(None, None, marks, MISSING_TEETH.get(marks, 0)))
        functions[f"times: {marks} a turn"] = lambda b=block, s=settings: find_rotation(b, s)
    return [{"pulses": name, "ms": ms} for name, ms in interleaved_ms(functions, rounds).items()]


def main() -> None:
    """Run, print, write."""
    options = arguments("Error of the angle that is found from pulses.")
    seeds = range(3) if options.quick else range(HELD_OUT, HELD_OUT + BLOCKS)
    tables = {
        "times": of_times(seeds),
        "shafts": of_shafts(seeds),
        "channels": of_channels(seeds),
        "costs": costs(5 if options.quick else 20),
    }
    print_table("Times of pulses: errors in revolutions; angle and speed: share within two stated sd", tables["times"])
    print_table("The same by shaft, jitter 1 us", tables["shafts"])
    print_table("Channels at 25.6 kHz", tables["channels"])
    print_table("Processor time of a block", tables["costs"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
