"""Times of the pulses in a channel: a threshold that follows the signal, a counter, the direction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from streams.turns.tacho import directions, edge_times
from tests.support.effort import effort_count

RATE, SECONDS, SPEED = 8000.0, 4.0, 21.7
TIME: NDArray[np.float64] = np.arange(round(RATE * SECONDS)) / RATE
TURNS = SPEED * TIME + 0.3
TRUE = (np.arange(1, int(TURNS[-1]) + 1) - 0.3) / SPEED
"""When the shaft passes whole turns."""


def keyphasor(share: float = 0.05) -> NDArray[np.float64]:
    """Pulses of some share of a turn that begin at whole turns, with edges of two samples."""
    passed = (TURNS % 1.0) / (SPEED / RATE)
    return np.clip(0.5 + 0.5 * passed, 0.0, 1.0) * (share > TURNS % 1.0)


def pick_up() -> NDArray[np.float64]:
    return np.sin(2.0 * np.pi * TURNS)


def error(found: NDArray[np.float64], true: NDArray[Any] = TRUE) -> float:
    """Return the largest error of the times, samples; of as many pulses as there are, but for one at each end."""
    assert abs(found.size - true.size) <= 1
    nearest = true[np.argmin(np.abs(found[:, np.newaxis] - true), axis=1)]
    assert np.unique(nearest).size == found.size
    return float(np.max(np.abs(found - nearest))) * RATE


def test_a_sine_is_met_between_the_samples() -> None:
    assert error(edge_times(pick_up(), RATE)) < 1e-3


def test_the_falling_edge_of_a_sine_is_half_a_turn_later() -> None:
    found = edge_times(pick_up(), RATE, falling=True)
    assert error(found, (np.arange(int(TURNS[-1]) + 1) + 0.2) / SPEED) < 1e-3


def test_digital_pulses_are_met_within_half_a_sample() -> None:
    assert error(edge_times((TURNS % 1.0 < 0.5).astype(np.float32), RATE)) <= 0.51


@pytest.mark.parametrize("share", [0.005, 0.02, 0.3, 0.9])
def test_narrow_and_wide_pulses(share: float) -> None:
    assert error(edge_times((share > TURNS % 1.0) * 1.0, RATE)) <= 0.51


def test_noise_near_the_threshold_makes_no_pulses() -> None:
    noise = 0.05 * np.random.default_rng(0).standard_normal(TIME.size)
    slow = np.sin(2.0 * np.pi * TURNS / 10.0)
    true = (np.arange(1, int(TURNS[-1] / 10.0) + 1) * 10.0 - 0.3) / SPEED
    assert error(edge_times(slow + noise, RATE), true) < 30.0
    bare = np.count_nonzero(np.diff((slow + noise > 0.0).astype(int)) > 0)
    assert bare > 5 * true.size


def test_a_drifting_offset_is_followed() -> None:
    drift = np.sin(2.0 * np.pi * TIME / SECONDS) + 0.5 * TIME
    assert error(edge_times(keyphasor() + drift, RATE)) < 1.5
    turn = RATE / SPEED
    assert error(edge_times(pick_up() + drift, RATE)) < 0.03 * turn
    assert error(edge_times(pick_up() + 0.1 * drift, RATE)) < 0.02 * turn


def test_an_amplitude_that_grows_with_the_speed_is_followed() -> None:
    turns = 2.0 * TIME + 6.0 * np.square(TIME)
    samples = (2.0 + 12.0 * TIME) * np.sin(2.0 * np.pi * turns)
    assert edge_times(samples, RATE).size == int(turns[-1])


def test_a_spike_moves_no_threshold() -> None:
    samples = keyphasor()
    samples[20011] = 40.0
    found = edge_times(samples, RATE)
    assert abs(found.size - TRUE.size) <= 1


@given(offset=st.floats(-1e4, 1e4), scale=st.floats(1e-3, 1e3))
@settings(max_examples=effort_count(quick=10, full=300))
def test_offset_and_scale_of_the_channel_change_nothing(offset: float, scale: float) -> None:
    found = edge_times(pick_up() * scale + offset, RATE)
    assert error(found) < 1e-3 + 1e-9 * abs(offset) / scale


@given(shift=st.integers(1, 4000))
@settings(max_examples=effort_count(quick=10, full=100))
def test_a_later_beginning_shifts_the_times(shift: int) -> None:
    found, later = edge_times(pick_up(), RATE), edge_times(pick_up()[shift:], RATE) + shift / RATE
    assert np.allclose(found[-later.size + 1 :], later[1:], rtol=0.0, atol=1e-9)


def test_a_threshold_that_is_given_is_taken() -> None:
    found = edge_times(pick_up(), RATE, 0.5)
    assert error(found, TRUE + 1.0 / 12.0 / SPEED) < 5e-2
    assert edge_times(pick_up(), RATE, 1.5).size == 0


@pytest.mark.parametrize("marks", [1, 20, 900])
@pytest.mark.parametrize("bits", [None, 16])
def test_a_counter(marks: int, bits: int | None) -> None:
    count = np.floor(TURNS * marks) + (60000.0 if bits else 0.0)
    count = count if bits is None else count % 2**bits
    found = edge_times(count, RATE)
    assert found.size == int(TURNS[-1] * marks) - int(0.3 * marks)
    assert np.all(np.diff(found) > 0.0)
    passed = (np.arange(int(0.3 * marks) + 1, int(TURNS[-1] * marks) + 1) / marks - 0.3) / SPEED
    assert float(np.max(np.abs(found - passed))) * RATE < 1.0
    assert np.array_equal(edge_times(-count if bits is None else count, RATE), found)


@pytest.mark.parametrize("samples", [np.zeros(100), np.full(100, np.nan), np.zeros(0), np.ones(1), [0.0, 1.0] * 2])
def test_rows_without_pulses(samples: object) -> None:
    assert edge_times(np.asarray(samples, dtype=np.float64), RATE).size <= 2


def test_a_second_track_tells_the_direction() -> None:
    turns = 8.0 * np.sin(2.0 * np.pi * TIME / SECONDS)
    first, second = (turns * 16 % 1.0 < 0.5) * 1.0, ((turns * 16 - 0.25) % 1.0 < 0.5) * 1.0
    times = edge_times(first, RATE)
    other = directions(times, second, RATE)
    back = np.abs(times - 0.5 * SECONDS) < 0.25 * SECONDS
    assert np.mean(other == back) > 0.98 or np.mean(other != back) > 0.98
    steady = (TURNS * 16 % 1.0 < 0.5) * 1.0, ((TURNS * 16 + 0.25) % 1.0 < 0.5) * 1.0
    assert not np.any(directions(edge_times(steady[0], RATE), steady[1], RATE))
