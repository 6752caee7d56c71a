"""What goes on beside the daemon: a page that crashes, is killed or comes back is the page's problem alone."""

from __future__ import annotations

import json
import os
import re
import signal
import urllib.request
from contextlib import ExitStack
from pathlib import Path

import pytest

from models.platform import supervision
from monitor.config.load import load_config
from monitor.records.events import EventLog
from monitor.records.store import Store
from monitor.service.companions import Companions
from monitor.service.daemon import Daemon
from monitor.service.start import inspect
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, start, status
from tests.support.docs import DOCS, read, table
from tests.support.waiting import PATIENCE_S, at_most, stop, wait_until

pytestmark = pytest.mark.process


def with_page(folder: Path) -> Path:
    path = make_machine(folder)
    path.write_text(path.read_text().replace("[web]\nenabled = false\n", "[web]\nport = 0\n"))
    return path


def answers(url: str) -> bool:
    with urllib.request.urlopen(f"{url}api/machines", timeout=PATIENCE_S) as response:
        return response.status == 200


def test_a_page_that_crashes_is_a_problem_and_stops_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = with_page(tmp_path)
    with monkeypatch.context() as broken:
        broken.setattr("monitor.service.children._PAGE", "sys:exit")
        broken.setattr(supervision, "MIN_PAUSE_S", 0.0)
        broken.setattr(supervision, "MAX_PAUSE_S", 0.0)
        with running(config, path=config):
            wait_until(lambda: "page" in status(config)["problems"])
            put(config, 1)
            wait_until(lambda: status(config)["blocks"] == 2)
            assert status(config)["page"] is None
            assert status(config)["status"] == "degraded"
            wait_until(lambda: status(config)["restarts"].get("page", {}).get("down"))
            found = status(config)["restarts"]["page"]
            assert (found["failures"], found["count"], found["cause"]) == (10, 9, "the page ended unexpectedly")
            with EventLog(tmp_path / "state" / "state.db") as log:
                wait_until(lambda: "stays_down" in [notice.body["kind"] for _, notice in log.notices()])
    assert last(config) == 2


def test_each_part_has_the_name_among_the_problems_that_the_documentation_gives(tmp_path: Path) -> None:
    config = with_page(tmp_path)
    nowhere = "127.0.0.1:1"
    mqtt = f'[publish.mqtt]\nurl = "mqtt://{nowhere}/a"\n[publish.sparkplug]\nurl = "mqtt://{nowhere}/b"\n'
    opcua = f'[publish.opcua]\n[operating.opcua]\nurl = "opc.tcp://{nowhere}"\nspeed_node = "ns=2;s=Speed"\n'
    config.write_text(f'{config.read_text()}{mqtt}{opcua}[notify.webhook]\nurl = "http://{nowhere}/"\n')
    daemon = Daemon(load_config(config), config)
    with ExitStack() as opened:
        daemon._open(inspect(load_config(config)), opened)
        companions, condition = daemon._companions, daemon._condition
        assert condition is not None
        parts = (daemon._disk, daemon._retention, daemon._loop_failures, daemon._log_failures, condition)
        for part in (*parts, daemon._ingest.failures, companions._publisher):
            part.problem = "x"
        for part in (*companions._servers.values(), *companions._workers.values()):
            part.problem = "x"
        companions._publisher.kept["m.nc"] = "x"
        found = set(daemon.problems())
        for part in (*parts[2:4], daemon._ingest.failures, daemon._retention.failures):
            part.note(OSError("x"))
        failures = daemon._failures()
    # These two are seen without a daemon that runs.
    found = {name if not name.startswith("notify.") else "notify.NAME" for name in found} | {"start", "backup"}
    rows = table(read(DOCS / "reference" / "daemon.md"), "## Status")
    assert found == set(re.findall(r"`([^`]+)`", rows["`problems`"]))
    assert {*failures, *failures["store"]} == set(re.findall(r"`([^`]+)`", rows["`failures`"]))


def test_without_a_page_none_is_started(tmp_path: Path) -> None:
    config = load_config(make_machine(tmp_path))
    with Store.open(tmp_path / "state.db", machine="m") as store:
        companions = Companions(config, store, tmp_path / "m.toml")
        companions.tick(room=False)
        assert (companions.url, companions.problems()) == (None, {})
        # Nothing is published on a full disk.
        assert not companions._publisher.busy
        companions.tick(room=True)
        assert companions._publisher.busy
        companions.end(room=False)
        companions.close()


def test_the_page_of_a_daemon_answers_is_started_again_and_ends_with_it(tmp_path: Path) -> None:
    config = with_page(tmp_path)
    daemon = start(config, "--quiet", programs=True)
    try:
        wait_until(lambda: status(config).get("page") is not None)
        assert answers(status(config)["page"])
        (child,) = pages_of(daemon.pid)
        os.kill(child, signal.SIGKILL)
        wait_until(lambda: "page" in status(config)["problems"])
        put(config, 1)
        wait_until(lambda: last(config) == 2)
        wait_until(lambda: status(config)["page"] is not None and status(config)["problems"] == {})
        assert answers(status(config)["page"])
        (child,) = pages_of(daemon.pid)
        with at_most(5.0):
            said = stop(daemon)
        assert daemon.returncode == 0, said
        assert status(config)["page"] is None
        wait_until(lambda: not Path(f"/proc/{child}").exists())
    finally:
        daemon.kill()
        daemon.communicate()


def test_the_page_does_not_outlive_a_daemon_that_is_killed(tmp_path: Path) -> None:
    config = with_page(tmp_path)
    daemon = start(config, "--quiet", programs=True)
    wait_until(lambda: status(config).get("page") is not None)
    (child,) = pages_of(daemon.pid)
    daemon.kill()
    daemon.communicate()
    wait_until(lambda: not alive(child))


def test_what_is_acknowledged_on_the_page_lets_the_alarm_go_and_open_pages_do_not_delay_the_stop(
    tmp_path: Path,
) -> None:
    config = with_page(tmp_path)
    level = '[[alarms.level]]\nfeature = "rms"\nalert_g = 0.001\non_delay_blocks = 1\nlatch = true\n'
    config.write_text(config.read_text() + level)
    put(config, 1)
    daemon = start(config, "--quiet")
    try:
        wait_until(lambda: status(config).get("page") is not None and status(config)["unacknowledged"] == 1)
        assert status(config)["channels"]["x0"]["alarms"][0]["latched"]
        page = status(config)["page"]
        token = (tmp_path / "state" / "web.token").read_text().strip()
        with urllib.request.urlopen(f"{page}api/events", timeout=PATIENCE_S) as response:
            (event,) = [event for event in json.load(response)["events"] if event["open"]]
        request = urllib.request.Request(
            f"{page}api/events/{event['id']}/acknowledge",
            data=json.dumps({"who": "Ada", "note": "seen"}).encode(),
            headers={"Authorization": f"Bearer {token}", "Content-Type": "application/json"},
        )
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as response:
            assert response.status == 200
        wait_until(lambda: status(config)["unacknowledged"] == 0)
        wait_until(lambda: not status(config)["channels"]["x0"]["alarms"][0]["latched"])
        put(config, 2)
        wait_until(lambda: last(config) == 4)
        with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
            events = [(event["kind"], event["block"]) for event in store.events()]
        assert events == [("alarm_raised", 1), ("alarm_released", 3)]
        with urllib.request.urlopen(f"{page}api/stream", timeout=PATIENCE_S) as stream:
            assert stream.readline()
            with at_most(5.0):
                said = stop(daemon)
        assert daemon.returncode == 0, said
    finally:
        daemon.kill()
        daemon.communicate()


def pages_of(pid: int) -> list[int]:
    """Return the children of a process that serve a page."""
    found = []
    for number in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        command = Path(f"/proc/{number}/cmdline").read_bytes()
        if b"monitor.web" in command:
            found.append(int(number))
    return found


def alive(pid: int) -> bool:
    """Return whether a process runs; one that nobody has waited for does not."""
    try:
        return ") Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False
