"""The error of an encoder: learned, turned to its place, and withheld where it is not that of the wheel."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.rotation.encoder import (
    LEARNING_TURNS,
    MIN_BLOCKS,
    MIN_REPEATED,
    EncoderReading,
    EncoderState,
    encoder_step,
    pattern_of,
)
from monitor.health.signal.rotation.intervals import PulseTrain, intervals
from tests.monitor.health.signal.rotation.wheels import MARKS, Floats, eccentric, thinned, wheel

TURNS = 200
ERROR = eccentric(0.1)


def learned(make: Callable[[int], PulseTrain], blocks: int = 6) -> tuple[EncoderState, EncoderReading]:
    state, reading = EncoderState(), EncoderReading("learning")
    for block in range(blocks):
        state, reading = encoder_step(state, make(block))
    return state, reading


def anywhere(block: int, error: Floats | None = ERROR, jitter: float = 1e-6) -> PulseTrain:
    """Return a block that begins at another mark than the others."""
    return wheel(TURNS, error=error, start=37 * block, jitter=jitter, seed=block)


STATE, READING = learned(anywhere)


def test_the_error_is_learned_without_an_index() -> None:
    assert READING.status == "ok"
    assert READING.error is not None
    assert READING.rms is not None
    assert READING.rms_error is not None
    assert READING.rms == pytest.approx(float(np.std(ERROR)), rel=0.01)
    apart = READING.error - np.roll(ERROR, -37 * 5)
    assert float(np.std(apart)) < 3.0 * READING.rms_error
    assert READING.turns == LEARNING_TURNS


def test_it_is_not_used_before_it_is_frozen_and_does_not_change_then() -> None:
    state = EncoderState()
    for block in range(LEARNING_TURNS // TURNS - 1):
        state, reading = encoder_step(state, anywhere(block))
        assert (reading.status, reading.error) == ("learning", None)
    assert not state.frozen
    assert state.blocks >= MIN_BLOCKS
    frozen, reading = encoder_step(state, anywhere(9))
    assert frozen.frozen
    assert encoder_step(frozen, anywhere(10))[1].status == "ok"
    assert encoder_step(frozen, anywhere(10, error=eccentric(0.3)))[0] is frozen


def test_an_index_keeps_the_marks_in_their_places() -> None:
    def indexed(block: int) -> PulseTrain:
        train = anywhere(block)
        return PulseTrain(train.times, train.numbers + 37 * block, MARKS, indexed=True)

    state, reading = learned(indexed)
    assert state.indexed
    assert reading.status == "ok"
    assert reading.error is not None
    assert float(np.std(reading.error - ERROR)) < 3.0 * (reading.rms_error or 0.0)
    # With an index, marks elsewhere are not this wheel's: nothing is turned.
    moved = PulseTrain(anywhere(0).times, anywhere(0).numbers + MARKS // 2, MARKS, indexed=True)
    assert encoder_step(state, moved)[1].status == "not_aligned"


@given(start=st.integers(0, MARKS - 1), harmonic=st.integers(1, 20))
@settings(max_examples=6)
def test_one_harmonic_is_found_at_any_beginning(start: int, harmonic: int) -> None:
    angle = 2.0 * np.pi * np.arange(MARKS) / MARKS
    error = 1e-4 * np.sin(harmonic * angle)
    found = pattern_of(intervals(wheel(64, error=error, start=start)))
    np.testing.assert_allclose(found.error, np.roll(error, -start), atol=2e-7)


def test_what_is_not_a_multiple_of_the_shaft_falls_out() -> None:
    train = wheel(TURNS, error=ERROR, lines=[(4.63, 3e-3, 0.0), (0.42, 1e-3, 0.0)], jitter=1e-7)
    found = pattern_of(intervals(train))
    assert float(np.std(found.error - ERROR)) < found.rms_error < 0.1 * found.rms


def test_a_run_up_and_missing_pulses_leave_the_error() -> None:
    for train in (wheel(TURNS, speed=10.0, slope=4.0, error=ERROR), thinned(anywhere(0), 0.01)):
        found = pattern_of(intervals(train))
        assert float(np.std(found.error - ERROR)) < 0.03 * found.rms


def test_jitter_alone_is_no_error_of_the_marks() -> None:
    state, reading = learned(lambda block: anywhere(block, error=None))
    assert state.frozen
    assert (reading.status, reading.error) == ("not_repeatable", None)
    assert state.pattern is not None
    assert state.pattern.rms < MIN_REPEATED * state.pattern.rms_error


def test_a_wrong_number_of_marks_is_not_repeatable() -> None:
    """Stated are 250 marks a turn, the wheel has 256: the pattern smears over the turns."""

    def misread(block: int) -> PulseTrain:
        train = anywhere(block)
        return PulseTrain(train.times, train.numbers, 250)

    reading = learned(misread, 8)[1]
    assert reading.error is None
    assert reading.status in ("slipped", "not_repeatable", "learning")


def test_uneven_tapes_on_a_shaft_are_learned() -> None:
    tapes = np.array([0.012, -0.004, -0.011, 0.003])
    _, reading = learned(lambda block: wheel(TURNS, marks=4, error=tapes, start=block, jitter=1e-6, seed=block))
    assert reading.status == "ok"
    assert reading.error is not None
    np.testing.assert_allclose(reading.error, np.roll(tapes, -5), atol=1e-5)


def test_jitter_of_a_third_of_the_pitch_hides_no_error() -> None:
    error = eccentric(0.1, 1024)

    def rough(block: int) -> PulseTrain:
        train = wheel(64, marks=1024, speed=25.0, error=error, start=37 * block, seed=block)
        late = 1e-5 * np.random.default_rng(block).uniform(-1.0, 1.0, train.times.size)
        return PulseTrain(np.sort(train.times + late), train.numbers, 1024)

    reading = learned(rough, 17)[1]
    assert reading.status == "ok"
    assert reading.error is not None
    angle = 2.0 * np.pi * np.arange(1024) / 1024
    first = 2.0 * np.abs(np.mean(reading.error * np.exp(-1j * angle)))
    assert first == pytest.approx(np.sqrt(2.0) * 0.1 / 360.0, rel=0.02)


def test_another_wheel_is_refused() -> None:
    state, reading = encoder_step(STATE, wheel(TURNS, marks=128))
    assert (reading.status, reading.error, state.blocks) == ("other_wheel", None, 1)
    assert encoder_step(STATE, wheel(TURNS, marks=128), learn=False)[0] is STATE
    three = 1e-4 * np.cos(6.0 * np.pi * np.arange(MARKS) / MARKS)
    reading = encoder_step(STATE, anywhere(0, error=three))[1]
    assert (reading.status, reading.error) == ("not_aligned", None)
    assert encoder_step(STATE, anywhere(0, error=None))[1].status == "not_aligned"


def test_a_line_next_to_the_shaft_is_refused_while_it_drifts() -> None:
    """0.004 turns a turn beside three times the shaft: the pattern wanders through the block."""
    reading = learned(lambda block: wheel(TURNS, lines=[(3.004, 1e-2, block)], jitter=1e-7), 8)[1]
    assert (reading.status, reading.error) == ("slipped", None)


def recounted(train: PulseTrain, at: int, more: int) -> PulseTrain:
    """Return a train whose marks are counted wrongly from a turn on: so many are missing and the time is not."""
    kept = np.delete(train.times, slice(at * MARKS, at * MARKS + more))
    kept[at * MARKS :] -= more / (40.0 * MARKS)
    return PulseTrain(kept, np.arange(kept.size, dtype=np.int64), MARKS)


@pytest.mark.parametrize("lost", [24, 64, 128])
@pytest.mark.parametrize("turn", [40, 60, 100])
def test_a_count_that_slips_within_a_block_is_refused(lost: int, turn: int) -> None:
    reading = encoder_step(STATE, recounted(anywhere(3), turn, lost))[1]
    assert reading.error is None
    assert reading.status in ("slipped", "not_aligned")


def test_a_pulse_that_was_not_counted_is_refused() -> None:
    train = anywhere(3)
    numbers = np.arange(train.times.size, dtype=np.int64)
    for times in (np.delete(train.times, 70 * MARKS), np.insert(train.times, 9, train.times[8:10].mean())):
        reading = encoder_step(STATE, PulseTrain(times, np.arange(times.size, dtype=np.int64), MARKS))[1]
        assert (reading.status, reading.error) == ("irregular", None)
    assert encoder_step(STATE, PulseTrain(train.times, numbers, MARKS))[1].status == "ok"


def test_learning_begins_anew_where_two_patterns_differ() -> None:
    other = eccentric(0.1, seed=5) + 1e-3 * np.cos(6.0 * np.pi * np.arange(MARKS) / MARKS)
    state, _ = learned(lambda block: anywhere(block, error=other), 2)
    state, reading = encoder_step(state, anywhere(2))
    assert reading.status == "not_aligned"
    assert state.blocks == 1
    for block in range(3, 8):
        state, reading = encoder_step(state, anywhere(block))
    assert reading.status == "ok"
    assert reading.rms == pytest.approx(float(np.std(ERROR)), rel=0.01)


def test_too_few_turns_and_blocks_out_of_order_are_not_learned() -> None:
    state, reading = encoder_step(EncoderState(), wheel(8))
    assert (state.pattern, reading.status) == (None, "too_few")
    state, reading = encoder_step(EncoderState(), anywhere(0), learn=False)
    assert (state.pattern, reading.status) == (None, "learning")


def test_a_step_leaves_state_and_pulses_as_they_are() -> None:
    train, before = anywhere(1), STATE.to_dict()
    assert STATE.pattern is not None
    for array in (train.times, train.numbers, STATE.pattern.error):
        array.flags.writeable = False
    first, second = (encoder_step(STATE, train)[1] for _ in range(2))
    assert STATE.to_dict() == before
    assert np.array_equal(first.error, second.error)  # type: ignore[arg-type]


def test_a_restarted_monitor_goes_on_with_the_same_digits() -> None:
    live = stored = EncoderState()
    for block in range(6):
        stored = EncoderState.from_dict(json.loads(json.dumps(stored.to_dict())))
        live, first = encoder_step(live, anywhere(block))
        stored, second = encoder_step(stored, anywhere(block))
        assert first.status == second.status
        assert live.to_dict() == stored.to_dict()
        assert (first.error is None) == (second.error is None)
        assert first.error is None or np.array_equal(first.error, second.error)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="version 1 expected, got 9"):
        EncoderState.from_dict({"version": 9})
