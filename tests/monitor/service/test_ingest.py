"""From a live source to the store: committed first, then acknowledged; nothing judged twice; nothing stops it."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.config.load import ConfigError
from monitor.records.database import StoreError
from monitor.records.ledger import SALVAGED_UP_TO, StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest, Turns
from streams.types.block import Rejected
from streams.types.source import Delivery, LiveSource
from tests.support.folder_kill import config
from tests.support.ingest import Queue, block, ingest_of, settings_of, steps


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with Store.open(tmp_path / "state.db", machine="m") as found:
        yield found


def test_blocks_are_committed_with_their_progress_and_then_acknowledged(store: Store) -> None:
    source = Queue(store, [block(1), Rejected("s", 2, "b2", "unreadable", "words"), block(3)])
    assert isinstance(source, LiveSource)
    with ingest_of(store, source) as ingest:
        steps(ingest, 4)
        assert ingest.backlogs()["s"].pending == 0
        assert ingest.problems() == {"s": "dry"}
        assert ingest.ignored() == {"a.md": "of another format"}
    assert source.acknowledged == [1, 2, 3]
    assert source.closed
    assert [record.status for record in store.records()] == ["ok", "unreadable", "ok"]
    with StoreLedger(store) as ledger:
        assert ledger.file_counts("s") == {"accepted": 3}
    assert "channel:s:x" in store.load_states()


def test_a_block_waits_for_two_verdicts_on_the_files_of_others_at_most(store: Store) -> None:
    """Five sources with many damaged files, and one that needs most of the time of the process that commits."""
    costs_s, period_s, time_s = {"good": 0.03, "bad": 0.02}, 0.05, [0.0]

    class Slow(Queue):
        def next(self, timeout: float) -> Delivery | None:
            found = super().next(timeout)
            time_s[0] += 0.001 if found is None else costs_s[self.name.rstrip("12345")]
            return found

    many = {
        f"bad{n}": [Rejected(f"bad{n}", k, f"{k}", "unreadable", "words") for k in range(1, 400)] for n in range(1, 6)
    }
    damaged = [Slow(store, list(items), name) for name, items in many.items()]
    good = Slow(store, [], "good")
    sources = [good, *damaged]
    settings = {source.name: settings_of(source.name) for source in sources}
    verdicts = arrived = committed = 0
    longest: list[int] = []
    came: deque[int] = deque()
    with Ingest(store, StoreLedger(store), sources, settings, timer=lambda: time_s[0]) as ingest:
        while committed < 200:
            while time_s[0] >= arrived * period_s:
                arrived += 1
                item = block(arrived, source="good")
                good.waiting.append(Delivery(item, progress=good.progress(item)))
                came.append(verdicts)
            record = ingest.step(threading.Event())
            assert record is not None
            if record.source == "good":
                committed += 1
                longest.append(verdicts - came.popleft())
            else:
                verdicts += 1
    # At the start nothing is known of what the blocks of each source take.
    assert max(longest[:20]) <= 20
    assert max(longest[20:]) <= 2
    assert verdicts >= 0.2 * time_s[0] / costs_s["bad"] - 2


def test_what_the_ledger_has_is_counted_and_never_judged_again(store: Store) -> None:
    again, other = block(1), block(1, seed=99)
    told = Rejected("s", 1, "copy", "duplicate", "same bytes", again.content_hash)
    source = Queue(store, [block(1), block(2), again, other, told, block(3)])
    with ingest_of(store, source) as ingest:
        steps(ingest, 2)
        before = ingest.state("s").to_stored()
        steps(ingest, 3)
        assert ingest.state("s").to_stored() == before
        steps(ingest, 1)
    assert source.acknowledged == [1, 2, 1, 1, 1, 3]
    assert store.counts() == {"ok": 3, "duplicate": 2, "changed": 1}


def test_a_block_as_one_before_is_new_unless_a_salvage_made_it_come_again(store: Store) -> None:
    again = [replace(block(1), sequence=number, name="live.csv") for number in (1, 3, 4)]
    source = Queue(store, [again[0], block(2), *again[1:]])
    with ingest_of(store, source) as ingest:
        steps(ingest, 4)
    assert store.counts() == {"ok": 4}
    with StoreLedger(store) as ledger:
        assert ledger.number_of("s", "live.csv", again[0].content_hash) is None
        with store.transaction() as connection:
            connection.execute("INSERT INTO meta VALUES (?, '2')", (SALVAGED_UP_TO,))
        assert ledger.number_of("s", "live.csv", again[0].content_hash) == 1
        assert ledger.number_of("s", "b2", again[0].content_hash) is None


def test_a_block_that_does_not_fit_the_configuration_is_refused_and_the_next_one_taken(store: Store) -> None:
    source = Queue(store, [block(1, channel="other"), block(2)])
    with ingest_of(store, source) as ingest:
        steps(ingest, 2)
    first, second = store.records()
    assert (first.status, second.status) == ("wrong_shape", "ok")
    assert "'x'" in first.reason


def test_a_store_that_fails_is_tried_again_and_nothing_is_acknowledged_meanwhile(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.pipeline._RETRY_S", 0.001)
    source = Queue(store, [block(1), block(2)])
    commit, failures = store.commit_many, []

    def full(*values: Any) -> object:
        if len(failures) < 3:
            failures.append(list(source.acknowledged))
            raise StoreError("state.db: database or disk is full")
        return commit(*values)

    monkeypatch.setattr(store, "commit_many", full)
    with ingest_of(store, source) as ingest:
        steps(ingest, 1)
        assert failures == [[], [], []]
        assert source.acknowledged == [1]
        assert "store" not in ingest.problems()
        failures.clear()
        stop = threading.Event()
        stop.set()
        assert ingest.step(stop) is None
        assert ingest.problems()["store"].startswith("state.db")
    assert source.acknowledged == [1]


def test_attempts_to_commit_are_a_second_apart_at_most(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("monitor.pipeline._RETRY_S", 1.0)  # Quick effort shortens it.
    waited: list[float | None] = []

    class Waiting(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            waited.append(timeout)
            return len(waited) == 7

    def full(*_: Any) -> object:
        raise StoreError("state.db: database or disk is full")

    monkeypatch.setattr(store, "commit_many", full)
    with ingest_of(store, Queue(store, [block(1)])) as ingest:
        assert ingest.step(Waiting()) is None
    assert waited == [0.05, 0.1, 0.2, 0.4, 0.8, 1.0, 1.0]


def test_it_stops_when_told_and_shows_what_it_commits(store: Store) -> None:
    source = Queue(store, [block(number) for number in range(1, 6)])
    stop, seen = threading.Event(), []

    def look(record: object) -> None:
        seen.append(record)
        if len(seen) == 3:
            stop.set()

    with ingest_of(store, source) as ingest:
        ingest.run(stop, look)
    assert len(seen) == 3
    assert source.acknowledged == [1, 2, 3]


def test_sources_take_turns(store: Store) -> None:
    one = Queue(store, [block(number) for number in range(1, 4)])
    two = Queue(store, [block(number, source="t") for number in range(1, 4)], name="t")
    with ingest_of(store, one, two) as ingest:
        steps(ingest, 4)
        assert one.acknowledged == two.acknowledged == [1, 2]
        steps(ingest, 2)
    assert store.last("s") == store.last("t") == 3


def test_a_source_that_cannot_be_opened_is_a_configuration_error(store: Store, tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ConfigError, match="expected a folder"):
        Ingest.open(config(str(tmp_path / "file")), store)
    machine = config(str(tmp_path))
    section = machine.source[0].model_copy(update={"url": None})
    with pytest.raises(ConfigError, match="url is missing"):
        Ingest.open(machine.model_copy(update={"source": [section]}), store)


def test_states_are_taken_up_where_the_store_ends(store: Store) -> None:
    first = Queue(store, [block(1), block(2)])
    with ingest_of(store, first) as ingest:
        steps(ingest, 2)
        expected = ingest.state("s").to_stored()
    with ingest_of(store, Queue(store, [])) as ingest:
        assert ingest.state("s").to_stored() == expected


def test_states_of_another_version_are_refused_in_words(store: Store, tmp_path: Path) -> None:
    with ingest_of(store, Queue(store, [block(1)])) as ingest:
        steps(ingest, 1)
    with store.transaction() as connection:
        connection.execute("UPDATE stage_states SET state = json_set(state, '$.version', 99)")
    (tmp_path / "in").mkdir()
    with pytest.raises(StoreError, match=r"state\.db: a state in it is of another version \(.*99"):
        Ingest.open(config(str(tmp_path / "in")), store)


BLOCK_S = 0.01


def serve(turns: Turns, waiting: list[int], costs: Sequence[float] = ()) -> int | None:
    """Take one block of the first source that has one; return its number."""
    for number in turns.order(waiting):
        if waiting[number]:
            waiting[number] -= 1
            turns.served(number, costs[number] if costs else BLOCK_S)
            return number
        turns.missed(number, 0.0)
    return None


@pytest.mark.parametrize("behind", [1, 5, 20])
def test_a_prompt_source_waits_for_a_block_of_another_at_most(behind: int) -> None:
    turns, waiting = Turns(1 + behind), [0, *[1000] * behind]
    for _ in range(8 * behind):
        serve(turns, waiting)
    for _ in range(50):
        waiting[0] += 1
        served = [serve(turns, waiting) for _ in range(2)]
        assert 0 in served
        serve(turns, waiting)


def test_sources_that_are_behind_get_a_turn_in_five_beside_a_busy_one() -> None:
    turns, waiting = Turns(3), [0, 1000, 1000]
    for _ in range(20):
        serve(turns, waiting)
    served: Counter[int | None] = Counter()
    for _ in range(500):
        # It is drained once in three blocks, so it keeps up although it is busy.
        waiting[0] = waiting[0] or 3
        served[serve(turns, waiting)] += 1
        if not waiting[0]:
            turns.order(waiting)
            turns.missed(0, 0.0)
    assert served[0] == pytest.approx(400, abs=4)
    assert served[1] == pytest.approx(served[2], abs=1)


def test_a_prompt_source_that_fell_behind_for_a_moment_catches_up_before_those_far_behind() -> None:
    turns, waiting = Turns(6), [0, *[10_000] * 5]
    for _ in range(200):
        serve(turns, waiting)
    # The machine was busy for a moment; then the source needs half of all turns, not a sixth.
    waiting[0] = 100
    longest = []
    for _ in range(500):
        waiting[0] += 1
        serve(turns, waiting)
        serve(turns, waiting)
        longest.append(waiting[0])
    assert max(longest) <= 101
    assert max(longest[200:]) <= 3
    assert all(10_000 - left > 60 for left in waiting[1:])


def test_a_source_that_needs_most_of_the_time_is_not_delayed_by_those_far_behind() -> None:
    turns, waiting = Turns(6), [0, *[10_000] * 5]
    for _ in range(200):
        serve(turns, waiting)
    longest = []
    # Three blocks come in the time of four.
    for number in range(2000):
        waiting[0] += number % 4 < 3
        serve(turns, waiting)
        longest.append(waiting[0])
    assert max(longest) <= 3
    assert all(10_000 - left > 80 for left in waiting[1:])


def test_a_file_that_takes_long_costs_its_source_the_next_turns() -> None:
    """By turns, a file that takes 5 s would come after every four blocks that take 10 ms."""
    turns, waiting, costs = Turns(2), [0, 5], [BLOCK_S, 5.0]
    for _ in range(3):
        serve(turns, waiting, costs)
    waiting = [1000, 200]
    served = [serve(turns, waiting, costs) for _ in range(1000)]
    assert served.count(1) <= 1


def test_a_source_that_does_not_know_what_waits_counts_as_far_behind_after_many_blocks() -> None:
    turns, left = Turns(2), [1000, 0]
    served: Counter[int] = Counter()
    for _ in range(500):
        left[1] += 1 if left[1] < 50 else 0
        number = next(number for number in turns.order([None, left[1]]) if left[number])
        left[number] -= 1
        served[number] += 1
        turns.served(number, BLOCK_S)
    assert served[0] == pytest.approx(150, abs=60)


def test_one_block_that_took_an_hour_does_not_put_its_source_behind_for_long() -> None:
    turns, waiting = Turns(2), [100, 10_000]
    for _ in range(50):
        serve(turns, waiting)
    # The disk was full meanwhile.
    turns.order(waiting)
    turns.served(0, 3600.0)
    waiting[0] = 20
    assert [serve(turns, waiting) for _ in range(20)].count(0) >= 15


def test_sources_that_are_all_behind_share_the_turns() -> None:
    turns, waiting = Turns(4), [1000] * 4
    served = Counter(serve(turns, waiting) for _ in range(400))
    assert all(abs(blocks - 100) <= 4 for blocks in served.values())


@pytest.mark.parametrize("prompt", [0, 1])
def test_sources_with_about_as_much_waiting_share_the_turns(prompt: int) -> None:
    turns, waiting = Turns(3), [0, 40, 37]
    served: Counter[int | None] = Counter()
    for _ in range(30):
        waiting[0] += prompt
        served[serve(turns, waiting)] += 1
        served[serve(turns, waiting)] += 1
    assert abs(served[1] - served[2]) <= 6


@given(st.lists(st.lists(st.integers(0, 3), min_size=3, max_size=3), max_size=60))
def test_every_block_is_served_whatever_arrives(arrivals: list[list[int]]) -> None:
    turns, waiting, served = Turns(3), [0, 0, 0], 0
    for arrived in arrivals:
        waiting = [have + new for have, new in zip(waiting, arrived, strict=True)]
        assert sorted(turns.order(waiting)) == sorted(turns.order([None, 0, 9.5])) == [0, 1, 2]
        served += serve(turns, waiting) is not None
    while serve(turns, waiting) is not None:
        served += 1
    assert served == sum(map(sum, arrivals))
