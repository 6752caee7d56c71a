"""Makers and checks that tests of daemon share."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from monitor.config.load import load_config
from monitor.records.store import Store
from monitor.service.daemon import Daemon
from tests.streams.folders import csv_bytes, noise
from tests.support.daemons import status
from tests.support.waiting import join, wait_until


@contextmanager
def running(config: Path, **injected: Any) -> Iterator[Daemon]:
    """Run a daemon in a thread until the end of the block; it must end in order."""
    stop, failures = threading.Event(), []
    daemon = Daemon(load_config(config), **injected)

    def run() -> None:
        try:
            daemon.run(stop)
        except Exception as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        wait_until(lambda: failures or status(config).get("status") in ("running", "degraded"))
        assert not failures
        yield daemon
    finally:
        stop.set()
        join(thread)
    assert failures == []


def put(config: Path, number: int, source: int = 0) -> None:
    """Give a source a file of two blocks."""
    path = config.parent / f"in{source}" / f"f{number:04d}.csv"
    path.with_suffix(".tmp").write_bytes(csv_bytes(noise(512, 1000 * source + number)))
    path.with_suffix(".tmp").rename(path)


def last(config: Path, source: str = "s0") -> int:
    with Store.open(config.parent / "state" / "state.db", read_only=True) as store:
        return store.last(source)
