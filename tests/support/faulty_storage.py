"""An object storage whose network and server fail as they are told: an HTTP proxy before a server that speaks S3.

Each request is shown to a rule, which may spoil its answer. Requests are passed on as they came, so that signatures
stay valid.
"""

from __future__ import annotations

import hashlib
import http.client
import socket
import struct
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Literal, cast
from urllib.parse import urlsplit

import pytest

How = Literal["refuse", "answer", "reset", "cut", "lose", "damage", "shorten", "delay"]
_CHECKSUMS = "x-amz-checksum"
_HOP_BY_HOP = ("connection", "transfer-encoding", "content-length", "keep-alive")


@dataclass(frozen=True)
class Request:
    """A request: its method, path with bucket, query, and how often the same one has come, this time included."""

    method: str
    path: str
    query: str
    times: int


@dataclass(frozen=True)
class Fault:
    """What becomes of a request.

    Attributes:
        how: "refuse": an answer with an error, and the request is not passed on; "answer": ``body`` instead of it;
            "reset": the connection is reset before it is passed on; "cut": half of the body is sent; "lose": it is
            carried out and its answer is lost; "damage": half of the body is sent, as if it were all, with its
            checksum; "shorten": the same without a checksum, which not every server has; "delay": it waits.
        status, code: of a refusal, such as 503 and "SlowDown".
        seconds: of a delay.
        body: of an answer.
    """

    how: How
    status: int = 503
    code: str = "SlowDown"
    seconds: float = 0.0
    body: bytes = b""


Rule = Callable[[Request], Fault | None]


def no_fault(_request: Request) -> Fault | None:
    """Pass all requests on."""
    return None


TRANSIENT = (
    Fault("refuse"),
    Fault("refuse", 500, "InternalError"),
    Fault("refuse", 502, "BadGateway"),
    Fault("reset"),
    Fault("cut"),
    Fault("lose"),
    Fault("damage"),
    Fault("delay", seconds=0.02),
)
"""Faults of the moment, which a repeated request overcomes."""


def at_random(seed: int, share: float, most: int = 2, faults: tuple[Fault, ...] = TRANSIENT) -> Rule:
    """Return a rule that spoils a share of the requests, each one so many times at most.

    What happens to a request depends on the seed, on what it asks for and on how often it came, not on the order.
    """

    def rule(request: Request) -> Fault | None:
        text = f"{seed} {request.method} {request.path} {request.query} {request.times}"
        drawn = int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")
        if request.times > most or drawn / 2**64 >= share:
            return None
        return faults[drawn % len(faults)]

    return rule


@dataclass
class FaultyStorage:
    """A running proxy.

    Attributes:
        endpoint: URL, which takes the place of that of the server.
        rule: says what becomes of each request; may be exchanged at any moment.
        requests: how many came.
        faults: how many were spoiled, by how.
    """

    endpoint: str
    rule: Rule = no_fault
    requests: int = 0
    faults: Counter[str] = field(default_factory=Counter[str])
    _seen: Counter[str] = field(default_factory=Counter[str])
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def begin(self) -> None:
        """Pass all on, as if nothing had come yet."""
        with self._lock:
            self.rule, self.requests = no_fault, 0
            self.faults.clear()
            self._seen.clear()

    def fault_of(self, method: str, target: str) -> Fault | None:
        """Count a request and return what becomes of it."""
        parts = urlsplit(target)
        with self._lock:
            self.requests += 1
            self._seen[f"{method} {target}"] += 1
            times = self._seen[f"{method} {target}"]
        found = self.rule(Request(method, parts.path, parts.query, times))
        if found is not None:
            with self._lock:
                self.faults[found.how if found.how != "refuse" else found.code] += 1
        return found


@contextmanager
def faulty_storage(port: int) -> Iterator[FaultyStorage]:
    """Listen on a port of its own, and pass on to another one of this machine."""
    with _Proxy(port) as proxy:
        thread = threading.Thread(target=proxy.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        try:
            yield proxy.state
        finally:
            proxy.stopped.set()
            proxy.shutdown()
            thread.join()


class _Proxy(ThreadingHTTPServer):
    """The proxy as a server."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, target: int) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.target = target
        self.state = FaultyStorage(f"http://127.0.0.1:{self.server_port}")
        self.stopped = threading.Event()

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of clients that go away."""


class _Handler(BaseHTTPRequestHandler):
    """One connection of a client."""

    protocol_version = "HTTP/1.1"
    # Else the parts of an answer wait for each other's acknowledgement.
    disable_nagle_algorithm = True

    @property
    def proxy(self) -> _Proxy:
        """The proxy."""
        return cast("_Proxy", self.server)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Say nothing."""

    def answer(self) -> None:
        """Pass a request on, or do what the rule says."""
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        fault = self.proxy.state.fault_of(self.command, self.path)
        if fault is None:
            self._pass_on(body, None)
        elif fault.how == "refuse":
            self._send(fault.status, {}, _error_text(fault.code))
        elif fault.how == "answer":
            self._send(200, {"ETag": '"0"', "Content-Type": "application/xml"}, fault.body)
        elif fault.how == "reset":
            self._reset()
        else:
            if fault.how == "delay":
                self.proxy.stopped.wait(fault.seconds)
            self._pass_on(body, fault.how)

    do_GET = do_PUT = do_POST = do_DELETE = do_HEAD = answer  # noqa: N815

    def _pass_on(self, body: bytes, how: How | None) -> None:
        link = http.client.HTTPConnection("127.0.0.1", self.proxy.target, timeout=60)
        try:
            link.putrequest(self.command, self.path, skip_host=True, skip_accept_encoding=True)
            for name, value in self.headers.items():
                if name.lower() not in ("connection", "expect"):
                    link.putheader(name, value)
            link.endheaders(body)
            answer = link.getresponse()
            found = answer.read()
        finally:
            link.close()
        if how == "lose":
            self._reset()
            return
        headers = {name: value for name, value in answer.getheaders() if name.lower() not in _HOP_BY_HOP}
        if how in ("damage", "shorten"):
            found = found[: len(found) // 2]
        if how == "shorten":
            headers = {name: value for name, value in headers.items() if not name.lower().startswith(_CHECKSUMS)}
        # Of HEAD, the length is that of what is not sent.
        stated = int(answer.getheader("Content-Length") or 0) if self.command == "HEAD" else len(found)
        self._send(answer.status, headers, found, stated, cut=how == "cut")

    def _send(
        self, status: int, headers: dict[str, str], body: bytes, size: int | None = None, *, cut: bool = False
    ) -> None:
        self.send_response_only(status)
        for name, value in headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body) if size is None else size))
        self.end_headers()
        if cut:
            self.wfile.write(body[: len(body) // 2])
            self.close_connection = True
        elif self.command != "HEAD":
            self.wfile.write(body)

    def _reset(self) -> None:
        with suppress(OSError):
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self.close_connection = True


def _error_text(code: str) -> bytes:
    text = f"<Error><Code>{code}</Code><Message>made by a test</Message><RequestId>1</RequestId></Error>"
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + text.encode()


def without_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let file systems that this process opens from now on repeat their requests at once."""
    from botocore import retryhandler

    from models.work import filesystem

    monkeypatch.setattr(retryhandler, "delay_exponential", lambda base, growth_factor, attempts: 0.0)
    monkeypatch.setattr(filesystem, "_PAUSES_S", (0.0,) * len(filesystem._PAUSES_S))
    monkeypatch.setattr(filesystem, "_S3_ROUNDS", 1)
