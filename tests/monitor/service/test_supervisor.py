"""Several machines: none can be started wrongly, each is kept running, one that fails touches no other."""

from __future__ import annotations

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.records.database import StoreError
from monitor.service import supervised
from monitor.service.fleet import load_fleet
from monitor.service.status_file import read_status
from monitor.service.supervised import Ear, Lines, Supervised
from monitor.service.supervision import Supervision, read_supervision
from monitor.service.supervisor import Supervisor
from tests.faults.daemons import ROOT, call, wait_for
from tests.fleet import add_machine, last, put, runs, said, supervise


@contextmanager
def supervising(folder: Path, **more: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a supervisor as a process; nothing of it is left after the block."""
    process = supervise(folder, **more)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def end(process: subprocess.Popen[str], number: int = signal.SIGTERM) -> tuple[int, str, float]:
    began = time.monotonic()
    process.send_signal(number)
    _, log = process.communicate(timeout=20)
    return process.returncode, log, time.monotonic() - began


@contextmanager
def daemon_of(folder: Path, name: str, **injected: Any) -> Iterator[Supervised]:
    """Give one supervised daemon, not started yet; nothing of it is left after the block."""
    machine = next(machine for machine in load_fleet(folder).machines if machine.name == name)
    daemon = Supervised(machine, **injected)
    try:
        yield daemon
    finally:
        daemon.kill()
        daemon.forget()


def ticking(daemon: Supervised, what: Callable[[], object]) -> None:
    """Tick until something is true."""

    def done() -> object:
        daemon.tick()
        return what()

    wait_for(done)


def test_machines_are_followed_one_that_is_killed_comes_back_and_no_other_notices(tmp_path: Path) -> None:
    for name in ("a", "b"):
        add_machine(tmp_path, name)
        put(tmp_path, name, 1)
    with supervising(tmp_path) as process:
        wait_for(lambda: all(said(tmp_path, name).get("blocks") == 2 for name in ("a", "b")))
        wait_for(lambda: read_supervision(tmp_path / "a" / "state"))
        before = {name: said(tmp_path, name)["pid"] for name in ("a", "b")}
        os.kill(before["a"], signal.SIGKILL)
        wait_for(lambda: said(tmp_path, "a")["pid"] != before["a"])
        for name in ("a", "b"):
            put(tmp_path, name, 2)
        wait_for(lambda: all(last(tmp_path, name) == 4 for name in ("a", "b")))
        assert said(tmp_path, "b")["pid"] == before["b"]
        wait_for(lambda: (read_supervision(tmp_path / "a" / "state") or {})["starts"] == 2)
        found = json.loads(call("status", "--json", "--config", str(tmp_path)).stdout)["machines"]
        assert {status["machine"]: status["status"] for status in found} == {"a": "running", "b": "running"}
        assert all(status["supervisor"]["pid"] == process.pid for status in found)
        # A second one would start daemons that are refused, for ever.
        second = call("run", "--config", str(tmp_path))
        assert second.returncode == 2
        assert all(f"{name}.toml: {tmp_path}/{name}/state: another supervisor" in second.stderr for name in "ab")
        code, log, seconds = end(process)
    assert code == 0, log
    assert seconds < 5.0
    assert "machine a: the daemon ended with signal SIGKILL; it is started again after 1 s" in log
    assert "a: " in log
    assert "machine a: runs again" in log
    for name in ("a", "b"):
        assert read_status(tmp_path / name / "state")["status"] == "stopped"
        assert read_supervision(tmp_path / name / "state") is None
        assert not (tmp_path / name / "state" / "supervisor.json").exists()
        assert [line for line in log.splitlines() if line.startswith(f"{name}: ") and "ready, watching s0" in line]


def test_daemons_end_in_order_when_their_supervisor_is_killed(tmp_path: Path) -> None:
    for name in ("a", "b"):
        add_machine(tmp_path, name)
    with supervising(tmp_path) as process:
        wait_for(lambda: all(runs(tmp_path, name) for name in ("a", "b")))
        put(tmp_path, "a", 1)
        wait_for(lambda: last(tmp_path, "a") == 2)
        process.kill()
        wait_for(lambda: not any(read_status(tmp_path / name / "state")["running"] for name in ("a", "b")))
    assert [read_status(tmp_path / name / "state")["status"] for name in ("a", "b")] == ["stopped", "stopped"]
    assert (tmp_path / "a" / "records" / "a-undated.nc").exists()
    # What was said by one that does not run any more counts for nothing.
    assert (tmp_path / "a" / "state" / "supervisor.json").exists()
    assert read_supervision(tmp_path / "a" / "state") is None
    with supervising(tmp_path) as process:
        wait_for(lambda: all(runs(tmp_path, name) for name in ("a", "b")))
        code, log, _ = end(process, signal.SIGINT)
    assert code == 0, log


def test_one_that_hangs_while_it_should_end_is_ended() -> None:
    text = (
        "import threading, time\n"
        "from monitor.service import supervision\n"
        "supervision._ENDS_WITHIN = 0.2\n"
        "stop = threading.Event()\n"
        "supervision.end_with_supervisor(stop)\n"
        "stop.wait()\n"
        "print('asked', flush=True)\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", text], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.close()
        assert child.stdout.readline() == b"asked\n"
        assert child.wait(30.0) == 1


def test_one_that_hangs_is_killed_and_started_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervised, "_HANGS_AFTER", 2.0)
    monkeypatch.setattr(supervised, "_GOOD_RUN", 2.5)
    add_machine(tmp_path, "a")
    with daemon_of(tmp_path, "a") as daemon:
        ticking(daemon, lambda: daemon.ready)
        assert daemon.pid is not None
        os.kill(daemon.pid, signal.SIGKILL)
        ticking(daemon, lambda: daemon.problem)
        ticking(daemon, lambda: daemon.ready)
        first = daemon.pid
        assert first is not None
        assert daemon.settled
        # It beats: it is left alone for longer than one that hangs.
        until = time.monotonic() + 3.0
        ticking(daemon, lambda: time.monotonic() > until)
        assert (daemon.pid, daemon.starts) == (first, 2)
        os.kill(first, signal.SIGSTOP)
        ticking(daemon, lambda: daemon.problem)
        assert daemon.problem == "gave no sign of life for 2 s and was killed"
        assert not daemon.ready
        # It had run well before, so that the failure is the first of a row.
        ticking(daemon, lambda: daemon.pid is None)
        assert daemon.problem == "gave no sign of life for 2 s and was killed; it is started again after 1 s"
        ticking(daemon, lambda: daemon.ready)
        assert daemon.problem is None
        assert (daemon.pid != first, daemon.starts) == (True, 3)


def test_without_descriptors_it_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add_machine(tmp_path, "a")
    now = [1000.0]
    with daemon_of(tmp_path, "a", monotonic=lambda: now[0]) as daemon:
        limits = resource.getrlimit(resource.RLIMIT_NOFILE)
        used = max(int(path.name) for path in Path("/proc/self/fd").iterdir())
        resource.setrlimit(resource.RLIMIT_NOFILE, (used, limits[1]))
        opened: list[int] = []
        try:
            with suppress(OSError):
                while True:
                    opened.append(os.open(os.devnull, os.O_RDONLY))
            daemon.tick()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, limits)
            for descriptor in opened:
                os.close(descriptor)
        assert daemon.problem == "cannot be started: Too many open files; it is started again after 1 s"
        assert daemon.waitable == []
        now[0] += 1.0
        ticking(daemon, lambda: daemon.ready)


def test_pauses_grow_and_it_is_said_why_it_does_not_start(tmp_path: Path) -> None:
    path = add_machine(tmp_path, "a")
    now = [1000.0]
    with daemon_of(tmp_path, "a", monotonic=lambda: now[0]) as daemon:
        path.unlink()
        for number, pause in enumerate((1, 2, 4), start=1):
            daemon.tick()
            wait_for(lambda: daemon.tick() or daemon.pid is None)
            often = f", {number} times in a row" if number > 1 else ""
            assert daemon.problem is not None
            assert daemon.problem.startswith(f"ended with exit code 2{often}; it is started again after {pause} s (")
            assert f"{path}: cannot be read" in daemon.problem
            now[0] += pause - 0.01
            daemon.tick()
            assert daemon.pid is None
            now[0] += 0.01
        assert daemon.starts == 3


def test_a_program_that_is_missing_is_a_problem_and_ends_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_machine(tmp_path, "a")
    with daemon_of(tmp_path, "a") as daemon:
        monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
        daemon.tick()
        assert daemon.problem == "cannot be started: No such file or directory; it is started again after 1 s"
        assert daemon.waitable == []


def test_the_manager_is_told_once_all_are_ready_or_have_failed(tmp_path: Path) -> None:
    add_machine(tmp_path, "a")
    add_machine(tmp_path, "b")
    # The configuration is good; the source is no folder.
    (tmp_path / "b" / "in0").rmdir()
    (tmp_path / "b" / "in0").touch()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(30.0)
        told = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "800000"}
        with supervising(tmp_path, env={**os.environ, **told}) as process:
            heard: list[str] = []
            while not any(line.startswith("READY=1") for line in heard):
                heard.append(manager.recv(4096).decode())
            # It is ready a moment before its status says so.
            wait_for(lambda: runs(tmp_path, "a"))
            ready = heard[-1]
            assert ready.startswith("READY=1\nSTATUS=1 of 2 machines run; b: ended with exit code 2")
            assert "expected a folder" in ready
            assert all(line.startswith("STATUS=") or line == "WATCHDOG=1" for line in heard[:-1])
            while heard[-1] != "WATCHDOG=1":
                heard.append(manager.recv(4096).decode())
            (tmp_path / "b" / "in0").unlink()
            while heard[-1] != "STATUS=2 of 2 machines run":
                heard.append(manager.recv(4096).decode())
            code, log, _ = end(process)
            manager.setblocking(False)
            while heard[-1] != "STOPPING=1":
                heard.append(manager.recv(4096).decode())
    assert code == 0, log
    assert "machine b: runs again" in log


class Page:
    """Stands for the page: remembers what was done with it."""

    def __init__(self) -> None:
        self.url: str | None = None
        self.problem: str | None = None
        self.ticks = 0
        self.closed = False

    def tick(self) -> None:
        self.ticks += 1

    def close(self) -> None:
        self.closed = True


def test_the_page_of_all_is_tended_and_its_problem_shown(tmp_path: Path) -> None:
    add_machine(tmp_path, "a")
    page, stop = Page(), threading.Event()
    supervisor = Supervisor(load_fleet(tmp_path), page=page)
    thread = threading.Thread(target=supervisor.run, args=(stop,))
    thread.start()
    try:
        wait_for(lambda: runs(tmp_path, "a"))
        page.problem = "port 8710 is taken"
        wait_for(lambda: supervisor.status() == "1 of 1 machines run; page: port 8710 is taken")
        page.problem, page.url = None, "http://127.0.0.1:8710/"
        wait_for(lambda: (read_supervision(tmp_path / "a" / "state") or {}).get("page") == page.url)
        assert supervisor.status() == "1 of 1 machines run"
    finally:
        stop.set()
        thread.join(10.0)
    assert not thread.is_alive()
    assert page.ticks > 0
    assert page.closed


def test_many_machines_publish_for_a_shorter_time_when_they_stop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    for number in range(8):
        add_machine(tmp_path, f"m{number}")
        if number in (0, 3, 7):
            supervisor = Supervisor(load_fleet(tmp_path))
            within = {daemon.publish_within for daemon in supervisor.daemons}
            assert within == {1.5 if number == 7 else 3.0}


def test_only_the_process_itself_is_believed() -> None:
    ear = Ear()
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
            link.sendto(b"READY=1\nSTATUS=x", "\0" + ear.address[1:])
            assert ear.hear(os.getpid() + 1) == []
            link.sendto(b"READY=1\nSTATUS=x", "\0" + ear.address[1:])
            assert ear.hear(os.getpid()) == ["READY=1", "STATUS=x"]
    finally:
        ear.close()


@given(st.lists(st.text("ab\n\xe9", max_size=20), max_size=8), st.booleans())
def test_every_line_of_a_log_gets_its_name(parts: list[str], ended: bool) -> None:
    reading, writing = os.pipe()
    pipe = os.fdopen(reading, "rb", buffering=0)
    lines, written = Lines("m", pipe), []
    lines_write: list[str] = []
    vars(lines)["_write"] = lambda line: lines_write.append(line.decode("utf-8", "replace"))
    try:
        for part in parts:
            os.write(writing, part.encode())
            written.append(part)
            assert lines.pass_on()
            # Whole lines come at once, what is not ended waits.
            assert "\n".join(lines_write) == "".join(written).rpartition("\n")[0]
        if ended:
            os.close(writing)
            assert not lines.pass_on()
            assert "\n".join(lines_write) == "".join(written)
    finally:
        lines.close()
        if not ended:
            os.close(writing)


def test_a_line_without_end_is_passed_on_in_pieces() -> None:
    reading, writing = os.pipe()
    lines = Lines("m", os.fdopen(reading, "rb", buffering=0))
    seen: list[bytes] = []
    vars(lines)["_write"] = seen.append
    try:
        os.write(writing, b"x" * 40_000)
        assert lines.pass_on()
        assert sum(map(len, seen)) >= 16_384
    finally:
        os.close(writing)
        lines.close()


def test_there_is_one_supervisor_and_its_words_end_with_it(tmp_path: Path) -> None:
    assert read_supervision(tmp_path) is None
    first = Supervision(tmp_path)
    first.say({"pid": 1, "starts": 1, "problem": None, "page": None})
    with pytest.raises(StoreError, match="another supervisor is running"):
        Supervision(tmp_path)
    assert read_supervision(tmp_path) == {"pid": 1, "starts": 1, "problem": None, "page": None}
    (tmp_path / "supervisor.json").write_text("[")
    assert read_supervision(tmp_path) is None
    first.close()
    first.close()
    Supervision(tmp_path).close()
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=r"Not a directory|File exists"):
        Supervision(tmp_path / "file" / "state")


def test_the_supervisor_loads_nothing_heavy(tmp_path: Path) -> None:
    add_machine(tmp_path, "a")
    text = (
        "import sys\nfrom pathlib import Path\n"
        "from monitor.service.fleet import load_fleet\n"
        "from monitor.service.supervisor import Supervisor\n"
        f"Supervisor(load_fleet(Path({str(tmp_path)!r})))\n"
        "print(sorted({'numba', 'xarray', 'netCDF4', 'matplotlib', 'dask', 'pymoo', 'starlette'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
