"""Stores of earlier commits: the daemon takes them over whole, says so, and goes on as the commit itself did.

The backups under tests/data/older are made by ``python -m benchmarks.regression.older``.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import sqlite3
import tarfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.regression.observe import of_store
from benchmarks.regression.older import (
    CLOSE,
    COMMITS,
    EQUAL,
    MORE,
    OLD_MAP,
    V_EQ,
    WHOLE,
    configuration,
    published,
    write_files,
)
from benchmarks.regression.store import next_blocks
from monitor.cli import spallwatch
from monitor.config.load import ConfigError, load_config
from monitor.records import database
from monitor.records.database import STORE_VERSION, StoreError
from monitor.records.store import Store
from monitor.service.daemon import Daemon

pytestmark = pytest.mark.process
KEPT = Path(os.environ.get("SPALLWATCH_OLDER", Path(__file__).parents[2] / "tests" / "data" / "older"))
PATIENCE_S = 120.0
V_EQ_TOLERANCE = {"thesis": 1e-4, "filter": 1e-2}
"""Relative, by method: the map is that of another commit, and since then particles of the filter may stand still."""
CACHES = ("meta", "rollup", "sqlite_sequence", "sqlite_stat1")
"""Tables that hold no record, or (``meta``) are compared by key."""


RENEWED = ("files", "stage_states", "spectra", "published", "told", "digests")
"""Tables that change with the blocks that are taken, and with the files, whose inodes are others here."""


class Older:
    """A machine with the state of an earlier commit."""

    def __init__(self, commit: str, folder: Path) -> None:
        with tarfile.open(KEPT / f"{commit}.tar.xz") as packed:
            packed.extractall(folder, filter="data")
        self.backup, self.folder = folder / "backup", folder
        self.expected = json.loads((folder / "expected.json").read_text())
        self.blocks: int = self.expected["blocks"]
        self.version = int(dict(rows_of(self.backup / "state.db")["meta"])["schema_version"])
        self.config, self.store = folder / "m.toml", folder / "state" / "state.db"
        write_files(folder / "in", 1, self.blocks, self.blocks)
        self.method = COMMITS[commit]
        self.config.write_text(configuration(folder / "in", self.method, rig={"calibrated": "declared"}))
        with tarfile.open(KEPT / f"{WHOLE}.tar.xz") as packed, (folder / "map.nc").open("wb") as out:
            found = packed.extractfile("backup/config/x-map.nc")
            assert found is not None
            shutil.copyfileobj(found, out)

    def restored(self) -> Path:
        """Put the store in its place, by the command where the backup is whole, and return its path."""
        if (self.backup / "manifest.json").exists():
            words = ["restore", str(self.backup), "--config", str(self.config), "--quiet"]
            done = CliRunner().invoke(spallwatch, words)
            assert done.exit_code == 0, done.output
        else:
            self.store.parent.mkdir()
            shutil.copy(self.backup / "state.db", self.store)
        return self.store


@pytest.fixture(params=COMMITS)
def older(request: pytest.FixtureRequest, tmp_path: Path) -> Older:
    return Older(request.param, tmp_path)


def rows_of(path: Path) -> dict[str, list[tuple[Any, ...]]]:
    """Return all rows of all tables of a database that is not in use, each table in its own order."""
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
        names = [name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        return {name: connection.execute(f"SELECT * FROM {name}").fetchall() for name in names}


def assert_kept(
    before: dict[str, list[tuple[Any, ...]]],
    after: dict[str, list[tuple[Any, ...]]],
    but: tuple[str, ...] = (),
) -> None:
    """Check that each row is there as it was, bit for bit, later columns apart; NaN is no value of SQLite."""
    for table, rows in before.items():
        if table not in (*CACHES, *but):
            found = after[table][: len(rows)]
            assert len(found) == len(rows), table
            assert [row[: len(old)] for row, old in zip(found, rows, strict=True)] == rows, table
    versions = dict(before["meta"]), dict(after["meta"])
    changed = {key for key in versions[0] if versions[0][key] != versions[1].get(key)}
    assert changed <= {"schema_version", "rolled_up", "rollup_features", "config_hash", "software_version"}


@contextmanager
def running(config: Path) -> Iterator[Callable[[], bool]]:
    """Run the daemon in a thread; yields whether it goes on, and ends it in order."""
    stop, failures = threading.Event(), list[Exception]()
    daemon = Daemon(load_config(config))

    def run() -> None:
        try:
            daemon.run(stop)
        except Exception as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield thread.is_alive
    finally:
        stop.set()
        thread.join()
    if failures:
        raise failures[0]


def take_blocks(older: Older) -> None:
    """Let the daemon take the blocks after those of the backup, and publish them."""
    with running(older.config) as goes_on:
        write_files(older.folder / "in", older.blocks + 1, older.blocks + MORE, older.blocks)
        until = time.monotonic() + PATIENCE_S
        while goes_on() and time.monotonic() < until:
            with suppress(StoreError), Store.open(older.store, read_only=True) as store:
                last = store.rows("SELECT max(last_block) FROM published")[0][0]
                if store.last("s") == older.blocks + MORE and last == store.rows("SELECT max(id) FROM blocks")[0][0]:
                    return
            time.sleep(0.05)


def test_the_store_of_an_earlier_commit_goes_on_and_nothing_recorded_changes(
    older: Older, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    before = rows_of(older.restored())
    take_blocks(older)
    after = rows_of(older.store)
    assert_kept(before, after, but=RENEWED)
    said = f"its tables of version {older.version} are now those of version {STORE_VERSION}"
    assert (said in caplog.text) == (older.version < STORE_VERSION)
    # No file of before was read again.
    assert len(after["blocks"]) == older.blocks + MORE
    assert after["refusals"] == []
    with Store.open(older.store, read_only=True) as store:
        assert store.check() == []
    found = next_blocks(of_store("live/store", older.store), older.blocks)
    expected = older.expected["columns"]
    for name in EQUAL:
        assert found[f"blocks/{name}"] == expected[name], name
    for name, tolerance in {**dict.fromkeys(CLOSE, 1e-5), V_EQ: V_EQ_TOLERANCE[older.method]}.items():
        one, other = numbers(found[f"blocks/{name}"]), numbers(expected[name])
        np.testing.assert_allclose(one, other, rtol=tolerance, err_msg=name)


def numbers(values: list[Any]) -> np.ndarray:
    return np.array(values, dtype=float)


def test_what_an_earlier_commit_published_is_published_again_with_equal_values(older: Older) -> None:
    older.restored()
    take_blocks(older)
    expected, found = older.expected["published"], published(older.folder / "records", older.blocks)
    assert {name: found.get(name) for name in expected} == expected


def test_a_store_newer_than_the_program_is_refused_and_left_as_it_is(older: Older) -> None:
    path = older.restored()
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("UPDATE meta SET value = ? WHERE key = 'schema_version'", (str(STORE_VERSION + 1),))
        connection.execute("PRAGMA auto_vacuum = NONE")
        connection.execute("VACUUM")
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    before = path.read_bytes()
    with pytest.raises(StoreError, match=f"schema version {STORE_VERSION + 1}; this program knows versions up to"):
        # Beside it no reader, which would make a log of its own.
        Daemon(load_config(older.config)).run(threading.Event())
    assert path.read_bytes() == before
    assert [part.name for part in path.parent.glob("state.db-*")] == []
    replay = CliRunner().invoke(spallwatch, ["status", "--config", str(older.config)])
    assert "Traceback" not in replay.output


def killed_at(statement: int, path: Path) -> bool:
    """Open a store for writing in a fork that dies before a statement; return whether it came that far."""
    child = os.fork()
    if not child:
        real, left = database.opened, [statement]

        def opened(*arguments: Any, **options: Any) -> sqlite3.Connection:
            connection = real(*arguments, **options)
            connection.set_trace_callback(die)
            return connection

        def die(_text: str) -> None:
            left[0] -= 1
            if left[0] < 0:
                os._exit(9)

        with patch.object(database, "opened", opened):
            Store.open(path).close()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9


def test_a_migration_that_is_killed_at_any_step_begins_again_whole(older: Older) -> None:
    path = older.restored()
    before = rows_of(older.backup / "state.db")
    expected: dict[str, list[tuple[Any, ...]]] | None = None
    statement = 0
    while True:
        for part in path.parent.glob("state.db*"):
            part.unlink()
        shutil.copy(older.backup / "state.db", path)
        (path.parent / "trends.db").write_bytes(b"the cache of an older version")
        dies = killed_at(statement, path)
        Store.open(path).close()
        found = rows_of(path)
        assert_kept(before, found)
        assert (path.parent / "trends.db").exists() == (older.version == STORE_VERSION)
        expected = expected or found
        assert found == expected, statement
        if not dies:
            break
        statement += 1
    assert statement > 5


def test_a_map_of_an_earlier_model_is_refused_with_what_to_do(tmp_path: Path) -> None:
    older = Older(OLD_MAP, tmp_path)
    older.restored()
    (tmp_path / "old-map.nc").replace(tmp_path / "map.nc")
    with pytest.raises(ConfigError, match=r"map\.nc: .*a map of another version, build it anew"):
        take_blocks(older)
