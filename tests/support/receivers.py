"""Who is told, for tests: a mail server with STARTTLS, TLS and login, a webhook, and their certificates; all real."""

from __future__ import annotations

import base64
import email
import email.policy
import http.server
import ipaddress
import json
import socketserver
import ssl
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from email.message import EmailMessage
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from streams.link.mqtt_client import end_client
from tests.support.waiting import PATIENCE_S


@dataclass(frozen=True)
class Certificate:
    """A certificate, which is its own authority, and its key."""

    cert: Path
    key: Path

    @property
    def server(self) -> ssl.SSLContext:
        """What a server with this certificate uses."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(self.cert, self.key)
        return context


def make_certificate(
    folder: Path, name: str = "right", subject: str = "IP:127.0.0.1", *, expired: bool = False
) -> Certificate:
    """Make a certificate for a name or an address."""
    found = Certificate(folder / f"{name}.pem", folder / f"{name}.key")
    if expired:
        _make_expired(found)
        return found
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    command += ["-days", "2", "-subj", f"/CN={name}", "-addext", f"subjectAltName={subject}"]
    command += ["-keyout", str(found.key), "-out", str(found.cert)]
    subprocess.run(command, check=True, capture_output=True)
    return found


def _make_expired(certificate: Certificate) -> None:
    """Write one of this computer that ended yesterday, which the command does not make."""
    key, name = ec.generate_private_key(ec.SECP256R1()), x509.Name([])
    now = datetime.now(UTC)
    made = x509.CertificateBuilder(name, name, key.public_key(), 1, now - timedelta(9), now - timedelta(1))
    address = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    made = made.add_extension(address, critical=True).add_extension(x509.BasicConstraints(True, None), critical=True)
    certificate.cert.write_bytes(made.sign(key, hashes.SHA256()).public_bytes(Encoding.PEM))
    certificate.key.write_bytes(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))


class _Server(socketserver.ThreadingTCPServer):
    allow_reuse_address = True
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A peer that goes away or refuses the certificate is part of the tests."""


@contextmanager
def _serving(handler: type[socketserver.BaseRequestHandler], owner: Any, port: int) -> Iterator[int]:
    with _Server(("127.0.0.1", port), type("Handler", (handler,), {"owner": owner})) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            thread.join()


@dataclass
class Mail:
    """A mail server.

    Attributes:
        certificate: None offers no encryption.
        tls: encrypted from the first byte, rather than by STARTTLS.
        login: name and password that it asks for.
        refuse: refuses recipients whose address has this in it, such as "@".
        hang: takes the message and never answers.
        answer: to a message.
        received: the messages.
        clear: what came before encryption began.
        port: of the server, 0 for any.
    """

    certificate: Certificate | None = None
    tls: bool = False
    login: tuple[str, str] | None = None
    refuse: str | None = None
    hang: bool = False
    answer: str = "250 taken"
    port: int = 0
    received: list[EmailMessage] = field(default_factory=list)
    recipients: list[str] = field(default_factory=list)
    clear: list[str] = field(default_factory=list)
    hanging: threading.Event = field(default_factory=threading.Event)
    closed: threading.Event = field(default_factory=threading.Event)

    @contextmanager
    def serving(self) -> Iterator[Mail]:
        """Serve until the end of the block."""
        with _serving(_MailHandler, self, self.port) as self.port:
            try:
                yield self
            finally:
                self.closed.set()


class _MailHandler(socketserver.StreamRequestHandler):
    owner: Mail

    def handle(self) -> None:
        self.encrypted = False
        if self.owner.tls:
            self._encrypt()
        self._say("220 here")
        self.known = self.owner.login is None
        while line := self.rfile.readline().decode().strip():
            if not self.encrypted:
                self.owner.clear.append(line)
            word = line.split()[0].upper()
            if word == "QUIT":
                self._say("221 bye")
                return
            self._answer(word, line)

    def _answer(self, word: str, line: str) -> None:
        if word == "EHLO":
            offers = ["here"]
            if self.owner.certificate is not None and not self.encrypted:
                offers.append("STARTTLS")
            if self.owner.login is not None and self.encrypted:
                offers.append("AUTH PLAIN")
            for offer in offers[:-1]:
                self._say(f"250-{offer}")
            self._say(f"250 {offers[-1]}")
        elif word == "STARTTLS":
            self._say("220 go on")
            self._encrypt()
        elif word == "AUTH":
            given = base64.b64decode(line.split()[2]).decode().split("\0")[1:]
            self.known = tuple(given) == self.owner.login
            self._say("235 welcome" if self.known else f"535 not {given[1]}")
        elif word == "RCPT":
            self.owner.recipients.append(line)
            self._say("550 nobody" if self.owner.refuse is not None and self.owner.refuse in line else "250 ok")
        elif word == "DATA" and self.known:
            self._take()
        else:
            self._say("250 ok" if self.known else "530 log in first")

    def _take(self) -> None:
        self._say("354 go on")
        body = b""
        while (part := self.rfile.readline()) != b".\r\n":
            body += part
        if self.owner.hang:
            self.owner.hanging.set()
            self.owner.closed.wait(PATIENCE_S)
            return
        self.owner.received.append(email.message_from_bytes(body, EmailMessage, policy=email.policy.default))
        self._say(self.owner.answer)

    def _encrypt(self) -> None:
        assert self.owner.certificate is not None
        self.request = self.connection = self.owner.certificate.server.wrap_socket(self.request, server_side=True)
        self.rfile, self.wfile = self.connection.makefile("rb"), self.connection.makefile("wb", buffering=0)
        self.encrypted = True

    def finish(self) -> None:
        super().finish()
        self.request.close()

    def _say(self, text: str) -> None:
        self.wfile.write(f"{text}\r\n".encode())


@dataclass
class Hook:
    """A webhook: ``answers`` are its statuses in turn, then 204; ``received`` holds path, authorization and body."""

    certificate: Certificate | None = None
    answers: list[int] = field(default_factory=list)
    port: int = 0
    received: list[tuple[str, str | None, Any]] = field(default_factory=list)

    @contextmanager
    def serving(self) -> Iterator[Hook]:
        """Serve until the end of the block."""
        with _serving(_HookHandler, self, self.port) as self.port:
            yield self


class _HookHandler(http.server.BaseHTTPRequestHandler):
    owner: Hook

    def setup(self) -> None:
        if self.owner.certificate is not None:
            self.request = self.owner.certificate.server.wrap_socket(self.request, server_side=True)
        super().setup()

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        status = self.owner.answers.pop(0) if self.owner.answers else 204
        self.owner.received.append((self.path, self.headers.get("Authorization"), body))
        self.send_response(status)
        self.send_header("Location", "/elsewhere")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def finish(self) -> None:
        super().finish()
        self.request.close()

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Be silent."""


@dataclass
class Pulse:
    """A service that expects a signal: ``answers`` are its statuses in turn, then 200; ``received`` holds the paths."""

    answers: list[int] = field(default_factory=list)
    port: int = 0
    received: list[str] = field(default_factory=list)

    @property
    def url(self) -> str:
        """The address of the signal, with a secret in it."""
        return f"http://127.0.0.1:{self.port}/ping/secret?x=1"

    @contextmanager
    def serving(self) -> Iterator[Pulse]:
        """Serve until the end of the block."""
        with _serving(_PulseHandler, self, self.port) as self.port:
            yield self


class _PulseHandler(http.server.BaseHTTPRequestHandler):
    owner: Pulse

    def do_GET(self) -> None:
        self.owner.received.append(self.path)
        self.send_response(self.owner.answers.pop(0) if self.owner.answers else 200)
        self.send_header("Location", "/elsewhere")
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_request(self, code: int | str = "-", size: int | str = "-") -> None:
        """Be silent."""


@contextmanager
def subscribed(port: int, topic: str) -> Iterator[list[tuple[str, Any, bool]]]:
    """Give the list into which topic, JSON and retained flag of each message of a broker go."""
    heard: list[tuple[str, Any, bool]] = []
    ready = threading.Event()
    client = Client(CallbackAPIVersion.VERSION2)

    def on_connect(client: Client, *rest: Any) -> None:
        client.subscribe(topic, qos=1)

    client.on_connect = on_connect
    client.on_subscribe = lambda *rest: ready.set()
    client.on_message = lambda client, data, item: heard.append((item.topic, json.loads(item.payload), item.retain))
    client.connect("127.0.0.1", port)
    client.loop_start()
    try:
        assert ready.wait(PATIENCE_S)
        yield heard
    finally:
        end_client(client)
