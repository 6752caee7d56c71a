"""A live source whose blocks are committed in the background."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from streams.types.block import Block, Rejected
from streams.types.source import LiveSource
from tests.support.memory_ledger import MemoryLedger


@contextmanager
def committing(source: LiveSource, ledger: MemoryLedger) -> Iterator[list[Block | Rejected]]:
    """Commit in the background, and give what was committed."""
    items: list[Block | Rejected] = []
    done = threading.Event()

    def work() -> None:
        while not done.is_set():
            delivery = source.next(0.02)
            if delivery is not None:
                ledger.commit(delivery.item)
                items.append(delivery.item)
                source.acknowledge(delivery)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield items
    finally:
        done.set()
        thread.join()
