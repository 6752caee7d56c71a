"""Children of a daemon that are forked from the process that forks the daemons, and not started as new interpreters.

Publisher and reader of a daemon live for a second in a test, and half of that are their imports.
"""

from __future__ import annotations

import multiprocessing
import multiprocessing.forkserver
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from multiprocessing import process, reduction
from types import SimpleNamespace
from typing import Any, cast

from tests.support.pace import quicken

PRELOADED = [
    *("monitor.service.publisher", "monitor.records.publish", "monitor.records.published_folder"),
    *("netCDF4", "dask.array"),
    *("monitor.web.server", "streams.files.parse.worker", "streams.files.formats.text", "pandas"),
]
"""What those children import."""

_CONTEXT = multiprocessing.get_context("forkserver")


class _Handle:
    """A file descriptor on its way to a forked process, where it has another number."""

    def __init__(self, number: int) -> None:
        self._number = number

    def __reduce__(self) -> tuple[Any, tuple[Any]]:
        return _taken, (reduction.DupFd(self._number),)


def _taken(sent: Any) -> int:
    return sent.detach()


def _become(command: Sequence[str], handles: Mapping[str, int], environment: Mapping[str, str], session: bool) -> None:
    """Run ``python -c CODE WORDS`` as a new interpreter does, but for its imports."""
    if session:
        os.setsid()
    os.environ.clear()
    os.environ.update(environment)
    null = os.open(os.devnull, os.O_RDWR)
    for number, name in enumerate(("stdin", "stdout")):
        os.dup2(handles.get(name, null), number)
    if session:
        os.dup2(null, 2)
    sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    for name in ("stdin", "stdout"):
        if name in handles:
            os.close(handles[name])
    quicken()
    # Numbers of descriptors among the words are those of this process.
    code, *words = command[command.index("-c") + 1 :]
    sys.argv = ["-c", *(str(handles.get(word, word)) for word in words)]
    exec(code, {"__name__": "__main__"})


class ForkedProcess:
    """A forked process with those methods of a :class:`subprocess.Popen` that ask for its end."""

    def __init__(self, target: Callable[..., None], arguments: Sequence[Any]) -> None:
        """Start ``target(*arguments)``."""
        self._process = _CONTEXT.Process(target=target, args=arguments)
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        """Exit code, negative for a signal, or None while it runs."""
        return self._process.exitcode

    def poll(self) -> int | None:
        """Return the exit code, or None while it runs."""
        return self.returncode

    def wait(self, timeout: float | None = None) -> int | None:
        """Wait for its end; return its exit code."""
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return self.returncode


class ForkedChild(ForkedProcess):
    """A child of the product, which starts it as a :class:`subprocess.Popen`."""

    def __init__(
        self,
        command: Sequence[str],
        *,
        stdin: int | None = None,
        stdout: int | None = None,
        stderr: int | None = None,
        pass_fds: Sequence[int] = (),
        start_new_session: bool = False,
        env: Mapping[str, str] | None = None,
    ) -> None:
        """Start it; standard error is this process's, or nothing in a new session."""
        given, own = {str(number): number for number in pass_fds}, dict[str, int]()
        if stdin == subprocess.PIPE:
            given["stdin"], own["stdin"] = os.pipe()
        if stdout == subprocess.PIPE:
            own["stdout"], given["stdout"] = os.pipe()
        handles = {name: _Handle(number) for name, number in given.items()}
        environment = dict(os.environ if env is None else env)
        try:
            super().__init__(_become, (command, handles, environment, start_new_session))
        finally:
            for name in own:
                os.close(given[name])
        # The end of this process waits for no child, as of a program.
        cast("Any", process)._children.discard(self._process)
        self.stdin = os.fdopen(own["stdin"], "wb") if "stdin" in own else None
        self.stdout = os.fdopen(own["stdout"], "rb") if "stdout" in own else None

    def kill(self) -> None:
        """Kill it, unless it has ended."""
        self._process.kill()


SUBPROCESS = SimpleNamespace(**{**vars(subprocess), "Popen": ForkedChild})
"""Takes the place of the module where the product starts children of a daemon."""


def address_of_forks() -> str:
    """Return where processes are forked."""
    server = cast("Any", multiprocessing.forkserver)._forkserver
    server.ensure_running()
    return server._forkserver_address


def fork_children_too(address: str) -> None:
    """Let the children of this forked process be forked where it was."""
    import monitor.service.children
    import streams.files.parse.child

    server = cast("Any", multiprocessing.forkserver)._forkserver
    server._forkserver_address, server.ensure_running = address, lambda: None
    for user in (monitor.service.children, streams.files.parse.child):
        vars(user)["subprocess"] = SUBPROCESS
