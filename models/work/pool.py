"""Executors of this machine: one task after another, or on its cores, as threads where the tasks release the GIL.

Each worker of the pool is a thread of this process. It runs a chunk itself, or has a process of its own for those that
need one, which begins with the first such chunk and is replaced where it is killed.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, TypeVar

from models.platform.memory import free_memory
from models.platform.process_signals import ended_by_parent, interrupt_held
from models.work.chunk import default_worker, run_chunk
from models.work.codec import decode, encode
from models.work.errors import MemoryNeedError, failure_of
from models.work.program import processor
from models.work.task import DIED, ChunkCall, ChunkOutcome, Failure

if TYPE_CHECKING:
    from multiprocessing.connection import Connection, PipeConnection
    from multiprocessing.context import SpawnProcess

    _Connection = Connection[bytes, bytes] | PipeConnection[bytes, bytes]

_T = TypeVar("_T")
_R = TypeVar("_R")
_AHEAD = 64
"""Tasks of a plain loop that are begun before their turn, a thread."""

_END_S = 2.0
"""Time for a process to end by itself: with nothing left to do, or when asked to, removing its temporary files."""
_STOPPED = Failure(DIED, "the worker was stopped", "")


def worker_count(workers: int) -> int:
    """Return a number of workers, where 0 is one per core.

    Raises:
        ValueError: it is negative.
    """
    if workers < 0:
        raise ValueError(f"workers must not be negative, got {workers!r}")
    return workers or os.cpu_count() or 1


class PoolExecutor:
    """Runs chunks side by side, as many as the memory allows."""

    name = "processes"

    def __init__(self, workers: int = 0, memory: float | None = None) -> None:
        """Begin without threads and processes.

        Args:
            workers: most chunks at work; 0 is one per core.
            memory: bytes for the chunks at work together; by default what is free now. One that needs more is refused.

        Raises:
            ValueError: if workers is negative.
        """
        self._count = worker_count(workers)
        if memory is None:
            memory = min((limit.free for limit in free_memory()), default=None)
        self._memory = _Memory(memory)
        self._calls: queue.SimpleQueue[ChunkCall | None] = queue.SimpleQueue()
        self._outcomes: queue.SimpleQueue[ChunkOutcome] = queue.SimpleQueue()
        self._workers: list[_Worker] = []
        self._submitted = 0

    def capacity(self) -> int:
        """Return twice the workers: one chunk waits for each."""
        return 2 * self._count

    def workers(self) -> int:
        """Return how many chunks may be at work."""
        return self._count

    def submit(self, call: ChunkCall) -> None:
        """Begin a chunk when a worker is free."""
        self._submitted += 1
        if len(self._workers) < min(self._count, self._submitted):
            self._workers.append(_Worker(self._calls, self._outcomes, self._memory))
        self._calls.put(call)

    def wait(self) -> ChunkOutcome:
        """Return the next outcome."""
        outcome = self._outcomes.get()
        self._submitted -= 1
        return outcome

    def close(self) -> None:
        """End the processes, and wait for chunks that threads have begun."""
        for worker in self._workers:
            worker.stop()
        for _ in self._workers:
            self._calls.put(None)
        until = time.monotonic() + _END_S
        for worker in self._workers:
            worker.join(until)
        for worker in self._workers:
            worker.release()
        self._workers.clear()

    def in_process(
        self, function: Callable[[_T], _R], tasks: Iterable[_T], *, threads: bool, memory: int
    ) -> Iterator[_R] | None:
        """Yield results in order from a plain loop, or from threads; None where several processes are needed."""
        count = min(self._count, len(tasks)) if isinstance(tasks, Sized) else self._count
        if self._memory.most is not None:
            count = min(count, int(self._memory.most // max(memory, 1)))
        if count <= 1:
            return map(function, tasks)
        return _in_threads(function, tasks, count) if threads else None


def _in_threads(function: Callable[[_T], _R], tasks: Iterable[_T], count: int) -> Iterator[_R]:
    with ThreadPoolExecutor(count) as pool:
        begun: deque[Future[_R]] = deque()
        try:
            for task in tasks:
                begun.append(pool.submit(function, task))
                if len(begun) >= _AHEAD * count:
                    yield begun.popleft().result()
            while begun:
                yield begun.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)


class _Memory:
    """Memory that chunks at work share."""

    def __init__(self, most: float | None) -> None:
        self.most = most
        self._used = 0
        self._changed = threading.Condition()

    @contextmanager
    def taken(self, size: int) -> Generator[None]:
        """Wait until so much is free."""
        with self._changed:
            self._changed.wait_for(lambda: self.most is None or self._used == 0 or self._used + size <= self.most)
            self._used += size
        try:
            yield
        finally:
            with self._changed:
                self._used -= size
                self._changed.notify_all()


class _Worker:
    """A thread that takes one chunk after another, and the process that it may have."""

    def __init__(
        self,
        calls: queue.SimpleQueue[ChunkCall | None],
        outcomes: queue.SimpleQueue[ChunkOutcome],
        memory: _Memory,
    ) -> None:
        self._calls = calls
        self._outcomes = outcomes
        self._memory = memory
        self._process: SpawnProcess | None = None
        self._connection: _Connection | None = None
        self._lock = threading.Lock()
        self._stopped = self._busy = False
        self._thread = threading.Thread(target=self._loop, name="work", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Tell the process to end if it is at work; the thread ends after its chunk."""
        with self._lock:
            self._stopped = True
            if self._process is not None and self._busy:
                self._process.terminate()

    def join(self, until: float) -> None:
        """Wait for the thread, and let a process end that waits for a chunk; kill one that works on at a time."""
        self._thread.join(max(until - time.monotonic(), 0.0))
        with self._lock:
            if self._process is not None and self._busy:
                self._process.kill()
        self._thread.join()
        if self._connection is not None:
            self._connection.close()

    def release(self) -> None:
        """Wait for the end of the process; kill it after a while."""
        process, self._process, self._connection = self._process, None, None
        if process is not None:
            process.join(_END_S)
            process.kill()
            # Not closed: multiprocessing may wait for it too, at the exit of an interrupted command.
            process.join()

    def _loop(self) -> None:
        while (call := self._calls.get()) is not None and not self._stopped:
            try:
                outcome = self._run(call)
            except BaseException as error:
                # Without an outcome the caller would wait for ever.
                outcome = _failed(call, failure_of(error, of_task=False))
            self._outcomes.put(outcome)

    def _run(self, call: ChunkCall) -> ChunkOutcome:
        most = self._memory.most
        if most is not None and call.memory > most:
            raise MemoryNeedError(f"{call.label} needs {1e-6 * call.memory:.0f} MB, {1e-6 * most:.0f} MB are free")
        with self._memory.taken(call.memory):
            if self._stopped:
                return _failed(call, _STOPPED)
            return run_chunk(call) if call.threads else self._in_process(call)

    def _in_process(self, call: ChunkCall) -> ChunkOutcome:
        with self._lock:
            if self._stopped:
                return _failed(call, _STOPPED)
            if self._process is None or self._connection is None:
                self._process, self._connection = _start()
            process, connection = self._process, self._connection
            self._busy = True
        try:
            connection.send_bytes(encode(call))
            outcome: ChunkOutcome = decode(connection.recv_bytes())
        except (EOFError, OSError):
            process.join()
            code, number = process.exitcode, process.pid
            with self._lock:
                connection.close()
                self.release()
                self._busy = False
            how = f"was killed by signal {-code}" if code is not None and code < 0 else f"ended with exit code {code}"
            worker = f"{default_worker().partition(' ')[0]} process {number}"
            message = f"the process that ran it {how}"
            return _failed(call, Failure(DIED, message, f"{worker}: a process that is killed logs nothing"), worker)
        with self._lock:
            self._busy = False
        return outcome


def _start() -> tuple[SpawnProcess, _Connection]:
    """Start a process that runs chunks; kernels, threads and files of this one are not copied."""
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    process = context.Process(target=_serve, args=(there,), name="work", daemon=True)
    with interrupt_held():
        process.start()
    there.close()
    return process, here


def _serve(connection: _Connection) -> None:
    """Run chunks in a process of their own until its parent closes the connection, ends it, or is killed."""
    # A parent that is killed while it reads an outcome breaks the connection.
    with ended_by_parent(_END_S), suppress(EOFError, OSError):
        while True:
            connection.send_bytes(encode(run_chunk(decode(connection.recv_bytes()))))


def _failed(call: ChunkCall, failure: Failure, worker: str | None = None) -> ChunkOutcome:
    return ChunkOutcome(call.key, failure, 0.0, 0, worker or default_worker(), processor())


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
