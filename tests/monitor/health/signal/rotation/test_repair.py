"""Which mark passed at which pulse, with pulses missing and too many."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.rotation.repair import Repaired, repaired
from tests.monitor.health.signal.rotation.shafts import Angle, Marks, even, hunting, marks, run_up, with_faults
from tests.support.effort import effort_count

SECONDS = 4.0
SHAFTS: dict[str, Angle] = {
    "even": even(29.3),
    "up": run_up(10.0, 40.0, SECONDS),
    "down": run_up(40.0, 10.0, SECONDS),
    "hunting": hunting(25.0, 0.2, 0.5),
}


def wrong_numbers(found: Repaired, true: Marks) -> int:
    """Return how many pulses have another number than their mark, all of them counted from one mark."""
    assert found.train is not None
    nearest = np.clip(np.searchsorted(true.times, found.train.times), 1, true.times.size - 1)
    nearest -= found.train.times - true.times[nearest - 1] < true.times[nearest] - found.train.times
    away = found.train.numbers - true.numbers[nearest]
    return int(np.count_nonzero(away != away[away.size // 2]))


@pytest.mark.parametrize("shaft", SHAFTS)
@pytest.mark.parametrize(("per_revolution", "missing_teeth"), [(1, 0), (4, 0), (60, 2), (36, 1), (256, 0)])
def test_one_in_a_hundred_missing_and_one_too_many(shaft: str, per_revolution: int, missing_teeth: int) -> None:
    true = marks(SHAFTS[shaft], SECONDS, per_revolution, missing_teeth)
    rng = np.random.default_rng(per_revolution)
    for _ in range(effort_count(quick=1, full=30)):
        times = with_faults(true.times, rng, missing=0.01, doubled=0.01, jitter=1e-6)
        found = repaired(times, SECONDS, per_revolution, missing_teeth)
        assert found.status == "ok"
        assert wrong_numbers(found, true) == 0
        assert found.train is not None
        assert found.train.indexed == (missing_teeth > 0)
        assert abs((found.missing - found.extra) - (true.times.size - times.size)) <= 2


@pytest.mark.parametrize("shaft", SHAFTS)
@pytest.mark.parametrize("per_revolution", [1, 12])
def test_pulses_without_a_fault_stay_as_they_are(shaft: str, per_revolution: int) -> None:
    true = marks(SHAFTS[shaft], SECONDS, per_revolution)
    found = repaired(true.times, SECONDS, per_revolution)
    assert found.train is not None
    assert (found.missing, found.extra) == (0, 0)
    assert np.array_equal(found.train.times, true.times)
    assert np.array_equal(found.train.numbers - found.train.numbers[0], true.numbers - true.numbers[0])


@given(lost=st.integers(1, 115), shaft=st.sampled_from(list(SHAFTS)))
@settings(max_examples=effort_count(quick=15, full=400))
def test_any_single_pulse_may_be_lost(lost: int, shaft: str) -> None:
    true = marks(SHAFTS[shaft], SECONDS, 1)
    lost = min(lost, true.times.size - 2)
    found = repaired(np.delete(true.times, lost), SECONDS, 1)
    assert (found.status, found.missing, found.extra) == ("ok", 1, 0)
    assert wrong_numbers(found, true) == 0


@given(after=st.floats(0.5, 3.5), shaft=st.sampled_from(list(SHAFTS)))
@settings(max_examples=effort_count(quick=15, full=400))
def test_any_single_pulse_may_be_added(after: float, shaft: str) -> None:
    true = marks(SHAFTS[shaft], SECONDS, 1)
    found = repaired(np.sort(np.append(true.times, after)), SECONDS, 1)
    assert found.status == "ok"
    assert found.extra - found.missing == 1 or np.any(true.times == after)
    assert wrong_numbers(found, true) == 0


def test_a_bounce_leaves_the_first_edge() -> None:
    true = marks(even(20.0), SECONDS, 1)
    found = repaired(np.sort(np.concatenate((true.times, true.times[10:20] + 1e-3))), SECONDS, 1)
    assert found.train is not None
    assert np.array_equal(found.train.times, true.times)
    assert (found.missing, found.extra) == (0, 10)


def test_the_marks_are_counted_from_the_first_tooth_after_the_gap() -> None:
    true = marks(SHAFTS["up"], SECONDS, 60, 2)
    found = repaired(true.times[17:] - true.times[17], SECONDS - true.times[17], 60, 2)
    assert found.train is not None
    assert np.array_equal(found.train.numbers % 60, true.numbers[17:] % 60)
    assert (found.missing, found.extra) == (0, 0)


def test_what_is_refused() -> None:
    rng = np.random.default_rng(5)
    true = marks(even(30.0), SECONDS, 1).times
    assert repaired(true[:3], SECONDS, 1).status == "too_few"
    assert repaired(np.zeros(0), SECONDS, 1).status == "too_few"
    assert repaired(np.sort(rng.uniform(0.0, SECONDS, 100)), SECONDS, 1).status == "irregular"
    assert repaired(true[:60], SECONDS, 1).status == "stopped"
    assert repaired(true[60:], SECONDS, 1).status == "stopped"
    assert repaired(with_faults(true, rng, missing=0.15), SECONDS, 1).status == "irregular"
    assert repaired(with_faults(true, rng, doubled=0.2), SECONDS, 1).status == "irregular"
    wheel = marks(even(30.0), SECONDS, 60).times
    assert repaired(wheel, SECONDS, 60, 2).status == "irregular"


def test_a_stop_within_the_block_is_no_gap_to_be_filled() -> None:
    true = marks(even(30.0), SECONDS, 1).times
    halted = np.concatenate((true[true < 1.5], true[true >= 1.5] + 0.517))
    assert repaired(halted[halted < SECONDS], SECONDS, 1).status == "irregular"


def test_a_dense_encoder_with_much_jitter_is_counted() -> None:
    true, rng = marks(SHAFTS["hunting"], SECONDS, 1024), np.random.default_rng(1)
    times = with_faults(true.times, rng, jitter=1e-5)
    found = repaired(times, SECONDS, 1024)
    assert found.train is not None
    assert (found.status, found.missing, found.extra) == ("ok", 0, 0)
    assert found.train.numbers[-1] == true.numbers[-1]
    faulty = with_faults(true.times, rng, missing=0.002, doubled=0.002, jitter=1e-5)
    assert repaired(faulty, SECONDS, 1024).status == "irregular"
