"""Trends and kept spectra: what they cost while blocks are committed, and how quickly a life can be drawn.

Run as ``python -m benchmarks.trends [--quick] [--json FILE]``. Four tables:

1. committing blocks of 1 and of 64 channels one by one, with the rollup and without it, in turn: milliseconds a block,
   what the rollup adds in microseconds a block and channel, and the longest commit;
2. building the rollup of a year of blocks of 5 s (6,307,200; ``--quick``: 50,000) that has none yet, as a migration
   does: microseconds a block, milliseconds a commit, and seconds for the index over time;
3. milliseconds to answer a query over ranges that begin anywhere, median and 99th percentile, with the rows that come
   back, the time to read the same records whole where there are at most 20,000, and the largest difference between the
   extremes and those of the values that were put in;
4. envelope spectra: milliseconds of thread time that choosing, encoding and writing them add to a block of 5 s at
   25.6 kHz, committed one by one, bytes a spectrum, rows left, and the largest error of an amplitude, over itself.
"""

from __future__ import annotations

import math
import random
import sqlite3
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.records import made_up
from monitor.health.record import Record
from monitor.health.signal.waterfall import SpectrumChange, SpectrumRow, WaterfallSettings, WaterfallState, step
from monitor.records.packing import pack, places_of
from monitor.records.rollup import BATCH_BLOCKS, FEATURES, LEVELS_S, SeriesKey, roll_up, rolled_up_to
from monitor.records.spectra import read_spectra
from monitor.records.store import Store
from monitor.records.trends import TrendTable, read_trends

INTERVAL = 5.0
BEGIN = 1_700_006_400.0
CHANNEL = "horizontal"
_CHUNK = 20_000
_BINS = 6500
_SPANS = {"an hour": 3600.0, "a day": 86400.0, "a week": 604800.0, "58 days": 58 * 86400.0}
_YEAR = 365 * 17_280
Values = NDArray[np.float64]


def fill(path: Path, count: int) -> Values:
    """Make a store of records 5 s apart with trend features only; return these, shape (record, feature)."""
    values = made_up(1)[0].channels[CHANNEL]
    channels = {CHANNEL: {name: values[name] for name in FEATURES} | {"quality_status": "ok"}}
    with Store.open(path, machine="rig") as store:
        store.commit(Record("rig", 1, "b1", "0", time=BEGIN, channels=channels), {})
        layout, row = pack(channels)
        places = places_of(layout, FEATURES)[CHANNEL]
        first = np.frombuffer(row, dtype="<f8")
        draw = np.random.default_rng(0)
        values = np.exp(draw.normal(scale=0.2, size=(count, len(FEATURES))))
        values[0] = first[places]
        for begin in range(1, count, _CHUNK):
            end = min(begin + _CHUNK, count)
            rows = np.tile(first, (end - begin, 1))
            rows[:, places] = values[begin:end]
            _put(store, begin, rows)
        with store.transaction() as connection:
            roll_up(connection, math.inf)
    return values


def _put(store: Store, begin: int, rows: Values) -> None:
    """Copy the first block of the ledger with other times and values: committing them one by one takes an hour."""

    def blocks() -> Iterator[tuple[int, str, str, float, int, float]]:
        for number in range(begin, begin + len(rows)):
            moment = BEGIN + INTERVAL * number
            yield number + 1, f"{number:032x}", f"b{number + 1}", moment, int(moment // 86400), moment

    with store.transaction() as connection:
        connection.executemany(
            "INSERT INTO blocks (source, sequence, content_hash, name, status, flags, reason, time, day, axis_time,"
            " time_status, run) VALUES ('rig', ?, ?, ?, 'ok', '', '', ?, ?, ?, 'given', 1)",
            blocks(),
        )
        connection.executemany(
            "INSERT INTO records VALUES (?, 1, ?)",
            ((begin + place + 1, row.tobytes()) for place, row in enumerate(rows.astype("<f8"))),
        )


def committing(folder: Path, channels: int, count: int) -> Row:
    """Time commits with and without the rollup."""
    values = made_up(1)[0].channels[CHANNEL]
    spent: dict[str, list[float]] = {"without": [], "with": []}
    paths = {name: folder / f"{name}-{channels}.db" for name in spent}
    with Store.open(paths["without"], machine="rig") as without, Store.open(paths["with"], machine="rig") as store:
        for number in range(count):
            named = {CHANNEL: values} | {f"c{place}": values for place in range(1, channels)}
            record = Record("rig", number + 1, "b", "c", time=BEGIN + INTERVAL * number, channels=named)
            # In changing order: what runs second finds warm caches.
            for name in ("with", "without") if number % 2 else ("without", "with"):
                if name == "with":
                    spent[name].append(_thread_ms(lambda r=record: store.commit(r, {})))
                    continue
                with patch("monitor.records.store.roll_up", lambda connection: None):
                    spent[name].append(_thread_ms(lambda r=record: without.commit(r, {})))
    # The first commit of a store makes its layout and its run.
    means = {name: statistics.fmean(times[1:]) for name, times in spent.items()}
    return {
        "channels": channels,
        "blocks": count,
        "ms a block without": means["without"],
        "ms a block with": means["with"],
        "added us a block and channel": 1e3 * (means["with"] - means["without"]) / channels,
        "longest without ms": max(spent["without"][1:]),
        "longest with ms": max(spent["with"][1:]),
        "added bytes a block and channel": (_size(paths["with"]) - _size(paths["without"])) / count / channels,
    }


def _size(path: Path) -> int:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    return path.stat().st_size


def building(path: Path, count: int) -> Row:
    """Time the building of the rollup of a whole store, and of the index."""
    with Store.open(path, machine="rig") as store:
        with store.transaction() as connection:
            connection.execute("DROP INDEX blocks_by_time")
            connection.execute("DELETE FROM rollup")
            connection.execute("DELETE FROM meta WHERE key = 'rolled_up'")
            began = time.perf_counter()
            connection.execute(
                "CREATE INDEX blocks_by_time ON blocks (source, day IS NULL, instr(flags, 'clock') > 0, axis_time)"
            )
            index = time.perf_counter() - began
        wall, calls, rolled_up = time.perf_counter(), 0, 0
        while count - rolled_up >= BATCH_BLOCKS:
            with store.transaction() as connection:
                roll_up(connection)
                rolled_up = rolled_up_to(connection)
            calls += 1
        wall = time.perf_counter() - wall
    return {
        "blocks": count,
        "index s": index,
        "rollup s": wall,
        "us a block": 1e6 * wall / count,
        "commits": calls,
        "ms a commit": 1e3 * wall / calls,
        "bytes a block in the store": _size(path) / count,
    }


def asking(path: Path, values: Values, rounds: int) -> list[Row]:
    """Time queries over ranges of several lengths, and compare their answers with the values."""
    draw = random.Random(1)
    count = len(values)
    whole = INTERVAL * (count - 1)
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)
    key = SeriesKey("rig", CHANNEL, dated=True)
    rows: list[Row] = []
    for name, span in {**_SPANS, "all": whole}.items():
        if span > whole:
            continue
        for points in (300, 1000, 2000):
            times: list[float] = []
            error = 0.0
            table = None
            for _ in range(rounds):
                since = BEGIN + draw.random() * (whole - span)
                began = time.perf_counter()
                table = read_trends(connection, key, since, since + span, points)
                times.append(1e3 * (time.perf_counter() - began))
                error = max(error, _error(table, values))
            assert table is not None
            rows.append(
                {
                    "range": name,
                    "records": int(span / INTERVAL) + 1,
                    "points": points,
                    "rows": table.time.size,
                    "resolution s": table.resolution,
                    "ms": statistics.median(times),
                    "ms p99": float(np.quantile(times, 0.99)),
                    "ms reading them whole": _reading_ms(path, span) if points == 300 else None,
                    "largest error": error,
                }
            )
    connection.close()
    return rows


def _error(table: TrendTable, values: Values) -> float:
    """Return the largest difference between the extremes of a table and those of the values."""
    begin = np.rint((table.time - BEGIN) / INTERVAL).astype(np.int64)
    if table.resolution is None:
        low = high = values[begin]
    else:
        # Rows shorter than the finest stretch hold the records of the range only: its edges are left out.
        inner = slice(None) if table.resolution >= LEVELS_S[0] else slice(1, -1)
        first = np.ceil((table.time - BEGIN) / INTERVAL).astype(np.int64).clip(0)
        last = np.ceil((table.time + table.resolution - BEGIN) / INTERVAL).astype(np.int64).clip(0, len(values))
        low = np.array([values[a:b].min(axis=0) for a, b in zip(first[inner], last[inner], strict=True)])
        high = np.array([values[a:b].max(axis=0) for a, b in zip(first[inner], last[inner], strict=True)])
        table = TrendTable(
            table.dated,
            table.resolution,
            table.time[inner],
            {name: column[inner] for name, column in table.low.items()},
            {name: column[inner] for name, column in table.high.items()},
            table.records[inner],
            table.counts,
        )
    found_low = np.stack([table.low[name] for name in FEATURES], axis=1)
    found_high = np.stack([table.high[name] for name in FEATURES], axis=1)
    return float(max(np.abs(found_low - low).max(), np.abs(found_high - high).max()))


def _reading_ms(path: Path, span: float) -> float | None:
    """Return the time to read the first records of a store whole."""
    if span / INTERVAL > 20_000:
        return None
    with Store.open(path, read_only=True) as store:
        began = time.perf_counter()
        for stored in store.stored("axis_time <= ?", BEGIN + span):
            stored.to_record()
        return 1e3 * (time.perf_counter() - began)


def keeping(folder: Path, count: int) -> list[Row]:
    """Time what kept spectra add to commits: two stores take the same blocks in turn, one of them with spectra."""
    draw = np.random.default_rng(0)
    spectra = np.abs(draw.normal(size=(16, _BINS))).astype(np.float32)
    plan, state = WaterfallSettings(), WaterfallState()
    spent: dict[str, list[float]] = {"without": [], "with": []}
    with (
        Store.open(folder / "without.db", machine="rig") as without,
        Store.open(folder / "with.db", machine="rig") as store,
    ):
        for place, record in enumerate(made_up(count)):
            states = {"waterfall": state.to_dict()}
            spent["without"].append(_thread_ms(lambda r=record, s=states: without.commit(r, s)))
            began = time.thread_time()
            state, kind, thin = step(state, record.time, plan)
            row = _row(record, spectra[place % 16])
            store.commit(record, {"waterfall": state.to_dict()}, spectra=[SpectrumChange(row, kind, thin)])
            spent["with"].append(1e3 * (time.thread_time() - began))
        kept = read_spectra(store, CHANNEL)
    worst = 0.0
    for row in kept:
        given = spectra[(row.sequence - 1) % 16].astype(np.float64)
        worst = max(worst, float(np.max(np.abs(row.amplitude - given) / given)))
    means = {name: statistics.fmean(values) for name, values in spent.items()}
    return [
        {
            "blocks": count,
            "ms a block without": means["without"],
            "ms a block with": means["with"],
            "added ms": means["with"] - means["without"],
            "bytes a spectrum": 2 * _BINS,
            "rows left": len(kept),
            "largest relative error": worst,
        }
    ]


def _thread_ms(action: Callable[[], object]) -> float:
    began = time.thread_time()
    action()
    return 1e3 * (time.thread_time() - began)


def _row(record: Record, amplitude: NDArray[np.float32]) -> SpectrumRow:
    lines = {"outer": 119.0, "inner": 167.0, "ball": 150.0, "cage": 11.0}
    return SpectrumRow(
        record.source, CHANNEL, record.sequence, record.time, 0.2, (500.0, 6000.0), 30.0, 1.0, True, amplitude, lines
    )


def main() -> None:
    """Run the three tables."""
    options = arguments(__doc__ or "")
    count = 50_000 if options.quick else _YEAR
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tables = {
            "committing": [
                committing(folder, 1, 1280 if options.quick else 12_800),
                committing(folder, 64, 128 if options.quick else 1280),
            ]
        }
        values = fill(folder / "state.db", count)
        tables["building"] = [building(folder / "state.db", count)]
        tables["asking"] = asking(folder / "state.db", values, 10 if options.quick else 100)
        tables["spectra"] = keeping(folder, 1000 if options.quick else 10_000)
    print_table("Commits with and without the rollup", tables["committing"])
    print_table("Building the rollup of a store without one", tables["building"])
    print_table("Asking for trends", tables["asking"])
    print_table("Kept envelope spectra", tables["spectra"])
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
