"""Time and work to read a block of 5 s at 25.6 kHz: .npy, WAV, TDMS, CSV; against another checkout where one is given.

    python -m benchmarks.loggers.reading_speed [--baseline PATH] [--rounds N] [--json FILE] [--quick]
        [--counts | --instructions]

PATH is a work tree with its own .venv. Both are processes that are warm and take turns file by file, so that whatever
disturbs the machine disturbs both; the figure is the median, and that of the ratios of neighbouring turns. Times are of
the wall clock, and of the processor with that of the process of parsers (Linux; a machine that is shared disturbs them
less). ``file``: ``sw.read`` of one file, with its opening; ``block``: of the blocks of a folder by ``sw.blocks``, the
second and those that follow; ``stream``: the same of the source below it, whose loader is that of the daemon.

--counts measures no time but the work of a block of ``stream``, which a busy machine does not change: ``calls`` of
functions of Python and C in both processes, and ``faults``, the pages of memory that they were given anew (Linux). The
parser is called in the process that counts its calls. --instructions adds those of the processor, in thousands, by
valgrind, without those of the system: some minutes for each tree.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from nptdms import ChannelObject, TdmsWriter

from benchmarks.common import print_table, write_json

ROOT = Path(__file__).resolve().parents[2]
RATE, SECONDS, FILES = 25600, 5, 8
CHANNELS = (1, 4)
_STATED = {"unit": "g"}
FORMATS: Mapping[str, Mapping[str, Any]] = {
    "npy": {**_STATED, "rate_hz": float(RATE)},
    "wav": {**_STATED, "scale": 8.0},
    "tdms": _STATED,
    "csv": _STATED,
}
"""By ending: what is said beside the file."""

_BEGIN = """
import json, os, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import spallwatch as sw
from streams.open import open_source
try:
    from streams.files.parse import child, worker
    from streams.types.spec import ChannelSpec, SourceSpec
except ImportError:
    from streams.readers import child, worker
    from streams.spec import ChannelSpec, SourceSpec

def children():
    listed = Path(f"/proc/self/task/{os.getpid()}/children")
    return [Path(f"/proc/{number}") for number in listed.read_text().split()] if listed.exists() else []

def stream(path, rows, rate_hz=None, **level):
    channels = tuple(ChannelSpec(name=f"a{row}", column=row + 1, **level) for row in range(rows))
    return iter(open_source(SourceSpec(name="s", url=path, block_s="file", rate=rate_hz, channels=channels)))
"""
_TIMES = """
def clocks():
    used = time.process_time()
    for process in children():
        used += int((process / "schedstat").read_text().split()[0]) * 1e-9
    return time.perf_counter(), used

for line in sys.stdin:
    path, how, way, rows = json.loads(line)
    begin = clocks()
    if way == "file":
        first, count = sw.read(path, **how), 1
    else:
        blocks = stream(path, rows, **how) if way == "stream" else sw.blocks(path, block_s="file", **how)
        first = next(blocks)
        begin = clocks()
        count = sum(1 for _ in blocks)
    wall, used = (after - before for after, before in zip(clocks(), begin))
    values, rate = (first.samples, first.rate) if way == "stream" else (first.values, first.attrs["rate_hz"])
    level = float((values ** 2).mean() ** 0.5)
    print(json.dumps([wall / count, used / count, rate, level]), flush=True)
"""
_COUNTS = """
import itertools, resource, warnings

def faults():
    found = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    return found + sum(int((process / "stat").read_text().rpartition(")")[2].split()[7]) for process in children())

def faults_of(path, how, rows):
    for _ in range(3):
        blocks = stream(path, rows, **how)
        next(blocks)
        begin = faults()
        count = sum(1 for _ in blocks)
    return (faults() - begin) / count

def calls_of(path, how, rows):
    calls = 0

    def count(frame, event, argument):
        nonlocal calls
        calls += event in ("call", "c_call")

    blocks = stream(path, rows, **how)
    for _ in itertools.islice(blocks, 3):
        pass
    sys.setprofile(None if is_traced else count)
    # What valgrind counts is what is below this call.
    sys.call_tracing(list, (itertools.islice(blocks, 2),))
    sys.setprofile(None)
    return calls / 2

def ask_here(process, request, data):
    process._pipes = here
    child.write_all(here.input.handle, data)
    request = json.loads(json.dumps(request))
    worker._load_libraries(request["module"])
    answer = worker._answer(request, here.input.handle, here.output.handle)
    return json.loads(json.dumps(answer))

warnings.simplefilter("ignore")
is_traced = len(sys.argv) > 2
cases = [json.loads(line) for line in sys.stdin]
found = [0.0 if is_traced else faults_of(*case) for case in cases]
here = child._Pipes(os.open(os.devnull, os.O_WRONLY), open(os.devnull), child.MemoryFile("i"), child.MemoryFile("o"))
child.ReaderProcess._ask = ask_here
print(json.dumps([[calls_of(*case), few] for case, few in zip(cases, found)]))
"""
_TRACED = "_PyEval_CallTracing"


class Reader:
    """A process of one tree that reads what it is told, and says how long it took."""

    def __init__(self, tree: Path) -> None:
        """Start it with the environment of the tree."""
        self.tree = tree
        python = tree / ".venv" / "bin" / "python"
        self.process = subprocess.Popen(
            [str(python), "-c", _BEGIN + _TIMES, str(tree)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=tree,
        )

    def read(self, path: Path, how: Mapping[str, Any], way: str, rows: int) -> list[float]:
        """Return s of wall clock and processor, Hz and RMS of a file, or of one of the blocks of a folder."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps([str(path), how, way, rows]) + "\n")
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


def write_files(folder: Path) -> list[tuple[str, int, Path]]:
    """Write folders of each format with the same noise, all different; return ending, channels and path of each."""
    random = np.random.default_rng(0)
    places = [(ending, rows, folder / f"{ending}{rows}") for ending in FORMATS for rows in CHANNELS]
    for _, _, place in places:
        place.mkdir()
    for index, rows in itertools.product(range(FILES), CHANNELS):
        samples = random.standard_normal((RATE * SECONDS, rows))
        stem = f"rec_20240501_120{index}00"
        np.save(folder / f"npy{rows}" / f"{stem}.npy", samples)
        soundfile.write(folder / f"wav{rows}" / f"{stem}.wav", samples / 8.0, RATE, subtype="PCM_24")
        words = {"wf_increment": 1.0 / RATE, "unit_string": "g"}
        with TdmsWriter(folder / f"tdms{rows}" / f"{stem}.tdms") as writer:
            channels = enumerate(samples.T.copy())
            writer.write_segment(
                [ChannelObject("run", f"acc{row}", values, properties=words) for row, values in channels]
            )
        head = f"Sample Rate: {RATE} Hz\n" + ",".join(f"acc{row}" for row in range(rows)) + "\n"
        with (folder / f"csv{rows}" / f"{stem}.csv").open("w", encoding="ascii") as file:
            file.write(head)
            np.savetxt(file, samples, "%.6f", ",")
    return places


def measure(readers: Sequence[Reader], places: Sequence[tuple[str, int, Path]], rounds: int) -> list[dict[str, Any]]:
    """Return a row for each folder and way: medians in ms, and the ratio of the first tree to the second."""
    rows: list[dict[str, Any]] = []
    for (ending, channels, folder), way in itertools.product(places, ("file", "block", "stream")):
        case = folder / (f"rec_20240501_120000.{ending}" if way == "file" else ""), FORMATS[ending], way, channels
        found = [reader.read(*case)[2:] for reader in readers]
        times = np.empty((len(readers), 2, rounds))
        for turn in range(rounds):
            for place in range(len(readers))[:: 1 if turn % 2 else -1]:
                times[place, :, turn] = readers[place].read(*case)[:2]
        row: dict[str, Any] = {"format": ending, "channels": channels, "way": way}
        row["ms"] = 1e3 * float(np.median(times[0, 0]))
        if len(readers) > 1:
            row["baseline_ms"] = 1e3 * float(np.median(times[1, 0]))
            row["ratio"], row["cpu_ratio"] = (float(each) for each in np.median(times[0] / times[1], axis=1))
            row["least_cpu_ratio"] = float(times[0, 1].min() / times[1, 1].min())
            row["same"] = str(np.allclose(found[0], found[1], rtol=1e-6))
        rows.append(row)
    return rows


def work(trees: Sequence[Path], places: Sequence[tuple[str, int, Path]], *, instructions: bool) -> list[dict[str, Any]]:
    """Return a row for each folder: the work of a block in each tree, and the ratio of the first to the second."""
    counted = [_counted(tree, places, instructions=instructions) for tree in trees]
    rows: list[dict[str, Any]] = []
    for number, (ending, channels, _) in enumerate(places):
        row: dict[str, Any] = {"format": ending, "channels": channels}
        for what in counted[0]:
            row[what] = counted[0][what][number]
            if len(trees) > 1:
                row[f"baseline_{what}"] = counted[1][what][number]
                row[f"{what}_ratio"] = row[what] / (counted[1][what][number] or float("nan"))
        rows.append(row)
    return rows


def _counted(tree: Path, places: Sequence[tuple[str, int, Path]], *, instructions: bool) -> dict[str, list[float]]:
    given = "".join(json.dumps([str(folder), FORMATS[ending], rows]) + "\n" for ending, rows, folder in places)
    command = [str(tree / ".venv" / "bin" / "python"), "-c", _BEGIN + _COUNTS, str(tree)]
    # The order of sets, and threads that would not work, change no count.
    still = {**os.environ, "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
    run = partial(subprocess.run, input=given, capture_output=True, text=True, check=True, cwd=tree, env=still)
    calls, faults = zip(*json.loads(run(command).stdout), strict=True)
    found = {"calls": list(calls), "faults": list(faults)}
    if instructions:
        with tempfile.TemporaryDirectory() as scratch:
            part = f"{scratch}/part"
            watched = [f"--toggle-collect={_TRACED}", f"--dump-after={_TRACED}", f"--callgrind-out-file={part}"]
            run(["valgrind", "--tool=callgrind", "--collect-atstart=no", *watched, *command, "traced"])
            texts = [Path(f"{part}.{number}").read_text() for number in range(1, len(places) + 1)]
        totals = [re.search(r"^totals: (\d+)", text, re.MULTILINE) for text in texts]
        found["k_instructions"] = [5e-4 * int(total[1]) for total in totals if total is not None]
    return found


def main() -> None:
    """Measure, print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--baseline", type=Path, metavar="PATH")
    parser.add_argument("--rounds", type=int, default=41)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--counts", action="store_true", help="of calls and pages of memory, in place of times")
    parser.add_argument("--instructions", action="store_true", help="--counts, and instructions by valgrind")
    options = parser.parse_args()
    trees = [tree.resolve() for tree in (ROOT, options.baseline) if tree is not None]
    readers: list[Reader] = []
    with tempfile.TemporaryDirectory() as scratch:
        places = write_files(Path(scratch))
        if options.counts or options.instructions:
            rows = work(trees, places, instructions=options.instructions)
        else:
            try:
                readers += map(Reader, trees)
                rows = measure(readers, places, 5 if options.quick else options.rounds)
            finally:
                for reader in readers:
                    reader.close()
    print_table("reading of a block of 5 s at 25.6 kHz", rows)
    commits = " ".join(map(_commit, trees))
    write_json(options.json, {"trees": {"rounds": options.rounds, "commits": commits}, "formats": rows})


def _commit(tree: Path) -> str:
    command = ["git", "-C", str(tree), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


if __name__ == "__main__":
    sys.exit(main())
