"""Time to read a block of 5 s at 25.6 kHz: .npy, WAV, TDMS, CSV; against another checkout where one is given.

    python -m benchmarks.loggers.reading_speed [--baseline PATH] [--rounds N] [--json FILE] [--quick]

PATH is a work tree with its own .venv. Both are processes that are warm and take turns file by file, so that whatever
disturbs the machine disturbs both; the figure is the median, and that of the ratios of neighbouring turns. Times are of
the wall clock, and of the processor with that of the process of parsers (Linux; a machine that is shared disturbs them
less). ``file``: ``sw.read`` of one file, with its opening; ``block``: of the blocks of a folder by ``sw.blocks``, the
second and those that follow; ``stream``: the same of the source below it, whose loader is that of the daemon.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from nptdms import ChannelObject, TdmsWriter

from benchmarks.common import print_table, write_json

ROOT = Path(__file__).resolve().parents[2]
RATE, SECONDS, FILES = 25600, 5, 6
_STATED = {"unit": "g"}
FORMATS: Mapping[str, Mapping[str, Any]] = {
    "npy": {**_STATED, "rate_hz": float(RATE)},
    "wav": {**_STATED, "scale": 8.0},
    "tdms": _STATED,
    "csv": _STATED,
}
"""By ending: what is said beside the file."""

_WORKER = """
import json, os, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import spallwatch as sw
from streams.open import open_source
try:
    from streams.types.spec import ChannelSpec, SourceSpec
except ImportError:
    from streams.spec import ChannelSpec, SourceSpec

def clocks():
    used = time.process_time()
    children = Path(f"/proc/self/task/{os.getpid()}/children")
    for child in children.read_text().split() if children.exists() else ():
        used += int(Path(f"/proc/{child}/schedstat").read_text().split()[0]) * 1e-9
    return time.perf_counter(), used

def stream(path, rate_hz=None, **level):
    channel = ChannelSpec(name="a", column=1, **level)
    return iter(open_source(SourceSpec(name="s", url=path, block_s="file", rate=rate_hz, channels=(channel,))))

for line in sys.stdin:
    path, how, way = json.loads(line)
    begin = clocks()
    if way == "file":
        first, count = sw.read(path, **how), 1
    else:
        blocks = stream(path, **how) if way == "stream" else sw.blocks(path, block_s="file", **how)
        first = next(blocks)
        begin = clocks()
        count = sum(1 for _ in blocks)
    wall, used = (after - before for after, before in zip(clocks(), begin))
    values, rate = (first.samples, first.rate) if way == "stream" else (first.values, first.attrs["rate_hz"])
    level = float((values ** 2).mean() ** 0.5)
    print(json.dumps([wall / count, used / count, rate, level]), flush=True)
"""


class Reader:
    """A process of one tree that reads what it is told, and says how long it took."""

    def __init__(self, tree: Path) -> None:
        """Start it with the environment of the tree."""
        self.tree = tree
        python = tree / ".venv" / "bin" / "python"
        self.process = subprocess.Popen(
            [str(python), "-c", _WORKER, str(tree)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=tree
        )

    def read(self, path: Path, how: Mapping[str, Any], way: str) -> list[float]:
        """Return s of wall clock and processor, Hz and RMS of a file, or of one of the blocks of a folder."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps([str(path), how, way]) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"{self.tree}: the reader ended at {path.name}")
        return json.loads(line)

    def close(self) -> None:
        """End it."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def write_files(folder: Path) -> None:
    """Write folders of each format with the same noise, all different."""
    random = np.random.default_rng(0)
    for ending in FORMATS:
        (folder / ending).mkdir()
    for index in range(FILES):
        samples = random.standard_normal(RATE * SECONDS)
        stem = f"rec_20240501_120{index}00"
        np.save(folder / "npy" / f"{stem}.npy", samples)
        soundfile.write(folder / "wav" / f"{stem}.wav", samples / 8.0, RATE, subtype="PCM_24")
        words = {"wf_increment": 1.0 / RATE, "unit_string": "g"}
        with TdmsWriter(folder / "tdms" / f"{stem}.tdms") as writer:
            writer.write_segment([ChannelObject("run", "acc", samples, properties=words)])
        head = f"Sample Rate: {RATE} Hz\nacc\n"
        text = head + "\n".join(f"{value:.6f}" for value in samples) + "\n"
        (folder / "csv" / f"{stem}.csv").write_text(text, encoding="ascii")


def measure(readers: Sequence[Reader], folder: Path, rounds: int) -> list[dict[str, Any]]:
    """Return a row for each format and way: medians in ms, and the ratio of the first tree to the second."""
    rows: list[dict[str, Any]] = []
    for ending, how in FORMATS.items():
        for way in ("file", "block", "stream"):
            path = folder / ending / (f"rec_20240501_120000.{ending}" if way == "file" else "")
            found = [reader.read(path, how, way)[2:] for reader in readers]
            times = np.empty((len(readers), 2, rounds))
            for turn in range(rounds):
                for place in range(len(readers))[:: 1 if turn % 2 else -1]:
                    times[place, :, turn] = readers[place].read(path, how, way)[:2]
            row: dict[str, Any] = {"format": ending, "way": way, "ms": 1e3 * float(np.median(times[0, 0]))}
            if len(readers) > 1:
                row["baseline_ms"] = 1e3 * float(np.median(times[1, 0]))
                row["ratio"], row["cpu_ratio"] = (float(each) for each in np.median(times[0] / times[1], axis=1))
                row["least_cpu_ratio"] = float(times[0, 1].min() / times[1, 1].min())
                row["same"] = str(np.allclose(found[0], found[1], rtol=1e-6))
            rows.append(row)
    return rows


def main() -> None:
    """Measure, print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--baseline", type=Path, metavar="PATH")
    parser.add_argument("--rounds", type=int, default=41)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    readers = [Reader(tree.resolve()) for tree in (ROOT, options.baseline) if tree is not None]
    try:
        with tempfile.TemporaryDirectory() as scratch:
            write_files(Path(scratch))
            rows = measure(readers, Path(scratch), 5 if options.quick else options.rounds)
    finally:
        for reader in readers:
            reader.close()
    print_table("reading of a block of 5 s at 25.6 kHz", rows)
    commits = [_commit(reader.tree) for reader in readers]
    write_json(options.json, {"trees": {"rounds": options.rounds, "commits": " ".join(commits)}, "formats": rows})


def _commit(tree: Path) -> str:
    command = ["git", "-C", str(tree), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


if __name__ == "__main__":
    sys.exit(main())
