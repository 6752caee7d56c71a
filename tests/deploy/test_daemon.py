"""The daemon under the restrictions of its unit, and the backup of its store while it runs."""

from __future__ import annotations

import ctypes
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
import xarray as xr

from monitor.records.store import Store
from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import make_machine, start, start_program, status
from tests.support.forks import ForkedProgram
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process

_SET_MDWE, _REFUSE_EXEC_GAIN = 65, 1


@contextmanager
def in_order(daemon: ForkedProgram | subprocess.Popen[str]) -> Iterator[None]:
    """Stop a daemon at the end, which must end in order."""
    try:
        yield
        log = stop(daemon)
        assert daemon.returncode == 0, log
    finally:
        daemon.kill()
        daemon.communicate()


def forbid_executable_memory() -> None:
    """Make this process and its children unable to turn memory executable, as MemoryDenyWriteExecute= does."""
    if ctypes.CDLL(None, use_errno=True).prctl(_SET_MDWE, _REFUSE_EXEC_GAIN, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_MDWE)")


def test_the_daemon_works_where_no_memory_can_become_executable(tmp_path: Path) -> None:
    tried = "import mmap; mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)"
    try:
        done = subprocess.run(
            [sys.executable, "-c", tried], preexec_fn=forbid_executable_memory, capture_output=True, check=False
        )
    except subprocess.SubprocessError:
        pytest.skip("the kernel is older than 6.3 and cannot forbid it")
    assert b"PermissionError" in done.stderr
    config = make_machine(tmp_path)
    path = tmp_path / "in0" / "f1.csv"
    path.write_bytes(csv_bytes(noise(512, 1)))
    with in_order(start_program(config, preexec_fn=forbid_executable_memory)):
        wait_until(lambda: status(config).get("blocks") == 2)
        wait_until(lambda: (tmp_path / "records" / "m-undated.nc").exists())
    with xr.open_dataset(tmp_path / "records" / "m-undated.nc") as dataset:
        assert dataset.sizes["time"] == 2


def test_a_backup_of_a_running_store_can_be_put_back(tmp_path: Path) -> None:
    config, database = make_machine(tmp_path), tmp_path / "state" / "state.db"
    (tmp_path / "in0" / "f1.csv").write_bytes(csv_bytes(noise(512, 1)))
    with in_order(start(config)):
        wait_until(lambda: status(config).get("blocks") == 2)
        # What .backup of the sqlite3 shell does.
        with closing(sqlite3.connect(database)) as running, closing(sqlite3.connect(tmp_path / "copy.db")) as copy:
            running.backup(copy)
    shutil.rmtree(tmp_path / "state")
    database.parent.mkdir()
    (tmp_path / "copy.db").rename(database)
    (tmp_path / "in0" / "f2.csv").write_bytes(csv_bytes(noise(512, 2)))
    with in_order(start(config)):
        # The first file is known already.
        wait_until(lambda: status(config).get("blocks") == 2)
    with Store.open(database, read_only=True) as store:
        assert [record.sequence for record in store.records()] == [1, 2, 3, 4]
        assert store.check() == []
