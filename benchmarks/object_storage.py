"""Chunks and recordings in an object storage: what a request costs, and what is fetched how fast.

The server is moto's on loopback, which checks signatures; a real one adds its distance to each request. Run with
``python -m benchmarks.object_storage``; ``benchmarks/results/object_storage.json`` keeps the figures.
"""

from __future__ import annotations

import importlib
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.common import arguments, print_table, write_json
from models.fleet.object_store import ObjectStore
from models.work.codec import encode
from models.work.folder_store import FolderStore
from models.work.runner import Runner
from models.work.serial import SerialExecutor
from models.work.task import Store, Work
from tests.support.object_storage import ObjectStorage, object_storage

_CHUNK_BYTES = 20_000
_LARGE_BYTES = 200_000_000
_SMALL_FILES, _SMALL_BYTES = 1000, 50_000

_FETCH = """
import resource, sys, time
from pathlib import Path
from streams.remote import fetched
url, scratch = sys.argv[1:]
import models.work.filesystem as filesystem
if url.startswith("s3"):
    filesystem.filesystem(url)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
begun = time.perf_counter()
with fetched(url, Path(scratch)) as recording:
    seconds, size = time.perf_counter() - begun, recording.size
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(seconds, size, (after - before) * 1024)
"""


def nothing(_shared: None, task: int) -> bytes:
    """Return as many bytes as a chunk has."""
    return bytes([task % 256]) * _CHUNK_BYTES


def _median_ms(action: Callable[[int], object], rounds: int) -> float:
    action(0)
    seconds: list[float] = []
    for number in range(1, rounds + 1):
        begun = time.perf_counter()
        action(number)
        seconds.append(time.perf_counter() - begun)
    return 1e3 * statistics.median(seconds)


def requests(store: Store, rounds: int) -> dict[str, Any]:
    """Return the median time of each kind of request, ms, and that of a whole chunk of no work."""
    data = encode(os.urandom(_CHUNK_BYTES))
    found = {
        "write_ms": _median_ms(lambda number: store.write(f"requests/{number}", data), rounds),
        "read_ms": _median_ms(lambda number: store.read(f"requests/{number}"), rounds),
        "none_ms": _median_ms(lambda number: store.read(f"requests/none-{number}"), rounds),
        "list_none_ms": _median_ms(lambda number: list(store.names(f"started/{number}/")), rounds),
        "delete_ms": _median_ms(lambda number: store.delete(f"requests/{number}"), rounds),
    }
    # Found by its name, which it does not have in the module that is run.
    function = importlib.import_module("benchmarks.object_storage").nothing
    work = Work[None, int, bytes]("nothing", function, memory=1)
    begun = time.perf_counter()
    with Runner(SerialExecutor(), store, keep=False) as runner:
        for _ in runner.run(work, None, list(range(rounds))):
            pass
        seconds = time.perf_counter() - begun
    return {**found, "chunk_ms": 1e3 * seconds / rounds}


def listing(store: Store, names: int) -> dict[str, Any]:
    """Return the names that are listed in a second, of so many chunks."""
    for number in range(names):
        store.write(f"chunks/{number % 256:02x}/{number:08x}", b"x")
    begun = time.perf_counter()
    found = sum(1 for _ in store.names("chunks/"))
    seconds = time.perf_counter() - begun
    if found != names:
        raise SystemExit(f"{found} of {names} names were listed")
    return {"names": names, "seconds": seconds, "names_per_s": names / seconds}


def fetch(url: str, folder: Path) -> dict[str, Any]:
    """Fetch a recording in a process of its own; return seconds, rate and the growth of its peak memory."""
    run = subprocess.run([sys.executable, "-c", _FETCH, url, str(folder)], capture_output=True, text=True, check=True)
    seconds, size, grown = map(float, run.stdout.split())
    return {"seconds": seconds, "mb": size / 1e6, "mb_per_s": size / 1e6 / seconds, "memory_mb": grown / 1e6}


def fetches(storage: ObjectStorage, folder: Path, quick: bool) -> list[dict[str, Any]]:
    """Return what fetching costs: a large object, by URL and by a signed one, and many small ones."""
    large, files = (_LARGE_BYTES // 10, _SMALL_FILES // 10) if quick else (_LARGE_BYTES, _SMALL_FILES)
    store = ObjectStore(storage.url("recordings"))
    store.write("large.npy", os.urandom(large))
    for number in range(files):
        store.write(f"many/{number:04}.npy", os.urandom(_SMALL_BYTES))
    cases = {
        "one object": storage.url("recordings/large.npy"),
        "one object, signed URL": storage.presigned("recordings/large.npy"),
        f"{files} objects": storage.url("recordings/many"),
    }
    return [{"recording": name, **fetch(url, folder)} for name, url in cases.items()]


def main() -> None:
    """Print and write all figures."""
    options = arguments(__doc__ or "")
    rounds, names = (20, 500) if options.quick else (200, 5000)
    with tempfile.TemporaryDirectory() as scratch, object_storage(1000) as storage:
        os.environ.update(storage.environment)
        stores: dict[str, Store] = {
            "folder": FolderStore(Path(scratch) / "chunks"),
            "object storage": ObjectStore(storage.url("chunks")),
        }
        table = [{"store": name, **requests(store, rounds)} for name, store in stores.items()]
        lists = [{"store": name, **listing(store, names)} for name, store in stores.items()]
        fetched = fetches(storage, Path(scratch) / "fetched", options.quick)
    print_table("requests", table)
    print_table("listing", lists)
    print_table("fetching", fetched)
    write_json(options.json, {"requests": table, "listing": lists, "fetching": fetched})


if __name__ == "__main__":
    main()
