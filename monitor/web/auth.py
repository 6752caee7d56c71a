"""Who may do what: the token of the page, and the sessions of browsers that have shown it."""

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

_SHORTEST = 16
_MOST_SESSIONS = 1000
_LIFETIME = 12 * 3600.0
_PENALTY = 1.0
_MOST_WAITING = 8


class TokenError(SpallwatchError):
    """The token cannot be used; the message names the file and what is wrong with it."""


def load_token(path: Path, *, make: bool) -> str:
    """Return the token in a file: its first line.

    A file that everybody on the computer can read is refused, not warned of: whoever has read it may acknowledge, and
    nobody reads the warnings of a service. Its group may read it, as that is how service managers hand out secrets.

    Args:
        path: of the file.
        make: whether one is made where there is none, of 32 random bytes and for its owner alone.

    Raises:
        TokenError: there is none, it cannot be read, it is open to others, or what it holds is too short.
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
    if len(token) < _SHORTEST or not token.isascii() or not token.isprintable():
        raise TokenError(f"{path}: the token must have at least {_SHORTEST} printable ASCII characters")
    return token


def _check_mode(path: Path, mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise TokenError(f"{path}: is not a file")
    if mode & 0o026:
        raise TokenError(f"{path}: others may read or change it; make it safe with: chmod 600 {path}")


def _make(path: Path) -> None:
    """Make a token file; it is whole from the first moment on, and never takes the place of another."""
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
    """Knows the token, by its digest, and the sessions; used in the event loop only."""

    def __init__(self, token: str, monotonic: Callable[[], float] = time.monotonic) -> None:
        """Take the token.

        Args:
            token: which opens.
            monotonic: seconds that never go back.
        """
        self._digest = _digest(token)
        self._monotonic = monotonic
        self._sessions: dict[bytes, float] = {}
        self._penalty = asyncio.Lock()
        self._waiting = 0

    def knows(self, token: str) -> bool:
        """Return whether this is the token, in a time that does not depend on where it differs."""
        return hmac.compare_digest(_digest(token), self._digest)

    def open_session(self) -> str:
        """Return the secret of a new session; of too many, the oldest ends."""
        self._forget_old()
        while len(self._sessions) >= _MOST_SESSIONS:
            self._sessions.pop(next(iter(self._sessions)))
        secret = secrets.token_urlsafe(32)
        self._sessions[_digest(secret)] = self._monotonic() + _LIFETIME
        return secret

    def has_session(self, secret: str) -> bool:
        """Return whether a session is open."""
        self._forget_old()
        return _digest(secret) in self._sessions

    def close_session(self, secret: str) -> None:
        """End a session; ending one that there is not does nothing."""
        self._sessions.pop(_digest(secret), None)

    async def punish(self) -> bool:
        """Let a wrong token wait, one after the other; return False where too many wait already."""
        if self._waiting >= _MOST_WAITING:
            return False
        self._waiting += 1
        try:
            async with self._penalty:
                await asyncio.sleep(_PENALTY)
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
