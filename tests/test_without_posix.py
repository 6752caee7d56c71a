"""Daemon, page and replay in processes that lack what only POSIX has (tests/without_posix): as they are with it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.streams.folders import csv_bytes, noise
from tests.support.commands import run_command
from tests.support.daemons import ROOT, free_port
from tests.support.fleet import add_machine
from tests.support.page import ask, machines
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process

_CLI = "from monitor.cli import main; main()"


def without_posix(*words: str) -> subprocess.Popen[str]:
    """Start the program without what only POSIX has; its children lack it too."""
    path = os.pathsep.join([str(ROOT / "tests" / "without_posix"), str(ROOT)])
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    command = [sys.executable, "-c", _CLI, *words]
    return subprocess.Popen(command, cwd=ROOT, text=True, env={**os.environ, "PYTHONPATH": path}, **pipes)


def state_of(config: Path) -> dict[str, Any]:
    path = config.parent / "a" / "state" / "status.json"
    return json.loads(path.read_text()) if path.exists() else {}


def answers(url: str) -> bool:
    try:
        return ask(url, "readyz") == {"status": "ready"}
    except OSError:
        return False


def summary_of(out: str) -> dict[str, Any]:
    found = json.loads(out)
    return {name: found[name] for name in ("offered", "accepted", "rejected", "ignored", "channels", "bearings")}


def test_run_with_its_page_and_replay(tmp_path: Path) -> None:
    port = free_port()
    config, url = add_machine(tmp_path, "a", web=f"port = {port}"), f"http://127.0.0.1:{port}/"
    files = tmp_path / "a" / "in0"
    for number in (1, 2):
        (files / f"f{number}.csv").write_bytes(csv_bytes(noise(512, number)))
    np.savez(files / "other.npz", x=np.zeros(3))
    with without_posix("run", "--config", str(config), "--quiet") as daemon:
        try:
            wait_until(lambda: state_of(config).get("blocks") == 4)
            wait_until(lambda: answers(url))
            assert machines(url)["a"]["running"]
            wait_until(lambda: ask(url, "api/records")["files"])
            # Another daemon of the machine is refused by the lock.
            with without_posix("run", "--config", str(config), "--no-page") as second:
                _, said = second.communicate()
                assert second.returncode == 2, said
                assert "another daemon is running" in said
        finally:
            log = stop(daemon)
        assert daemon.returncode == 0, log
    words = ("replay", str(files), "--config", str(config), "--json", "--no-report", "--quiet", "--out")
    with without_posix(*words, str(tmp_path / "without")) as replay:
        out, said = replay.communicate()
        assert replay.returncode == 0, said
    assert summary_of(out) == summary_of(run_command(*words, tmp_path / "with").stdout)


def test_the_calls_are_gone_in_such_a_process() -> None:
    code = "from sitecustomize import CALLS; print([n for m, names in CALLS.items() for n in names if hasattr(m, n)])"
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tests" / "without_posix")}
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; import resource"], env=environment, capture_output=True, text=True, check=False
    )
    assert done.stdout == "[]\n"
    assert "ModuleNotFoundError: No module named 'resource' without POSIX" in done.stderr
