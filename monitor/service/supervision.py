"""Between a supervisor and the daemons that it starts: who supervises a machine, and what it says of it."""

from __future__ import annotations

import fcntl
import json
import os
import threading
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from monitor.records.database import StoreError

_NAME = "supervisor.json"
_LOCK = "supervisor.lock"
_ENDS_WITHIN = 10.0
_PATIENCE = 1.0


class Supervision:
    """The supervisor's hold on the state folder of one machine, and its file there; use as long as it is supervised."""

    def __init__(self, state_dir: Path) -> None:
        """Become the supervisor of a machine; its state folder is made where it is missing.

        Raises:
            StoreError: another supervisor has it, or the folder cannot be written.
        """
        self._path = state_dir / _NAME
        try:
            state_dir.mkdir(parents=True, exist_ok=True)
            self._lock: int | None = os.open(state_dir / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StoreError(f"{state_dir}: {error.strerror or error}") from None
        until = time.monotonic() + _PATIENCE
        # Whoever asks what a supervisor says holds the lock for a moment.
        while not _try_lock(self._lock):
            if time.monotonic() >= until:
                os.close(self._lock)
                raise StoreError(f"{state_dir}: another supervisor is running for this machine; there can be only one")
            time.sleep(0.02)
        self._said: dict[str, Any] = {}

    def say(self, values: Mapping[str, Any]) -> None:
        """Replace what the file says where it changed; a disk that does not take it is left to the daemon to report."""
        if values == self._said:
            return
        self._said = dict(values)
        temporary = self._path.with_name(f".{_NAME}.tmp")
        with suppress(OSError):
            temporary.write_text(json.dumps(self._said, allow_nan=False), encoding="utf-8")
            temporary.replace(self._path)

    def close(self) -> None:
        """Take the file away and let another supervisor in; closing twice does nothing."""
        if self._lock is not None:
            with suppress(OSError):
                self._path.unlink(missing_ok=True)
            os.close(self._lock)
            self._lock = None


def read_supervision(state_dir: Path) -> dict[str, Any] | None:
    """Return what the supervisor of a machine says of it, or None where it has none that runs.

    Returns:
        ``pid`` of the supervisor; ``starts``, how often it has started the daemon; ``problem``, why the daemon does not
        run, in one sentence, or None; ``page``, the address of the page of all machines, or None.
    """
    try:
        lock = os.open(state_dir / _LOCK, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        # Shared: whoever asks at the same time is not taken for a supervisor.
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _read(state_dir / _NAME)
    finally:
        os.close(lock)
    return None


def end_with_supervisor(stop: threading.Event, descriptor: int = 0) -> None:
    """Ask this process to stop when its supervisor has gone, however that ended: its end of a pipe is then closed.

    Args:
        stop: is set then.
        descriptor: of the pipe, by default standard input.
    """

    def wait() -> None:
        with suppress(OSError):
            while os.read(descriptor, 512):
                pass
        stop.set()
        # What hangs must not keep the locks of the machine from the next supervisor. This thread ends with the others.
        threading.Event().wait(_ENDS_WITHIN)
        os._exit(1)

    threading.Thread(target=wait, name="supervisor", daemon=True).start()


def _try_lock(lock: int) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _read(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None
