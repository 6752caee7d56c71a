"""What every request must pass before it is answered, and what every answer says to browsers."""

from __future__ import annotations

import asyncio
import ipaddress
import json
import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from monitor.config.web import WebSection
from monitor.web.auth import Doorkeeper

_LOG = logging.getLogger(__name__)
MOST_BODY = 8192
_MOST_HEAD, _MOST_TARGET = 8192, 2048
_LONGEST_ANSWER, _LONGEST_SEND = 30.0, 20.0
_OPEN = ("/", "/login", "/logout", "/api/session", "/readyz")
"""What is answered without a token: the bare page, which asks for one, and whether there is anybody."""
_UNBOUNDED = ("/api/stream", "/records/")
"""Answers that may take long as a whole; each part of them must be taken in time."""
_HEADERS = {
    "content-security-policy": "default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; "
    "form-action 'self'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-embedder-policy": "require-corp",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
}


@dataclass(frozen=True)
class Doors:
    """Under which names the page is reached, and for what it asks for a token.

    Attributes:
        hosts: values of the Host header, in lower case.
        port: it listens on.
        cookie: name of the cookie of a session, another for each port, as browsers do not tell ports apart.
        secure: whether it speaks TLS.
        reading: whether reading needs the token.
    """

    hosts: frozenset[str]
    port: int
    cookie: str
    secure: bool
    reading: bool

    @classmethod
    def of(cls, web: WebSection, port: int) -> Doors:
        """Return those of a configuration.

        Args:
            web: the configuration.
            port: that it listens on.
        """
        secure = web.cert_file is not None
        host = f"[{web.host}]" if ":" in web.host else web.host
        hosts: set[str] = set()
        for name in ("localhost", "127.0.0.1", "[::1]", host, *web.allowed_hosts):
            given = name.lower()
            if given.rpartition(":")[2].isdigit() and not given.endswith("]"):
                hosts |= _spelt(given.rpartition(":")[0], int(given.rpartition(":")[2]))
            else:
                hosts |= _spelt(given, port)
        return cls(frozenset(hosts), port, f"spallwatch-{port}", secure, web.reading_needs_token)

    def admits_host(self, host: str, server: str | None) -> bool:
        """Return whether a Host header names this page.

        Args:
            host: the header.
            server: the address that the connection came to; a name that somebody else's server resolves to it is not
                that address.
        """
        host = host.lower()
        if host in self.hosts:
            return True
        try:
            address = ipaddress.ip_address(server or "")
        except ValueError:
            return False
        literal = f"[{address}]" if address.version == 6 else str(address)
        return host in _spelt(literal, self.port)


def _spelt(name: str, port: int) -> set[str]:
    """Return how browsers write a name and a port: the usual ports of HTTP are left out."""
    return {f"{name}:{port}", name} if port in (80, 443) else {f"{name}:{port}"}


@dataclass(frozen=True)
class _No:
    status: int
    sentence: str
    headers: tuple[tuple[bytes, bytes], ...] = ()


class Guard:
    """ASGI middleware: refuses, sets the headers of all answers, ends what takes too long, and measures."""

    def __init__(
        self,
        app: ASGIApp,
        doors: Doors,
        keeper: Doorkeeper,
        measured: Callable[[str, int, float], object] = lambda *_: None,
    ) -> None:
        """Take what is guarded.

        Args:
            app: the application.
            doors: how it is reached.
            keeper: who knows the token.
            measured: is told the path, the status and the seconds of each answer.
        """
        self._app, self._doors, self._keeper, self._measured = app, doors, keeper, measured

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            raise RuntimeError(f"nothing but HTTP is spoken here, not {scope['type']}")
        began, status = time.monotonic(), 0

        async def guarded_send(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message.get("headers", ()), *self._headers()]
            # A client that does not take its answer is given up.
            async with asyncio.timeout(_LONGEST_SEND):
                await send(message)

        try:
            await self._answer(scope, receive, guarded_send)
        except TimeoutError:
            if status == 0:
                await _refuse(guarded_send, _No(503, "the answer takes too long"))
        finally:
            self._measured(scope["path"], status, time.monotonic() - began)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = _headers_of(scope)
        no = self._check(scope, headers)
        if no is not None:
            await _refuse(send, no)
            return
        bearer, session = self._credentials(headers)
        scope["state"]["authorized"] = bearer is True or session
        scope["state"]["session"] = _cookie(headers, self._doors.cookie) if session else None
        no = self._check_rights(scope, headers, by_cookie=session and bearer is not True)
        if bearer is False:
            patient = await self._keeper.punish()
            no = _No(401, "the token is wrong") if patient else _No(429, "too many wrong tokens; try again later")
        if no is not None:
            await _refuse(send, no)
        elif scope["path"].startswith(_UNBOUNDED):
            await self._app(scope, receive, send)
        else:
            async with asyncio.timeout(_LONGEST_ANSWER):
                await self._app(scope, receive, send)

    def _check(self, scope: Scope, headers: Mapping[str, list[str]]) -> _No | None:
        """Return why a request is refused, whoever sent it."""
        if len(scope["raw_path"]) + len(scope["query_string"]) > _MOST_TARGET:
            return _closing(414, "the address is too long")
        if sum(len(key) + len(value) + 4 for key, value in scope["headers"]) > _MOST_HEAD:
            return _closing(431, "the headers are too long")
        host = headers.get("host", [])
        server = scope.get("server") or (None, None)
        if len(host) != 1 or not self._doors.admits_host(host[0], server[0]):
            return _closing(421, "this is not a name of the page; names are listed in [web] allowed_hosts")
        if not self._same_origin(headers, host[0]):
            return _closing(403, "requests of other pages are not answered")
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return _No(405, "only GET and POST are answered", ((b"allow", b"GET, HEAD, POST"),))
        return _check_body(scope["method"], headers)

    def _same_origin(self, headers: Mapping[str, list[str]], host: str) -> bool:
        origins = headers.get("origin", [])
        if not origins:
            return True
        found = urlsplit(origins[0])
        schemes = ("https",) if self._doors.secure else ("http", "https")
        return len(origins) == 1 and found.scheme in schemes and found.netloc.lower() == host.lower()

    def _credentials(self, headers: Mapping[str, list[str]]) -> tuple[bool | None, bool]:
        """Return whether the token that was given is right (None: none was), and whether a session is open."""
        secret = _cookie(headers, self._doors.cookie)
        session = secret is not None and self._keeper.has_session(secret)
        given = headers.get("authorization", [])
        if not given:
            return None, session
        kind, _, token = given[0].partition(" ")
        return len(given) == 1 and kind.lower() == "bearer" and self._keeper.knows(token.strip()), session

    def _check_rights(self, scope: Scope, headers: Mapping[str, list[str]], *, by_cookie: bool) -> _No | None:
        path, posting = scope["path"], scope["method"] == "POST"
        free = path in _OPEN or path.startswith("/static/")
        if not scope["state"]["authorized"] and not free and (posting or self._doors.reading):
            return _No(401, "this needs the token of the page", ((b"www-authenticate", b"Bearer"),))
        if not posting:
            return None
        kind = headers.get("content-type", [""])[0].partition(";")[0].strip().lower()
        if kind != "application/json":
            return _closing(415, "the body must be JSON (Content-Type: application/json)")
        if by_cookie and "origin" not in headers:
            return _closing(403, "a request with a cookie must say where it comes from (Origin)")
        return None

    def _headers(self) -> list[tuple[bytes, bytes]]:
        headers = [(key.encode(), value.encode()) for key, value in _HEADERS.items()]
        if self._doors.secure:
            headers.append((b"strict-transport-security", b"max-age=31536000"))
        return headers


def _check_body(method: str, headers: Mapping[str, list[str]]) -> _No | None:
    length = headers.get("content-length", ["0"])
    if "transfer-encoding" in headers:
        return _closing(411, "the length of the body must be given (Content-Length)")
    if len(length) != 1 or not length[0].isdigit() or int(length[0]) > MOST_BODY:
        return _closing(413, f"a body may have {MOST_BODY} bytes")
    if method != "POST" and int(length[0]):
        return _closing(400, "a request for reading has no body")
    return None


def _closing(status: int, sentence: str) -> _No:
    """Return a refusal after which the connection ends, as its rest is not read."""
    return _No(status, sentence, ((b"connection", b"close"),))


async def _refuse(send: Send, no: _No) -> None:
    body = json.dumps({"error": no.sentence}).encode()
    headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode())]
    cache = (b"cache-control", b"no-store")
    await send({"type": "http.response.start", "status": no.status, "headers": [*headers, cache, *no.headers]})
    await send({"type": "http.response.body", "body": body})


def _headers_of(scope: Scope) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for key, value in scope["headers"]:
        found.setdefault(key.decode("latin-1"), []).append(value.decode("latin-1"))
    return found


def _cookie(headers: Mapping[str, list[str]], name: str) -> str | None:
    try:
        found = SimpleCookie("; ".join(headers.get("cookie", ()))).get(name)
    except CookieError:
        return None
    return None if found is None else found.value
