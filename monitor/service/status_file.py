"""The small file in which a running daemon says what it is doing, and whether it runs at all."""

from __future__ import annotations

import fcntl
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from monitor.records.database import StoreError

_NAME = "status.json"
_LOCK = "daemon.lock"
_PATIENCE = 1.0


class StatusFile:
    """Written by the one daemon of a state folder, replaced whole each time; use :meth:`open`."""

    def __init__(self, path: Path, lock: int) -> None:
        """Take over an open lock; :meth:`open` is the way to get one."""
        self.path = path
        self._lock: int | None = lock

    @classmethod
    def open(cls, state_dir: Path) -> Self:
        """Become the daemon of a state folder, which is made where it is missing.

        Raises:
            StoreError: another daemon has it, or the folder cannot be written.
        """
        try:
            state_dir.mkdir(parents=True, exist_ok=True)
            lock = os.open(state_dir / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StoreError(f"{state_dir}: {error.strerror or error}") from None
        until = time.monotonic() + _PATIENCE
        # Whoever asks whether a daemon runs holds the lock for a moment.
        while not _try_lock(lock, fcntl.LOCK_EX):
            if time.monotonic() >= until:
                os.close(lock)
                raise StoreError(f"{state_dir}: another daemon is running for this machine; there can be only one")
            time.sleep(0.02)
        return cls(state_dir / _NAME, lock)

    def write(self, values: Mapping[str, Any]) -> None:
        """Replace what the file says.

        Raises:
            OSError: it cannot be written; the old one is intact.
        """
        temporary = self.path.with_name(f".{_NAME}.tmp")
        temporary.write_text(json.dumps(values, allow_nan=False), encoding="utf-8")
        temporary.replace(self.path)

    def close(self) -> None:
        """Let another daemon in; closing twice does nothing."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __enter__(self) -> Self:
        """Return the file itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of the lock."""
        self.close()


def read_status(state_dir: Path) -> dict[str, Any]:
    """Return what the daemon of a state folder said last, with ``running``: whether it still is.

    Where none is running, ``status`` is ``stopped`` (it ended in order), ``died``, or ``never_ran``.
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
