"""SQLite's own errors at each call of a commit: nothing is acknowledged that is not there, and a repetition commits.

The errors are real. A full database is one whose ``max_page_count`` is reached, an interruption comes from the progress
handler, memory runs out by ``hard_heap_limit``, and an input or output error or a full disk is what the kernel answers
to a system call, by ``strace``.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import sqlite3
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.ledger import StoreLedger, write_progress
from monitor.records.store import Store
from streams.types.source import FileProgress
from tests.support.effort import effort_count
from tests.support.forks import Fork, Messages
from tests.support.store_kill import block
from tests.support.waiting import finish, wait_until

BEFORE = 3
"""Blocks that are there before the one that meets the error."""
STRACE = shutil.which("strace")
CALLS = ("pwrite64", "fdatasync", "pread64")
PR_SET_PTRACER = 0x59616D61


def long_block(sequence: int) -> Record:
    """Return a block whose record needs new pages."""
    values = {"rms": 1.0 / sequence, "stage": "healthy"}
    events = tuple({"kind": "tick", "n": k, "text": "x" * 500} for k in range(40))
    return Record("s", sequence, f"block {sequence}", f"{sequence:08x}", channels={"x": values}, events=events)


def commit(store: Store, record: Record) -> str:
    """Commit a block with a state and the place in its file, as the daemon does."""
    place = FileProgress(record.name, 100, 1, 1, "h", record.content_hash, 100, 10, "accepted")
    states = {"channel:s:x": {"seen": record.sequence}}
    return store.commit(record, states, lambda connection: write_progress(connection, record.source, [place]))


class Injecting:
    """A connection that prepares an error before its n-th call."""

    def __init__(self, connection: sqlite3.Connection, n: int, prepare: Callable[[sqlite3.Connection], None]) -> None:
        self.real, self.n, self.prepare, self.calls = connection, n, prepare, 0

    def _count(self) -> None:
        self.calls += 1
        if self.calls == self.n:
            self.prepare(self.real)

    def execute(self, *given: Any) -> sqlite3.Cursor:
        self._count()
        return self.real.execute(*given)

    def executemany(self, *given: Any) -> sqlite3.Cursor:
        self._count()
        return self.real.executemany(*given)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.real, name)


def full(connection: sqlite3.Connection) -> None:
    connection.execute(f"PRAGMA max_page_count = {connection.execute('PRAGMA page_count').fetchone()[0]}")


def roomy(connection: sqlite3.Connection) -> None:
    connection.execute("PRAGMA max_page_count = 1000000")


def interrupt(connection: sqlite3.Connection) -> None:
    once = [1]
    connection.set_progress_handler(lambda: once.pop() if once else 0, 1)


def let_go(connection: sqlite3.Connection) -> None:
    connection.set_progress_handler(None, 1)


def starve(connection: sqlite3.Connection) -> None:
    connection.execute("PRAGMA hard_heap_limit = 1")


def with_error(store: Store, n: int, prepare: Callable[[sqlite3.Connection], None]) -> tuple[str, int]:
    """Commit a block while an error is prepared before the n-th call; return the answer and the number of calls."""
    real = store._connection
    injecting = Injecting(real, n, prepare)
    store._connection = injecting  # pyright: ignore[reportAttributeAccessIssue]
    try:
        return commit(store, long_block(BEFORE + 1)), injecting.calls
    except StoreError as error:
        return str(error), injecting.calls
    finally:
        store._connection = real


def assert_whole(store: Store, blocks: int) -> None:
    """Check that the store holds the first blocks, whole and once, with the state after the last of them."""
    assert store.check() == []
    assert [record.sequence for record in store.records()] == list(range(1, blocks + 1))
    assert store.load_states() == {"channel:s:x": {"seen": blocks}}
    assert store.rows("SELECT count(*) FROM digests")[0][0] == blocks
    events = 40 if blocks > BEFORE else 0
    assert len(store.events()) == events + BEFORE // 3


def begun(path: Path) -> Store:
    store = Store.open(path, machine="m")
    StoreLedger(store).close()
    for sequence in range(1, BEFORE + 1):
        assert commit(store, block(sequence)) == "committed"
    return store


@pytest.mark.parametrize(
    ("prepare", "undo", "said"),
    [(full, roomy, "database or disk is full"), (interrupt, let_go, "interrupted")],
    ids=["full", "interrupted"],
)
def test_an_error_at_any_call_commits_nothing(
    tmp_path: Path,
    prepare: Callable[[sqlite3.Connection], None],
    undo: Callable[[sqlite3.Connection], None],
    said: str,
) -> None:
    n, refused = 0, 0
    while True:
        n += 1
        with begun(tmp_path / f"{n}.db") as store:
            answer, calls = with_error(store, n, prepare)
            undo(store._connection)
            if calls < n:
                break
            if answer != "committed":
                assert answer == f"{store.path}: {said}"
                refused += 1
                assert_whole(store, BEFORE)
                assert commit(store, long_block(BEFORE + 1)) == "committed"
            assert_whole(store, BEFORE + 1)
        with Store.open(tmp_path / f"{n}.db", machine="m") as store:
            assert_whole(store, BEFORE + 1)
    assert n > 10
    # A full database is met only by the calls that need a new page.
    assert refused >= (n - 1 if said == "interrupted" else 3)


def commit_starved(messages: Messages, path: Path, n: int) -> None:
    """Commit while no memory is left from the n-th call on, send the answer and end as if killed."""
    with begun(path) as store:
        messages.send(with_error(store, n, starve))
        os._exit(0)


@pytest.mark.process
@pytest.mark.parametrize("n", range(1, effort_count(quick=4, full=40)))
def test_without_memory_nothing_is_committed(tmp_path: Path, n: int) -> None:
    # The limit cannot be raised again, so that each is a process of its own, which ends as if it were killed.
    step = effort_count(quick=5, full=1)
    path = tmp_path / "state.db"
    ((answer, calls),) = Fork(commit_starved, path, n * step).finish()
    with Store.open(path, machine="m") as store:
        assert_whole(store, BEFORE + (answer == "committed"))
        if answer != "committed":
            assert "out of memory" in answer
            assert commit(store, long_block(BEFORE + 1)) == "committed"
        elif calls >= n * step:
            pytest.fail(f"no memory was needed from call {n * step} on")
        assert_whole(store, BEFORE + 1)


def commit_eight(messages: Messages, path: Path) -> None:
    """Commit eight blocks once a tracer lets this process go on, and send the answers."""
    # The tracer is no ancestor.
    ctypes.CDLL(None).prctl(PR_SET_PTRACER, ctypes.c_ulong(-1), 0, 0, 0)
    os.kill(os.getpid(), signal.SIGSTOP)
    answers: list[tuple[int, str]] = []
    try:
        with Store.open(path, machine="m") as store:
            StoreLedger(store).close()
            for sequence in range(1, 9):
                try:
                    answers.append((sequence, commit(store, block(sequence))))
                except StoreError as error:
                    answers.append((sequence, str(error)))
    except StoreError as error:
        answers.append((0, str(error)))
    messages.send(answers)


def status_of(process: Fork, field: str) -> str:
    """Return a field of a process in /proc."""
    (line,) = re.findall(rf"^{field}:\s+(.*)$", Path(f"/proc/{process.pid}/status").read_text(), re.MULTILINE)
    return line


def answers_under(path: Path, *inject: str) -> list[tuple[int, str]]:
    """Commit eight blocks while the kernel refuses some calls on the database; return the answers."""
    assert STRACE is not None
    child = Fork(commit_eight, path)
    wait_until(lambda: status_of(child, "State").startswith("T"))
    files = [part for suffix in ("", "-wal", "-journal") for part in ("-P", f"{path}{suffix}")]
    command = [STRACE, "-q", "-p", str(child.pid), "-o", f"{path}.trace", *files, "-e", f"trace={','.join(CALLS)}"]
    with subprocess.Popen([*command, *inject], stderr=subprocess.PIPE, text=True) as tracer:
        wait_until(lambda: status_of(child, "TracerPid") != "0" or tracer.poll() is not None)
        assert tracer.poll() is None, tracer.communicate()[1]
        os.kill(child.pid, signal.SIGCONT)
        (answers,) = child.finish()
        said = finish(tracer)
    assert tracer.returncode == 0, said
    return answers


@pytest.mark.process
@pytest.mark.parametrize("error", ["EIO", "ENOSPC"])
@pytest.mark.parametrize("call", CALLS)
def test_what_the_kernel_refuses_is_not_acknowledged(tmp_path: Path, call: str, error: str) -> None:
    if STRACE is None:
        reason = "strace is missing (Debian package strace)"
        if os.environ.get("CI"):
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    counted = answers_under(tmp_path / "counted.db")
    assert counted == [(sequence, "committed") for sequence in range(1, 9)]
    calls = Path(f"{tmp_path}/counted.db.trace").read_text().count(f"{call}(")
    assert calls > 3
    every = max(1, calls // effort_count(quick=3, full=10**6))
    refused = 0
    for n in range(1, calls + 1, every):
        path = tmp_path / f"{n}.db"
        answers = answers_under(path, "-e", f"inject={call}:error={error}:when={n}")
        acknowledged = [sequence for sequence, answer in answers if answer in ("committed", "duplicate")]
        refused += len(answers) != len(acknowledged)
        if 0 in dict(answers):
            acknowledged = []
        with Store.open(path, machine="m") as store:
            StoreLedger(store).close()
            assert store.check() == []
            there = [record.sequence for record in store.records()]
            assert set(acknowledged) <= set(there)
            for sequence in range(1, 9):
                assert commit(store, block(sequence)) == ("duplicate" if sequence in there else "committed")
            assert sorted(record.sequence for record in store.records()) == list(range(1, 9))
            assert {record.sequence: record for record in store.records()} == {k: block(k) for k in range(1, 9)}
    assert refused > 0


def test_a_block_that_meets_a_lack_of_memory_is_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not put aside as one that cannot be analysed."""
    with begun(tmp_path / "state.db") as store:

        def fails(*given: Any) -> None:
            raise MemoryError

        monkeypatch.setattr("monitor.records.filing.file_record", fails)
        with pytest.raises(StoreError, match="out of memory"):
            commit(store, block(BEFORE + 1))
        monkeypatch.undo()
        assert commit(store, block(BEFORE + 1)) == "committed"
