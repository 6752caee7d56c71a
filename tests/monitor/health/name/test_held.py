"""The event of a verdict that names another part: given once it has held; withheld for hints, flicker, joined names."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.name.evidence import BlockEvidence, parts_of
from monitor.health.name.machine import MachineState, PersistentName, step
from monitor.health.output import name_events
from monitor.health.schema import FAULTS
from monitor.words.events import badness, event_text

PERSIST = 5
# Blocks of a deep name after which the evidence since the onset is on its side, of 20 blocks of another.
MANY = 60


def names(fault: str | None, count: int, depth: float = 0.4, *, final: bool = True) -> list[BlockEvidence]:
    return [BlockEvidence(fault=fault, depth=depth, final=final)] * count


def changes(blocks: Iterable[BlockEvidence]) -> list[tuple[int, str | None, str | None]]:
    """Return number of the block, part before and part after of each event."""
    state, found = MachineState(), []
    for number, heard in enumerate(blocks, 1):
        state, said = step(state, {"x": heard}, {"drive": ("x",)}, PERSIST)
        state = MachineState.from_dict(json.loads(json.dumps(state.to_dict())))
        found += [(event["block"], event["from"], event["to"]) for event in name_events(number, said)]
    return found


def first_named(blocks: Iterable[BlockEvidence], fault: str) -> int:
    """Return the first block at which the verdict has a name."""
    state = MachineState()
    for number, heard in enumerate(blocks, 1):
        state, said = step(state, {"x": heard}, {"drive": ("x",)}, PERSIST)
        if said["drive"].fault == fault:
            return number
    raise AssertionError(fault)


def test_another_part_is_an_event_once_its_name_has_held() -> None:
    blocks = names("outer", 20) + names("inner", MANY)
    since = first_named(blocks, "inner")
    assert changes(blocks) == [(since + PERSIST - 1, "outer", "inner")]
    assert changes(blocks[: since + PERSIST - 2]) == []
    # Blocks that name no part do not count.
    pause = [BlockEvidence(usable=False, paused=True)] * 3
    assert changes([*blocks[:since], *pause, *blocks[since:]]) == [(since + PERSIST + 2, "outer", "inner")]


@pytest.mark.parametrize(
    "blocks",
    [
        names("outer", MANY),
        names("outer", 20, final=False) + names("inner", MANY, final=False),
        names("outer", 20, final=False) + names("inner", MANY),
        names("outer", 20) + names(None, MANY),
        names("inner|ball", 20) + names("inner", MANY),
        names("outer", 20) + names("outer", 5, final=False) + names("inner", MANY),
        names("outer", 20) + [*names("inner", 1), *names("outer", 1)] * MANY,
    ],
    ids=["same", "hints", "hint, then verdict", "silence", "joined", "the next stage", "flicker"],
)
def test_no_event(blocks: list[BlockEvidence]) -> None:
    assert changes(blocks) == []


@pytest.mark.parametrize("flicker", [("inner", None), ("inner", "ball"), ("inner", "outer"), ("inner|ball", "inner")])
def test_a_name_that_comes_and_goes_is_not_held(flicker: tuple[str | None, ...]) -> None:
    held = PersistentName("outer")
    for _ in range(20):
        for fault in flicker:
            held = held.after(fault, PERSIST)
    assert held.fault == "outer"
    for _ in range(PERSIST):
        held = held.after("ball", PERSIST)
    assert held == PersistentName("ball")


@given(st.lists(st.sampled_from((*FAULTS, "inner|ball", "ball|cage", None)), max_size=80))
def test_each_event_goes_on_from_the_one_before_and_names_another_part(faults: list[str | None]) -> None:
    found = changes([heard for fault in faults for heard in names(fault, 1, 1.0)])
    for (_, _, held), (_, before, _) in itertools.pairwise(found):
        assert before == held
    for block, before, after in found:
        assert block > PERSIST
        assert not parts_of(before) & parts_of(after)


def test_a_state_of_version_2_holds_no_name_yet() -> None:
    state = MachineState()
    for heard in names("outer", 20):
        state, _ = step(state, {"x": heard}, {"drive": ("x",)}, PERSIST)
    stored = {name: value for name, value in state.to_dict().items() if name != "held"}
    read = MachineState.from_dict(stored | {"version": 2})
    assert read == MachineState(state.voices, state.named)


def test_its_words_and_rank() -> None:
    body = {
        "kind": "fault_changed",
        "channel": "x",
        "block": 9,
        "bearing": "drive",
        "from": "outer",
        "to": "inner|ball",
    }
    text = "the verdict on drive names the inner race or rolling element now, before the outer race"
    assert event_text(body) == text
    assert badness(body) > 0
