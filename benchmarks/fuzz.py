"""Mutated and costly files and mutated frames: verdicts, times, memory, and what another source feels of them.

Run as ``python -m benchmarks.fuzz [--quick] [--json FILE]``. 11,004 (quick: 240) mutated files, and the files made to
cost much, go through the readers as in a recording, and 2,000 (200) mutated frames through the decoder. Tables:

- verdicts by format; a file that is ``read`` was damaged where nothing checks. ``slowest_s`` is the longest time from
  one verdict to the next, starts of child processes included; ``child_mb`` the peak of a child, ``parent_mb`` that of
  this process so far, which commits in the daemon;
- the costly files one by one;
- delays: a source gets a block every 250 or 50 ms, from its arrival to its commit, while other sources have nothing,
  and while they have all costly files and 11,000 (quick: 100) mutated ones. ``start_s`` is the longest delay of the
  first five seconds, in which the child processes start, ``longest_s`` that of the rest. ``others`` counts verdicts on
  the files of the others;
  ``block_cpu_ms`` and ``other_cpu_ms`` are processor time of the thread that commits, for each; ``busy`` is its
  processor time over the time, ``load`` that of the machine (1 min) at the end.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from benchmarks.common import arguments, print_table, write_json
from monitor.config.load import Config, validate
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from streams.block import Block
from streams.link.wire import WireError, decode_frame
from streams.open import open_source
from streams.readers.child import shared_process
from streams.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import MAKERS, RATE, signal
from tests.support.attacks import ATTACKS
from tests.support.fuzz import BINARY, COLUMN_OF, mutate, mutated_frames

SEED = 1000
NAMES = [*BINARY, "x.csv"]
_COUNTED = (
    "read",
    "incomplete",
    "unreadable",
    "refused",
    "empty",
    "wrong_shape",
    "wrong_rate",
    "nan",
    "reader_crashed",
)
_PERIODS_S = (0.25, 0.05)
_START_S = 5.0
_DAMAGED = ("x.csv", "x.npy", "x.mat", "x.h5", "x.wav")
_WRITE = """
import sys
from pathlib import Path
from tests.support.attacks import ATTACKS
path = Path(sys.argv[1])
path.write_bytes(ATTACKS[path.name][1](float(sys.argv[2])))
"""

Row = dict[str, float | str | None]


def mutated(name: str, count: int) -> Iterator[bytes]:
    """Yield damaged files of one kind."""
    whole, rng = MAKERS[name](signal(2, 600)), np.random.default_rng(SEED + NAMES.index(name))
    for _ in range(count):
        yield mutate(whole, rng)


def parent_mb() -> float:
    """Return the peak of the resident memory of this process, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def child_mb() -> float:
    """Return the peak of the resident memory of the child that parses, MB."""
    with suppress(OSError):
        for line in Path(f"/proc/{shared_process().pid}/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) * 1024 / 1e6
    return 0.0


def verdicts(url: str, kind: str, column: int | str) -> tuple[Counter[str], float, float]:
    """Return the verdicts on the files of a recording, the slowest in s, and the peak of a child in MB."""
    spec = SourceSpec(
        *("fuzz", url),
        block_s="file",
        rate=RATE,
        format=kind,
        channels=(ChannelSpec("a", column=column, unit="g", scale=1.0),),
    )
    found: Counter[str] = Counter()
    slowest = peak = 0.0
    last = time.perf_counter()
    for item in open_source(spec):
        found["read" if isinstance(item, Block) else item.status] += 1
        now = time.perf_counter()
        slowest, last, peak = max(slowest, now - last), now, max(peak, child_mb())
    return found, slowest, peak


def fuzz(name: str, count: int) -> Row:
    """Read mutated files of one kind."""
    with tempfile.TemporaryDirectory() as folder:
        for number, data in enumerate(mutated(name, count)):
            (Path(folder) / f"{number:05d}_{name}").write_bytes(data)
        found, slowest, peak = verdicts(f"folder:{folder}", "auto", COLUMN_OF.get(name, "acc_2"))
    counts: Row = {status: found[status] for status in _COUNTED}
    others = found.total() - sum(found[status] for status in _COUNTED)
    seconds: Row = {"slowest_s": slowest, "child_mb": peak, "parent_mb": parent_mb()}
    return {"file": name, "files": found.total(), **counts, "other": others, **seconds}


def write_attack(path: Path, share: float) -> None:
    """Write a costly file by another process, since the memory of this one is measured."""
    subprocess.run([sys.executable, "-c", _WRITE, str(path), str(share)], check=True)


def attack(name: str, share: float) -> Row:
    """Read one costly file."""
    kind, _, expected = ATTACKS[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write_attack(path, share)
        size = path.stat().st_size / 1e6
        found, slowest, peak = verdicts(str(path), kind, 1)
    status = next(iter(found))
    said: Row = {"verdict": status, "expected": "yes" if status in expected else "no"}
    return {"file": name, "mb": size, **said, "s": slowest, "child_mb": peak, "parent_mb": parent_mb()}


def frames(count: int) -> Row:
    """Decode mutated frames."""
    found: Counter[str] = Counter()
    slowest = 0.0
    for frame in mutated_frames(count, SEED):
        began = time.perf_counter()
        try:
            decode_frame(frame)
            found["read"] += 1
        except WireError as error:
            found[error.status] += 1
        slowest = max(slowest, time.perf_counter() - began)
    return {"frames": count, **dict(sorted(found.items())), "slowest_s": slowest, "parent_mb": parent_mb()}


def configured(root: Path) -> Config:
    """Return a machine with a source for arrays, and one for the damaged files of each format."""
    kinds = sorted({kind for kind, _, _ in ATTACKS.values()})
    sources = [{"name": "good", "url": f"folder:{root / 'good'}", "format": "npy"}]
    sources += [{"name": f"bad_{kind}", "url": f"folder:{root / kind}", "format": kind} for kind in kinds]
    for folder in ("good", *kinds):
        (root / folder).mkdir()
    every = {"rate_hz": RATE, "block_s": "file", "settle_s": 0.1}
    channel = {"column": 1, "unit": "g", "scale": 1.0, "bearing": "b", "band_hz": [[2000, 6000]]}
    values = {
        "machine": {"name": "fuzz"},
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": {"speed_hz": 30.0},
        "source": [source | every for source in sources],
        "channel": [{"name": source["name"], "source": source["name"], **channel} for source in sources],
    }
    return validate(values, Path("fuzz.toml"))


def delays(share: float, count: int, seconds: float, period: float, *, damaged: bool) -> Row:
    """Return the delays of a source, s, with a block every ``period`` s, beside others with damaged files or none."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        config = configured(root)
        if damaged:
            for name, (kind, _, _) in ATTACKS.items():
                write_attack(root / kind / name, share)
            for name in _DAMAGED:
                kind = {"h5": "hdf5"}.get(name[2:], name[2:])
                for number, data in enumerate(mutated(name, count)):
                    (root / kind / f"{number:05d}_{name}").write_bytes(data)
        arrived: dict[str, float] = {}
        stop = threading.Event()
        writer = threading.Thread(target=_write_good, args=(root / "good", arrived, stop, seconds, period))
        felt: list[tuple[float, float]] = []
        spent: dict[bool, list[float]] = {True: [], False: []}
        with Store.open(root / "state.db", machine="fuzz") as store, Ingest.open(config, store) as ingest:
            writer.start()
            began, cpu_began = time.monotonic(), time.thread_time()
            while writer.is_alive() or len(felt) < len(arrived):
                cpu = time.thread_time()
                record = ingest.step(stop)
                if record is not None:
                    spent[record.source == "good"].append(time.thread_time() - cpu)
                if record is not None and record.source == "good":
                    came = arrived[record.name]
                    felt.append((came - began, time.monotonic() - came))
            busy = (time.thread_time() - cpu_began) / (time.monotonic() - began)
        writer.join()
    found, first = sorted(delay for _, delay in felt), [delay for came, delay in felt if came < _START_S]
    later = [delay for came, delay in felt if came >= _START_S]
    files = len(_DAMAGED) * count + len(ATTACKS) if damaged else 0
    named: Row = {"period_s": period, "other files": files, "others": len(spent[False]), "blocks": len(found)}
    spread: Row = {"median_s": found[len(found) // 2], "p99_s": found[int(0.99 * len(found))]}
    spread |= {"start_s": max(first, default=None), "longest_s": max(later, default=None)}
    cpu_ms = {which: 1e3 * sum(each) / max(len(each), 1) for which, each in spent.items()}
    costs: Row = {"block_cpu_ms": cpu_ms[True], "other_cpu_ms": cpu_ms[False], "busy": busy}
    return {**named, **spread, **costs, "load": os.getloadavg()[0], "parent_mb": parent_mb()}


def _write_good(folder: Path, arrived: dict[str, float], stop: threading.Event, seconds: float, period: float) -> None:
    rng, began, number = np.random.default_rng(SEED), time.monotonic(), 0
    while time.monotonic() - began < seconds:
        number += 1
        name = f"{number:06d}.npy"
        np.save(folder / f".{name}", rng.normal(size=2560).astype(np.float32))
        arrived[name] = time.monotonic()
        (folder / f".{name}").rename(folder / name)
        stop.wait(period)


def main() -> None:
    """Print the tables and write them where asked."""
    options = arguments("Mutated and costly files and frames: verdicts, times, memory, delays.")
    share, count = (0.1, 20) if options.quick else (1.0, 11_000 // len(NAMES) + 1)
    rows = [fuzz(name, count) for name in NAMES]
    print_table("verdicts on mutated files", rows)
    costly = [attack(name, share) for name in ATTACKS]
    print_table("costly files", costly)
    decoded = [frames(200 if options.quick else 2000)]
    print_table("mutated frames", decoded)
    seconds, beside = (5.0, 20) if options.quick else (60.0, 11_000 // len(_DAMAGED))
    felt = [
        delays(share, beside, seconds, period, damaged=damaged) for period in _PERIODS_S for damaged in (False, True)
    ]
    print_table("delays of another source", felt)
    write_json(options.json, {"fuzz": rows, "attacks": costly, "frames": decoded, "delays": felt})


if __name__ == "__main__":
    main()
