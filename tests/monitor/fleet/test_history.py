"""Recordings as one source: however it is cut into parts, the same blocks come, with the same numbers and times."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from monitor.fleet.history import HistorySource, Position
from monitor.health.signal.bands import VOTES_NEEDED
from streams.types.block import Block, Rejected
from streams.types.spec import SourceError

HOUR = 3600.0
Items = list[Block | Rejected]
KINDS = st.lists(st.sampled_from(["block", "rejected", "repetition"]), max_size=6)


@dataclass
class Opened:
    """A recording that is open."""

    items: Items
    name: str = "s"

    def __iter__(self) -> Iterator[Block | Rejected]:
        return iter(self.items)

    def __len__(self) -> int:
        return len(self.items)


def recordings(kinds: list[list[str]]) -> dict[str, Items]:
    """Return recordings of items by their names; each counts from 1, and times go on over all of them."""
    found: dict[str, Items] = {}
    time = 1.7e9
    for number, listed in enumerate(kinds):
        items: Items = []
        sequence = 0
        for kind in listed:
            name = f"r{number}[{len(items)}]"
            time += HOUR
            if kind == "repetition":
                if not sequence:
                    # What is repeated came before, under a number.
                    continue
                items.append(Rejected("s", max(1, sequence), name, "duplicate", "again", f"{number}"))
                continue
            sequence += 1
            if kind == "rejected":
                items.append(Rejected("s", sequence, name, "nan", "no numbers"))
            else:
                samples = np.zeros((1, 1), np.float32)
                items.append(Block(samples, 1.0, ("a",), ("g",), "s", sequence, name, start=time, elapsed=0.0))
        found[f"r{number}"] = items
    return found


def source(found: dict[str, Items], begin: Position = Position()) -> HistorySource:  # noqa: B008 - frozen
    @contextmanager
    def opener(name: str, reading: object) -> Iterator[Opened]:
        if name not in found:
            raise SourceError(f"there is no {name}")
        yield Opened(found[name])

    return HistorySource("s", list(found)[begin.recording :], begin, opener)


def seen(item: Block | Rejected) -> tuple[object, ...]:
    if isinstance(item, Block):
        # The elapsed time of the first recording is its own.
        return item.sequence, item.name, item.start, item.elapsed if not item.name.startswith("r0") else None
    return item.sequence, item.name, item.status


def take(history: HistorySource, last: int, limit: int | None) -> tuple[Items, list[Rejected]]:
    """Take items after a number as a replay does; return them, and the repetitions that were met."""
    taken: Items = []
    repeated: list[Rejected] = []
    for item in history:
        if isinstance(item, Rejected) and item.is_repetition:
            repeated.append(item)
        elif item.sequence > last:
            taken.append(item)
        if len(taken) == limit:
            break
    return taken, repeated


@given(st.lists(KINDS, min_size=1, max_size=5), st.integers(1, 5))
def test_parts_give_what_one_go_gives(kinds, limit):
    found = recordings(kinds)
    whole, repeated = take(source(found), 0, None)
    assert [item.sequence for item in whole] == list(range(1, len(whole) + 1))
    parts: Items = []
    met: list[Rejected] = []
    begin = Position()
    while True:
        history = source(found, begin)
        if parts:
            starts = [item.start for item in parts if isinstance(item, Block)]
            history.continues(starts[0] if starts else None, met)
        taken, met = take(history, len(parts), limit)
        parts += taken
        assert history.problem is None
        if len(taken) < limit:
            break
        assert history.reached.part == begin.part + 1
        begin = history.reached
    assert list(map(seen, parts)) == list(map(seen, whole))
    assert sorted(item.name for item in met) == sorted(item.name for item in repeated)


def test_what_cannot_be_opened_ends_a_history_and_is_said():
    found = recordings([["block"], ["block"], ["block"]])
    history = source(found)
    del found["r1"]
    taken, _ = take(history, 0, None)
    assert [item.name for item in taken] == ["r0[0]"]
    assert history.problem == "there is no r1"
    # The next iteration begins afresh.
    found |= recordings([["block"], ["block"]])
    assert len(take(history, 0, None)[0]) == 3
    assert history.problem is None


def test_its_length_is_counted_as_far_as_the_choice_of_bands_needs_it():
    assert len(source(recordings([["block"] * 3, ["rejected"]]))) == 4
    assert len(source(recordings([["block"] * VOTES_NEEDED] * 2))) == VOTES_NEEDED
