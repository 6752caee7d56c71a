"""One recording of pulses: repaired, studied, or refused with the reason."""

from __future__ import annotations

import numpy as np
import pytest

from monitor.health.signal.rotation.ias import study
from monitor.health.signal.rotation.rotation import TachoSettings
from tests.monitor.health.signal.rotation.wheels import MARKS, eccentric, wheel

LINES = [(k * 4.63, 1e-4 * k, float(k)) for k in range(1, 6)]
WHEEL = TachoSettings(per_revolution=MARKS)
TRAIN = wheel(100, lines=LINES, error=eccentric(0.05), jitter=1e-8)


def test_pulses_that_are_missing_or_too_many_are_counted() -> None:
    times = np.delete(TRAIN.times, [700, 9000, 20000])
    times = np.sort(np.append(times, TRAIN.times[5000] + 3e-5))
    found = study(times + 12.5, WHEEL)
    assert (found.missing, found.extra) == (3, 1)
    assert found.lines({"outer": 4.6})["outer"].detected
    assert found.wheel.rms * 360.0 == pytest.approx(0.05, rel=0.02)
    assert not found.removed


def test_what_repeats_each_turn_is_taken_out_where_asked() -> None:
    plain, without = study(TRAIN.times, WHEEL), study(TRAIN.times, WHEEL, remove_wheel=True)
    assert without.removed
    at = without.spectrum.turns
    assert without.spectrum.amplitude[at] < 0.01 * plain.spectrum.amplitude[at]
    line = round(4.63 / plain.spectrum.resolution)
    assert without.spectrum.amplitude[line] == pytest.approx(plain.spectrum.amplitude[line], rel=1e-3)


def test_nothing_is_taken_out_where_nothing_repeats() -> None:
    assert not study(wheel(100, jitter=1e-6).times, WHEEL, remove_wheel=True).removed


def test_a_wheel_with_a_gap_is_counted_from_it() -> None:
    train = wheel(60, marks=60, lines=[(1.5, 1e-3, 0.0)], start=0)
    teeth = train.numbers % 60 < 58
    found = study(train.times[teeth], TachoSettings(per_revolution=60, missing_teeth=2))
    assert found.train.indexed
    assert found.missing == 0
    spectrum = found.spectrum
    assert spectrum.amplitude[round(1.5 / spectrum.resolution)] == pytest.approx(2 * np.pi * 40.0 * 1e-3, rel=0.05)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.zeros(1), "1 pulses"),
        (np.sort(np.random.default_rng(0).uniform(0.0, 1.0, 5000)), "do not follow one speed"),
        (wheel(3).times, "got 256 marks over 3"),
    ],
    ids=["one", "at random", "three turns"],
)
def test_pulses_without_a_speed_are_refused(times: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        study(times, WHEEL)
