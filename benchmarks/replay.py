"""Processor time of a replay of 128,000-sample .npy blocks, by stage, for each block and channel.

A folder of blocks of 5 s at 25.6 kHz is replayed as ``spallwatch replay`` does it: read, hash, check, features, name,
detect, kept spectra, record, commit. The second half of the life is damaged, so that the naming seeks rivals. Each
stage is timed where its caller calls it, in the thread that does it; "rest" is what the sum leaves of the processor
time of the whole process. The target scales with the calibration kernel of the same run.

``python -m benchmarks.replay [--quick] [--json FILE]``
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import monitor.health.channel
import monitor.health.step
import monitor.service.replay
from benchmarks.common import REFERENCE_MS, Row, Tables, benchmark, calibration_kernel
from monitor.config.load import validate
from monitor.health import onset as detect
from monitor.records.store import Store
from reference.signals import HealthyMachine, bearing_lines, impacts
from streams.recording.source import Recording

SAMPLES, RATE, SPEED = 128_000, 25_600.0, 30.0
TARGET_MS = 5.0
"""Asked for a block and channel where the calibration kernel takes ``REFERENCE_MS``."""
STAGES = ("read", "check", "features", "name", "detect", "commit", "publish")


def write_blocks(folder: Path, blocks: int, channels: int) -> None:
    """Write a recording, healthy and then damaged: one .npy file a block, shape (sample, channel)."""
    rng = np.random.default_rng(12)
    _, lines = bearing_lines("6205", SPEED)
    machines = [HealthyMachine.draw(rng, SPEED, lines.bpfo) for _ in range(channels)]
    for number in range(blocks):
        rows = [machine.block(rng, 1.0, RATE, SAMPLES) for machine in machines]
        if number >= blocks // 2:
            rows = [row + impacts(rng, "outer", lines, rate=RATE, duration=SAMPLES / RATE) for row in rows]
        np.save(folder / f"{number:05d}.npy", np.stack(rows, axis=1).astype(np.float32))


def configuration(folder: Path, channels: int) -> dict[str, Any]:
    """Return the tables of the configuration."""
    return {
        "machine": {"name": "bench"},
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": {"speed_hz": SPEED, "load_newton": 1000.0},
        "source": [{"name": "s", "url": f"folder:{folder}", "rate_hz": RATE, "block_s": "file"}],
        "channel": [
            {"name": f"c{k}", "source": "s", "column": k, "unit": "m/s2", "bearing": "b", "band_hz": [[1000.0, 9000.0]]}
            for k in range(1, channels + 1)
        ],
        "detect": {"learn_blocks": 10, "run_in_blocks": 2},
    }


@contextmanager
def timed_stages() -> Iterator[dict[str, float]]:
    """Time the stages while the context lasts: seconds of the calling thread, by stage."""
    spent: dict[str, float] = defaultdict(float)

    def timed(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            began = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[stage] += time.thread_time() - began

        return call

    def read(recording: Recording) -> Iterator[Any]:
        items = iterate(recording)
        while True:
            began = time.thread_time()
            item = next(items, None)
            spent["read"] += time.thread_time() - began
            if item is None:
                return
            yield item

    iterate = Recording.__iter__
    places: list[tuple[Any, str, str]] = [
        (monitor.health.step, "span_of", "check"),
        (monitor.health.step, "check_channel", "check"),
        (monitor.health.channel, "block_features", "features"),
        (monitor.health.channel, "name_fault", "name"),
        (detect, "step", "detect"),
        (Store, "commit_many", "commit"),
        (monitor.service.replay, "publish", "publish"),
    ]
    with ExitStack() as patched:
        for place, name, stage in places:
            patched.enter_context(mock.patch.object(place, name, timed(stage, getattr(place, name))))
        patched.enter_context(mock.patch.object(Recording, "__iter__", read))
        yield spent


def measure(blocks: int, channels: int, rounds: int) -> Row:
    """Replay one recording several times; return the median of each stage, ms a block and channel."""
    kernel = calibration_kernel()
    runs: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "blocks"
        folder.mkdir()
        write_blocks(folder, blocks, channels)
        config = validate(configuration(folder, channels), Path(place) / "bench.toml")
        for number in range(rounds + 1):
            for _ in range(20):
                began = time.thread_time()
                kernel()
                runs["kernel"].append(1e3 * (time.thread_time() - began))
            with timed_stages() as spent:
                began = time.process_time()
                done = monitor.service.replay.replay(config, None, Path(place) / f"out{number}")
                total = time.process_time() - began
            if done.summary["accepted"] != blocks:
                raise AssertionError(f"{done.summary['accepted']} of {blocks} blocks were accepted")
            if number == 0:
                continue
            scale = 1e3 / (blocks * channels)
            for stage in STAGES:
                runs[stage].append(scale * spent[stage])
            runs["all"].append(scale * (total - spent["publish"]))
    found = {name: statistics.median(values) for name, values in runs.items()}
    rest = found["all"] - sum(found[stage] for stage in STAGES if stage != "publish")
    return {
        "channels": channels,
        "blocks": blocks,
        **{f"{stage}_ms": found[stage] for stage in STAGES},
        "rest_ms": rest,
        "all but publish_ms": found["all"],
        "kernel_ms": found["kernel"],
        "target_ms here": TARGET_MS * found["kernel"] / REFERENCE_MS,
    }


@benchmark("Processor time of a replay, by stage.")
def main(quick: bool) -> Tables:
    """Run, print, write."""
    rounds = 1 if quick else 5
    rows = [measure(12 if quick else blocks, channels, rounds) for channels, blocks in ((1, 192), (4, 96))]
    return {"replay": rows}
