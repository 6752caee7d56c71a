"""Publication of record files by a child process, at the request of the thread that commits."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from monitor.records.database import StoreError
from monitor.records.store import Published, Store
from monitor.service.child_process import Child, close_pipes, end_child, read_output, start_child

_LOG = logging.getLogger(__name__)
_MAX_PUBLICATION_S = 600.0
_MIN_PAUSE_FACTOR = 20.0
_CHECK_TURNS = 10
_MAX_ANSWERS = 200
"""Publications after which a new child takes over: the libraries leak some kilobytes with every file."""


class Publisher:
    """Publishes at intervals; a failure is a :attr:`problem`, never an exception.

    All methods are called from the thread that owns the store.
    """

    def __init__(
        self,
        store: Store,
        records_dir: Path,
        every: float = 60.0,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Keep a store that is open for writing, and the least seconds ``every`` from publication to publication."""
        self._store, self._records_dir = store, records_dir
        self._every, self._monotonic = every, monotonic
        self._child: Child | None = None
        self._buffer = b""
        self._answers = 0
        self._retired: Child | None = None
        self._requested_at: float | None = None
        self._due = monotonic()
        # Files may have been lost or damaged since the last run.
        self._changed = True
        self._idle_turns = 0
        self.problem: str | None = None
        """Why files are not published, or None."""

    @property
    def busy(self) -> bool:
        """Whether a publication is under way."""
        return self._requested_at is not None

    @property
    def pid(self) -> int | None:
        """Number of the child process, or None where none is running."""
        return None if self._child is None else self._child.pid

    def changed(self) -> None:
        """Note that there is more to publish."""
        self._changed = True

    def tick(self) -> None:
        """Read an answer that has come, and send a request when it is due."""
        now = self._monotonic()
        if self.busy:
            self._collect(0.0)
            if self._requested_at is not None and now - self._requested_at > _MAX_PUBLICATION_S:
                self._fail(f"publishing takes longer than {_MAX_PUBLICATION_S:.0f} s")
        elif now >= self._due:
            self._idle_turns += 1
            if self._changed or self._idle_turns >= _CHECK_TURNS:
                self._request()
            else:
                self._due = now + self._every

    def finish(self, seconds: float) -> bool:
        """Publish everything within so many seconds; return whether it succeeded."""
        until = time.monotonic() + seconds
        while self.busy and time.monotonic() < until:
            self._collect(until - time.monotonic())
        if self.busy:
            return False
        if self._changed:
            self._request()
        while self.busy and time.monotonic() < until:
            self._collect(until - time.monotonic())
        return not self.busy and self.problem is None

    def close(self) -> None:
        """End the child; a file that it was replacing keeps its old content."""
        self._requested_at = None
        earlier, self._retired = self._retired, None
        self._retire()
        later, self._retired = self._retired, None
        for child in (earlier, later):
            if child is not None:
                end_child(child)

    def _retire(self) -> None:
        """Let the child end after its present publication."""
        child, self._child = self._child, None
        self._answers, self._buffer = 0, b""
        if child is None:
            return
        self._retired = child
        close_pipes(child)

    def _request(self) -> None:
        self._requested_at, self._changed, self._idle_turns = self._monotonic(), False, 0
        try:
            if self._child is None:
                self._child = start_child(
                    "monitor.service.publish_worker:main",
                    str(self._store.path.absolute()),
                    str(self._records_dir.absolute()),
                )
            assert self._child.stdin is not None
            self._child.stdin.write(b"publish\n")
            self._child.stdin.flush()
        except OSError as error:
            self._fail(f"the publisher cannot be asked: {error.strerror or error}")

    def _collect(self, timeout: float) -> None:
        """Read the child's answer, waiting at most ``timeout`` seconds."""
        assert self._child is not None
        part = read_output(self._child, timeout, 1 << 20)
        if part is None:
            return
        self._buffer += part
        if not part:
            self._fail("the publisher ended unexpectedly")
        elif self._buffer.endswith(b"\n"):
            line, self._buffer = self._buffer, b""
            self._take(json.loads(line))

    def _take(self, answer: dict[str, Any]) -> None:
        """Note what was written; what cannot be noted is published again."""
        took = float(answer["seconds"])
        self._requested_at = None
        self._due = self._monotonic() + max(self._every, _MIN_PAUSE_FACTOR * took)
        try:
            for done in answer["published"]:
                self._store.note_published(Published(*done))
        except StoreError as error:
            _LOG.warning("what was published cannot be noted: %s", error)
            self._changed = True
        if answer["published"]:
            _LOG.info("published %s in %.1f s", ", ".join(str(done[0]) for done in answer["published"]), took)
        self._set_problem(answer["problem"])
        self._answers += 1
        if self._answers >= _MAX_ANSWERS and (self._retired is None or self._retired.poll() is not None):
            self._retire()

    def _fail(self, problem: str) -> None:
        self.close()
        self._due = self._monotonic() + self._every
        self._set_problem(problem)

    def _set_problem(self, problem: str | None) -> None:
        if problem is not None:
            self._changed = True
        if problem != self.problem:
            if problem is None:
                _LOG.warning("publishing works again")
            else:
                _LOG.error("publishing fails: %s", problem)
        self.problem = problem
