"""Which wheel is named, when, and when not."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from monitor.health.gears.naming import (
    MIN_LEARNED,
    GearsInput,
    GearsOutput,
    GearsState,
    Learned,
    WheelReading,
    step,
)
from monitor.health.gears.settings import GearSettings
from tests.monitor.health.gears.signals import pair
from tests.support.effort import effort_count
from tests.support.naming import PAIR, RULES, blocks


def run(
    state: GearsState, given: Iterator[GearsInput], count: int, gears: GearSettings = PAIR
) -> tuple[GearsState, list[GearsOutput]]:
    """Return the state after some blocks, and what each gave; stored and read again after each."""
    outputs: list[GearsOutput] = []
    for _ in range(count):
        state, output = step(state, next(given), gears, RULES)
        state = GearsState.from_dict(json.loads(json.dumps(state.to_dict())))
        outputs.append(output)
    return state, outputs


def learned() -> GearsState:
    """Return the state after the blocks that are learned."""
    return run(GearsState(), blocks(1), MIN_LEARNED)[0]


@pytest.mark.parametrize(
    ("wheel", "factors", "kind"),
    [
        ("pinion", {"fm4": 3.0, "m6a": 9.0, "residual": 1.5}, "tooth"),
        ("wheel", {"residual": 9.0, "fm4": 1.3}, "tooth"),
        ("wheel", {"sideband": 20.0, "residual": 1.2}, "eccentric"),
    ],
)
def test_the_damaged_wheel_is_named_once_it_persists(wheel: str, factors: dict[str, float], kind: str) -> None:
    state, outputs = run(learned(), blocks(2, 0.05, **{wheel: factors}), 4)
    assert [output.fault for output in outputs] == [None, None, f"gear:{wheel}", f"gear:{wheel}"]
    assert [output.changed for output in outputs] == [False, False, True, False]
    assert outputs[-1].kind == kind
    state, outputs = run(state, blocks(3), RULES.close_blocks)
    assert (outputs[-2].named, outputs[-1].named, outputs[-1].replaced) == (wheel, None, wheel)


def test_another_wheel_takes_the_name() -> None:
    state, _ = run(learned(), blocks(2, pinion={"fm4": 3.0}), 3)
    state, outputs = run(state, blocks(4, wheel={"fm4": 3.0}), 3)
    assert [output.named for output in outputs] == ["pinion", "pinion", "wheel"]
    assert outputs[-1].replaced == "pinion"


def test_nothing_is_named_while_learning_or_of_one_block() -> None:
    _, outputs = run(GearsState(), blocks(2, pinion={"fm4": 30.0}), MIN_LEARNED)
    assert {one.status for output in outputs for one in output.wheels.values()} == {"learning"}
    assert not any(output.scores or output.named for output in outputs)
    state, outputs = run(learned(), blocks(2, pinion={"fm4": 3.0}), 2)
    _, more = run(state, blocks(3), 5)
    assert not any(output.named for output in [*outputs, *more])


def test_a_rise_of_all_wheels_is_that_of_the_machine() -> None:
    both = {"residual": 9.0, "sideband": 20.0}
    _, outputs = run(learned(), blocks(5, pinion=both, wheel=both), 10)
    assert not any(output.named for output in outputs)
    assert max(max(output.scores.values()) for output in outputs) < 1.0


def test_nothing_is_judged_beyond_the_learned_conditions_or_without_an_average() -> None:
    state = learned()
    given = blocks(6, pinion={"fm4": 5.0})
    faster = (replace(next(given), speed=40.0) for _ in range(10))
    _, outputs = run(state, faster, 5)
    assert {one.status for output in outputs for one in output.wheels.values()} == {"outside_conditions"}
    heavier = (replace(next(given), load=200.0) for _ in range(10))
    assert not any(output.named for output in run(state, heavier, 5)[1])
    none = (GearsInput(n, {"pinion": WheelReading("no_angle"), "wheel": WheelReading("too_short")}) for n in range(9))
    after, outputs = run(state, none, 5)
    assert after == state
    assert outputs[0].wheels["pinion"].status == "no_angle"
    assert not outputs[0].scores


def test_a_wheel_that_turns_a_whole_number_of_times_gives_way_to_the_slower_one() -> None:
    gears = pair(20, 40)
    state, _ = run(GearsState(), blocks(1), MIN_LEARNED, gears)
    both, alone = {"fm4": 3.0}, {"fm4": 3.2}
    _, outputs = run(state, blocks(2, pinion=alone, wheel=both), 4, gears)
    assert outputs[-1].named == "wheel"
    _, outputs = run(state, blocks(2, pinion=alone), 4, gears)
    assert outputs[-1].named == "pinion"


def test_other_gears_are_learned_anew_and_an_unknown_version_is_refused() -> None:
    state, outputs = run(learned(), blocks(2), 1, pair(24, 71))
    assert outputs[0].wheels["pinion"].status == "learning"
    assert state.learned["pinion"].count == 1
    with pytest.raises(ValueError, match="version 1 expected, got 7"):
        GearsState.from_dict({**state.to_dict(), "version": 7})


def test_na4_is_relative_to_the_blocks_so_far_and_then_to_what_was_learned() -> None:
    first = run(GearsState(), blocks(8), 1)[1][0]
    indicators = first.wheels["pinion"].indicators
    assert indicators is not None
    assert first.na4["pinion"] == pytest.approx(indicators.unlike)
    _, outputs = run(learned(), blocks(8, pinion={"variance": 10.0}), 1)
    assert outputs[0].na4["pinion"] == pytest.approx(300.0, rel=0.6)


def test_what_is_learned_is_mean_and_spread() -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(size=(50, 4))
    known = Learned()
    for row in values:
        known = known.after(row.tolist(), 2.0)
    np.testing.assert_allclose(known.mean, values.mean(axis=0))
    np.testing.assert_allclose(np.array(known.squares) / 49, values.var(axis=0, ddof=1))
    assert known.excess(0, 0.0) == 0.0
    assert known.excess(0, 3.0) == -known.excess(0, -3.0) > 2.0


def test_healthy_values_exceed_the_threshold_at_most_as_stated() -> None:
    count = effort_count(quick=500, full=20000)
    state, given = run(GearsState(), blocks(1, 1.0), MIN_LEARNED)[0], blocks(11, 1.0)
    scores = [max(step(state, next(given), PAIR, RULES)[1].scores.values()) for _ in range(count)]
    assert sum(score > 1.0 for score in scores) <= 1 + count // 1000
    assert max(scores) > 0.0
