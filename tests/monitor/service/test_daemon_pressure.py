"""Bursts, slow disks, quiet and noisy neighbours: blocks wait, their age is shown, and nobody starves."""

from __future__ import annotations

import itertools
import threading
import time
from pathlib import Path
from typing import Any

import pytest

from monitor.records.store import Store
from monitor.service.system import ServiceManager
from streams.types.source import Delivery
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.effort import effort_count
from tests.support.ingest import Queue, block, ingest_of, steps
from tests.support.waiting import wait_until

pytestmark = pytest.mark.process

FILES = effort_count(quick=80, full=10_000)


class SlowDisk:
    """Commits that take a while, until the disk is mended."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
        self.slow = threading.Event()
        self.slow.set()
        commit = Store.commit_many

        def wait(store: Store, *values: Any) -> object:
            if self.slow.is_set():
                time.sleep(seconds)
            return commit(store, *values)

        monkeypatch.setattr(Store, "commit_many", wait)


def order(config: Path) -> list[str]:
    """Return the sources of the blocks as they were committed."""
    with Store.open(config.parent / "state" / "state.db", read_only=True) as store:
        return [row[0] for row in store.rows("SELECT source FROM blocks ORDER BY id")]


@pytest.mark.timeout(effort_count(quick=900, full=1800))
def test_a_burst_delays_itself_and_no_other_source(tmp_path: Path) -> None:
    config = make_machine(tmp_path, sources=2)
    for number in range(FILES):
        put(config, number)
    given = 0
    with running(config):
        while last(config, "s0") < 2 * FILES - 100:
            given += 1
            put(config, given, source=1)
            wait_until(lambda blocks=2 * given: last(config, "s1") == blocks, every=0.03)
            shown = status(config)["sources"]
            if shown["s0"]["pending"]:
                assert shown["s0"]["oldest_age_s"] > 0.0
            assert shown["s0"]["offered"] == sum(shown["s0"][key] for key in ("accepted", "rejected", "pending"))
        wait_until(lambda: last(config, "s0") == 2 * FILES, every=0.05)
        wait_until(lambda: status(config)["sources"]["s0"]["pending"] == 0)
    places = [place for place, source in enumerate(order(config)) if source == "s1"]
    assert len(places) == 2 * given >= 4
    # In turn: between the two blocks of a file of the one comes a block of the other.
    assert all(second - first <= 2 for first, second in zip(places[::2], places[1::2], strict=True))


def test_on_a_slow_disk_blocks_wait_in_turn_and_their_age_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk, beats = SlowDisk(monkeypatch, 0.1), []
    monkeypatch.setattr(ServiceManager, "feed_watchdog", lambda self, now: beats.append(now))
    config = make_machine(tmp_path, sources=2)
    for number in range(40):
        put(config, number)
        put(config, number, source=1)
    with running(config):
        wait_until(lambda: status(config)["sources"]["s0"]["oldest_age_s"] > 0.7, every=0.05)
        wait_until(lambda: min(order(config).count(name) for name in ("s0", "s1")) >= 5, every=0.05)
        found = status(config)
        assert found["status"] == "running"
        assert min(found["sources"][name]["pending"] for name in ("s0", "s1")) > 10
        taken = order(config)
        # From where both have a block; one that keeps up comes first, one behind has at least a turn in five.
        both = taken[max(taken.index("s0"), taken.index("s1")) :]
        for name in ("s0", "s1"):
            turns = [turn for turn, source in enumerate(both) if source == name]
            assert max(after - before for before, after in itertools.pairwise([-1, *turns])) <= 5
        # A daemon that is slow is alive: it beats with each block.
        assert len(beats) >= len(taken)
        disk.slow.clear()
        wait_until(lambda: last(config, "s0") == last(config, "s1") == 80)
        wait_until(lambda: status(config)["sources"]["s0"]["oldest_age_s"] == 0.0)


def test_a_disk_that_hangs_for_a_moment_loses_nothing_and_the_stop_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    SlowDisk(monkeypatch, 0.7)
    config = make_machine(tmp_path)
    put(config, 1)
    with running(config):
        wait_until(lambda: status(config)["sources"]["s0"]["pending"] == 1)
    # The block in hand was finished; what was not taken is still in the folder.
    done = last(config)
    assert done <= 2
    with running(config):
        wait_until(lambda: last(config) == 2)


def test_a_busy_source_is_not_slowed_down_by_a_quiet_one(tmp_path: Path) -> None:
    waited: list[float] = []

    class Quiet(Queue):
        def next(self, timeout: float) -> Delivery | None:
            waited.append(timeout)
            return None

    with Store.open(tmp_path / "state.db", machine="m") as store:
        busy, quiet = Queue(store, [block(number) for number in range(1, 6)]), Quiet(store, [], name="t")
        with ingest_of(store, quiet, busy) as ingest:
            steps(ingest, 5)
            assert busy.acknowledged == [1, 2, 3, 4, 5]
            assert set(waited) == {0.0}
            steps(ingest, 1)
            assert max(waited) > 0.0
