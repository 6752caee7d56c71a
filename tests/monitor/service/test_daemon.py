"""The daemon in this process: what it says of itself; full disks, lost files and noisy neighbours end nothing."""

from __future__ import annotations

import json
import os
import re
import socket
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from monitor import __version__
from monitor.config.load import ConfigError, load_config
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.store import Store
from monitor.service.companions import Companions
from monitor.service.daemon import Daemon, free_bytes
from monitor.service.machine_status import channel_state
from monitor.service.progress import boot_id
from monitor.service.system import DiskGuard, ServiceManager, StatusFile, present_status, read_status
from tests.support.commands import run_command
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.docs import DOCS, read, table
from tests.support.waiting import PATIENCE_S, at_most, wait_until


@pytest.mark.process
def test_it_says_what_it_does_until_it_stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.service.companions._LAST_PUBLICATION_S", 600.0)
    told: list[str] = []
    monkeypatch.setattr(ServiceManager, "send", lambda self, *lines: told.append(lines[0]))
    end = Companions.end
    monkeypatch.setattr(Companions, "end", lambda self, *, room: (told.append("published"), end(self, room=room))[1])
    config = make_machine(tmp_path, sources=2)
    put(config, 1)
    (tmp_path / "in0" / "notes.md").touch()
    with running(config):
        wait_until(lambda: status(config)["sources"]["s0"]["accepted"] == 1 and status(config)["blocks"] == 2)
        found = read_status(tmp_path / "state")
        shown = present_status(load_config(config))
        with pytest.raises(StoreError, match="another daemon is running"):
            StatusFile.open(tmp_path / "state")
    assert found["running"]
    assert (found["status"], found["problems"], found["machine"]) == ("running", {}, "m")
    counts = {"offered": 2, "accepted": 1, "rejected": 0, "pending": 0, "ignored": 1, "oldest_age_s": 0.0, "refused": 0}
    assert found["sources"]["s0"] == counts
    assert found["ignored"] == {"s0/notes.md": "of another format than csv (*.csv, *.txt, *.tsv, *.dat, *.asc, *.lvm)"}
    first, second = found["channels"]["x0"], found["channels"]["x1"]
    assert (first["stage"], first["last_block"], first["last_block_status"]) == ("learning", 2, "ok")
    assert (first["state"], second["state"]) == ("check_function", "check_function")
    assert second["last_block"] is None
    identity = [found[key] for key in ("pid", "boot", "version", "config_hash")]
    assert identity == [os.getpid(), boot_id(), __version__, load_config(config).hash]
    rows = ",".join(name for name in table(read(DOCS / "reference" / "daemon.md"), "## Status") if "." not in name)
    assert shown.keys() | {"stall"} == set(re.findall(r"`(\w+)`", rows))
    after = read_status(tmp_path / "state")
    assert (after["running"], after["status"]) == (False, "stopped")
    assert told == ["READY=1", "STOPPING=1", "published"]
    with xr.open_dataset(tmp_path / "records" / "m-undated.nc") as dataset:
        assert dataset.sizes["time"] == 2
        assert dataset.attrs["config_hash"] == load_config(config).hash


@pytest.mark.process
def test_a_restart_knows_what_was_and_goes_on(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    put(config, 1)
    with running(config):
        wait_until(lambda: status(config)["blocks"] == 2)
    with running(config):
        wait_until(lambda: status(config)["status"] == "running")
        assert status(config)["channels"]["x0"]["last_block"] == 2
        assert status(config)["sources"]["s0"]["accepted"] == 1
        put(config, 2)
        wait_until(lambda: last(config) == 4)
    assert status(config)["blocks"] == 2
    out = ("--out", tmp_path / "out", "--no-report", "--json")
    replayed = json.loads(run_command("replay", tmp_path / "in0", "--config", config, *out).stdout)
    ours, theirs = status(config)["channels"]["x0"].keys(), replayed["channels"]["x0"].keys()
    own = {"source", "state", "reason", "alarms", "levels"}
    assert own | {f"last_block{end}" for end in ("", "_utc", "_status", "_age_s")} == ours - theirs
    assert theirs <= ours
    assert status(config)["bearings"] == replayed["bearings"]
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert store.rows("SELECT count(*), max(run) FROM runs JOIN blocks ON run = runs.id") == [(4, 1)]
        assert store.rows("SELECT count(*) FROM runs") == [(1,)]


@pytest.mark.process
def test_without_room_on_the_disk_nothing_is_taken_until_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.service.system._CHECK_DISK_S", 0.05)
    config = make_machine(tmp_path)
    free = [10**9]
    put(config, 1)
    with running(config, free=lambda _: free[0]):
        wait_until(lambda: last(config) == 2)
        free[0] = 1000
        wait_until(lambda: status(config)["status"] == "degraded")
        assert "nearly full" in status(config)["problems"]["disk"]
        put(config, 2)
        time.sleep(0.5)
        assert last(config) == 2
        free[0] = 10**9
        wait_until(lambda: last(config) == 4)
        wait_until(lambda: status(config)["status"] == "running")
        assert status(config)["problems"] == {}


@pytest.mark.process
def test_a_store_that_cannot_commit_ends_nothing_and_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.pipeline._RETRY_S", 0.05)
    config, full = make_machine(tmp_path), threading.Event()
    commit = Store.commit_many

    def fails(store: Store, *values: Any) -> object:
        if full.is_set():
            raise StoreError("state.db: database or disk is full")
        return commit(store, *values)

    monkeypatch.setattr(Store, "commit_many", fails)
    full.set()
    put(config, 1)
    with running(config):
        wait_until(lambda: status(config).get("status") == "degraded")
        told = r"state\.db: database or disk is full \((once|\d+ times) since 20\d\d-.*Z\)"
        assert re.fullmatch(told, status(config)["problems"]["store"])
        wait_until(lambda: status(config)["sources"]["s0"]["oldest_age_s"] > 0.5)
        assert status(config)["sources"]["s0"]["pending"] == 1
        full.clear()
        wait_until(lambda: last(config) == 2)
        wait_until(lambda: status(config)["status"] == "running")
        assert status(config)["failures"]["store"]["last_cause"] == "state.db: database or disk is full"


@pytest.mark.process
def test_it_stops_in_order_while_the_store_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(store: Store, *values: Any) -> object:
        raise StoreError("state.db: database or disk is full")

    monkeypatch.setattr(Store, "commit_many", fails)
    config = make_machine(tmp_path)
    put(config, 1)
    with ExitStack() as ending, running(config):
        wait_until(lambda: status(config)["problems"])
        ending.enter_context(at_most(5.0))
    assert status(config)["status"] == "stopped"


@pytest.mark.process
def test_silence_and_rejections_are_no_health(tmp_path: Path) -> None:
    config, late = make_machine(tmp_path), [0.0]
    with running(config, monotonic=lambda: time.monotonic() + late[0]):
        wait_until(lambda: status(config).get("channels"))
        assert status(config)["channels"]["x0"]["state"] == "check_function"
        late[0] = 601.0
        wait_until(lambda: status(config)["channels"]["x0"]["state"] == "no_data")
        put(config, 1)
        wait_until(lambda: status(config)["channels"]["x0"]["state"] == "check_function")
        (tmp_path / "in0" / "f9.csv").write_bytes(b"1.0\nwords\n")
        wait_until(lambda: status(config)["channels"]["x0"]["state"] == "bad_data")
        assert "rejected: unreadable" in status(config)["channels"]["x0"]["reason"]
    assert status(config)["state"] == "bad_data"


@pytest.mark.process
def test_publishing_that_fails_is_shown_and_stops_nothing(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    (tmp_path / "records").write_bytes(b"")
    put(config, 1)
    with running(config):
        wait_until(lambda: "publisher" in status(config)["problems"])
        put(config, 2)
        wait_until(lambda: last(config) == 4)
        (tmp_path / "records").unlink()
        wait_until(lambda: (tmp_path / "records" / "m-undated.nc").exists())
        wait_until(lambda: status(config)["status"] == "running")


def test_a_source_that_cannot_be_opened_is_refused_and_leaves_no_lock(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    (tmp_path / "in0").rmdir()
    (tmp_path / "in0").write_bytes(b"")
    with pytest.raises(ConfigError, match="expected a folder"):
        Daemon(load_config(config)).run(threading.Event())
    assert read_status(tmp_path / "state") == {"running": False, "status": "never_ran"}


@pytest.mark.process
def test_a_damaged_store_is_saved_as_far_as_it_can_be_and_the_daemon_goes_on(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    for number in range(20):
        put(config, number)
    with running(config):
        wait_until(lambda: last(config) == 40)
    database = tmp_path / "state" / "state.db"
    with Store.open(database, read_only=True) as store:
        before = {found.sequence: found for found in store.records()}
    data = bytearray(database.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 4096] = bytes(4096)
    database.write_bytes(data)
    with running(config):
        put(config, 100)
        wait_until(lambda: status(config)["blocks"] == 2)
        wait_until(lambda: status(config)["unacknowledged"] == 1)
    assert list(database.parent.glob("state.db.corrupt-*"))
    with EventLog(database) as log:
        ((_, notice),) = log.notices()
        assert notice.body["kind"] == "store_salvaged"
    with Store.open(database, read_only=True) as store:
        after = {found.sequence: found for found in store.records()}
        assert store.check() == []
    assert sorted(after) == list(range(1, 43))
    same = [number for number, found in before.items() if after[number] == found]
    assert len(same) == notice.body["saved"] >= 1


def test_the_disk_guard_waits_for_a_quarter_more(tmp_path: Path) -> None:
    free: list[int | OSError] = [1000]

    def look(folder: Path) -> int:
        if isinstance(free[0], OSError):
            raise free[0]
        return free[0]

    guard = DiskGuard(tmp_path, look, least=1000)
    assert guard.check(0.0)
    free[0] = 999
    assert guard.check(1.0)
    assert not guard.check(5.0)
    free[0] = 1249
    assert not guard.check(10.0)
    free[0] = 1250
    assert guard.check(15.0)
    free[0] = OSError(5, "Input/output error")
    assert not guard.check(20.0)
    assert guard.problem == f"{tmp_path}: cannot be looked at (Input/output error)"
    assert free_bytes(tmp_path) > 0


def test_systemd_is_told(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        notifier = ServiceManager({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "4000000"})
        notifier.send("READY=1", "STATUS=watching s")
        assert manager.recv(100) == b"READY=1\nSTATUS=watching s"
        for now in (0.0, 0.5, 1.0, 1.9):
            notifier.feed_watchdog(now)
        assert [manager.recv(100) for _ in range(2)] == [b"WATCHDOG=1"] * 2
        manager.setblocking(False)
        with pytest.raises(BlockingIOError):
            manager.recv(100)
    notifier.send("STOPPING=1")
    ServiceManager({}).send("READY=1")


def test_what_is_not_known_to_be_well_is_not_called_normal() -> None:
    silent, refused = "no block for 61 s", "block 3 was rejected: nan"
    assert channel_state("normal") == ("normal", "healthy")
    assert channel_state("normal", silent=silent, refused=refused) == ("no_data", silent)
    assert channel_state("normal", refused=refused) == ("bad_data", refused)
    assert channel_state("maintenance_required", silent=silent)[0] == "no_data"
    assert channel_state("out_of_specification", refused=refused)[0] == "bad_data"
    assert channel_state("failure", silent=silent, refused=refused)[0] == "failure"
    alert = {"rule": "loud", "severity": "alert", "active": True, "since_block": 5}
    assert channel_state("maintenance_required", [alert])[1] == "alert of loud since block 5"
    unnamed = {**alert, "rule": "tt_lower", "feature": "tt_lower"}
    said = "alert of lower end of the time to threshold since block 5"
    assert channel_state("maintenance_required", [unnamed])[1] == said
    final, end = "the final stage has begun", "the end of life was reached"
    assert channel_state("maintenance_required", stage="final") == ("maintenance_required", final)
    assert channel_state("maintenance_required", [alert], stage="final")[1] == f"{final}; alert of loud since block 5"
    assert channel_state("failure", [alert], stage="end_of_life") == ("failure", end)
    held = {**alert, "severity": "danger", "active": False}
    assert channel_state("failure", [held, alert])[1].endswith("block 5, which is over and waits to be acknowledged")
    assert channel_state("bad_data", [alert]) == ("bad_data", "too many blocks are rejected or flagged")


def test_a_status_file_that_is_damaged_is_as_none(tmp_path: Path) -> None:
    (tmp_path / "status.json").write_text("[1")
    assert read_status(tmp_path) == {"running": False, "status": "never_ran"}
    with StatusFile.open(tmp_path) as file:
        assert read_status(tmp_path) == {"running": True, "status": "starting"}
        file.write({"status": "running", "pid": 1})
        assert json.loads((tmp_path / "status.json").read_text()) == {"status": "running", "pid": 1}
    assert read_status(tmp_path) == {"running": False, "status": "died", "pid": 1}


@pytest.mark.process
@pytest.mark.parametrize("error", [OverflowError("date value out of range"), PermissionError(13, "Permission denied")])
def test_a_status_that_cannot_be_written_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    def fails(*_: Any) -> None:
        raise error

    config = make_machine(tmp_path)
    with running(config):
        with monkeypatch.context() as broken:
            broken.setattr(StatusFile, "write", fails)
            said = status(config)["updated_utc"]
            put(config, 1)
            wait_until(lambda: last(config) == 2)
            assert status(config)["updated_utc"] == said
        wait_until(lambda: status(config)["blocks"] == 2)
