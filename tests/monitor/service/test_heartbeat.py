"""The dead-man signal: sent while blocks can be committed, and never by a daemon that is stuck."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from monitor.config.load import ConfigError, load_config
from monitor.config.outputs import NotifySection
from monitor.records.database import StoreError
from monitor.records.store import Store
from monitor.service.daemon import Daemon
from monitor.service.ingest import Ingest
from monitor.service.notify.channels import Heartbeat
from tests.support.daemon import last, put, running
from tests.support.daemons import free_port, make_machine, status
from tests.support.receivers import Pulse
from tests.support.waiting import wait_until


@pytest.fixture
def pulse() -> Iterator[Pulse]:
    with Pulse().serving() as serving:
        yield serving


class Clock:
    """Monotonic seconds that a test sets."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def heartbeat_of(pulse: Pulse, clock: Clock) -> Heartbeat:
    return Heartbeat(NotifySection(heartbeat_url=pulse.url, heartbeat_interval_s=60.0), clock)


def test_it_is_requested_once_an_interval_while_it_is_called(pulse: Pulse) -> None:
    clock = Clock()
    heartbeat = heartbeat_of(pulse, clock)
    for clock.now in (0.0, 1.0, 59.9):
        heartbeat.beat(lambda: True)
    wait_until(lambda: pulse.received == ["/ping/secret?x=1"])

    def again() -> bool:
        # One that is due while another has not ended is left out: the next is due an interval later.
        if len(pulse.received) == 1:
            clock.now += 60.0
            heartbeat.beat(lambda: True)
        return len(pulse.received) > 1

    clock.now = 0.0
    wait_until(again)
    heartbeat.close()
    assert len(pulse.received) <= 1 + clock.now / 60.0


def test_it_is_not_requested_while_nothing_can_be_committed(pulse: Pulse) -> None:
    clock = Clock()
    heartbeat = heartbeat_of(pulse, clock)
    for clock.now in (0.0, 100.0, 200.0):
        heartbeat.beat(lambda: False)
    # The first moment of health is said at once.
    clock.now = 201.0
    heartbeat.beat(lambda: True)
    wait_until(lambda: len(pulse.received) == 1)
    heartbeat.close()
    assert len(pulse.received) == 1


def test_a_request_that_fails_is_a_problem_without_the_secret_until_one_succeeds(
    pulse: Pulse, caplog: pytest.LogCaptureFixture
) -> None:
    clock = Clock()
    pulse.answers = [500, 302]
    heartbeat = heartbeat_of(pulse, clock)
    with caplog.at_level(logging.INFO):
        for clock.now, problem in ((0.0, "answered 500"), (60.0, "answered 302"), (120.0, None)):
            heartbeat.beat(lambda: True)
            wait_until(lambda expected=problem: (heartbeat.problem or "None").endswith(str(expected)))
    assert len(pulse.received) == 3
    assert "secret" not in caplog.text
    heartbeat.close()


def test_without_an_address_there_is_no_signal() -> None:
    heartbeat = Heartbeat(NotifySection())
    heartbeat.beat(lambda: pytest.fail("not asked"))
    heartbeat.close()
    assert heartbeat.problem is None


@pytest.mark.parametrize("url", ["http://me:secret@host/ping", "ftp://host/ping", "http://host/a b", "https:///ping"])
def test_an_address_that_cannot_be_meant_is_refused(tmp_path: Path, url: str) -> None:
    config = make_machine(tmp_path)
    config.write_text(config.read_text() + f'[notify]\nheartbeat_url = "{url}"\n')
    with pytest.raises(ConfigError, match="notify"):
        load_config(config)


def hundredfold() -> float:
    """Return monotonic seconds that go a hundred times as fast: an interval of a second is over in 10 ms."""
    return 100.0 * time.monotonic()


def beating(folder: Path, pulse: Pulse) -> Path:
    config = make_machine(folder)
    config.write_text(config.read_text() + f'[notify]\nheartbeat_url = "{pulse.url}"\nheartbeat_interval_s = 1\n')
    return config


def wait_intervals(config: Path, number: int = 30) -> None:
    """Wait until a daemon with that clock has gone on for so many intervals."""
    first = status(config)["up_s"]
    wait_until(lambda: status(config)["up_s"] > first + number)


@pytest.mark.process
def test_a_daemon_signals_while_it_is_idle_and_not_while_the_disk_is_full(tmp_path: Path, pulse: Pulse) -> None:
    config = beating(tmp_path, pulse)
    free = [10**9]
    with running(config, free=lambda _: free[0], monotonic=hundredfold):
        wait_until(lambda: len(pulse.received) >= 3)
        free[0] = 0
        wait_until(lambda: "disk" in status(config)["problems"])
        seen = len(pulse.received)
        wait_intervals(config)
        # One may have been on its way.
        assert len(pulse.received) <= seen + 1
        free[0] = 10**9
        wait_until(lambda: len(pulse.received) >= seen + 3)


@pytest.mark.process
def test_a_daemon_that_cannot_commit_is_silent(tmp_path: Path, pulse: Pulse, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise StoreError("the disk gave an error")

    config = beating(tmp_path, pulse)
    with running(config, monotonic=hundredfold):
        with monkeypatch.context() as broken:
            broken.setattr(Store, "commit_many", fails)
            put(config, 1)
            wait_until(lambda: "store" in status(config)["problems"])
            seen = len(pulse.received)
            wait_intervals(config)
            assert len(pulse.received) <= seen + 1
        wait_until(lambda: last(config) == 2 and len(pulse.received) >= seen + 3)


@pytest.mark.process
def test_a_daemon_whose_thread_hangs_is_silent(tmp_path: Path, pulse: Pulse, monkeypatch: pytest.MonkeyPatch) -> None:
    config = beating(tmp_path, pulse)
    hangs, goes_on = threading.Event(), threading.Event()

    def hang(*_: object) -> None:
        hangs.set()
        goes_on.wait()

    with running(config, monotonic=hundredfold):
        with monkeypatch.context() as broken:
            broken.setattr(Ingest, "step", hang)
            assert hangs.wait()
            seen = len(pulse.received)
            time.sleep(0.2)
            assert len(pulse.received) <= seen + 1
        goes_on.set()
        wait_until(lambda: len(pulse.received) >= seen + 3)


@pytest.mark.process
def test_an_address_that_does_not_answer_delays_nothing(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    url = f"http://127.0.0.1:{free_port()}/ping/secret"
    config.write_text(config.read_text() + f'[notify]\nheartbeat_url = "{url}"\nheartbeat_interval_s = 1\n')
    with running(config):
        wait_until(lambda: "notify.heartbeat" in status(config).get("problems", {}))
        put(config, 1)
        wait_until(lambda: last(config) == 2)
        assert "secret" not in str(status(config))


def test_the_thread_that_commits_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Problems of outputs and sources do not hold the signal back: others tell them."""
    daemon = Daemon(load_config(make_machine(tmp_path)))
    for problems, healthy in (
        ({}, True),
        ({"publisher": "x", "s0": "x", "notify.smtp": "x"}, True),
        ({"disk": "x"}, False),
        ({"store": "x", "s0": "x"}, False),
        ({"events": "x"}, False),
    ):
        monkeypatch.setattr(daemon, "problems", lambda found=problems: dict(found))
        assert daemon._can_commit() is healthy


def test_a_disk_without_room_for_a_commit_is_not_healthy_before_one_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = Daemon(load_config(make_machine(tmp_path)), free=lambda _: 10_000)
    monkeypatch.setattr(daemon, "problems", dict)
    assert not daemon._can_commit()
