"""Locks of a store between processes: whoever looks at the file beside its own connections must not let go of them.

POSIX takes all locks of a process on a file away as soon as it closes any descriptor of that file. Without its lock a
connection is not seen by others, and the last one that they see removes the log when it is closed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.durable import take_lock
from monitor.records.reader import StoreReader
from monitor.records.recover.published import gather
from monitor.records.store import Store
from tests.support.daemons import ROOT
from tests.support.forks import Fork, Messages
from tests.support.waiting import wait_until

_COUNT = "SELECT count(*) FROM blocks"
_ACKNOWLEDGE = """
import sys, time
from pathlib import Path
from monitor.records.events import EventLog
EventLog(Path(sys.argv[1])).close()
"""
_COMMIT = """
import sys
from pathlib import Path
from monitor.health.record import Record
from monitor.records.store import Store
with Store.open(Path(sys.argv[1]), machine="m") as store:
    number = store.last("s") + 1
    store.commit(Record("s", number, "b", str(number)), {})
"""


def other_process(program: str, path: Path) -> None:
    subprocess.run([sys.executable, "-c", program, str(path)], cwd=ROOT, check=True)


@pytest.mark.process
def test_a_reader_in_the_process_of_the_writer_does_not_cost_it_its_log(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    with Store.open(path, machine="m") as store:
        store.commit(Record("s", 1, "b", "1"), {})
        log = path.with_name("state.db-wal").stat().st_ino
        with Store.open(path, read_only=True) as reader:
            assert reader.last("s") == 1
        other_process(_ACKNOWLEDGE, path)
        assert path.with_name("state.db-wal").stat().st_ino == log
        assert store.commit(Record("s", 2, "b", "2"), {}) == "committed"
        with Store.open(path, read_only=True) as reader:
            assert reader.last("s") == 2


@pytest.mark.process
def test_the_page_reads_on_when_the_writer_is_started_anew(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    other_process(_COMMIT, path)
    reader = StoreReader(path)
    with reader.connection() as first, reader.connection() as second:
        assert first.execute(_COUNT).fetchall() == second.execute(_COUNT).fetchall() == [(1,)]
    for number in (2, 3):
        other_process(_COMMIT, path)
        assert reader.rows(_COUNT) == [(number,)]
    reader.close()


@pytest.mark.parametrize(("content", "says"), [(b"words, no database" * 9, "is not a database"), (b"", "is empty")])
def test_a_reader_is_told_what_is_no_store(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "state.db").write_bytes(content)
    with pytest.raises(StoreError, match=says):
        Store.open(tmp_path / "state.db", read_only=True)


def test_a_lock_that_a_child_of_a_killed_process_holds_for_a_moment_is_waited_for(tmp_path: Path) -> None:
    """Between fork and exec a child holds the descriptors of its parent, which may be killed meanwhile."""
    path = tmp_path / "state.db"
    held = take_lock(path)
    assert held is not None
    releasing = threading.Timer(0.3, held.close)
    releasing.start()
    taken = take_lock(path)
    releasing.join()
    assert taken is not None
    taken.close()


@pytest.mark.process
def test_the_process_that_reads_published_files_ends_with_its_parent(tmp_path: Path) -> None:
    """A process that outlives its parent would write into the scratch store of the next recovery."""
    slow = tmp_path / "slow.nc"
    os.mkfifo(slow)
    parent = Fork(_gather, tmp_path, slow)
    parent.receive()
    children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")
    wait_until(lambda: len(children.read_text().split()) == 1)
    (child,) = children.read_text().split()
    parent.kill()
    wait_until(lambda: not Path(f"/proc/{child}/cmdline").exists() or not Path(f"/proc/{child}/cmdline").read_bytes())


def _gather(messages: Messages, folder: Path, file: Path) -> None:
    messages.send("begun")
    gather([file], "m", folder / "scratch.db", lambda: None)
