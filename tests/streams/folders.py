"""A watched folder driven by a clock that a test sets, and a ledger that remembers what was committed."""

from __future__ import annotations

import threading
import weakref
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.platform.supervision import Restarts
from streams.folder.source import FolderClock, FolderSource
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceSpec
from tests.support.memory_ledger import MemoryLedger

RATE = 1000.0
CHANNELS = (ChannelSpec("x", column=1, unit="g"),)


class SetClock(FolderClock):
    """A clock that passes only while somebody waits."""

    patience_s = 60.0

    def __init__(self) -> None:
        self.now = 1000.0

    def monotonic(self) -> float:
        return self.now

    def wait(self, event: threading.Event, seconds: float) -> None:
        if not event.is_set():
            self.now += seconds


class DeafWatch:
    """Stands for a network share: no events."""

    listening = False

    def __init__(self) -> None:
        self.starts: list[Path] = []
        self.closed: set[str] = set()
        self.dead = False
        self.overflows = 0
        self.restarts = Restarts("the watch of s")

    def start(self, root: Path) -> None:
        self.starts.append(root)
        self.dead = False

    def tend(self) -> bool:
        return self.dead

    def finished(self) -> set[str]:
        found, self.closed = self.closed, set()
        return found

    def stop(self) -> None:
        pass


class Rig:
    """A folder, its source, and a ledger to which everything delivered is committed."""

    def __init__(self, root: Path, ledger: MemoryLedger | None = None, **spec: Any) -> None:
        self.root = root
        self.ledger = ledger or MemoryLedger()
        self.clock = SetClock()
        self.watch = DeafWatch()
        base = SourceSpec(name="s", url=f"folder:{root}", rate=RATE, channels=CHANNELS, block_s="file")
        self.spec = replace(base, **spec)
        self._opened_sources: list[FolderSource] = []
        self.items: list[Block | Rejected] = []
        self.outcomes: list[str] = []
        self.source = self._opened()
        weakref.finalize(self, _close, self._opened_sources)

    def _opened(self) -> FolderSource:
        source = FolderSource(self.spec, str(self.root), self.clock)
        vars(source)["_watch"] = self.watch
        source.open(self.ledger)
        self._opened_sources.append(source)
        return source

    def restart(self) -> None:
        """Let the process die with whatever it had not committed, and begin anew on the same ledger."""
        self.source.close()
        self.source = self._opened()

    def run(self, seconds: float = 10.0, most: int | None = None) -> list[Block | Rejected]:
        """Let time pass, commit what comes, and return it."""
        end = self.clock.now + seconds
        found: list[Block | Rejected] = []
        while self.clock.now < end and (most is None or len(found) < most):
            delivery = self.source.next(end - self.clock.now)
            if delivery is None:
                break
            found.append(delivery.item)
            self.outcomes.append(self.ledger.commit(delivery.item, delivery.progress))
            self.source.acknowledge(delivery)
        self.items += found
        self.check()
        return found

    def check(self) -> None:
        backlog = self.source.backlog()
        assert backlog.offered == backlog.accepted + backlog.rejected + backlog.ignored + backlog.pending

    def samples(self) -> NDArray[np.floating]:
        """Return all samples of all blocks, one after the other."""
        return np.concatenate([item.samples[0] for item in self.items if isinstance(item, Block)])


def _close(sources: list[FolderSource]) -> None:
    """End the threads and child processes of sources that a test has left open."""
    for source in sources:
        source.close()


def noise(count: int, seed: int = 0) -> NDArray[np.float64]:
    return np.round(np.random.default_rng(seed).normal(size=count), 4)


def csv_bytes(samples: NDArray[np.float64]) -> bytes:
    return "".join(f"{value:.4f}\n" for value in samples).encode()


def verdicts(items: list[Block | Rejected]) -> list[tuple[str, str]]:
    return [(item.name, item.status if isinstance(item, Rejected) else "accepted") for item in items]
