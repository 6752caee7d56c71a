"""No state that a crash may leave of a short life breaks a promise; on a disk that lies, broken ones are found."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchmarks.common import effort_count
from benchmarks.crash.__main__ import workplace
from benchmarks.crash.explore import Recorded, explore, record_life, shown
from benchmarks.crash.history import Change, Disk, History, changed
from benchmarks.crash.recorder import Entry, has_compiler

pytestmark = pytest.mark.process
CALLS = {"create", "write", "truncate", "fsync", "fdatasync", "rename", "link", "unlink", "rmdir", "mkdir"}


@pytest.fixture(scope="module")
def life():
    if not has_compiler():
        if os.environ.get("CI"):
            pytest.fail("gcc is missing", pytrace=False)
        pytest.skip("the recorder needs gcc")
    with workplace() as folder:
        yield record_life(folder / "life")


@pytest.mark.timeout(effort_count(quick=600, full=4 * 3600))
def test_no_crash_state_breaks_a_promise(life: Recorded) -> None:
    found = explore(life, effort_count(quick=200, full=10_000))
    assert list(shown(found)) == []
    assert found.distinct >= effort_count(quick=200, full=10_000)
    assert {entry.call for entry in life.entries} - {"mark"} == CALLS


@pytest.mark.timeout(600)
def test_a_disk_that_lies_breaks_promises(life: Recorded) -> None:
    found = explore(life, 400, models=("ordered",), ignore_syncs=True, stop_at=3)
    assert len(found.broken) >= 3


def test_changes_of_a_file_fill_gaps_with_zeros() -> None:
    changes = [Change(file=1, offset=3, data=b"ab"), Change(file=1, offset=4), Change(file=1, offset=0, data=b"x")]
    assert changed(b"", changes) == b"x\0\0a"


def entry(call: str, *paths: str, inode: int = 0, data: bytes = b"", is_folder: bool = False) -> Entry:
    return Entry(call, inode, is_folder, 0, tuple(f"/r/{path}" for path in paths), data)


@pytest.mark.parametrize(("model", "kept"), [("ordered", {"b": b"new"}), ("weakest", {})])
def test_a_synced_file_keeps_its_name_in_order_alone(model: str, kept: dict[str, bytes]) -> None:
    history = History(Path("/r"), model)  # type: ignore[arg-type]
    history.add(entry("create", "a", inode=7))
    history.add(entry("write", inode=7, data=b"new"))
    history.add(entry("rename", "a", "b", inode=7))
    assert history.disk.tree((), history.kinds)[0] == {}
    history.add(entry("fsync", inode=7))
    assert history.disk.tree((), history.kinds)[0] == kept
    history.add(entry("fsync", inode=1, is_folder=True))
    assert history.disk.tree((), history.kinds)[0] == {"b": b"new"}


def test_an_unsynced_write_may_be_lost_behind_a_durable_name() -> None:
    disk = Disk("ordered", pending=[Change(((0, "a", 1),)), Change(file=1, data=b"x"), Change(file=2, data=b"y")])
    disk.sync(2, data_only=False)
    assert disk.tree((), {0: True, 1: False, 2: False})[0] == {"a": b""}
