"""Silence is said once and its end once, whatever the rhythm of a source; a restart repeats neither."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.record import Record
from monitor.records.database import StoreError
from monitor.records.events import EventLog
from monitor.records.store import Store
from monitor.service.machine_status import DataFlow, LatestBlock, SilenceLog, silence_limit
from tests.support.daemon import last, put, running
from tests.support.daemons import make_machine, status
from tests.support.effort import effort_count
from tests.support.waiting import wait_until


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[tuple[Store, EventLog]]:
    with Store.open(tmp_path / "state.db", machine="m") as store, EventLog(store.path) as log:
        yield store, log


def silences(opened: tuple[Store, EventLog]) -> SilenceLog:
    return SilenceLog(*opened, {"s": ["x", "y"]}, lambda: 1.7e9)


def flow(age: float, flowed: float = 0.0) -> dict[str, DataFlow]:
    return {"s": DataFlow(7, age, 60.0, flowed)}


def kinds(log: EventLog) -> list[str]:
    return [notice.body["kind"] for _, notice in log.notices()]


def test_it_is_said_once_with_what_is_known(opened: tuple[Store, EventLog]) -> None:
    found = silences(opened)
    assert found.update(flow(60.0)) == []
    (notice,) = found.update(flow(61.0))
    assert notice == {
        "kind": "no_data",
        "source": "s",
        "channels": ["x", "y"],
        "last_block": 7,
        "age_s": 61.0,
        "text": "no block from source s for 61 s; the last was block 7",
    }
    assert found.update(flow(600.0)) == []
    # One block is no flow yet.
    assert found.update(flow(1.0)) == []
    assert found.update(flow(1.0, flowed=60.0))[0]["kind"] == "data_again"
    assert found.update(flow(2.0, flowed=90.0)) == []
    assert kinds(opened[1]) == ["no_data", "data_again"]
    assert [notice.open for _, notice in opened[1].notices()] == [True, False]


def test_a_restart_repeats_nothing(opened: tuple[Store, EventLog]) -> None:
    silences(opened).update(flow(61.0))
    assert silences(opened).update(flow(700.0)) == []
    assert silences(opened).update(flow(1.0, flowed=100.0))[0]["kind"] == "data_again"
    assert silences(opened).update(flow(1.0, flowed=100.0)) == []
    assert silences(opened).update(flow(61.0))[0]["kind"] == "no_data"


def test_what_cannot_be_logged_is_logged_later(opened: tuple[Store, EventLog], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*values: Any) -> str:
        raise StoreError("state.db: database or disk is full")

    found = silences(opened)
    with monkeypatch.context() as patched:
        patched.setattr(EventLog, "notice", full)
        assert found.update(flow(61.0)) == []
        assert found.problem == "state.db: database or disk is full"
    assert found.update(flow(62.0))[0]["age_s"] == 62.0
    assert found.problem is None


@settings(max_examples=effort_count(quick=20, full=2000))
@given(gaps=st.lists(st.sampled_from([1.0, 5.0, 30.0, 59.0, 61.0, 300.0]), min_size=1, max_size=60))
def test_whatever_the_rhythm_notices_alternate_and_none_comes_within_a_silence_limit(
    tmp_path_factory: pytest.TempPathFactory, gaps: list[float]
) -> None:
    wait = silence_limit(5.0)
    assert wait == 60.0
    with Store.open(tmp_path_factory.mktemp("s") / "state.db", machine="m") as store, EventLog(store.path) as log:
        found, newest, now = silences((store, log)), LatestBlock(), 0.0
        said: list[tuple[float, str]] = []

        def look() -> None:
            committed, since = newest.committed or 0.0, newest.flowing_since or 0.0
            flow = DataFlow(newest.sequence, now - committed, wait, committed - since)
            said.extend((now, notice["kind"]) for notice in found.update({"s": flow}))

        for sequence, gap in enumerate(gaps, 1):
            until = now + gap
            while now + 1.0 < until:
                now += 1.0
                look()
            now = until
            newest = newest.after(Record("s", sequence, "b", str(sequence)), now, wait)
            look()
    assert [kind for _, kind in said] == (["no_data", "data_again"] * len(said))[: len(said)]
    # Silent for the whole limit before the one, blocks for as long before the other: never in quick succession.
    assert all(after - before >= wait - 1.0 for (before, _), (after, _) in pairwise(said))
    # The oracle: silence is said if and only if there was one.
    assert bool(said) == any(gap > wait + 1.0 for gap in gaps)


def test_the_limit_follows_the_interval() -> None:
    assert silence_limit(None) == 600.0
    assert silence_limit(0.1) == 60.0
    assert silence_limit(600.0) == 6000.0


@pytest.mark.process
def test_a_daemon_logs_silence_and_its_end_and_a_restart_while_silent_says_nothing(tmp_path: Path) -> None:
    config, late = make_machine(tmp_path, sources=2), [0.0]

    def clock() -> float:
        return time.monotonic() + late[0]

    def notices() -> list[tuple[str, str]]:
        with EventLog(tmp_path / "state" / "state.db") as log:
            return [(found.body["kind"], found.body["source"]) for _, found in log.notices()]

    def counted(blocks: int) -> None:
        """Wait until the status counts the blocks since the start; their times are taken before that."""
        wait_until(lambda: status(config)["blocks"] == blocks)

    with running(config, monotonic=clock):
        put(config, 1)
        put(config, 1, source=1)
        wait_until(lambda: last(config) == last(config, "s1") == 2)
        counted(4)
        assert notices() == []
        # Blocks without a date: ten minutes are the limit. s1 goes on, s0 does not.
        late[0] += 400.0
        put(config, 2, source=1)
        wait_until(lambda: last(config, "s1") == 4)
        counted(6)
        late[0] += 300.0
        wait_until(lambda: status(config)["channels"]["x0"]["state"] == "no_data")
        wait_until(lambda: status(config)["unacknowledged"] == 1)
        assert status(config)["channels"]["x1"]["state"] == "check_function"
        assert notices() == [("no_data", "s0")]
    with running(config, monotonic=clock):
        late[0] += 400.0
        put(config, 3, source=1)
        wait_until(lambda: last(config, "s1") == 6)
        counted(2)
        late[0] += 300.0
        wait_until(lambda: status(config)["channels"]["x0"]["state"] == "no_data")
        assert notices() == [("no_data", "s0")]
        for number in (2, 3, 4):
            put(config, number)
            wait_until(lambda blocks=2 * number: last(config) == blocks)
            put(config, number + 2, source=1)
            wait_until(lambda blocks=2 * number + 4: last(config, "s1") == blocks)
            counted(4 * number - 2)
            late[0] += 310.0
        put(config, 5)
        wait_until(lambda: notices()[-1] == ("data_again", "s0"))
    assert notices() == [("no_data", "s0"), ("data_again", "s0")]


@pytest.mark.process
def test_what_could_not_be_taken_is_no_silence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.service.system._CHECK_DISK_S", 0.05)
    config, late, free = make_machine(tmp_path), [0.0], [10**9]
    with running(config, monotonic=lambda: time.monotonic() + late[0], free=lambda _: free[0]):
        put(config, 1)
        wait_until(lambda: last(config) == 2)
        free[0] = 1000
        wait_until(lambda: "disk" in status(config)["problems"])
        late[0] += 3600.0
        put(config, 2)
        wait_until(lambda: status(config)["up_s"] > 3600.0)
        free[0] = 10**9
        wait_until(lambda: last(config) == 4)
        wait_until(lambda: status(config)["problems"] == {} and status(config)["blocks"] == 4)
    with EventLog(tmp_path / "state" / "state.db") as log:
        assert {found.body["kind"] for _, found in log.notices()} == {"disk_low"}
