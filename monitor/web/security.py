"""Access: checks on every request and headers of every answer, as ASGI middleware; signing in and out."""

from __future__ import annotations

import asyncio
import ipaddress
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from monitor.config.outputs import WebSection
from monitor.web.answers import json_object, without_folders
from monitor.web.auth import Caller, Doorkeeper, Visitor
from monitor.web.turns import SignInError
from monitor.web.users import User, UsersError, invite
from monitor.words.events import utc_text

MAX_BODY_BYTES = 8192
DEVICE_S = 180 * 86_400
"""How long a browser that signed in by name is known, so that the guesses of others do not delay it."""
_MAX_HEAD_BYTES, _MAX_TARGET_BYTES = 8192, 2048
_MAX_ANSWER_S, _MAX_SEND_S = 30.0, 20.0
_OPEN = ("/", "/login", "/logout", "/api/session", "/readyz")
"""Answered without a token: the empty page, which asks for one, and whether the page is served."""
_FOR_ADMINS = ("/api/users", "/api/desk")
_UNBOUNDED = ("/api/stream", "/records/")
"""Answers without a limit on their whole duration; the client must take each part in time."""
NOT_KEPT = {"cache-control": "no-store"}
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
    """Names under which the page is reached, and what needs a token."""

    hosts: frozenset[str]
    """Values of the Host header, in lower case."""
    port: int
    cookie: str
    """Name of the session cookie, which has the port, as browsers share cookies between ports."""
    secure: bool
    """Whether TLS is used."""
    reading: bool
    """Whether reading needs the token."""
    desk: bool = False
    """Whether there are folders for the import desk."""

    @classmethod
    def of(cls, web: WebSection, port: int) -> Doors:
        """Return those of a configuration that listens on ``port``."""
        secure = web.cert_file is not None
        hosts: set[str] = set()
        for name in ("localhost", "127.0.0.1", "[::1]", web.url_host, *web.allowed_hosts):
            given = name.lower()
            if given.rpartition(":")[2].isdigit() and not given.endswith("]"):
                hosts |= _spellings(given.rpartition(":")[0], int(given.rpartition(":")[2]))
            else:
                hosts |= _spellings(given, port)
        return cls(
            frozenset(hosts), port, f"spallwatch-{port}", secure, web.reading_needs_token, bool(web.import_folders)
        )

    def admits_host(self, host: str, server: str | None) -> bool:
        """Return whether a Host header names this page, or is the address ``server`` of the connection."""
        host = host.lower()
        if host in self.hosts:
            return True
        try:
            address = ipaddress.ip_address(server or "")
        except ValueError:
            return False
        literal = f"[{address}]" if address.version == 6 else str(address)
        return host in _spellings(literal, self.port)


def _spellings(name: str, port: int) -> set[str]:
    """Return how browsers write a name and a port: the usual ports of HTTP are left out."""
    return {f"{name}:{port}", name} if port in (80, 443) else {f"{name}:{port}"}


@dataclass(frozen=True)
class _Refusal:
    status: int
    sentence: str
    headers: Mapping[str, str] = field(default_factory=dict)


class Guard:
    """ASGI middleware: refuse requests, set headers, end slow answers, measure.

    It is used instead of Starlette's TrustedHostMiddleware (which ignores the port and the address of the connection),
    SessionMiddleware (whose sessions cannot be ended) and GZipMiddleware (which packs in the event loop).
    """

    def __init__(
        self,
        app: ASGIApp,
        doors: Doors,
        keeper: Doorkeeper,
        measured: Callable[[str, int, float], object] = lambda *_: None,
    ) -> None:
        """Guard an application; ``measured`` is called with path, status and seconds of each answer."""
        self._app, self._doors, self._keeper, self._measured = app, doors, keeper, measured
        self._headers = dict(_HEADERS)
        if doors.secure:
            self._headers["strict-transport-security"] = "max-age=31536000"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            raise RuntimeError(f"expected a request over HTTP, found {scope['type']}")
        began, status = time.monotonic(), 0

        async def guarded_send(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message).update(self._headers)
            # The connection of a client that does not take its answer is ended.
            async with asyncio.timeout(_MAX_SEND_S):
                await send(message)

        try:
            await self._answer(scope, receive, guarded_send)
        except TimeoutError:
            if status == 0:
                await _refuse(scope, receive, guarded_send, _Refusal(503, "the answer takes too long"))
        finally:
            self._measured(scope["path"], status, time.monotonic() - began)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = HTTPConnection(scope)
        refusal = self._check(scope, request.headers)
        if refusal is not None:
            await _refuse(scope, receive, send, refusal)
            return
        secret = request.cookies.get(self._doors.cookie)
        visitor = None if secret is None else self._keeper.visitor(secret)
        bearer = self._bearer(request.headers)
        scope["state"]["session"] = None if visitor is None else secret
        scope["state"]["visitor"] = Visitor() if bearer is True else visitor
        refusal = self._check_rights(scope, request.headers, by_cookie=visitor is not None and bearer is not True)
        if bearer is False:
            refusal = _Refusal(429, "too many wrong tokens; try again later")
            if await self._keeper.delay_wrong_token():
                refusal = _Refusal(401, "the token is wrong")
        if refusal is not None:
            await _refuse(scope, receive, send, refusal)
        elif scope["path"].startswith(_UNBOUNDED):
            await self._app(scope, receive, send)
        else:
            async with asyncio.timeout(_MAX_ANSWER_S):
                await self._app(scope, receive, send)

    def _check(self, scope: Scope, headers: Headers) -> _Refusal | None:
        """Return why a request is refused whatever its credentials."""
        if len(scope["raw_path"]) + len(scope["query_string"]) > _MAX_TARGET_BYTES:
            return _closing(414, "the address is too long")
        if sum(len(key) + len(value) + 4 for key, value in scope["headers"]) > _MAX_HEAD_BYTES:
            return _closing(431, "the headers are too long")
        host = headers.getlist("host")
        server = scope.get("server") or (None, None)
        if len(host) != 1 or not self._doors.admits_host(host[0], server[0]):
            return _closing(421, "this is not a name of the page; names are listed in [web] allowed_hosts")
        if not self._same_origin(headers, host[0]):
            return _closing(403, "requests of other pages are not answered")
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return _Refusal(405, "only GET and POST are answered", {"allow": "GET, HEAD, POST"})
        return _check_body(scope["method"], headers)

    def _same_origin(self, headers: Headers, host: str) -> bool:
        origins = headers.getlist("origin")
        if not origins:
            return True
        found = urlsplit(origins[0])
        schemes = ("https",) if self._doors.secure else ("http", "https")
        return len(origins) == 1 and found.scheme in schemes and found.netloc.lower() == host.lower()

    def _bearer(self, headers: Headers) -> bool | None:
        """Return whether the token of a request is right; None where it has none."""
        given = headers.getlist("authorization")
        if not given:
            return None
        kind, _, token = given[0].partition(" ")
        return len(given) == 1 and kind.lower() == "bearer" and self._keeper.is_token(token.strip())

    def _check_rights(self, scope: Scope, headers: Headers, *, by_cookie: bool) -> _Refusal | None:
        path, posting = scope["path"], scope["method"] == "POST"
        free = path in _OPEN or path.startswith("/static/")
        visitor: Visitor | None = scope["state"]["visitor"]
        for_admins = path.startswith(_FOR_ADMINS)
        if visitor is None and not free and (posting or for_admins or self._doors.reading):
            return _Refusal(401, "this needs a sign-in, or the token of the page", {"www-authenticate": "Bearer"})
        if visitor is not None and not free and posting and not visitor.may_acknowledge:
            return _Refusal(403, f"{visitor.name} is a {visitor.role}, and may only read")
        if visitor is not None and for_admins and visitor.role != "admin":
            return _Refusal(403, f"{visitor.name} is no admin")
        if not posting:
            return None
        kind = headers.get("content-type", "").partition(";")[0].strip().lower()
        if kind != "application/json":
            return _closing(415, "the body must be JSON (Content-Type: application/json)")
        if by_cookie and "origin" not in headers:
            return _closing(403, "a request with a cookie must say where it comes from (Origin)")
        return None


def _check_body(method: str, headers: Headers) -> _Refusal | None:
    length = headers.getlist("content-length") or ["0"]
    if "transfer-encoding" in headers:
        return _closing(411, "the length of the body must be given (Content-Length)")
    if len(length) != 1 or not length[0].isdigit() or int(length[0]) > MAX_BODY_BYTES:
        return _closing(413, f"a body may have {MAX_BODY_BYTES} bytes")
    if method != "POST" and int(length[0]):
        return _closing(400, "a request for reading has no body")
    return None


def _closing(status: int, sentence: str) -> _Refusal:
    """Return a refusal after which the connection ends, as the rest of the request is not read."""
    return _Refusal(status, sentence, {"connection": "close"})


async def _refuse(scope: Scope, receive: Receive, send: Send, refusal: _Refusal) -> None:
    headers = {**NOT_KEPT, **refusal.headers}
    await JSONResponse({"error": refusal.sentence}, refusal.status, headers)(scope, receive, send)


def sign_in_routes(doors: Doors, keeper: Doorkeeper) -> list[Route]:
    """Return the addresses; a cookie that scripts cannot read takes the place of the token or the password."""
    device = f"{doors.cookie}-device"

    async def login(request: Request) -> Response:
        given = json_object((await request.body())[:MAX_BODY_BYTES]) or {}
        caller = Caller(
            "" if request.client is None else request.client.host,
            request.cookies.get(device, ""),
            request.state.visitor is not None,
        )
        try:
            user = await _user_of(keeper, given, caller)
        except SignInError as error:
            return _error(error.status, error.sentence)
        except UsersError as error:
            return _error(503, without_folders(str(error)))
        response = Response(status_code=204, headers=NOT_KEPT)
        secret = keeper.open_session(user)
        response.set_cookie(doors.cookie, secret, httponly=True, samesite="strict", secure=doors.secure, path="/")
        if user is not None:
            shown = keeper.device_cookie(user)
            response.set_cookie(
                device, shown, DEVICE_S, httponly=True, samesite="strict", secure=doors.secure, path="/login"
            )
        return response

    async def logout(request: Request) -> Response:
        await request.body()
        if request.state.session is not None:
            keeper.close_session(request.state.session)
        response = Response(status_code=204, headers=NOT_KEPT)
        response.delete_cookie(doors.cookie, httponly=True, samesite="strict", secure=doors.secure, path="/")
        return response

    async def session(request: Request) -> Response:
        visitor: Visitor | None = request.state.visitor
        found = {
            "authorized": visitor is not None,
            "needs_token": doors.reading,
            "can_acknowledge": visitor is not None and visitor.may_acknowledge,
            "user": None if visitor is None else visitor.name,
            "role": None if visitor is None else visitor.role,
            "users": keeper.has_users,
            "desk": doors.desk,
        }
        return JSONResponse(found, headers=NOT_KEPT)

    async def users(_: Request) -> Response:
        known = {} if keeper.users is None else keeper.users.all()
        found = [{"name": user.name, "role": user.role, "invited": bool(user.invite)} for user in known.values()]
        return JSONResponse({"users": found}, headers=NOT_KEPT)

    async def invitation(request: Request) -> Response:
        name = (json_object((await request.body())[:MAX_BODY_BYTES]) or {}).get("name")
        if keeper.users is None or not isinstance(name, str) or name not in keeper.users.all():
            return _error(404, "there is no such user")
        try:
            code, until = await asyncio.to_thread(invite, keeper.users.path, name)
        except UsersError as error:
            return _error(503, without_folders(str(error)))
        return JSONResponse({"name": name, "code": code, "until_utc": utc_text(until)}, headers=NOT_KEPT)

    return [
        Route("/login", login, methods=["POST"]),
        Route("/logout", logout, methods=["POST"]),
        Route("/api/session", session, methods=["GET"]),
        Route("/api/users", users, methods=["GET"]),
        Route("/api/users/invite", invitation, methods=["POST"]),
    ]


async def _user_of(keeper: Doorkeeper, given: dict[str, Any], caller: Caller) -> User | None:
    """Return who signs in, None for the holder of the token; :class:`SignInError` where that is refused."""
    token, name, code, password = (given.get(key) for key in ("token", "name", "code", "password"))
    if isinstance(name, str) and isinstance(password, str):
        return await keeper.sign_in(name, password, caller)
    if isinstance(code, str) and isinstance(password, str):
        return await keeper.redeem(code.strip(), password)
    if not isinstance(token, str):
        raise SignInError(
            400, "the body must be a JSON object with the token, or name and password, or code and password"
        )
    if not keeper.is_token(token.strip()):
        if await keeper.delay_wrong_token():
            raise SignInError(401, "the token is wrong")
        raise SignInError(429, "too many wrong tokens; try later")
    return None


def _error(status: int, sentence: str) -> Response:
    return JSONResponse({"error": sentence}, status, headers=NOT_KEPT)
