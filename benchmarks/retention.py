"""Retention: what a simulated year of a channel takes on the disk, to open and to draw, with retention and without.

Run as ``python -m benchmarks.retention [--quick] [--json FILE]``. A year of blocks of 10 s (3,153,600; ``--quick``: 14
days) of one channel with all variables is put into a store day by day, as a stream does that ends nowhere; after each
day the rollup is brought up, and with ``full_days`` (30; ``--quick``: 2) the day that became too old is condensed and
the store shortened, in the steps of the daemon. Three tables:

1. size of the store, bytes a block, size of the published files (that of one written day, times the days), seconds
   to open and check the store as the daemon does, and milliseconds (median of 20) of the trends that the page draws
   of the whole time and of the newest day, and of the counts of blocks;
2. what retention takes over 20 days: microseconds a condensed block, and the 99th percentile and the longest step of
   each kind, ms: so long a block waits at most;
3. identities: blocks of which ten thousand, drawn at random, are offered again, by outcome; records of the trends and
   of the counts that are missing.
"""

from __future__ import annotations

import os
import random
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from benchmarks.records import made_up
from monitor.health.record import Record
from monitor.records.compact import file_bytes, shorten
from monitor.records.condense import condense
from monitor.records.database import SharedConnection
from monitor.records.filing import content_digest, ledger_digest
from monitor.records.ledger import StoreLedger
from monitor.records.packing import pack
from monitor.records.publish import file_name, publish
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.rollup import SeriesKey, roll_up
from monitor.records.store import Published, Store
from monitor.records.trends import read_trends

CHANNEL = "horizontal"
DAY_S = 86400.0
INTERVAL = 10.0
DAY_BLOCKS = round(DAY_S / INTERVAL)
BEGIN = 1_700_006_400.0
_STEP_S = 0.05
_DURABLE_DAYS = 20
"""Days whose steps are written durably and timed."""
_LEDGER = "source, sequence, content_hash, name, status, flags, reason, time, elapsed, day, axis_time, time_status"
_OFFERED = 10_000


@dataclass
class Steps:
    """Durations of the steps of retention, s, and how many blocks were condensed."""

    condense: list[float] = field(default_factory=list)
    shorten: list[float] = field(default_factory=list)
    blocks: int = 0


def first_record() -> Record:
    """Return the first block, with all variables of one channel."""
    record = made_up(1)[0]
    return replace(record, time=BEGIN, channels={CHANNEL: dict(record.channels[CHANNEL]) | {"quality_status": "ok"}})


def put_day(store: Store, day: int, row: bytes) -> None:
    """Put the blocks of a day into the store, made in SQL as copies of the first: committing them takes hours.

    Their digests are true, so that the newest pass the check at the start of a daemon.
    """
    first, last = max(day * DAY_BLOCKS, 1), (day + 1) * DAY_BLOCKS
    layout = store.rows("SELECT layout FROM layouts WHERE id = 1")[0][0]
    content = content_digest(layout, row, (), ())
    with store.transaction() as connection:
        connection.execute(
            "WITH RECURSIVE n(i) AS (SELECT ?1 UNION ALL SELECT i + 1 FROM n WHERE i + 1 < ?2)"
            " INSERT INTO blocks (id, source, sequence, content_hash, name, status, flags, reason, time, day,"
            " axis_time, time_status, run) SELECT i + 1, 'rig', i + 1, lower(hex(randomblob(16))),"
            " printf('block-%06d', i + 1), 'ok', '', '', ?3 + ?4 * i, ?5, ?3 + ?4 * i, 'given', 1 FROM n",
            (first, last, BEGIN, INTERVAL, int(BEGIN // DAY_S) + day),
        )
        ids = (first + 1, last)
        connection.execute("INSERT INTO records SELECT id, 1, ? FROM blocks WHERE id BETWEEN ? AND ?", (row, *ids))
        ledger = connection.execute(f"SELECT id, {_LEDGER} FROM blocks WHERE id BETWEEN ? AND ?", ids)
        digests = [(number, ledger_digest(entry), content) for number, *entry in ledger]
        connection.executemany("INSERT INTO digests VALUES (?, ?, ?, NULL)", digests)
        roll_up(connection, float("inf"))


def simulate(path: Path, days: int, full_days: float | None) -> Steps:
    """Make the store of so many days."""
    steps = Steps()
    record = first_record()
    with Store.open(path, machine="rig") as store, closing(StoreLedger(store)):
        with store.maintenance() as connection:
            connection.execute("PRAGMA synchronous = OFF")
        store.commit(record, {"channel:rig:horizontal": {"version": 1}})
        _, row = pack(record.channels)
        for day in range(days):
            put_day(store, day, row)
            number = int(BEGIN // DAY_S) + day
            store.note_published(Published(file_name("rig", number), number, (day + 1) * DAY_BLOCKS, 1))
            if full_days is not None:
                retain(store, full_days, steps, durable=full_days <= day < full_days + _DURABLE_DAYS)
    return steps


def retain(store: Store, full_days: float, steps: Steps, *, durable: bool) -> None:
    """Condense and shorten in the steps of the daemon; only durable ones are timed."""

    def condense_some(size: int) -> int:
        with store.transaction() as connection:
            return condense(connection, full_days * DAY_S, size)

    def shorten_some(size: int) -> int:
        with store.maintenance() as connection:
            return shorten(connection, size)

    with store.maintenance() as connection:
        connection.execute(f"PRAGMA synchronous = {'FULL' if durable else 'OFF'}")
    for action, spent, least, most in (
        (condense_some, steps.condense, 8, 512),
        (shorten_some, steps.shorten, 16, 1024),
    ):
        size = 64 if durable else most
        while True:
            began = time.perf_counter()
            done = action(size)
            took = time.perf_counter() - began
            if not done:
                break
            if durable:
                spent.append(took)
                steps.blocks += done if action is condense_some else 0
                size = max(least, size // 2) if took > _STEP_S else min(most, 2 * size)
    with store.maintenance() as connection:
        connection.execute("PRAGMA synchronous = OFF")


def median_ms(function: Callable[[], object]) -> float:
    """Return the median of 20 durations, ms."""
    spent = []
    for _ in range(20):
        began = time.perf_counter()
        function()
        spent.append(time.perf_counter() - began)
    return 1e3 * statistics.median(spent)


def measure(name: str, path: Path, days: int, file_size: int) -> Row:
    """Return sizes and durations of a store."""
    began = time.perf_counter()
    store, _ = open_or_salvage(path, machine="rig")
    with store, closing(StoreLedger(store)) as ledger, SharedConnection(path) as reader:
        ledger.committed("rig")
        store.load_states()
        opening = time.perf_counter() - began
        with store.maintenance() as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        key = SeriesKey("rig", CHANNEL, True)

        def trends(since: float | None) -> None:
            with reader.use() as connection:
                read_trends(connection, key, since=since)

        end = BEGIN + days * DAY_S
        return {
            "store": name,
            "blocks": days * DAY_BLOCKS,
            "store GB": file_bytes(path) / 1e9,
            "bytes a block": file_bytes(path) / (days * DAY_BLOCKS),
            "published GB": file_size * days / 1e9,
            "open s": opening,
            "whole trend ms": median_ms(lambda: trends(None)),
            "newest day ms": median_ms(lambda: trends(end - DAY_S)),
            "counts ms": median_ms(store.counts),
        }


def offered_again(path: Path, days: int) -> Row:
    """Offer blocks that are there; count records that trends and counts lack."""
    draw = random.Random(2)
    record = first_record()
    count = days * DAY_BLOCKS
    with Store.open(path, machine="rig") as store, SharedConnection(path) as reader:
        numbers = [draw.randrange(2, count + 1) for _ in range(_OFFERED)]
        with closing(StoreLedger(store)) as ledger:
            hashes = [ledger.content_of("rig", number) or "" for number in numbers]
        again = [
            replace(record, sequence=number, content_hash=digest)
            for number, digest in zip(numbers, hashes, strict=True)
        ]
        outcomes = Counter(store.commit_many([(item, {}) for item in again]))
        with reader.use() as connection:
            table = read_trends(connection, SeriesKey("rig", CHANNEL, True))
        drawn = int(np.sum(table.records))
        return {
            "offered": _OFFERED,
            "duplicate": outcomes["duplicate"],
            "taken again": outcomes["committed"],
            "missing in trends": count - drawn,
            "missing in counts": count - store.counts()["ok"],
        }


def published_size(folder: Path) -> int:
    """Return the size of the file of one day, bytes."""
    with Store.open(folder / "day.db", machine="rig") as store:
        record = first_record()
        store.commit(record, {})
        _, row = pack(record.channels)
        put_day(store, 0, row)
        (path,) = publish(store, folder / "day")
    return path.stat().st_size


def main() -> None:
    """Measure, print and write the tables."""
    options = arguments(__doc__ or "")
    days, full_days = (14, 2.0) if options.quick else (365, 30.0)
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        size = published_size(folder)
        sizes: list[Row] = []
        again: Row = {}
        steps = Steps()
        for label, keep in (("with retention", full_days), ("without", None)):
            path = folder / f"{label.replace(' ', '-')}.db"
            found = simulate(path, days, keep)
            steps = found if keep is not None else steps
            sizes.append(measure(f"{label}, {days} days", path, days, size))
            if keep is not None:
                again = offered_again(path, days)
            path.unlink()
    taken: Row = {
        "condensed blocks": steps.blocks,
        "us a block": 1e6 * sum(steps.condense) / steps.blocks,
        "steps": len(steps.condense),
        "99 % of steps ms": 1e3 * float(np.quantile(steps.condense, 0.99)),
        "longest step ms": 1e3 * max(steps.condense),
        "shortening steps": len(steps.shorten),
        "longest shortening ms": 1e3 * max(steps.shorten, default=0.0),
        "load at the start": load,
    }
    print_table("Store", sizes)
    print_table("Steps", [taken])
    print_table("Identities", [again])
    write_json(options.json, {"store": sizes, "steps": taken, "identities": again})


if __name__ == "__main__":
    main()
