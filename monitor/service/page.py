"""The page of a daemon: a child process, restarted when it ends; no call waits for it."""

from __future__ import annotations

import contextlib
import json
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from monitor.config.web import WebSection
from monitor.service.child_process import Child, end_child, hear, start_child

_LOG = logging.getLogger(__name__)
_FIRST_PAUSE, _LONGEST_PAUSE = 1.0, 60.0
_SETTLED = 60.0
_SILENT = 60.0
_MOST_BYTES = 1 << 16
_ENTRY = "monitor.web.server:child"


class PageProcess:
    """Serves the page of one machine from a child process; its failure is a :attr:`problem`, never an exception.

    All methods are called from one thread.
    """

    def __init__(
        self,
        config: Path,
        web: WebSection,
        state_dir: Path,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take what it serves; nothing is started yet.

        Args:
            config: file of the machine.
            web: where it listens, and to whom.
            state_dir: where its token is kept if none is configured.
            monotonic: seconds that never go back.
        """
        self._given = {
            "config": str(config.absolute()),
            "web": web.model_dump(mode="json"),
            "state_dir": str(state_dir.absolute()),
        }
        self._monotonic = monotonic
        self._child: Child | None = None
        self._buffer = b""
        self._due, self._pause = monotonic(), _FIRST_PAUSE
        self._started = self._heard = monotonic()
        self._said: str | None = None
        self.url: str | None = None
        """Address of the page once it answers, or None."""
        self.problem: str | None = None
        """What keeps it from being served whole, in one sentence, or None."""

    @property
    def pid(self) -> int | None:
        """Number of the child process, or None where none is running."""
        return None if self._child is None else self._child.pid

    def tick(self) -> None:
        """Start it when it is time, take what it says, and note that it ended or says nothing any more."""
        now = self._monotonic()
        if self._child is None:
            if now >= self._due:
                self._begin(now)
            return
        self._listen(self._child, now)
        if self._child is not None and now - self._heard > _SILENT:
            self._fail(f"the page has said nothing for {_SILENT:.0f} s", now)

    def close(self) -> None:
        """End it within a second."""
        child, self._child = self._child, None
        self.url, self._buffer = None, b""
        self._due = float("inf")
        if child is not None:
            end_child(child)

    def _begin(self, now: float) -> None:
        self._started = self._heard = now
        self._said = None
        try:
            self._child = start_child(_ENTRY, json.dumps(self._given))
        except OSError as error:
            self._fail(f"the page cannot be started: {error.strerror or error}", now)

    def _listen(self, child: Child, now: float) -> None:
        part = hear(child, 0.0, _MOST_BYTES)
        if part is None:
            return
        if not part:
            self._fail(self._said or "the page ended unexpectedly", now)
            return
        self._heard = now
        *lines, self._buffer = (self._buffer + part).split(b"\n")
        for line in lines:
            with contextlib.suppress(ValueError):
                self._take(json.loads(line))
        if now - self._started > _SETTLED:
            self._pause = _FIRST_PAUSE

    def _take(self, said: dict[str, Any]) -> None:
        if "problem" in said:
            self._said = str(said["problem"])
            self._say(self._said)
        if "url" in said:
            self.url = str(said["url"])
            _LOG.info("the page is at %s", self.url)
            # What it said before it listened is of a part of it, and goes on.
            self._say(self._said)

    def _fail(self, problem: str, now: float) -> None:
        child, self._child = self._child, None
        self.url, self._buffer = None, b""
        self._due = now + self._pause
        self._pause = min(2.0 * self._pause, _LONGEST_PAUSE)
        if child is not None:
            end_child(child)
        self._say(problem)

    def _say(self, problem: str | None) -> None:
        if problem != self.problem:
            if problem is None:
                _LOG.warning("the page is served again")
            else:
                _LOG.error("page: %s", problem)
        self.problem = problem
