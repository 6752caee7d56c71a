"""Chunks on the workers of a dask cluster.

Chunks are futures of one client; their tasks and results go through the store, not through the scheduler. What is
under way is known here alone: where the scheduler is lost, a new client sends it again.
"""

from __future__ import annotations

import queue
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from models.fleet.connect import Cluster, ClusterError, RefusedWorkerError
from models.fleet.member import run, turn_name
from models.fleet.roster import Roster
from models.work.chunk import MAX_ATTEMPTS, clear_marks, lost_workers, read_chunk
from models.work.codec import DamagedDataError
from models.work.errors import MemoryNeedError, failure_of
from models.work.program import processor
from models.work.task import DIED, ChunkCall, ChunkOutcome, Failure, FileStore

RECONNECT_S = 300.0
"""Time for a lost scheduler to come back, and then for its workers, s."""
IDLE_S = 600.0
"""Time for which chunks wait for a worker that can take them, s."""
MAX_LOSSES = 10
"""How often dask may give up a chunk that has not begun, as the workers where it waited were lost."""
_LOOK_S = 2.0
_RESULT_S = 5.0
"""Time to fetch an outcome: while it passes, workers that come back are not asked to join, s."""
_AHEAD = 2


@dataclass
class _Sent:
    """A chunk under way.

    Attributes:
        call: the chunk.
        future: of dask; its key is new each time that the chunk is sent.
        losses: how often dask gave up, because the workers that had it were lost.
        waiting: since when no worker that takes part has it, by the clock of this process.
        copied: whether it was sent again while a silent worker had it; then it is so no more.
    """

    call: ChunkCall
    future: Any = None
    losses: int = 0
    waiting: float | None = None
    copied: bool = False


class ClusterExecutor:
    """Sends chunks to a cluster.

    Attributes:
        name: address of the scheduler, or "local".
    """

    def __init__(
        self,
        cluster: Cluster,
        store: FileStore,
        tell: Callable[[str], None],
        *,
        reconnect_s: float = RECONNECT_S,
        idle_s: float = IDLE_S,
    ) -> None:
        """Connect, and wait for the workers.

        Args:
            cluster: the scheduler, which the executor closes.
            store: of the chunks.
            tell: called with lines for people.
            reconnect_s: time for a lost scheduler and its workers to come back, s.
            idle_s: time for which a chunk waits for a worker that can take it, s.

        Raises:
            RefusedWorkerError: the scheduler or a worker runs another program, or does not reach the store.
            ClusterError: no scheduler answers, or too few workers come.
        """
        self.name = cluster.address
        self._tell = tell
        self._cluster = cluster
        self._store = store
        self._reconnect_s = reconnect_s
        self._idle_s = idle_s
        self._sent: dict[str, _Sent] = {}
        self._ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._outcomes: deque[ChunkOutcome] = deque()
        self._number = 0
        self._looked = time.monotonic()
        self._client: Any = None
        self._roster = Roster(self.name, store, tell)
        try:
            self._client = cluster.connect()
            self._roster.use(self._client)
            self._roster.wait_for(cluster.workers)
        except BaseException:
            self.close()
            raise

    def capacity(self) -> int:
        """Return twice the threads of the workers: one chunk waits for each."""
        return _AHEAD * max(self._roster.threads(), 1)

    def workers(self) -> int:
        """Return how many workers take part."""
        return len(self._roster.members)

    def submit(self, call: ChunkCall) -> None:
        """Send a chunk; one that no worker has the memory for has failed."""
        if self._roster.members and call.memory > self._roster.memory():
            most = self._roster.memory()
            error = MemoryNeedError(
                f"{call.label} needs {1e-6 * call.memory:.0f} MB, the largest worker of {self.name} "
                f"has {1e-6 * most:.0f} MB for it"
            )
            self._outcomes.append(_failed(call, failure_of(error)))
            return
        self._sent[call.key] = sent = _Sent(call)
        self._send(sent)

    def wait(self) -> ChunkOutcome:
        """Return the next outcome.

        Raises:
            ClusterError: the scheduler or all workers were lost for too long.
        """
        while True:
            if time.monotonic() - self._looked > _LOOK_S:
                self._look()
                self._looked = time.monotonic()
            if self._outcomes:
                return self._outcomes.popleft()
            with suppress(queue.Empty):
                self._take(self._ended.get(timeout=_LOOK_S))

    def close(self) -> None:
        """Cancel what is under way, and end the workers that were started for it."""
        client, self._client = self._client, None
        self._sent.clear()
        try:
            self._roster.close()
            if client is not None:
                client.close(timeout=5)
        finally:
            self._cluster.close()

    def _send(self, sent: _Sent) -> None:
        """Give a chunk to the scheduler under a new key, for the workers that take part at this moment.

        Others may offer memory too, to a caller whose store they reach. A future before is forgotten. A lost scheduler
        is noticed later.
        """
        call = sent.call
        self._number += 1
        sent.future, sent.waiting = None, None
        if not self._roster.members:
            # To dask, no name of a worker means any worker.
            return
        resource = self._roster.resource
        turn = {} if call.threads else {turn_name(resource): 1}
        try:
            sent.future = self._client.submit(
                run,
                call,
                resource,
                key=f"{call.function.partition(':')[2]}-{call.key}-{self._number}",
                pure=False,
                workers=self._roster.addresses(),
                resources={resource: max(call.memory, 1), **turn},
            )
        except (OSError, RuntimeError):
            if self._client.status == "running":
                raise
            sent.future = None
            self._ended.put(None)
            return
        sent.future.add_done_callback(self._ended.put)

    def _take(self, future: Any) -> None:
        """Take a future that has ended, or None where the scheduler is lost."""
        found = [sent for sent in self._sent.values() if sent.future is future]
        if not found:
            return
        sent = found[0]
        if future is not None and future.status in ("pending", "lost"):
            # Its worker was lost after it had ended.
            self._send(sent)
        elif future is None or future.status not in ("finished", "error"):
            self._recover()
        elif future.status == "finished":
            self._answered(sent, future)
        else:
            try:
                error = future.exception(timeout=_RESULT_S)
            except Exception as raised:  # It cannot be fetched or unpickled.
                error = raised
            self._fail(sent, error)

    def _answered(self, sent: _Sent, future: Any) -> None:
        """Take what a worker answered; where it cannot be fetched, its results may be where they belong."""
        try:
            outcome = _checked(sent.call, future.result(timeout=_RESULT_S))
        except Exception as error:
            sent.losses += 1
            outcome = self._stored(sent.call)
            if outcome is None and sent.losses >= MAX_ATTEMPTS:
                outcome = _failed(sent.call, failure_of(error, of_task=False))
        if outcome is None:
            self._send(sent)
        else:
            self._end(sent, outcome)

    def _fail(self, sent: _Sent, error: BaseException) -> None:
        """Take an exception of dask; those of tasks are outcomes."""
        from distributed import KilledWorker

        if not isinstance(error, KilledWorker):
            self._end(sent, _failed(sent.call, failure_of(error, of_task=False)))
            return
        sent.losses += 1
        marks = len(lost_workers(self._store, sent.call))
        # Dask also counts chunks that only waited on a worker that was lost; those that began left a mark.
        if marks < MAX_ATTEMPTS and sent.losses < MAX_LOSSES:
            self._send(sent)
            return
        last = getattr(error.last_worker, "address", "unknown")
        failure = Failure(DIED, f"its workers were lost, the last one at {last}", "a killed process logs nothing")
        self._end(sent, _failed(sent.call, failure))

    def _end(self, sent: _Sent, outcome: ChunkOutcome) -> None:
        self._outcomes.append(outcome)
        del self._sent[sent.call.key]

    def _look(self) -> None:
        """Ask new workers to join, and send chunks again that no worker has, or one that is silent.

        Raises:
            ClusterError: there was none for too long.
        """
        try:
            joined = self._roster.refresh()
            if not self._sent:
                return
            placed = {key: address for address, keys in self._client.processing().items() for key in keys}
            if joined:
                self._widen(placed)
        except (OSError, RuntimeError, TimeoutError):
            if self._client.status == "running":
                return
            self._recover()
            return
        for sent in list(self._sent.values()):
            if sent.future is None or not sent.future.done():
                self._look_at(sent, None if sent.future is None else placed.get(sent.future.key))

    def _widen(self, keys: Iterable[str]) -> None:
        """Let workers that have joined take chunks that wait for others; the scheduler moves them by itself."""
        own = {sent.future.key for sent in self._sent.values() if sent.future is not None}
        allowed = dict.fromkeys(own.intersection(keys), self._roster.addresses())
        # A chunk that has ended meanwhile is unknown: at worst the others wait where they are.
        with suppress(KeyError):
            self._client.sync(self._client.scheduler.set_restrictions, worker=allowed)

    def _look_at(self, sent: _Sent, worker: str | None) -> None:
        """Send a chunk again unless a worker that takes part has it; ``worker`` is the one that the scheduler gave it.

        A copy that is left with a silent worker may end later: its results are the same.

        Raises:
            ClusterError: there was no worker for it for too long.
        """
        now = time.monotonic()
        if worker in self._roster.members:
            sent.waiting = None
        elif sent.waiting is None:
            sent.waiting = now
        elif (outcome := self._stored(sent.call)) is not None:
            self._end(sent, outcome)
        elif sent.call.memory <= self._roster.memory() and not (worker is not None and sent.copied):
            # The scheduler does not look again at what it could not place.
            sent.copied = sent.copied or worker is not None
            self._send(sent)
        elif now - sent.waiting > self._idle_s:
            raise ClusterError(
                f"{self.name}: for {self._idle_s:.0f} s there was no worker for {sent.call.label}, which needs "
                f"{1e-6 * sent.call.memory:.0f} MB; {len(self._roster.members)} workers take part"
            )

    def _recover(self) -> None:
        """Connect again to a scheduler that was lost, and send again what was under way.

        Raises:
            ClusterError: it does not come back in time.
        """
        if not self._cluster.lasting:
            raise ClusterError(f"{self.name}: the scheduler was lost")
        stated = f"{self.name}: the scheduler was lost"
        self._tell(f"{stated}; waiting up to {self._reconnect_s:.0f} s for it")
        with suppress(Exception):
            self._client.close(timeout=1)
        self._connect_again(time.monotonic() + self._reconnect_s, stated)
        for sent in list(self._sent.values()):
            # Workers go with their scheduler: that says nothing against the chunks that they had.
            clear_marks(self._store, sent.call.key, sent.call.caller)
            if (outcome := self._stored(sent.call)) is not None:
                self._end(sent, outcome)
            else:
                self._send(sent)
        self._looked = time.monotonic()

    def _stored(self, call: ChunkCall) -> ChunkOutcome | None:
        """Return the outcome of a chunk that a worker has ended and could not tell of."""
        try:
            found = read_chunk(self._store, call.key)
        except DamagedDataError:
            found = None
        return None if found is None else ChunkOutcome(call.key, None, found.seconds, 0, found.worker, found.processor)

    def _connect_again(self, deadline: float, stated: str) -> None:
        while True:
            try:
                self._client = self._cluster.connect()
                self._roster.use(self._client)
                self._roster.wait_for(1, max(deadline - time.monotonic(), 1.0), strict=False)
                self._tell(f"{self.name}: {len(self._roster.members)} workers are back")
                return
            except RefusedWorkerError:
                raise
            except (ClusterError, OSError, RuntimeError, TimeoutError) as error:
                with suppress(Exception):
                    self._client.close(timeout=1)
                if time.monotonic() > deadline:
                    raise ClusterError(
                        f"{stated}, and did not come back within {self._reconnect_s:.0f} s: {error}"
                    ) from None
                time.sleep(0.5)


def _checked(call: ChunkCall, answer: object) -> ChunkOutcome:
    """Return the answer of a worker, or a failure where it is none for this chunk."""
    if isinstance(answer, ChunkOutcome) and answer.key == call.key:
        return answer
    error = DamagedDataError(f"{call.label}: a worker answered with {type(answer).__name__}, not with its outcome")
    return _failed(call, failure_of(error))


def _failed(call: ChunkCall, failure: Failure) -> ChunkOutcome:
    return ChunkOutcome(call.key, failure, 0.0, 0, "the caller", processor())
