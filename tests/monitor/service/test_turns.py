"""Who is asked next: sources that keep up first, those behind now and then, each in its turn."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.service.ingest import Turns

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
