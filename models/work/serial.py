"""Work in this process, one task after another."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from models.work.chunk import run_chunk
from models.work.task import ChunkCall, ChunkOutcome

_T = TypeVar("_T")
_R = TypeVar("_R")


class SerialExecutor:
    """Runs a chunk when its outcome is waited for."""

    name = "serial"

    def __init__(self) -> None:
        """Begin with nothing to do."""
        self._calls: deque[ChunkCall] = deque()

    def capacity(self) -> int:
        """Return 1."""
        return 1

    def workers(self) -> int:
        """Return 1."""
        return 1

    def submit(self, call: ChunkCall) -> None:
        """Note a chunk for :meth:`wait`."""
        self._calls.append(call)

    def wait(self) -> ChunkOutcome:
        """Run the oldest chunk that was submitted."""
        return run_chunk(self._calls.popleft())

    def close(self) -> None:
        """Give up what was submitted."""
        self._calls.clear()

    def in_process(
        self, function: Callable[[_T], _R], tasks: Iterable[_T], *, threads: bool, memory: int
    ) -> Iterator[_R]:
        """Yield the function of each task as objects of this process, without a store."""
        return map(function, tasks)
