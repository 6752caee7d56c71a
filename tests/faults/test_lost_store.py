"""A store that is lost, or older than the published records, is made again from them, and the monitor goes on."""

from __future__ import annotations

import json
import random
import shutil
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

from monitor.health.onset import DetectSettings
from monitor.health.record import Record
from monitor.health.state import SourceSettings, Stored
from monitor.pipeline import resumed_state
from monitor.records.events import EventLog
from monitor.records.ledger import StoreLedger, write_progress
from monitor.records.publish import publish
from monitor.records.published_folder import snapshot_path
from monitor.records.recover import published
from monitor.records.recover.salvage import SalvageReport, open_or_salvage
from monitor.records.store import Store
from reference.steps import Steps
from streams.types.block import Block, Rejected
from streams.types.source import FileProgress
from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import make_machine, start, status
from tests.support.effort import effort_count
from tests.support.forks import Fork
from tests.support.ingest import settings_of
from tests.support.lost_store import blocks_of
from tests.support.victims import salvage
from tests.support.waiting import stop, wait_until

pytestmark = pytest.mark.process

PUBLISHED, KEPT, TOTAL = 100, 60, 120
"""Blocks in the published files, in a database without its write-ahead log, and of the undisturbed run."""
START = 1.7e9 + 3400.0
KILLS = effort_count(quick=2, full=200)


def settings() -> SourceSettings:
    found = settings_of()
    detect = DetectSettings(learn_blocks=30, run_in_blocks=10, persist_blocks=3)
    channels = {name: replace(channel, detect=detect) for name, channel in found.channels.items()}
    return replace(found, channels=channels)


def item(number: int) -> Block | Rejected:
    if number % 17 == 0:
        return Rejected("s", number, f"b{number}", "unreadable", "words", f"{number:08x}")
    level = 1.0 if number < 80 else 1.0 + 0.1 * (number - 79)
    samples = level * np.random.default_rng(number).normal(size=(1, 256))
    begin = START + 60.0 * number
    return Block(samples, 2560.0, ("x",), ("g",), "s", number, f"b{number}", begin, content_hash=f"{number:08x}")


class Life(NamedTuple):
    """Records of an undisturbed run, and the states after each."""

    records: list[Record]
    states: list[Stored]


def values_of(record: Record) -> dict[str, dict[str, object]]:
    """Return the values that are there; a variable without a value may also be left out."""
    return {name: {k: v for k, v in x.items() if v is not None} for name, x in record.channels.items()}


def as_json(states: Stored) -> Stored:
    return json.loads(json.dumps(states))


def progress(number: int) -> FileProgress:
    return FileProgress(f"b{number}", 100, 1, number, "h", f"{number:08x}", 100, 10, "accepted")


def commit(store: Store, record: Record, states: Stored) -> None:
    files = [progress(record.sequence)]
    assert store.commit(record, states, lambda to: write_progress(to, "s", files)) == "committed"


@pytest.fixture(scope="module")
def life() -> Life:
    steps = Steps(settings())
    found = Life([], [])
    for number in range(1, TOTAL + 1):
        found.records.append(steps.take(item(number)))
        found.states.append(steps.stored())
    return found


@pytest.fixture(scope="module")
def template(life: Life, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders state and records of a process that ended here, with the latest commits in its log only."""
    folder = tmp_path_factory.mktemp("machine")
    made = folder / "made"
    with Store.open(made / "state.db", machine="m") as store, StoreLedger(store), EventLog(store.path) as log:
        store.describe({"config_hash": "c1"})
        for record, states in zip(life.records[:KEPT], life.states, strict=False):
            commit(store, record, states)
        with closing(sqlite3.connect(store.path)) as other:
            other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        for record, states in zip(life.records[KEPT:PUBLISHED], life.states[KEPT:], strict=False):
            commit(store, record, states)
        log.notice(1.8e9, {"kind": "no_data", "channel": "x"})
        log.acknowledge("n1", "operator", "seen", 1.8e9)
        assert len(publish(store, folder / "records")) == 2
        (folder / "state").mkdir()
        for suffix in ("", "-wal"):
            shutil.copyfile(f"{store.path}{suffix}", folder / "state" / f"state.db{suffix}")
    shutil.rmtree(made)
    return folder


@pytest.fixture
def machine(template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The database of such a machine; the published files are read in this process, which is faster."""
    monkeypatch.setattr(published, "_in_child", lambda scratch, files, beat: published.take_files(scratch, files))
    shutil.copytree(template, tmp_path, dirs_exist_ok=True)
    return tmp_path / "state" / "state.db"


def lose_all(path: Path) -> None:
    for file in path.parent.iterdir():
        file.unlink()


def lose_database(path: Path) -> None:
    path.unlink()


def lose_log(path: Path) -> None:
    Path(f"{path}-wal").unlink()


def truncate(path: Path) -> None:
    path.write_bytes(b"?")


def truncate_without_log(path: Path) -> None:
    truncate(path)
    lose_log(path)


def empty(path: Path) -> None:
    path.write_bytes(b"")
    lose_log(path)


def lose_tables(path: Path) -> None:
    """Leave what a writer leaves that was killed before it made its tables."""
    lose_all(path)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
    assert path.stat().st_size >= 4096


def lose_snapshot_too(path: Path) -> None:
    lose_all(path)
    snapshot_path(path.parents[1] / "records", "m").unlink()


def damage_snapshot_too(path: Path) -> None:
    lose_all(path)
    snapshot = snapshot_path(path.parents[1] / "records", "m")
    snapshot.write_text(snapshot.read_text().replace('"seen', '"seem'))


def opened(path: Path) -> tuple[Store, SalvageReport | None]:
    return open_or_salvage(path, machine="m", records_dir=path.parents[1] / "records")


LOSSES = (
    *(lose_all, lose_database, lose_log, lose_tables, truncate, truncate_without_log, empty),
    *(lose_snapshot_too, damage_snapshot_too),
)


@pytest.mark.parametrize("lose", LOSSES)
def test_a_lost_store_is_made_again_and_the_monitor_goes_on_as_if_nothing_were_lost(
    machine: Path, life: Life, lose: Callable[[Path], None]
) -> None:
    lose(machine)
    store, report = opened(machine)
    with store, StoreLedger(store) as ledger:
        assert report is not None
        assert report.lost == report.unchecked == 0
        assert list(store.records()) == life.records[:PUBLISHED]
        assert store.check() == []
        # What a sender is answered, and what a folder knows of its files.
        assert ledger.committed("s") == PUBLISHED
        assert ledger.file_counts("s") == {"accepted": PUBLISHED}
        assert ledger.file("s", "b90") == progress(90)
        state = resumed_state(store, settings())
        assert state.to_stored() == life.states[PUBLISHED - 1]
        assert store.load_states() == as_json(life.states[PUBLISHED - 1])
        steps = Steps(settings(), state.to_stored(), state.latest)
        for number in range(PUBLISHED + 1, TOTAL + 1):
            commit(store, steps.take(item(number)), steps.stored())
        assert list(store.records()) == life.records
        publish(store, machine.parents[1] / "records")
        assert blocks_of(machine.parents[1] / "records") == TOTAL
    assert not list((machine.parents[1] / "records").glob("*.lost-*"))
    again, second = opened(machine)
    again.close()
    assert second is None


@pytest.mark.parametrize("lose", [lose_all, lose_log])
def test_the_log_says_it_and_keeps_what_it_had(machine: Path, lose: Callable[[Path], None]) -> None:
    lose(machine)
    store, report = opened(machine)
    store.close()
    assert report is not None
    assert report.restored == (PUBLISHED if lose is lose_all else PUBLISHED - KEPT)
    with EventLog(machine) as log:
        (_, before), (_, notice) = log.notices()
    assert before.body["kind"] == "no_data"
    assert [given.note for given in before.acknowledgements] == ["seen"]
    assert notice.body["kind"] == "store_salvaged"
    assert notice.open
    assert notice.body["restored"] == report.restored
    assert "from the published files" in report.text


def test_a_store_that_is_no_older_than_its_files_is_left_alone(machine: Path) -> None:
    before = {path.name for path in machine.parent.iterdir()}
    store, report = opened(machine)
    with store:
        assert report is None
        assert store.last("s") == PUBLISHED
    assert {path.name for path in machine.parent.iterdir()} <= before | {"state.db.lock", "state.db-shm"}


def test_a_file_is_never_replaced_by_one_with_fewer_blocks(machine: Path, life: Life) -> None:
    lose_all(machine)
    records = machine.parents[1] / "records"
    with Store.open(machine, machine="m") as store, StoreLedger(store):
        for record, states in zip(life.records[:3], life.states, strict=False):
            commit(store, record, states)
        publish(store, records)
        kept = {path.name: path for path in records.glob("*.lost-*")}
        assert len(kept) == 1
        with xr.open_dataset(next(iter(kept.values()))) as dataset:
            assert dataset.sizes["time"] > 3
        with EventLog(machine) as log:
            ((_, notice),) = log.notices()
        assert notice.body["kind"] == "records_kept"
        assert next(iter(kept)) in notice.body["text"]
        # It is said once, and readers do not take it twice.
        commit(store, life.records[3], life.states[3])
        publish(store, records)
        assert len(list(records.glob("*.lost-*"))) == 1
    assert sum(path.suffix == ".nc" for path in records.iterdir()) == 2


def test_a_file_that_cannot_be_read_is_kept_and_said(machine: Path, life: Life) -> None:
    records = machine.parents[1] / "records"
    damaged = min(records.glob("m-*.nc"))
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[: len(whole) // 2])
    lose_all(machine)
    store, report = opened(machine)
    with store:
        assert report is not None
        assert report.unreadable == (damaged.name,)
        assert 0 < report.saved < PUBLISHED
        assert report.saved + report.lost == PUBLISHED
        assert {record.sequence for record in store.records()} < set(range(1, PUBLISHED + 1))
        publish(store, records)
    # Nothing of it is in the store, so that it stays as it is.
    assert damaged.read_bytes() == whole[: len(whole) // 2]


def test_a_row_that_is_not_as_it_was_committed_is_not_taken(machine: Path) -> None:
    lose_all(machine)
    path = min((machine.parents[1] / "records").glob("m-*.nc"))
    with xr.open_dataset(path) as dataset:
        value = float(dataset.rms.values[5, 0])
    data = path.read_bytes()
    place = data.find(np.float64(value).tobytes())
    assert place > 0
    path.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
    store, report = opened(machine)
    with store:
        assert report is not None
        assert report.lost == 1
        assert store.record("s", 6) is None


def test_files_of_older_versions_give_their_values_and_count_as_unproven(machine: Path, life: Life) -> None:
    for path in (machine.parents[1] / "records").glob("m-*.nc"):
        with xr.open_dataset(path, decode_cf=False) as dataset:
            dataset.load()
        path.unlink()
        dataset.to_netcdf(path)
    lose_snapshot_too(machine)
    store, report = opened(machine)
    with store:
        assert report is not None
        assert (report.saved, report.unchecked, report.lost) == (PUBLISHED, PUBLISHED, 0)
        for found, expected in zip(store.records(), life.records, strict=False):
            assert replace(found, channels=values_of(found)) == replace(expected, channels=values_of(expected))
        assert resumed_state(store, settings()).to_stored() == life.states[PUBLISHED - 1]


@pytest.mark.timeout(effort_count(quick=900, full=7200))
def test_killed_while_it_is_made_again_each_block_is_there_once(template: Path, tmp_path: Path, life: Life) -> None:
    generator = random.Random(20261122)
    seconds = 2.0
    for number in range(KILLS):
        folder = tmp_path / str(number)
        shutil.copytree(template, folder)
        path = folder / "state" / "state.db"
        generator.choice([lose_all, lose_log, truncate])(path)
        child = Fork(salvage, path, folder / "records")
        child.receive()
        began, until = time.monotonic(), time.monotonic() + generator.uniform(0.0, seconds)
        while child.alive and time.monotonic() < until:
            time.sleep(0.01)
        if not child.alive:
            seconds = max(0.3, time.monotonic() - began)
        child.kill()
        store, _ = opened(path)
        with store:
            assert list(store.records()) == life.records[:PUBLISHED]
            assert store.load_states() == as_json(life.states[PUBLISHED - 1])
            assert store.check() == []
        assert not [name for name in path.parent.iterdir() if "salvag" in name.name or "published" in name.name]
        shutil.rmtree(folder)


def test_a_daemon_whose_store_is_deleted_takes_no_file_twice_and_says_it(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    for number in range(8):
        (tmp_path / "in0" / f"f{number:05d}.csv").write_bytes(csv_bytes(noise(512, number)))
    daemon = start(config, "--quiet")
    wait_until(lambda: status(config).get("blocks") == 16)
    # The last publication is given three seconds at the stop, which a busy machine may not keep.
    wait_until(lambda: blocks_of(tmp_path / "records") == 16, every=0.1)
    stop(daemon)
    for path in (tmp_path / "state").glob("state.db*"):
        path.unlink()
    daemon = start(config, "--quiet")
    (tmp_path / "in0" / "f00008.csv").write_bytes(csv_bytes(noise(512, 8)))
    wait_until(lambda: status(config).get("pid") == daemon.pid and status(config)["blocks"] >= 2)
    wait_until(lambda: status(config)["sources"]["s0"]["pending"] == 0)
    wait_until(lambda: blocks_of(tmp_path / "records") == 18, every=0.1)
    now = status(config)
    said = stop(daemon)
    assert daemon.returncode == 0, said
    assert now["sources"]["s0"]["accepted"] == 9
    assert "16 of them from the published files" in now["recovered"]
    assert now["unacknowledged"] == 1
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert [record.sequence for record in store.records()] == list(range(1, 19))
        assert store.counts() == {"ok": 18}
    assert blocks_of(tmp_path / "records") == 18
