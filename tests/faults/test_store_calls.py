"""What the system refuses for a while at the files of the store of a daemon that runs: it goes on with all records."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from monitor.health.record import Record
from monitor.records.store import Store
from tests.support.daemon import put
from tests.support.daemons import make_machine, start_program, status
from tests.support.effort import effort_count
from tests.support.waiting import wait_until

pytestmark = pytest.mark.process

STRACE = shutil.which("strace")
FILES = 6
CALLS = [
    ("fcntl", "ENOLCK", "300..420+7"),
    ("pread64", "EIO", "60..160+3"),
    ("pwrite64", "EIO", "150..260+9"),
    ("fdatasync", "EIO", "6..20+3"),
    ("ftruncate", "EIO", "1..3"),
    ("openat", "EMFILE", "8..20+2"),
]
"""A call on the files of the store, its error, and which calls of the process fail."""


@pytest.fixture(scope="module", autouse=True)
def tracing() -> None:
    """Skip where processes cannot be traced; under CI strace must be there."""
    if STRACE is None:
        reason = "strace is missing (Debian package strace)"
        if os.environ.get("CI"):
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    if subprocess.run([STRACE, "-f", "-o", os.devnull, "true"], capture_output=True, check=False).returncode:
        pytest.skip("needs the right to trace processes")


def lived(folder: Path, *inject: str) -> tuple[list[Record], str]:
    """Let a daemon take files while calls fail; return the records, and what strace saw."""
    folder.mkdir()
    config, trace = make_machine(folder), folder / "strace"
    files = [part for suffix in ("", "-wal", "-shm") for part in ("-P", f"{folder / 'state' / 'state.db'}{suffix}")]
    prefix = [str(STRACE), "-f", "-q", "-o", str(trace), *files, *inject]
    daemon = start_program(config, "--quiet", prefix=prefix if inject else ())
    try:
        wait_until(lambda: status(config).get("status") in ("running", "degraded") or daemon.poll() is not None)
        for number in range(1, FILES + 1):
            put(config, number)
            time.sleep(0.2)
        wait_until(lambda: status(config).get("blocks") == 2 * FILES or daemon.poll() is not None)
        wait_until(lambda: status(config)["status"] == "running" or daemon.poll() is not None)
        os.kill(status(config)["pid"], 15)
        _, said = daemon.communicate(timeout=60)
    finally:
        daemon.kill()
        daemon.communicate()
    assert daemon.returncode == 0, said
    with Store.open(folder / "state" / "state.db", read_only=True) as store:
        assert store.check() == []
        assert not list(folder.glob("state/*.corrupt-*"))
        return list(store.records()), trace.read_text(errors="replace") if inject else ""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    records, _ = lived(tmp_path_factory.mktemp("undisturbed") / "m")
    assert len(records) == 2 * FILES
    return records


@pytest.mark.parametrize(("call", "error", "when"), CALLS[: effort_count(quick=2, full=len(CALLS))])
def test_a_daemon_goes_on_when_calls_fail_for_a_while(
    tmp_path: Path, undisturbed: list[Record], call: str, error: str, when: str
) -> None:
    records, trace = lived(tmp_path / "m", "-e", f"trace={call}", "-e", f"inject={call}:error={error}:when={when}")
    assert "INJECTED" in trace
    assert records == undisturbed
