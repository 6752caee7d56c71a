"""Owners of threads and child processes: when one that ended is started again, and when it stays down.

An owner starts again what failed, after 1 s at first and twice as long after each further failure, up to a minute. Ten
failures within ten minutes are a lasting fault: it stays down for a quarter of an hour, is a problem and an event, and
has one attempt then. A minute without a failure ends all that. docs/ARCHITECTURE.md lists the owners.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from models.words.errors import SpallwatchError

_LOG = logging.getLogger(__name__)
MIN_PAUSE_S, MAX_PAUSE_S = 1.0, 60.0
MAX_FAILURES, WINDOW_S = 10, 600.0
"""Failures within so many seconds after which it stays down."""
STABLE_S = 60.0
REST_S = 900.0
"""Seconds between two attempts of what stays down."""
MAX_SILENCE_S = 30.0
_MAX_LOOK_S = 1.0
"""Longest time between two looks that counts as silence: a process that was frozen does not hang."""


class LostThreadError(SpallwatchError):
    """A thread that cannot be replaced hangs; the process ends, and its service manager starts it again."""


class Restarts:
    """Failures of one thread or child, the next start, and what a status says of them."""

    def __init__(
        self,
        name: str,
        monotonic: Callable[[], float] = time.monotonic,
        clock: Callable[[], float] = time.time,
    ) -> None:
        """Begin without a failure; ``name`` begins sentences, ``clock`` gives UTC seconds."""
        self.name = name
        self._monotonic, self._clock = monotonic, clock
        self._recent: deque[float] = deque(maxlen=MAX_FAILURES)
        self._pause, self._due = MIN_PAUSE_S, float("-inf")
        self._started: float | None = None
        self._news: str | None = None
        self.failures = self.count = 0
        """Failures, and starts after one."""
        self.cause: str | None = None
        self._last: float | None = None
        self.down = False
        """Whether it stays down, but for an attempt now and then."""

    @property
    def due(self) -> bool:
        """Whether it may be started now."""
        return self.wait_s <= 0.0

    @property
    def wait_s(self) -> float:
        """Seconds until it may be started, 0 or less where that is now."""
        return self._due - self._monotonic()

    def started(self) -> None:
        """Note a start."""
        self._started = self._monotonic()
        if self.cause is not None:
            self.count += 1
            self._last = self._clock()

    def runs(self) -> None:
        """Note that it runs, at each look of the owner: after a minute its failures are over."""
        if self.cause is None or self._started is None or self._monotonic() - self._started < STABLE_S:
            return
        if self.down:
            _LOG.warning("%s runs again", self.name)
        self._pause, self.down = MIN_PAUSE_S, False

    def failed(self, cause: str) -> None:
        """Note an end; ``cause`` is a sentence without the name."""
        self.runs()
        now = self._monotonic()
        self.failures, self.cause, self._started = self.failures + 1, cause, None
        self._recent.append(now)
        if self.down or (len(self._recent) == MAX_FAILURES and now - self._recent[0] <= WINDOW_S):
            if not self.down:
                self._news = f"{self.name} failed {MAX_FAILURES} times within {WINDOW_S / 60:.0f} minutes: {cause}"
                _LOG.error("%s; tried again every %.0f minutes", self._news, REST_S / 60)
            self.down, self._due = True, now + REST_S
            return
        self._due = now + self._pause
        self._pause = min(2.0 * self._pause, MAX_PAUSE_S)

    def problem(self) -> str | None:
        """Return that it stays down and why, or None."""
        if not self.down:
            return None
        return (
            f"{self.name} stays down after {MAX_FAILURES} failures within {WINDOW_S / 60:.0f} minutes, and is tried "
            f"every {REST_S / 60:.0f} minutes: {self.cause}"
        )

    def take_news(self) -> str | None:
        """Return once that it was given up, for the event log."""
        news, self._news = self._news, None
        return news

    def values(self) -> dict[str, Any]:
        """Return count, cause and time of the last restart, and whether it stays down, for JSON."""
        last = None if self._last is None else datetime.fromtimestamp(self._last, UTC).isoformat(timespec="seconds")
        return {
            "failures": self.failures,
            "count": self.count,
            "cause": self.cause,
            "last_utc": last,
            "down": self.down,
        }


class OwnedThread:
    """A thread that is started again where it ends with an exception.

    :meth:`tend` is called by the owner about every second. A thread that calls :meth:`turn` at least every few seconds
    is watched for that; one that hangs cannot be replaced.
    """

    def __init__(
        self,
        restarts: Restarts,
        work: Callable[[], None],
        prepare: Callable[[], None] = lambda: None,
        *,
        turns: bool = False,
        thread: str | None = None,
    ) -> None:
        """Keep the work, which returns only at the end, and what is done in the owner's thread before each start.

        Args:
            restarts: of this thread.
            work: of the thread.
            prepare: its exception prevents the start.
            turns: whether the work calls :meth:`turn`.
            thread: name of the thread.
        """
        self.restarts, self._work, self._prepare, self._turns = restarts, work, prepare, turns
        self._name = thread or restarts.name
        self._thread: threading.Thread | None = None
        self._cause: str | None = None
        self._begun = self._ended = False
        self._turned = self._seen = 0
        self._silent_s, self._looked = 0.0, time.monotonic()

    def start(self) -> None:
        """Start it the first time; raise what ``prepare`` raises. A thread that cannot be had is tried again."""
        self._prepare()
        self._begun = True
        self._launch()

    def turn(self) -> None:
        """In the thread: note that it goes on."""
        self._turned += 1

    def tend(self) -> None:
        """Start it again where that is due.

        Raises:
            LostThreadError: it has not gone on for half a minute.
        """
        if self._ended or not self._begun:
            return
        thread = self._thread
        if thread is not None and thread.is_alive():
            self._check_turns()
            self.restarts.runs()
            return
        if thread is not None:
            self._thread = None
            self.restarts.failed(self._cause or "it ended unexpectedly")
        if self.restarts.due:
            try:
                self._prepare()
            except Exception as error:  # Whatever keeps it from starting is tried again.
                self.restarts.failed(str(error) or type(error).__name__)
                return
            self._launch()

    def end(self) -> None:
        """Start it no more."""
        self._ended = True

    def join(self, seconds: float) -> None:
        """Wait for the end for at most so many seconds."""
        if self._thread is not None:
            self._thread.join(seconds)

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def problem(self) -> str | None:
        """Return that it does not run though it should, or None."""
        if self._ended or not self._begun or self.alive:
            return self.restarts.problem()
        cause = self._cause or self.restarts.cause
        return self.restarts.problem() or f"{self.restarts.name} has ended and is started again: {cause}"

    def _launch(self) -> None:
        self._cause = None
        thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        try:
            thread.start()
        except RuntimeError as error:  # The system gives no more threads.
            self.restarts.failed(str(error))
            return
        self._thread = thread
        self.restarts.started()

    def _run(self) -> None:
        try:
            self._work()
        except BaseException as error:  # Whatever ends a thread is known to its owner.
            self._cause = f"{type(error).__name__}: {error}".rstrip(": ")
            _LOG.exception("%s ended and is started again", self.restarts.name)
        else:
            self._ended = True

    def _check_turns(self) -> None:
        now = time.monotonic()
        passed, self._looked = min(now - self._looked, _MAX_LOOK_S), now
        if not self._turns or self._turned != self._seen:
            self._seen, self._silent_s = self._turned, 0.0
            return
        self._silent_s += passed
        if self._silent_s > MAX_SILENCE_S:
            raise LostThreadError(f"{self.restarts.name} hangs for {MAX_SILENCE_S:.0f} s and cannot be replaced")
