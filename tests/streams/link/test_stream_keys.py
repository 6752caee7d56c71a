"""Who may send: the key of a stream is proven, never sent; TLS encrypts; a wrong sender changes nothing."""

from __future__ import annotations

import hashlib
import hmac
import logging
import socket
import ssl
from contextlib import closing, suppress
from pathlib import Path

import pytest

from streams.link.peer import proof, read_key, sender_context
from streams.link.refusals import KEY
from streams.link.sender import Sender, SendError, TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import HELLO, block_frame, encode_frame, hello
from streams.types.spec import NetworkSpec, SourceError, SourceSpec, parse_address
from tests.streams.tcp_peers import URL, Recorded, answer, block, commit, frame, gone, link, raw, receiving
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger
from tests.support.receivers import Certificate, make_certificate
from tests.support.waiting import PATIENCE_S, wait_until

SECRET = "correct horse battery staple"


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "press.key"
    path.write_text(SECRET + "\n", encoding="utf-8")
    path.chmod(0o600)
    return path


def keyed(receiver: TcpReceiver, key: str, tls: ssl.SSLContext | None = None, host: str = "127.0.0.1") -> TcpLink:
    return TcpLink(
        parse_address(f"tcp://{host}:{receiver.port}", "test"), "press", PATIENCE_S, key=key.encode(), tls=tls
    )


def whole(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        more = connection.recv(count - len(data))
        assert more
        data += more
    return data


def test_the_hello_of_the_documentation(key_file: Path) -> None:
    ledger = MemoryLedger()
    with receiving(ledger, NetworkSpec(stream_key_file=key_file)) as receiver:
        with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as connection:
            connection.sendall(HELLO.pack(b"SPWH", 2, 5) + b"press")
            nonce = whole(connection, 32)
            connection.sendall(hmac.new(SECRET.encode(), b"SPWH" + nonce + b"press", hashlib.sha256).digest())
            assert answer(connection) == 0
            connection.sendall(frame(1))
            commit(receiver, ledger)
            assert answer(connection) == 1
        with committing(receiver, ledger):
            assert Sender(Recorded(range(1, 21)), keyed(receiver, SECRET)).run().acknowledged == 20


@pytest.mark.parametrize("version", [1, 2])
def test_a_sender_without_the_key_is_refused_and_the_right_one_undisturbed(key_file: Path, version: int) -> None:
    ledger = MemoryLedger()
    with receiving(ledger, NetworkSpec(stream_key_file=key_file)) as receiver:
        right = keyed(receiver, SECRET)
        assert right.connect() == 0
        if version == 1:
            with raw(receiver) as connection:
                connection.sendall(frame(1))
                assert gone(connection)
        else:
            with pytest.raises(SendError, match="the receiver refuses: the key is not that of stream 'press'"):
                Sender(Recorded(range(1, 3)), keyed(receiver, "wrong"), patience=PATIENCE_S).run()
        assert receiver.next(0.0) is None
        right.send(frame(1))
        commit(receiver, ledger)
        assert right.committed(PATIENCE_S) == 1
        right.close()
        (notice,) = receiver.notices()
        assert (notice["kind"], notice["source"]) == (KEY, "press")
        assert SECRET not in notice["text"]


def test_a_proof_is_good_for_one_connection(key_file: Path) -> None:
    with receiving(MemoryLedger(), NetworkSpec(stream_key_file=key_file)) as receiver:
        answers = []
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as connection:
                connection.sendall(hello("press", 2))
                nonce = whole(connection, 32)
                answers.append(proof(SECRET.encode(), nonce, "press"))
                # The second sender has only recorded the first.
                connection.sendall(answers[0])
                if len(answers) == 2:
                    assert answer(connection) >> 63 == 1
                else:
                    assert answer(connection) == 0
        assert answers[0] != answers[1]


def test_a_jump_is_explained_to_a_sender_of_version_2(key_file: Path) -> None:
    with receiving(MemoryLedger(), NetworkSpec(stream_key_file=key_file)) as receiver:
        sender = keyed(receiver, SECRET)
        sender.connect()
        sender.send(frame(5_000_000))
        with pytest.raises(SendError, match="frame 5000000 of 'press' came after 0: a jump of more than"):
            sender.committed(PATIENCE_S)
        sender.close()


def test_a_key_may_be_shown_before_one_is_asked_for() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, committing(receiver, ledger):
        assert Sender(Recorded(range(1, 4)), keyed(receiver, SECRET)).run().acknowledged == 3


def test_each_stream_of_an_address_has_its_key(key_file: Path) -> None:
    specs = [
        SourceSpec("press", URL, network=NetworkSpec(stream_key_file=key_file)),
        SourceSpec("saw", URL, network=NetworkSpec()),
    ]
    with receiving(MemoryLedger(), specs=specs) as receiver:
        with raw(receiver, "saw") as connection:
            assert answer(connection) == 0
        with raw(receiver, "press") as connection:
            assert gone(connection)


def test_other_machines_need_a_key_or_their_address(key_file: Path, caplog: pytest.LogCaptureFixture) -> None:
    spec = SourceSpec("press", "tcp://0.0.0.0:0")
    with TcpReceiver([spec]) as receiver, pytest.raises(SourceError, match="give stream_key_file"):
        receiver.open(MemoryLedger())
    with caplog.at_level(logging.WARNING):
        with TcpReceiver([spec], NetworkSpec(stream_key_file=key_file)) as receiver:
            receiver.open(MemoryLedger())
            with closing(keyed(receiver, SECRET)) as sender:
                assert sender.connect() == 0
        assert caplog.records == []
        with TcpReceiver([spec], NetworkSpec(peers=("192.168.7.0/24",))) as receiver:
            receiver.open(MemoryLedger())
        assert "machines among peers may send without a key" in caplog.text
        caplog.clear()
        with TcpReceiver([SourceSpec("press", URL)]) as receiver:
            receiver.open(MemoryLedger())
        assert "source press: every user of this computer may send without a key" in caplog.text
        caplog.clear()
        with TcpReceiver([SourceSpec("press", URL)], NetworkSpec(stream_key_file=key_file)) as receiver:
            receiver.open(MemoryLedger())
        assert caplog.records == []


def test_a_key_comes_from_a_file_and_a_weak_one_is_said(
    tmp_path: Path, key_file: Path, caplog: pytest.LogCaptureFixture
) -> None:
    empty, weak = tmp_path / "empty", tmp_path / "weak"
    empty.write_text("\nkey\n", encoding="utf-8")
    weak.write_text("short", encoding="utf-8")
    assert read_key(key_file, "test") == SECRET.encode()
    for path, words in ((empty, "first line"), (tmp_path / "gone", "No such file")):
        network = NetworkSpec(stream_key_file=path)
        with TcpReceiver([SourceSpec("press", URL)], network) as receiver, pytest.raises(SourceError, match=words):
            receiver.open(MemoryLedger())
    with caplog.at_level(logging.WARNING), receiving(MemoryLedger(), NetworkSpec(stream_key_file=weak)):
        assert "has 5 characters" in caplog.text
    caplog.clear()
    key_file.chmod(0o644)
    with caplog.at_level(logging.WARNING), receiving(MemoryLedger(), NetworkSpec(stream_key_file=key_file)):
        assert "chmod 600" in caplog.text
    assert SECRET not in caplog.text


def test_silent_connections_do_not_keep_a_sender_out() -> None:
    with receiving(MemoryLedger(), NetworkSpec(max_connections=4)) as receiver:
        held = [socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) for _ in range(8)]
        with raw(receiver) as connection:
            assert answer(connection) == 0
        for silent in held:
            silent.close()


@pytest.fixture
def certificate(tmp_path: Path) -> Certificate:
    return make_certificate(tmp_path)


def encrypted(certificate: Certificate, key_file: Path | None = None) -> NetworkSpec:
    return NetworkSpec(tls_cert_file=certificate.cert, tls_key_file=certificate.key, stream_key_file=key_file)


@pytest.mark.process
def test_frames_travel_encrypted(certificate: Certificate, key_file: Path) -> None:
    ledger = MemoryLedger()
    with receiving(ledger, encrypted(certificate, key_file)) as receiver, committing(receiver, ledger):
        context = sender_context(certificate.cert, "test")
        recording = Recorded(range(1, 31), samples=20_000)
        result = Sender(recording, keyed(receiver, SECRET, context)).run()
        assert (result.acknowledged, result.reconnects) == (30, 0)
        # Small frames: several in one record of TLS, which no selector reports.
        assert Sender(Recorded(range(1, 201)), keyed(receiver, SECRET, context)).run().acknowledged == 200
        with pytest.raises(SendError, match="the receiver refuses: the key"):
            Sender(recording, keyed(receiver, "wrong", context), patience=0.0).run()


@pytest.mark.process
def test_encrypted_frames_wait_while_too_much_waits(certificate: Certificate) -> None:
    ledger = MemoryLedger()
    size = len(encode_frame(block_frame(block(1))))
    network = NetworkSpec(tls_cert_file=certificate.cert, tls_key_file=certificate.key, max_waiting=3 * size)
    with receiving(ledger, network) as receiver, committing(receiver, ledger):
        address = parse_address(f"tcp://127.0.0.1:{receiver.port}", "test")
        context = sender_context(certificate.cert, "test")
        result = Sender(Recorded(range(1, 301)), TcpLink(address, "press", PATIENCE_S, tls=context)).run()
        assert (result.acknowledged, result.reconnects) == (300, 0)


@pytest.mark.process
def test_a_certificate_that_is_not_trusted_ends_the_sender(certificate: Certificate, tmp_path: Path) -> None:
    other = make_certificate(tmp_path, "other")
    with receiving(MemoryLedger(), encrypted(certificate)) as receiver:
        with pytest.raises(SendError, match="not trusted"):
            keyed(receiver, SECRET, sender_context(other.cert, "test")).connect()
        with pytest.raises(SendError, match="not trusted"):
            keyed(receiver, SECRET, sender_context(certificate.cert, "test"), "localhost").connect()


@pytest.mark.process
def test_what_is_not_tls_ends_its_own_connection_only(certificate: Certificate, tmp_path: Path) -> None:
    ledger = MemoryLedger()
    with receiving(ledger, encrypted(certificate)) as receiver:
        for data in (hello("press") + frame(1), b"\x16\x03\x01\x02\x00" + bytes(200), b""):
            with socket.create_connection(("127.0.0.1", receiver.port), PATIENCE_S) as connection:
                connection.sendall(data)
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_WR)
                assert gone(connection)
        wait_until(lambda: receiver.problem() is not None)
        context = sender_context(certificate.cert, "test")
        address = parse_address(f"tcp://127.0.0.1:{receiver.port}", "test")
        with closing(TcpLink(address, "press", PATIENCE_S, tls=context)) as sender:
            assert sender.connect() == 0
    unusable = NetworkSpec(tls_cert_file=tmp_path / "gone", tls_key_file=certificate.key)
    with TcpReceiver([SourceSpec("press", URL)], unusable) as receiver, pytest.raises(SourceError, match="cannot be"):
        receiver.open(ledger)
    with pytest.raises(SourceError, match="belong together"):
        NetworkSpec(tls_cert_file=certificate.cert)
    specs = [SourceSpec("press", URL, network=encrypted(certificate)), SourceSpec("saw", URL, network=NetworkSpec())]
    with pytest.raises(SourceError, match="the same tls_cert_file"):
        TcpReceiver(specs)


def test_a_plain_link_still_speaks_version_1() -> None:
    ledger = MemoryLedger()
    with receiving(ledger) as receiver:
        assert link(receiver)._hello == b"SPWH\x01\x00\x05\x00press"
