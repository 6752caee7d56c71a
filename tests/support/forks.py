"""Processes that are forked from one that has loaded the product: most of the life of a new program is its imports."""

from __future__ import annotations

import atexit
import logging
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from signal import SIGKILL, Signals
from typing import Any

import pytest

from tests.support.effort import effort_count
from tests.support.forked_children import PRELOADED, ForkedProcess, address_of_forks, fork_children_too
from tests.support.pace import quicken
from tests.support.waiting import wait_until

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(
    [
        *("pytest", "monitor.cli", "monitor.commands.run", "monitor.service.daemon"),
        *(*PRELOADED, "tests.support.forked_children", "tests.support.pace"),
    ]
)
# Full effort starts the children of daemons as programs.
_FORKED_CHILDREN = effort_count(quick=1, full=0) == 1


def fork_workers(patch: pytest.MonkeyPatch) -> None:
    """Fork the processes of a pool of work in quick effort; tests of the pool itself start interpreters."""
    if _FORKED_CHILDREN:
        patch.setattr("models.work.pool.multiprocessing.get_context", lambda _: _CONTEXT)


class Fork:
    """A process that runs a function of an importable module and sends messages; use :meth:`kill` or :meth:`finish`."""

    def __init__(self, target: Callable[..., None], *arguments: object) -> None:
        """Start ``target(messages, *arguments)``; ``messages.send`` sends one to this process."""
        self._messages, theirs = _CONTEXT.Pipe(duplex=False)
        self._process = _CONTEXT.Process(target=target, args=(theirs, *arguments))
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int:
        """Number of the process."""
        assert self._process.pid is not None
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.is_alive()

    def receive(self) -> Any:
        """Return the next message; EOFError when the process ended without another."""
        return self._messages.recv()

    def kill(self) -> list[Any]:
        """Kill the process; return the messages that were not received before."""
        self._process.kill()
        return self.finish()

    def finish(self) -> list[Any]:
        """Wait for the end of the process; return the messages that were not received before."""
        wait_until(lambda: not self._process.is_alive())
        messages: list[Any] = []
        while self._messages.poll():
            try:
                messages.append(self._messages.recv())
            except EOFError:
                break
        self._messages.close()
        self._process.close()
        return messages


Messages = Connection
"""Where a forked function sends its messages."""


def _run_program(words: Sequence[str], folder: Path, environment: Mapping[str, str], errors: str, forks: str) -> None:
    """Become the program: its words, folder, environment and standard error; end as it does."""
    from monitor.cli import main

    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    time.tzset()
    quicken()
    if forks:
        fork_children_too(forks)
    os.dup2(os.open(errors, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600), 2)
    sys.argv = ["spallwatch", *words]
    try:
        main()
    finally:
        # A process of multiprocessing ends without them.
        atexit._run_exitfuncs()
        logging.shutdown()


class ForkedProgram(ForkedProcess):
    """The program spallwatch in a fork, with those methods of a :class:`subprocess.Popen` that tests need."""

    def __init__(self, *words: str, folder: Path, errors: str | None = None, programs: bool = False) -> None:
        """Start it with these words after its name; its standard error goes to a file, which is returned at its end.

        ``programs``: its children are started as programs in quick effort too.
        """
        self._own: Path | None = None
        if errors is None:
            descriptor, errors = tempfile.mkstemp()
            os.close(descriptor)
            self._own = Path(errors)
        forks = address_of_forks() if _FORKED_CHILDREN and not programs else ""
        super().__init__(_run_program, (words, folder, dict(os.environ), errors, forks))

    def communicate(self, *, timeout: float | None = None) -> tuple[str, str]:
        """Wait for its end; return "" and its standard error."""
        self.wait(timeout)
        if self._own is None:
            return "", ""
        own, self._own = self._own, None
        said = own.read_text()
        own.unlink()
        return "", said

    def send_signal(self, number: Signals) -> None:
        """Send a signal, unless it has ended."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it, unless it has ended."""
        self.send_signal(SIGKILL)
