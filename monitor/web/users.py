"""Users of the page: names, roles and hashes of passwords in a file that the page and ``spallwatch user`` share.

A CSV file with the columns ``name,role,password,invite,invite_until_utc_s``, readable by its owner and group only.
It is replaced as a whole, and read again when it has changed. Passwords are kept as hashes (passwords.py),
codes of invitations as their SHA-256 digests.
"""

from __future__ import annotations

import csv
import hashlib
import hmac
import logging
import os
import secrets
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, cast, get_args

from models.words.errors import WrongInputError
from monitor.web.passwords import check_new_password, hash_password, is_password, is_present

Role = Literal["viewer", "operator", "admin"]
ROLES: tuple[Role, ...] = get_args(Role)
"""A viewer reads; an operator acknowledges, too; an admin invites users, too."""
USERS_FILE = "web.users"
"""In the folder of the token, where no other is configured."""
INVITE_S = 24 * 3600.0
_MAX_NAME_CHARACTERS = 64
_MAX_FILE_BYTES = 1 << 20
_COLUMNS = ("name", "role", "password", "invite", "invite_until_utc_s")
_LOCK_WAIT_S, _LOCK_STALE_S, _LOCK_POLL_S = 5.0, 30.0, 0.02
_LOG = logging.getLogger(__name__)


class UsersError(WrongInputError):
    """The file of users cannot be used or changed; the message names it and says what is wrong."""


@dataclass(frozen=True)
class User:
    """A user.

    Attributes:
        password: hash of the password, "" until one was set.
        invite: digest of the code of an open invitation, "" for none.
        invite_until: UTC s since 1970.
    """

    name: str
    role: Role
    password: str = ""
    invite: str = ""
    invite_until: float = 0.0


def check_name(name: str) -> str:
    """Return a name; raise ValueError where it is none."""
    if not 0 < len(name) <= _MAX_NAME_CHARACTERS or name != name.strip() or not name.isprintable():
        raise ValueError(f"a name has 1 to {_MAX_NAME_CHARACTERS} printable characters and no blanks around them")
    return name


def digest_of_code(code: str) -> str:
    """Return what is kept of the code of an invitation: it is random, so that a plain digest does not give it away."""
    return hashlib.sha256(code.encode("utf-8", "surrogatepass")).hexdigest()


def read_users(path: Path) -> dict[str, User]:
    """Return the users of a file by name; none where there is no file.

    Raises:
        UsersError: the file is open to others, or not what it should be.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise UsersError(f"{path}: cannot be read ({error.strerror or error})") from None
    with os.fdopen(descriptor, "r", encoding="utf-8", newline="") as file:
        mode = os.fstat(descriptor)
        if not stat.S_ISREG(mode.st_mode) or mode.st_size > _MAX_FILE_BYTES:
            raise UsersError(f"{path}: is not a file of users")
        if os.name == "posix" and mode.st_mode & 0o026:
            raise UsersError(f"{path}: others may read or change it; make it safe with: chmod 600 {path}")
        try:
            return _parsed(path, file)
        except (csv.Error, UnicodeDecodeError) as error:
            raise UsersError(f"{path}: is not a file of users ({error})") from None


def _parsed(path: Path, file: Iterator[str]) -> dict[str, User]:
    found: dict[str, User] = {}
    rows = csv.reader(file, strict=True)
    if tuple(next(rows, ())) != _COLUMNS:
        raise UsersError(f"{path}:1: expected the columns {','.join(_COLUMNS)}")
    for row in rows:
        where = f"{path}:{rows.line_num}"
        if len(row) != len(_COLUMNS):
            raise UsersError(f"{where}: expected {len(_COLUMNS)} columns, found {len(row)}")
        name, role, password, invite, until = row
        try:
            check_name(name)
            moment = float(until or 0.0)
        except ValueError as error:
            raise UsersError(f"{where}: {error}") from None
        if role not in ROLES:
            raise UsersError(f"{where}: role: expected one of {', '.join(ROLES)}, found {role!r}")
        if name in found:
            raise UsersError(f"{where}: a second user of the name {name!r}")
        found[name] = User(name, cast("Role", role), password, invite, moment)
    return found


@contextmanager
def changed_users(path: Path) -> Iterator[dict[str, User]]:
    """Lend the users of a file, and replace it by what they are then; nothing is written after an exception.

    Raises:
        UsersError: it cannot be read or replaced, or another process holds it for seconds.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with _lock(path):
        users = read_users(path)
        before = dict(users)
        yield users
        if users != before or not path.exists():
            try:
                _write(path, users)
            except OSError as error:
                raise UsersError(f"{path}: cannot be written ({error.strerror or error})") from None


def _write(path: Path, users: dict[str, User]) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with suppress(FileNotFoundError):
        temporary.unlink()
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(_COLUMNS)
            rows.writerows(tuple(asdict(user).values()) for user in users.values())
            file.flush()
            os.fsync(descriptor)
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise


@contextmanager
def _lock(path: Path) -> Iterator[None]:
    """Hold the file against other processes; the lock of one that died is broken after half a minute."""
    lock = path.with_name(f".{path.name}.lock")
    until = time.monotonic() + _LOCK_WAIT_S
    while True:
        try:
            os.close(os.open(lock, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))
            break
        except FileExistsError:
            with suppress(OSError):
                if time.time() - lock.stat().st_mtime > _LOCK_STALE_S:
                    lock.unlink()
                    continue
            if time.monotonic() > until:
                raise UsersError(f"{path}: is being changed by another process ({lock})") from None
            time.sleep(_LOCK_POLL_S)
        except OSError as error:
            raise UsersError(f"{path}: cannot be changed ({error.strerror or error})") from None
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()


def invite(path: Path, name: str, clock: Callable[[], float] = time.time) -> tuple[str, float]:
    """Return the code of a new invitation of a user, valid once for a day, and until when, UTC s since 1970.

    Raises:
        UsersError: there is no such user, or the file cannot be changed.
    """
    code, until = secrets.token_urlsafe(24), round(clock() + INVITE_S)
    with changed_users(path) as users:
        if name not in users:
            raise UsersError(f"{path}: there is no user {name!r}; expected one of {', '.join(users) or 'none so far'}")
        users[name] = replace(users[name], invite=digest_of_code(code), invite_until=until)
    return code, until


class Users:
    """The users of a page; a file that cannot be used lets nobody in, and is logged once."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        """Keep the path; the file may come, change and go at any time."""
        self.path, self._clock = path, clock
        self._state: tuple[int, ...] | None = None
        self._users: dict[str, User] = {}

    def all(self) -> dict[str, User]:
        """Return the present users by name."""
        try:
            found = self.path.stat()
            state = (found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode)
        except OSError:
            state = None
        if state is None or state != self._state:
            self._users, self._state = {}, state
            try:
                self._users = {} if state is None else read_users(self.path)
            except UsersError as error:
                _LOG.error("no user can sign in: %s", error)
        return self._users

    def is_password(self, name: str, password: str) -> bool:
        """Return whether a user has a password; of an unknown user, that takes as long."""
        user = self.all().get(name)
        return is_password(password, "" if user is None else user.password)

    def renew(self, name: str, password: str) -> None:
        """Store a right password anew where its hash is of an earlier version; a failure is logged, and tried again."""
        before = self.all().get(name)
        if before is None or is_present(before.password):
            return
        try:
            stored = hash_password(password)
            with changed_users(self.path) as users:
                if users.get(name) == before:
                    users[name] = replace(before, password=stored)
        except UsersError as error:
            _LOG.warning("the hash of a password stays as it is: %s", error)

    def invited(self, code: str) -> User | None:
        """Return the user whom a code invites at present, or None."""
        given, now = digest_of_code(code), self._clock()
        # All are compared, so that the time says nothing of them.
        found = [user for user in self.all().values() if hmac.compare_digest(user.invite or "-" * 64, given)]
        return found[0] if found and found[0].invite_until >= now else None

    def redeem(self, code: str, password: str) -> User | None:
        """Set the password of the user whom a code invites, and use the code up; None for one that invites nobody.

        Raises:
            ValueError: the password is too short or too long; the code stays valid.
            UsersError: the file cannot be changed.
        """
        invited = self.invited(code)
        if invited is None:
            return None
        stored = hash_password(check_new_password(password))
        with changed_users(self.path) as users:
            user = users.get(invited.name)
            if user is None or not hmac.compare_digest(user.invite or "-", digest_of_code(code)):
                return None
            users[user.name] = replace(user, password=stored, invite="", invite_until=0.0)
        return users[user.name]
