"""The status file of a daemon, and the lock that shows whether it runs."""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from monitor.records.database import Closing, StoreError

_NAME = "status.json"
_LOCK = "daemon.lock"
_LOCK_S = 1.0


class StatusFile(Closing):
    """Written by the one daemon of a state folder, replaced atomically; use :meth:`open`."""

    def __init__(self, path: Path, lock: int) -> None:
        """Own an open lock; see :meth:`open`."""
        self.path = path
        self._lock: int | None = lock

    @classmethod
    def open(cls, state_dir: Path) -> Self:
        """Take the lock of a state folder, which is created if it is missing.

        Raises:
            StoreError: another daemon has it, or the folder cannot be written.
        """
        try:
            state_dir.mkdir(parents=True, exist_ok=True)
            lock = os.open(state_dir / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StoreError(f"{state_dir}: {error.strerror or error}") from None
        until = time.monotonic() + _LOCK_S
        # A reader of the status holds the lock for a moment.
        while not _try_lock(lock, fcntl.LOCK_EX):
            if time.monotonic() >= until:
                os.close(lock)
                raise StoreError(f"{state_dir}: another daemon is running for this machine; there can be only one")
            time.sleep(0.02)
        return cls(state_dir / _NAME, lock)

    def write(self, values: Mapping[str, Any]) -> None:
        """Replace the content of the file; OSError leaves the old content."""
        temporary = self.path.with_name(f".{_NAME}.tmp")
        temporary.write_text(json.dumps(values, allow_nan=False), encoding="utf-8")
        temporary.replace(self.path)

    def close(self) -> None:
        """Release the lock; closing twice does nothing."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def read_status(state_dir: Path) -> dict[str, Any]:
    """Return the latest status of a daemon, with ``running``: whether it still runs.

    Where none is running, ``status`` is ``stopped`` (it ended normally), ``died``, or ``never_ran``.
    """
    found = _read(state_dir / _NAME)
    running = _is_locked(state_dir / _LOCK)
    if not running:
        found["status"] = ("stopped" if found.get("status") == "stopped" else "died") if found else "never_ran"
    elif not found:
        found["status"] = "starting"
    return {"running": running, **found}


def _read(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _is_locked(path: Path) -> bool:
    try:
        lock = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return not _try_lock(lock, fcntl.LOCK_SH)
    finally:
        os.close(lock)


def _try_lock(lock: int, kind: int) -> bool:
    try:
        fcntl.flock(lock, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
