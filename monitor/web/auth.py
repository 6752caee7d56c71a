"""The token of the page, and the sessions of browsers that have sent it or the password of a user."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import os
import secrets
import stat
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from models.platform.portable import NO_LINK, NO_WAIT, others_may
from models.words.errors import SpallwatchError
from monitor.web.users import Role, User, Users

_MIN_TOKEN_CHARACTERS = 16
_MAX_SESSIONS = 1000
_SESSION_S = 12 * 3600.0
_WRONG_TOKEN_S = 1.0
_MAX_WAITING = 8
MAX_WRONG_PASSWORDS, LOCKED_S = 5, 900.0
"""Wrong passwords in a row after which a name is locked, and for how long after the last one."""
_MAX_NAMES = 1000


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


class WrongPasswords:
    """Counts the wrong passwords of each name, known or not, and locks it after several in a row."""

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Count nothing yet."""
        self._monotonic = monotonic
        self._counts: dict[str, tuple[int, float]] = {}

    def locked(self, name: str) -> bool:
        """Return whether a name is locked at present."""
        count, last = self._counts.get(name, (0, 0.0))
        return count >= MAX_WRONG_PASSWORDS and self._monotonic() - last < LOCKED_S

    def note(self, name: str, *, right: bool) -> None:
        """Note a password; a right one, or a quarter of an hour, makes the earlier ones forgotten."""
        count, last = self._counts.pop(name, (0, 0.0))
        if right:
            return
        count = count if self._monotonic() - last < LOCKED_S else 0
        while len(self._counts) >= _MAX_NAMES:
            self._counts.pop(next(iter(self._counts)))
        self._counts[name] = (count + 1, self._monotonic())


class SignInError(SpallwatchError):
    """A sign-in that is refused: HTTP status and one sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        """Take status and sentence."""
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


class Doorkeeper:
    """The token, by its digest, the users, and the open sessions; used in the event loop only."""

    def __init__(self, token: str, users: Users | None = None, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Keep the digest of the token, and the users where there are any."""
        self._digest = _digest(token)
        self._monotonic = monotonic
        self.users = users
        self._wrong = WrongPasswords(monotonic)
        self._sessions: dict[bytes, _Session] = {}
        self._penalty = asyncio.Lock()
        self._waiting = 0

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

    async def sign_in(self, name: str, password: str) -> User:
        """Return the user of a name and a password, which are checked one at a time.

        Raises:
            SignInError: 401 they are wrong, said after a second; 429 the name is locked, or too many wait.
        """
        async with self._turn():
            if self._wrong.locked(name):
                raise SignInError(429, f"too many wrong passwords for this name; wait {LOCKED_S / 60:.0f} minutes")
            users = self.users
            right = users is not None and await asyncio.to_thread(users.is_password, name, password)
            user = None if users is None else users.all().get(name)
            self._wrong.note(name, right=right)
            if not right or user is None:
                await asyncio.sleep(_WRONG_TOKEN_S)
                raise SignInError(401, "name or password is wrong")
            return user

    async def redeem(self, code: str, password: str) -> User:
        """Return the user whom a code invites, with the new password.

        Raises:
            SignInError: 400 the password is too short or too long; 401 the code invites nobody, said after a second;
                429 too many wait.
            UsersError: the file of users cannot be changed.
        """
        async with self._turn():
            try:
                user = None if self.users is None else await asyncio.to_thread(self.users.redeem, code, password)
            except ValueError as error:
                raise SignInError(400, str(error)) from None
            if user is None:
                await asyncio.sleep(_WRONG_TOKEN_S)
                raise SignInError(401, "this code is wrong, used or older than a day; ask for a new one")
            return user

    @asynccontextmanager
    async def _turn(self) -> AsyncIterator[None]:
        """Let one attempt through at a time; :class:`SignInError` 429 if too many wait already."""
        if self._waiting >= _MAX_WAITING:
            raise SignInError(429, "too many try to sign in; try again later")
        self._waiting += 1
        try:
            async with self._penalty:
                yield
        finally:
            self._waiting -= 1

    def close_session(self, secret: str) -> None:
        """End a session; an unknown one is ignored."""
        self._sessions.pop(_digest(secret), None)

    async def delay_wrong_token(self) -> bool:
        """Delay the answer to a wrong token, one at a time; return False at once if too many wait already."""
        try:
            async with self._turn():
                await asyncio.sleep(_WRONG_TOKEN_S)
        except SignInError:
            return False
        return True

    def _forget_old(self) -> None:
        now = self._monotonic()
        while self._sessions:
            oldest = next(iter(self._sessions))
            if self._sessions[oldest].until > now:
                return
            del self._sessions[oldest]


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest()
