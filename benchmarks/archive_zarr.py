"""An archive of 1,000 recordings in one Zarr store: what it costs to write, to open and to compute with.

Run: python -m benchmarks.archive_zarr [--quick] [--json FILE]

The recordings are 1.25 s of the simulated bench (``rig:ferrara``), two bearings that wear out, each of three
accelerometers a machine. With ARCHIVE_FOLDER the recordings and their replay are kept there and found again.
"""

from __future__ import annotations

import datetime
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import spallwatch as sw
from benchmarks.common import arguments, print_table, write_json
from models.work.folder_store import FolderStore
from monitor.config.load import load_config
from monitor.fleet import zarr_store
from monitor.fleet.arrays import Extent, arrays_of_rows, arrays_of_table, coordinates, global_attributes
from monitor.fleet.page import fleet_page
from monitor.fleet.result import RecordingResult
from monitor.service.replay import replay
from streams.rig import open_rig

RUNS, SENSORS = 2, 3
BEGIN = datetime.datetime(2024, 3, 1, tzinfo=datetime.UTC)
PARTS = 4
"""Recordings that are cut from a block of the bench of 5 s."""
LARGE = Extent(rows=10_000_000, recordings=100_000, channels=4)
TARGET_S = 2.0
CONFIG = """
[machine]
name = "rig"
[[bearing]]
name = "test"
designation = "6205"
[operating]
speed_hz = 40
load_newton = 4000
[[source]]
name = "s"
rate_hz = 25600
block_s = 0.1
time_from = "name"
time_name = "%Y%m%d-%H%M%S"
[[channel]]
name = "de"
source = "s"
column = 1
unit = "m/s2"
bearing = "test"
[detect]
run_in_blocks = 0
learn_blocks = 10
persist_blocks = 1
"""
_OPEN = {
    "xarray.open_zarr": "import xarray; found = xarray.open_zarr(place); assert found.rms.chunks",
    "spallwatch.open_archive": "import spallwatch; found = spallwatch.open_archive(place); assert found.rms.chunks",
    "nothing: import xarray, zarr, dask": "import xarray, zarr, dask.array",
}


def main() -> None:
    """Measure, print tables and write the figures."""
    options = arguments(__doc__ or "")
    count = 60 if options.quick else 1000
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(os.environ.get("ARCHIVE_FOLDER", scratch))
        _make(folder, count)
        out = folder / "out"
        archive, written = _archive(folder, out)
        place = str(out / "records.zarr")
        opened = _opened(
            {"the archive": place, "ten million rows": _large(out, Path(scratch))}, 5 if options.quick else 9
        )
        computed = _computed(place)
        equal = _equal(folder, place, 3 if options.quick else 20)
        pages = _page(written)
    for title, table in (
        ("The archive", [archive]),
        ("Opening lazily, a process each", opened),
        ("Computing", computed),
        ("Page of the fleet", pages),
        ("Against replays", [equal]),
    ):
        print_table(title, table)
    write_json(
        options.json,
        {"archive": archive, "opening": opened, "computing": computed, "page": pages, "against_replays": equal},
    )


def _make(folder: Path, count: int) -> None:
    """Write the recordings and the manifest, unless they are there."""
    machines = RUNS * SENSORS
    each = -(-count // machines)
    manifest = "".join(
        f'[[machine]]\nname = "rig-{run}-{sensor}"\nconfig = "m.toml"\nrecordings = "rig-{run}-{sensor}/*.npy"\n'
        for run in range(RUNS)
        for sensor in range(SENSORS)
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "m.toml").write_text(CONFIG)
    (folder / "manifest.toml").write_text(manifest)
    for run in range(RUNS):
        if len(list(folder.glob(f"rig-{run}-*/*.npy"))) < min(each, count) * SENSORS:
            _simulate(folder, run, each)
    for extra in sorted(folder.glob("rig-*/*.npy"))[count:]:
        extra.unlink()


def _simulate(folder: Path, run: int, each: int) -> None:
    """Write so many recordings of each sensor of a bearing that wears out."""
    blocks = -(-each // PARTS)
    source = open_rig(f"rig:ferrara?seed={run + 1}&healthy_blocks={blocks // 2}&blocks={blocks}", "rig")
    for number, block in zip(range(blocks), source, strict=False):
        for part, samples in enumerate(np.split(block.samples, PARTS, axis=1)):
            if number * PARTS + part < each:
                moment = BEGIN + datetime.timedelta(seconds=300 * number + 2 * part)
                for sensor in range(SENSORS):
                    path = folder / f"rig-{run}-{sensor}" / f"{moment:%Y%m%d-%H%M%S}.npy"
                    path.parent.mkdir(exist_ok=True)
                    np.save(path, samples[sensor : sensor + 1].astype(np.float32))


def _archive(folder: Path, out: Path) -> tuple[dict[str, Any], list[RecordingResult]]:
    """Replay the recordings by the command, days first; write the Zarr store of them, timed by itself."""
    noted = folder / "replay.json"
    if not noted.exists():
        noted.write_text(json.dumps(_replay(folder, out)))
    results = [RecordingResult.from_json(path.read_bytes()) for path in sorted(out.glob("rig-*/*/result.json"))]
    begun, cpu = time.perf_counter(), time.process_time()
    written = zarr_store.write_archive(results, FolderStore(out), str(out / "records.zarr"))
    found = {
        "recordings": len(results),
        "failed": sum(result.status == "failed" for result in results),
        "rows": written.rows,
        **json.loads(noted.read_text()),
        "zarr_wall_s": time.perf_counter() - begun,
        "zarr_cpu_s": time.process_time() - cpu,
        "zarr_mb": _megabytes(out / "records.zarr"),
        "zarr_files": sum(path.is_file() for path in (out / "records.zarr").rglob("*")),
        "days_mb": sum(file.size for result in results for file in result.files) / 1e6,
        "recordings_mb": sum(path.stat().st_size for path in folder.glob("rig-*/*.npy")) / 1e6,
    }
    return found, results


def _replay(folder: Path, out: Path) -> dict[str, float]:
    begun, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    options = ["--out", str(out), "--workers", "2", "--json", "--quiet"]
    subprocess.run(
        _python("from monitor.cli import main; main()", "archive", "replay", str(folder / "manifest.toml"), *options),
        check=True,
        capture_output=True,
    )
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"replay_wall_s": wall, "replay_cpu_s": cpu}


def _megabytes(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def _large(out: Path, scratch: Path) -> str:
    """Write what a reader of ten million rows opens: all metadata, and no rows."""
    root = json.loads((out / "records.zarr" / "zarr.json").read_bytes())
    arrays = root["consolidated_metadata"]["metadata"]
    dims = {name: tuple(array["dimension_names"][1:]) for name, array in arrays.items()}
    variables = {name: tuple("fault" if dim == "part" else dim for dim in found) for name, found in dims.items()}
    sizes = {"fault": 4, "harmonic": 5, "bpfo_harmonic": 6, "coefficient": 3, "band": 2, "threshold": 2}
    extent = Extent(LARGE.rows, LARGE.recordings, LARGE.channels, variables, sizes)
    labels = coordinates()
    arrays = [*arrays_of_rows(extent), *arrays_of_table(extent), *(array for array, _ in labels)]
    metadata = {array.name: zarr_store.metadata_of(array) for array in arrays}
    store = FolderStore(scratch / "large.zarr")
    for array, values in labels:
        for name, data in zarr_store.encoded(array, metadata[array.name], 0, values).items():
            store.write(name, data)
    store.write("zarr.json", zarr_store.root_of(metadata, global_attributes(extent)))
    return store.url


def _opened(places: dict[str, str], rounds: int) -> list[dict[str, Any]]:
    """Time each way of opening in a process of its own, taking turns."""
    cases = [(title, name) for title in places for name in _OPEN]
    times: dict[tuple[str, str], list[tuple[float, float]]] = {case: [] for case in cases}
    for _ in range(rounds):
        for title, name in cases:
            times[title, name].append(_process(f"place = {places[title]!r}; {_OPEN[name]}"))
    return [
        {
            "store": title,
            "by": name,
            "median_wall_s": statistics.median(wall for wall, _ in found),
            "least_wall_s": min(wall for wall, _ in found),
            "greatest_wall_s": max(wall for wall, _ in found),
            "median_cpu_s": statistics.median(cpu for _, cpu in found),
            "processes": rounds,
            "target_s": TARGET_S,
        }
        for (title, name), found in times.items()
    ]


def _process(code: str) -> tuple[float, float]:
    """Return wall and processor time of a Python process, s, from its start to its end."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(_python(code), check=True)
    wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _python(code: str, *more: str) -> list[str]:
    return [sys.executable, "-c", code, *more]


def _computed(place: str) -> list[dict[str, Any]]:
    """Time what users compute, of a store that is open already, twice: the median is of both."""
    found = xr.open_zarr(place)
    table = xr.open_zarr(place)[["machine", "recording_name", "row_size"]].compute()
    machine, name = str(table.machine.values[0]), str(table.recording_name.values[-1])
    final = found.stage.attrs["flag_meanings"].split().index("final") - 1
    whole: dict[str, Callable[[], object]] = {
        "mean RMS of each recording": lambda: found.rms.groupby(found.recording_index.compute()).mean().compute(),
        "share of rows in the final stage": lambda: (found.stage == final).mean().compute(),
        "greatest of each envelope line": lambda: found.envelope_snr.max("row").compute(),
        "all variables into memory": lambda: found.compute(),
        "one recording, all variables": lambda: sw.open_archive(place, machine=machine, recording=name),
    }
    rows = []
    for title, function in whole.items():
        times = []
        for _ in range(3):
            begun = time.perf_counter()
            function()
            times.append(time.perf_counter() - begun)
        rows.append({"what": title, "first_s": times[0], "median_s": statistics.median(times)})
    return rows


def _equal(folder: Path, place: str, number: int) -> dict[str, Any]:
    """Compare recordings, evenly taken, with replays of them alone."""
    paths = sorted(folder.glob("rig-*/*.npy"))
    chosen = paths[:: max(len(paths) // number, 1)]
    config = load_config(folder / "m.toml")
    equal = 0
    for path in chosen:
        with tempfile.TemporaryDirectory() as scratch:
            replay(config, str(path), Path(scratch))
            alone = sw.open_records(Path(scratch))
            found = sw.open_archive(place, machine=path.parent.name, recording=path.name)
            equal += found.drop_attrs().identical(alone.drop_attrs())
    return {"compared": len(chosen), "equal_bit_for_bit": equal}


def _page(results: list[RecordingResult]) -> list[dict[str, Any]]:
    """Time the page of the fleet, of these recordings and of ten times as many."""
    rows = []
    for copies in (1, 10):
        begun = time.perf_counter()
        page = fleet_page(results * copies)
        rows.append(
            {
                "recordings": len(results) * copies,
                "seconds": time.perf_counter() - begun,
                "mb": len(page.encode()) / 1e6,
            }
        )
    return rows


if __name__ == "__main__":
    main()
