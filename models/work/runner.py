"""The tasks of a kind of work on an executor: cut into chunks, sent, retried, and put in order.

Results do not depend on the executor, on the number of workers, on what was found done, or on which chunks failed and
were run again. Those of chunks wait in the store, not in memory.
"""

from __future__ import annotations

import secrets
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType
from typing import Any, Self, TypeVar

from models.platform.scratch import scratch_folder
from models.words.errors import WrongInputError
from models.work.chunk import (
    KnownChunks,
    attempted_chunks,
    check_writable,
    chunk_key,
    clear_attempts,
    delete_own,
    read_chunk,
    sent_tasks,
    write_log,
    write_run,
    write_shared,
)
from models.work.codec import DamagedDataError, encode
from models.work.errors import LostFolderError, ObjectStorageError, chunks_failed, error_of, failure_of
from models.work.folder_store import FolderStore
from models.work.job import Chunk, Job, Meter, Tally, chunks_of, direct_outcomes, direct_results
from models.work.pool import SerialExecutor
from models.work.program import program
from models.work.task import DIED, ChunkCall, ChunkOutcome, Executor, Failure, FileStore, Progress, Work

_S = TypeVar("_S")
_T = TypeVar("_T")
_R = TypeVar("_R")


class Runner:
    """Runs tasks on an executor.

    Without a store, an executor of this process runs a plain loop over objects; processes get a temporary folder.

    Attributes:
        tally: chunks done and failed so far, over all runs.
    """

    def __init__(
        self,
        executor: Executor,
        store: FileStore | None = None,
        resume: bool = False,
        notify: Callable[[Progress], None] | None = None,
        *,
        keep: bool = True,
        lasting: bool = True,
    ) -> None:
        """Take an executor, which the runner closes.

        Args:
            executor: runs chunks.
            store: of shared values and results, which all workers reach.
            resume: whether chunks that are found in the store are used.
            notify: called in this process whenever a chunk is done.
            keep: whether :meth:`finished` leaves the files in the store.
            lasting: whether the store is there after the run, so that people are told what it keeps.
        """
        self.executor = executor
        self.tally = Tally()
        self.notify = notify
        self._store = store
        self._resume = resume
        self._keep = keep
        self._lasting = lasting
        self._temporary: ExitStack | None = None
        self._begun = False
        self._caller = secrets.token_hex(4)
        self._known: KnownChunks | None = None
        self._attempted: set[str] = set()
        # Runs that wait for a chunk, by its key; none where a run was given up.
        self._waiting: dict[str, list[tuple[Job[Any], Chunk[Any]]]] = {}

    def __enter__(self) -> Self:
        """Return the runner."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it; without an exception its files are then deleted as by :meth:`finished`."""
        try:
            # First: what a worker has yet to answer is among the files.
            self.executor.close()
            if kind is None:
                self.finished()
        finally:
            self._leave()

    @property
    def url(self) -> str | None:
        """URL of the store that was given, None where there is none."""
        return None if self._store is None or self._temporary is not None else self._store.url

    @property
    def _kept_in(self) -> str | None:
        return self.url if self._lasting else None

    def run(self, work: Work[_S, _T, _R], shared: _S, tasks: Iterable[_T], *, total: int | None = None) -> Iterator[_R]:
        """Yield the result of each task, in their order.

        Args:
            work: kind of task.
            shared: given to each task.
            tasks: pulled as they are needed.
            total: their number for the progress, where ``tasks`` has no length.

        Raises:
            WrongInputError, ValueError: by a function; that of the first such task, after the results before it.
            ChunksFailedError: chunks failed too often, after all others are done.
            Exception: any other of a function in this process without a store, as by a plain loop.
        """
        if self.url is None:
            meter = self._meter(work, tasks, total)
            if (found := direct_results(self.executor, work, shared, tasks, meter)) is not None:
                yield from found
                return
        with self._job(work, shared, tasks, total, stops=True) as job:
            waiting: dict[int, Chunk[_T]] = {}
            following, complete = 0, True
            for ended in self._ended(job):
                waiting[ended.number] = ended
                while (chunk := waiting.pop(following, None)) is not None:
                    if chunk.failure is not None and chunk.failure.wrong_input:
                        raise error_of(chunk.failure)
                    complete = complete and chunk.failure is None
                    if complete:
                        results = self._results(job, chunk)
                        if results is None:
                            break
                        yield from results
                    following += 1
            if job.failed:
                raise chunks_failed(job.failed, job.planned, self._kept_in)

    def outcomes(
        self,
        work: Work[_S, _T, _R],
        shared: _S,
        tasks: Iterable[_T],
        *,
        total: int | None = None,
        follow: Callable[[_T, _R], _T | None] | None = None,
    ) -> Iterator[tuple[int, _R | Failure]]:
        """Yield the number of each task with its result, or with why it failed, in the order in which they end.

        Args:
            work: kind of task; a chunk that fails is a failure of each of its tasks.
            shared: given to each task.
            tasks: pulled as they are needed.
            total: their number for the progress, where ``tasks`` has no length.
            follow: returns the task that continues one, of the same number, by its result, None at the end of the
                chain; asked when the result has been taken. ``work.per_chunk`` is 1 with it.
        """
        if follow is not None and work.per_chunk != 1:
            raise ValueError(f"tasks that follow each other need per_chunk 1, {work.name} has {work.per_chunk}")
        if self.url is None:
            meter = self._meter(work, tasks, total)
            if (found := direct_outcomes(self.executor, work, shared, tasks, meter, follow)) is not None:
                yield from found
                return
        with self._job(work, shared, tasks, total, stops=False) as job:
            for chunk in self._ended(job):
                if chunk.failure is not None:
                    for i in range(len(chunk.tasks)):
                        yield chunk.first + i, chunk.failure
                elif (results := self._results(job, chunk)) is not None:
                    yield from enumerate(results, chunk.first)
                    if follow is not None and (task := follow(chunk.tasks[0], results[0])) is not None:
                        job.continue_with(chunk, task)

    def finished(self) -> None:
        """Delete what runners put into the store, unless it is kept for others or chunks failed."""
        if self._store is not None and self._begun and not self._keep and not self.tally.failed:
            delete_own(self._store)
            self._begun = False

    def close(self) -> None:
        """Give up what is under way and release the workers."""
        try:
            self.executor.close()
        finally:
            self._leave()

    def _leave(self) -> None:
        if self._temporary is not None:
            self._temporary.close()
            self._temporary, self._store = None, None

    def _meter(self, work: Work[Any, _T, Any], tasks: Iterable[_T], total: int | None) -> Callable[[], Meter]:
        return lambda: Meter(work, chunks_of(work, tasks, total), self.tally, self.notify)

    @contextmanager
    def _job(
        self, work: Work[_S, _T, Any], shared: _S, tasks: Iterable[_T], total: int | None, *, stops: bool
    ) -> Generator[Job[_T]]:
        """Begin a run; at its end its chunks are no longer waited for."""
        store = self._begin()
        job = Job(work, encode(shared), tasks, total, stops=stops)
        try:
            write_shared(store, job.shared, job.shared_data)
        except OSError:
            self._check_store()
            raise
        try:
            yield job
        except KeyboardInterrupt as error:
            if (place := self._kept_in) is not None:
                error.add_note(f"{job.done} chunks of {work.name} are kept in {place}; --resume goes on from there")
            raise
        finally:
            for waiting in self._waiting.values():
                waiting[:] = [(other, chunk) for other, chunk in waiting if other is not job]

    def _begin(self) -> FileStore:
        """Return the store; at first, see what is in it."""
        try:
            if self._store is None:
                with ExitStack() as stack:
                    self._store = FolderStore(stack.enter_context(scratch_folder("spallwatch-work-")))
                    self._temporary = stack.pop_all()
            note = None if self._begun else write_run(self._store)
        except OSError as error:
            place = tempfile.gettempdir() if self._store is None else self._store.url
            raise WrongInputError(f"{place}: chunks cannot be kept there: {error.strerror}") from None
        if not self._begun:
            self._begun = True
            if note is not None and self._resume:
                self.tally.notes.append(note)
            self._attempted = attempted_chunks(self._store)
            self._known = KnownChunks(self._store) if self._resume else None
        return self._store

    def _ended(self, job: Job[_T]) -> Iterator[Chunk[_T]]:
        """Yield the chunks of a job that are done or set aside, in any order."""
        while True:
            self._submit(job)
            while job.ready:
                yield job.ready.popleft()
                self._submit(job)
            if not any(other is job for waiting in self._waiting.values() for other, _ in waiting):
                if not job.ready:
                    return
                continue
            self._take(self.executor.wait())

    def _submit(self, job: Job[_T]) -> None:
        """Send chunks of a job while workers may have more; what is found done is ready at once."""
        while not job.ready and len(self._waiting) < max(self.executor.capacity(), 1):
            chunk = job.next_chunk()
            if chunk is None:
                return
            fresh = not chunk.key
            tasks = encode(chunk.tasks)
            chunk.key = chunk_key(job.function, job.shared, tasks)
            if fresh and self._known is not None and chunk.key in self._known:
                job.found(chunk)
                self._tell(job)
                return
            self._send(job, chunk, tasks)

    def _send(self, job: Job[_T], chunk: Chunk[_T], tasks: bytes) -> None:
        if (waiting := self._waiting.get(chunk.key)) is not None:
            waiting.append((job, chunk))
            return
        assert self._store is not None
        if chunk.key in self._attempted:
            self._attempted.remove(chunk.key)
            clear_attempts(self._store, chunk.key)
        self._waiting[chunk.key] = [(job, chunk)]
        self.executor.submit(self._call(job, chunk, tasks))

    def _call(self, job: Job[_T], chunk: Chunk[_T], tasks: bytes) -> ChunkCall:
        assert self._store is not None
        work = job.work
        if chunk.tries:
            # What is shared may have been deleted or damaged meanwhile.
            write_shared(self._store, job.shared, job.shared_data, again=True)
        sent = sent_tasks(self._store, chunk.key, tasks)
        return ChunkCall(
            key=chunk.key,
            label=chunk.label,
            function=job.function,
            store=self._store.url,
            shared=job.shared,
            tasks=sent,
            memory=work.memory,
            program=program(),
            threads=work.threads,
            caller=self._caller,
        )

    def _take(self, outcome: ChunkOutcome) -> None:
        """Give an outcome to the runs that wait for it; raise where the store is lost to all."""
        if outcome.failure is not None and outcome.failure.of_store:
            self._check_store()
        for job, chunk in self._waiting.pop(outcome.key, ()):
            if outcome.failure is not None and outcome.failure.kind == DIED and self._store is not None:
                with suppress(Exception):
                    write_log(self._store, outcome.key, chunk.label, outcome.failure, outcome.worker)
            if (aside := job.end(chunk, outcome)) is not None:
                self.tally.failed.append(aside)
            self._tell(job)

    def _check_store(self) -> None:
        """Raise where this process does not reach the store: no worker would."""
        assert self._store is not None
        try:
            check_writable(self._store)
        except ObjectStorageError as error:
            raise ObjectStorageError(f"{error}{self._kept}") from None
        except OSError as error:
            raise LostFolderError(f"{self._store.url}: cannot be written: {error.strerror}{self._kept}") from None

    @property
    def _kept(self) -> str:
        return "" if self._kept_in is None else "; chunks that are done stay, --resume goes on with the others"

    def _results(self, job: Job[_T], chunk: Chunk[_T]) -> list[Any] | None:
        """Return the results of a chunk that is done; None where they cannot be read, and it is run again."""
        assert self._store is not None
        try:
            stored = read_chunk(self._store, chunk.key)
            if stored is None:
                raise DamagedDataError(f"{self._store.url} has no results of {chunk.label}, which a worker wrote")
            if len(stored.results) != len(chunk.tasks):
                found, expected = len(stored.results), len(chunk.tasks)
                raise DamagedDataError(f"{self._store.url}: {chunk.label} has {found} results of {expected} tasks")
        except DamagedDataError as error:
            job.undo(chunk)
            if (aside := job.fail(chunk, failure_of(error))) is not None:
                self.tally.failed.append(aside)
            return None
        self.tally.chunks += 1
        self.tally.kept += chunk.kept
        self.tally.processors.add(stored.processor)
        return stored.results

    def _tell(self, job: Job[Any]) -> None:
        if self.notify is not None:
            self.notify(job.progress(self.executor.workers()))


SERIAL = Runner(SerialExecutor())
"""Tasks one after another in this process, as a plain loop: the default of functions that take a runner."""
