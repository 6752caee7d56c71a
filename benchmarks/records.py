"""Records: what a commit, reading back and publishing cost, and that nothing is lost on the way.

Run as ``python -m benchmarks.records [--quick] [--json FILE]``. Two tables:

1. milliseconds per block of two channels to commit alone (as the daemon does), to commit in batches of 64 (as a replay
   does) and to read back, with the thread time beside the time that passes: the difference is the disk; and the number
   of records that differ from what was committed;
2. milliseconds to publish a day of 17,280 blocks of 5 s as netCDF, by step, the size of the file, and the largest
   difference between the published RMS and the one committed.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from benchmarks.common import Row, arguments, print_table, write_json
from monitor.health.record import Record
from monitor.health.schema import DIMENSION_SIZES, VARIABLES
from monitor.records.publish import day_dataset, days, publish
from monitor.records.store import Store

DAY_BLOCKS = 17_280
BATCH = 64
_MIDNIGHT = 1_700_006_400.0


def made_up(count: int) -> list[Record]:
    """Records in which every variable of both channels has a value: the most that a block can cost."""
    draw = random.Random(1)

    def value(kind: str, values: tuple[str, ...], dims: tuple[str, ...]) -> Any:
        if dims:
            return tuple(value(kind, values, dims[1:]) for _ in range(DIMENSION_SIZES.get(dims[0], 1)))
        if values:
            return draw.choice(values)
        return draw.random() if kind == "float" else draw.randrange(1, 1000)

    return [
        Record(
            source="rig",
            sequence=number + 1,
            name=f"block-{number + 1:06d}",
            content_hash=f"{number:032x}",
            time=_MIDNIGHT + 5.0 * number,
            elapsed=5.0 * number,
            channels={
                channel: {
                    variable.name: value(variable.kind, variable.values, variable.dims)
                    for variable in VARIABLES.values()
                }
                for channel in ("horizontal", "vertical")
            },
        )
        for number in range(count)
    ]


def timed(step: Callable[[], object], blocks: int) -> tuple[float, float]:
    """Return the thread time and the passed time of a step, ms per block."""
    thread, wall = time.thread_time(), time.perf_counter()
    step()
    return 1e3 * (time.thread_time() - thread) / blocks, 1e3 * (time.perf_counter() - wall) / blocks


def committing(folder: Path, count: int) -> list[Row]:
    """Time commits and reading back."""
    records = made_up(count)
    states = {"detect:horizontal": {"version": 1, "learned": [[0.1, 0.2, 0.3]] * 100}}
    batches = [[(record, states) for record in records[at : at + BATCH]] for at in range(0, count, BATCH)]
    rows: list[Row] = []
    with Store.open(folder / "one.db", machine="rig") as one, Store.open(folder / "many.db", machine="rig") as many:
        for name, store, step in (
            ("commit, one block a transaction", one, lambda: [one.commit(record, states) for record in records]),
            (f"commit, {BATCH} blocks a transaction", many, lambda: [many.commit_many(batch) for batch in batches]),
            ("read back", many, lambda: list(many.records())),
        ):
            thread, wall = timed(step, count)
            differ = sum(first != second for first, second in zip(records, store.records(), strict=True))
            rows.append({"step": name, "thread ms": thread, "passed ms": wall, "records that differ": differ})
    size = (folder / "many.db").stat().st_size / count
    return [{**row, "bytes a block": size} for row in rows]


def publishing(folder: Path, blocks: int) -> list[Row]:
    """Time the publication of a day."""
    records = made_up(blocks)
    with Store.open(folder / "day.db", machine="rig") as store:
        store.commit_many([(record, {}) for record in records])
        ((day, _),) = days(store)
        stored: list[Any] = []
        steps: dict[str, Callable[[], object]] = {
            "read the day": lambda: stored.extend(store.stored("day IS ?", day)),
            "read and build the dataset": lambda: day_dataset(store, day),
            "publish: read, build, write, make durable": lambda: publish(store, folder / "records"),
            "publish: nothing changed": lambda: publish(store, folder / "records"),
        }
        rows: list[Row] = []
        for name, step in steps.items():
            thread, wall = timed(step, 1)
            rows.append({"step": name, "blocks": blocks, "thread ms": thread, "passed ms": wall})
        (path,) = publish(store, folder / "records", rebuild=True)
    with xr.open_dataset(path) as dataset:
        committed = np.array([record.channels["vertical"]["rms"] for record in records])
        error = float(np.max(np.abs(dataset.rms.sel(channel="vertical").values - committed)))
    size = path.stat().st_size / 1e6
    return [{**row, "file MB": size, "largest error of RMS": error} for row in rows]


def main() -> None:
    """Run both tables."""
    options = arguments(__doc__ or "")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tables = {
            "commit": committing(folder, 300 if options.quick else 3000),
            "publish": publishing(folder, 2000 if options.quick else DAY_BLOCKS),
        }
    print_table("Records of two channels, every variable present", tables["commit"])
    print_table("A day as netCDF", tables["publish"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
