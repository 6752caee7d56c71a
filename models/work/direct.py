"""Tasks as a plain loop over objects of this process: no store, no encoding, exceptions as they are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, Protocol, TypeVar, runtime_checkable

from models.work.errors import FailedChunk, failure_of
from models.work.job import Tally
from models.work.task import Executor, Failure, Progress, Work

_S = TypeVar("_S")
_T = TypeVar("_T")
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
