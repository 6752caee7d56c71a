"""``spallwatch page``: one page over the machines of a folder, whose daemons are processes of their own."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import ROOT, call, start
from tests.support.fleet import add_machine
from tests.support.forks import ForkedProgram
from tests.support.page import ask, machines
from tests.support.waiting import PATIENCE_S, finish, stop, wait_until

pytestmark = pytest.mark.process

_CLI = "from monitor.cli import main; main()"


@contextmanager
def started(folder: Path, *options: str, **more: Any) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run the page of a folder; yield the process and the address that it printed."""
    command = [sys.executable, "-c", _CLI, "page", "--config", str(folder), "--port", "0", *options]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=ROOT, text=True, **pipes, **more) as process:
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


@contextmanager
def daemon_of(config: Path) -> Iterator[ForkedProgram]:
    process = start(config, "--no-page", "--quiet")
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_one_page_follows_the_daemons_of_all_machines(tmp_path: Path) -> None:
    latched = '[[alarms.level]]\nfeature = "rms"\nalert_g = 0.001\non_delay_blocks = 1\nlatch = true\n'
    configs = {name: add_machine(tmp_path, name, web="port = 0") for name in ("a", "b")}
    configs["a"].write_text(configs["a"].read_text() + latched)
    (tmp_path / "c.toml").write_text("invalid")
    with ExitStack() as opened:
        process, url = opened.enter_context(started(tmp_path))
        assert {name: machine["status"] for name, machine in machines(url).items()} == {
            "a": "never_ran",
            "b": "never_ran",
        }
        daemons = {name: opened.enter_context(daemon_of(config)) for name, config in configs.items()}
        (tmp_path / "a" / "in0" / "f1.csv").write_bytes(csv_bytes(noise(512, 1)))
        wait_until(lambda: machines(url)["a"].get("blocks") == 2)
        wait_until(lambda: machines(url)["b"]["running"])
        assert all(machine["page"] is None for machine in machines(url).values())

        # An acknowledgement reaches the daemon through the event log of its store.
        (event,) = [event for event in ask(url, "api/events")["events"] if event["kind"] == "alarm_raised"]
        token = (tmp_path / "a" / "state" / "web.token").read_text().strip()
        wait_until(lambda: machines(url)["a"]["unacknowledged"] == 1)
        ask(url, f"api/events/{event['id']}/acknowledge", {"who": "ada"}, token)
        wait_until(lambda: machines(url)["a"]["unacknowledged"] == 0)

        # A daemon that is killed and started again is shown as such.
        before = machines(url)["a"]["pid"]
        daemons["a"].kill()
        wait_until(lambda: machines(url)["a"]["status"] == "died")
        opened.enter_context(daemon_of(configs["a"]))
        wait_until(lambda: machines(url)["a"]["running"] and machines(url)["a"].get("pid") != before)
        assert machines(url)["b"]["running"]

        log = stop(process)
        assert process.returncode == 0, log
        assert f"left out: {tmp_path}/c.toml:1: not valid TOML" in log


def test_the_service_manager_learns_that_the_page_answers_and_is_alive(tmp_path: Path) -> None:
    add_machine(tmp_path, "a")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE_S)
        environment = {**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "1000000"}
        with started(tmp_path, env=environment) as (process, url):
            assert manager.recv(4096).decode() == f"READY=1\nSTATUS=the page of 1 machine is at {url}"
            assert manager.recv(4096) == b"WATCHDOG=1"
            assert ask(url, "readyz") == {"status": "ready"}
            process.send_signal(signal.SIGINT)
            assert manager.recv(4096) == b"STOPPING=1"
            log = finish(process)
            assert process.returncode == 0, log


def test_one_file_can_be_served_too_and_a_taken_port_is_named(tmp_path: Path) -> None:
    config = add_machine(tmp_path, "a")
    with started(config) as (_, url):
        assert list(machines(url)) == ["a"]
        port = url.rstrip("/").rpartition(":")[2]
        done = call("page", "--config", str(config), "--port", port)
    assert done.returncode == 2
    assert f"port = {port}: cannot be listened on" in done.stderr


def test_run_refuses_a_folder_and_names_the_alternatives(tmp_path: Path) -> None:
    add_machine(tmp_path, "a")
    done = call("run", "--config", str(tmp_path))
    assert done.returncode == 2
    assert "is a folder; run follows one machine" in done.stderr
    assert "spallwatch@NAME" in done.stderr
    assert f"spallwatch page --config {tmp_path}" in done.stderr
    assert not (tmp_path / "a" / "state").exists()
