"""Processes that are forked from one that has loaded the product: most of the life of a new program is its imports."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from tests.waiting import wait_until

_CONTEXT = multiprocessing.get_context("forkserver")
_CONTEXT.set_forkserver_preload(["pytest", "monitor.service.ingest", "monitor.records.recover.salvage"])


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
