"""What a daemon and the system say of each other: status file, lock, full disk, service manager and log.

The protocol of the service manager is that of sd_notify(3). The log goes to standard error, with priorities in the
journal, else with the time.
"""

from __future__ import annotations

import json
import logging
import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Self

from models.platform.portable import FileLock, local_datagrams
from monitor.config.load import Config
from monitor.records.backup import read_note
from monitor.records.compact import reusable_bytes
from monitor.records.database import Closing, SharedConnection, StoreError
from monitor.records.durable import free_bytes, make_folder
from monitor.service.progress import stall_of

_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_NAME = "status.json"
_LOCK = "daemon.lock"
_LOCK_S = 1.0
_MIN_LOG_SHARE = 0.25
"""Share of the free space that the daemon keeps, down to which room inside the store counts as free."""
_CHECK_DISK_S = 5.0
_DISK_HYSTERESIS = 1.25
_THIN_FACTOR = 2.0
_COMMIT_BYTES = 1_000_000
"""Room for the log of one commit."""


class StatusFile(Closing):
    """Written by the one daemon of a state folder, replaced atomically; use :meth:`open`."""

    def __init__(self, path: Path, lock: FileLock) -> None:
        """Own a lock that is held; see :meth:`open`."""
        self.path, self._lock = path, lock

    @classmethod
    def open(cls, state_dir: Path) -> Self:
        """Take the lock of a state folder, which is created if it is missing.

        Raises:
            StoreError: another daemon has it, or the folder cannot be written.
        """
        try:
            make_folder(state_dir, 0o750)
            lock = FileLock(state_dir / _LOCK)
        except OSError as error:
            raise StoreError(f"{state_dir}: {error.strerror or error}") from error
        until = time.monotonic() + _LOCK_S
        # A reader of the status holds the lock for a moment.
        while not lock.take():
            if time.monotonic() >= until:
                lock.close()
                raise StoreError(f"{state_dir}: another daemon is running for this machine; there can be only one")
            time.sleep(0.02)
        found = cls(state_dir / _NAME, lock)
        found.touch()
        return found

    def touch(self) -> None:
        """Make the content of an earlier daemon look new, while this one starts."""
        with suppress(OSError):
            os.utime(self.path)

    def write(self, values: Mapping[str, Any]) -> None:
        """Replace the content of the file; OSError leaves the old content."""
        temporary = self.path.with_name(f".{_NAME}.tmp")
        temporary.write_text(json.dumps(values, allow_nan=False), encoding="utf-8")
        temporary.replace(self.path)

    def close(self) -> None:
        """Release the lock; closing twice does nothing."""
        self._lock.close()


def read_status(state_dir: Path) -> dict[str, Any]:
    """Return the latest status of a daemon, with ``running``: True, False or "stalled".

    Where none is running, ``status`` is ``stopped`` (it ended normally), ``died``, or ``never_ran``. One that runs and
    does not go on is ``stalled``, and ``stall`` says why.
    """
    path = state_dir / _NAME
    found, running = _read(path), is_running(state_dir)
    if not running:
        found["status"] = ("stopped" if found.get("status") == "stopped" else "died") if found else "never_ran"
    elif not found or found.get("status") == "stopped":
        found["status"] = "starting"
    elif (stall := stall_of(found, path)) is not None:
        return {**found, "running": "stalled", "status": "stalled", "stall": stall}
    return {"running": running, **found}


def present_status(
    config: Config, *, free: Callable[[Path], int] = free_bytes, clock: Callable[[], float] = time.time
) -> dict[str, Any]:
    """Return the status of a machine as :func:`read_status`, with what is seen without its daemon.

    That is a full disk, which keeps a daemon from writing its status, the age of the last backup, and why the latest
    attempt failed. Both are ``problems``, with which a running daemon is ``degraded``.
    """
    state_dir = config.machine.state_dir
    found, backup = read_status(state_dir), read_note(state_dir)
    problems = dict(found.get("problems", {}))
    if "stall" in found:
        problems["daemon"] = f"stalled: {found['stall']}"
    if (full := full_disk(state_dir, round(1e6 * config.machine.min_free_mb), free)) is not None:
        problems["disk"] = full
    if backup.get("problem"):
        problems["backup"] = f"the backup of {backup.get('failed_utc')} failed: {backup['problem']}"
    if problems:
        found["problems"] = problems
        if found.get("status") == "running":
            found["status"] = "degraded"
    made = backup.get("utc")
    age = None if made is None else round(max(0.0, clock() - datetime.fromisoformat(made).timestamp()), 3)
    return {**found, "last_backup_utc": made, "last_backup_age_s": age}


def full_disk(folder: Path, least: int, free: Callable[[Path], int]) -> str | None:
    """Return that a commit may find no room, or None; ``least`` is the room that the daemon keeps free, bytes."""
    least = max(least, _COMMIT_BYTES)
    try:
        found = free(folder)
    except OSError:
        return None
    if found >= least or (found >= _MIN_LOG_SHARE * least and found + _reusable(folder / "state.db") >= least):
        return None
    return _full_words(folder, found, least)


def _full_words(folder: Path, free: int, least: float) -> str:
    return f"{folder}: the disk is nearly full, {free / 1e6:.0f} MB are free, {least / 1e6:.0f} MB are needed"


class DiskGuard:
    """Detects a file system that is too full to go on, with hysteresis."""

    def __init__(
        self,
        folder: Path,
        free: Callable[[Path], int],
        least: int,
        reusable: Callable[[], int] = lambda: 0,
    ) -> None:
        """Keep folder, reader of its free bytes, and the bytes below which it is full until a quarter more is free.

        ``reusable`` returns the bytes inside the store that count as free, down to a quarter of ``least``.
        """
        self._folder, self._free, self._least, self._reusable = folder, free, least, reusable
        self._due = float("-inf")
        self.problem: str | None = None
        """Why nothing may be written, or None."""
        self.shortage: str | None = None
        """Why the store is to be thinned, or None: free space is below twice that at which nothing may be written."""

    def check(self, now: float) -> bool:
        """Check the file system every five seconds of the monotonic time ``now``; return whether there is room."""
        if now >= self._due:
            self._due = now + _CHECK_DISK_S
            self.problem = self._poll()
        return self.problem is None

    def _poll(self) -> str | None:
        try:
            free = self._free(self._folder)
        except OSError as error:
            return f"{self._folder}: cannot be looked at ({error.strerror or error})"
        least = self._least if self.problem is None else self._least * _DISK_HYSTERESIS
        enough = _THIN_FACTOR * self._least * (1.0 if self.shortage is None else _DISK_HYSTERESIS)
        usable = free if free >= enough else free + self._reusable()
        self.shortage = None if usable >= enough else f"{self._folder}: {free / 1e6:.0f} MB are free on the disk"
        if usable >= least and free >= _MIN_LOG_SHARE * self._least:
            return None
        return _full_words(self._folder, free, least)


def _reusable(store: Path) -> int:
    """Return the bytes inside a store that new blocks can take."""
    try:
        with SharedConnection(store) as shared:
            return reusable_bytes(shared)
    except StoreError:
        return 0


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def is_running(state_dir: Path) -> bool:
    """Return whether a daemon has the lock of a state folder."""
    try:
        lock = FileLock(state_dir / _LOCK, read_only=True)
    except OSError:
        return False
    try:
        return not lock.take(shared=True)
    finally:
        lock.close()


class ServiceManager:
    """The service manager named by the environment (``NOTIFY_SOCKET``, ``WATCHDOG_USEC``); does nothing without one."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        """Read address and period."""
        address = environment.get("NOTIFY_SOCKET", "")
        # A leading @ stands for the zero byte of the abstract name space.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        watchdog = environment.get("WATCHDOG_USEC", "")
        self._every = int(watchdog) / 4e6 if watchdog.isdigit() else None
        self._due = float("-inf")

    def send(self, *lines: str) -> None:
        """Send lines such as ``READY=1``; errors of the connection are ignored."""
        if not self._address:
            return
        with suppress(OSError), local_datagrams() as link:
            link.setblocking(False)
            link.sendto("\n".join(lines).encode(), self._address)

    def feed_watchdog(self, now: float) -> None:
        """Feed the watchdog, four times in its period; ``now`` is of a monotonic clock."""
        if self._every is not None and now >= self._due:
            self._due = now + self._every
            self.send("WATCHDOG=1")


def set_up_log(level: int) -> None:
    """Write the log of this program from a level on, and warnings of other packages, to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        JournalFormatter() if to_journal() else logging.Formatter("%(asctime)s %(levelname)s %(message)s")
    )
    logging.basicConfig(handlers=[handler], level=logging.WARNING)
    for package in ("monitor", "streams"):
        logging.getLogger(package).setLevel(level)


def to_journal(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether standard error is the journal: the stream in ``JOURNAL_STREAM`` (systemd.exec(5))."""
    # A program that redirects its output inherits the variable, so device and inode are compared.
    try:
        found = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError, AttributeError):
        return False
    return environment.get("JOURNAL_STREAM") == f"{found.st_dev}:{found.st_ino}"


class JournalFormatter(logging.Formatter):
    """Begins each line with its priority, as sd-daemon(3) has it, so that ``journalctl --priority`` finds it."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines of a record."""
        priority = next((value for level, value in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())
