"""The token of the page, and the sessions of browsers that have sent it or the password of a user."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import os
import secrets
import stat
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from models.platform.portable import NO_LINK, NO_WAIT, others_may
from models.words.errors import SpallwatchError
from monitor.web.turns import CHECKS, SignInError, SignInTurns
from monitor.web.users import Role, User, Users
from streams.link.front import client_of

_MIN_TOKEN_CHARACTERS = 16
_MAX_SESSIONS = 1000
_SESSION_S = 12 * 3600.0
_WRONG_TOKEN_S = 1.0
_MAX_HELD = 64
"""Answers to wrong tokens and codes that are held back at the same time; beyond, they are refused at once."""
_MAX_REMEMBERED = 1000


class TokenError(SpallwatchError):
    """The token cannot be used; the message names the file and what is wrong with it."""


def load_token(path: Path, *, make: bool) -> str:
    """Return the token in a file: its first line.

    A file that others can read or write is refused; its group may read it, as service managers pass secrets that way.
    A missing file is created with ``make``: 32 random bytes, readable by its owner only.

    Raises:
        TokenError: the file is missing, unreadable, open to others, or its token is too short.
    """
    try:
        if make and not path.exists():
            _make(path)
        descriptor = os.open(path, os.O_RDONLY | NO_WAIT)
        try:
            _check_mode(path, os.fstat(descriptor).st_mode)
            token = os.read(descriptor, 4096).partition(b"\n")[0].decode("utf-8").strip()
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        raise TokenError(f"{path}: there is no such file; its first line is to be the token of the page") from None
    except (OSError, UnicodeDecodeError) as error:
        raise TokenError(f"{path}: cannot be read ({error})") from None
    if len(token) < _MIN_TOKEN_CHARACTERS or not token.isascii() or not token.isprintable():
        raise TokenError(f"{path}: the token must have at least {_MIN_TOKEN_CHARACTERS} printable ASCII characters")
    return token


def _check_mode(path: Path, mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise TokenError(f"{path}: is not a file")
    if others_may(mode, 0o026):
        raise TokenError(f"{path}: others may read or change it; make it safe with: chmod 600 {path}")


def _make(path: Path) -> None:
    """Create a token file atomically; an existing one is kept."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with suppress(FileNotFoundError):
        temporary.unlink()
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(secrets.token_urlsafe(32) + "\n")
            file.flush()
            os.fsync(descriptor)
        with suppress(FileExistsError):
            path.hardlink_to(temporary)
    finally:
        temporary.unlink()


@dataclass(frozen=True)
class Visitor:
    """Who sends a request: a user with a role, or the holder of the token, who has no name and may do everything."""

    name: str | None = None
    role: Role = "admin"

    @property
    def may_acknowledge(self) -> bool:
        """Whether the role allows it."""
        return self.role != "viewer"


@dataclass(frozen=True)
class _Session:
    """An open session: until when (s, monotonic), of whom, and the digest of the password that opened it."""

    until: float
    name: str | None = None
    password: bytes = b""


@dataclass(frozen=True)
class Caller:
    """Who tries to sign in: the address, the cookie of a browser that was signed in before, and whether it is now."""

    address: str = ""
    device: str = ""
    signed_in: bool = False


STRANGER = Caller()


class Doorkeeper:
    """The token, by its digest, the users, and the open sessions; used in the event loop only."""

    def __init__(self, token: str, users: Users | None = None, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Keep the digest of the token, and the users where there are any."""
        self._digest = _digest(token)
        self._monotonic = monotonic
        self.users = users
        self._turns = SignInTurns(monotonic)
        self._hashing = ThreadPoolExecutor(CHECKS, "passwords")
        self._right: dict[str, None] = {}
        self._sessions: dict[bytes, _Session] = {}
        self._held = 0
        self._device_key = hmac.digest(token.encode(), b"devices", "sha256")

    def is_token(self, token: str) -> bool:
        """Return whether this is the token, in a time that does not depend on where it differs."""
        return hmac.compare_digest(_digest(token), self._digest)

    @property
    def has_users(self) -> bool:
        """Whether anybody can sign in by name."""
        return self.users is not None and bool(self.users.all())

    def open_session(self, user: User | None = None) -> str:
        """Return the secret of a new session, of a user or of the token; beyond the limit, the oldest session ends."""
        self._forget_old()
        while len(self._sessions) >= _MAX_SESSIONS:
            self._sessions.pop(next(iter(self._sessions)))
        secret = secrets.token_urlsafe(32)
        until = self._monotonic() + _SESSION_S
        session = _Session(until) if user is None else _Session(until, user.name, _digest(user.password))
        self._sessions[_digest(secret)] = session
        return secret

    def visitor(self, secret: str) -> Visitor | None:
        """Return whose session is open, with the present role, or None.

        The sessions of a user end when the user is removed or gets another password.
        """
        self._forget_old()
        session = self._sessions.get(_digest(secret))
        if session is None or session.name is None:
            return None if session is None else Visitor()
        user = None if self.users is None else self.users.all().get(session.name)
        if user is None or not hmac.compare_digest(_digest(user.password), session.password):
            self.close_session(secret)
            return None
        return Visitor(user.name, user.role)

    async def sign_in(self, name: str, password: str, caller: Caller = STRANGER) -> User:
        """Return the user of a name and a password.

        Wrong passwords are counted by name and client, and by browser for one that signed in by this name before, so
        that a stranger's make none wait but the stranger's next.

        Raises:
            SignInError: 401 they are wrong, said after a second; 429 too many wait.
        """
        client, device = client_of(caller.address), self._device(caller.device, name)
        key = f"{client} {_digest(name).hex()}" if device is None else f"device {device}"
        known = caller.signed_in or device is not None or key in self._right
        async with self._turns.turn(client, key, known=known):
            user = await asyncio.get_running_loop().run_in_executor(self._hashing, self._check, name, password)
            if user is None:
                self._turns.guesses.wrong(key)
            else:
                self._turns.guesses.right(key)
                self._right.pop(key, None)
                self._right[key] = None
        while len(self._right) > _MAX_REMEMBERED:
            self._right.pop(next(iter(self._right)))
        if user is None:
            await asyncio.sleep(_WRONG_TOKEN_S)
            raise SignInError(401, "name or password is wrong")
        return user

    def _check(self, name: str, password: str) -> User | None:
        """Return the user whose name and password these are; runs in a thread of the pool."""
        if self.users is None or not self.users.is_password(name, password):
            return None
        self.users.renew(name, password)
        return self.users.all().get(name)

    async def redeem(self, code: str, password: str) -> User:
        """Return the user whom a code invites, with the new password; only a right code costs a hash.

        Raises:
            SignInError: 400 the password is too short or too long; 401 the code invites nobody, said after a second;
                429 too many wait.
            UsersError: the file of users cannot be changed.
        """
        user = None
        if self.users is not None and self.users.invited(code) is not None:
            async with self._turns.turn("", "code", known=True):
                redeem = partial(self.users.redeem, code, password)
                try:
                    user = await asyncio.get_running_loop().run_in_executor(self._hashing, redeem)
                except ValueError as error:
                    raise SignInError(400, str(error)) from None
        if user is None:
            if not await self.delay_wrong_token():
                raise SignInError(429, "too many wrong codes; try again later")
            raise SignInError(401, "this code is wrong, used or older than a day; ask for a new one")
        return user

    def device_cookie(self, user: User) -> str:
        """Return what a browser that signed in by a name shows at its next sign-in; another password ends it."""
        nonce = secrets.token_urlsafe(12)
        return f"{nonce}.{self._device_sign(user, nonce)}"

    def _device_sign(self, user: User, nonce: str) -> str:
        return hmac.digest(self._device_key, f"{nonce} {user.name} {user.password}".encode(), "sha256").hex()

    def _device(self, cookie: str, name: str) -> str | None:
        """Return the nonce of a browser that signed in by this name before, or None."""
        nonce, _, given = cookie.partition(".")
        user = None if self.users is None else self.users.all().get(name)
        if user is None or not user.password or not given.isascii():
            return None
        return nonce if hmac.compare_digest(given, self._device_sign(user, nonce)) else None

    def close_session(self, secret: str) -> None:
        """End a session; an unknown one is ignored."""
        self._sessions.pop(_digest(secret), None)

    async def delay_wrong_token(self) -> bool:
        """Delay the answer to a wrong token or code; return False at once if too many are delayed already."""
        if self._held >= _MAX_HELD:
            return False
        self._held += 1
        try:
            await asyncio.sleep(_WRONG_TOKEN_S)
        finally:
            self._held -= 1
        return True

    def close(self) -> None:
        """End the threads."""
        self._hashing.shutdown(wait=True, cancel_futures=True)

    def _forget_old(self) -> None:
        now = self._monotonic()
        while self._sessions:
            oldest = next(iter(self._sessions))
            if self._sessions[oldest].until > now:
                return
            del self._sessions[oldest]


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest()
