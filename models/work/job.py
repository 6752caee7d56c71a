"""One kind of work under way: which chunks wait, which are done, and how long the rest takes."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sized
from dataclasses import dataclass, field
from itertools import islice
from statistics import median
from typing import Any, Generic, TypeVar

from models.work.chunk import MAX_ATTEMPTS
from models.work.codec import digest_of, name_of
from models.work.errors import FailedChunk
from models.work.task import ChunkOutcome, Failure, Progress, Work

_T = TypeVar("_T")
_MAX_TIMES = 101


@dataclass
class Tally:
    """What became of the chunks of a runner, over all its runs.

    Attributes:
        chunks: done, the kept ones included.
        kept: found done in the store.
        failed: set aside.
        processors: kinds of processor that the results came from.
        notes: lines for people, such as that nothing of an earlier run can be used.
    """

    chunks: int = 0
    kept: int = 0
    failed: list[FailedChunk] = field(default_factory=list[FailedChunk])
    processors: set[str] = field(default_factory=set[str])
    notes: list[str] = field(default_factory=list[str])


@dataclass
class Chunk(Generic[_T]):
    """Some tasks of a job.

    Attributes:
        number: of the chunk, from 0.
        first: number of its first task.
        tasks: in order.
        label: for people.
        part: place in a chain of tasks that follow each other, from 1.
        key: known once it was encoded.
        tries: failures so far.
        kept: whether it was found done.
        failure: why it was set aside.
    """

    number: int
    first: int
    tasks: list[_T]
    label: str
    part: int = 1
    key: str = ""
    tries: int = 0
    kept: bool = False
    failure: Failure | None = None


class Job(Generic[_T]):
    """The chunks of one run.

    Attributes:
        work: kind of task.
        function: its name.
        shared: digest of what all tasks share.
        shared_data: the same encoded.
        stops: whether wrong input ends the run.
        ready: chunks that are done or set aside, for the caller.
        failed: those that were set aside.
        planned: chunks so far.
        done: those that are done.
        kept: those of them that were found done.
    """

    def __init__(
        self, work: Work[Any, _T, Any], shared: bytes, tasks: Iterable[_T], total: int | None, *, stops: bool
    ) -> None:
        """Take the tasks; ``shared`` is what they share, encoded, ``total`` counts them."""
        self.work = work
        self.function = name_of(work.function)
        self.shared, self.shared_data = digest_of(shared), shared
        self.stops = stops
        self.ready: deque[Chunk[_T]] = deque()
        self.failed: list[FailedChunk] = []
        self.planned = self.done = self.kept = 0
        self._total = chunks_of(work, tasks, total)
        self._source = _cut(work, tasks)
        self._again: deque[Chunk[_T]] = deque()
        self._seconds: deque[float] = deque(maxlen=_MAX_TIMES)
        self._stopped = False

    def next_chunk(self) -> Chunk[_T] | None:
        """Return a chunk to be run: one that failed before, else the next; None where there is none at the moment."""
        if self._again:
            return self._again.popleft()
        chunk = None if self._stopped else next(self._source, None)
        if chunk is not None:
            self.planned += 1
        return chunk

    def continue_with(self, chunk: Chunk[_T], task: _T) -> None:
        """Add the task that follows that of a chunk."""
        part, number = chunk.part + 1, self.planned
        label = f"{self.work.name} {chunk.first + 1}, part {part}"
        self.planned += 1
        if self._total is not None:
            self._total += 1
        self._again.append(Chunk(number, chunk.first, [task], label, part))

    def found(self, chunk: Chunk[_T]) -> None:
        """Take a chunk that is in the store."""
        chunk.kept = True
        self.kept += 1
        self.done += 1
        self.ready.append(chunk)

    def end(self, chunk: Chunk[_T], outcome: ChunkOutcome) -> FailedChunk | None:
        """Take the outcome of a chunk; return what was set aside."""
        failure = outcome.failure
        if failure is None:
            self.done += 1
            self._seconds.append(outcome.seconds)
            self.ready.append(chunk)
            return None
        if failure.wrong_input:
            self._stopped = self.stops
            self.ready.append(chunk)
            if self.stops:
                chunk.failure = failure
                return None
            return self._set_aside(chunk, failure)
        return self.fail(chunk, failure)

    def fail(self, chunk: Chunk[_T], failure: Failure) -> FailedChunk | None:
        """Run a chunk again, or set it aside; return it then."""
        chunk.tries += 1
        if chunk.tries < MAX_ATTEMPTS:
            self._again.append(chunk)
            return None
        self.ready.append(chunk)
        return self._set_aside(chunk, failure)

    def _set_aside(self, chunk: Chunk[_T], failure: Failure) -> FailedChunk:
        chunk.failure = failure
        self.failed.append(aside := FailedChunk(chunk.key, chunk.label, failure.message, failure.log))
        return aside

    def undo(self, chunk: Chunk[_T]) -> None:
        """Count a chunk as not done: its results could not be read."""
        self.done -= 1
        self.kept -= chunk.kept
        chunk.kept = False

    def progress(self, workers: int) -> Progress:
        """Return how far the run is; the time left is that of the median chunk on as many workers.

        Chunks that are done are found before the first one ends: an interrupted run leaves few gaps among them.
        """
        total = self.planned if self._total is None else self._total
        left = total - self.done - len(self.failed)
        seconds = median(self._seconds) * max(left, 0) / max(workers, 1) if self._seconds else None
        return Progress(self.done, total, self.kept, len(self.failed), seconds, self.work.name)


def chunks_of(work: Work[Any, _T, Any], tasks: Iterable[_T], total: int | None) -> int | None:
    """Return the number of chunks, None where that of the tasks is not known."""
    count = len(tasks) if isinstance(tasks, Sized) else total
    return None if count is None else -(-count // work.per_chunk)


def _cut(work: Work[Any, _T, Any], tasks: Iterable[_T]) -> Iterator[Chunk[_T]]:
    source = iter(tasks)
    number = 0
    while part := list(islice(source, work.per_chunk)):
        first = number * work.per_chunk
        last = f" to {first + len(part)}" if len(part) > 1 else ""
        yield Chunk(number, first, part, f"{work.name} {first + 1}{last}")
        number += 1
