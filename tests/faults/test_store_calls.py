"""What the system refuses for a while at the files of the store of a daemon that runs: it goes on with all records."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from monitor.health.record import Record
from monitor.records.store import Store
from tests.support.daemon import put
from tests.support.daemons import make_machine, start_program, status
from tests.support.effort import effort_count
from tests.support.waiting import finish, wait_until

pytestmark = pytest.mark.process

STRACE = shutil.which("strace")
FILES = 6
CALLS = [
    ("pread64", "EIO"),
    ("pwrite64", "EIO"),
    ("fdatasync", "EIO"),
    # SQLite waits ten seconds for a lock whose release was refused.
    ("fcntl", "ENOLCK"),
]
"""A call on the files of the store, and its error."""


@pytest.fixture(scope="module", autouse=True)
def tracing() -> None:
    """Skip where processes cannot be traced; under CI strace must be there."""
    if STRACE is None:
        reason = "strace is missing (Debian package strace)"
        if os.environ.get("CI"):
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    with subprocess.Popen(["sleep", "1"]) as other:
        traced = subprocess.run([STRACE, "-o", os.devnull, "-p", str(other.pid)], capture_output=True, check=False)
    if traced.returncode:
        pytest.skip("needs the right to trace processes that run")


def lived(folder: Path, *inject: str) -> list[Record]:
    """Let a daemon take files while calls fail, and go on when they work again; return the records."""
    folder.mkdir()
    config = make_machine(folder)
    daemon = start_program(config, "--quiet")
    try:
        wait_until(lambda: status(config).get("status") == "running" or daemon.poll() is not None)
        with refusing(daemon.pid, folder, inject) if inject else nullcontext():
            for number in range(1, FILES + 1):
                put(config, number)
                time.sleep(0.2)
        wait_until(lambda: status(config).get("blocks") == 2 * FILES or daemon.poll() is not None)
        wait_until(lambda: status(config)["status"] == "running" or daemon.poll() is not None)
        daemon.terminate()
        said = finish(daemon)
    finally:
        daemon.kill()
        daemon.communicate()
    assert daemon.returncode == 0, said
    with Store.open(folder / "state" / "state.db", read_only=True) as store:
        assert store.check() == []
        assert not list(folder.glob("state/*.corrupt-*"))
        return list(store.records())


@contextmanager
def refusing(pid: int, folder: Path, inject: tuple[str, ...]) -> Iterator[None]:
    """Have calls on the files of the store of a process fail; at least one fails before the end."""
    trace, store = folder / "strace", folder / "state" / "state.db"
    files = [part for suffix in ("", "-wal", "-shm") for part in ("-P", f"{store}{suffix}")]
    with subprocess.Popen([str(STRACE), "-f", "-q", "-o", str(trace), "-p", str(pid), *files, *inject]) as tracer:
        try:
            yield
            wait_until(lambda: "INJECTED" in trace.read_text(errors="replace"))
        finally:
            # It lets go of the process.
            tracer.terminate()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    records = lived(tmp_path_factory.mktemp("undisturbed") / "m")
    assert len(records) == 2 * FILES
    return records


@pytest.mark.parametrize(("call", "error"), CALLS[: effort_count(quick=3, full=len(CALLS))])
def test_a_daemon_goes_on_when_calls_fail_for_a_while(
    tmp_path: Path, undisturbed: list[Record], call: str, error: str
) -> None:
    records = lived(tmp_path / "m", "-e", f"trace={call}", "-e", f"inject={call}:error={error}:when=2+3")
    assert records == undisturbed
