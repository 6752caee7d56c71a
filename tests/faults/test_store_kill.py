"""A process that commits blocks is killed at any moment: what it acknowledged is there, once, and whole."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest

from monitor.records.store import Store
from tests.support.effort import effort_count
from tests.support.forks import Fork, Messages
from tests.support.store_kill import block

pytestmark = pytest.mark.process

KILLS = effort_count(quick=5, full=200)


def commit_for_ever(messages: Messages, path: Path) -> None:
    """Commit block after block, and send the number of each that is acknowledged."""
    with Store.open(path, machine="m") as store:
        messages.send("open")
        sequence = store.last("s")
        while True:
            sequence += 1
            if store.commit(block(sequence), {"detect:x": {"seen": sequence}}) == "committed":
                messages.send(sequence)


def test_every_acknowledged_block_survives_sigkill(tmp_path: Path) -> None:
    generator = random.Random(20240229)
    acknowledged = total = 0
    path = tmp_path / "state.db"
    for kill in range(KILLS):
        if kill % 10 == 0:
            # A store grown over many kills would make each look at it slower, and the first moments are special.
            path = tmp_path / f"{kill}.db"
            acknowledged = 0
        child = Fork(commit_for_ever, path)
        # The first child is killed after it has acknowledged a block, however slow the machine is.
        messages = [child.receive() for _ in range(2 if kill == 0 else int(generator.random() < 0.7))]
        time.sleep(generator.uniform(0.0, 0.2))
        messages += child.kill()
        acknowledged = max([acknowledged, *(number for number in messages if number != "open")])
        total = max(total, acknowledged)
        with Store.open(path, machine="m") as store:
            assert store.check() == []
            found = list(store.records())
            assert len(found) >= acknowledged
            assert found == [block(number) for number in range(1, len(found) + 1)]
            assert store.load_states() == ({"detect:x": {"seen": len(found)}} if found else {})
            assert [event["n"] for event in store.events()] == list(range(3, len(found) + 1, 3))
    assert total > 0
