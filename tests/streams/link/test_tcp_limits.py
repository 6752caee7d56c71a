"""Who may talk to the TCP receiver, how much, how slowly, and what nonsense costs."""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress

import pytest

from streams.link.sender import Sender
from streams.link.tcp import TcpReceiver
from streams.link.wire import HEAD, block_frame, encode_frame, hello
from streams.types.spec import NetworkSpec, SourceError, SourceSpec, parse_address
from tests.streams.tcp_peers import Recorded, answer, block, commit, frame, gone, link, raw, receiving
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger
from tests.support.waiting import PATIENCE_S, join, wait_until


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "hello"),
        (hello("lathe"), "not configured"),
        (hello("press") + b"SPW2" + bytes(60), "SPW1"),
        (hello("press") + HEAD.pack(b"SPW1", 1, 1000, 1, 1.0, 2**31, 4, 0, 0), "at most"),
        (hello("press") + frame(1)[:-1] + b"\0", "checksum"),
        (hello("press") + frame(1)[:-9], "middle"),
    ],
)
def test_nonsense_ends_its_own_connection_only(data: bytes, words: str) -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as connection:
            connection.sendall(data)
            with suppress(OSError):
                connection.shutdown(socket.SHUT_WR)
            assert gone(connection)
        wait_until(lambda: words in (receiver.problem() or ""))
        assert receiver.next(0.0) is None
        with raw(receiver) as connection:
            assert answer(connection) == 0
            connection.sendall(frame(1))
            assert commit(receiver, ledger).sequence == 1
            assert receiver.problem() is None


def test_a_sender_that_dawdles_is_dropped() -> None:
    network = NetworkSpec(read_timeout=0.2)
    with receiving(MemoryLedger(), network) as receiver:
        with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as connection:
            connection.sendall(b"SP")
            assert gone(connection)
        assert "no whole hello within 0.2 s" in (receiver.problem() or "")
        with raw(receiver) as connection:
            answer(connection)
            # Between two frames there is no limit.
            time.sleep(0.6)
            connection.sendall(frame(1))
            wait_until(lambda: receiver.backlog().pending == 1)
            connection.sendall(frame(2)[:50])
            assert gone(connection)
        wait_until(lambda: "no whole frame within 0.2 s" in (receiver.problem() or ""))
        assert receiver.listener()["refused"]["slow"] == 2
        assert receiver.listener()["received_bytes"] > 50


def test_one_connection_too_many_is_refused() -> None:
    with receiving(MemoryLedger(), NetworkSpec(max_connections=1)) as receiver, raw(receiver) as first:
        answer(first)
        with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as second:
            assert gone(second)
        counts = receiver.listener()
        assert (counts["connections"], counts["accepted"], counts["refused"]["full"]) == (1, 1, 1)


def test_a_sender_that_reads_no_answers_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as connection:
        answer(connection)
        monkeypatch.setattr("streams.link.tcp._MAX_OUT_BYTES", 7)
        connection.sendall(frame(1))
        commit(receiver, ledger)
        assert gone(connection)
        wait_until(lambda: "does not read what is answered" in (receiver.problem() or ""))


def test_many_connections_at_once_wait_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("streams.link.tcp._ACCEPTED_PER_S", 20.0)
    with receiving(MemoryLedger()) as receiver:
        began = time.monotonic()
        for _ in range(12):
            with raw(receiver) as connection:
                assert answer(connection) == 0
        # Two at once, and twenty a second.
        assert time.monotonic() - began >= 0.45


def test_an_address_that_is_not_among_peers_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(NetworkSpec, "admits", lambda *_: False)
    with receiving(MemoryLedger()) as receiver:
        with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as connection:
            assert gone(connection)
        wait_until(lambda: receiver.listener()["refused"]["address"] == 1)
        assert "127.0.0.1: not among peers" in (receiver.problem() or "")


def test_a_client_that_connects_too_often_is_refused_and_another_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("streams.link.tcp._CONNECTIONS_PER_S", 1.0)
    with receiving(MemoryLedger(), NetworkSpec(max_connections=2)) as receiver:
        at = ("127.0.0.1", receiver.port)
        began = time.monotonic()
        for _ in range(60):
            with socket.create_connection(at, PATIENCE_S, source_address=("127.0.0.9", 0)) as connection:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_WR)
                assert gone(connection)
        taken = 5 + 2.0 * (time.monotonic() - began)
        with raw(receiver) as connection:
            assert answer(connection) == 0
        assert receiver.listener()["refused"]["rate"] >= 60 - taken


def test_the_newest_connection_of_a_stream_is_the_one() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, raw(receiver) as first:
        answer(first)
        with raw(receiver) as second:
            answer(second)
            assert gone(first)
            second.sendall(frame(1))
            commit(receiver, ledger)
            assert answer(second) == 1


def test_reading_stops_while_too_much_waits() -> None:
    ledger = MemoryLedger()
    size = len(encode_frame(block_frame(block(1, 20000))))
    with receiving(ledger, NetworkSpec(max_waiting=3 * size)) as receiver:
        sender = Sender(Recorded(range(1, 61), samples=20000), link(receiver))
        thread = threading.Thread(target=sender.run)
        thread.start()
        wait_until(lambda: receiver.backlog().pending >= 3)
        time.sleep(0.3)
        assert receiver.backlog().pending == 3
        # The sender holds more.
        assert receiver.queued_blocks() is None
        assert "faster than they are committed" in (receiver.problem() or "")
        with committing(receiver, ledger):
            join(thread)
        wait_until(lambda: receiver.queued_blocks() == 0)
    assert sorted(ledger.blocks("press")) == list(range(1, 61))


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("tcp://127.0.0.1", "expected tcp"),
        ("tcp://user:secret@127.0.0.1:1", "password_file"),
        ("tcp://127.0.0.1:99999", "ort"),
        ("tcp://127.0.0.1:5/path", "expected tcp"),
        ("mqtt://h/a/+/b", "without"),
        ("mqtt://h/a/%23", "without"),
        ("mqtt://h", "expected tcp"),
        ("udp://h:1", "expected tcp"),
    ],
)
def test_addresses_that_are_none_are_named(url: str, words: str) -> None:
    with pytest.raises(SourceError, match=words) as caught:
        parse_address(url, "[[source]] press: url")
    assert "secret" not in str(caught.value)


def test_other_machines_are_kept_out_unless_they_are_named() -> None:
    spec = SourceSpec("press", "tcp://0.0.0.0:0")
    with TcpReceiver([spec]) as receiver, pytest.raises(SourceError, match="peers"):
        receiver.open(MemoryLedger())
    network = NetworkSpec(peers=("192.168.7.0/24",))
    assert network.admits("192.168.7.9")
    assert network.admits("::ffff:192.168.7.9")
    assert network.admits("127.0.0.1")
    assert network.admits("::1")
    assert not network.admits("192.168.8.9")
    with pytest.raises(SourceError, match="peers"):
        NetworkSpec(peers=("nowhere",))
    with TcpReceiver([spec], network) as receiver:
        receiver.open(MemoryLedger())
        with raw(receiver) as connection:
            assert answer(connection) == 0


def test_an_address_in_use_is_named() -> None:
    with receiving(MemoryLedger()) as receiver:
        spec = SourceSpec("saw", f"tcp://127.0.0.1:{receiver.port}")
        with TcpReceiver([spec]) as other, pytest.raises(SourceError, match="cannot be listened to"):
            other.open(MemoryLedger())
