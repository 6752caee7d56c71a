"""Child processes of the daemon: start, read without waiting, end."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Mapping
from typing import Any

from models.installation import child_path
from models.portable import PipeReader

_END_S = 0.5
_MAX_BYTES = 1 << 16
# A service manager signals all processes at once; a child goes on until its parent closes its standard input.
_START = """
import signal, sys
for name in ("SIGINT", "SIGTERM", "SIGHUP"):
    if hasattr(signal, name):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
import importlib, json
sys.path[:] = json.loads(sys.argv.pop())
module, _, function = sys.argv.pop(1).partition(":")
getattr(importlib.import_module(module), function)()
"""


def end_with_parent() -> None:
    """In a child: end it as soon as its standard input ends, because the parent closed it or has ended."""
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()


def _end_with_parent() -> None:
    while os.read(0, 4096):
        pass
    os._exit(0)


def report_line(values: Mapping[str, Any]) -> None:
    """In a child: report a JSON object as a line of standard output; end where nothing reads it any more."""
    try:
        print(json.dumps(values), flush=True)
    except OSError:
        os._exit(0)


class Child:
    """A child process with pipes that runs the function ``module:function`` with ``sys.argv[1:]``."""

    def __init__(self, entry: str, *arguments: str) -> None:
        """Start it; may raise OSError."""
        command = [sys.executable, "-P", "-c", _START, entry, *arguments, json.dumps(child_path())]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input = self._process.stdin
        with self._process.stdout as output:
            self._output = PipeReader(os.dup(output.fileno()))
        self._buffer = b""
        self.pid = self._process.pid

    @property
    def ended(self) -> bool:
        """Whether it runs no more."""
        return self._process.poll() is not None

    def write(self, line: bytes) -> None:
        """Write to its standard input; OSError where it has ended."""
        self._input.write(line)
        self._input.flush()

    def read_lines(self, timeout: float = 0.0) -> list[bytes] | None:
        """Return the new complete lines of its output, waiting at most ``timeout`` (s); None if it has ended."""
        if not self._output.wait(timeout):
            return []
        part = self._output.read(_MAX_BYTES)
        *lines, self._buffer = (self._buffer + part).split(b"\n")
        return lines if part else None

    def close_pipes(self) -> None:
        """Close its pipes; it ends after its present task."""
        for pipe in (self._input, self._output):
            with contextlib.suppress(OSError):
                pipe.close()

    def end(self) -> None:
        """Close its pipes and kill it if it does not end, within a second.

        A child that hangs in an unreachable network share cannot be killed yet; it is left behind, and waited for
        beside.
        """
        self.close_pipes()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                threading.Thread(target=self._process.wait, daemon=True).start()
