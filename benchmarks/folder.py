"""The watched folder: what it costs beside the bare reader, to the committed record, and to look at many files.

Run as ``python -m benchmarks.folder [--quick] [--json FILE]``. Times are thread CPU times of one core, medians, but for
the delay, which is the clock's. Three tables:

1. a file of 128,000 samples (float64, one channel): the bare reader, the digest of its bytes, the file through the
   folder to an acknowledged block (read, digest, told from others, parsed), and the same re-cut into blocks of 5 s;
2. the scan of a folder of many files that are all known, and what share of one core it may take;
3. the delay from the end of writing to the acknowledged block, events on and a settling time of 2 s.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import REFERENCE_MS, Row, arguments, calibration_kernel, interleaved_ms, print_table, write_json
from streams.digest import content_hash
from streams.folder.source import FolderSource
from streams.recognise import data_set_of
from streams.spec import ChannelSpec, SourceSpec
from tests.support.memory_ledger import MemoryLedger

SAMPLES = 128_000
RATE = 25_600.0
CHANNELS = (ChannelSpec("x", column=1, unit="g", scale=1.0),)


def spec(kind: str, **more: Any) -> SourceSpec:
    """Return the configuration of a folder of files of one kind."""
    base: dict[str, Any] = {
        "name": "s",
        "url": "folder:",
        "rate": RATE,
        "channels": CHANNELS,
        "format": kind,
        "block_s": "file",
    }
    return SourceSpec(**(base | more))


class NoFiles:
    """A folder of which nothing but the name is needed."""

    sequential = False
    several = True

    def __init__(self, root: Path) -> None:
        """Take the name."""
        self.root = root
        self.closed: list[str] = []

    def __iter__(self):
        """Iterate over nothing."""
        return iter(())

    def expect(self, paths: Sequence[str]) -> None:
        """Ignore the order of what will be read."""


def write(path: Path, seed: int) -> None:
    """Write a file of noise by its ending."""
    import soundfile

    values = np.random.default_rng(seed).normal(size=SAMPLES)
    if path.suffix == ".csv":
        path.write_text("".join(f"{value:.5f}\n" for value in values))
    elif path.suffix == ".npy":
        np.save(path, values)
    else:
        soundfile.write(path, values / 8.0, int(RATE), subtype="PCM_24")


def through(root: Path, kind: str, block_s: float | str) -> Callable[[], object]:
    """Return a function that takes one file through a folder; each call needs a new file, which it writes untimed."""
    source = FolderSource(spec(kind, settle_s=0.0, block_s=block_s), str(root))
    ledger = MemoryLedger()
    source.open(ledger)

    def take() -> None:
        while True:
            delivery = source.next(1.0)
            if delivery is None:
                raise RuntimeError("nothing came")
            ledger.commit(delivery.item, delivery.progress)
            source.acknowledge(delivery)
            if not source.backlog().pending:
                return

    return take


def folder_rows(rounds: int) -> list[Row]:
    """Return the cost of a file, bare and through the folder."""
    rows: list[Row] = []
    fft = interleaved_ms({"fft": calibration_kernel()}, 20)["fft"]
    for kind in ("npy", "wav", "csv"):
        times: dict[str, list[float]] = {"bare": [], "digest": [], "folder": [], "re-cut": []}
        with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
            runs = {
                "folder": (Path(one), through(Path(one), kind, "file")),
                "re-cut": (Path(two), through(Path(two), kind, 5.0)),
            }
            read = data_set_of(spec(kind), NoFiles(Path(one)), kind).read
            for number in range(rounds + 1):
                for name, (root, take) in runs.items():
                    write(root / f"f{number}.{kind}", number)
                    start = time.thread_time()
                    take()
                    times[name].append(time.thread_time() - start)
                data = (Path(one) / f"f{number}.{kind}").read_bytes()
                start = time.thread_time()
                read(data, f"f{number}.{kind}")
                times["bare"].append(time.thread_time() - start)
                start = time.thread_time()
                content_hash(data)
                times["digest"].append(time.thread_time() - start)
        medians = {f"{name} ms": 1e3 * statistics.median(values[1:]) for name, values in times.items()}
        rows.append({"format": kind, **medians, "fft ms": fft})
    return rows


def scan_rows(counts: tuple[int, ...]) -> list[Row]:
    """Return the cost of looking at files that are all known."""
    rows: list[Row] = []
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            for number in range(count):
                (root / f"f{number:06d}.csv").write_bytes(f"{number}.5\n1.5\n".encode())
            source = FolderSource(spec("csv", settle_s=0.0), folder)
            ledger = MemoryLedger()
            with source:
                source.open(ledger)
                while (delivery := source.next(1.0)) is not None:
                    ledger.commit(delivery.item, delivery.progress)
                    source.acknowledge(delivery)
                times = interleaved_ms({"scan": lambda source=source: source._scan(source._clock.monotonic())}, 9)
            rows.append({"files": count, "scan ms": times["scan"], "share of a core, at most": 1 / 20})
    return rows


def delay_rows(rounds: int) -> list[Row]:
    """Return the delay from closing a file to its acknowledged block."""
    delays: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        source, ledger = FolderSource(spec("npy"), folder), MemoryLedger()
        with source:
            source.open(ledger)
            for number in range(rounds + 1):
                write(Path(folder) / f"f{number}.npy", number)
                began = time.perf_counter()
                delivery = source.next(10.0)
                if delivery is None:
                    raise RuntimeError("nothing came")
                ledger.commit(delivery.item, delivery.progress)
                source.acknowledge(delivery)
                delays.append(time.perf_counter() - began)
    # The first file waits for the settling time.
    p50, p99 = (1e3 * float(np.quantile(delays[1:], q)) for q in (0.5, 0.99))
    return [{"files": rounds, "first ms": 1e3 * delays[0], "p50 ms": p50, "p99 ms": p99}]


def main() -> None:
    """Measure and print."""
    options = arguments("cost of the watched folder")
    rounds = 5 if options.quick else 21
    tables = {
        "file": folder_rows(rounds),
        "scan": scan_rows((1000,) if options.quick else (1000, 10_000, 30_000)),
        "delay": delay_rows(20 if options.quick else 200),
    }
    print_table(
        f"One file of {SAMPLES} samples (the FFT takes {REFERENCE_MS} ms on the reference machine)", tables["file"]
    )
    print_table("A scan of files that are all known", tables["scan"])
    print_table("From the end of writing to the acknowledged block, events on", tables["delay"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
