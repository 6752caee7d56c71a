"""A server in a child process of the daemon: started, watched, and started again after it ended.

The child reports on its standard output, one JSON object a line: ``url`` once it listens, ``problem``, and anything
every few seconds.
"""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any

from monitor.service.child_process import Child

_LOG = logging.getLogger(__name__)
_MIN_PAUSE_S, _MAX_PAUSE_S = 1.0, 60.0
_STABLE_S = 60.0
_MAX_SILENCE_S = 60.0


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
        self._due, self._pause = monotonic(), _MIN_PAUSE_S
        self._started = self._last_output = monotonic()
        self._reason: str | None = None
        self.url: str | None = None
        """Address of the server once it answers, or None."""
        self.problem: str | None = None
        """Why nothing is served, or None."""

    @property
    def pid(self) -> int | None:
        """Number of the child process, or None where none is running."""
        return None if self._child is None else self._child.pid

    def tick(self) -> None:
        """Start the child when it is due, read its output, and note that it ended or hangs."""
        now = self._monotonic()
        if self._child is None:
            if now >= self._due:
                self._begin(now)
            return
        self._read(self._child, now)
        if self._child is not None and now - self._last_output > _MAX_SILENCE_S:
            self._fail(f"{self._name} has said nothing for {_MAX_SILENCE_S:.0f} s", now)

    def close(self) -> None:
        """End it within a second."""
        child, self._child = self._child, None
        self.url, self._due = None, float("inf")
        if child is not None:
            child.end()

    def _begin(self, now: float) -> None:
        self._started = self._last_output = now
        self._reason = None
        try:
            self._child = Child(self._entry, json.dumps(self._request))
        except OSError as error:
            self._fail(f"{self._name} cannot be started: {error.strerror or error}", now)

    def _read(self, child: Child, now: float) -> None:
        lines = child.read_lines()
        if lines is None:
            self._fail(self._reason or f"{self._name} ended unexpectedly", now)
            return
        for line in lines:
            self._last_output = now
            with contextlib.suppress(ValueError):
                self._take(json.loads(line))
        if lines and now - self._started > _STABLE_S:
            self._pause = _MIN_PAUSE_S

    def _take(self, line: dict[str, Any]) -> None:
        if "problem" in line:
            self._reason = str(line["problem"])
        if "url" in line:
            self.url = str(line["url"])
            _LOG.info("%s is at %s", self._name, self.url)
            self._note(None)

    def _fail(self, problem: str, now: float) -> None:
        child, self._child = self._child, None
        self.url, self._due = None, now + self._pause
        self._pause = min(2.0 * self._pause, _MAX_PAUSE_S)
        if child is not None:
            child.end()
        self._note(problem)

    def _note(self, problem: str | None) -> None:
        if problem != self.problem:
            if problem is None:
                _LOG.warning("%s is served again", self._name)
            else:
                _LOG.error("%s: %s", self._name.removeprefix("the "), problem)
        self.problem = problem
