"""The N-th call of each kind fails in the daemon, its children and the commands beside it."""

from __future__ import annotations

import os
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from benchmarks.common import effort_count
from benchmarks.faults.cases import Case, all_cases
from benchmarks.faults.judge import judge
from benchmarks.faults.life import START_S, Life, wrongs
from benchmarks.faults.shim import KINDS, PLACES, ROLES, Plan, Shim

pytestmark = pytest.mark.process

FEW = (
    "steady:daemon:pwrite:store:ENOSPC:1x1",
    "steady:daemon:opendir:input:EMFILE:1x1",
    "steady:daemon:send:socket:EPIPE:1x1",
    "backup:backup:fsync:life:EIO:1x1",
)
CASES = [case for case in all_cases() if effort_count(quick=case.name in FEW, full=True)]
_PROGRAM = """
import errno, os, sys
words = []
for number in range(4):
    try:
        words.append(str({call}))
    except OSError as error:
        words.append(errno.errorcode[error.errno])
print(*words)
"""


@pytest.fixture(scope="module", autouse=True)
def compiler() -> None:
    """Skip where the library cannot be made; under CI there must be a compiler."""
    if shutil.which("gcc") is None or not sys.platform.startswith("linux"):
        if os.environ.get("CI"):
            pytest.fail("gcc is missing (Debian package gcc)", pytrace=False)
        pytest.skip("needs gcc on Linux")


def said(shim: Shim, folder: Path, call: str) -> list[str]:
    """Return what four calls in a program said, whose command line is that of a backup."""
    code = _PROGRAM.format(call=call.replace("PATH", repr(str(folder / "state.db"))))
    command = [sys.executable, "-c", code, "backup", "--config"]
    done = subprocess.run(command, env=shim.environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("kind", "call"),
    [
        ("open", "os.close(os.open(PATH, os.O_RDONLY)) or 8"),
        ("write", "os.write(os.open(PATH, os.O_WRONLY), bytes(8))"),
        ("pwrite", "os.pwrite(os.open(PATH, os.O_WRONLY), bytes(8), 0)"),
        ("read", "len(os.read(os.open(PATH, os.O_RDONLY), 8))"),
        ("pread", "len(os.pread(os.open(PATH, os.O_RDONLY), 8, 0))"),
        ("fsync", "os.fsync(os.open(PATH, os.O_RDONLY)) or 8"),
        ("rename", "os.rename(PATH, PATH) or 8"),
        ("ftruncate", "os.ftruncate(os.open(PATH, os.O_RDWR), 8) or 8"),
    ],
)
def test_the_calls_of_a_plan_fail_and_no_others(tmp_path: Path, kind: str, call: str) -> None:
    (tmp_path / "state.db").write_bytes(bytes(8))
    shim = Shim(tmp_path)
    shim.arm(Plan(kind, "EIO", "backup", "store", first=2, calls=2))
    assert said(shim, tmp_path, call) == ["8", "EIO", "EIO", "8"]
    assert (shim.fired, shim.where) == (2, "state.db")
    assert shim.counts()[kind, "backup", "store"] >= 4
    for other in (Plan(kind, "EIO", "daemon", "store"), Plan(kind, "EIO", "backup", "published")):
        shim.arm(other)
        assert said(shim, tmp_path, call) == ["8"] * 4
        assert shim.fired == 0
    shim.disarm()
    assert said(shim, tmp_path, call) == ["8"] * 4


def test_half_of_the_bytes_are_written(tmp_path: Path) -> None:
    (tmp_path / "state.db").write_bytes(b"")
    shim = Shim(tmp_path)
    shim.arm(Plan("pwrite", "short", "backup", "store", first=3))
    assert said(shim, tmp_path, "os.pwrite(os.open(PATH, os.O_WRONLY), bytes(8), 0)") == ["8", "8", "4", "8"]


def test_sqlite_and_threads_are_reached(tmp_path: Path) -> None:
    shim = Shim(tmp_path)
    code = "import sqlite3, sys; sqlite3.connect(sys.argv[1]).execute('CREATE TABLE t (x)')"
    threads = "import threading; threading.Thread(target=int).start()"
    for kind, program, reason in (("pwrite", code, "disk I/O error"), ("thread", threads, "can't start new thread")):
        shim.arm(Plan(kind, "EIO" if kind == "pwrite" else "EAGAIN", "backup", None))
        command = [sys.executable, "-c", program, str(tmp_path / "state.db"), "backup", "--config"]
        done = subprocess.run(command, env=shim.environment, capture_output=True, text=True, check=False)
        assert reason in done.stderr
        assert shim.fired == 1


def test_cases_name_kinds_roles_and_places_that_there_are() -> None:
    cases = all_cases()
    assert len({case.name for case in cases}) == len(cases)
    assert {case.plan.kind for case in cases} <= set(KINDS)
    assert {case.plan.role for case in cases} <= set(ROLES)
    assert {case.plan.place for case in cases} <= set(PLACES)
    assert set(FEW) <= {case.name for case in cases}


def test_blocks_that_are_lost_doubled_or_changed_are_counted(tmp_path: Path) -> None:
    store = tmp_path / "state.db"
    with closing(sqlite3.connect(store)) as connection:
        connection.executescript(
            "CREATE TABLE blocks (source, sequence, content_hash);"
            "CREATE TABLE identities (source, sequence, content);"
            "CREATE TABLE condensed_sources (id, source);"
            "INSERT INTO condensed_sources VALUES (1, 't');"
            "INSERT INTO identities VALUES (1, 1, x'0a');"
            "INSERT INTO blocks VALUES ('t', 2, '0b'), ('t', 3, '0c'), ('f', 1, '0d');"
        )

    def found(acknowledged: dict[int, str], given: dict[str, str]) -> dict[str, int]:
        blocks = SimpleNamespace(acknowledged=acknowledged, went_back=[])
        life = SimpleNamespace(store=store, blocks=blocks, files=SimpleNamespace(given=given))
        return wrongs(cast("Any", life))

    whole = {1: "0a", 2: "0b", 3: "0c"}
    assert found(whole, {"x": "0d"}) == {"lost": 0, "doubled": 0, "changed": 0, "rejected": 0}
    assert found(whole | {4: "0e"}, {"x": "0d"})["lost"] == 1
    assert found(whole | {2: "ff"}, {"x": "0d"})["changed"] == 1
    assert found(whole, {"x": "0e"})["changed"] == 1
    with closing(sqlite3.connect(store)) as connection, connection:
        connection.execute("INSERT INTO blocks VALUES ('t', 4, '0c'), ('f', 2, '')")
    assert found(whole, {"x": "0d"}) == {"lost": 0, "doubled": 1, "changed": 0, "rejected": 1}


@pytest.fixture(scope="module")
def life() -> Any:
    """One life for all cases."""
    with Life() as found:
        assert found.wait_well(3 * START_S)
        yield found


@pytest.mark.timeout(900)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_fault_loses_nothing_and_ends(life: Life, case: Case) -> None:
    verdict = judge(life, case, goes_on_s=60.0)
    assert verdict.fired or effort_count(quick=0, full=1), "the fault never came"
    assert verdict.problems == [], verdict.row()
