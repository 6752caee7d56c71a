"""Files of invented loggers, and the truth beside them.

    python -m benchmarks.loggers.generate OUT --seeds 0 60

Makes OUT/SEED/data and OUT/SEED/truth.json.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from datetime import UTC
from pathlib import Path

import numpy as np

from benchmarks.loggers.binary import WRITERS
from benchmarks.loggers.plan import SPEED_HZ, LoggerTruth, Plan, TrueFile, plan_of
from benchmarks.loggers.text import Written


def generate(seed: int, folder: Path) -> LoggerTruth:
    """Write the files of the logger of a seed to ``folder/data``, and ``folder/truth.json``."""
    plan = plan_of(seed)
    data = folder / "data"
    data.mkdir(parents=True)
    written = WRITERS[plan.format](plan, data)
    truth = _truth(seed, plan, written)
    truth.write(folder / "truth.json")
    return truth


def _truth(seed: int, plan: Plan, written: Written) -> LoggerTruth:
    unknowable, ambiguous = list(dict.fromkeys(written.unknowable)), list(dict.fromkeys(written.ambiguous))
    answers = dict(written.answers)
    if plan.dating == "none":
        unknowable.append("start")
        answers["--start-utc"] = f"{plan.starts[0]:%Y-%m-%dT%H:%M:%SZ}"
        answers["--interval-s"] = f"{(plan.starts[1] - plan.starts[0]).total_seconds():g}"
    if plan.draw.chosen.get("ambiguous_name"):
        ambiguous.append("start")
        answers["--time-name"] = "%y%m%d_%H%M%S"
    form = str(plan.draw.chosen.get("date_form", ""))
    answers["--date-order"] = "month_first" if form.startswith("%m/") else "day_first"
    channels = written.channels
    files = [each for index in range(len(plan.starts)) for each in _files(plan, written, index)]
    speed = SPEED_HZ if plan.speed_in and plan.format not in ("wav", "uff", "npy", "lvm") else None
    return LoggerTruth(
        seed,
        plan.format,
        plan.rate,
        channels,
        files,
        speed,
        plan.zone,
        unknowable,
        ambiguous,
        answers,
        plan.draw.chosen,
    )


def _files(plan: Plan, written: Written, index: int) -> list[TrueFile]:
    """Return the truth of a file; of an LVM file of two segments, that of each."""
    wall = plan.wall(index)
    right = index not in plan.wrong_clock
    start: float | None = wall.timestamp() if written.zone_stated else wall.replace(tzinfo=UTC).timestamp()
    if plan.fault == "autumn" and not written.zone_stated and wall.fold:
        # A clock that was set back shows it once; names alone, which sort the files by it, never do.
        before = plan.wall(index - 1).replace(tzinfo=None)
        right = wall.replace(tzinfo=None) > before or plan.dating in ("name", "folder")
    if plan.dating == "none" or not right:
        start = None
    lost = plan.lost if index == len(plan.starts) - 1 else ""
    signal = plan.signals[index]
    parts = np.array_split(signal, 2, axis=1) if plan.draw.chosen.get("segments") else [signal]
    whole = TrueFile(written.paths[index], start, [], right, lost)
    found: list[TrueFile] = []
    for number, part in enumerate(parts):
        begin = None if start is None else start + 30.0 * number
        levels = [channel.levels(row, plan.rate) for channel, row in zip(written.channels, part, strict=True)]
        rms, velocity = [level for level, _ in levels], [level for _, level in levels]
        found.append(replace(whole, start_utc=begin, rms=rms, velocity=velocity))
    return found


def main() -> None:
    """Write the loggers of a range of seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 60), metavar=("FIRST", "END"))
    options = parser.parse_args()
    for seed in range(*options.seeds):
        truth = generate(seed, options.out / f"{seed:04d}")
        print(
            f"{seed:04d} {truth.format}: {len(truth.files)} files, {len(truth.channels)} channels, {truth.rate_hz:g} Hz"
        )


if __name__ == "__main__":
    main()
