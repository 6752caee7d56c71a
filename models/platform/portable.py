"""Calls that only POSIX has, each with a portable way; with ``models.platform.process_signals`` the only place of them.

Where a call is missing, as on Windows, the portable way is taken. What is lost there: limits of memory and processor
time of a parser (its time stays limited), the durability of a name in a folder by a call of its own, the check of a
file's permissions, and the measures of another process. None of this was tried on Windows itself; a test takes the
calls away on Linux (tests/without_posix).

Every process imports this; what few calls need is imported by them.
"""

from __future__ import annotations

import errno
import importlib
import os
import queue
import select
import stat
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import socket
    import sqlite3


def _optional(name: str) -> Any:
    """Return a module of the standard library, None where the system lacks it."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


_fcntl, _resource = _optional("fcntl"), _optional("resource")
# Types are those of one system; what another lacks is looked up.
_os: Any = os
_select: Any = select
_POLL_S = 0.02

BINARY: int = getattr(os, "O_BINARY", 0)
"""Flag of ``os.open``: bytes as they are. It belongs to each call."""
NO_WAIT: int = getattr(os, "O_NONBLOCK", 0) | BINARY
"""Flag of ``os.open``: a FIFO does not block."""
NO_LINK: int = getattr(os, "O_NOFOLLOW", 0) | BINARY
"""Flag of ``os.open``: a link is refused."""


class FileLock:
    """A lock on a file, for one holder or several sharers; the system releases it when the process ends.

    Without ``fcntl`` it is that of an SQLite database, which locks on every system.
    """

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open the file, which is made unless ``read_only``; OSError where that fails."""
        flags = os.O_RDONLY if read_only else os.O_RDWR | os.O_CREAT
        self._handle: int | None = os.open(path, flags | BINARY, 0o644)
        self._database: sqlite3.Connection | None = None
        if _fcntl is None:
            import sqlite3

            os.close(self._handle)
            self._handle = None
            uri = f"{path.absolute().as_uri()}?mode={'ro' if read_only else 'rw'}"
            self._database = sqlite3.connect(uri, uri=True, timeout=0.0, isolation_level=None, check_same_thread=False)

    def take(self, *, shared: bool = False) -> bool:
        """Take the lock; return whether it was free. OSError where the file system has no locks."""
        if self._database is not None:
            return _begin(self._database, shared=shared)
        try:
            _fcntl.flock(self._handle, (_fcntl.LOCK_SH if shared else _fcntl.LOCK_EX) | _fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def is_at(self, path: Path) -> bool:
        """Return whether the lock file still has this name; True where a file in use cannot lose it."""
        if self._handle is None:
            return True
        try:
            return os.path.samestat(os.fstat(self._handle), path.stat())
        except FileNotFoundError:
            return False

    def wait(self) -> None:
        """Take the lock when it is free."""
        if self._database is None:
            _fcntl.flock(self._handle, _fcntl.LOCK_EX)
            return
        while not _begin(self._database, shared=False):
            time.sleep(_POLL_S)

    def close(self) -> None:
        """Release the lock; closing twice does nothing."""
        handle, self._handle = self._handle, None
        if handle is not None:
            os.close(handle)
        if self._database is not None:
            self._database.close()


def _begin(database: sqlite3.Connection, *, shared: bool) -> bool:
    import sqlite3

    try:
        database.execute("BEGIN" if shared else "BEGIN EXCLUSIVE")
        database.execute("SELECT 1 FROM sqlite_master").fetchall()
    except sqlite3.OperationalError:
        with suppress(sqlite3.OperationalError):
            database.execute("ROLLBACK")
        return False
    return True


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable: a rename survives a power cut only after this.

    Where folders cannot be opened, the file system's own log is relied on, as SQLite does.
    """
    if not hasattr(os, "O_DIRECTORY"):
        return
    descriptor = os.open(folder, os.O_RDONLY | _os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_file(path: Path) -> None:
    """Make the content of a file durable."""
    # Windows flushes a file that is open for writing only.
    descriptor = os.open(path, os.O_RDWR | BINARY if BINARY else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def forget_cached(handle: int) -> None:
    """Have what is read next of an open file come from the disk, where the system can be told."""
    if hasattr(os, "posix_fadvise"):
        _os.posix_fadvise(handle, 0, 0, _os.POSIX_FADV_DONTNEED)


def open_folder(folder: str) -> None:
    """Raise OSError where a folder may not be listed or searched."""
    if hasattr(os, "O_DIRECTORY"):
        os.close(os.open(f"{folder}/.", os.O_RDONLY | _os.O_DIRECTORY))
        return
    with os.scandir(folder):
        pass


def may_write(folder: Path) -> bool:
    """Return whether files can be made in a folder."""
    return os.access(folder, os.W_OK | os.X_OK, effective_ids=os.access in os.supports_effective_ids)


def is_read_only(folder: Path) -> bool:
    """Return whether a file system is mounted for reading only; False where that is not known."""
    return hasattr(os, "ST_RDONLY") and bool(_os.statvfs(folder).f_flag & _os.ST_RDONLY)


def others_may(mode: int, bits: int) -> bool:
    """Return whether a file's mode has any of some permission bits; False where modes mean nothing."""
    return hasattr(os, "geteuid") and bool(stat.S_IMODE(mode) & bits)


def device_number(device: int) -> str | None:
    """Return "major:minor" of a device, None where it has none."""
    return f"{_os.major(device)}:{_os.minor(device)}" if hasattr(os, "major") else None


def read_at(handle: int, size: int, place: int) -> bytes:
    """Return up to ``size`` bytes of an open file; one thread at a time."""
    if hasattr(os, "pread"):
        return _os.pread(handle, size, place)
    os.lseek(handle, place, os.SEEK_SET)
    return os.read(handle, size)


def read_into_at(handle: int, target: memoryview, place: int) -> int:
    """Fill a view from an open file; return how many bytes came."""
    if hasattr(os, "preadv"):
        return _os.preadv(handle, [target], place)
    part = read_at(handle, min(len(target), 1 << 24), place)
    target[: len(part)] = part
    return len(part)


def write_at(handle: int, data: bytes | memoryview, place: int) -> int:
    """Write to an open file; return how many bytes were written; one thread at a time."""
    if hasattr(os, "pwrite"):
        return _os.pwrite(handle, data, place)
    os.lseek(handle, place, os.SEEK_SET)
    return os.write(handle, data)


def reserve(handle: int, size: int) -> None:
    """Give a file a length, with room on the disk where the system can promise it; OSError where there is none."""
    if hasattr(os, "posix_fallocate") and size:
        _os.posix_fallocate(handle, 0, size)
    else:
        os.ftruncate(handle, size)


class MemoryFile:
    """An open file that no other program sees, in memory where the system has that, else in the temporary folder.

    Attributes:
        handle: file descriptor.
        path: by which this process, or a child that was given the handle, opens it again.
    """

    def __init__(self, name: str) -> None:
        """Make an empty one; ``name`` is for people."""
        self._own: Path | None = None
        if hasattr(os, "memfd_create"):
            self.handle: int = _os.memfd_create(name, _os.MFD_CLOEXEC)
            self.path = f"/proc/self/fd/{self.handle}"
        else:
            import tempfile

            self.handle, self.path = tempfile.mkstemp(prefix=f"spallwatch-{name}-")
            self._own = Path(self.path)

    def close(self) -> None:
        """Close it; its content is gone."""
        os.close(self.handle)
        if self._own is not None:
            # A child that was killed may hold it for a moment.
            with suppress(OSError):
                self._own.unlink()


class DiskFile:
    """An open file of the temporary folder that vanishes when it is closed.

    Attributes:
        handle: file descriptor.
        path: by which this process and its children open it again, for as long as it is open here.
    """

    def __init__(self) -> None:
        """Make an empty one; OSError where the folder cannot be written to."""
        import tempfile

        self.handle, name = tempfile.mkstemp(prefix="spallwatch-")
        self.path, self._own = name, Path(name)
        if hasattr(os, "memfd_create"):
            # Without a name nothing is left of it, even where this process is killed.
            self.path = f"/proc/{os.getpid()}/fd/{self.handle}"
            self._own.unlink()

    def close(self) -> None:
        """Close it; its content is gone."""
        os.close(self.handle)
        with suppress(OSError):
            self._own.unlink()


class PipeReader:
    """The reading end of a pipe, with a limit of the time that is waited for."""

    def __init__(self, handle: int) -> None:
        """Own a file descriptor."""
        self._handle = handle
        self._parts: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._part: bytes | None = None
        self._polled = hasattr(select, "poll")
        if not self._polled:
            # Only sockets can be waited for.
            threading.Thread(target=self._pump, name="pipe", daemon=True).start()

    def wait(self, seconds: float) -> bool:
        """Wait until there is something to read, or the end; return whether there is."""
        if self._polled:
            poll = _select.poll()
            poll.register(self._handle, _select.POLLIN)
            return bool(poll.poll(1e3 * max(seconds, 0.0)))
        if self._part is None:
            with suppress(queue.Empty):
                self._part = self._parts.get(timeout=max(seconds, 0.0)) if seconds > 0.0 else self._parts.get_nowait()
        return self._part is not None

    def read(self, count: int) -> bytes:
        """Return up to ``count`` bytes, waiting for the first; b"" at the end."""
        if self._polled:
            return os.read(self._handle, count)
        part = self._part if self._part is not None else self._parts.get()
        self._part = part[count:] or None if part else part
        return part[:count]

    def close(self) -> None:
        """Close the pipe: at once, or once its other end is closed where a thread reads it."""
        if self._polled:
            os.close(self._handle)

    def _pump(self) -> None:
        part = b" "
        while part:
            try:
                part = os.read(self._handle, 1 << 16)
            except OSError:
                part = b""
            self._parts.put(part)
        with suppress(OSError):
            os.close(self._handle)


def handed_down(ends: Sequence[int], files: Sequence[MemoryFile]) -> tuple[list[str], dict[str, Any]]:
    """Return words and arguments of ``subprocess.Popen`` by which a child takes its ends of two pipes, and files.

    The words are for :func:`taken_over`. A child that cannot inherit descriptors gets its standard ones, and paths.
    """
    import subprocess

    nothing = subprocess.DEVNULL
    if _fcntl is not None:
        passed = [*ends, *(file.handle for file in files)]
        arguments = {"pass_fds": passed, "stdin": nothing, "stdout": nothing, "start_new_session": True}
        return [str(handle) for handle in passed], arguments
    return ["0", "1", *(file.path for file in files)], {"stdin": ends[0], "stdout": ends[1]}


def taken_over(words: Sequence[str]) -> list[int]:
    """Return in a child its ends of the pipes and the files, by the words of :func:`handed_down`."""
    if all(word.isdigit() for word in words):
        return [int(word) for word in words]
    # What a library prints must not reach the parent.
    ends, nothing = [os.dup(0), os.dup(1)], os.open(os.devnull, os.O_RDWR)
    for standard in (0, 1):
        os.dup2(nothing, standard)
    return [*ends, *(os.open(path, os.O_RDWR | BINARY) for path in words[2:])]


def limit(kind: str, value: int) -> None:
    """Set a soft limit of this process ("CORE", "FSIZE", "CPU", "AS"), within the hard one that it was given."""
    if _resource is None:
        return
    number = getattr(_resource, f"RLIMIT_{kind}")
    _, hard = _resource.getrlimit(number)
    _resource.setrlimit(number, (value if hard == _resource.RLIM_INFINITY else min(value, hard), hard))


def address_limit() -> int | None:
    """Return the soft limit of the address space of this process (``ulimit -v``), bytes; None where there is none."""
    if _resource is None:
        return None
    soft, _ = _resource.getrlimit(_resource.RLIMIT_AS)
    return None if soft == _resource.RLIM_INFINITY else int(soft)


def lower_priority(steps: int = 5) -> None:
    """Let threads of other processes go first, where the system can be told; ``steps`` are those of nice(2)."""
    if hasattr(os, "nice"):
        _os.nice(steps)


def after_fork(function: Callable[[], None]) -> None:
    """Call a function in each process that is forked from this one."""
    if hasattr(os, "register_at_fork"):
        _os.register_at_fork(after_in_child=function)


def process_memory(pid: int | None) -> float | None:
    """Return the resident memory of a process, bytes; None where it is not known."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
        return float(pages * _os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError, IndexError, AttributeError):
        return None


def processor_time(pid: int | None) -> float | None:
    """Return the processor time that a process has used, s; None where it is not known."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return None


def local_datagrams() -> socket.socket:
    """Return a socket for datagrams within this machine; OSError where the system has none."""
    import socket

    family: Any = getattr(socket, "AF_UNIX", None)
    if family is None:
        raise OSError(errno.EAFNOSUPPORT, "no local sockets")
    return socket.socket(family, socket.SOCK_DGRAM)
