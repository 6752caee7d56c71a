"""Children and threads of the daemon that die once, die always or hang; tasks of the page; the thread of signals."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from typing import Any

import pytest

from models.platform import supervision
from models.platform.supervision import MAX_FAILURES, REST_S, LostThreadError
from monitor.commands import run
from monitor.service import children
from monitor.service.children import ServerProcess, Worker, end_with_parent, report_line
from monitor.web.server import keep_running
from tests.support.waiting import wait_until

_HERE = "tests.monitor.service.test_owned"


def server_that_answers() -> None:
    """Answer at once, and stay."""
    end_with_parent()
    report_line({"url": "http://here/"})
    wait_until(lambda: False)


def server_that_ends() -> None:
    """End with a reason."""
    report_line({"problem": "the port is taken"})
    sys.exit(1)


class Time:
    """Seconds that the test sets."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def ticking(server: ServerProcess, done: Callable[[], object]) -> None:
    def look() -> object:
        server.tick()
        return done()

    wait_until(look)


@pytest.mark.process
def test_a_child_that_dies_once_is_started_again_and_its_status_says_why() -> None:
    time = Time()
    server = ServerProcess("the page", f"{_HERE}:server_that_answers", {}, time)
    try:
        ticking(server, lambda: server.url)
        assert server.pid is not None
        os.kill(server.pid, signal.SIGKILL)
        ticking(server, lambda: server.problem)
        assert (server.problem, server.url) == ("the page ended unexpectedly", None)
        server.tick()
        assert server.pid is None
        time.now += 5.0
        ticking(server, lambda: server.url)
        assert server.problem is None
        found = server.restarts.values()
        assert (found["count"], found["cause"], found["down"]) == (1, "the page ended unexpectedly", False)
    finally:
        server.close()


@pytest.mark.process
def test_a_child_that_always_dies_stays_down_with_its_reason_and_is_tried_later() -> None:
    time = Time()
    server = ServerProcess("the page", f"{_HERE}:server_that_ends", {}, time)
    try:
        for number in range(1, MAX_FAILURES + 1):
            ticking(server, lambda number=number: server.restarts.failures == number)
            time.now += server.restarts.wait_s if number < MAX_FAILURES else 0.0
        assert server.restarts.down
        assert "the page stays down after 10 failures" in str(server.problem)
        assert str(server.problem).endswith("the port is taken")
        time.now += REST_S / 2.0
        server.tick()
        assert server.pid is None
        time.now += REST_S
        server.tick()
        assert server.pid is not None
    finally:
        server.close()


@pytest.mark.process
def test_a_child_that_hangs_is_ended_and_started_again() -> None:
    time = Time()
    server = ServerProcess("the page", f"{_HERE}:server_that_answers", {}, time)
    try:
        ticking(server, lambda: server.url)
        hung = server.pid
        time.now += 61.0
        server.tick()
        assert server.problem == "the page has said nothing for 60 s"
        time.now += 5.0
        ticking(server, lambda: server.url)
        assert server.pid != hung
    finally:
        server.close()


class Working(Worker):
    """A worker that does what the test says with each piece of news."""

    def __init__(self, does: Callable[[], object]) -> None:
        super().__init__("notify-mail")
        self.does, self.rounds = does, 0
        self.start()

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._news or self._ending)
                if self._ending:
                    return
                self._news = False
            self.does()
            self.rounds += 1


def test_a_worker_that_dies_once_goes_on_with_the_next_news(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervision, "MIN_PAUSE_S", 0.0)
    outcomes: list[Any] = [MemoryError("of a library"), None]

    def once() -> None:
        found = outcomes.pop(0)
        if found is not None:
            raise found

    worker = Working(once)
    worker.restarts._pause = 0.0
    worker.changed()
    wait_until(lambda: worker.trouble())
    assert worker.trouble() == "the thread notify-mail has ended and is started again: MemoryError: of a library"
    worker.tend()
    assert worker.trouble() is None
    worker.changed()
    wait_until(lambda: worker.rounds == 1)
    assert worker.restarts.count == 1
    worker.end()
    worker.join(5.0)
    worker.tend()
    assert worker.trouble() is None


def test_a_worker_that_hangs_is_a_problem_and_one_that_waits_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    go: list[int] = []
    worker = Working(lambda: wait_until(lambda: go))
    with monkeypatch.context() as later:
        later.setattr(children, "_MAX_ATTEMPT_S", 0.0)
        wait_until(lambda: worker._wake.busy_since is None)
        assert worker.trouble() is None
        worker.changed()
        wait_until(lambda: worker.trouble())
        assert "the thread notify-mail has not come back from its latest attempt" in str(worker.trouble())
    go.append(1)
    wait_until(lambda: worker.rounds == 1 and worker.trouble() is None)
    worker.end()
    worker.join(5.0)


def test_a_task_of_the_page_that_fails_once_goes_on_and_one_that_always_fails_ends_the_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(supervision, "MAX_PAUSE_S", 0.0)
    monkeypatch.setattr(supervision, "MIN_PAUSE_S", 0.0)
    lives: list[int] = []

    async def once() -> None:
        lives.append(1)
        if len(lives) == 1:
            raise RuntimeError("can't start new thread")
        await asyncio.sleep(3600.0)

    async def outlived() -> None:
        task = asyncio.create_task(keep_running("the stream of the page", once))
        while len(lives) < 2:
            await asyncio.sleep(0.0)
        assert not task.done()
        task.cancel()

    asyncio.run(outlived())

    async def always() -> None:
        raise RuntimeError("can't start new thread")

    with pytest.raises(LostThreadError, match=r"the stream of the page failed too often: RuntimeError: can't start"):
        asyncio.run(keep_running("the stream of the page", always))


class Failing:
    """A socket whose first reads fail."""

    def __init__(self, errors: int) -> None:
        self.left = errors

    def recv(self, size: int) -> bytes:
        self.left -= 1
        if self.left >= 0:
            raise ConnectionResetError("by peer")
        return bytes([signal.SIGTERM])


def test_signals_are_waited_for_through_a_few_errors_and_not_through_lasting_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(run, "_ERROR_PAUSE_S", 0.0)
    few: Any = Failing(9)
    assert run._receive(few) == bytes([signal.SIGTERM])
    many: Any = Failing(10)
    with pytest.raises(ConnectionResetError):
        run._receive(many)
