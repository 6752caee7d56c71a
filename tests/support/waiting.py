"""Waits that fail on lack of progress, so that a slow or busy machine fails no test."""

from __future__ import annotations

import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from os import sysconf
from pathlib import Path
from typing import Any, Protocol

PATIENCE_S = 120.0
"""Time without progress after which a wait fails; also the timeout of a test's connections."""
MIN_WORK_S = 0.05 * PATIENCE_S
"""Processor time that counts as progress: an idle daemon uses less in that time."""
_TICKS_PER_S = sysconf("SC_CLK_TCK")


class Running(Protocol):
    """A process that was started: a :class:`subprocess.Popen` or a fork."""

    @property
    def pid(self) -> int:
        """Its number."""
        ...

    @property
    def returncode(self) -> Any:
        """Exit code, or None while it runs."""
        ...

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""
        ...

    def wait(self, timeout: float | None = None) -> int | None:
        """Wait for its end."""
        ...

    def communicate(self, *, timeout: float | None = None) -> tuple[Any, Any]:
        """Wait for its end; return its standard output and standard error."""
        ...

    def send_signal(self, sig: signal.Signals, /) -> None:
        """Send a signal."""
        ...

    def kill(self) -> None:
        """Kill it."""
        ...


def work_of_others() -> float:
    """Return the processor time of all child processes and of the other threads of this one, s."""
    return time.process_time() - time.thread_time() + sum(map(_family_work, _children("self")))


def _family_work(pid: str) -> float:
    with suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        ticks = sum(map(int, fields[11:15]))  # utime, stime and those of the children that ended
        return ticks / _TICKS_PER_S + sum(map(_family_work, _children(pid)))
    return 0.0


def _children(pid: str) -> list[str]:
    found: list[str] = []
    for tasks in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(OSError):
            found += tasks.read_text().split()
    return found


class Stall:
    """Lack of progress: the progress value stays the same, and little processor time is used."""

    def __init__(self, progress: Callable[[], object] | None = None, stalled_after: float = PATIENCE_S) -> None:
        """Begin to watch; ``stalled_after`` is in seconds."""
        self._progress, self._stalled_after = progress, stalled_after
        self._value = progress() if progress else None
        self._work, self._since = work_of_others(), time.monotonic()
        self._looked = self._since

    def check(self) -> None:
        """Raise AssertionError when nothing has gone on for too long."""
        now = time.monotonic()
        if now - self._looked < 0.01 * self._stalled_after:
            return
        self._looked = now
        value, work = self._progress() if self._progress else None, work_of_others()
        # The work of a child that ended and is not waited for is lost, hence the distance.
        if value != self._value or abs(work - self._work) > MIN_WORK_S:
            self._value, self._work, self._since = value, work, now
        elif now - self._since > self._stalled_after:
            raise AssertionError(f"no progress for {self._stalled_after:g} s (progress value: {value!r})")


def wait_until(
    condition: Callable[[], object],
    progress: Callable[[], object] | None = None,
    stalled_after: float = PATIENCE_S,
    every: float = 0.01,
) -> None:
    """Wait until a condition is true.

    Args:
        progress: value that changes while work goes on; processor time of child processes and threads counts always.
        stalled_after: time without progress after which the wait fails, s.
        every: least pause between two looks, s; a look that takes longer is followed by a pause as long.

    Raises:
        AssertionError: nothing went on for so long.
    """
    stall = Stall(progress, stalled_after)
    looked = time.monotonic()
    while not condition():
        stall.check()
        time.sleep(max(every, time.monotonic() - looked))
        looked = time.monotonic()


def finish(process: Running) -> str:
    """Wait for the end of a process; return its standard error."""
    stall = Stall()
    while True:
        try:
            return process.communicate(timeout=1.0)[1]
        except subprocess.TimeoutExpired:
            stall.check()


def stop(process: Running, number: signal.Signals = signal.SIGTERM) -> str:
    """Send a signal to a process and wait for its end; return its standard error."""
    process.send_signal(number)
    return finish(process)


def join(*threads: threading.Thread) -> None:
    """Wait for the end of threads."""
    wait_until(lambda: not any(thread.is_alive() for thread in threads))


def slowness(work: float = 0.1) -> float:
    """Return how much longer than alone a piece of work takes in this moment: wall time by processor time."""
    began, used = time.monotonic(), time.thread_time()
    while time.thread_time() - used < work:
        pass
    return max(1.0, (time.monotonic() - began) / work)


@contextmanager
def at_most(seconds: float) -> Iterator[None]:
    """Check that the block ends in a time that is stated for an idle machine, scaled by the load of this one."""
    slow, began = slowness(), time.monotonic()
    yield
    took = time.monotonic() - began
    assert took < seconds or took < seconds * max(slow, slowness())
