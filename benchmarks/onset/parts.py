"""Onsets on eleven runs to failure, of each part, that come and go, and of healthy machines.

Run as ``python -m benchmarks.onset.parts [--quick] [--json FILE]``. Tables:

1. both axes of eleven PRONOSTIA runs (``femto_histories``): t_fs, when it was known, episodes that closed, a baseline
   learned anew, end of life, judged by the windows of :mod:`benchmarks.onset.windows`; beside them three sigma (five
   times running) and a CUSUM of ln RMS, which are right if they alarm between the first block of the window and the
   block by which the onset must be known;
2. how often each is defensible, early, late, missed;
3. episodes that come and go on simulated levels, with seeds that no constant was set on: found, closed, and the damage
   that follows found by this detector and by one that latches;
4. damage of each part that grows, 5 s blocks through features and detector, listening to all parts or as the thesis;
5. how often a healthy score exceeds its threshold where the lines of the parts are independent, or all the same: this
   score, and the length of the excesses of all five features at the threshold of independent ones;
6. healthy machines, 5 s blocks sample by sample through features and detector, all parts listened to.

Without the recordings (``SPALLWATCH_DATA``) tables 1 and 2 are left out.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, Tables, benchmark
from benchmarks.onset.detection import cusum, three_sigma
from benchmarks.onset.windows import WINDOWS, Window, inputs_of
from monitor.health import onset as detect
from monitor.health.channel import detect_input
from monitor.health.later_stages import ChannelBlock
from monitor.health.onset.detector import one_of, threshold_for
from monitor.health.signal.condition import Quantity
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.signal.quality import Verdict
from reference import recordings_folder
from reference.signals import HealthyMachine, bearing_lines, impacts

ALL = detect.DetectSettings()
THESIS = replace(ALL, features=("rms", "h_or"))
LATCHING = replace(THESIS, close_blocks=10**9)
HELD_OUT_SEED = 20261123
RATE, SPEED, SECONDS = 25600.0, 27.5, 5.0


@dataclass
class Told:
    """What the detector said of a history: its last state, the first onset, the blocks of other changes."""

    state: detect.DetectState
    first: tuple[int, int] | None = None
    relearned: tuple[int, ...] = ()
    judged: int = 0
    over: int = 0
    alarms: int = 0


def told(blocks: Iterator[detect.DetectInput] | list[detect.DetectInput], settings: detect.DetectSettings) -> Told:
    """Take blocks through the detector."""
    found = Told(detect.DetectState())
    for block in blocks:
        found.state, output = detect.step(found.state, block, settings)
        found.judged += output.score is not None
        found.over += output.score is not None and output.score > output.threshold
        found.alarms += output.alarm
        if output.alarm and found.first is None:
            found.first = marks(found.state)
        if output.relearned is not None:
            found.relearned = (*found.relearned, block.sequence)
    return found


def marks(state: detect.DetectState) -> tuple[int, int] | None:
    """Return the blocks of onset and knowledge of the open episode, or None."""
    if state.t_fs is None or state.t_fs_known is None:
        return None
    return state.t_fs.sequence, state.t_fs_known.sequence


def judge_alarm(window: Window, alarm: int | None) -> str:
    """Judge a rule that has no date of the onset but that of its alarm."""
    onset = None if alarm is None else min(alarm, window.last)
    return window.judge(onset, alarm)


def run_tables() -> tuple[list[Row], list[Row]]:
    """Tables 1 and 2."""
    rows: list[Row] = []
    counts: dict[str, Counter[str]] = {}
    for window in WINDOWS:
        inputs = inputs_of(recordings_folder(), window)
        whole, thesis = told(inputs, ALL), told(inputs, THESIS)
        rms = np.array([block.rms for block in inputs])
        alarms = {"three_sigma": three_sigma(rms), "cusum": cusum(rms)}
        onset, known = marks(whole.state) or (None, None)
        verdicts = {
            "program": window.judge(onset, known),
            "features of the thesis": window.judge(*(marks(thesis.state) or (None, None))),
            **{name: judge_alarm(window, alarm) for name, alarm in alarms.items()},
        }
        for name, verdict in verdicts.items():
            counts.setdefault(name, Counter())[verdict] += 1
        end = whole.state.t_eol
        rows.append(
            {
                "run": window.run,
                "axis": window.axis,
                "window": f"{window.first}-{window.last}, {window.known_by}",
                "t_fs": onset,
                "known": known,
                "is": verdicts["program"],
                "closed": " ".join(f"{e.began.sequence}-{e.closed.sequence}" for e in whole.state.episodes),
                "learned anew": " ".join(map(str, whole.relearned)),
                "t_eol": end and end.sequence,
                "t_fs (thesis)": thesis.state.t_fs and thesis.state.t_fs.sequence,
                **alarms,
                **{f"{name} is": verdicts[name] for name in alarms},
            }
        )
    kinds = ("defensible", "early", "late", "missed")
    return rows, [{"rule": name, **{kind: found[kind] for kind in kinds}} for name, found in counts.items()]


def come_and_go(machines: int, factor: float, length: int, seed: int) -> Row:
    """Table 3, one row: each machine has two episodes that return, then damage that stays."""
    rng = np.random.default_rng(seed)
    blocks, begins, last = 1600, (300, 700), 1300
    totals = Counter[str]()
    lateness: list[int] = []
    for _ in range(machines):
        machine = HealthyMachine.draw(rng, SPEED, 154.0)
        level = machine.levels(rng, blocks)
        lines = 0.15 * rng.standard_normal((blocks, len(detect.LINES)))
        level[rng.uniform(size=blocks) < machine.burst_rate] *= rng.uniform(1.5, 20.0)
        for begin in begins:
            level[begin : begin + length] *= factor
        level[last:] *= np.linspace(1.0, 4.0, blocks - last)
        inputs = [
            detect.DetectInput(
                i + 1, 10.0 * i, float(level[i]), dict(zip(detect.LINES, np.exp(lines[i]), strict=True)), None
            )
            for i in range(blocks)
        ]
        whole, latching = told(inputs, ALL), told(inputs, LATCHING)
        inside = [[e for e in whole.state.episodes if abs(e.began.sequence - begin) <= 5] for begin in begins]
        totals["episodes"] += len(begins)
        totals["found and closed"] += sum(len(found) == 1 for found in inside)
        totals["other episodes"] += len(whole.state.episodes) - sum(map(len, inside))
        found = marks(whole.state)
        totals["last found"] += found is not None and found[0] > last
        totals["last found by latching"] += (marks(latching.state) or (0, 0))[0] > last
        lateness += [
            e.closed.sequence - (begin + length) for begin, hits in zip(begins, inside, strict=True) for e in hits
        ]
    return {
        "raised by": factor,
        "blocks": length,
        "machines": machines,
        **totals,
        "closed after (median)": float(np.median(lateness)) if lateness else None,
    }


def features_of(samples: NDArray[np.floating], sequence: int) -> detect.DetectInput:
    """Take one block through the features."""
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    asked = FeatureSettings(RATE, ((500.0, 6000.0),), fundamentals(lines), speed=SPEED)
    block = ChannelBlock(samples, RATE, sequence, 10.0 * sequence, Verdict(), Quantity(SPEED, "configured"))
    return detect_input(block_features(samples, RATE, asked), block, absolute=True, usable=True)


def growing(part: str, machines: int, seed: int) -> Row:
    """Table 4, one row: blocks from the first damage to its detection; impacts grow by 0.05 of the noise a block."""
    rng = np.random.default_rng(seed)
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    n, healthy, blocks = round(RATE * SECONDS), 150, 310
    after: dict[str, list[float]] = {"all parts": [], "thesis": []}
    leading = Counter[str]()
    for _ in range(machines):
        machine = HealthyMachine.draw(rng, SPEED, lines.bpfo)
        inputs: list[detect.DetectInput] = []
        for i, level in enumerate(machine.levels(rng, blocks)):
            x = machine.block(rng, float(level), RATE, n)
            if i >= healthy:
                height = 0.05 * (i + 1 - healthy)
                x += impacts(rng, part, lines, rate=RATE, duration=SECONDS, height=height, noise=0.0)
            inputs.append(features_of(x.astype(np.float32), i + 1))
        for name, settings in (("all parts", ALL), ("thesis", THESIS)):
            state = detect.DetectState()
            known = math.inf
            for block in inputs:
                state, output = detect.step(state, block, settings)
                if output.alarm:
                    known = block.sequence - healthy
                    leading[output.leading or ""] += name == "all parts"
                    break
            after[name].append(known)
    return {
        "part": part,
        "machines": machines,
        **{f"{name}: known after": float(np.median(values)) for name, values in after.items()},
        "led by": ", ".join(f"{name} {count}" for name, count in leading.items() if count),
    }


def rates(draws: int) -> list[Row]:
    """Table 5."""
    rng = np.random.default_rng(5)
    rms = np.maximum(rng.standard_normal(draws), 0.0)
    rows: list[Row] = []
    for name, lines in (
        ("independent", rng.standard_normal((draws, 4))),
        ("all the same", np.repeat(rng.standard_normal((draws, 1)), 4, axis=1)),
        ("each other's opposite", rng.standard_normal((draws, 1)) * np.array([[1.0, -1.0, 1.0, -1.0]])),
    ):
        highest = np.array([one_of(value, 4) for value in lines.max(axis=1).tolist()])
        length = np.linalg.norm(np.maximum(np.column_stack([rms, lines]), 0.0), axis=1)
        rows.append(
            {
                "lines": name,
                "this score, per 1000": 1e3 * float(np.mean(np.hypot(rms, highest) > threshold_for(1.0))),
                "length of five, per 1000": 1e3 * float(np.mean(length > threshold_for(1.0, 5))),
                "one line alone counts from": math.sqrt(threshold_for(1.0) ** 2 + 2.0 * math.log(4.0)),
                "of five": threshold_for(1.0, 5),
            }
        )
    return rows


def healthy(machines: int, blocks: int, seed: int) -> Row:
    """Table 6: machines of their own, each from learning on; levels drift by 5 % and knock at times."""
    rng = np.random.default_rng(seed)
    _, lines = bearing_lines("PRONOSTIA", SPEED)
    n = round(RATE * SECONDS)
    totals = Counter[str]()
    for _ in range(machines):
        machine = HealthyMachine.draw(rng, SPEED, lines.bpfo)
        levels = enumerate(machine.levels(rng, blocks))
        samples = (machine.block(rng, float(level), RATE, n).astype(np.float32) for _, level in levels)
        found = told((features_of(x, i + 1) for i, x in enumerate(samples)), ALL)
        totals.update(judged=found.judged, over=found.over, onsets=found.alarms, relearned=len(found.relearned))
        assert found.state.baseline is not None
        totals["parts"] = max(totals["parts"], len(found.state.baseline.lines))
    # Poisson's upper limit at 95 %; exact without an event.
    upper = 3.0 if totals["onsets"] == 0 else totals["onsets"] + 1.645 * math.sqrt(totals["onsets"]) + 1.5
    return {
        "block_s": SECONDS,
        "machines": machines,
        "parts listened to": totals["parts"],
        "healthy blocks": totals["judged"],
        "over per 1000": 1e3 * totals["over"] / totals["judged"],
        "onsets": totals["onsets"],
        "onsets per 10000": 1e4 * totals["onsets"] / totals["judged"],
        "at most": 1e4 * upper / totals["judged"],
        "baselines learned anew": totals["relearned"],
    }


@benchmark("Onsets: runs to failure, each part, episodes, healthy machines.")
def main(quick: bool) -> Tables:
    """Run, print, write."""
    tables: dict[str, list[Row]] = {}
    if recordings_folder().is_dir():
        tables["runs"], tables["counts"] = run_tables()
    else:
        print("no recordings: SPALLWATCH_DATA names no folder")
    tables["episodes"] = [
        come_and_go(2 if quick else 100, factor, length, HELD_OUT_SEED + place)
        for place, (factor, length) in enumerate(((1.5, 20), (2.0, 20), (2.0, 100), (4.0, 100), (4.0, 7), (4.0, 4)))
    ]
    parts = ("outer", "inner", "ball", "cage")
    tables["parts"] = [growing(part, 1 if quick else 5, HELD_OUT_SEED + 100 + i) for i, part in enumerate(parts)]
    tables["rates"] = rates(200_000 if quick else 4_000_000)
    tables["healthy"] = [healthy(*((1, 200) if quick else (30, 2140)), seed=HELD_OUT_SEED + 200)]
    return tables
