"""Notifications follow the log: in order, at least once, across restarts, each channel from its own position."""

from __future__ import annotations

import logging
import random
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.config.outputs import MqttSection, NotifySection, SmtpSection, WebhookSection
from monitor.records.events import Delivered, Deliveries
from monitor.service.notify.channels import configured_channels
from tests.support.notifier import NOW, Log, Notifying, Recorder, positions
from tests.support.waiting import wait_until


@pytest.fixture
def log(tmp_path: Path) -> Iterator[Log]:
    log = Log(tmp_path)
    yield log
    log.close()


def test_each_section_has_its_channel() -> None:
    sections = NotifySection(
        smtp=SmtpSection(host="mail", sender="a@b.example", to=("c@d.example",)),
        webhook=WebhookSection(url="http://127.0.0.1:1/hook"),
        mqtt=MqttSection(url="mqtt://127.0.0.1:1/alarms"),
    )
    assert [channel.name for channel in configured_channels(sections)] == ["smtp", "webhook", "mqtt"]
    assert configured_channels(NotifySection()) == []


def test_a_new_channel_begins_at_the_present_end(log: Log) -> None:
    log.add("final_stage")
    log.notice()
    channel = Recorder()
    with Notifying(log, channel) as notifier:
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: channel.messages)
        log.notice()
        notifier.wake()
        wait_until(lambda: len(channel.messages) == 2)
    assert channel.numbers == [3, 4]


def test_events_that_waited_at_the_end_are_delivered_after_the_next_start(log: Log) -> None:
    channel = Recorder()
    channel.failing = True
    with Notifying(log, channel) as notifier:
        log.add("alarm_raised", "final_stage")
        notifier.wake()
        wait_until(lambda: notifier.problems())
    assert channel.messages == []
    log.add("end_of_life")
    log.notice()
    again = Recorder()
    with Notifying(log, again):
        wait_until(lambda: again.messages)
    assert again.numbers == [1, 2, 3, 4]
    with Notifying(log, Recorder()) as notifier:
        notifier.wake()
    assert again.numbers == [1, 2, 3, 4]


def test_a_message_sent_but_not_noted_is_sent_again(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    # A kill between sending and noting leaves the place behind.
    channel = Recorder()
    with Notifying(log, channel) as notifier, monkeypatch.context() as patched:
        wait_until(lambda: positions(log, "channel") == [(0, 0)])
        patched.setattr(Deliveries, "save", lambda *_: None)
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: channel.numbers == [1])
    with Notifying(log, channel):
        wait_until(lambda: channel.numbers == [1, 1])


def test_each_channel_has_its_own_position_and_a_failing_one_delays_no_other(
    log: Log, caplog: pytest.LogCaptureFixture
) -> None:
    bad, good = Recorder("bad"), Recorder("good")
    bad.failing = True
    with Notifying(log, bad, good) as notifier, caplog.at_level(logging.ERROR):
        log.add("alarm_raised")
        notifier.wake()
        wait_until(lambda: good.numbers == [1])
        wait_until(lambda: bad.attempts > 2)
        assert notifier.problems() == {"notify.bad": "no answer"}
        log.add("alarm_cleared")
        notifier.wake()
        wait_until(lambda: good.numbers == [1, 2])
        bad.failing = False
        wait_until(lambda: bad.numbers == [1, 2] and not notifier.problems())
    # The waiting events became one message, and the failure was logged once.
    assert len(bad.messages) == 1
    assert sum("tried again" in line for line in caplog.messages) == 1


def test_a_channel_that_was_removed_begins_anew(log: Log) -> None:
    first, second = Recorder("first"), Recorder("second")
    with Notifying(log, first, second):
        pass
    log.add("alarm_raised")
    with Notifying(log, first):
        wait_until(lambda: first.numbers == [1])
    with Notifying(log, first, second) as notifier:
        log.add("alarm_cleared")
        notifier.wake()
        wait_until(lambda: first.numbers == [1, 2] and second.numbers == [2])
    with Notifying(log):
        pass
    assert positions(log, "first") == []


def test_a_store_made_anew_goes_on_from_its_end_and_a_salvage_is_reported(tmp_path: Path) -> None:
    log = Log(tmp_path)
    channel, new = Recorder("channel"), Recorder("new")
    with Deliveries(log.path) as deliveries:
        deliveries.begin(["channel"], NOW)
        deliveries.save("channel", Delivered(700, 30))
    log.add("alarm_raised")
    log.notice("store_salvaged", utc=NOW)
    with Notifying(log, channel, new, clock=lambda: NOW + 60.0) as notifier:
        wait_until(lambda: new.numbers == [2])
        log.add("alarm_cleared")
        notifier.wake()
        wait_until(lambda: channel.numbers == [3] and new.numbers == [2, 3])
    log.close()


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_each_event_is_delivered_in_order_at_least_once(tmp_path_factory: pytest.TempPathFactory, seed: int) -> None:
    generator = random.Random(seed)
    log, channel = Log(tmp_path_factory.mktemp("log")), Recorder()
    expected: list[int] = []
    kinds = ("alarm_raised", "alarm_cleared", "alarm_released", "final_stage")
    with Deliveries(log.path) as deliveries:
        deliveries.begin(["channel"], NOW)
    limits = {"most_per_hour": 3600, "queue_events": generator.choice((1, 3, 50))}
    for _ in range(generator.randint(1, 4)):
        with Notifying(log, channel, limits=limits, first_pause=0.001) as notifier:
            for _ in range(generator.randint(0, 8)):
                channel.failing = generator.random() < 0.3
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
    channel.failing = False
    with Notifying(log, channel, limits=limits, first_pause=0.001):
        wait_until(lambda: set(channel.numbers) == set(expected))
    log.close()
    delivered = [event for message in channel.messages for event in message.values["events"]]
    for notices in (False, True):
        numbers = [event["n"] for event in delivered if (event["kind"] == "no_data") == notices]
        # No message failed after it was sent, so that none was sent twice.
        assert numbers == sorted(set(numbers))
