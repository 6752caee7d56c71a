"""The token of the page, and the sessions of browsers that have sent it."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import os
import secrets
import stat
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from models.errors import SpallwatchError

_MIN_TOKEN_CHARACTERS = 16
_MAX_SESSIONS = 1000
_SESSION_S = 12 * 3600.0
_WRONG_TOKEN_S = 1.0
_MAX_WAITING = 8


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
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
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
    if mode & 0o026:
        raise TokenError(f"{path}: others may read or change it; make it safe with: chmod 600 {path}")


def _make(path: Path) -> None:
    """Create a token file atomically; an existing one is kept."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with suppress(FileNotFoundError):
        temporary.unlink()
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="ascii") as file:
            file.write(secrets.token_urlsafe(32) + "\n")
            file.flush()
            os.fsync(descriptor)
        with suppress(FileExistsError):
            path.hardlink_to(temporary)
    finally:
        temporary.unlink()


class Doorkeeper:
    """The token, by its digest, and the open sessions; used in the event loop only."""

    def __init__(self, token: str, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Keep the digest of the token."""
        self._digest = _digest(token)
        self._monotonic = monotonic
        self._sessions: dict[bytes, float] = {}
        self._penalty = asyncio.Lock()
        self._waiting = 0

    def is_token(self, token: str) -> bool:
        """Return whether this is the token, in a time that does not depend on where it differs."""
        return hmac.compare_digest(_digest(token), self._digest)

    def open_session(self) -> str:
        """Return the secret of a new session; beyond the limit, the oldest session ends."""
        self._forget_old()
        while len(self._sessions) >= _MAX_SESSIONS:
            self._sessions.pop(next(iter(self._sessions)))
        secret = secrets.token_urlsafe(32)
        self._sessions[_digest(secret)] = self._monotonic() + _SESSION_S
        return secret

    def has_session(self, secret: str) -> bool:
        """Return whether a session is open."""
        self._forget_old()
        return _digest(secret) in self._sessions

    def close_session(self, secret: str) -> None:
        """End a session; an unknown one is ignored."""
        self._sessions.pop(_digest(secret), None)

    async def delay_wrong_token(self) -> bool:
        """Delay the answer to a wrong token, one at a time; return False at once if too many wait already."""
        if self._waiting >= _MAX_WAITING:
            return False
        self._waiting += 1
        try:
            async with self._penalty:
                await asyncio.sleep(_WRONG_TOKEN_S)
        finally:
            self._waiting -= 1
        return True

    def _forget_old(self) -> None:
        now = self._monotonic()
        while self._sessions:
            oldest = next(iter(self._sessions))
            if self._sessions[oldest] > now:
                return
            del self._sessions[oldest]


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest()
