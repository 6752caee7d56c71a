"""Telling of what the log has: in order, at least once, across restarts; retried, limited, and in nobody's way."""

from __future__ import annotations

import logging
import random
import sqlite3
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.config.notify import MqttSection, NotifySection, SmtpSection, WebhookSection
from monitor.health.record import Record
from monitor.records.events import Delivered, Deliveries, EventLog
from monitor.records.store import Store
from monitor.service.notify.channels import Message, NotifyError, configured_channels
from monitor.service.notify.message import Sender
from monitor.service.notify.notifier import Notifier
from tests.waiting import PATIENCE_S, wait_until

PRESS = Sender("press")
NOW = 1.79e9


def test_each_section_has_its_channel() -> None:
    sections = NotifySection(
        smtp=SmtpSection(host="mail", sender="a@b.example", to=("c@d.example",)),
        webhook=WebhookSection(url="http://127.0.0.1:1/hook"),
        mqtt=MqttSection(url="mqtt://127.0.0.1:1/alarms"),
    )
    assert [channel.name for channel in configured_channels(sections)] == ["smtp", "webhook", "mqtt"]
    assert configured_channels(NotifySection()) == []


class Recorder:
    """A way that keeps what it is given; it fails while ``failing``, and waits while ``go`` is clear."""

    def __init__(self, name: str = "way") -> None:
        self.name = name
        self.messages: list[Message] = []
        self.attempts = 0
        self.failing = False
        self.missing: str | None = None
        self.complaint: str | None = None
        self.go = threading.Event()
        self.go.set()

    def check(self) -> None:
        if self.missing is not None:
            raise NotifyError(self.missing)

    def send(self, message: Message) -> str | None:
        self.attempts += 1
        self.go.wait(PATIENCE_S)
        if self.failing:
            raise NotifyError("nobody answers")
        self.messages.append(message)
        return self.complaint

    @property
    def numbers(self) -> list[int]:
        """The blocks and notices told of, in order."""
        return [event["n"] for message in self.messages for event in message.values["events"]]


class Log:
    """A store with events numbered as they come."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "state.db"
        self.store = Store.open(self.path, machine="press")
        self.log = EventLog(self.path)
        self.sequence = self.last = 0

    def add(self, *kinds: str, time: float | None = NOW, **more: Any) -> None:
        """Commit a block with events."""
        self.sequence += 1
        events = []
        for kind in kinds:
            self.last += 1
            events.append({"kind": kind, "channel": "x", "n": self.last, **more})
        record = Record("s", self.sequence, "b", str(self.sequence), time=time, events=tuple(events))
        assert self.store.commit(record, {}) == "committed"

    def notice(self, kind: str = "no_data", utc: float = NOW) -> None:
        """Log what no block led to."""
        self.last += 1
        self.log.notice(utc, {"kind": kind, "n": self.last})

    def close(self) -> None:
        self.log.close()
        self.store.close()


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    log = Log(tmp_path)
    yield log
    log.close()


class Telling:
    """A notifier that is closed at the end of the block."""

    def __init__(self, log: Log, *ways: Recorder, **more: Any) -> None:
        section = NotifySection(**more.pop("limits", {}))
        self.notifier = Notifier(PRESS, ways, section, log.path, **{"first_pause": 0.05, "clock": lambda: NOW, **more})

    def __enter__(self) -> Notifier:
        return self.notifier

    def __exit__(self, *rest: object) -> None:
        self.notifier.close()


def test_a_new_way_begins_at_the_present_end(log: Log) -> None:
    log.add("final_stage")
    log.notice()
    way = Recorder()
    with Telling(log, way) as notifier:
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: way.messages)
        log.notice()
        notifier.wake()
        wait_until(lambda: len(way.messages) == 2)
    assert way.numbers == [3, 4]


def test_what_waited_at_the_end_is_told_after_the_next_start(log: Log) -> None:
    way = Recorder()
    way.failing = True
    with Telling(log, way) as notifier:
        log.add("alarm_raised", "final_stage")
        notifier.wake()
        wait_until(lambda: notifier.problems())
    assert way.messages == []
    log.add("end_of_life")
    log.notice()
    again = Recorder()
    with Telling(log, again):
        wait_until(lambda: again.messages)
    assert again.numbers == [1, 2, 3, 4]
    with Telling(log, Recorder()) as notifier:
        notifier.wake()
    assert again.numbers == [1, 2, 3, 4]


def test_what_was_sent_but_not_noted_is_sent_once_more(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    # A kill between sending and noting leaves the place behind.
    way = Recorder()
    with Telling(log, way) as notifier, monkeypatch.context() as patched:
        wait_until(lambda: places(log, "way") == [(0, 0)])
        patched.setattr(Deliveries, "save", lambda *_: None)
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: way.numbers == [1])
    with Telling(log, way):
        wait_until(lambda: way.numbers == [1, 1])


def places(log: Log, way: str) -> list[tuple[int, int]]:
    with Deliveries(log.path) as told:
        place = told.progress(way)
    return [] if place is None else [(place.event, place.notice)]


def test_each_way_has_its_own_place_and_one_that_fails_delays_no_other(
    log: Log, caplog: pytest.LogCaptureFixture
) -> None:
    bad, good = Recorder("bad"), Recorder("good")
    bad.failing = True
    with Telling(log, bad, good) as notifier, caplog.at_level(logging.ERROR):
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: good.numbers == [1])
        wait_until(lambda: bad.attempts > 2)
        assert notifier.problems() == {"notify.bad": "nobody answers"}
        log.add("alarm_cleared")
        notifier.wake()
        wait_until(lambda: good.numbers == [1, 2])
        bad.failing = False
        wait_until(lambda: bad.numbers == [1, 2] and not notifier.problems())
    # What waited has become one message, and the failure was logged once.
    assert len(bad.messages) == 1
    assert sum("tried again" in line for line in caplog.messages) == 1


def test_a_way_that_was_taken_out_begins_anew(log: Log) -> None:
    first, second = Recorder("first"), Recorder("second")
    with Telling(log, first, second):
        pass
    log.add("alarm_raised")
    with Telling(log, first):
        wait_until(lambda: first.numbers == [1])
    with Telling(log, first, second) as notifier:
        log.add("alarm_cleared")
        notifier.wake()
        wait_until(lambda: first.numbers == [1, 2] and second.numbers == [2])
    with Telling(log):
        pass
    assert places(log, "first") == []


def test_the_rate_limit_holds_across_restarts_and_leads_to_one_summary(log: Log) -> None:
    way, now = Recorder(), [1000.0]
    more: dict[str, Any] = {"limits": {"most_per_hour": 2}, "monotonic": lambda: now[0], "clock": lambda: NOW + now[0]}
    with Telling(log, way, **more) as notifier:
        for number in (1, 2):
            log.add("alarm_raised", severity="alert")
            notifier.wake()
            wait_until(lambda number=number: len(way.messages) == number)
        for number in range(3, 43):
            kind, severity = ("alarm_cleared", "alert") if number % 4 else ("alarm_raised", "danger")
            log.add(kind, severity=severity)
        notifier.wake()
    now[0] += 3000.0
    with Telling(log, way, **more):
        pass
    assert len(way.messages) == 2
    now[0] += 601.0
    with Telling(log, way, **more):
        wait_until(lambda: len(way.messages) == 3)
    summary = way.messages[2]
    assert summary.title.startswith("press: 40 events, worst: x: danger")
    assert summary.values["left_out"] == 20
    assert "and 20 events not listed here" in summary.text
    told = [event["n"] for event in summary.values["events"]]
    # The ten dangers are among those listed, in the order in which they came.
    assert told == sorted(told)
    assert set(range(4, 43, 4)) <= set(told)


def test_what_cannot_be_told_for_too_long_is_given_up_and_counted(log: Log, caplog: pytest.LogCaptureFixture) -> None:
    way, now = Recorder(), [0.0]
    way.failing = True
    more: dict[str, Any] = {"limits": {"give_up_hours": 1.0}, "clock": lambda: NOW + now[0]}
    with Telling(log, way, **more) as notifier, caplog.at_level(logging.ERROR):
        # Blocks of any age, and of none: it is the time since the event was found that counts.
        log.add("alarm_raised", time=NOW - 1e8)
        log.add("alarm_raised", time=None)
        log.notice(utc=NOW)
        notifier.wake()
        wait_until(lambda: way.attempts > 1)
        assert places(log, "way") == [(0, 0)]
    now[0] = 3700.0
    with Telling(log, way, **more):
        wait_until(lambda: places(log, "way") == [(2, 1)])
    log.add("end_of_life")
    way.failing = False
    with Telling(log, way, **more):
        wait_until(lambda: way.messages)
    assert way.numbers == [4]
    assert way.messages[0].values["left_out"] == 3
    assert any("given up after 1 h: 3 events" in line for line in caplog.messages)


def test_all_that_was_given_up_is_said_even_if_nothing_is_left(log: Log) -> None:
    way = Recorder()
    with Deliveries(log.path) as told:
        told.begin(["way"], NOW)
        told.save("way", Delivered(left_out=1))
    with Telling(log, way):
        wait_until(lambda: way.messages)
    assert way.messages[0].title == "press: 1 event not delivered in time"


def test_a_clock_that_was_never_set_makes_nothing_old(log: Log) -> None:
    way, utc = Recorder(), [100.0]
    way.failing = True
    with Telling(log, way, clock=lambda: utc[0]) as notifier:
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: way.attempts > 1)
        utc[0] = NOW
        wait_until(lambda: way.attempts > 3)
    with Telling(log, way, clock=lambda: utc[0]):
        wait_until(lambda: way.attempts > 5)
        way.failing = False
        wait_until(lambda: way.numbers == [1])


def test_a_store_made_anew_goes_on_from_its_end_and_a_salvage_is_told(tmp_path: Path) -> None:
    log = Log(tmp_path)
    way, new = Recorder("way"), Recorder("new")
    with Deliveries(log.path) as told:
        told.begin(["way"], NOW)
        told.save("way", Delivered(700, 30))
    log.add("alarm_raised")
    log.notice("store_salvaged", utc=NOW)
    with Telling(log, way, new, clock=lambda: NOW + 60.0) as notifier:
        wait_until(lambda: new.numbers == [2])
        log.add("alarm_cleared")
        notifier.wake()
        wait_until(lambda: way.numbers == [3] and new.numbers == [2, 3])
    log.close()


def test_a_way_that_is_broken_does_not_end_its_thread(log: Log, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Recorder):
        def send(self, message: Message) -> str | None:
            if not self.attempts:
                self.attempts += 1
                raise RuntimeError("a fault")
            return super().send(message)

    way = Broken()
    with Telling(log, way) as notifier:
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: way.numbers == [1])
    assert "notification by way fails" in caplog.text


def test_what_is_missing_is_a_problem_before_the_first_alarm(log: Log) -> None:
    way = Recorder()
    way.missing = "password cannot be read"
    with Telling(log, way) as notifier:
        wait_until(lambda: notifier.problems() == {"notify.way": "password cannot be read"})
        way.missing = None
        wait_until(lambda: not notifier.problems())
    assert way.attempts == 0


def test_what_was_delivered_with_a_complaint_is_not_delivered_again(log: Log) -> None:
    way = Recorder()
    way.complaint = "refused for ben"
    with Telling(log, way) as notifier:
        for number in (1, 2):
            log.add("alarm_raised")
            notifier.wake()
            wait_until(lambda number=number: len(way.messages) == number)
            wait_until(lambda: notifier.problems() == {"notify.way": "refused for ben"})
        way.complaint = None
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: not notifier.problems())
    assert way.numbers == [1, 2, 3]


def test_telling_holds_up_no_commit_and_no_commit_holds_up_telling(log: Log) -> None:
    way = Recorder()
    # Whoever commits does not wait at all: any lock in its way would be an error.
    log.store._connection.execute("PRAGMA busy_timeout = 0")
    with Telling(log, way, limits={"most_per_hour": 3600}) as notifier:
        way.go.clear()
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: way.attempts == 1)
        for _ in range(50):
            log.add("condition")
        with log.store.transaction() as connection:
            # And while a commit takes its time, the message goes out all the same.
            connection.execute("INSERT OR REPLACE INTO meta VALUES ('x', 'y')")
            way.go.set()
            wait_until(lambda: way.numbers == [1])
        notifier.wake()
        wait_until(lambda: len(way.messages) == 2)
    assert (len(way.messages[1].values["events"]), way.messages[1].values["left_out"]) == (20, 30)


def test_writing_places_beside_a_busy_writer_costs_no_commit(log: Log) -> None:
    done = threading.Event()

    def move() -> None:
        with Deliveries(log.path) as told:
            number = 0
            while not done.is_set():
                number += 1
                told.mark_found(float(number))
                told.save("way", Delivered(number))

    threads = [threading.Thread(target=move) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(300):
            log.add("condition")
    finally:
        done.set()
        for thread in threads:
            thread.join()
    assert log.store.check() == []
    assert len(log.store.events()) == 300


def test_a_log_that_cannot_be_opened_is_a_problem_and_is_tried_again(log: Log, tmp_path: Path) -> None:
    way = Recorder()
    away = tmp_path / "away.db"
    missing = Notifier(PRESS, [way], NotifySection(), away, first_pause=0.05)
    wait_until(lambda: "away.db" in missing.problems().get("notify.way", ""))
    with sqlite3.connect(log.path) as source, sqlite3.connect(away) as target:
        source.backup(target)
    source.close()
    target.close()
    wait_until(lambda: not missing.problems())
    missing.close()
    assert way.messages == []


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_whatever_happens_each_event_is_told_in_order_at_least_once(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    generator = random.Random(seed)
    log, way = Log(tmp_path_factory.mktemp("log")), Recorder()
    expected: list[int] = []
    kinds = ("alarm_raised", "alarm_cleared", "alarm_released", "final_stage")
    with Deliveries(log.path) as told:
        told.begin(["way"], NOW)
    limits = {"most_per_hour": 3600, "queue_events": generator.choice((1, 3, 50))}
    for _ in range(generator.randint(1, 4)):
        with Telling(log, way, limits=limits, first_pause=0.001) as notifier:
            for _ in range(generator.randint(0, 8)):
                way.failing = generator.random() < 0.3
                if generator.random() < 0.3:
                    log.notice()
                    expected.append(log.last)
                else:
                    kind = generator.choice(kinds)
                    log.add(kind)
                    expected += [log.last] if kind != "alarm_released" else []
                notifier.wake()
                if generator.random() < 0.5:
                    time.sleep(0.002)
    way.failing = False
    with Telling(log, way, limits=limits, first_pause=0.001):
        wait_until(lambda: set(way.numbers) == set(expected))
    log.close()
    told = [event for message in way.messages for event in message.values["events"]]
    for notices in (False, True):
        numbers = [event["n"] for event in told if (event["kind"] == "no_data") == notices]
        # No message failed after it was sent, so that none was sent twice.
        assert numbers == sorted(set(numbers))
