"""The policy of errors: what each error says of the store, and when damage is believed."""

from __future__ import annotations

import errno
import logging
import os
import sqlite3
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from monitor.health.record import Record
from monitor.records.events import EventLog
from monitor.records.failures import Failures, Kind, StoreDamagedError, StoreError, confirmed, discards, kind_of
from monitor.records.recover.loss import damage_in_use
from monitor.records.recover.salvage import open_or_salvage
from monitor.records.store import Store
from tests.support.store_faults import ERRORS, Faults, coded


def of_sqlite(code: int) -> sqlite3.Error:
    return coded(sqlite3.OperationalError("words"), code)


@pytest.mark.parametrize(
    ("error", "kind", "discarded"),
    [
        (of_sqlite(sqlite3.SQLITE_BUSY), Kind.TRANSIENT, True),
        (of_sqlite(sqlite3.SQLITE_BUSY_SNAPSHOT), Kind.TRANSIENT, True),
        (of_sqlite(sqlite3.SQLITE_PROTOCOL), Kind.TRANSIENT, True),
        (of_sqlite(sqlite3.SQLITE_IOERR_FSYNC), Kind.TRANSIENT, True),
        (of_sqlite(sqlite3.SQLITE_IOERR_CORRUPTFS), Kind.TRANSIENT, True),
        (of_sqlite(sqlite3.SQLITE_FULL), Kind.TRANSIENT, False),
        (of_sqlite(sqlite3.SQLITE_CANTOPEN), Kind.TRANSIENT, False),
        (of_sqlite(sqlite3.SQLITE_NOMEM), Kind.TRANSIENT, False),
        (of_sqlite(sqlite3.SQLITE_READONLY_CANTLOCK), Kind.TRANSIENT, False),
        (of_sqlite(sqlite3.SQLITE_READONLY), Kind.LASTING, False),
        (of_sqlite(sqlite3.SQLITE_PERM), Kind.LASTING, False),
        (of_sqlite(sqlite3.SQLITE_ERROR), Kind.LASTING, False),
        (of_sqlite(sqlite3.SQLITE_CORRUPT_INDEX), Kind.DAMAGE, True),
        (of_sqlite(sqlite3.SQLITE_NOTADB), Kind.DAMAGE, True),
        (sqlite3.ProgrammingError("Cannot operate on a closed database."), Kind.LASTING, False),
        (MemoryError(), Kind.TRANSIENT, False),
        (OSError(errno.EIO, "x"), Kind.TRANSIENT, False),
        (OSError(errno.ENOLCK, "x"), Kind.TRANSIENT, False),
        (OSError(errno.EMFILE, "x"), Kind.TRANSIENT, False),
        (OSError(errno.EROFS, "x"), Kind.LASTING, False),
        (PermissionError(errno.EACCES, "x"), Kind.LASTING, False),
        (StoreError("x"), Kind.LASTING, False),
    ],
)
def test_each_error_has_a_kind(error: Exception, kind: Kind, discarded: bool) -> None:
    assert kind_of(error) is kind
    assert discards(error) is discarded
    told = StoreError("state.db: words")
    told.__cause__ = error
    assert told.kind is kind


def test_damage_is_believed_when_two_checks_find_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.records.failures._AGAIN_S", 0.0)
    answers = ["bad", None, "bad", "worse"]
    assert confirmed(lambda: answers.pop(0)) is None
    assert confirmed(lambda: answers.pop(0)) == "worse"
    malformed = coded(sqlite3.DatabaseError("malformed"), sqlite3.SQLITE_CORRUPT)
    failures = Failures("it fails", "it works", lambda: None, clock=lambda: 0.0)
    failures.note(malformed)
    failures.note(malformed)
    assert failures.problem == "malformed (2 times since 1970-01-01T00:00:00Z)"
    failures.end()
    assert failures.problem is None
    assert failures.history is not None
    assert failures.history["count"] == 2
    failures = Failures("it fails", "it works", lambda: "page 3 is wrong")
    failures.note(of_sqlite(sqlite3.SQLITE_IOERR_READ))
    with pytest.raises(StoreDamagedError, match="page 3 is wrong") as told:
        failures.note(malformed)
    assert told.value.exit_code == 1


def filled(path: Path) -> Path:
    """Make a store whose blocks are in the database, not in its log."""
    with Store.open(path, machine="m") as store:
        for sequence in range(1, 60):
            store.commit(Record("s", sequence, f"block {sequence}", f"{sequence:08x}"), {"x": {"seen": sequence}})
    return path


def test_damage_is_seen_beside_the_writer_without_costing_it_its_locks(tmp_path: Path) -> None:
    path = filled(tmp_path / "state.db")
    with Store.open(path) as store:
        assert damage_in_use(path) is None
        handle = os.open(path, os.O_WRONLY)
        os.pwrite(handle, b"\xff" * 8192, path.stat().st_size // 2)
        for _ in range(2):
            assert damage_in_use(path)
        # A page process that now takes itself for the only one would remove the log.
        locks = Path("/proc/locks").read_text()
        assert f":{path.with_name('state.db-shm').stat().st_ino} " in locks
        assert store.writable
        os.close(handle)


@pytest.mark.parametrize("error", ["malformed", "read", "lock"])
@pytest.mark.parametrize("first", range(1, 24, 2))
def test_one_failing_read_at_the_start_makes_no_store_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: str, first: int
) -> None:
    path = filled(tmp_path / "state.db")
    faults = Faults(first, 1, error)
    faults.install(monkeypatch)
    opened = None
    with suppress(StoreError):
        opened = open_or_salvage(path, machine="m")
    assert faults.fired == 1
    store, report = opened or open_or_salvage(path, machine="m")
    with store:
        assert report is None
        assert store.last("s") == 59
    assert not list(tmp_path.glob("*.corrupt-*"))


@pytest.mark.parametrize("error", ERRORS)
def test_a_connection_works_again_after_each_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.ERROR)
    path = filled(tmp_path / "state.db")
    faults = Faults(10**6, 2, error)
    faults.install(monkeypatch)
    with Store.open(path) as store, EventLog(path) as log:
        faults.first, faults.end = faults.statements + 1, faults.statements + 3
        for use in (lambda: store.rows("SELECT 1"), lambda: log.notice(0.0, {"kind": "tick"})):
            with pytest.raises(StoreError):
                use()
        assert faults.fired == 2
        assert log.notice(0.0, {"kind": "tick"}) == "n1"
        assert store.commit(Record("s", 60, "block 60", "60"), {}) == "committed"
        assert store.rows("PRAGMA synchronous") == log.rows("PRAGMA synchronous") == [(2,)]
        assert len(log.notices()) == 1
    with pytest.raises(StoreError, match="closed"):
        log.notice(0.0, {"kind": "tick"})


def test_a_file_that_cannot_be_opened_now_is_not_taken_for_a_damaged_store(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, opened = filled(tmp_path / "state.db"), Path.open

    def refused(self: Path, *given: Any, **named: Any) -> Any:
        if self == path:
            raise OSError(errno.EMFILE, "Too many open files")
        return opened(self, *given, **named)

    monkeypatch.setattr(Path, "open", refused)
    with pytest.raises(StoreError, match="Too many open files") as told:
        open_or_salvage(path, machine="m")
    assert told.value.kind is Kind.TRANSIENT
    monkeypatch.undo()
    store, report = open_or_salvage(path, machine="m")
    store.close()
    assert report is None
