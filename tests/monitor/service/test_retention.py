"""The retention of the daemon: short steps, a size cap, a low disk; notices say what happens."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from monitor.config.machine import RetentionSection
from monitor.records.events import EventLog
from monitor.records.publish import days, file_name
from monitor.records.spectra import kept_blocks
from monitor.records.store import Published, Store
from monitor.service.publisher import PublishedFiles
from monitor.service.retention import Retention
from monitor.service.system import DiskGuard
from tests.monitor.records.condensed import BEGIN, DAY, EVENT_EVERY, PER_DAY, fill, present
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.waiting import wait_until

ALL_THERE = PublishedFiles(complete=True)


class Machine:
    """A store of four published days, its event log, and a clock that moves on with each look."""

    def __init__(self, folder: Path) -> None:
        self.store = Store.open(folder / "state.db", machine="m")
        self.blocks = self.store.last("s")
        self.log = EventLog(self.store.path)
        self.now = 0.0

    def monotonic(self) -> float:
        self.now += 0.001
        return self.now

    def retention(self, **section: Any) -> Retention:
        return Retention(
            RetentionSection(**section), self.store, self.log, monotonic=self.monotonic, clock=lambda: BEGIN
        )

    def run(self, retention: Retention, seconds: float, files: PublishedFiles = ALL_THERE, **more: Any) -> None:
        end = self.now + seconds
        while self.now < end:
            self.now += 0.1
            retention.tick(files, **{"idle": True, "disk": None, **more})

    def notices(self) -> list[str]:
        return [event.body["kind"] for _, event in self.log.notices()]


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of four published days, made once."""
    path = tmp_path_factory.mktemp("template") / "state.db"
    with Store.open(path, machine="m") as store:
        fill(store)
        for day, last in days(store):
            store.note_published(Published(file_name("m", day), day, last, 1))
    return path


@pytest.fixture
def machine(template: Path, tmp_path: Path) -> Iterator[Machine]:
    shutil.copy(template, tmp_path)
    made = Machine(tmp_path)
    yield made
    made.log.close()
    made.store.close()


def test_full_records_stay_for_so_many_days(machine: Machine) -> None:
    machine.run(machine.retention(), 60.0)
    assert len(present(machine.store)) == machine.blocks
    machine.run(machine.retention(full_days=2), 60.0)
    left = [number for number in present(machine.store) if number % EVENT_EVERY]
    assert left[0] == machine.blocks - 2 * PER_DAY
    assert machine.store.counts() == {"ok": machine.blocks}
    assert machine.notices() == []


def test_nothing_is_condensed_while_files_are_not_written(machine: Machine) -> None:
    machine.run(machine.retention(full_days=1), 60.0, PublishedFiles())
    assert len(present(machine.store)) == machine.blocks


def test_a_step_is_small_and_the_next_one_waits(machine: Machine) -> None:
    retention = machine.retention(full_days=1)
    retention.tick(ALL_THERE, idle=False, disk=None)
    first = machine.blocks - len(present(machine.store))
    assert 0 < first <= 64
    retention.tick(ALL_THERE, idle=False, disk=None)
    assert machine.blocks - len(present(machine.store)) == first


def test_a_low_disk_condenses_all_but_a_day_and_says_so_once(machine: Machine) -> None:
    retention = machine.retention()
    machine.run(retention, 60.0, disk="state: 300 MB are free on the disk")
    assert min(number for number in present(machine.store) if number % EVENT_EVERY) == machine.blocks - PER_DAY
    assert machine.notices() == ["disk_low"]
    assert retention.take_news()
    assert not retention.take_news()


def test_the_size_cap_condenses_then_says_what_to_do_and_deletes_only_where_it_may(machine: Machine) -> None:
    retention = machine.retention(max_gb=1e-6)
    machine.run(retention, 130.0)
    assert min(number for number in present(machine.store) if number % EVENT_EVERY) == machine.blocks - PER_DAY
    assert machine.notices() == ["size_cap"]
    assert retention.problem is not None
    assert "archive-days" in retention.problem
    assert retention.to_delete == 0
    retention = machine.retention(max_gb=1e-6, delete_published=True)
    machine.run(retention, 130.0)
    assert retention.to_delete > 0
    machine.run(machine.retention(max_gb=1.0), 130.0)


def test_lost_files_of_condensed_days_are_said_once(machine: Machine) -> None:
    retention = machine.retention(full_days=1)
    files = PublishedFiles(True, 0, ("m-20231115.nc",))
    machine.run(retention, 60.0, files)
    machine.run(retention, 60.0, files)
    assert machine.notices() == ["published_missing"]


def test_of_old_spectra_one_a_week_stays_with_the_pinned_ones(machine: Machine) -> None:
    rows = [("s", "x", day + 1, day * DAY, 2 if day == 3 else 1, "{}", b"") for day in range(60)]
    with machine.store.transaction() as connection:
        connection.executemany("INSERT INTO spectra VALUES (?, ?, ?, ?, ?, ?, ?, NULL)", rows)
    machine.run(machine.retention(spectra_days=20), 60.0)
    left = [number - 1 for number, _ in kept_blocks(machine.store, "x")]
    assert left == [0, 3, 7, 14, 21, 28, 35, *range(39, 60)]


def test_a_store_that_cannot_be_read_is_a_problem_and_no_exception(machine: Machine) -> None:
    retention = machine.retention(full_days=1)
    with machine.store.transaction() as connection:
        connection.execute("ALTER TABLE identities RENAME TO gone")
    machine.run(retention, 1.0)
    assert "no such table: identities" in (retention.problem or "")
    with machine.store.transaction() as connection:
        connection.execute("ALTER TABLE gone RENAME TO identities")
    machine.run(retention, 60.0)
    assert retention.problem is None


def test_the_disk_is_short_before_it_is_full_and_free_pages_of_an_old_store_count(tmp_path: Path) -> None:
    free, reusable = [2000], [0]
    guard = DiskGuard(tmp_path, lambda _: free[0], 1000, lambda: reusable[0])
    assert guard.check(0.0)
    assert guard.shortage is None
    free[0] = 1999
    assert guard.check(5.0)
    assert guard.shortage is not None
    free[0], reusable[0] = 500, 600
    assert guard.check(10.0)
    reusable[0] = 499
    assert not guard.check(15.0)
    free[0], reusable[0] = 200, 1 << 30
    assert not guard.check(20.0)
    free[0] = 2500
    assert guard.check(25.0)
    assert guard.shortage is None


@pytest.mark.process
def test_a_daemon_on_a_low_disk_thins_the_store_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.service.system._CHECK_DISK_S", 0.05)
    monkeypatch.setattr("monitor.service.retention._MAX_PAUSE_S", 0.1)
    monkeypatch.setattr("monitor.service.retention.MIN_FULL_S", 1.0)
    config = make_machine(tmp_path)
    for number in range(40):
        put(config, number)
    free = [10**9]
    with running(config, free=lambda _: free[0]):
        wait_until(lambda: last(config) == 80)
        assert condensed(config) == 0
        free[0] = 1_500_000
        wait_until(lambda: condensed(config) > 50)
        put(config, 40)
        wait_until(lambda: last(config) == 82)
        assert status(config)["status"] == "running"
    with EventLog(tmp_path / "state" / "state.db") as log:
        assert [event.body["kind"] for _, event in log.notices()] == ["disk_low"]


def condensed(config: Path) -> int:
    with Store.open(config.parent / "state" / "state.db", read_only=True) as store:
        return store.rows("SELECT count(*) FROM identities")[0][0]
