"""Owners: a thread that dies once, dies always, hangs, or cannot be had; nothing is left of two hundred restarts."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from models.platform import supervision
from models.platform.supervision import (
    MAX_FAILURES,
    MAX_PAUSE_S,
    MAX_SILENCE_S,
    REST_S,
    STABLE_S,
    LostThreadError,
    OwnedThread,
    Restarts,
)
from tests.support.waiting import wait_until


@pytest.fixture(autouse=True)
def pace(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the pause of the product, which quick effort shortens."""
    monkeypatch.setattr(supervision, "MIN_PAUSE_S", 1.0)


class Time:
    """Seconds that the test sets."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now

    def until_due(self, restarts: Restarts) -> float:
        """Go on until the next start; return the seconds that took."""
        before = self.now
        while not restarts.due:
            self.now += 0.5
        return self.now - before


def restarts_at(time: Time) -> Restarts:
    return Restarts("the receiver of press", time, lambda: 1.7e9)


def test_pauses_double_up_to_a_minute_and_a_minute_without_failure_ends_them() -> None:
    time = Time()
    restarts = restarts_at(time)
    pauses = []
    for _ in range(8):
        restarts.failed("OSError: gone")
        pauses.append(time.until_due(restarts))
        restarts.started()
    assert pauses == [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, MAX_PAUSE_S, MAX_PAUSE_S]
    assert restarts.values() == {
        "failures": 8,
        "count": 8,
        "cause": "OSError: gone",
        "last_utc": "2023-11-14T22:13:20+00:00",
        "down": False,
    }
    assert restarts.problem() is None
    time.now += STABLE_S
    restarts.runs()
    restarts.failed("OSError: gone")
    assert time.until_due(restarts) == 1.0


def test_a_lasting_fault_is_given_up_and_loud_and_is_tried_now_and_then() -> None:
    time = Time()
    restarts = restarts_at(time)
    for _ in range(MAX_FAILURES):
        assert not restarts.down
        time.until_due(restarts)
        restarts.started()
        restarts.failed("OSError: gone")
    assert restarts.down
    assert restarts.take_news() == "the receiver of press failed 10 times within 10 minutes: OSError: gone"
    assert restarts.take_news() is None
    assert time.until_due(restarts) == REST_S
    restarts.started()
    assert "stays down after 10 failures" in str(restarts.problem())
    restarts.failed("OSError: still gone")
    assert time.until_due(restarts) == REST_S
    assert restarts.take_news() is None
    restarts.started()
    time.now += STABLE_S
    restarts.runs()
    assert (restarts.down, restarts.problem()) == (False, None)


def test_failures_that_are_rare_never_add_up() -> None:
    time = Time()
    restarts = restarts_at(time)
    for _ in range(100):
        restarts.started()
        time.now += 90.0
        restarts.failed("OSError: gone")
        assert not restarts.down
        assert time.until_due(restarts) == 1.0


def tended(thread: OwnedThread, time: Time) -> None:
    """Look after a thread when it has ended, then at the next start that is due."""
    thread.join(5.0)
    thread.tend()
    time.until_due(thread.restarts)
    thread.tend()


def test_a_thread_that_dies_once_is_started_again_with_what_it_needs() -> None:
    time, lives, end = Time(), list[int](), threading.Event()
    prepared = list[int]()

    def work() -> None:
        lives.append(len(lives))
        if len(lives) == 1:
            raise ConnectionResetError("by peer")
        end.wait()

    thread = OwnedThread(restarts_at(time), work, lambda: prepared.append(1))
    thread.start()
    tended(thread, time)
    wait_until(lambda: len(lives) == 2)
    assert (len(prepared), thread.alive) == (2, True)
    assert thread.restarts.cause == "ConnectionResetError: by peer"
    end.set()
    thread.join(5.0)
    thread.tend()
    # It returned: that is its end.
    assert (len(lives), thread.restarts.count, thread.restarts.failures) == (2, 1, 1)


def test_a_thread_that_always_dies_stays_down_and_even_the_end_of_the_interpreter_is_told() -> None:
    time, lives = Time(), list[int]()

    def work() -> None:
        lives.append(1)
        raise SystemExit("of a library")

    thread = OwnedThread(restarts_at(time), work)
    thread.start()
    for _ in range(MAX_FAILURES - 1):
        tended(thread, time)
    wait_until(lambda: not thread.alive)
    thread.tend()
    assert thread.restarts.down
    before = len(lives)
    time.now += REST_S / 2
    thread.tend()
    assert (before, len(lives)) == (MAX_FAILURES, MAX_FAILURES)
    assert thread.restarts.cause == "SystemExit: of a library"


def test_what_cannot_be_prepared_is_tried_again() -> None:
    time, ready, end = Time(), list[int](), threading.Event()

    def prepare() -> None:
        if len(ready) < 3:
            ready.append(1)
            if len(ready) > 1:
                raise OSError("the address is taken")

    thread = OwnedThread(restarts_at(time), lambda: waited(end) if len(ready) == 3 else _die(), prepare)
    thread.start()
    for _ in range(3):
        tended(thread, time)
    assert thread.alive
    assert thread.restarts.failures == 3
    end.set()


def waited(event: threading.Event) -> None:
    event.wait()


def _die() -> None:
    raise RuntimeError("died")


def test_a_thread_that_the_system_does_not_give_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    time, end = Time(), threading.Event()

    def no_thread(self: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    thread = OwnedThread(restarts_at(time), lambda: waited(end))
    with monkeypatch.context() as full:
        full.setattr(threading.Thread, "start", no_thread)
        thread.start()
    assert thread.restarts.cause == "can't start new thread"
    time.until_due(thread.restarts)
    thread.tend()
    assert thread.alive
    end.set()


def looked(thread: OwnedThread, now: Any, seconds: float, every: float) -> None:
    """Look after a thread at intervals for so many seconds."""
    for _ in range(round(seconds / every)):
        now[0] += every
        thread.tend()


def test_a_thread_that_hangs_ends_the_process_but_no_process_that_was_frozen(monkeypatch: pytest.MonkeyPatch) -> None:
    now, end = [0.0], threading.Event()
    monkeypatch.setattr(supervision.time, "monotonic", lambda: now[0])
    thread = OwnedThread(Restarts("the receiver of press", Time()), lambda: waited(end), turns=True)
    thread.start()
    looked(thread, now, MAX_SILENCE_S - 1.0, 0.5)
    # Nobody looked for an hour: neither went on.
    now[0] += 3600.0
    thread.tend()
    thread.turn()
    looked(thread, now, MAX_SILENCE_S - 1.0, 0.5)
    with pytest.raises(LostThreadError, match=r"the receiver of press hangs for 30 s and cannot be replaced"):
        looked(thread, now, 3.0, 0.5)
    assert LostThreadError.exit_code == 1
    end.set()


def test_two_hundred_restarts_leave_no_thread_and_no_descriptor() -> None:
    clock, rounds = Time(), 200

    def work() -> None:
        with Path(os.devnull).open("rb"):
            raise OSError("gone")

    thread = OwnedThread(restarts_at(clock), work)
    before = threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))
    thread.start()
    began = time.monotonic()
    for _ in range(rounds):
        tended(thread, clock)
    thread.end()
    thread.join(5.0)
    assert thread.restarts.count == rounds
    # Those of other tests may have ended meanwhile.
    assert threading.active_count() <= before[0]
    assert len(list(Path("/proc/self/fd").iterdir())) <= before[1]
    assert time.monotonic() - began < 60.0
