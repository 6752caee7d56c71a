"""Records over MQTT: keys with their units, each at least once in order, whatever the broker does, in nobody's way."""

from __future__ import annotations

import contextlib
import json
import random
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from monitor.config.outputs import RecordMqttSection
from monitor.health.record import Record
from monitor.records.condense import condense
from monitor.records.queries import StoredRecord
from monitor.records.store import Published, Store
from monitor.service.neighbours.points import channel_message, state_message
from monitor.service.record_mqtt import PLACE, RecordMqtt
from streams.types.block import STANDARD_GRAVITY
from tests.support.broker import Broker
from tests.support.effort import effort_count
from tests.support.proxy import Proxy
from tests.support.receivers import subscribed
from tests.support.waiting import join, wait_until

CHANNELS = {"s": ("x", "y")}


class Commits:
    """A store with blocks of two channels, numbered as they come."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.store = Store.open(folder / "state.db", machine="m")
        self.last = self.store.last("s")

    def add(self, number: int = 1, **more: Any) -> None:
        for _ in range(number):
            self.last += 1
            values = {name: {"rms": STANDARD_GRAVITY * self.last, "stage": "healthy"} for name in ("x", "y")}
            fields = {"time": 1.79e9 + self.last, "channels": values, **more}
            self.store.commit(Record("s", self.last, "b", str(self.last), **fields), {})


@pytest.fixture
def commits(tmp_path: Path) -> Iterator[Commits]:
    (tmp_path / "state").mkdir()
    commits = Commits(tmp_path / "state")
    yield commits
    commits.store.close()


@contextlib.contextmanager
def publishing(commits: Commits, port: int, **more: Any) -> Iterator[RecordMqtt]:
    section = RecordMqttSection(url=f"mqtt://127.0.0.1:{port}/plant/records", **more)
    records = RecordMqtt(section, "m", CHANNELS, commits.folder)
    try:
        yield records
    finally:
        records.close(5.0)


def blocks(heard: list[tuple[str, Any, bool]], channel: str = "x") -> list[int]:
    """The blocks of a channel, in the order in which they came."""
    return [body["block"] for topic, body, _ in heard if topic == f"plant/records/m/s/{channel}"]


@pytest.mark.broker
def test_each_record_is_published_with_its_units_and_kept_by_the_broker(tmp_path: Path, commits: Commits) -> None:
    commits.add(2)
    with Broker(tmp_path / "broker") as broker:
        with subscribed(broker.port, "plant/records/#") as heard, publishing(commits, broker.port) as records:
            commits.add()
            records.changed()
            wait_until(lambda: blocks(heard, "y"))
            commits.add(status="stopped", flags=("stopped",), reason="it stands still")
            commits.add(status="nan", channels={}, reason="not finite")
            records.changed()
            wait_until(lambda: len(blocks(heard, "y")) == 3)
        with subscribed(broker.port, "plant/records/m/s/x") as kept:
            wait_until(lambda: kept)
    # It begins where the store ended, and what the broker keeps is the newest.
    assert blocks(heard) == [3, 4, 5]
    assert [(body["block"], retained) for _, body, retained in kept] == [(5, True)]
    bodies = [body for topic, body, _ in heard if topic.endswith("/x")]
    assert bodies[0] | {"machine": "m", "source": "s", "channel": "x", "status": "ok"} == bodies[0]
    assert bodies[0]["rms_g"] == pytest.approx(3.0)
    assert bodies[0]["time_utc"] == "2026-09-21T14:13:23.000Z"
    assert (bodies[1]["flags"], bodies[1]["reason"]) == (["stopped"], "it stands still")
    assert (bodies[2]["status"], bodies[2]["rms_g"], bodies[2]["stage"]) == ("nan", None, None)
    assert bodies[0].keys() == bodies[2].keys()


@pytest.mark.broker
def test_what_was_committed_while_it_was_down_or_the_broker_away_comes_afterwards(
    tmp_path: Path, commits: Commits
) -> None:
    broker = Broker(tmp_path / "broker")
    with broker, publishing(commits, broker.port) as records:
        wait_until(lambda: records.problem is None)
    commits.add(3)
    # Nobody is there: nothing waits for it, and the problem is shown.
    with publishing(commits, broker.port) as records:
        commits.add(2)
        records.changed()
        wait_until(lambda: records.problem is not None and "refused" in records.problem)
        with broker, subscribed(broker.port, "plant/records/#") as heard:
            wait_until(lambda: blocks(heard) == [1, 2, 3, 4, 5])
            wait_until(lambda: records.problem is None)
            commits.add()
            records.changed()
            wait_until(lambda: blocks(heard)[-1] == 6)
    with broker, subscribed(broker.port, "plant/records/#") as heard, publishing(commits, broker.port) as records:
        commits.add()
        records.changed()
        wait_until(lambda: 7 in blocks(heard))
    # What the broker itself keeps came first, then what it had not confirmed before it ended, and what is new.
    assert set(blocks(heard)) <= {5, 6, 7}


@pytest.mark.broker
def test_where_records_left_the_store_before_they_were_sent_it_goes_on_with_the_oldest_there(
    tmp_path: Path, commits: Commits
) -> None:
    broker = Broker(tmp_path / "broker")
    commits.add(2)
    with broker, publishing(commits, broker.port) as records:
        wait_until(lambda: records.problem is None and (commits.folder / PLACE).exists())
    commits.add(198)
    commits.store.note_published(Published("m-20260921.nc", int(1.79e9 // 86400), 200, 1))
    assert condense(commits.store, 100.0, 1000) == 99
    with broker, subscribed(broker.port, "plant/records/#") as heard, publishing(commits, broker.port):
        wait_until(lambda: blocks(heard) == list(range(100, 201)))


@pytest.mark.broker
def test_connections_cut_at_any_moment_and_a_killed_broker_leave_nothing_out(
    tmp_path: Path, commits: Commits, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.service.broker._MIN_PAUSE_S", 0.05)
    generator = random.Random(20261121)
    broker, heard = Broker(tmp_path / "broker"), []
    with Proxy(broker.port) as proxy, publishing(commits, proxy.port, retain=False) as records:
        for _ in range(effort_count(quick=2, full=10)):
            # What is published before there is a subscriber is not delivered.
            with broker, subscribed(broker.port, "plant/records/m/s/#") as now:
                proxy.lets_through = True
                for _ in range(10):
                    for _ in range(generator.randint(1, 20)):
                        commits.add()
                        records.changed()
                    time.sleep(generator.uniform(0.0, 0.01))
                    proxy.cut(reset=generator.random() < 0.5)
                wait_until(lambda now=now: commits.last in blocks(now) and commits.last in blocks(now, "y"))
                proxy.lets_through = False
            heard += now
            # Killed, and more is committed meanwhile.
            commits.add(3)
        with broker, subscribed(broker.port, "plant/records/m/s/#") as now:
            proxy.lets_through = True
            wait_until(lambda: commits.last in blocks(now) and commits.last in blocks(now, "y"))
        heard += now
    for channel in ("x", "y"):
        found = blocks(heard, channel)
        assert set(found) == set(range(1, commits.last + 1))
        # In order, but for what is sent again from some place on.
        first = [number for index, number in enumerate(found) if number not in found[:index]]
        assert first == sorted(first)


@pytest.mark.broker
def test_a_process_that_dies_leaves_nothing_out(tmp_path: Path, commits: Commits) -> None:
    with Broker(tmp_path / "broker") as broker, subscribed(broker.port, "plant/records/m/s/x") as heard:
        with publishing(commits, broker.port, retain=False):
            pass
        kept = (commits.folder / PLACE).read_text()
        with publishing(commits, broker.port, retain=False) as records:
            commits.add(5)
            records.changed()
            wait_until(lambda: blocks(heard) == [1, 2, 3, 4, 5])
        # Killed before it could write how far it had come.
        (commits.folder / PLACE).write_text(kept)
        commits.add()
        with publishing(commits, broker.port, retain=False):
            wait_until(lambda: blocks(heard) == [1, 2, 3, 4, 5, 1, 2, 3, 4, 5, 6])
        # A damaged file does not publish a year once more.
        (commits.folder / PLACE).write_text("{")
        with publishing(commits, broker.port, retain=False) as records:
            commits.add()
            records.changed()
            wait_until(lambda: blocks(heard)[-1] == 7)
    assert blocks(heard).count(6) == 1


@pytest.mark.broker
def test_many_that_were_missed_come_at_a_bounded_rate(tmp_path: Path, commits: Commits) -> None:
    with Broker(tmp_path / "broker") as broker, subscribed(broker.port, "plant/records/m/s/x") as heard:
        with publishing(commits, broker.port):
            pass
        commits.add(150)
        began = time.monotonic()
        with publishing(commits, broker.port, most_per_s=100) as records:
            wait_until(lambda: len(blocks(heard)) == 150)
        # Two messages a block, a second's worth of them at once.
        assert time.monotonic() - began >= 1.8
    assert blocks(heard) == list(range(1, 151))
    assert records.problem is None


def test_a_broker_that_never_answers_holds_up_neither_commits_nor_the_end(commits: Commits) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        section = RecordMqttSection(url=f"mqtt://127.0.0.1:{server.getsockname()[1]}/plant/records")
        records = RecordMqtt(section, "m", CHANNELS, commits.folder)
        peer = server.accept()[0]
        commits.add(50)
        records.changed()
        records.close(0.05)
        # The end was not waited for: the thread is still waiting for an answer.
        thread = records._thread._thread
        assert thread is not None
        assert thread.is_alive()
        peer.close()
    join(thread)


@pytest.mark.broker
def test_how_the_machine_stands_is_said_when_it_changes_and_when_it_dies(tmp_path: Path, commits: Commits) -> None:
    status = commits.folder / "status.json"

    def say(state: str) -> None:
        values = {"status": "running", "state": state, "problems": {}, "channels": {"x": {"state": state, "n": 1}}}
        status.with_suffix(".tmp").write_text(json.dumps(values))
        status.with_suffix(".tmp").replace(status)

    with (
        Broker(tmp_path / "broker") as broker,
        Proxy(broker.port) as proxy,
        subscribed(broker.port, "plant/records/m/state") as heard,
    ):
        say("normal")
        with publishing(commits, proxy.port) as records:
            wait_until(lambda: len(heard) == 1)
            say("normal")
            commits.add()
            records.changed()
            say("failure")
            wait_until(lambda: len(heard) == 2)
            assert heard[1][1]["channels"] == {"x": "failure"}
            # Gone without a word: the broker says so.
            proxy.cut()
            wait_until(lambda: len(heard) == 4)
        wait_until(lambda: len(heard) == 5)
    assert [body["status"] for _, body, _ in heard] == ["running", "running", "unreachable", "running", "stopped"]
    assert [body["state"] for _, body, _ in heard] == ["normal", "failure", "no_data", "failure", "failure"]


@pytest.mark.broker
def test_that_it_stops_is_said_whenever_it_is_told_to(
    tmp_path: Path, commits: Commits, monkeypatch: pytest.MonkeyPatch
) -> None:
    (commits.folder / "status.json").write_text(json.dumps({"status": "running", "state": "normal", "problems": {}}))
    allowed = RecordMqtt._wait_allowed
    closers: list[threading.Thread] = []

    def close_meanwhile(records: RecordMqtt) -> float:
        # After the state of this round has been published, before it is seen whether to end.
        if not closers:
            closers.append(threading.Thread(target=records.close, args=(5.0,)))
            closers[0].start()
            wait_until(lambda: records._ending)
        return allowed(records)

    monkeypatch.setattr(RecordMqtt, "_wait_allowed", close_meanwhile)
    with Broker(tmp_path / "broker") as broker, subscribed(broker.port, "plant/records/m/state") as heard:
        with publishing(commits, broker.port):
            wait_until(lambda: bool(closers))
            join(closers[0])
        wait_until(lambda: len(heard) == 2)
    assert [body["status"] for _, body, _ in heard] == ["running", "stopped"]


def test_nothing_configured_starts_nothing(tmp_path: Path) -> None:
    records = RecordMqtt(None, "m", CHANNELS, tmp_path)
    records.changed()
    records.close()
    assert records.problem is None
    assert list(tmp_path.iterdir()) == []


def test_a_message_says_what_it_does_not_know() -> None:
    values = {
        "absolute_level": "no",
        "rms": 2.5,
        "h_or": (1.0, 2.0),
        "v_eq": 3e-8,
        "v_th": (5e-8, 9e-8),
        "tt": (3600.0, None),
        "tt_status": ("ok", "no_crossing"),
        "t_fs": 1.79e9,
        "fault": "inner|ball",
    }
    row = StoredRecord("m", "s", 7, "clipped", "clipped gap", "", 1.79e9, 5.0, {"x": values})
    found = json.loads(channel_message(row, "x"))
    # The unit of the sensor is not known, and that is said.
    assert (found["unit"], found["rms_g"], found["h_or_g"]) == ("unknown", 2.5, 1.0)
    assert found["v_eq_mm2"] == pytest.approx(0.03)
    assert (found["threshold_mm2"], found["tt_s"], found["tt_status"]) == (pytest.approx(0.05), 3600.0, "ok")
    assert (found["flags"], found["fault"], found["t_fs_utc"]) == (
        ["clipped", "gap"],
        "inner|ball",
        "2026-09-21T14:13:20.000Z",
    )
    undated = json.loads(channel_message(StoredRecord("m", "s", 7, "ok", "", "", None, 5.0, {"x": {"t_fs": 3.0}}), "x"))
    assert (undated["time_utc"], undated["t_fs_utc"], undated["elapsed_s"]) == (None, None, 5.0)
    assert json.loads(state_message("m", None))["status"] == "unreachable"
