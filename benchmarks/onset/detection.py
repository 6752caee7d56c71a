"""The onset detector: right on the runs to failure, and quiet on healthy machines.

Run as ``python -m benchmarks.onset.detection [--quick] [--json FILE]``. Tables:

1. four PRONOSTIA runs, two channels: where the final stage began, when it was known, end of life, name; beside them two
   textbook rules with the same learning window, three standard deviations on RMS with five consecutive exceedances and
   a CUSUM on ln RMS (slack 2, limit 20 standard deviations). A rule is right if it alarms inside the window;
2. the same runs with each setting of the detector varied, the others at their defaults;
3. healthy simulated machines, sample by sample through quality, features, naming and detection: alarms, blocks over the
   threshold, blocks with a name;
4. healthy simulated machines, features only, for counts that samples do not reach; drift and its memory varied;
5. how large a lasting step of RMS, of H_or over its floor, or of both must be to be known within 20 blocks;
6. time of one block through quality, features, naming and detection.

Without the recordings (``SPALLWATCH_DATA``) tables 1 and 2 are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, Tables, benchmark, calibration_kernel, interleaved_ms
from models.machine.bearing import kinematics
from monitor.health import onset as detect
from monitor.health.channel import check_channel, detect_input, step
from monitor.health.later_stages import ChannelBlock
from monitor.health.name.naming import name_fault
from monitor.health.signal.condition import Quantity
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.signal.quality import check_samples
from monitor.health.state import ChannelSettings, ChannelState
from reference import recordings_folder
from reference.recordings import RUNS, History, Run, histories
from reference.signals import HealthyMachine, bearing_lines, impacts

Marks = tuple[int, int] | None
DEFAULTS = detect.DetectSettings()
LEARNING = slice(DEFAULTS.run_in_blocks, DEFAULTS.run_in_blocks + (DEFAULTS.learn_blocks or 0))
VARIED: tuple[tuple[str, tuple[float, ...]], ...] = (
    ("learn_blocks", (30, 50, 75, 100, 125, 150)),
    ("run_in_blocks", (0, 10, 20, 30, 45, 60)),
    ("persist_blocks", (2, 3, 4, 5, 6, 7)),
    ("false_alarms_per_1000_blocks", (0.1, 0.3, 1.0, 3.0, 10.0)),
    ("rms_drift", (0.05, 0.07, 0.10, 0.14, 0.20)),
    ("h_or_drift", (0.07, 0.10, 0.15, 0.21, 0.30)),
)


def rerun(inputs: list[detect.DetectInput], settings: detect.DetectSettings) -> detect.DetectState:
    """Return the detector's state after these blocks."""
    state = detect.DetectState()
    for block in inputs:
        state, _ = detect.step(state, block, settings)
    return state


def marks(state: detect.DetectState) -> Marks:
    """Return the blocks of onset and knowledge, or None."""
    if state.t_fs is None or state.t_fs_known is None:
        return None
    return state.t_fs.sequence, state.t_fs_known.sequence


def three_sigma(rms: NDArray[np.float64]) -> int | None:
    """Return the block (from 1) at which RMS has been over mean + 3 sd of the learning window five times running."""
    level = rms[LEARNING].mean() + 3.0 * rms[LEARNING].std()
    count = 0
    for i in range(LEARNING.stop, rms.size):
        count = count + 1 if rms[i] > level else 0
        if count == 5:
            return i + 1
    return None


def cusum(rms: NDArray[np.float64]) -> int | None:
    """Return the block (from 1) at which the CUSUM of ln RMS, slack 2 and limit 20 standard deviations, alarms."""
    ln = np.log(rms)
    z = (ln - ln[LEARNING].mean()) / ln[LEARNING].std()
    total = 0.0
    for i in range(LEARNING.stop, rms.size):
        total = max(0.0, total + float(z[i]) - 2.0)
        if total > 20.0:
            return i + 1
    return None


def run_rows(run: Run, found: dict[str, History]) -> list[Row]:
    """Table 1 for one run."""
    rows: list[Row] = []
    verdict = run.verdict({name: marks(history.detector) for name, history in found.items()})
    for name, history in found.items():
        detector = history.detector
        rms = np.array([block.rms for block in history.inputs])
        rules = {"three_sigma": three_sigma(rms), "cusum": cusum(rms)}
        row: dict[str, float | int | str | None] = {
            "run": run.name,
            "channel": name,
            "window": f"{run.window[0]}-{run.window[1]}, {run.known_by}",
            "t_fs": detector.t_fs and detector.t_fs.sequence,
            "known": detector.t_fs_known and detector.t_fs_known.sequence,
            "t_eol": detector.t_eol and detector.t_eol.sequence,
            "fault": history.fault,
            "named from": next((block for block, naming in history.namings if naming.fault is not None), None),
            "run is": verdict,
        }
        for rule, block in rules.items():
            row[rule] = block
            row[f"{rule} is"] = _inside(run, block)
        rows.append(row)
    return rows


def _inside(run: Run, block: int | None) -> str:
    if block is None:
        return "none"
    if block < run.window[0]:
        return "early"
    return "right" if block <= run.known_by else "late"


def sensitivity_rows(found: dict[Run, dict[str, History]]) -> list[Row]:
    """Table 2."""
    rows: list[Row] = []
    for name, values in VARIED:
        default = next(field.default for field in fields(DEFAULTS) if field.name == name)
        for value in values:
            settings = replace(DEFAULTS, **{name: type(default)(value)})
            row: dict[str, float | int | str | None] = {"setting": name, "value": value}
            right = 0
            for run, channels in found.items():
                all_marks = {channel: marks(rerun(history.inputs, settings)) for channel, history in channels.items()}
                verdict = run.verdict(all_marks)
                right += verdict == "right"
                row[run.name] = f"{' '.join(_short(mark) for mark in all_marks.values())} {verdict}"
            rows.append({**row, "right": right})
    return rows


def _short(mark: Marks) -> str:
    return "-" if mark is None else f"{mark[0]}/{mark[1]}"


@dataclass
class Count:
    """What healthy machines gave.

    Attributes:
        machines: machines, each learned anew; one that alarms ends there.
        judged: blocks after learning.
        over: blocks over the threshold.
        alarms: machines that alarmed.
        named: blocks in which a part was named.
    """

    machines: int = 0
    judged: int = 0
    over: int = 0
    alarms: int = 0
    named: int = 0

    def row(self, **what: float | str) -> Row:
        """Return the counts as rates per 1000 healthy blocks; the upper limit is Poisson's at 95 %."""
        upper = self.alarms + 3.0 if self.alarms == 0 else self.alarms + 1.645 * math.sqrt(self.alarms) + 1.5
        return {
            **what,
            "machines": self.machines,
            "healthy blocks": self.judged,
            "over per 1000": 1e3 * self.over / self.judged,
            "alarms": self.alarms,
            "alarms per 1000": 1e3 * self.alarms / self.judged,
            "at most": 1e3 * upper / self.judged,
            "named": self.named,
        }

    def take(self, output: detect.DetectOutput) -> None:
        """Count one block."""
        self.judged += output.score is not None
        self.over += output.score is not None and output.score > output.threshold
        self.alarms += output.alarm


def healthy_samples(duration: float, machines: int, blocks: int, seed: int) -> tuple[Count, list[list[float]]]:
    """Take healthy machines through the whole line of stages; return the counts, and the prominences seen.

    Prominences of each part, NaN where the resolution does not show it.
    """
    rng = np.random.default_rng(seed)
    rate, speed = 25600.0, 27.5
    bearing, lines = bearing_lines("PRONOSTIA", speed)
    n = round(rate * duration)
    average = 16 if duration < 0.5 else 1
    settings = ChannelSettings("healthy", bearing, bands=((500.0, 6000.0),), average_blocks=average)
    count = Count()
    prominences: list[list[float]] = []
    for _ in range(machines):
        machine = HealthyMachine.draw(rng, speed, lines.bpfo)
        state = ChannelState()
        count.machines += 1
        for i, level in enumerate(machine.levels(rng, blocks)):
            samples = machine.block(rng, float(level), rate, n).astype(np.float32)
            verdict = check_channel(samples, state, settings)
            block = ChannelBlock(samples, rate, i + 1, 10.0 * i, verdict, Quantity(speed, "configured"))
            state, output = step(state, block, settings)
            assert output.detection is not None
            assert output.features is not None
            count.take(output.detection)
            count.named += output.naming is not None and output.naming.fault is not None
            shown = detect_input(output.features, block, absolute=True, usable=True).prominence
            prominences.append([shown.get(name, math.nan) for name in detect.LINES])
            if output.detection.alarm:
                break
    return count, prominences


def sample_table(quick: bool) -> tuple[list[Row], dict[float, NDArray[np.float64]]]:
    """Table 3, and the scatter of ln prominence about its median by duration of a block, shape (block, part)."""
    rows: list[Row] = []
    scatter = {}
    for duration, machines, blocks in ((0.1, 8, 530), (5.0, 2, 230)) if quick else ((0.1, 60, 530), (5.0, 8, 330)):
        count, prominences = healthy_samples(duration, machines, blocks, seed=round(10 * duration))
        rows.append(count.row(block_s=duration))
        ln = np.log(prominences)
        scatter[duration] = ln - np.median(ln, axis=0)
    return rows, scatter


def lines_of(ln_prominence: NDArray[np.float64]) -> dict[str, float]:
    """Return what the detector takes of a row of ln prominences, shape (part,), NaN for those that are not shown."""
    return {name: math.exp(ln) for name, ln in zip(detect.LINES, ln_prominence.tolist(), strict=True) if ln == ln}


def healthy_features(machine: HealthyMachine, machines: int, seed: int, ln_prominence: NDArray[np.float64]) -> Count:
    """Take machines of which only the levels are drawn through the detector.

    Prominences are drawn from those seen, shape (block, part), all parts of a block together.
    """
    rng = np.random.default_rng(seed)
    count, blocks = Count(), 2130
    for _ in range(machines):
        one = replace(machine, scatter=rng.uniform(0.02, 0.03))
        levels = one.levels(rng, blocks)
        levels[rng.uniform(size=blocks) < one.burst_rate] *= rng.uniform(1.5, 20.0)
        prominence = rng.choice(ln_prominence, blocks)
        state = detect.DetectState()
        count.machines += 1
        for i in range(blocks):
            block = detect.DetectInput(i + 1, 10.0 * i, float(levels[i]), lines_of(prominence[i]), None)
            state, output = detect.step(state, block, DEFAULTS)
            count.take(output)
            if output.alarm:
                break
    return count


HEALTHY = (
    (0.0, 50.0, 0.0),
    (0.05, 10.0, 0.005),
    (0.05, 50.0, 0.0),
    (0.05, 50.0, 0.005),
    (0.05, 500.0, 0.005),
    (0.10, 50.0, 0.005),
    (0.10, 500.0, 0.005),
    (0.20, 50.0, 0.005),
)
"""Standard deviation of the drift of ln level, blocks of its memory, share of blocks with a burst."""


def feature_table(quick: bool, ln_prominence: NDArray[np.float64]) -> list[Row]:
    """Table 4."""
    machines = 6 if quick else 100
    rows: list[Row] = []
    for drift, memory, bursts in HEALTHY:
        drawn = HealthyMachine.draw(np.random.default_rng(6), 27.5, 154.0)
        machine = replace(drawn, drift=drift, memory=memory, burst_rate=bursts)
        count = healthy_features(machine, machines, 7, ln_prominence)
        rows.append(count.row(drift=drift, memory_blocks=memory, bursts=bursts))
    return rows


def step_table(quick: bool, ln_prominence: NDArray[np.float64]) -> list[Row]:
    """Table 5: machines that drift by 5 %, a step at block 300; the share of them that is known by block 320."""
    machines = 40 if quick else 400
    rows: list[Row] = []
    for factor in (1.1, 1.2, 1.3, 1.4, 1.5, 1.7, 2.0, 2.5, 3.0):
        row: dict[str, float | int | str | None] = {"step": factor}
        for name, steps in {"of RMS": (factor, 1.0), "of H_or": (1.0, factor), "of both": (factor, factor)}.items():
            rng = np.random.default_rng(9)
            known = sum(_is_known(rng, ln_prominence, steps) for _ in range(machines))
            row[name] = known / machines
        rows.append(row)
    return rows


def _is_known(rng: np.random.Generator, ln_prominence: NDArray[np.float64], steps: tuple[float, float]) -> bool:
    """Tell whether the steps of RMS and prominence at block 300 of one machine are known by block 320, not before."""
    levels = HealthyMachine.draw(rng, 27.5, 154.0).levels(rng, 320)
    prominence = rng.choice(ln_prominence, 320)
    levels[299:] *= steps[0]
    prominence[299:, 0] += math.log(steps[1])
    inputs = [
        detect.DetectInput(i + 1, None, float(level), lines_of(row), None)
        for i, (level, row) in enumerate(zip(levels, prominence, strict=True))
    ]
    known = rerun(inputs, DEFAULTS).t_fs_known
    return known is not None and known.sequence >= 300


def time_table(quick: bool) -> list[Row]:
    """Table 6: a damaged bearing, so that the naming seeks its rivals too."""
    rows: list[Row] = []
    for duration in (0.1, 5.0):
        rate, speed = 25600.0, 27.5
        bearing, lines = bearing_lines("PRONOSTIA", speed)
        x = impacts(np.random.default_rng(1), "outer", lines, rate=rate, duration=duration).astype(np.float32)
        asked = FeatureSettings(rate, ((500.0, 6000.0),), fundamentals(lines), speed=speed)
        features = block_features(x, rate, asked)
        settings = ChannelSettings("damaged", bearing, bands=((500.0, 6000.0),))
        block = ChannelBlock(x, rate, 1, 0.0, check_samples(x), Quantity(speed, "configured"))
        given = detect.DetectInput(1, 0.0, 1.0, dict.fromkeys(detect.LINES, 1.0), 1.0)
        learned = detect.DetectState(baseline=detect.Baseline(0.0, 0.03, dict.fromkeys(detect.LINES, (0.0, 0.1))))
        paths = {
            "kernel": calibration_kernel(),
            "quality_ms": partial(check_samples, x),
            "features_ms": partial(block_features, x, rate, asked),
            "naming_ms": partial(name_fault, features.sought[0], kinematics(bearing, speed), features.families[0]),
            "detect_ms": partial(detect.step, learned, given, DEFAULTS),
            "all_stages_ms": partial(step, ChannelState(), block, settings),
        }
        ms = interleaved_ms(paths, 21 if quick else 101)
        kernel = ms.pop("kernel")
        rows.append({"block_s": duration, "samples": x.size, **ms, "kernel_ms": kernel})
    return rows


@benchmark("Onset detection: recordings, sensitivity, false alarms, time.")
def main(quick: bool) -> Tables:
    """Run, print, write."""
    tables: dict[str, list[Row]] = {}
    folder = recordings_folder()
    if folder.is_dir():
        runs = RUNS[:3] if quick else RUNS
        found = {run: histories(run, folder) for run in runs}
        tables["runs"] = [row for run, channels in found.items() for row in run_rows(run, channels)]
        tables["sensitivity"] = sensitivity_rows(found)
    else:
        print("no recordings: SPALLWATCH_DATA names no folder")
    tables["healthy_samples"], scatter = sample_table(quick)
    tables["healthy_features"] = feature_table(quick, scatter[0.1])
    tables["steps"] = step_table(quick, scatter[0.1])
    tables["time"] = time_table(quick)
    return tables
