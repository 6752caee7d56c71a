"""Blocks that no life of a library can give get no V_eq, and sound lives keep theirs."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.size import DamageInput
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.plausible import LAGS, MAX_GAP, Limits, Watch, step_score
from tests.oracles.toy_lives import INTERVAL, THRESHOLD, toy_library, toy_life
from tests.support.effort import effort_count

LIVES = effort_count(quick=8, full=200)
Change = Callable[[list[DamageInput], np.random.Generator], list[DamageInput]]


def toy_blocks(number: int) -> list[DamageInput]:
    life = toy_life(number)
    rows = zip(life.t, life.rms, life.harmonics, life.load, life.speed, strict=True)
    return [DamageInput(float(t), float(r), tuple(map(float, h)), float(n), float(f)) for t, r, h, n, f in rows]


def loud(block: DamageInput, gain: float) -> DamageInput:
    return replace(block, rms=gain * block.rms, harmonics=tuple(gain * x for x in block.harmonics or ()))


def statuses(blocks: list[DamageInput], features: str = "rms+harmonics") -> list[str]:
    state, found = LibraryState(), []
    for block in blocks:
        state, damage, _ = step(state, block, toy_library(), LibrarySettings(features=features), thresholds=[THRESHOLD])
        found.append(str(damage.status))
    return found


def gain_changes(gain: float) -> Change:
    def change(blocks: list[DamageInput], rng: np.random.Generator) -> list[DamageInput]:
        half = len(blocks) // 2
        return blocks[:half] + [loud(block, gain) for block in blocks[half:]]

    return change


def noise(blocks: list[DamageInput], rng: np.random.Generator) -> list[DamageInput]:
    middle = blocks[len(blocks) // 2]
    return [
        replace(loud(middle, float(np.exp(rng.standard_normal()))), time=b.time, load=b.load, speed=b.speed)
        for b in blocks
    ]


def lost_lines(blocks: list[DamageInput], rng: np.random.Generator) -> list[DamageInput]:
    """The RMS of a damaged bearing with the lines of a sound one, as a fault of another part gives."""
    sound = blocks[0].harmonics or ()
    return [
        replace(b, harmonics=tuple(0.2 * x * math.exp(0.05 * rng.standard_normal()) for x in sound)) for b in blocks
    ]


@pytest.mark.parametrize("features", ["rms", "rms+harmonics"])
def test_few_sound_lives_are_ever_implausible(features: str) -> None:
    ever = [("implausible" in statuses(toy_blocks(4000 + n), features)) for n in range(2 * LIVES)]
    assert np.mean(ever) <= 0.05 + 2.0 / len(ever)


@pytest.mark.parametrize(
    ("change", "features"),
    [
        (gain_changes(3.0), "rms"),
        (gain_changes(3.0), "rms+harmonics"),
        (gain_changes(0.3), "rms"),
        (gain_changes(0.01), "rms+harmonics"),
        (noise, "rms"),
        (noise, "rms+harmonics"),
        (lost_lines, "rms+harmonics"),
    ],
)
def test_what_no_damage_gives_is_refused(change: Change, features: str) -> None:
    rng, flagged = np.random.default_rng(8), 0
    for number in range(5000, 5000 + LIVES):
        found = statuses(change(toy_blocks(number), rng), features)
        flagged += not {"ok"}.issuperset(found[len(found) // 2 : len(found) // 2 + 50])
    assert flagged >= 0.85 * LIVES


def test_a_gain_that_comes_back_leaves_no_trace() -> None:
    blocks = toy_blocks(2004)
    while_away = [loud(b, 4.0) if 30 <= i < 36 else b for i, b in enumerate(blocks)]
    found, sound = statuses(while_away), statuses(blocks)
    assert Counter(found[30:36]) == {"implausible": 6}
    assert found[36:] == sound[36:]


def test_a_gap_of_the_logging_ends_with_the_gap() -> None:
    blocks = toy_blocks(2004)
    late = [b if i < 30 else replace(b, time=b.time + 20 * 3600.0) for i, b in enumerate(blocks)]
    assert statuses(late)[30:] == statuses(blocks)[30:]


def test_an_older_state_goes_on() -> None:
    blocks, state = toy_blocks(2004), LibraryState()
    for block in blocks[:20]:
        state, _, _ = step(state, block, toy_library(), thresholds=[THRESHOLD])
    stored = json.loads(json.dumps(state.to_dict()))
    del stored["watch"]
    assert LibraryState.from_dict(stored | {"version": 1}) == state


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=48), st.floats(-5, 5), st.floats(-3, 3))
def test_a_step_does_not_depend_on_the_unit(latest: list[float], level: float, shift: float) -> None:
    score = step_score(latest, level)
    moved = step_score([x + shift for x in latest], level + shift)
    assert score is not None
    assert moved == pytest.approx(score, abs=1e-9)


def test_longer_waits_allow_higher_rises_and_no_deeper_falls() -> None:
    limits = toy_library().fit_for("rms").limits
    assert isinstance(limits, Limits)
    assert list(limits.rise) == sorted(limits.rise)
    assert limits.largest_rise(0.3) == limits.rise[0]
    assert math.isinf(limits.largest_rise(LAGS[-1] + 1))
    assert not limits.holds_step(-1.01 * float(limits.fall[0]), 1000.0)


def test_refused_blocks_widen_the_limit_less_than_a_gap_does() -> None:
    watch = Watch(seen=0.0)
    for block in range(1, 100):
        watch = watch.see(block * INTERVAL, INTERVAL)
    assert watch.lag(99 * INTERVAL, INTERVAL) == MAX_GAP
    assert watch.closed == 0.0
    after = watch.see(199 * INTERVAL, INTERVAL)
    assert after.lag(199 * INTERVAL, INTERVAL) == 100.0
    assert after.closed == (100.0 - MAX_GAP) * INTERVAL
    assert after.use().lag(0.0, INTERVAL) == 0.0
