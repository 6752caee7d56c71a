"""Notifications that fail or wait, or run beside a busy store: limited, retried, given up in the end."""

from __future__ import annotations

import contextlib
import logging
import sqlite3
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from monitor.config.outputs import NotifySection
from monitor.records.events import Delivered, Deliveries
from monitor.service.notify.channels import Message
from monitor.service.notify.notifier import Notifier
from tests.support.notifier import NOW, PRESS, Log, Notifying, Recorder, positions
from tests.support.waiting import wait_until


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    with contextlib.closing(Log(tmp_path)) as log:
        yield log


def test_the_rate_limit_holds_across_restarts_and_leads_to_one_summary(log: Log) -> None:
    channel, now = Recorder(), [1000.0]
    more: dict[str, Any] = {"limits": {"most_per_hour": 2}, "monotonic": lambda: now[0], "clock": lambda: NOW + now[0]}
    with Notifying(log, channel, **more) as notifier:
        for number in (1, 2):
            log.add("alarm_raised", severity="alert")
            notifier.wake()
            wait_until(lambda number=number: len(channel.messages) == number)
        for number in range(3, 43):
            kind, severity = ("alarm_cleared", "alert") if number % 4 else ("alarm_raised", "danger")
            log.add(kind, severity=severity)
        notifier.wake()
    now[0] += 3000.0
    with Notifying(log, channel, **more):
        pass
    assert len(channel.messages) == 2
    now[0] += 601.0
    with Notifying(log, channel, **more):
        wait_until(lambda: len(channel.messages) == 3)
    summary = channel.messages[2]
    assert summary.title.startswith("press: 40 events, worst: x: danger")
    assert summary.values["left_out"] == 20
    assert "and 20 events not listed here" in summary.text
    delivered = [event["n"] for event in summary.values["events"]]
    # The ten dangers are among those listed, in the order in which they came.
    assert delivered == sorted(delivered)
    assert set(range(4, 43, 4)) <= set(delivered)


def test_events_not_delivered_for_too_long_are_given_up_and_counted(log: Log, caplog: pytest.LogCaptureFixture) -> None:
    channel, now = Recorder(), [0.0]
    channel.failing = True
    more: dict[str, Any] = {"limits": {"give_up_hours": 1.0}, "clock": lambda: NOW + now[0]}
    with Notifying(log, channel, **more) as notifier, caplog.at_level(logging.ERROR):
        # Blocks of any age, and without a date: the time since the event was found counts.
        log.add("alarm_raised", time=NOW - 1e8)
        log.add("alarm_raised", time=None)
        log.notice(utc=NOW)
        notifier.wake()
        wait_until(lambda: channel.attempts > 1)
        assert positions(log, "channel") == [(0, 0)]
    now[0] = 3700.0
    with Notifying(log, channel, **more):
        wait_until(lambda: positions(log, "channel") == [(2, 1)])
    log.add("end_of_life")
    channel.failing = False
    with Notifying(log, channel, **more):
        wait_until(lambda: channel.messages)
    assert channel.numbers == [4]
    assert channel.messages[0].values["left_out"] == 3
    assert any("given up after 1 h: 3 events" in line for line in caplog.messages)


def test_events_given_up_are_reported_even_if_none_is_left(log: Log) -> None:
    channel = Recorder()
    with Deliveries(log.path) as deliveries:
        deliveries.begin(["channel"], NOW)
        deliveries.save("channel", Delivered(left_out=1))
    with Notifying(log, channel):
        wait_until(lambda: channel.messages)
    assert channel.messages[0].title == "press: 1 event not delivered in time"


def test_a_clock_that_was_never_set_makes_nothing_old(log: Log) -> None:
    channel, utc = Recorder(), [100.0]
    channel.failing = True
    with Notifying(log, channel, clock=lambda: utc[0]) as notifier:
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: channel.attempts > 1)
        utc[0] = NOW
        wait_until(lambda: channel.attempts > 3)
    with Notifying(log, channel, clock=lambda: utc[0]):
        wait_until(lambda: channel.attempts > 5)
        channel.failing = False
        wait_until(lambda: channel.numbers == [1])


def test_a_broken_channel_does_not_end_its_thread(log: Log, caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Recorder):
        def send(self, message: Message) -> str | None:
            if not self.attempts:
                self.attempts += 1
                raise RuntimeError("a fault")
            return super().send(message)

    channel = Broken()
    with Notifying(log, channel) as notifier:
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: channel.numbers == [1])
    assert "notification by channel fails" in caplog.text


def test_a_missing_file_is_a_problem_before_the_first_alarm(log: Log) -> None:
    channel = Recorder()
    channel.missing = "password cannot be read"
    with Notifying(log, channel) as notifier:
        wait_until(lambda: notifier.problems() == {"notify.channel": "password cannot be read"})
        channel.missing = None
        wait_until(lambda: not notifier.problems())
    assert channel.attempts == 0


def test_a_message_delivered_with_a_complaint_is_not_delivered_again(log: Log) -> None:
    channel = Recorder()
    channel.complaint = "refused for ben"
    with Notifying(log, channel) as notifier:
        for number in (1, 2):
            log.add("alarm_raised")
            notifier.wake()
            wait_until(lambda number=number: len(channel.messages) == number)
            wait_until(lambda: notifier.problems() == {"notify.channel": "refused for ben"})
        channel.complaint = None
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: not notifier.problems())
    assert channel.numbers == [1, 2, 3]


def test_notifications_delay_no_commit_and_no_commit_delays_them(log: Log) -> None:
    channel = Recorder()
    # The connection that commits does not wait: a lock held by another would be an error.
    log.store._connection.execute("PRAGMA busy_timeout = 0")
    with Notifying(log, channel, limits={"most_per_hour": 3600}) as notifier:
        channel.go.clear()
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: channel.attempts == 1)
        for _ in range(50):
            log.add("condition")
        with log.store.transaction() as connection:
            # A commit that takes long does not delay the message.
            connection.execute("INSERT OR REPLACE INTO meta VALUES ('x', 'y')")
            channel.go.set()
            wait_until(lambda: channel.numbers == [1])
        notifier.wake()
        wait_until(lambda: len(channel.messages) == 2)
    assert (len(channel.messages[1].values["events"]), channel.messages[1].values["left_out"]) == (20, 30)


def test_writing_positions_beside_a_busy_writer_costs_no_commit(log: Log) -> None:
    done = threading.Event()

    def move() -> None:
        with Deliveries(log.path) as deliveries:
            number = 0
            while not done.is_set():
                number += 1
                deliveries.mark_found(float(number))
                deliveries.save("channel", Delivered(number))

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
    channel = Recorder()
    away = tmp_path / "away.db"
    missing = Notifier(PRESS, [channel], NotifySection(), away, first_pause=0.05)
    wait_until(lambda: "away.db" in missing.problems().get("notify.channel", ""))
    with sqlite3.connect(log.path) as source, sqlite3.connect(away) as target:
        source.backup(target)
    source.close()
    target.close()
    wait_until(lambda: not missing.problems())
    missing.close()
    assert channel.messages == []
