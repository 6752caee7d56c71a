"""Mail servers and webhooks that answer without end, slowly, or with what they were sent."""

from __future__ import annotations

import socket
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from monitor.config.outputs import SmtpSection, WebhookSection
from monitor.service.notify import channels
from monitor.service.notify.channels import Message, NotificationChannel, NotifyError, SmtpChannel, WebhookChannel
from tests.support.receivers import Hook, Mail, make_certificate
from tests.support.waiting import PATIENCE_S

MESSAGE = Message("press: danger", "RMS is 3.21 g\n")
SECRET = "let me in"
_MAX_MEMORY = 8 << 20
Answering = Callable[[socket.socket, threading.Event], None]


@contextmanager
def answering(answer: Answering) -> Iterator[int]:
    """Give the port of a server that answers one connection."""
    over = threading.Event()

    def serve() -> None:
        connection, _ = server.accept()
        with connection, suppress(OSError):
            connection.settimeout(PATIENCE_S)
            answer(connection, over)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield server.getsockname()[1]
        finally:
            over.set()
            thread.join()


def mail(port: int, **more: Any) -> SmtpChannel:
    values = {"security": "none", "sender": "a@plant.example", "to": ("b@plant.example",), **more}
    return SmtpChannel(SmtpSection(host="127.0.0.1", port=port, **values))


def webhook(port: int, **more: Any) -> WebhookChannel:
    return WebhookChannel(WebhookSection(url=f"http://127.0.0.1:{port}/hook", **more))


def endless(head: bytes, part: bytes) -> Answering:
    """Answer with a head, and a part again and again."""

    def answer(connection: socket.socket, over: threading.Event) -> None:
        connection.sendall(head)
        while not over.is_set():
            connection.sendall(part * 16)

    return answer


def once(answer: bytes) -> Answering:
    """Answer, and read all that was sent."""

    def work(connection: socket.socket, _: threading.Event) -> None:
        connection.sendall(answer)
        while connection.recv(1 << 16):
            pass

    return work


def dripping(head: bytes) -> Answering:
    """Answer a byte at a time, each before a receiver has waited for long."""

    def answer(connection: socket.socket, over: threading.Event) -> None:
        connection.sendall(head)
        while not over.wait(0.05):
            connection.sendall(b"2")

    return answer


ENDLESS: dict[str, tuple[Callable[..., NotificationChannel], Answering]] = {
    "lines of a greeting": (mail, endless(b"", b"220-" + b"x" * 8000 + b"\r\n")),
    "lines after the greeting": (mail, endless(b"220 here\r\n", b"250-" + b"x" * 8000 + b"\r\n")),
    "a line": (mail, endless(b"220 here\r\n", b"x" * 8000)),
    "go on": (webhook, endless(b"", b"HTTP/1.1 100 Continue\r\n\r\n")),
    "a header": (webhook, endless(b"HTTP/1.1 200 OK\r\n", b"a: " + b"x" * 60_000 + b"\r\n")),
    "a status": (webhook, endless(b"", b"HTTP/1.1 200 " + b"x" * 8000)),
}


@pytest.mark.parametrize("name", ENDLESS)
def test_an_answer_without_end_is_a_problem_and_takes_no_memory(name: str) -> None:
    make, answer = ENDLESS[name]
    with answering(answer) as port:
        channel = make(port)
        tracemalloc.start()
        try:
            with pytest.raises(NotifyError, match=r"127\.0\.0\.1: "):
                channel.send(MESSAGE)
            assert tracemalloc.get_traced_memory()[1] < _MAX_MEMORY
        finally:
            tracemalloc.stop()


@pytest.mark.parametrize("make", [mail, webhook])
def test_an_answer_that_drips_ends_the_attempt(
    make: Callable[..., NotificationChannel], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(channels, "_MAX_EXCHANGE_S", 0.4)
    with answering(dripping(b"")) as port:
        channel, begin = make(port), time.monotonic()
        with pytest.raises(NotifyError, match=r"not complete after|timed out"):
            channel.send(MESSAGE)
        assert 0.4 <= time.monotonic() - begin < PATIENCE_S


def test_a_giant_body_is_not_read() -> None:
    with answering(endless(b"HTTP/1.1 200 OK\r\nContent-Length: 999999999999\r\n\r\n", b"x" * 60_000)) as port:
        assert webhook(port).send(MESSAGE) is None


def test_a_redirection_to_another_address_is_not_followed() -> None:
    """Neither to this computer nor to the metadata of a cloud: the answer is an error, whatever it names."""
    with Hook().serving() as inner:
        for target in (f"http://127.0.0.1:{inner.port}/in", "http://169.254.169.254/latest/meta-data", "//[::1]/"):
            for status in (301, 302, 303, 307, 308):
                head = f"HTTP/1.1 {status} x\r\nLocation: {target}\r\nContent-Length: 0\r\n\r\n".encode()
                refused = pytest.raises(NotifyError, match=f"answered {status}")
                with answering(once(head)) as port, refused:
                    webhook(port).send(MESSAGE)
        assert inner.received == []


def test_what_a_server_repeats_of_a_secret_is_in_no_error(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text(f"{SECRET}\n", encoding="utf-8")

    def echo(connection: socket.socket, _: threading.Event) -> None:
        asked = connection.recv(1 << 16)
        once(next(line for line in asked.splitlines() if b"Bearer" in line) + b"\r\n\r\n")(connection, _)

    with answering(echo) as port, pytest.raises(NotifyError, match="no answer of HTTP") as failed:
        webhook(port, token_file=token).send(MESSAGE)
    assert SECRET not in str(failed.value)


@pytest.mark.process
def test_what_a_mail_server_repeats_of_the_password_is_in_no_error(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text(f"{SECRET}\n", encoding="utf-8")
    keys = {"username_file": tmp_path / "secret", "password_file": tmp_path / "secret"}
    with Mail(make_certificate(tmp_path), login=(SECRET, SECRET), answer=f"550 {SECRET}").serving() as server:
        channel = mail(server.port, security="starttls", ca_file=tmp_path / "right.pem", **keys)
        with pytest.raises(NotifyError, match="answered 550: its text repeats the password") as failed:
            channel.send(MESSAGE)
    assert SECRET not in str(failed.value)


def test_a_mail_that_is_taken_is_not_sent_again_for_what_the_server_says_at_the_end() -> None:
    for last in (b"421 go away\r\n", b"\xff\xfe\r\n", b""):

        def answer(connection: socket.socket, _: threading.Event, last: bytes = last) -> None:
            connection.sendall(b"220 here\r\n")
            with connection.makefile("rb") as lines:
                for line in map(bytes.upper, lines):
                    if line.startswith(b"QUIT"):
                        connection.sendall(last)
                        return
                    data = line.startswith(b"DATA")
                    connection.sendall(b"354 go on\r\n" if data else b"250 ok\r\n")
                    if data:
                        while lines.readline() != b".\r\n":
                            pass
                        connection.sendall(b"250 taken\r\n")

        with answering(answer) as port:
            assert mail(port).send(MESSAGE) is None
