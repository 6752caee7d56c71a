"""What is asked of a worker and what comes back: kinds of tasks, chunks of them, and the executors that run chunks.

A chunk is a fixed run of tasks of one kind. Its key is a digest of all that its result depends on (the function, what
all tasks share, the tasks, the program), so a chunk can run twice, anywhere, and its result is the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")

DIED = "died"
"""Kind of failure of a chunk whose worker was lost."""


CHUNK_SECONDS = 2.0
"""Work in a chunk: much longer than it takes to send one, and shorter than a worker outlives its scheduler (30 s)."""

MIN_CHUNKS = 16
"""Chunks of work that is short, so that several workers have some of it."""


@dataclass(frozen=True)
class Work(Generic[S, T, R]):
    """A kind of task: ``function(shared, task)`` for each of many tasks.

    Attributes:
        name: for people, such as "rows of the map".
        function: of a module, found by its name; it depends on its arguments and the program alone, and changes none.
        memory: bytes that one task needs at most, beside the program.
        per_chunk: tasks of a chunk. It never depends on the workers, so that a chunk is found again by others.
        threads: whether the function releases the GIL, so that local workers are threads.
    """

    name: str
    function: Callable[[S, T], R]
    memory: int
    per_chunk: int = 1
    threads: bool = False

    def sized(self, seconds: float, tasks: int | None = None, chunk: float | None = None) -> Work[S, T, R]:
        """Return this kind of task with as many tasks in a chunk as take about ``chunk`` seconds.

        Args:
            seconds: of a task, roughly; by what it is, never by who runs it.
            tasks: their number; then there are ``MIN_CHUNKS`` of them where there are so many tasks.
            chunk: seconds of a chunk; default ``CHUNK_SECONDS``.
        """
        length = CHUNK_SECONDS if chunk is None else chunk
        count = max(1, round(length / max(seconds, 1e-9)))
        if tasks is not None:
            count = min(count, max(1, tasks // MIN_CHUNKS))
        return replace(self, per_chunk=count)


@dataclass(frozen=True)
class ChunkCall:
    """One chunk as it is sent to a worker: bytes and names, no code.

    Attributes:
        key: digest of the chunk, hexadecimal.
        label: for people, such as "rows of the map 17 to 24".
        function: "module:name".
        store: URL of the store of shared values and results, as the workers reach it.
        shared: digest of what all tasks share, its name in the store.
        tasks: encoded tasks (``models.work.codec``).
        memory: bytes that the chunk needs at most.
        program: digest of the program; a worker that runs another one refuses.
        threads: whether a thread of the caller's process may run it, as ``Work.threads``.
        caller: identity of the runner, hexadecimal: several may share a store.
    """

    key: str
    label: str
    function: str
    store: str
    shared: str
    tasks: bytes = field(repr=False)
    memory: int
    program: str
    threads: bool = False
    caller: str = ""


@dataclass(frozen=True)
class Failure:
    """Why a chunk failed.

    Attributes:
        kind: the exception ("builtins:ValueError"), or DIED where the worker was lost.
        message: one line.
        log: traceback, or what is known of a lost worker.
        wrong_input: whether the exception is a WrongInputError or a ValueError: another attempt would fail, too.
        of_store: whether a store may have failed, rather than the task.
    """

    kind: str
    message: str
    log: str
    wrong_input: bool = False
    of_store: bool = False


@dataclass(frozen=True)
class ChunkOutcome:
    """What a worker says of a chunk; its results stand in the store.

    Attributes:
        key: of the chunk.
        failure: None where the chunk is done.
        seconds: wall time of its tasks.
        size: bytes of its encoded results.
        worker: name and address for people.
        processor: kind of processor, since results are equal bit for bit on one kind alone.
    """

    key: str
    failure: Failure | None
    seconds: float
    size: int
    worker: str
    processor: str


class Executor(Protocol):
    """A way of running chunks: in this process, in several, or on a cluster."""

    name: str

    def capacity(self) -> int:
        """Return how many chunks should be under way at this moment: those at work and a few that wait near them."""
        ...

    def workers(self) -> int:
        """Return how many workers there are at this moment."""
        ...

    def submit(self, call: ChunkCall) -> None:
        """Begin a chunk; it does not wait."""
        ...

    def wait(self) -> ChunkOutcome:
        """Return the next outcome of any chunk that was submitted; a lost worker is an outcome with a failure."""
        ...

    def close(self) -> None:
        """Give up what is under way and release the workers."""
        ...


class FileStore(Protocol):
    """Whole files by name in a folder or an object store; names are parts joined by "/"."""

    url: str

    def read(self, name: str) -> bytes | None:
        """Return a file, None where there is none."""
        ...

    def write(self, name: str, data: bytes, *, durable: bool = True) -> None:
        """Write a file in one step: readers see the old one, the new one or none, never a part.

        Unless ``durable``, it may be lost or torn where the machine loses power.
        """
        ...

    def delete(self, name: str) -> None:
        """Delete a file if it is there."""
        ...

    def names(self, prefix: str = "") -> Iterator[str]:
        """Yield the names of all whole files that begin so, in any order."""
        ...


@dataclass(frozen=True)
class Progress:
    """How far a run is, in chunks.

    Attributes:
        done: those that are done, the kept ones included.
        total: as far as it is known.
        kept: found done in the store.
        failed: set aside.
        seconds_left: None where nothing is known yet.
        name: of the kind of task.
    """

    done: int
    total: int
    kept: int
    failed: int
    seconds_left: float | None
    name: str = ""
