"""Notification against real servers on this machine: delivered, retried, limited, and in nobody's way."""

from __future__ import annotations

import email
import email.policy
import http.server
import json
import logging
import socketserver
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from email.message import EmailMessage
from pathlib import Path
from typing import Any

import pytest
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from monitor.alarm_config import MqttSection, NotifySection, SmtpSection, WebhookSection
from monitor.service.notify.channels import Message, NotifyError, read_secret
from monitor.service.notify.mqtt import MqttWay
from monitor.service.notify.notifier import Notifier
from monitor.service.notify.smtp import SmtpWay
from monitor.service.notify.webhook import WebhookWay
from tests.broker import Broker

EVENT = {"kind": "alarm_raised", "severity": "danger", "rule": "rms", "channel": "Hörizontal"}
MESSAGE = Message("press", (EVENT,))


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


class Mail(socketserver.StreamRequestHandler):
    received: list[bytes]
    recipients: list[str]
    refuse: bool

    def handle(self) -> None:
        self._say("220 here")
        while line := self.rfile.readline().decode().strip():
            word = line[:4].upper()
            if word == "DATA":
                self._say("354 go on")
                body = b""
                while (part := self.rfile.readline()) != b".\r\n":
                    body += part
                self.received.append(body)
                self._say("250 taken")
            elif word == "RCPT":
                self.recipients.append(line)
                self._say("550 nobody" if self.refuse else "250 ok")
            else:
                self._say("221 bye" if word == "QUIT" else "250 ok")
                if word == "QUIT":
                    return

    def _say(self, text: str) -> None:
        self.wfile.write(f"{text}\r\n".encode())


class Hook(http.server.BaseHTTPRequestHandler):
    received: list[tuple[str, str | None, Any]]
    answers: list[int]

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        status = self.answers.pop(0) if self.answers else 204
        self.received.append((self.path, self.headers.get("Authorization"), body))
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        pass


@contextmanager
def serving(handler: type[socketserver.BaseRequestHandler], **fields: Any) -> Iterator[tuple[int, Any]]:
    """Give the port of a server and the handler, whose ``fields`` it shares."""
    mine = type("Handler", (handler,), fields)
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), mine) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield server.server_address[1], mine
        finally:
            server.shutdown()
            thread.join()


def smtp(port: int) -> SmtpWay:
    to = ("anna@plant.example", "ben@plant.example")
    return SmtpWay(SmtpSection(host="127.0.0.1", port=port, security="none", sender="watch@plant.example", to=to))


def hook(port: int, token_file: Path | None = None) -> WebhookWay:
    return WebhookWay(WebhookSection(url=f"http://127.0.0.1:{port}/hook?a=1", token_file=token_file))


def test_an_email_arrives_whole() -> None:
    with serving(Mail, received=[], recipients=[], refuse=False) as (port, server):
        smtp(port).send(MESSAGE)
        assert len(server.recipients) == 2
        mail = email.message_from_bytes(server.received[0], EmailMessage, policy=email.policy.default)
    assert mail["Subject"] == "press: danger alarm_raised rms Hörizontal"
    assert mail["From"] == "watch@plant.example"
    assert "channel: Hörizontal" in mail.get_content()


def test_a_name_with_a_line_break_makes_no_header() -> None:
    message = Message("press\r\nBcc: all@plant.example", (EVENT,))
    with serving(Mail, received=[], recipients=[], refuse=False) as (port, server):
        smtp(port).send(message)
        mail = email.message_from_bytes(server.received[0], policy=email.policy.default)
    assert mail["Bcc"] is None


def test_what_is_not_taken_is_said(tmp_path: Path) -> None:
    with serving(Mail, received=[], recipients=[], refuse=True) as (port, _), pytest.raises(NotifyError, match="smtp"):
        smtp(port).send(MESSAGE)
    with serving(Hook, received=[], answers=[302]) as (port, _), pytest.raises(NotifyError, match="answered 302"):
        hook(port).send(MESSAGE)
    for way in (smtp(1), hook(1), MqttWay(MqttSection(url="mqtt://127.0.0.1:1/alarms"))):
        with pytest.raises(NotifyError, match=way.name):
            way.send(MESSAGE)
    with pytest.raises(NotifyError, match="cannot be read"):
        read_secret(tmp_path / "none")


def test_a_webhook_gets_json_and_the_token_from_its_file(tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("secret\n")
    with serving(Hook, received=[], answers=[]) as (port, server):
        hook(port, token).send(MESSAGE)
    path, authorization, body = server.received[0]
    assert (path, authorization) == ("/hook?a=1", "Bearer secret")
    assert body["events"] == [EVENT]


@pytest.mark.broker
def test_mqtt_publishes_and_knows_that_the_broker_has_it(tmp_path: Path) -> None:
    got: list[bytes] = []
    ready = threading.Event()
    with Broker(tmp_path / "broker") as broker:
        client = Client(CallbackAPIVersion.VERSION2)
        client.on_message = lambda client, data, message: got.append(bytes(message.payload))
        client.on_subscribe = lambda *values: ready.set()
        client.connect("127.0.0.1", broker.port)
        client.subscribe("plant/alarms", qos=1)
        client.loop_start()
        try:
            assert ready.wait(10.0)
            MqttWay(MqttSection(url=f"mqtt://127.0.0.1:{broker.port}/plant/alarms")).send(MESSAGE)
            wait_until(lambda: bool(got))
        finally:
            client.disconnect()
            client.loop_stop()
    assert json.loads(got[0])["machine"] == "press"


def test_it_is_tried_again_until_it_is_delivered_and_delays_no_other(caplog: pytest.LogCaptureFixture) -> None:
    settings = NotifySection()
    with (
        serving(Hook, received=[], answers=[500, 503]) as (port, server),
        serving(Mail, received=[], recipients=[], refuse=False) as (mail_port, mail),
        caplog.at_level(logging.ERROR),
    ):
        notifier = Notifier("press", [hook(port), smtp(mail_port)], settings, first_pause=0.2)
        notifier.tell(EVENT)
        wait_until(lambda: "notify.webhook" in notifier.problems())
        wait_until(lambda: len(mail.received) == 1)
        wait_until(lambda: len(server.received) == 3 and not notifier.problems() and not notifier.waiting())
        notifier.close()
    assert server.received[2][2]["events"] == [EVENT]
    assert sum("tried again" in line for line in caplog.messages) == 1


class Slow:
    """A way that waits to be let go."""

    name = "slow"

    def __init__(self) -> None:
        self.go = threading.Event()
        self.messages: list[Message] = []

    def send(self, message: Message) -> None:
        self.go.wait(10.0)
        self.messages.append(message)


def test_a_full_queue_and_the_rate_limit_lose_nothing_unsaid() -> None:
    way = Slow()
    now = [0.0]
    settings = NotifySection(queue_events=10, most_per_hour=2)
    notifier = Notifier("press", [way], settings, monotonic=lambda: now[0])
    notifier.tell({"kind": "first"})
    wait_until(lambda: notifier.waiting() == 0)
    for number in range(1000):
        notifier.tell({"kind": "event", "number": number})
    assert notifier.waiting() == 10
    way.go.set()
    wait_until(lambda: len(way.messages) == 2)
    assert [event["number"] for event in way.messages[1].events] == list(range(990, 1000))
    assert way.messages[1].left_out == 990
    assert "990 more events" in way.messages[1].text
    notifier.tell({"kind": "late"})
    now[0] = 3601.0
    notifier.tell({"kind": "next"})
    wait_until(lambda: sum(len(message.events) for message in way.messages) == 13)
    notifier.close()


def test_a_way_that_is_broken_does_not_end_its_thread(caplog: pytest.LogCaptureFixture) -> None:
    class Broken:
        name = "broken"
        calls = 0

        def send(self, message: Message) -> None:
            self.calls += 1
            if self.calls == 1:
                raise RuntimeError("a fault")

    way = Broken()
    notifier = Notifier("press", [way], NotifySection(), first_pause=0.01)
    notifier.tell(EVENT)
    wait_until(lambda: way.calls == 2)
    notifier.close()
    assert "notification by broken fails" in caplog.text
