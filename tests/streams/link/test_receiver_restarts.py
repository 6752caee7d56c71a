"""Receivers whose thread ends are made again: senders connect again, and each block is committed once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from models.platform.supervision import MAX_FAILURES
from streams.link.mqtt import MqttLink, MqttReceiver
from streams.link.sender import Sender
from streams.link.tcp import TcpReceiver
from streams.types.source import LiveSource
from streams.types.spec import SourceSpec, parse_address
from tests.streams.tcp_peers import Recorded, answer, commit, frame, gone, link, raw, receiving
from tests.support.broker import Broker
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import wait_until

URL = "tcp://127.0.0.1:0"


@contextmanager
def tending(receiver: LiveSource) -> Iterator[None]:
    """Look after a receiver, as the daemon does."""
    ending = threading.Event()

    def look() -> None:
        while not ending.wait(0.05):
            receiver.tend()

    thread = threading.Thread(target=look)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


def fail_once(target: Any, name: str, error: BaseException) -> None:
    """Let the next call of a method of one object raise."""
    before: Callable[..., Any] = getattr(target, name)

    def once(*values: Any) -> Any:
        setattr(target, name, before)
        raise error

    setattr(target, name, once)


def counts() -> tuple[int, int]:
    """Return the numbers of threads and of open descriptors."""
    return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))


def test_a_receiver_whose_wake_socket_is_reset_goes_on_without_losing_a_connection() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        answer(connection)
        connection.sendall(frame(1))
        waker = receiver._waker
        assert waker is not None
        waker._ours.close()
        wait_until(lambda: waker._ours.fileno() >= 0)
        commit(receiver, ledger)
        assert answer(connection) == 1
        connection.sendall(frame(2))
        commit(receiver, ledger)
        assert answer(connection) == 2
        assert receiver.restarts()[0].failures == 0


def test_a_receiver_whose_thread_dies_listens_again_at_its_port_and_nothing_is_lost_or_doubled() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, tending(receiver):
        port = receiver.port
        with raw(receiver) as connection, committing(receiver, ledger) as items:
            answer(connection)
            connection.sendall(frame(1) + frame(2))
            wait_until(lambda: len(items) == 2)
            fail_once(receiver._selector, "select", OSError(9, "Bad file descriptor"))
            assert gone(connection)
            wait_until(lambda: receiver.restarts()[0].count == 1)
            assert receiver.port == port
            result = Sender(Recorded(range(1, 41)), link(receiver)).run()
        assert (result.acknowledged, result.skipped) == (40, 2)
        assert receiver.restarts()[0].cause == "OSError: [Errno 9] Bad file descriptor"
        assert receiver.problem() is None
    assert [item.sequence for item in items] == list(range(1, 41))


def test_a_sender_in_the_middle_of_a_recording_outlives_the_death_of_the_receiver() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, tending(receiver), committing(receiver, ledger) as items:

        def kill() -> None:
            wait_until(lambda: len(items) > 20)
            fail_once(receiver._selector, "select", OSError(104, "Connection reset by peer"))

        killer = threading.Thread(target=kill)
        killer.start()
        result = Sender(Recorded(range(1, 401)), link(receiver)).run()
        killer.join()
    assert (result.acknowledged, result.reconnects >= 1) == (400, True)
    assert [item.sequence for item in items] == list(range(1, 401))


def test_an_error_of_the_program_with_one_sender_ends_its_connection_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    ledger = MemoryLedger()
    specs = [SourceSpec("press", URL), SourceSpec("fan", URL)]
    with receiving(ledger, specs=specs) as receiver:
        take = receiver._take

        def of_press(peer: Any, message: bytearray) -> None:
            if peer.stream == "press":
                raise ZeroDivisionError("division by zero")
            take(peer, message)

        with raw(receiver, "fan") as good, raw(receiver) as bad:
            assert (answer(good), answer(bad)) == (0, 0)
            monkeypatch.setattr(receiver, "_take", of_press)
            bad.sendall(frame(1))
            assert gone(bad)
            good.sendall(frame(1))
            commit(receiver, ledger)
            assert answer(good) == 1
        assert receiver.backlog().refused == 1
        assert receiver.restarts()[0].failures == 0


def test_a_receiver_that_always_dies_stays_down_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: TcpReceiver, *values: object) -> None:
        raise ValueError("broken")

    with receiving(MemoryLedger()) as receiver:
        (restarts,) = receiver.restarts()
        monkeypatch.setattr(TcpReceiver, "_pause_or_resume", broken)
        for _ in range(MAX_FAILURES):
            assert not restarts.down
            receiver._wake()
            receiver._thread.join(5.0)
            receiver.tend()
            assert receiver.problem() is not None
            monkeypatch.setattr(restarts, "_due", 0.0)
            if not restarts.down:
                receiver.tend()
        assert "the receiver of press stays down after 10 failures" in str(receiver.problem())
        assert restarts.take_news() == "the receiver of press failed 10 times within 10 minutes: ValueError: broken"


def test_two_hundred_receivers_leave_no_thread_and_no_descriptor(monkeypatch: pytest.MonkeyPatch) -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        before = counts()
        (restarts,) = receiver.restarts()
        for number in range(1, 201):
            fail_once(receiver._selector, "select", OSError(9, "Bad file descriptor"))
            receiver._wake()
            receiver._thread.join(5.0)
            receiver.tend()
            monkeypatch.setattr(restarts, "_due", 0.0)
            receiver.tend()
            assert restarts.count == number
        with raw(receiver) as connection:
            assert answer(connection) == 0
            connection.sendall(frame(1))
            commit(receiver, ledger)
            assert answer(connection) == 1
        wait_until(lambda: all(now <= then for now, then in zip(counts(), before, strict=True)))


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    with Broker(tmp_path / "broker") as running:
        yield running


@pytest.mark.process
def test_an_mqtt_receiver_whose_thread_dies_connects_again_and_takes_each_block_once(broker: Broker) -> None:
    ledger, url = MemoryLedger(), f"mqtt://127.0.0.1:{broker.port}/plant"
    with MqttReceiver([SourceSpec("press", url)]) as receiver:
        receiver.open(ledger)
        wait_until(lambda: receiver.problem() is None)
        with tending(receiver), committing(receiver, ledger) as items:
            sender = Sender(Recorded(range(1, 11)), MqttLink(parse_address(url, "test")))
            assert sender.run().acknowledged == 10
            fail_once(receiver._client, "_loop", OSError(104, "Connection reset by peer"))
            wait_until(lambda: receiver.restarts()[0].count == 1)
            wait_until(lambda: receiver.problem() is None)
            result = Sender(Recorded(range(1, 31)), MqttLink(parse_address(url, "test"))).run()
        assert (result.acknowledged, result.skipped) == (30, 10)
    assert [item.sequence for item in items] == list(range(1, 31))


@pytest.mark.process
def test_an_mqtt_message_on_which_the_program_fails_ends_no_connection(
    broker: Broker, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger, url = MemoryLedger(), f"mqtt://127.0.0.1:{broker.port}/plant"
    with MqttReceiver([SourceSpec("press", url)]) as receiver:
        receiver.open(ledger)
        wait_until(lambda: receiver.problem() is None)
        fail_once(receiver._arrivals, "take", ZeroDivisionError("division by zero"))
        sender = MqttLink(parse_address(url, "test"))
        with committing(receiver, ledger) as items:
            assert sender.connect() == 0
            sender.send(frame(1))
            wait_until(lambda: "ZeroDivisionError" in str(receiver.problem()))
            sender.send(frame(1))
            wait_until(lambda: sender.committed(0.1) == 1)
        sender.close()
        assert receiver.restarts()[0].failures == 0
    assert [item.sequence for item in items] == [1]
