"""Functions of tasks, and an executor that does what a script says."""

from __future__ import annotations

import os
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from models.words.errors import WrongInputError
from models.work.chunk import run_chunk
from models.work.task import DIED, ChunkCall, ChunkOutcome, Failure, Work


@dataclass(frozen=True)
class Shared:
    factor: float
    table: Any = None


def scaled(shared: Shared, task: float) -> np.ndarray:
    return np.full(3, shared.factor * task)


def fails_on_odd(shared: int, task: int) -> int:
    if task % 2:
        raise RuntimeError(f"{task} is odd")
    return task + shared


def refuses_from(shared: int, task: int) -> int:
    if task >= shared:
        raise WrongInputError(f"task {task}: expected less than {shared}")
    return task


def wrong_value(_shared: None, task: int) -> int:
    return int("x" * task) if task else 0


def leaks(shared: str, _task: int) -> None:
    raise OSError(f"cannot open {shared} with {os.environ['AWS_SECRET_ACCESS_KEY']}")


def unsendable(_shared: None, _task: int) -> dict[str, range]:
    return {"a": range(3)}


def dies_once(shared: str, task: int) -> int:
    """Kill the process at the first odd task."""
    try:
        os.close(os.open(f"{shared}/{task}", os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return task
    return os._exit(9) if task % 2 else task


def cleans_up(shared: str, task: int) -> int:
    """Make a file, wait to be interrupted, and remove the file; task 0 does nothing."""
    if task == 0:
        return task
    path = Path(shared, f"temporary-{task}")
    path.touch()
    try:
        time.sleep(60.0)
    finally:
        path.unlink()
    return task


def process(_shared: None, _task: int) -> int:
    return os.getpid()


def work(function: Callable[..., Any], per_chunk: int = 1, *, threads: bool = False) -> Work[Any, Any, Any]:
    return Work(function.__name__, function, 1000, per_chunk, threads)


class ScriptedExecutor:
    """Runs chunks in an order that ``choose`` says, and loses the workers of some.

    Attributes:
        choose: returns which of so many waiting chunks is next.
        fate: returns for a chunk "run", "dies" (before its end), "late" (it has ended, but the worker is lost).
    """

    name = "scripted"

    def __init__(self, choose: Callable[[int], int], fate: Callable[[str], str], most: int = 3) -> None:
        self.choose, self.fate, self.most = choose, fate, most
        self.calls: deque[ChunkCall] = deque()
        self.ran: list[str] = []
        self.greatest = 0

    def capacity(self) -> int:
        return self.most

    def workers(self) -> int:
        return self.most

    def submit(self, call: ChunkCall) -> None:
        self.calls.append(call)
        self.greatest = max(self.greatest, len(self.calls))

    def wait(self) -> ChunkOutcome:
        number = self.choose(len(self.calls))
        call = self.calls[number]
        del self.calls[number]
        fate = self.fate(call.label)
        lost = ChunkOutcome(call.key, Failure(DIED, "lost", ""), 0.0, 0, "w", "p")
        if fate == "dies":
            return lost
        self.ran.append(call.label)
        outcome = run_chunk(call)
        return lost if fate == "late" else replace(outcome, worker="w")

    def close(self) -> None:
        self.calls.clear()
