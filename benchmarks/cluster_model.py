"""A cluster on paper: one caller, one scheduler and many workers, with measured seconds for each step of a chunk.

Caller and scheduler do one thing at a time; a chunk passes caller, scheduler, worker, scheduler and caller. Each worker
has one chunk at work and one that waits, as ``models.fleet`` sends them.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

_AHEAD = 2


@dataclass(frozen=True)
class Costs:
    """Processor time of a chunk, s: of the caller and the scheduler, and of its worker beside the tasks."""

    caller: float
    scheduler: float
    worker: float


def simulated_share(costs: Costs, workers: int, chunk_s: float, chunks: int) -> float:
    """Return the share of the workers' time in which they do not work on tasks, from the first chunk to the last.

    Args:
        chunk_s: seconds of the tasks of a chunk.
        chunks: their number.
    """
    caller = scheduler = 0.0
    free = [0.0] * workers
    events: list[tuple[float, int]] = []
    sent = 0

    def send(now: float, worker: int) -> None:
        """Let the caller and the scheduler send a chunk to a worker; note when the worker has done it."""
        nonlocal caller, scheduler, sent
        sent += 1
        caller = max(caller, now) + 0.5 * costs.caller
        scheduler = max(scheduler, caller) + 0.5 * costs.scheduler
        free[worker] = max(free[worker], scheduler) + costs.worker + chunk_s
        heapq.heappush(events, (free[worker], worker))

    for number in range(min(_AHEAD * workers, chunks)):
        send(0.0, number % workers)
    ended = 0.0
    while events:
        now, worker = heapq.heappop(events)
        scheduler = max(scheduler, now) + 0.5 * costs.scheduler
        caller = max(caller, scheduler) + 0.5 * costs.caller
        ended = caller
        if sent < chunks:
            send(caller, worker)
    return 1.0 - chunk_s * chunks / workers / ended


def smallest_chunk(costs: Costs, workers: int, most: float, rounds: int = 40) -> float:
    """Return the seconds of work of a chunk from which on at most such a share of the time is lost.

    Args:
        rounds: chunks of each worker.
    """
    low, high = 1e-4, 1000.0
    while high > 1.01 * low:
        middle = (low * high) ** 0.5
        if simulated_share(costs, workers, middle, rounds * workers) > most:
            low = middle
        else:
            high = middle
    return high
