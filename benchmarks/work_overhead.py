"""What sharing work costs beside the work: encoding, chunks in a folder, processes, and ten million chunks in a store.

Run: python -m benchmarks.work_overhead [--quick] [--json FILE]
"""

from __future__ import annotations

import hashlib
import resource
import tempfile
import time
import tracemalloc
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import arguments, interleaved_ms, print_table, write_json
from models.machine.scene import Defect, Scene, Slip
from models.maps.plan import MapPlan
from models.work.chunk import StoredChunk, chunk_key
from models.work.codec import decode, encode
from models.work.folder_store import FolderStore
from models.work.pool import PoolExecutor
from models.work.runner import SERIAL, Runner
from models.work.serial import SerialExecutor
from models.work.store_files import KnownChunks
from models.work.task import ChunkCall, ChunkOutcome, Work

CHUNKS = 10_000_000
_ENCODED = encode(StoredChunk("0" * 40, [0.0], 0.0, "worker", "processor"))


def nothing(_shared: object, task: float) -> float:
    """Return the task: what is measured is all around it."""
    return task


class NoStore:
    """Takes all that is written, and has each chunk; ``count`` names stand in it."""

    url = "none"

    def __init__(self, count: int = 0) -> None:
        """Take the number of names."""
        self._count = count

    def read(self, name: str) -> bytes | None:
        """Return the same results for each chunk."""
        return _ENCODED if name.startswith("chunks/") else None

    def write(self, name: str, data: bytes, *, durable: bool = True) -> None:
        """Forget it."""

    def delete(self, name: str) -> None:
        """Do nothing."""

    def names(self, prefix: str = "") -> Iterator[str]:
        """Yield names as a folder does."""
        for number in range(self._count if prefix == "chunks/" else 0):
            key = hashlib.blake2b(number.to_bytes(4, "little"), digest_size=20).hexdigest()
            yield f"chunks/{key[:2]}/{key}"


class NoExecutor:
    """Says of each chunk at once that it is done."""

    name = "none"

    def __init__(self) -> None:
        """Begin with nothing to do."""
        self._calls: deque[ChunkCall] = deque()

    def capacity(self) -> int:
        """Return that of a hundred workers."""
        return 200

    def workers(self) -> int:
        """Return 100."""
        return 100

    def submit(self, call: ChunkCall) -> None:
        """Note a chunk."""
        self._calls.append(call)

    def wait(self) -> ChunkOutcome:
        """Return that the oldest one is done."""
        return ChunkOutcome(self._calls.popleft().key, None, 1.0, 100, "worker", "processor")

    def close(self) -> None:
        """Do nothing."""


def codec_rows(rounds: int) -> list[dict[str, float | str]]:
    """Return time and size of a few tasks and results."""
    scene = Scene(40.0, 4e3, defect=Defect(0.1, 1e-5), slip=Slip(0.01))
    plan = MapPlan(
        load=(4000.0, 8000.0), speed=(20.0, 40.0), h_d=(1e-5, 1e-4), dphi_d=tuple(np.linspace(0.01, 0.5, 40))
    )
    values = {
        "three indices": (1, 2, 3),
        "scene with rig": scene,
        "plan of a map": plan,
        "row, 40 x 40": np.ones((40, 40)),
    }
    values["map, 100 MB"] = np.ones(12_500_000)
    rows: list[dict[str, float | str]] = []
    for name, value in values.items():
        data = encode(value)
        calls: dict[str, Callable[[], object]] = {
            "encode": lambda v=value: encode(v),
            "decode": lambda d=data: decode(d),
        }
        ms = interleaved_ms(calls, 5 if len(data) > 1e6 else rounds)
        rows.append(
            {"value": name, "bytes": len(data), "encode_us": 1e3 * ms["encode"], "decode_us": 1e3 * ms["decode"]}
        )
    return rows


def chunk_rows(count: int) -> list[dict[str, float | str]]:
    """Return the processor time of this process for a chunk that does nothing, by where it runs; median of three."""
    tasks = np.arange(float(count)).tolist()
    kind = Work("nothing", nothing, 0)
    rows: list[dict[str, float | str]] = []

    def timed(name: str, run: Callable[[], Any]) -> None:
        seconds: list[float] = []
        for _ in range(3):
            begun = time.process_time()
            assert list(run()) == tasks
            seconds.append(time.process_time() - begun)
        rows.append({"where": name, "ms_per_chunk": 1e3 * float(np.median(seconds)) / count})

    timed("loop, no store", lambda: SERIAL.run(kind, None, tasks))
    with tempfile.TemporaryDirectory() as folder:
        store = FolderStore(folder)
        timed("loop, chunks in a folder", lambda: Runner(SerialExecutor(), store).run(kind, None, tasks))
        timed("found done in a folder", lambda: Runner(SerialExecutor(), store, resume=True).run(kind, None, tasks))
        with Runner(PoolExecutor(2), store) as runner:
            list(runner.run(kind, None, tasks[:4]))
            timed("caller of two processes, chunks in a folder", lambda: runner.run(kind, None, tasks))
    return rows


def runner_rows(counts: tuple[int, int]) -> list[dict[str, float | str]]:
    """Return time and memory of the runner alone, for two numbers of chunks."""
    rows: list[dict[str, float | str]] = []
    for count in counts:
        kind = Work("nothing", nothing, 0)
        begun = time.thread_time()
        done = sum(1 for _ in Runner(NoExecutor(), NoStore()).run(kind, None, range(count)))
        seconds = time.thread_time() - begun
        tracemalloc.start()
        done += sum(1 for _ in Runner(NoExecutor(), NoStore()).run(kind, None, range(count)))
        held = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert done == 2 * count
        rows.append({"chunks": count, "us_per_chunk": 1e6 * seconds / count, "peak_memory_mb": 1e-6 * held})
    return rows


def index_row(count: int) -> dict[str, float | str]:
    """Return what it costs to know the names of so many chunks, and to find which of them are done."""
    begun = time.thread_time()
    for _ in NoStore(count // 10).names("chunks/"):
        pass
    making = 10.0 * (time.thread_time() - begun)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.thread_time()
    known = KnownChunks(NoStore(count))
    listing = time.thread_time() - begun - making
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert len(known) == count
    sample = min(count, 100_000)
    begun = time.thread_time()
    found = sum(
        chunk_key("benchmarks.work_overhead:nothing", "0" * 40, encode([(1, 2, n)])) in known for n in range(sample)
    )
    planning = (time.thread_time() - begun) * count / sample
    assert found == 0
    return {
        "chunks": count,
        "list_s": listing,
        "plan_s": planning,
        "held_mb": 1e-6 * 8 * count,
        "peak_mb": 1.024e-3 * peak,
    }


def folder_row(count: int) -> dict[str, float | str]:
    """Return the processor time to list a real folder of chunks."""
    with tempfile.TemporaryDirectory() as folder:
        for name in NoStore(count).names("chunks/"):
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(_ENCODED)
        begun = time.thread_time()
        known = KnownChunks(FolderStore(folder))
        seconds = time.thread_time() - begun
        assert len(known) == count
    return {"files": count, "list_s": seconds, "us_per_file": 1e6 * seconds / count}


def main() -> None:
    """Print the tables."""
    options = arguments(__doc__ or "")
    quick = options.quick
    index = index_row(CHUNKS // 100 if quick else CHUNKS)
    results = {
        "index": [index],
        "folder": [folder_row(10_000 if quick else 100_000)],
        "runner": runner_rows((2_000, 4_000) if quick else (20_000, 100_000)),
        "codec": codec_rows(50 if quick else 1000),
        "chunk": chunk_rows(50 if quick else 200),
    }
    titles = {
        "index": "Names of chunks in a store: list them, find a run's own among them",
        "folder": "A folder of chunks",
        "runner": "The runner alone",
        "codec": "Values as bytes, thread time",
        "chunk": "A chunk that does nothing, processor time",
    }
    for name, rows in results.items():
        print_table(titles[name], rows)
    write_json(options.json, results)


if __name__ == "__main__":
    # Workers find functions by the name of their module.
    from benchmarks import work_overhead

    work_overhead.main()
