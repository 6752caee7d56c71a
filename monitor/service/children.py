"""Child processes and threads of the daemon: start, read without waiting, end; both are started again after an end.

Pauses and bound are those of :mod:`models.platform.supervision`.

A server reports on its standard output, one JSON object a line: ``url`` once it listens, ``problem``, and anything
every few seconds, also ``listener``, counts of its connections.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from models.platform.portable import PipeReader
from models.platform.process_signals import child_path
from models.platform.supervision import OwnedThread, Restarts
from monitor.config.outputs import WebSection

_LOG = logging.getLogger(__name__)
_PAGE = "monitor.web.server:child"
_END_S = 0.5
_MAX_BYTES = 1 << 16
_MAX_SILENCE_S = 60.0
_MAX_ATTEMPT_S = 600.0
"""Time without a pause after which a thread is taken to hang."""
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


class _Rest(threading.Condition):
    """A condition that knows since when its thread has not waited."""

    busy_since: float | None = None

    def wait(self, timeout: float | None = None) -> bool:
        """Wait as a condition does."""
        self.busy_since = None
        try:
            return super().wait(timeout)
        finally:
            self.busy_since = time.monotonic()


class Worker:
    """A thread that is woken where there is something new; its failure is a :attr:`problem`, never an exception.

    A subclass gives ``_work``, and starts the thread; its owner calls :meth:`tend`.
    """

    def __init__(self, name: str) -> None:
        """Make the thread of a name."""
        self.problem: str | None = None
        """Why the latest attempt failed, or None."""
        self._wake = _Rest()
        self._news = self._ending = False
        self.restarts = Restarts(f"the thread {name}")
        self._thread = OwnedThread(self.restarts, self._work, thread=name)

    def changed(self) -> None:
        """Note that there is something new; returns at once."""
        with self._wake:
            self._news = True
            self._wake.notify()

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def tend(self) -> None:
        """Start the thread again where it has ended."""
        self._thread.tend()

    def trouble(self) -> str | None:
        """Return that the thread has ended or hangs, or else the :attr:`problem`.

        One that hangs is not replaced: what it does may be done twice then.
        """
        since = self._wake.busy_since
        busy = None if since is None or not self._thread.alive else time.monotonic() - since
        if busy is not None and busy > _MAX_ATTEMPT_S:
            return f"{self.restarts.name} has not come back from its latest attempt for {busy:.0f} s"
        return self._thread.problem() or self.problem

    def join(self, seconds: float) -> None:
        """Wait for the end for at most so many seconds."""
        self._thread.join(seconds)

    def end(self) -> None:
        """Let the thread end; returns at once."""
        self._thread.end()
        with self._wake:
            self._ending = True
            self._wake.notify()

    def _work(self) -> None:
        """Work until the end, in the thread."""
        raise NotImplementedError


class ServerProcess:
    """Keeps one server running, from one thread; its failure is a :attr:`problem`, never an exception."""

    def __init__(
        self, name: str, entry: str, request: Mapping[str, Any], monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        """Keep what the function ``entry`` is given as JSON; :meth:`tick` starts the child.

        ``name`` begins sentences about the server, such as "the page".
        """
        self._name, self._entry, self._request = name, entry, dict(request)
        self._monotonic = monotonic
        self._child: Child | None = None
        self.restarts = Restarts(name, monotonic)
        self._closed = False
        self._last_output = monotonic()
        self._reason: str | None = None
        self.url: str | None = None
        """Address of the server once it answers, or None."""
        self.problem: str | None = None
        """Why nothing is served, or None."""
        self.listener: Mapping[str, Any] | None = None
        """Counts of its connections, where it reports them."""

    @property
    def pid(self) -> int | None:
        """Number of the child process, or None where none is running."""
        return None if self._child is None else self._child.pid

    def tick(self) -> None:
        """Start the child when it is due, read its output, and note that it ended or hangs."""
        now = self._monotonic()
        if self._child is None:
            if self.restarts.due and not self._closed:
                self._begin(now)
            return
        self._read(self._child, now)
        if self._child is not None and now - self._last_output > _MAX_SILENCE_S:
            self._fail(f"{self._name} has said nothing for {_MAX_SILENCE_S:.0f} s")

    def close(self) -> None:
        """End it within a second."""
        child, self._child = self._child, None
        self.url, self._closed = None, True
        if child is not None:
            child.end()

    def _begin(self, now: float) -> None:
        self._last_output = now
        self._reason = None
        try:
            self._child = Child(self._entry, json.dumps(self._request))
        except OSError as error:
            self._fail(f"{self._name} cannot be started: {error.strerror or error}")
            return
        self.restarts.started()

    def _read(self, child: Child, now: float) -> None:
        lines = child.read_lines()
        if lines is None:
            self._fail(self._reason or f"{self._name} ended unexpectedly")
            return
        for line in lines:
            self._last_output = now
            with contextlib.suppress(ValueError):
                self._take(json.loads(line))
        if lines:
            self.restarts.runs()

    def _take(self, line: dict[str, Any]) -> None:
        if "problem" in line:
            self._reason = str(line["problem"])
        self.listener = line.get("listener", self.listener)
        if "url" in line:
            self.url = str(line["url"])
            _LOG.info("%s is at %s", self._name, self.url)
            self._note(None)

    def _fail(self, problem: str) -> None:
        child, self._child = self._child, None
        self.url = self.listener = None
        if child is not None:
            child.end()
        self.restarts.failed(problem)
        self._note(self.restarts.problem() or problem)

    def _note(self, problem: str | None) -> None:
        if problem != self.problem:
            if problem is None:
                _LOG.warning("%s is served again", self._name)
            else:
                _LOG.error("%s: %s", self._name.removeprefix("the "), problem)
        self.problem = problem


def page_server(
    config: Path, web: WebSection, state_dir: Path, monotonic: Callable[[], float] = time.monotonic
) -> ServerProcess:
    """Return the server of the page of one machine.

    It keeps file and section of the configuration, and the folder of the token.
    """
    request = {
        "config": str(config.absolute()),
        "web": web.model_dump(mode="json"),
        "state_dir": str(state_dir.absolute()),
    }
    return ServerProcess("the page", _PAGE, request, monotonic)
