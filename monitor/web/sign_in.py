"""Signing in and out, the present session, and the invitation of users: addresses of the page."""

from __future__ import annotations

import asyncio
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from monitor.web.answers import json_object, without_folders
from monitor.web.auth import Doorkeeper, SignInError, Visitor
from monitor.web.security import MAX_BODY_BYTES, NOT_KEPT, Doors
from monitor.web.users import User, UsersError, invite
from monitor.words.events import utc_text


def sign_in_routes(doors: Doors, keeper: Doorkeeper) -> list[Route]:
    """Return the addresses; a cookie that scripts cannot read takes the place of the token or the password."""

    async def login(request: Request) -> Response:
        given = json_object((await request.body())[:MAX_BODY_BYTES]) or {}
        try:
            user = await _user_of(keeper, given)
        except SignInError as error:
            return _error(error.status, error.sentence)
        except UsersError as error:
            return _error(503, without_folders(str(error)))
        response = Response(status_code=204, headers=NOT_KEPT)
        secret = keeper.open_session(user)
        response.set_cookie(doors.cookie, secret, httponly=True, samesite="strict", secure=doors.secure, path="/")
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


async def _user_of(keeper: Doorkeeper, given: dict[str, Any]) -> User | None:
    """Return who signs in, None for the holder of the token; :class:`SignInError` where that is refused."""
    token, name, code, password = (given.get(key) for key in ("token", "name", "code", "password"))
    if isinstance(name, str) and isinstance(password, str):
        return await keeper.sign_in(name, password)
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
