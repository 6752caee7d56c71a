"""Over time the length follows the asked error, and a status says whether it is met."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.scene import Defect, Scene, Slip
from models.machine.speed_profile import ramp
from models.solve.engine.averages import amplitudes_at, levels_of, mean_error
from models.solve.engine.motion import Motion, Planned
from models.solve.engine.over_time import MOST_SECONDS, answer, expected_seconds
from models.solve.response import Response
from models.solve.simulate import simulate
from models.words.request import USUAL_SECONDS, Request
from reference.signals import record_of
from tests.support.effort import effort_count

Values = NDArray[np.float64]
Kind = Callable[[np.random.Generator], tuple[Motion, float]]

BALL = Scene(40.0, 4000.0, defect=Defect(math.radians(8.0), 5e-4, part="ball"))
SLIPPING = Scene(40.0, 4000.0, defect=Defect(math.radians(4.0), 5e-4), slip=Slip(0.01))
RATE, CARRIER, UPDATE = 2000.0, 170.0, 200.0
"""Sampling rate, and rates of a carrier and of the steps of its amplitude, Hz."""
BLOCK = 0.02


def autoregressive(rng: np.random.Generator, rho: float, count: int) -> Values:
    """Return a series of variance one whose neighbours have the correlation rho, (count,)."""
    noise = rng.standard_normal(count) * math.sqrt(1.0 - rho * rho)
    found = np.empty(count)
    found[0] = rng.standard_normal()
    for k in range(1, count):
        found[k] = rho * found[k - 1] + noise[k]
    return found


def seconds_of(found: Response) -> float:
    assert found.record is not None
    return found.record.signal.shape[1] / found.record.rate


def noisy(rng: np.random.Generator) -> tuple[Motion, float]:
    """Return a carrier whose amplitude is an AR(1) series about one, and the mean square of all time."""
    scatter, memory = rng.uniform(0.1, 0.4), math.exp(rng.uniform(math.log(0.2), math.log(3.0))) * BLOCK
    count = math.ceil(2.0 * MOST_SECONDS * UPDATE)
    amplitude = 1.0 + scatter * autoregressive(rng, math.exp(-1.0 / (UPDATE * memory)), count)
    return moving(lambda t: amplitude[(t * UPDATE).astype(np.int64)]), 0.5 * (1.0 + scatter**2)


def modulated(rng: np.random.Generator) -> tuple[Motion, float]:
    """Return a carrier with two modulations that have no common period with a block, and the mean square."""
    depth = rng.uniform(0.1, 0.5, 2)
    rate = np.exp(rng.uniform(math.log(0.1), math.log(2.0), 2)) / BLOCK
    phase = rng.uniform(0.0, 2.0 * math.pi, 2)

    def amplitude(t: Values) -> Values:
        return 1.0 + np.sum(depth * np.sin(2.0 * math.pi * np.outer(t, rate) + phase), axis=1)

    return moving(amplitude), 0.5 * (1.0 + 0.5 * float(np.sum(depth**2)))


def moving(amplitude: Callable[[Values], Values]) -> Motion:
    """Return a motion of one sensor: a carrier times an amplitude, a function of the time."""

    def from_rest(steps: int, oversampling: int) -> tuple[Values, bool]:
        t = np.arange(steps) / (RATE * oversampling)
        return (amplitude(t) * np.sin(2.0 * math.pi * CARRIER * t))[:, None], True

    return Motion(from_rest, ("mo",), "none", "none", bpfo=CARRIER, block=BLOCK, settle=0.05, repeats=False)


def test_the_errors_of_lines_cover_noise_and_lines_beside_them() -> None:
    """Three lines of a signal in noise that has a memory, with another line a few over the length away from one."""
    rng, covered, over = np.random.default_rng(5), [], []
    t = np.arange(4000) / 1000.0
    for _ in range(effort_count(quick=100, full=1000)):
        phase, size = rng.uniform(0.0, 2.0 * math.pi, 4), np.array([1.0, 0.1, 10.0 ** rng.uniform(-3.0, 0.0), 1.0])
        rates = [20.3, 40.6, 60.9, 60.9 + rng.uniform(3.5, 6.0) / 4.0]
        lines = [a * np.cos(2.0 * math.pi * f * t + p) for a, f, p in zip(size, rates, phase, strict=True)]
        signal = np.sum(lines, axis=0) + rng.uniform(0.01, 0.5) * autoregressive(rng, 0.8, len(t))
        found, errors = amplitudes_at(signal, 20.3 / 1000.0, 3)
        covered += list(np.abs(found - size[:3]) <= errors)
        over += list(errors / np.maximum(np.abs(found - size[:3]), 1e-9))
    assert np.mean(covered) >= 0.93
    assert np.median(over) <= 10.0


def test_a_signal_too_short_for_lines_has_none() -> None:
    assert np.all(np.isnan(amplitudes_at(np.ones(5), 0.1, 3)))


def test_lines_over_time_have_errors() -> None:
    short, long = (simulate(BALL, quantity="lines", accuracy=0.3, duration=seconds) for seconds in (0.5, 4.0))
    ours = amplitudes_at(record_of(short).of(), short.bpfo / record_of(short).rate, 6)[0]
    assert ours == pytest.approx(short.harmonics, rel=1e-2, abs=1e-2 * short.rms)
    assert np.all(np.abs(short.harmonics - long.harmonics) <= short.harmonics_error + long.harmonics_error)
    assert np.max(long.harmonics_error) < np.max(short.harmonics_error)
    assert long.lines_error < short.lines_error
    assert (long.status, short.status) == (
        "not_periodic" if long.lines_error <= 0.3 else "inaccurate",
        "not_periodic" if short.lines_error <= 0.3 else "inaccurate",
    )


@pytest.mark.parametrize("kind", [noisy, modulated])
def test_the_stated_error_covers_the_true_one_where_it_decided_the_length(kind: Kind) -> None:
    """100 stationary signals of known mean power, whose runs ended because their own error was small enough."""
    count, covered, lengths = effort_count(quick=100, full=1000), [], []
    for seed in range(count):
        rng = np.random.default_rng((40, seed))
        motion, power = kind(rng)
        request = Request(accuracy=math.exp(rng.uniform(math.log(0.03), math.log(0.2))), rate=RATE)
        found = answer(motion, request, 1.0 / (2.0 * RATE))
        assert found.rms_error == pytest.approx(found.averaging_error, abs=1e-3)
        covered.append((abs(found.rms / math.sqrt(power) - 1.0) <= found.rms_error, found.status == "not_periodic"))
        lengths.append(seconds_of(found))
        if found.status == "inaccurate":
            assert lengths[-1] == MOST_SECONDS
    within, met = np.array(covered).T
    assert np.mean(within) >= 0.9
    assert np.mean(within[met]) >= 0.88
    # Most ended before the limit, at unlike lengths.
    assert np.mean(met) >= 0.5
    assert min(lengths) < 0.1 * MOST_SECONDS < np.max(lengths)


@pytest.mark.parametrize("rho", [0.0, 0.6])
@pytest.mark.parametrize("count", [16, 40, 200])
def test_the_bound_of_a_mean_covers_it(rho: float, count: int) -> None:
    rng = np.random.default_rng((41, count, round(10 * rho)))
    series = [autoregressive(rng, rho, count) for _ in range(effort_count(quick=400, full=4000))]
    bounds = np.array([mean_error(one).bound for one in series])
    off = np.abs([float(np.mean(one)) for one in series])
    assert np.mean(off <= bounds) >= 0.88
    # Nor is it stated large: four times the scatter of the means would cover anything.
    assert np.median(bounds) < 5.0 * np.sqrt(np.mean(off**2))


def test_alike_values_are_worth_less_than_independent_ones() -> None:
    rng = np.random.default_rng(42)
    found = [np.median([mean_error(autoregressive(rng, rho, 16)).standard for _ in range(200)]) for rho in (0.0, 0.8)]
    assert found[0] == pytest.approx(0.25, rel=0.3)
    assert found[1] > 1.8 * found[0]
    assert mean_error(np.ones(9)) == (0.0, 0.0)


def test_a_level_that_swings_regularly_is_known_better_than_its_scatter_says() -> None:
    """The mean over so many swings is off by a part of one of them."""
    t = np.arange(200 * 100) / 100.0
    signal = np.sqrt(1.0 + 0.5 * np.sin(2.0 * math.pi * 0.382 * t))
    found = levels_of(signal, 200.0)
    assert abs(found.rms - 1.0) <= found.bound < 0.3 * found.scatter
    assert not found.same(repeats=True)


def test_a_missed_accuracy_is_said_over_time() -> None:
    met, missed = (simulate(BALL, accuracy=accuracy, duration=0.3) for accuracy in (0.2, 1e-5))
    assert (met.status, missed.status) == ("not_periodic", "inaccurate")
    assert met.error <= 0.2
    assert missed.error > 1e-5
    assert not missed.repeats
    assert seconds_of(met) == seconds_of(missed) == pytest.approx(0.3)


def test_the_length_follows_the_accuracy_and_has_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    loose, tight = (simulate(SLIPPING, accuracy=accuracy) for accuracy in (5e-2, 1e-2))
    assert loose.status == "not_periodic"
    assert seconds_of(loose) < min(USUAL_SECONDS, seconds_of(tight))
    assert loose.error <= 5e-2
    monkeypatch.setattr("models.solve.engine.over_time.MOST_SECONDS", 0.5)
    limited = simulate(SLIPPING, accuracy=1e-4)
    assert limited.status == "inaccurate"
    assert seconds_of(limited) == 0.5


def test_what_is_no_mean_level_takes_a_second() -> None:
    assert Request(quantity="lines").seconds == Request(quantity="waveform").seconds == USUAL_SECONDS
    assert Request(quantity="lines", duration=0.2).seconds == 0.2
    assert Request().seconds is None
    changing = Scene(20.0, 1000.0, speed_profile=ramp(10.0, 30.0, USUAL_SECONDS))
    found = simulate(changing, accuracy=0.1, rate=12800.0)
    assert seconds_of(found) == USUAL_SECONDS
    # The level is that of this time.
    assert (found.averaging_error, found.rms_se) == (0.0, 0.0)


def test_a_longer_run_is_expected_of_a_finer_accuracy() -> None:
    expected = [expected_seconds(BALL, Request(accuracy=accuracy)) for accuracy in (0.1, 1e-3, 1e-5)]
    assert expected == sorted(expected)
    assert expected[-1] == MOST_SECONDS
    assert expected_seconds(BALL, Request(duration=7.0)) == 7.0


def test_a_plan_is_made_again_for_a_longer_run_only() -> None:
    made: list[float] = []

    def make(seconds: float) -> float:
        made.append(seconds)
        return seconds

    planned = Planned(make, 2.0)
    assert [planned.until(seconds) for seconds in (1.0, 2.0, 3.0, 2.5)] == [2.0, 2.0, 3.0, 3.0]
    assert made == [2.0, 3.0]


def test_a_mean_of_very_slow_swings_takes_eight_of_them() -> None:
    motion = replace(moving(lambda t: 1.0 + 0.1 * np.sin(0.7 * t)), block=1.0)
    found = answer(motion, Request(accuracy=0.5, rate=RATE), 1.0 / (2.0 * RATE))
    assert seconds_of(found) == pytest.approx(8.0)
