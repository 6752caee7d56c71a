"""A statement of SQLite that fails at any place of a life, once or for a while, changes no record and ends nothing."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import load_config
from monitor.health.record import Record
from monitor.records.failures import StoreDamagedError
from monitor.records.store import Store
from monitor.service.daemon import Daemon, StoppedError
from streams.types.block import Block, Rejected
from streams.types.source import Delivery
from tests.support.daemon import put, running
from tests.support.daemons import make_machine, status
from tests.support.effort import effort_count
from tests.support.ingest import Queue, block, ingest_of, steps
from tests.support.store_faults import ERRORS, Faults
from tests.support.waiting import wait_until

BLOCKS = 4
KINDS = tuple(ERRORS)
BRIEF = tuple(kind for kind in KINDS if kind != "malformed")
NEVER = 10**9


class Blind(Queue):
    """A source that does not read the store when a block is acknowledged."""

    def acknowledge(self, delivery: Delivery) -> None:
        assert delivery is self.out
        self.acknowledged.append(delivery.item.sequence)


def taken(path: Path, faults: Faults) -> tuple[list[Record], dict[str, Any], dict[str, int]]:
    """Take blocks into a store, whose faults begin once it is open; return what it holds afterwards."""
    items: list[Block | Rejected] = [block(number) for number in range(1, BLOCKS + 1)]
    first, count = faults.first, faults.end - faults.first
    faults.first = faults.end = NEVER
    with Store.open(path, machine="m") as store:
        source = Blind(store, items)
        with ingest_of(store, source) as ingest:
            faults.first = faults.statements + first
            faults.end = faults.first + count
            steps(ingest, BLOCKS)
            faults.end = faults.first
            assert "store" not in ingest.problems()
        assert source.acknowledged == list(range(1, BLOCKS + 1))
        assert store.check() == []
        return list(store.records()), store.load_states(), store.counts()


@pytest.mark.parametrize("count", [1, 7])
def test_a_statement_that_fails_anywhere_changes_no_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    with monkeypatch.context() as patched:
        none = Faults(NEVER, 0, "busy")
        none.install(patched)
        expected = taken(tmp_path / "expected.db", none)
    fired = 0
    for number, first in enumerate(range(1, NEVER, effort_count(quick=5, full=1))):
        # What reads as malformed each time is malformed.
        kinds = KINDS if count == 1 else BRIEF
        faults = Faults(first, count, kinds[number % len(kinds)])
        with monkeypatch.context() as patched:
            faults.install(patched)
            assert taken(tmp_path / f"{first}.db", faults) == expected
        if not faults.fired:
            break
        fired += 1
    assert fired >= effort_count(quick=10, full=50)


@pytest.mark.process
def test_damage_found_twice_ends_the_ingest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.db"
    items: list[Block | Rejected] = [block(number) for number in range(1, 40)]
    with Store.open(path, machine="m") as store:
        source = Queue(store, items)
        with ingest_of(store, source) as ingest:
            steps(ingest, 20)
            with store.connection() as connection:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            harm = "import sys; f = open(sys.argv[1], 'r+b'); f.seek(100); f.write(b'\\xff' * 400_000)"
            subprocess.run([sys.executable, "-c", harm, str(path)], check=True)
            monkeypatch.setattr("monitor.records.failures._AGAIN_S", 0.01)
            with pytest.raises(StoreDamagedError, match="the next start makes it again"):
                steps(ingest, 19)
            assert 20 <= len(source.acknowledged) < 39


@contextmanager
def faulty(config: Path, faults: Faults) -> Iterator[Daemon]:
    """Run a daemon whose second file comes while statements fail, and check that it goes on."""
    put(config, 1)
    with running(config) as daemon:
        put(config, 2)
        wait_until(lambda: status(config)["blocks"] == 4)
        wait_until(lambda: faults.end == faults.first or faults.statements > faults.end)
        wait_until(lambda: status(config)["status"] == "running")
        yield daemon


def held(config: Path) -> list[Record]:
    with Store.open(config.parent / "state" / "state.db", read_only=True) as store:
        assert store.check() == []
        return list(store.records())


@pytest.mark.process
def test_a_daemon_goes_on_after_statements_that_fail_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.service.daemon._START_PAUSE_S", 0.05)
    folders = [tmp_path / name for name in ("none", *BRIEF)]
    expected: list[Record] = []
    told = 0
    for number, folder in enumerate(folders):
        folder.mkdir()
        config = make_machine(folder)
        faults = Faults(10 + 37 * number, 0 if number == 0 else 12, BRIEF[number - 1])
        with monkeypatch.context() as patched:
            faults.install(patched)
            with faulty(config, faults):
                told += bool(status(config)["failures"])
        assert not list((folder / "state").glob("*.corrupt-*"))
        if number == 0:
            expected = held(config)
            assert len(expected) == 4
            assert told == 0
        else:
            assert faults.fired == 12
            assert held(config) == expected
    # The first ones fail at the start, which is in the log alone.
    assert told >= len(BRIEF) // 2


@pytest.mark.process
def test_a_start_that_the_system_refuses_for_long_is_no_wrong_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.service.daemon._START_PAUSE_S", 0.05)
    monkeypatch.setattr("monitor.service.daemon._START_S", 0.5)
    sent: list[str] = []
    monkeypatch.setattr("monitor.service.daemon.ServiceManager.send", lambda self, *lines: sent.append(lines[0]))
    config = make_machine(tmp_path)
    Faults(5, NEVER, "read").install(monkeypatch)
    with pytest.raises(StoppedError, match=r"cannot start: .*disk I/O error") as told:
        Daemon(load_config(config)).run(threading.Event())
    assert told.value.exit_code == 1
    assert set(sent) == {"EXTEND_TIMEOUT_USEC=60000000"}
    found = status(config)
    assert found["status"] == "starting"
    assert "disk I/O error" in found["problems"]["start"]
