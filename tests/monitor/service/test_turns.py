"""Who is asked next: sources that keep up first, those behind now and then, each in its turn."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.service.turns import Turns


def serve(turns: Turns, waiting: list[int]) -> int | None:
    """Take one block of the first source that has one; return its number."""
    for number in turns.order():
        turns.asked(number, delivered=waiting[number] > 0)
        if waiting[number]:
            waiting[number] -= 1
            return number
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
            turns.asked(0, delivered=False)
    assert served[0] == pytest.approx(400, abs=4)
    assert served[1] == pytest.approx(served[2], abs=1)


def test_a_prompt_source_that_fell_behind_for_a_moment_catches_up_before_those_far_behind() -> None:
    turns, waiting = Turns(6), [0, *[10_000] * 5]
    for _ in range(200):
        serve(turns, waiting)
    # The machine was busy for a moment; then the source needs half of all turns, not a sixth.
    waiting[0] = 10
    longest = []
    for _ in range(500):
        waiting[0] += 1
        serve(turns, waiting)
        serve(turns, waiting)
        longest.append(waiting[0])
    assert max(longest) <= 11
    assert max(longest[100:]) <= 3
    assert all(10_000 - left > 60 for left in waiting[1:])


def test_sources_that_are_all_behind_share_the_turns() -> None:
    turns, waiting = Turns(4), [1000] * 4
    served = Counter(serve(turns, waiting) for _ in range(400))
    assert all(abs(blocks - 100) <= 4 for blocks in served.values())


@given(st.lists(st.lists(st.integers(0, 3), min_size=3, max_size=3), max_size=60))
def test_every_block_is_served_whatever_arrives(arrivals: list[list[int]]) -> None:
    turns, waiting, served = Turns(3), [0, 0, 0], 0
    for arrived in arrivals:
        waiting = [have + new for have, new in zip(waiting, arrived, strict=True)]
        assert sorted(turns.order()) == [0, 1, 2]
        served += serve(turns, waiting) is not None
    while serve(turns, waiting) is not None:
        served += 1
    assert served == sum(map(sum, arrivals))
