"""What a year costs on the disk: a year of blocks in compressed time, with default settings and with a quota.

    python -m benchmarks.service.year [--quick] [--json FILE]

Blocks of 5 s at 25.6 kHz of one channel, one every 10 minutes (52,560; ``--quick``: every hour, 8,760), go through the
stages; each is committed to two stores, one with the default settings and one with a quota, which is halved after 9
months. Blocks are drawn from a few signals; an outer race fails during the last two months, so that there are events
and forecasts. The clock is that of the blocks: retention runs every hour of it, files are published every day of it and
where the quota asks for deletion, by the functions of the daemon. Bytes are those of SQLite's pages by table and of the
files.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, Tables, benchmark
from monitor.config.load import Config, validate
from monitor.config.machine import RetentionSection
from monitor.health.record import Record
from monitor.records.compact import file_bytes, settle_log
from monitor.records.events import EventLog
from monitor.records.publish import delete_oldest, missing_files, publish, published_bytes
from monitor.records.published_folder import snapshot_path
from monitor.records.quota import note_days_given_up
from monitor.records.store import Store
from monitor.service.publisher import PublishedFiles
from monitor.service.retention import Retention
from monitor.service.setup import source_settings
from reference.signals import bearing_lines, impacts
from reference.steps import Steps
from streams.types.block import Block

RATE, SECONDS, SPEED = 25600.0, 5.0, 25.0
INTERVAL_S, HOUR_S, DAY_S = 600.0, 3600.0, 86400.0
BEGIN = 1_767_225_600.0
DAYS = 365
QUOTA_GB, QUICK_QUOTA_GB, LOWERED_TO, LOWERED_AFTER = 0.15, 0.06, 0.5, 0.75
FAILS_AFTER = 5.0 / 6.0
_SIGNALS = 12
_MAX_TICKS = 3600
_GROUPS = {
    "full records": ("blocks", "records", "digests", "layouts"),
    "forecasts, events": ("forecasts", "events", "condensed_forecasts", "forecast_inputs", "notices"),
    "trends": ("rollup",),
    "identities": ("identities",),
}


def machine(folder: Path) -> Config:
    """Return the configuration: defaults but for what has none."""
    return validate(
        {
            "machine": {"name": "m"},
            "bearing": [{"name": "b", "designation": "1205 ETN9"}],
            "operating": {"speed_hz": SPEED},
            "source": [{"name": "s", "url": f"folder:{folder}", "rate_hz": RATE, "block_s": SECONDS}],
            "channel": [{"name": "x", "source": "s", "column": 1, "unit": "m/s2", "bearing": "b"}],
        },
        folder / "machine.toml",
    )


def blocks(interval: float) -> Iterator[Block]:
    """Yield the blocks of a life: the outer race fails in its last sixth."""
    rng = np.random.default_rng(39)
    lines = bearing_lines("1205 ETN9", SPEED)[1]
    made = [
        np.asarray(impacts(rng, "outer", lines, rate=RATE, duration=SECONDS, height=height), dtype=np.float32)
        for height in (0.0, *np.geomspace(0.5, 12.0, _SIGNALS - 1))
    ]
    healthy: list[NDArray[np.float32]] = [rng.standard_normal(made[0].size).astype(np.float32) for _ in range(_SIGNALS)]
    count = round(DAYS * DAY_S / interval)
    for number in range(count):
        part = (number / count - FAILS_AFTER) / (1.0 - FAILS_AFTER)
        signal = healthy[number % _SIGNALS] if part < 0.0 else made[int(part * _SIGNALS)]
        samples = signal * np.float32(1.0 + 0.02 * rng.standard_normal())
        yield Block(
            samples[None], RATE, ("x",), ("m/s2",), "s", number + 1, f"b{number}.csv",
            start=BEGIN + interval * number, elapsed=interval * number, content_hash=rng.bytes(16).hex(),
        )  # fmt: skip


@dataclass
class Monitored:
    """A store with its retention and its files, and what was seen of it.

    Attributes:
        quota: GB, None without one.
        peak: greatest share of the quota at the end of an hour, beyond that at which it was lowered.
        over: hours at the end of which it was exceeded.
    """

    folder: Path
    quota: float | None = None
    peak: float = 0.0
    hours: int = 0
    over: int = 0
    now: float = 0.0
    files: PublishedFiles = field(default_factory=PublishedFiles)
    busy_s: float = 0.0

    def __post_init__(self) -> None:
        """Open the store."""
        self.store = Store.open(self.folder / "state.db", machine="m")
        self.log = EventLog(self.store.path)
        self.records_dir = self.folder / "records"
        self.limit(self.quota)

    def limit(self, quota: float | None) -> None:
        """Begin with a quota, as a daemon that is started with another one."""
        self.quota = quota
        section = RetentionSection(max_gb=quota, delete_published=quota is not None)
        clock = {"monotonic": lambda: self.now, "clock": lambda: BEGIN + self.now}
        self.retention = Retention(section, self.store, self.log, **clock)

    def hour(self, items: Sequence[tuple[Record, Any]], spectra: Sequence[Any], *, day_ends: bool) -> None:
        """Commit the blocks of an hour, publish where a day has ended, and let the retention work."""
        self.store.commit_many(items, spectra=spectra)
        if day_ends:
            self.publish()
        began, began_at = time.thread_time(), self.now
        for _ in range(_MAX_TICKS):
            self.now += HOUR_S / _MAX_TICKS
            before = self._work()
            self.retention.tick(self.files, idle=True, disk=None)
            if self._work() == before and self.retention.problem is None:
                break
        self.now = began_at + HOUR_S
        self.busy_s += time.thread_time() - began
        self.hours += 1
        if self.retention.to_delete:
            self.publish()
        if self.quota is not None:
            share = self.bytes() / (1e9 * self.quota)
            self.peak, self.over = max(self.peak, share), self.over + (share > 1.0)

    def publish(self) -> None:
        """Publish as the daemon's publisher does, and delete what the quota asks for."""
        publish(self.store, self.records_dir)
        if delete_oldest(self.store, self.records_dir, self.retention.to_delete, BEGIN + self.now):
            note_days_given_up(self.store, BEGIN + self.now)
        missing = tuple(missing_files(self.store, self.records_dir))
        self.files = PublishedFiles(True, published_bytes(self.records_dir, "m"), missing)

    def bytes(self) -> int:
        """Return the bytes of store, log and published files."""
        return file_bytes(self.store.path) + published_bytes(self.records_dir, "m")

    def _work(self) -> tuple[int, int]:
        with self.store.connection() as connection:
            return connection.total_changes, connection.execute("PRAGMA freelist_count").fetchone()[0]

    def kinds(self) -> dict[str, float]:
        """Return the megabytes of each kind; the log is emptied before."""
        settle_log(self.store)
        rows = dict(self.store.rows("SELECT name, sum(pgsize) FROM dbstat GROUP BY name"))
        tables = dict(self.store.rows("SELECT name, tbl_name FROM sqlite_master"))
        found = {
            kind: sum(size for name, size in rows.items() if tables.get(name) in names)
            for kind, names in _GROUPS.items()
        }
        query = "SELECT coalesce(sum(json_extract(header, '$.view.sizes[2]')), 0), coalesce(sum(length(view)), 0)"
        waveforms, views = self.store.rows(f"{query}, count(*) FROM spectra")[0][:2]
        spectra = rows.get("spectra", 0) - views
        found |= {"waveforms": waveforms, "raw spectra": views - waveforms, "envelope spectra": spectra}
        wal = file_bytes(self.store.path) - self.store.path.stat().st_size
        found["states, free, rest"] = self.store.path.stat().st_size - sum(found.values())
        found |= {"write-ahead log": wal, "published files": published_bytes(self.records_dir, "m")}
        found["snapshot"] = snapshot_path(self.records_dir, "m").stat().st_size
        found["all"] = sum(found.values())
        return {kind: size / 1e6 for kind, size in found.items()}

    def close(self) -> None:
        """Close the store."""
        self.log.close()
        self.store.close()


def live(interval: float, quota: float, folder: Path) -> tuple[Monitored, Monitored, list[Row]]:
    """Take a year of blocks into both stores; return them, and their bytes month by month."""
    config = machine(folder)
    steps = Steps(source_settings(config, config.source[0]))
    places = [folder / name for name in ("default", "quota")]
    for place in places:
        place.mkdir()
    free, bound = Monitored(places[0]), Monitored(places[1], quota)
    per_hour, hours = round(HOUR_S / interval), round(DAYS * DAY_S / HOUR_S)
    months: list[Row] = []
    items: list[tuple[Record, Any]] = []
    spectra: list[Any] = []
    for block in blocks(interval):
        record = steps.take(block)
        items.append((record, steps.stored()))
        spectra += steps.spectra
        if len(items) < per_hour:
            continue
        hour = free.hours
        if hour == round(LOWERED_AFTER * hours):
            bound.limit(LOWERED_TO * quota)
        for each in (free, bound):
            each.hour(items, spectra, day_ends=hour % 24 == 23)
        items, spectra = [], []
        if free.hours % max(1, hours // 12) == 0:
            sizes = {"default MB": free.bytes() / 1e6, "with quota MB": bound.bytes() / 1e6}
            months.append({"day": free.hours // 24, **sizes, "quota MB": 1e3 * (bound.quota or 0.0)})
    return free, bound, months


@benchmark(__doc__)
def measure(quick: bool) -> Tables:
    """Measure a year."""
    interval, limit = (HOUR_S, QUICK_QUOTA_GB) if quick else (INTERVAL_S, QUOTA_GB)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        free, bound, months = live(interval, limit, Path(name))
        count = round(DAYS * DAY_S / interval)
        by_quota = bound.kinds()
        kinds = [
            {"kind": kind, "default MB": size, "B/block": 1e6 * size / count, "with quota MB": by_quota[kind]}
            for kind, size in free.kinds().items()
        ]
        with free.store.connection() as connection:
            events = connection.execute("SELECT count(*) FROM events").fetchone()[0]
        values = bound.retention.values() or {}
        quota: Row = {
            "interval s": interval,
            "blocks": count,
            "events": events,
            "hours": bound.hours,
            "hours beyond the quota": bound.over,
            "greatest share of it": bound.peak,
            "given up": ", ".join(values["given_up"]),
            "counted": sum(bound.store.counts().values()),
            "problem": bound.retention.problem,
            "retention s": bound.busy_s,
            "seconds": time.monotonic() - began,
            "RSS MB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
        }
        for each in (free, bound):
            each.close()
    return {"bytes by kind, one channel": kinds, "month by month": months, "quota": quota}
