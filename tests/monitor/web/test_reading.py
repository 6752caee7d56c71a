"""Reading beside the writer: stores that are replaced, queries that take too long, threads that are all busy."""

from __future__ import annotations

import json
import socket
import sqlite3
import threading
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.reader import LedgerTally, StoreReader
from monitor.records.store import Store
from monitor.service.system import StatusFile
from monitor.web import api
from monitor.web.answers import numbers, without_folders
from tests.support.daemons import make_machine
from tests.support.effort import effort_count
from tests.support.pages import Page, page_of
from tests.support.waiting import PATIENCE_S, wait_until


def fill(path: Path, statuses: list[str], first: int = 1) -> None:
    """Commit blocks of these statuses."""
    with Store.open(path, machine="m") as store:
        for number, status in enumerate(statuses, first):
            hashed = f"{path}{number}"
            store.commit(Record("s", number, f"in/b{number}", hashed, status=status, elapsed=float(number)), {})


def test_a_store_is_read_while_it_is_written_and_after_it_was_replaced(tmp_path: Path) -> None:
    path, reader = tmp_path / "state.db", StoreReader(tmp_path / "state.db")
    with pytest.raises(StoreError, match="no such file"):
        reader.rows("SELECT 1")
    fill(path, ["ok"] * 3)
    with Store.open(path, machine="m") as store, store.transaction() as connection:
        connection.execute("DELETE FROM records")
        assert reader.rows("SELECT count(*) FROM records") == [(3,)]
    assert reader.rows("SELECT count(*) FROM records") == [(0,)]
    for item in tmp_path.iterdir():
        item.rename(item.with_name(f"old-{item.name}"))
    fill(path, ["ok"])
    assert reader.rows("SELECT count(*) FROM records") == [(1,)]
    reader.close()


@pytest.mark.parametrize("content", [b"", b"words and no database", b"SQLite format 3\x00" + bytes(4000)])
def test_what_is_no_store_is_said(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "state.db").write_bytes(content)
    with pytest.raises(StoreError, match=r"state\.db: "):
        StoreReader(tmp_path / "state.db").rows("SELECT 1")


def test_the_database_of_another_program_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE meta (key TEXT, value TEXT)")
    connection.close()
    with pytest.raises(StoreError, match="is not a store"):
        StoreReader(path).rows("SELECT 1")


def test_a_query_that_takes_too_long_is_given_up(tmp_path: Path) -> None:
    fill(tmp_path / "state.db", ["ok"])
    reader = StoreReader(tmp_path / "state.db", max_loan_s=0.05)
    endless = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT count(*) FROM n"
    with pytest.raises(StoreError, match="takes too long"):
        reader.rows(endless)
    assert reader.rows("SELECT count(*) FROM blocks") == [(1,)]
    reader.close()


def test_many_threads_read_at_once(tmp_path: Path) -> None:
    fill(tmp_path / "state.db", ["ok"] * 20)
    reader = StoreReader(tmp_path / "state.db")
    with ThreadPoolExecutor(16) as threads:
        found = list(threads.map(lambda _: reader.rows("SELECT count(*) FROM blocks")[0][0], range(200)))
    assert found == [20] * 200
    reader.close()


@settings(max_examples=effort_count(quick=10, full=200))
@given(
    parts=st.lists(
        st.lists(st.sampled_from(["ok", "flat", "clipped", "unreadable", "nan"]), max_size=6), min_size=1, max_size=4
    )
)
def test_blocks_are_counted_once_however_they_come(
    parts: list[list[str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("s") / "state.db"
    fill(path, [])
    tally, done = LedgerTally(StoreReader(path)), 0
    for part in parts:
        fill(path, part, done + 1)
        done += len(part)
        while tally.update():
            pass
        with Store.open(path, read_only=True) as store:
            assert tally.counts() == store.counts()
    statuses = [status for part in parts for status in part]
    assert tally.by_source() == {("s", status): number for status, number in Counter(statuses).items()}
    others = [(block.sequence, block.status) for block in tally.others(1000)]
    assert others == [(place, status) for place, status in enumerate(statuses, 1) if status != "ok"][::-1]
    assert all(api.listed(block)["name"] == f"b{block.sequence}" for block in tally.others(1000))


def test_a_new_store_is_counted_anew(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    fill(path, ["ok", "flat"])
    tally = LedgerTally(StoreReader(path))
    assert not tally.update()
    for item in tmp_path.iterdir():
        item.rename(item.with_name(f"old-{item.name}"))
    fill(path, ["nan"])
    tally.update()
    assert tally.counts() == {"nan": 1}


@given(st.lists(st.floats(), max_size=50))
def test_numbers_for_json_are_close_and_never_nan(values: list[float]) -> None:
    found = numbers(np.array(values, dtype=float))
    assert [number is None for number in found] == [not np.isfinite(value) for value in values]
    for number, value in zip(found, values, strict=True):
        if number is not None:
            assert number == pytest.approx(value, rel=1e-6, abs=5e-324)
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/var/lib/x/state.db: is full", "state.db: is full"),
        ("cannot read '/a/b c/d.csv'", "cannot read 'b c/d.csv'"),
        ("no path here, 3 m/s2 and 1/2", "no path here, 3 m/s2 and 1/2"),
        ("folder:/srv/in", "folder:in"),
        ("http://x.example/a", "http://x.example/a"),
    ],
)
def test_sentences_lose_their_folders(text: str, expected: str) -> None:
    assert without_folders(text) == expected


@given(st.lists(st.from_regex(r"[a-z0-9._-]{1,8}", fullmatch=True), min_size=2, max_size=5))
def test_no_folder_is_left(parts: list[str]) -> None:
    path = "/" + "/".join(parts)
    assert without_folders(f"{path}: no such file") == f"{parts[-1]}: no such file"


def test_slow_answers_hold_up_no_other_and_are_not_too_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, go_on = make_machine(tmp_path), threading.Event()
    fill(tmp_path / "state" / "state.db", ["ok"])
    monkeypatch.setattr(api, "channel", lambda *_: {"late": go_on.wait(PATIENCE_S)})
    with page_of(config) as page:
        held = [_ask_and_leave(page) for _ in range(80)]
        try:
            assert page.ask("/readyz").status == 200
            assert page.ask("/api/session").status == 200
            wait_until(lambda: page.ask("/readyz").status == 200)
            reply = page.ask("/api/channels/m/x0")
            assert reply.status == 503
            assert "too much is asked" in reply.json["error"]
        finally:
            go_on.set()
        answers = Counter(_status(connection) for connection in held)
        assert set(answers) == {200, 503}
        assert answers[200] == 64
        wait_until(lambda: page.ask("/api/channels/m/x0").json == {"late": True})


def _ask_and_leave(page: Page) -> socket.socket:
    connection = page.dial()
    connection.sendall(b"GET /api/channels/m/x0 HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port)
    return connection


def _status(connection: socket.socket) -> int:
    with connection:
        return int(connection.recv(100).split()[1])


def test_a_stream_that_is_not_read_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.web.security._MAX_SEND_S", 0.3)
    monkeypatch.setattr("monitor.web.stream._HEARTBEAT_S", 0.0)
    config = make_machine(tmp_path)
    large = {"problems": {"s0": "x" * 4_000_000}, "channels": {}}
    with StatusFile.open(tmp_path / "state") as daemon, page_of(config) as page:
        daemon.write(large | {"up_s": 0})
        with socket.socket() as lazy:
            lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            lazy.connect(("127.0.0.1", page.port))
            lazy.sendall(b"GET /api/stream HTTP/1.1\r\nHost: localhost:%d\r\n\r\n" % page.port)
            wait_until(lambda: _streams(page) == 1.0)
            number = [0]

            def ended() -> bool:
                number[0] += 1
                daemon.write(large | {"up_s": number[0]})
                return _streams(page) == 0.0

            wait_until(ended, every=0.1)


def _streams(page: Page) -> float:
    text = page.ask("/metrics").body.decode()
    return next(float(line.split()[1]) for line in text.splitlines() if line.startswith("spallwatch_page_streams "))
