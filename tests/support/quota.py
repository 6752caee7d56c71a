"""A store whose retention keeps to a quota: blocks with views, published days, and what may never leave."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from monitor.config.machine import RetentionSection
from monitor.health.record import Record
from monitor.health.signal.spectra import BlockView, RawSpectra
from monitor.health.signal.waterfall import Kind, SpectrumChange, SpectrumRow
from monitor.records.compact import file_bytes
from monitor.records.events import EventLog
from monitor.records.publish import days, file_name
from monitor.records.spectra import read_block_view
from monitor.records.store import Published, Store
from monitor.service.publisher import PublishedFiles
from monitor.service.retention import Retention

BEGIN = 1_700_006_400.0
HOUR = 3600.0
DAY_FILE = 30_000
"""Bytes of a published day, whose content does not matter here."""


def change(number: int, time: float, kind: Kind) -> SpectrumChange:
    """Return a spectrum with a view of 40 kB."""
    random = np.random.default_rng(number)
    spectra = RawSpectra(1.0, random.random(2000), 12.5, random.random(2048))
    view = BlockView(25600.0, 128_000, spectra, random.normal(size=16_384))
    amplitude = random.random(500)
    row = SpectrumRow("s", "x", number, time, 1.0, (1.0, 2.0), 25.0, 1.0, True, amplitude, {"outer": 90.0}, view=view)
    return SpectrumChange(row, kind)


class Bounded:
    """A store, its retention, and a clock of its own; published days are numbers only."""

    def __init__(self, path: Path, quota: float) -> None:
        """Open the store; the quota is in bytes."""
        self.store = Store.open(path, machine="m")
        self.log = EventLog(path)
        self.number, self.time, self.now = self.store.last("s"), BEGIN, 0.0
        self.deleted: set[str] = set()
        self.times: dict[int, float] = {}
        self.limit(quota)

    def limit(self, quota: float) -> None:
        """Begin with another quota, as after a restart."""
        section = RetentionSection(max_gb=quota / 1e9, delete_published=True)
        clocks: dict[str, Any] = {"monotonic": lambda: self.now, "clock": lambda: self.time}
        self.quota, self.retention = quota, Retention(section, self.store, self.log, **clocks)

    def block(self, kind: Kind, *, event: bool = False, forecast: bool = False) -> None:
        """Commit a block at the present time."""
        self.number += 1
        self.times[self.number] = self.time
        values = {"rms": 1.0 + self.number % 7, "stage": "healthy", "bpfo_amplitude": [1.0] * 6}
        record = Record(
            source="s",
            sequence=self.number,
            name=f"b{self.number}",
            content_hash=f"{self.number:032x}",
            time=self.time,
            channels={"x": values},
            events=({"kind": "tick", "n": self.number},) if event else (),
            forecasts=({"channel": "x", "status": "ok", "tt_s": 1.0},) if forecast else (),
        )
        state = {"detect:x": {"seen": self.number}}
        self.store.commit(record, state, spectra=[change(self.number, self.time, kind)])

    def published(self) -> int:
        """Publish all days, delete what is asked for, and return the bytes of the files."""
        found = {file_name("m", day): (day, last) for day, last in days(self.store)}
        noted = dict(self.store.rows("SELECT file, last_block FROM published"))
        for name, (day, last) in found.items():
            if noted.get(name) != last:
                self.store.note_published(Published(name, day, last, DAY_FILE))
        names = sorted({name for (name,) in self.store.rows("SELECT file FROM published")} - self.deleted)
        end = self.store.rows("SELECT coalesce(max(CAST(value AS INTEGER)), 0) FROM meta WHERE key='condensed_up_to'")
        less = self.retention.to_delete
        for name in names:
            (last,) = self.store.rows("SELECT last_block FROM published WHERE file = ?", name)[0]
            if less <= 0 or last > end[0][0]:
                break
            self.deleted.add(name)
            less -= DAY_FILE
        return DAY_FILE * len(set(names) - self.deleted)

    def hour(self, hours: float = 1.0, ticks: int = 120) -> int:
        """Let time pass, with a publication a minute; return the bytes of store, log and files at its end."""
        size = 0
        for _ in range(ticks):
            size = self.published()
            before = self.used(size), self.retention.to_delete
            for _ in range(4):
                self.now += 15.0
                self.retention.tick(PublishedFiles(True, size), idle=True, disk=None)
            if before == (self.used(self.published()), self.retention.to_delete):
                break
        self.time += HOUR * hours
        return self.used(self.published())

    def used(self, files: int) -> int:
        """Return the bytes of store, log and files of so many."""
        return file_bytes(self.store.path) + files

    def check(self, pinned: set[int], events: set[int], forecasts: set[int]) -> None:
        """Fail where something is gone that may never leave."""
        store = self.store
        present = {number for (number,) in store.rows("SELECT sequence FROM blocks")}
        gone = {number for (number,) in store.rows("SELECT sequence FROM identities")}
        assert present | gone == set(range(1, self.number + 1))
        assert not present & gone
        assert {event["n"] for event in store.events()} == events <= present
        assert {row.block for row in store.forecasts()} == forecasts
        assert store.counts() == {"ok": self.number}
        assert store.load_states() == {"detect:x": {"seen": self.number}}
        assert store.record("s", self.number) is not None
        newest = max(self.times.values(), default=0.0)
        assert {number for number, time in self.times.items() if time >= newest - 24 * HOUR} <= present
        for number in pinned | {self.number}:
            row = read_block_view(store, "x", at=number)
            assert row is not None
            assert row.view is not None
            assert row.view.waveform.size == 16_384
        totals = store.rows("SELECT level, sum(records) FROM rollup WHERE level > 600 GROUP BY level")
        assert len({count for _, count in totals}) <= 1

    def close(self) -> None:
        """Close the store."""
        self.log.close()
        self.store.close()
