"""The preloaded library that makes calls fail, and the shared memory by which it is told which.

``shim.c`` beside this file is compiled with gcc into a scratch folder; nothing of it is installed.
"""

from __future__ import annotations

import ctypes
import errno
import mmap
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

KINDS = (
    *("open", "read", "pread", "write", "pwrite", "fsync", "fdatasync", "rename", "unlink", "ftruncate", "mmap"),
    *("lock", "opendir", "socket", "bind", "listen", "accept", "recv", "send", "connect", "epoll_wait", "poll"),
    *("malloc", "thread", "fork"),
)
"""In the order of the enumeration of shim.c."""
ROLES = {
    "publisher": "service.publisher",
    "page": "web.server",
    "parser": "files.parse",
    "daemon": " run --config",
    "backup": " backup --config",
    "restore": " restore --config",
    "archive-days": " archive-days --config",
}
"""Words in the command line of a process, by its role; the first that is there counts."""
PLACES = {
    "store": "state.db",
    "published": ".nc",
    "status": "status.json",
    "input": "/in/",
    "socket": "socket:",
    "pipe": "pipe:",
    "life": "/spallwatch-life-",
    "none": "",
}
"""Parts of a path by place; the first that is there counts, and the last one where there is none of them."""
SHORT = -1
"""In place of an error number: half of the bytes are read or written."""
FOREVER = 2**62
_ROLES, _PLACES, _WORD, _LENGTH = 8, 8, 64, 200
_ANY = -1
_SOURCE = Path(__file__).with_name("shim.c")


class _Control(ctypes.Structure):
    _fields_ = (
        ("armed", ctypes.c_uint32),
        *((name, ctypes.c_int32) for name in ("kind", "role", "place", "error", "pid")),
        *((name, ctypes.c_int64) for name in ("first", "last", "seen", "fired")),
        ("path", ctypes.c_char * _LENGTH),
        ("roles", (ctypes.c_char * _WORD) * _ROLES),
        ("places", (ctypes.c_char * _WORD) * _PLACES),
        ("calls", ((ctypes.c_int64 * _PLACES) * _ROLES) * len(KINDS)),
    )


@dataclass(frozen=True)
class Plan:
    """Which calls fail.

    Attributes:
        kind: one of ``KINDS``.
        error: name of an error number such as "EIO", or "short".
        role: of the processes, one of ``ROLES``.
        place: of the files, one of ``PLACES``; None: all.
        first: the call that fails first, from 1, counted from when the plan is armed.
        calls: how many fail; None: all until the plan is disarmed.
    """

    kind: str
    error: str
    role: str
    place: str | None
    first: int = 1
    calls: int | None = 1


def compiled(folder: Path) -> Path:
    """Compile the library into a folder and return its path; RuntimeError where that fails or gcc is missing."""
    gcc, library = shutil.which("gcc"), folder / "shim.so"
    if gcc is None:
        raise RuntimeError("gcc is missing (Debian package gcc)")
    command = [gcc, "-O2", "-shared", "-fPIC", "-o", str(library), str(_SOURCE), "-ldl", "-lpthread"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{_SOURCE}: gcc ended with {done.returncode}: {done.stderr.strip()}")
    return library


class Shim:
    """The shared memory of all processes of a life."""

    def __init__(self, folder: Path) -> None:
        """Compile the library and make the file of the shared memory in a folder; RuntimeError as :func:`compiled`."""
        self._library, self._file = compiled(folder), folder / "faults.bin"
        self._file.write_bytes(bytes(ctypes.sizeof(_Control)))
        with self._file.open("r+b") as file:
            self._memory = mmap.mmap(file.fileno(), ctypes.sizeof(_Control))
        self._control = _Control.from_buffer(self._memory)
        for number, word in enumerate(ROLES.values()):
            self._control.roles[number].value = word.encode()
        for number, word in enumerate(PLACES.values()):
            self._control.places[number].value = word.encode()

    @property
    def environment(self) -> dict[str, str]:
        """The environment of a process whose calls, and those of its children, are counted and fail as planned."""
        return {**os.environ, "LD_PRELOAD": str(self._library), "SPALLWATCH_FAULTS": str(self._file)}

    def arm(self, plan: Plan) -> None:
        """Let calls fail from now on."""
        self.disarm()
        control = self._control
        control.kind, control.role = KINDS.index(plan.kind), tuple(ROLES).index(plan.role)
        control.place = _ANY if plan.place is None else tuple(PLACES).index(plan.place)
        control.error = SHORT if plan.error == "short" else getattr(errno, plan.error)
        control.first = plan.first
        control.last = FOREVER if plan.calls is None else plan.first + plan.calls - 1
        control.seen = control.fired = control.pid = 0
        control.path = b""
        control.armed = 1

    def disarm(self) -> None:
        """Let no call fail any more."""
        self._control.armed = 0

    @property
    def fired(self) -> int:
        """How many calls failed since the plan was armed."""
        return self._control.fired

    @property
    def where(self) -> str:
        """The last part of the path of the first call that failed, "" where it has none."""
        return Path(self._control.path.decode(errors="replace")).name

    def counts(self) -> dict[tuple[str, str, str], int]:
        """Return the calls so far by kind, role and place, those that came at all."""
        return {
            (kind, role, place): found
            for i, kind in enumerate(KINDS)
            for j, role in enumerate(ROLES)
            for k, place in enumerate(PLACES)
            if (found := self._control.calls[i][j][k])
        }
