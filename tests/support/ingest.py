"""Makers and checks that tests of ingest share."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import replace
from typing import Any, Self

import numpy as np

from models.platform.supervision import Restarts
from monitor.health.state import SourceSettings
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.setup import source_settings
from streams.types.block import Block, Rejected
from streams.types.source import Backlog, Delivery, FileProgress, Ledger
from tests.support.folder_kill import config

RATE = 2560.0


def block(sequence: int, seed: int | None = None, channel: str = "x", source: str = "s") -> Block:
    samples = np.random.default_rng(sequence if seed is None else seed).normal(size=(1, 256))
    return Block(samples, RATE, (channel,), ("g",), source, sequence, f"b{sequence}", content_hash=str(samples[0, 0]))


class Queue:
    """A live source that gives what it is told to, and keeps what is not acknowledged."""

    def __init__(self, store: Store, items: list[Block | Rejected], name: str = "s") -> None:
        self.name = name
        self.store = store
        self.waiting = deque(Delivery(item, progress=self.progress(item)) for item in items)
        self.acknowledged: list[int] = []
        self.out: Delivery | None = None
        self.closed = False

    def progress(self, item: Block | Rejected) -> tuple[FileProgress, ...]:
        return (FileProgress(f"{item.name}.csv", 1, 2, 3, verdict="accepted"),)

    def open(self, ledger: Ledger) -> None:
        pass

    def next(self, timeout: float) -> Delivery | None:
        self.out = self.waiting.popleft() if self.waiting else None
        return self.out

    def acknowledge(self, delivery: Delivery) -> None:
        assert delivery is self.out
        assert self.store.record(delivery.item.source, delivery.item.sequence) is not None
        self.acknowledged.append(delivery.item.sequence)

    def assumes_interval(self) -> bool:
        return False

    def ready_blocks(self) -> int:
        return self.queued_blocks()

    def tend(self) -> None:
        pass

    def restarts(self) -> tuple[Restarts, ...]:
        return ()

    def listener(self) -> None:
        return None

    def queued_blocks(self) -> int:
        return len(self.waiting)

    def backlog(self) -> Backlog:
        return Backlog(0, 0, 0, len(self.waiting), 0.0)

    def ignored(self) -> dict[str, str]:
        return {"a.md": "of another format"}

    def problem(self) -> str | None:
        return None if self.waiting else "dry"

    def notices(self) -> list[dict[str, Any]]:
        return []

    def close(self) -> None:
        self.closed = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def settings_of(name: str = "s") -> SourceSettings:
    machine = config("nowhere")
    return replace(source_settings(machine, machine.source[0]), name=name)


def ingest_of(store: Store, *sources: Queue) -> Ingest:
    names = {source.name for source in sources}
    settings = {name: settings_of(name) for name in names}
    # No block costs more time than another.
    return Ingest(store, StoreLedger(store), sources, settings, clock=lambda: 1.7e9, timer=lambda: 0.0)


def steps(ingest: Ingest, count: int) -> None:
    for _ in range(count):
        ingest.step(threading.Event())
