"""The event log: nothing is lost or changed, and an acknowledgement says who, when and why."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.store import Store


def record(sequence: int, *kinds: str) -> Record:
    events = tuple({"kind": kind, "channel": "x", "rule": "rms", "block": sequence} for kind in kinds)
    return Record(source="s", sequence=sequence, name="n", content_hash=str(sequence), time=1.7e9, events=events)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "state.db"
    with Store.open(path, machine="m") as store:
        store.commit_many([(record(1, "alarm_raised"), {}), (record(2, "alarm_cleared", "final_stage"), {})])
    return path


def test_events_are_followed_oldest_first(path: Path) -> None:
    with EventLog(path) as log:
        assert [event.body["kind"] for _, event in log.events()] == ["alarm_raised", "alarm_cleared", "final_stage"]
        assert [event.block for _, event in log.events(limit=1)] == [1]
        assert [event.id for _, event in log.events(limit=1)] == ["1"]
        assert [number for number, _ in log.events(1)] == [2, 3]


def test_an_acknowledgement_says_who_and_when_and_survives(path: Path) -> None:
    with EventLog(path) as log:
        assert log.unacknowledged() == 2
        assert log.acknowledge("1", " Anna ", "looked at it", 5.0).open is False
        log.acknowledge("1", "Ben", "", 6.0)
        assert log.unacknowledged() == 1
    with EventLog(path) as log:
        event = log.event("1")
        assert event is not None
        assert [(item.who, item.utc, item.note) for item in event.acknowledgements] == [
            ("Anna", 5.0, "looked at it"),
            ("Ben", 6.0, ""),
        ]
        assert [(*known[:2], known[2].body["rule"], known[2].block) for known in log.acknowledged_alarms()] == [
            (1, 5.0, "rms", 1),
            (2, 6.0, "rms", 1),
        ]
        assert [number for number, _, _ in log.acknowledged_alarms(1)] == [2]


@pytest.mark.parametrize("name", ["9", "n1", "", "n", "1; DROP TABLE events", "²", "9" * 40])
def test_what_is_not_there_cannot_be_acknowledged(path: Path, name: str) -> None:
    with EventLog(path) as log, pytest.raises(ValueError, match="there is no event"):
        log.acknowledge(name, "Anna", "", 1.0)


@pytest.mark.parametrize(("who", "note"), [("", "x"), ("  ", ""), ("a" * 101, ""), ("a", "b" * 2001)])
def test_names_and_notes_have_limits(path: Path, who: str, note: str) -> None:
    with EventLog(path) as log, pytest.raises(ValueError, match="characters"):
        log.acknowledge("1", who, note, 1.0)


def test_a_notice_needs_no_block_and_leaves_the_records_alone(path: Path) -> None:
    with Store.open(path, machine="m") as store:
        before = list(store.records())
        with EventLog(path) as log:
            name = log.notice(7.0, {"kind": "no_data", "channel": "x"})
            assert log.unacknowledged() == 3
            log.acknowledge(name, "Anna", "", 8.0)
            assert log.unacknowledged() == 2
            assert [event.utc for _, event in log.notices()] == [7.0]
        assert list(store.records()) == before


def test_acknowledging_from_other_threads_beside_the_writer_loses_nothing(path: Path) -> None:
    with Store.open(path, machine="m") as store, EventLog(path) as log:
        threads = [threading.Thread(target=lambda n=n: log.acknowledge("1", f"p{n}", "", float(n))) for n in range(8)]
        for thread in threads:
            thread.start()
        for sequence in range(3, 20):
            store.commit(record(sequence), {})
        for thread in threads:
            thread.join()
        event = log.event("1")
        assert event is not None
        assert {item.who for item in event.acknowledgements} == {f"p{n}" for n in range(8)}


def test_a_store_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match=r"none\.db"):
        EventLog(tmp_path / "none.db")
