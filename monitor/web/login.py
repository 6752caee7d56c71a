"""Routes to log in and out: a cookie that scripts cannot read replaces the token."""

from __future__ import annotations

import json

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from monitor.web.auth import Doorkeeper
from monitor.web.security import MAX_BODY_BYTES, Doors

_NOT_KEPT = {"cache-control": "no-store"}


def login_routes(doors: Doors, keeper: Doorkeeper) -> list[Route]:
    """Return the addresses for logging in and out."""

    async def login(request: Request) -> Response:
        body = await request.body()
        try:
            token = json.loads(body[:MAX_BODY_BYTES])["token"]
        except (ValueError, KeyError, TypeError):
            token = None
        if not isinstance(token, str):
            return _error(400, "the body must be a JSON object with the token")
        if not keeper.knows(token.strip()):
            waited = await keeper.delay_wrong_token()
            return _error(401, "the token is wrong") if waited else _error(429, "too many wrong tokens; try later")
        response = Response(status_code=204, headers=_NOT_KEPT)
        response.set_cookie(
            doors.cookie, keeper.open_session(), httponly=True, samesite="strict", secure=doors.secure, path="/"
        )
        return response

    async def logout(request: Request) -> Response:
        await request.body()
        if request.state.session is not None:
            keeper.close_session(request.state.session)
        response = Response(status_code=204, headers=_NOT_KEPT)
        response.delete_cookie(doors.cookie, httponly=True, samesite="strict", secure=doors.secure, path="/")
        return response

    async def session(request: Request) -> Response:
        authorized = bool(request.state.authorized)
        found = {"authorized": authorized, "needs_token": doors.reading, "can_acknowledge": authorized}
        return JSONResponse(found, headers=_NOT_KEPT)

    return [
        Route("/login", login, methods=["POST"]),
        Route("/logout", logout, methods=["POST"]),
        Route("/api/session", session, methods=["GET"]),
    ]


def _error(status: int, sentence: str) -> Response:
    return JSONResponse({"error": sentence}, status, headers=_NOT_KEPT)
