"""Progress of a daemon: waits without a reason, a frozen process, an old status, and the exit code for a container."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import load_config
from monitor.service import daemon as daemons
from monitor.service.progress import MAX_PROGRESS_AGE_S, MAX_STATUS_AGE_S, SourceProgress, boot_id, unhealthy
from monitor.service.system import StatusFile, present_status, read_status
from monitor.web.api import health
from monitor.web.machines import Machines
from tests.support.commands import run_command
from tests.support.daemon import put, running
from tests.support.daemons import make_machine, start
from tests.support.daemons import status as raw_status
from tests.support.waiting import wait_until


def status(config: Path) -> dict[str, Any]:
    return present_status(load_config(config))


def aged(progress: SourceProgress, now: list[float], seconds: float, ready: dict[str, int]) -> None:
    """Look every second for so many seconds."""
    for _ in range(round(seconds)):
        now[0] += 1.0
        progress.look(ready)


def test_the_age_counts_while_blocks_wait_and_begins_anew_with_a_commit() -> None:
    now = [0.0]
    progress = SourceProgress(lambda: now[0])
    aged(progress, now, 20.0, {"press": 0, "fan": 3})
    assert progress.ages() == {"press": 0.0, "fan": 20.0}
    progress.note("fan")
    aged(progress, now, 5.0, {"press": 0, "fan": 2})
    assert progress.ages() == {"press": 0.0, "fan": 5.0}
    aged(progress, now, 1.0, {"press": 0, "fan": 0})
    assert progress.ages()["fan"] == 0.0


def test_a_source_is_stalled_only_where_nothing_says_why() -> None:
    now = [0.0]
    progress = SourceProgress(lambda: now[0])
    aged(progress, now, MAX_PROGRESS_AGE_S, {"press": 1})
    assert progress.stalled(()) == []
    aged(progress, now, 1.0, {"press": 1})
    assert progress.stalled(()) == ["press"]
    assert [progress.stalled((reason,)) for reason in ("disk", "store", "press", "fan")] == [[], [], [], ["press"]]
    progress.note("press")
    assert progress.stalled(()) == []


def test_a_process_that_was_frozen_did_not_wait() -> None:
    now = [0.0]
    progress = SourceProgress(lambda: now[0])
    aged(progress, now, 1.0, {"press": 1})
    now[0] += 3600.0
    progress.look({"press": 1})
    assert progress.stalled(()) == []


def written(folder: Path, **more: Any) -> StatusFile:
    """Write the status of a daemon whose lock is held until the file is closed."""
    file = StatusFile.open(folder)
    values = {"status": "running", "pid": os.getpid(), "boot": boot_id(), "problems": {}, "progress_age_s": {}}
    file.write({**values, **more})
    return file


def test_a_status_that_is_not_renewed_is_stalled_and_one_of_a_start_is_not(tmp_path: Path) -> None:
    with written(tmp_path) as file:
        assert read_status(tmp_path)["running"] is True
        old = time.time() - MAX_STATUS_AGE_S - 5.0
        os.utime(file.path, (old, old))
        found = read_status(tmp_path)
        assert (found["running"], found["status"]) == ("stalled", "stalled")
        assert found["stall"] == "it has not renewed its status for 20 s"
        assert list(unhealthy(found)) == ["the daemon is stalled: it has not renewed its status for 20 s"]
        # A start that takes long renews what an earlier daemon left.
        file.touch()
        assert read_status(tmp_path)["running"] is True
    os.utime(tmp_path / "status.json", (old, old))
    assert read_status(tmp_path)["status"] == "died"


def test_a_source_whose_blocks_wait_is_named(tmp_path: Path) -> None:
    with written(tmp_path, stalled=["press"], progress_age_s={"press": 75.2, "fan": 0.0}):
        found = read_status(tmp_path)
        assert (found["running"], found["stall"]) == ("stalled", "source press: blocks wait for 75 s")


def test_the_last_status_of_a_stopped_daemon_is_no_running_one_while_the_next_starts(tmp_path: Path) -> None:
    with written(tmp_path, status="stopped"):
        found = read_status(tmp_path)
        assert (found["running"], found["status"]) == (True, "starting")
        assert list(unhealthy(found)) == ["the daemon is starting"]


@pytest.mark.process
def test_a_frozen_daemon_is_stalled_and_unhealthy_until_it_goes_on(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    assert run_command("status", "--config", config, "--check").returncode == 1
    process = start(config, "--quiet")
    try:
        wait_until(lambda: status(config)["status"] == "running")
        assert run_command("status", "--config", config, "--check").returncode == 0
        process.send_signal(signal.SIGSTOP)
        wait_until(lambda: status(config)["running"] == "stalled")
        found = status(config)
        assert found["status"] == "stalled"
        assert found["problems"] == {"daemon": "stalled: its process is frozen (SIGSTOP or a debugger)"}
        checked = run_command("status", "--config", config, "--check")
        assert checked.returncode == 1
        assert "unhealthy, m: the daemon is stalled: its process is frozen" in checked.stdout
        assert json.loads(run_command("status", "--config", config, "--check", "--json").stdout)["reasons"]
        # Without --check, the exit code is that of a status that could be read.
        assert run_command("status", "--config", config).returncode == 0
        code, answer = health(Machines([load_config(config)]))
        assert (code, answer["status"]) == (503, "failing")
        assert answer["reasons"][0].startswith("machine m: the daemon is stalled")
        process.send_signal(signal.SIGCONT)
        wait_until(lambda: status(config)["running"] is True)
        put(config, 1)
        wait_until(lambda: status(config)["blocks"] == 2)
        assert status(config)["progress_age_s"] == {"s0": 0.0}
        assert run_command("status", "--config", config, "--check").returncode == 0
    finally:
        process.send_signal(signal.SIGCONT)
        process.kill()
        process.communicate()
    assert run_command("status", "--config", config, "--check").returncode == 1


@pytest.mark.process
def test_the_watchdog_is_fed_only_while_no_source_is_stalled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.service.system._CHECK_DISK_S", 0.05)
    fed: list[threading.Thread] = []
    stalled: list[str] = []
    committing: set[threading.Thread] = set()
    step = daemons.Ingest.step

    def taken(ingest: Any, stop: threading.Event) -> object:
        committing.add(threading.current_thread())
        return step(ingest, stop)

    monkeypatch.setattr(daemons.Ingest, "step", taken)
    monkeypatch.setattr(
        daemons.ServiceManager, "feed_watchdog", lambda self, now: fed.append(threading.current_thread())
    )
    monkeypatch.setattr(daemons.Ingest, "stalled", lambda self: list(stalled))
    config, free = make_machine(tmp_path), [10**9]
    with running(config, free=lambda _: free[0]):
        wait_until(lambda: len(fed) > 3)
        stalled.append("s0")
        wait_until(lambda: raw_status(config)["stalled"] == ["s0"])
        before = len(fed)
        time.sleep(0.5)
        assert len(fed) == before
        # A restart would not help.
        free[0] = 0
        wait_until(lambda: len(fed) > before)
        free[0] = 10**9
        wait_until(lambda: raw_status(config)["stalled"] == ["s0"])
        before = len(fed)
        stalled.clear()
        wait_until(lambda: len(fed) > before)
        wait_until(lambda: raw_status(config)["stalled"] == [])
    assert set(fed) == committing
