"""One kind of work under way: which chunks wait, which are done, and how long the rest takes; also as a plain loop.

The loop is over objects of this process: no store, no encoding, exceptions as they are.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from statistics import median
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

from models.work.chunk import MAX_ATTEMPTS
from models.work.codec import digest_of, name_of
from models.work.errors import FailedChunk, failure_of
from models.work.task import ChunkOutcome, Executor, Failure, Progress, Work

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


_S = TypeVar("_S")
_R = TypeVar("_R")


@runtime_checkable
class InProcess(Protocol):
    """An executor that can also run tasks as objects of this process."""

    def in_process(
        self, function: Callable[[Any], Any], tasks: Iterable[Any], *, threads: bool, memory: int
    ) -> Iterator[Any] | None:
        """Yield results in order; None where such tasks need other processes.

        ``threads`` is whether they may be threads, ``memory`` what each needs, bytes.
        """
        ...


class Meter:
    """Counts the tasks of a plain loop, in chunks as elsewhere."""

    def __init__(
        self, work: Work[Any, Any, Any], total: int | None, tally: Tally, notify: Callable[[Progress], None] | None
    ) -> None:
        """Begin; ``total`` is the number of chunks."""
        self._work = work
        self._total = total
        self._tally = tally
        self._notify = notify
        self._tasks = self._failed = 0
        self._begun = time.monotonic()

    def count(self) -> None:
        """Count a task."""
        self._tasks += 1
        if self._tasks % self._work.per_chunk == 0:
            self._tell(self._tasks // self._work.per_chunk)

    def fail(self, label: str, failure: Failure) -> None:
        """Count a task that failed."""
        self._failed += 1
        self._tally.failed.append(FailedChunk("", label, failure.message, failure.log))

    def end(self) -> None:
        """Count the last chunk, which may be shorter."""
        if self._tasks % self._work.per_chunk:
            self._tell(self._tasks // self._work.per_chunk + 1)

    def _tell(self, done: int) -> None:
        self._tally.chunks += 1
        if self._notify is None:
            return
        total = max(done, self._total or 0)
        left = (time.monotonic() - self._begun) * (total - done) / done
        self._notify(Progress(done - self._failed, total, 0, self._failed, left, self._work.name))


def direct_results(
    executor: Executor, work: Work[_S, _T, _R], shared: _S, tasks: Iterable[_T], meter: Callable[[], Meter]
) -> Iterator[_R] | None:
    """Return the results of tasks in order; None where the executor does not run them in this process."""
    if not isinstance(executor, InProcess):
        return None
    found = executor.in_process(partial(work.function, shared), tasks, threads=work.threads, memory=work.memory)
    return None if found is None else _metered(found, meter())


def _metered(results: Iterator[_R], meter: Meter) -> Iterator[_R]:
    for result in results:
        meter.count()
        yield result
    meter.end()


def direct_outcomes(
    executor: Executor,
    work: Work[_S, _T, _R],
    shared: _S,
    tasks: Iterable[_T],
    meter: Callable[[], Meter],
    follow: Callable[[_T, _R], _T | None] | None,
) -> Iterator[tuple[int, _R | Failure]] | None:
    """Return the outcomes of tasks, as ``Runner.outcomes``; None where the executor does not run them here."""
    if not isinstance(executor, InProcess):
        return None

    def attempt(task: _T) -> tuple[_T, _R | Failure]:
        try:
            return task, work.function(shared, task)
        except Exception as error:
            return task, failure_of(error)

    found = executor.in_process(attempt, tasks, threads=work.threads, memory=work.memory)
    return None if found is None else _chained(found, attempt, work, meter(), follow)


def _chained(
    found: Iterator[tuple[_T, _R | Failure]],
    attempt: Callable[[_T], tuple[_T, _R | Failure]],
    work: Work[_S, _T, _R],
    meter: Meter,
    follow: Callable[[_T, _R], _T | None] | None,
) -> Iterator[tuple[int, _R | Failure]]:
    for number, (first, first_outcome) in enumerate(found):
        task, outcome = first, first_outcome
        while True:
            if isinstance(outcome, Failure):
                meter.fail(f"{work.name} {number + 1}", outcome)
            meter.count()
            yield number, outcome
            following = None if follow is None or isinstance(outcome, Failure) else follow(task, outcome)
            if following is None:
                break
            task, outcome = attempt(following)
    meter.end()
