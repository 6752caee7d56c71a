from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records.database import STORE_VERSION, StoreError
from monitor.records.store import Store
from streams.types.listing import file_system_type
from tests.oracles.records_oracle import records
from tests.support.effort import effort_count


def block(sequence: int, content: str = "h", source: str = "s", **fields: Any) -> Record:
    values = {"x": {"rms": sequence / 3.0, "stage": "learning"}}
    return Record(
        **{"source": source, "sequence": sequence, "name": f"b{sequence}", "content_hash": content, "channels": values}
        | fields
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "state" / "state.db"


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    with Store.open(path, machine="m") as opened:
        opened.describe({"config_hash": "c1"})
        yield opened


def test_a_committed_block_is_there_after_reopening_with_its_states(path: Path) -> None:
    state = {"value": 0.1 + 0.2, "seen": [1, 2], "none": None}
    with Store.open(path, machine="m") as store:
        assert store.commit(block(1), {"detect:x": state}) == "committed"
        assert store.commit(block(2), {"detect:x": {**state, "seen": []}}) == "committed"
    with Store.open(path, machine="m") as store:
        assert list(store.records()) == [block(1), block(2)]
        assert store.load_states() == {"detect:x": {**state, "seen": []}}
        assert store.last("s") == 2
        assert store.last("other") == 0
        assert store.record("s", 2) == block(2)
        assert store.record("s", 3) is None
        assert store.check() == []


@given(st.lists(records(bands=2), max_size=4, unique_by=lambda record: record.sequence))
@settings(max_examples=effort_count(quick=6, full=500))
def test_records_come_back_bit_for_bit(tmp_path_factory: pytest.TempPathFactory, made: list[Record]) -> None:
    with Store.open(tmp_path_factory.mktemp("store") / "state.db", machine="m") as store:
        assert store.commit_many([(record, {}) for record in made]) == ["committed"] * len(made)
        assert list(store.records()) == made
        assert [record.to_json() for record in store.records()] == [record.to_json() for record in made]


def test_the_same_block_again_is_not_counted_twice_and_another_in_its_place_changes_nothing(store: Store) -> None:
    assert store.commit(block(1), {"a": {"n": 1}}) == "committed"
    assert store.commit(block(1), {"a": {"n": 2}}) == "duplicate"
    assert store.commit(block(1, content="other", status="nan"), {"a": {"n": 3}}) == "changed"
    assert store.commit(block(1, source="t"), {}) == "committed"
    assert list(store.records()) == [block(1), block(1, source="t")]
    assert store.load_states() == {"a": {"n": 1}}
    assert store.counts() == {"ok": 2, "duplicate": 1, "changed": 1}


def test_a_run_that_was_rolled_back_is_described_again(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with Store.open(path, machine="m") as store:
        with monkeypatch.context() as patched:
            full = sqlite3.OperationalError("database or disk is full")
            patched.setattr(store._presence, "check", Mock(side_effect=full))
            with pytest.raises(StoreError, match="disk is full"):
                store.commit(block(1), {})
        assert store.commit(block(1), {}) == "committed"
        assert list(store.records()) == [block(1)]


def test_offered_is_the_sum_of_what_was_counted(store: Store) -> None:
    offered = [
        block(1),
        block(2, status="nan", channels={}),
        block(3, flags=("gap",), status="gap"),
        block(2),
        block(4),
    ]
    outcomes = store.commit_many([(record, {}) for record in offered])
    assert outcomes == ["committed", "committed", "committed", "duplicate", "committed"]
    assert sum(store.counts().values()) == len(offered)
    assert store.counts() == {"ok": 2, "nan": 1, "gap": 1, "duplicate": 1}


def test_a_batch_that_fails_leaves_nothing_behind(store: Store) -> None:
    store.commit(block(1), {"a": {"n": 1}})
    new_layout = block(2, channels={"z": {"mean": 1.0}})
    with pytest.raises(StoreError, match="state of stage 'a'"):
        store.commit_many([(new_layout, {"a": {"n": float("nan")}})])
    assert list(store.records()) == [block(1)]
    assert store.load_states() == {"a": {"n": 1}}
    # The layout that went with the failed batch is known under no stale number.
    assert store.commit(new_layout, {}) == "committed"
    assert list(store.records()) == [block(1), new_layout]


def test_a_full_disk_is_a_store_error_and_the_store_goes_on_afterwards(store: Store) -> None:
    store.commit(block(1), {})
    pages = store.rows("PRAGMA page_count")[0][0]
    store.rows(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(StoreError, match=r"state\.db: database or disk is full"):
        store.commit_many([(block(number, name="n" * 500), {}) for number in range(2, 40)])
    store.rows("PRAGMA max_page_count = 1000000")
    assert store.last("s") == 1
    assert store.commit(block(2), {}) == "committed"
    assert store.check() == []


def test_forecasts_and_events_have_their_tables(store: Store) -> None:
    event = {"kind": "t_fs_known", "channel": "x"}
    record = block(7, forecasts=({"tt": 5.0, "status": "ok"}, {"tt": None, "status": "concave"}), events=(event,))
    store.commit(record, {})
    assert store.events() == [{"source": "s", "block": 7, **event}]
    assert store.rows("SELECT count(*) FROM forecasts")[0][0] == 2
    assert list(store.records()) == [record]


def test_a_reader_sees_what_is_committed_and_cannot_write(store: Store, path: Path) -> None:
    store.commit(block(1), {})
    with Store.open(path, read_only=True) as reader:
        assert reader.machine == "m"
        store.commit(block(2), {})
        assert reader.last("s") == 2
        with pytest.raises(StoreError, match="reading only"):
            reader.commit(block(3), {})


@pytest.mark.usefixtures("refused_at_once")
def test_a_second_writer_is_kept_out_until_the_first_is_gone(store: Store, path: Path) -> None:
    with pytest.raises(StoreError, match="another process is writing"):
        Store.open(path, machine="m")
    store.close()
    Store.open(path, machine="m").close()


def test_another_machine_is_refused(store: Store, path: Path) -> None:
    store.close()
    with pytest.raises(StoreError, match="belongs to machine 'm', not to 'n'"):
        Store.open(path, machine="n")
    Store.open(path, machine="m").close()


def test_meta_tells_versions_and_the_latest_run(store: Store) -> None:
    store.describe({"config_hash": "c2"})
    meta = store.meta()
    assert meta["schema_version"] == str(STORE_VERSION)
    assert meta["config_hash"] == "c2"
    assert meta["machine"] == "m"
    assert meta["software_version"]
    store.describe({"config_hash": "c2"})
    assert store.rows("SELECT count(*) FROM runs")[0][0] == 2


def test_a_newer_schema_is_refused(store: Store, path: Path) -> None:
    store.close()
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE meta SET value = '99' WHERE key = 'schema_version'")
    connection.close()
    with pytest.raises(StoreError, match=rf"state\.db: was written with schema version 99; .* up to {STORE_VERSION}"):
        Store.open(path, machine="m")


def test_files_that_are_no_store_are_refused(tmp_path: Path) -> None:
    other = tmp_path / "other.db"
    connection = sqlite3.connect(other)
    connection.execute("CREATE TABLE t (x)")
    connection.close()
    text = tmp_path / "text.db"
    text.write_text("these are not the records")
    empty = tmp_path / "empty.db"
    empty.touch()
    damaged = tmp_path / "damaged.db"
    damaged.write_bytes(b"SQLite format 3\x00" + b"\xff" * 5000)
    for path, message in (
        (other, "database of another program"),
        (text, "is not a database"),
        (damaged, "not a database|malformed"),
        (tmp_path, "is a folder"),
    ):
        with pytest.raises(StoreError, match=message) as caught:
            Store.open(path, machine="m")
        assert str(path) in str(caught.value)
    with pytest.raises(StoreError, match="no such file"):
        Store.open(tmp_path / "none.db", machine="m", create=False)
    with pytest.raises(StoreError, match="is empty"):
        Store.open(empty, machine="m", create=False)
    with pytest.raises(StoreError, match="needs the name of its machine"):
        Store.open(tmp_path / "none.db")
    assert text.read_text() == "these are not the records"


def test_a_network_file_system_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.records.database.file_system_type", lambda folder: "nfs4")
    with pytest.raises(StoreError, match=r"network file system \(nfs4\)"):
        Store.open(path, machine="m")


def test_the_file_system_is_found_in_the_mount_table(tmp_path: Path) -> None:
    device = tmp_path.stat().st_dev
    mine = f"{os.major(device)}:{os.minor(device)}"
    table = (
        f"21 1 0:99 / /a rw - tmpfs none rw\n36 35 {mine} / /mnt rw,noatime shared:1 - cifs //server/share rw\nbad\n"
    )
    assert file_system_type(tmp_path, table) == "cifs"
    assert file_system_type(tmp_path, "21 1 0:0 / /a rw - tmpfs none rw\n") is None
