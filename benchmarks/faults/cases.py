"""The faults: which call of which process fails on what, how, when in a life, once or for a while."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from benchmarks.faults.shim import Plan

When = Literal["steady", "start", "stop", "backup", "restore", "archive-days"]


@dataclass(frozen=True)
class Case:
    """A fault and when it happens: in a daemon that follows its sources, at its start or stop, or in a command."""

    when: When
    plan: Plan

    @property
    def name(self) -> str:
        """A name of the case, different from all others."""
        plan = self.plan
        until = "while" if plan.calls is None else f"x{plan.calls}"
        return f"{self.when}:{plan.role}:{plan.kind}:{plan.place or 'any'}:{plan.error}:{plan.first}{until}"


Row = tuple[str, str, str | None, str, str]
"""Role, kind, place, errors, and when: numbers of the call, or "w" for all calls of a while."""

_STEADY: Sequence[Row] = (
    ("daemon", "pread", "store", "EIO short", "1 9 w"),
    ("daemon", "pwrite", "store", "EIO ENOSPC EDQUOT short", "1 40 w"),
    ("daemon", "fdatasync", "store", "EIO ENOSPC", "1 4 w"),
    ("daemon", "lock", "store", "ENOLCK EIO", "1 30 w"),
    ("daemon", "open", "status", "EMFILE EACCES ENOSPC", "1 w"),
    ("daemon", "write", "status", "ENOSPC EIO EDQUOT", "1 w"),
    ("daemon", "rename", "status", "EIO EROFS", "1 w"),
    ("daemon", "opendir", "input", "EMFILE EIO EACCES", "1 w"),
    ("daemon", "open", "input", "EMFILE ENFILE EACCES EIO", "1 w"),
    ("daemon", "read", "input", "EIO short", "1 w"),
    ("daemon", "read", "input", "EINTR", "1"),
    ("daemon", "accept", "socket", "EMFILE ENFILE ECONNABORTED", "1 w"),
    ("daemon", "recv", "socket", "ECONNRESET ETIMEDOUT", "1 8 w"),
    ("daemon", "recv", "socket", "EINTR EAGAIN short", "1"),
    ("daemon", "send", "socket", "EPIPE ECONNRESET", "1 6 w"),
    ("daemon", "send", "socket", "EAGAIN short", "1"),
    ("daemon", "epoll_wait", "none", "EINTR ENOMEM", "1 9"),
    ("daemon", "poll", "none", "EINTR ENOMEM", "1"),
    ("daemon", "read", "pipe", "EIO EINTR", "1"),
    ("daemon", "write", "pipe", "EPIPE", "1"),
    ("daemon", "malloc", "none", "ENOMEM", "1 300 4000 w"),
    ("page", "accept", "socket", "EMFILE ENFILE ECONNABORTED", "1 w"),
    ("page", "recv", "socket", "ECONNRESET ETIMEDOUT", "1 w"),
    ("page", "send", "socket", "EPIPE ECONNRESET short", "1 w"),
    ("page", "epoll_wait", "none", "EINTR ENOMEM", "1"),
    ("page", "open", "status", "EMFILE EIO", "1 w"),
    ("page", "read", "status", "EIO", "1 w"),
    ("page", "pread", "store", "EIO short", "1 w"),
    ("page", "lock", "store", "ENOLCK EIO", "1 w"),
    ("page", "malloc", "none", "ENOMEM", "1 200"),
    ("parser", "read", "pipe", "EIO EINTR", "1"),
    ("parser", "write", "pipe", "EPIPE", "1"),
    ("parser", "malloc", "none", "ENOMEM", "1 30"),
    ("publisher", "open", "published", "EMFILE EROFS EACCES", "1"),
    ("publisher", "pwrite", "published", "ENOSPC EIO short", "1 30"),
    ("publisher", "fsync", "published", "EIO ENOSPC", "1"),
    ("publisher", "rename", "published", "EIO EROFS", "1"),
    ("publisher", "ftruncate", "published", "EIO", "1"),
    ("publisher", "pread", "store", "EIO", "1"),
    ("publisher", "lock", "store", "ENOLCK", "1"),
    ("publisher", "write", "pipe", "EPIPE", "1"),
    ("publisher", "malloc", "none", "ENOMEM", "500"),
)
_START: Sequence[Row] = (
    ("daemon", "open", "store", "EMFILE EIO EACCES", "1 4"),
    ("daemon", "pread", "store", "EIO", "1 20"),
    ("daemon", "mmap", "store", "ENOMEM", "1"),
    ("daemon", "lock", "store", "ENOLCK", "1 20"),
    ("daemon", "lock", "life", "ENOLCK", "1"),
    ("daemon", "socket", "none", "EMFILE", "1 3"),
    ("daemon", "bind", "socket", "EADDRINUSE EACCES", "1"),
    ("daemon", "listen", "socket", "EADDRINUSE", "1"),
    ("daemon", "thread", "none", "EAGAIN", "1 3 5"),
    ("daemon", "fork", "none", "EAGAIN ENOMEM", "1 2"),
    ("daemon", "mmap", "none", "ENOMEM", "1500"),
    ("daemon", "unlink", "life", "EIO", "1"),
    ("page", "bind", "socket", "EADDRINUSE", "1"),
    ("page", "thread", "none", "EAGAIN", "1 2"),
    ("page", "mmap", "store", "ENOMEM", "1"),
    ("publisher", "fork", "none", "EAGAIN", "1"),
)
_STOP: Sequence[Row] = (
    ("daemon", "fdatasync", "store", "EIO", "1"),
    ("daemon", "pwrite", "store", "ENOSPC", "1"),
    ("daemon", "unlink", "store", "EIO", "1"),
    ("daemon", "rename", "status", "EIO", "1"),
    ("publisher", "rename", "published", "EIO", "1"),
)
_COMMANDS: Sequence[Row] = (
    ("backup", "open", "store", "EMFILE EACCES", "1 3"),
    ("backup", "pread", "store", "EIO", "2"),
    ("backup", "pwrite", "store", "ENOSPC EIO", "1 9"),
    ("backup", "fsync", "life", "EIO", "1"),
    ("backup", "rename", "life", "EIO", "1"),
    ("backup", "lock", "store", "ENOLCK", "1"),
    ("backup", "write", "published", "ENOSPC", "1"),
    ("backup", "read", "published", "EIO", "1"),
    ("backup", "malloc", "none", "ENOMEM", "150000"),
    ("restore", "open", "store", "EMFILE", "1"),
    ("restore", "read", "store", "EIO", "1"),
    ("restore", "write", "store", "ENOSPC", "1"),
    ("restore", "fsync", "store", "EIO", "1"),
    ("restore", "fsync", "life", "EIO", "1"),
    ("restore", "rename", "store", "EIO", "1"),
    ("restore", "pread", "store", "EIO", "1"),
    ("archive-days", "open", "published", "EMFILE EACCES", "1"),
    ("archive-days", "write", "published", "ENOSPC", "1"),
    ("archive-days", "read", "published", "EIO", "1"),
    ("archive-days", "fsync", "published", "EIO", "1"),
    ("archive-days", "rename", "published", "EIO", "1"),
    ("archive-days", "rename", "life", "EIO", "1"),
    ("archive-days", "unlink", "published", "EIO EACCES", "1"),
)


def _plans(row: Row) -> Iterator[Plan]:
    role, kind, place, errors, numbers = row
    for error in errors.split():
        for number in numbers.split():
            if number == "w":
                yield Plan(kind, error, role, place, calls=None)
            else:
                yield Plan(kind, error, role, place, first=int(number))


def all_cases() -> list[Case]:
    """Return all cases: those of one daemon first, then those that start and stop one, then the commands."""
    cases = [Case("steady", plan) for row in _STEADY for plan in _plans(row)]
    cases += [Case("start", plan) for row in _START for plan in _plans(row)]
    cases += [Case("stop", plan) for row in _STOP for plan in _plans(row)]
    for row in _COMMANDS:
        when: When = "backup" if row[0] == "backup" else "restore" if row[0] == "restore" else "archive-days"
        cases += [Case(when, plan) for plan in _plans(row)]
    return cases
