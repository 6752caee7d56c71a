"""What naming and the measured speed cost: the step of a channel, present tree against a baseline commit.

Run as ``python -m benchmarks.naming_cost [--quick] [--json FILE] [--baseline COMMIT]``. Both trees take the same blocks
through ``monitor.health.step``, each in a process of its own; they take turns block by block, so that whatever disturbs
the machine disturbs both. Times are thread times, medians, also at the reference machine: scaled by the time of the
calibration kernel (``benchmarks/common.py``) in the same run. ``exact`` is the present tree with ``speed_exact =
true``, where no speed is measured; ``longer`` is the median of the paired differences to the baseline. Blocks of two
and four channels are those of a whole source.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

BASELINE = "83a1ef365103149f0606d520b228f2f7d70e0ddd"
BLOCKS: dict[str, tuple[str, str, float | None]] = {
    "PRONOSTIA, 2 x 0.1 s at 25.6 kHz": ("femto/Bearing2_7.tar.xz", "pronostia_1650rpm_4200n", None),
    "IMS, 4 x 1 s at 20 kHz": ("ims_samples/2004.02.12.10.32.39.xz", "ims_test2", None),
    "CWRU inner, 5 s at 12 kHz": ("cwru/105_0.mat", "cwru_drive_end", 5.0),
    "CWRU healthy, 5 s at 48 kHz": ("cwru/97_Normal_0.mat", "cwru_drive_end", 5.0),
    "MFPT outer, 3 s at 48.8 kHz": ("mfpt/OuterRaceFault_vload_1.mat", "mfpt", None),
    "HIT-SM outer, 5.1 s at 51.2 kHz": ("hit_sm_mfs/OR8_1200.mat", "hit_sm", None),
    "UESTC outer, 13 s at 20 kHz": ("uestc/O_1000_2.mat", "uestc", None),
}


def serve(folder: Path) -> None:
    """Take a block for each line that names one, and print its thread time, ms; with ``exact``, its speed is known."""
    from monitor.config.load import load_config
    from monitor.health.state import SourceState
    from monitor.health.step import step
    from monitor.service.setup import open_configured, source_settings

    ready: dict[tuple[str, bool], tuple[Any, Any, Any]] = {}
    for line in sys.stdin:
        name, _, mode = line.rstrip("\n").partition("\t")
        exact = mode == "exact"
        if (name, exact) not in ready:
            file, example, block_s = BLOCKS[name]
            config = load_config(Path("examples") / f"{example}.toml")
            if exact:
                operating = config.operating.model_copy(update={"speed_exact": True})
                config = config.model_copy(update={"operating": operating})
            section = config.source[0]
            if block_s is not None:
                section = section.model_copy(update={"block_s": block_s})
            settings = source_settings(config, section)
            block = next(iter(open_configured(config, section, str(folder / file))))
            state, _ = step(SourceState.begin(settings), block, settings)
            ready[name, exact] = state, block, settings
            step(state, block, settings)
        state, block, settings = ready[name, exact]
        began = time.thread_time()
        step(state, block, settings)
        print(1e3 * (time.thread_time() - began), flush=True)


class Child:
    """A process that takes blocks with the code of one tree."""

    def __init__(self, root: Path, folder: Path) -> None:
        """Start it."""
        command = [sys.executable, "-P", str(Path(__file__).resolve()), "--serve", str(folder)]
        environment = {**os.environ, "PYTHONPATH": str(root)}
        self.process = subprocess.Popen(
            command, cwd=root, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __call__(self, name: str, mode: str = "") -> float:
        """Return the thread time of one block, ms."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{name}\t{mode}\n")
        self.process.stdin.flush()
        return float(self.process.stdout.readline())

    def close(self) -> None:
        """End it."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait(timeout=30)


def measure(present: Child, baseline: Child, rounds: int, *, exact: bool) -> list[dict[str, float | str]]:
    """Return the medians of each block, in ms and at the reference machine."""
    from benchmarks.common import REFERENCE_MS, calibration_kernel, interleaved_ms

    kernel = calibration_kernel()
    rows: list[dict[str, float | str]] = []
    for name in BLOCKS:
        times: dict[str, list[float]] = {"baseline": [], "present": [], "exact": []}
        kernel_ms: list[float] = []
        for _ in range(rounds):
            times["baseline"].append(baseline(name))
            times["present"].append(present(name))
            if exact:
                times["exact"].append(present(name, "exact"))
            kernel_ms.append(interleaved_ms({"kernel": kernel}, 3)["kernel"])
        scale = REFERENCE_MS / statistics.median(kernel_ms)
        longer = statistics.median(p - b for p, b in zip(times["present"], times["baseline"], strict=True))
        row: dict[str, float | str] = {"block": name}
        row |= {f"{kind} ms": statistics.median(values) for kind, values in times.items() if values}
        row |= {"longer ms": longer, "longer, reference ms": longer * scale, "kernel ms": statistics.median(kernel_ms)}
        if exact:
            speed = statistics.median(p - e for p, e in zip(times["present"], times["exact"], strict=True))
            row["speed, reference ms"] = speed * scale
        rows.append(row)
    return rows


def main() -> None:
    """Run, print, write; or serve one tree."""
    parser = argparse.ArgumentParser(description="Cost of naming and of the measured speed.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    parser.add_argument("--baseline", default=BASELINE, metavar="COMMIT", help="to compare with")
    parser.add_argument("--serve", type=Path, metavar="DIR", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve is not None:
        serve(options.serve)
        return
    from benchmarks.common import print_table, write_json
    from benchmarks.regression.trees import ROOT, baseline_tree, full_hash
    from monitor.config.machine import OperatingSection
    from tests.conftest import recordings_folder

    folder = recordings_folder().resolve()
    exact = "speed_exact" in OperatingSection.model_fields
    with tempfile.TemporaryDirectory() as scratch, baseline_tree(options.baseline, Path(scratch)) as tree:
        present, baseline = Child(ROOT, folder), Child(tree.root, folder)
        try:
            rows = measure(present, baseline, 5 if options.quick else 40, exact=exact)
        finally:
            present.close()
            baseline.close()
    print_table(f"Step of a channel; baseline {options.baseline[:7]}", rows)
    write_json(options.json, {"baseline": {"commit": full_hash(options.baseline)}, "cost": rows})


if __name__ == "__main__":
    main()
