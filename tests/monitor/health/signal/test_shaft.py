"""The shaft speed measured near a stated one: found where both spectra show it, and withheld where they do not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.channel import HELD_BLOCKS, held_factor
from monitor.health.signal.comb import LineSpectrum, beside_shaft, line_spectrum
from monitor.health.signal.condition import ConditionSettings, Quantity, known_sd
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.shaft import ACCEPTED, MIN_TURNS, SHAFT_ORDERS, measure_shaft
from reference.signals import bearing_lines, impacts
from tests.support.effort import effort_count

RATE, BAND, RESOLUTION = 12000.0, (1000.0, 5000.0), 0.2
SAMPLES = NDArray[np.float64]


def spectrum(lines: SAMPLES, seed: int, height: float = 20.0, n: int = 4000) -> LineSpectrum:
    """Return noise with lines (Hz) of such a height over it, as a Hann window shows them."""
    rng = np.random.default_rng(seed)
    frequency = np.arange(n) * RESOLUTION
    amplitude = np.sqrt(rng.exponential(size=n))
    for line in lines:
        off = np.abs(frequency - line) / RESOLUTION
        amplitude += height * np.where(off < 2.0, np.cos(np.pi * off / 4.0) ** 2, 0.0)
    return line_spectrum(amplitude, RESOLUTION, speed=30.0)


def orders_of(speed: float, *orders: int) -> SAMPLES:
    return speed * np.array(orders or range(1, SHAFT_ORDERS + 1), dtype=float)


def cage_of(speed: float) -> SAMPLES:
    """Lines at every third of a speed but each eighth, as passages of eight balls that are not alike make them."""
    return np.array([k * speed / 3.0 for k in range(1, 37) if k % 8])


def half_of(speed: float) -> SAMPLES:
    return 0.5 * speed * np.arange(1.0, 2.0 * SHAFT_ORDERS + 1.0)


@settings(max_examples=effort_count(quick=25, full=200), deadline=None)
@given(error=st.floats(-0.08, 0.08), speed=st.floats(20.0, 40.0), seed=st.integers(0, 2**16))
def test_a_shaft_that_both_spectra_show_is_found_wherever_it_is_stated(error: float, speed: float, seed: int) -> None:
    found = measure_shaft(
        spectrum(orders_of(speed), seed), spectrum(orders_of(speed, 1, 2, 3, 5), seed + 1), speed / (1.0 + error)
    )
    assert found is not None
    assert abs(found.speed - speed) < min(5.0 * found.sd, 0.001 * speed)


def test_the_stated_error_is_of_the_size_of_the_errors() -> None:
    rng, z = np.random.default_rng(3), []
    for seed in range(effort_count(quick=40, full=300)):
        speed = rng.uniform(20.0, 40.0)
        found = measure_shaft(
            spectrum(orders_of(speed), seed, 5.0), spectrum(orders_of(speed, 1, 2), seed), speed * 1.03
        )
        assert found is not None
        z.append((found.speed - speed) / found.sd)
    assert 0.1 < math.sqrt(float(np.mean(np.square(z)))) < 1.5


@pytest.mark.parametrize(
    ("raw", "envelope", "stated", "why"),
    [
        (orders_of(30.0)[:0], orders_of(30.0)[:0], 30.0, "noise"),
        (orders_of(30.0, 2, 4, 6, 8, 10, 12), orders_of(30.0, 2, 4, 6, 8, 10, 12), 30.5, "lines of a supply at 60 Hz"),
        (orders_of(30.0, 3, 6, 9, 12), orders_of(30.0, 3, 6, 9, 12), 30.5, "an outer race near three times the shaft"),
        (orders_of(30.0, 5, 10), orders_of(30.0, 5, 10), 30.5, "an inner race near five times the shaft"),
        (orders_of(30.0)[:0], orders_of(30.0), 30.5, "only the envelope shows it"),
        (cage_of(30.0), cage_of(30.0), 30.5, "three turns of a cage whose every turn shows"),
        (half_of(30.0), half_of(30.0), 30.5, "a shaft that turns at half the speed"),
        (np.concatenate([orders_of(30.0), orders_of(31.4)]), orders_of(30.0)[:0], 30.5, "two shafts"),
        (orders_of(30.0), orders_of(30.0), 30.0 / (1.0 - ACCEPTED) * 1.006, "beyond the range"),
        (orders_of(3.0), orders_of(3.0), 3.0, "fewer turns than are needed"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_speed_is_withheld(raw: SAMPLES, envelope: SAMPLES, stated: float, why: str) -> None:
    for seed in range(3):
        assert measure_shaft(spectrum(raw, seed), spectrum(envelope, seed + 10), stated) is None, why


def test_the_score_is_that_of_a_slow_and_obvious_one() -> None:
    raw, envelope = spectrum(orders_of(29.3), 1), spectrum(orders_of(29.3, 1, 2, 4), 2)
    found = measure_shaft(raw, envelope, 30.0)
    assert found is not None
    best = -math.inf
    for speed in np.arange(29.29, 29.31, 0.001):
        heights = [sum(top(spec, k * speed) for spec in (raw, envelope)) for k in range(1, SHAFT_ORDERS + 1)]
        kept = [[h for k, h in enumerate(heights, 1) if k % out] for out in (2, 3, 5)]
        best = max(best, min(sum(part) / len(part) for part in kept))
    assert found.score == pytest.approx(best, rel=1e-9)


def top(spec: LineSpectrum, frequency: float) -> float:
    """Return the excess of the bin if it is the top of a line, 0.6 of that of a top beside it."""
    at, power = round(frequency / RESOLUTION), spec.power

    def of(bin_: int) -> float:
        return float(spec.excess[bin_]) if power[bin_] >= power[bin_ - 1] and power[bin_] > power[bin_ + 1] else 0.0

    return max(of(at), 0.6 * of(at - 1), 0.6 * of(at + 1))


def test_lines_at_harmonics_of_the_shaft_are_left_out_two_bins_either_side() -> None:
    whole = spectrum(orders_of(30.0), 4)
    beside = beside_shaft(whole, 30.0, 0.0)
    assert beside.beside is not None
    left_out = np.flatnonzero(beside.beside == 0.0)
    assert set(np.abs(left_out - 150.0 * np.rint(left_out / 150.0)).tolist()) == {0.0, 1.0}
    assert np.count_nonzero(beside_shaft(whole, 30.0, 0.02).beside == 0.0) > left_out.size
    np.testing.assert_array_equal(beside.sought, whole.excess * beside.beside)


def machine(
    true: float, stated: float, *, shaft: bool, speed_sd: float | None = None, held: float = 1.0
) -> BlockFeatures:
    """Return the features of five seconds of a damaged outer race on a machine that runs beside its stated speed."""
    _, lines = bearing_lines("6205", true)
    _, nominal = bearing_lines("6205", stated)
    x = impacts(np.random.default_rng(1), "outer", lines, rate=RATE, duration=5.0, height=20.0)
    t = np.arange(x.size) / RATE
    x += sum((0.3 * np.cos(2.0 * np.pi * k * true * t + k) for k in range(1, 9)), np.zeros(x.size)) * shaft
    given_ = FeatureSettings(RATE, (BAND,), fundamentals(nominal), speed=stated, speed_sd=speed_sd, held=held)
    return block_features(x.astype(np.float32), RATE, given_)


@pytest.mark.parametrize("error", [-0.06, 0.0, 0.05])
def test_features_are_those_at_the_speed_that_is_found(error: float) -> None:
    exact = machine(30.0, 30.0, shaft=True, speed_sd=0.0)
    found = machine(30.0, 30.0 * (1.0 + error), shaft=True)
    assert found.shaft is not None
    assert found.shaft.speed == pytest.approx(30.0, rel=1e-3)
    assert found.speed == pytest.approx(found.shaft.speed)
    assert found.values["speed_factor"] == pytest.approx(1.0 / (1.0 + error), rel=2e-3)
    assert found.values["h_or"] == pytest.approx(exact.values["h_or"], rel=0.02)


def test_without_lines_of_the_shaft_the_stated_or_the_held_speed_stands() -> None:
    silent = machine(30.0, 31.2, shaft=False)
    assert silent.shaft is None
    assert silent.speed == 31.2
    held = machine(30.0, 31.2, shaft=False, held=30.0 / 31.2)
    assert held.shaft is None
    assert held.speed == pytest.approx(30.0)
    assert held.values["h_or"] == pytest.approx(machine(30.0, 30.0, shaft=True).values["h_or"], rel=0.02)


def test_a_block_too_short_for_the_shaft_gives_the_bits_of_before() -> None:
    """Fewer than ``MIN_TURNS``: nothing depends on whether the speed would be measured."""
    _, lines = bearing_lines("PRONOSTIA", 27.5)
    assert MIN_TURNS > 0.1 * 27.5
    x = impacts(np.random.default_rng(0), "outer", lines, duration=0.1).astype(np.float32)
    found = block_features(x, 25600.0, FeatureSettings(25600.0, (BAND,), fundamentals(lines), speed=27.5))
    assert found.shaft is None
    assert found.sought[0].beside is None


def test_one_wrong_speed_among_the_latest_blocks_has_no_effect() -> None:
    assert held_factor((0.96,) * (HELD_BLOCKS - 1)) == 1.0
    assert held_factor((*((0.96,) * (HELD_BLOCKS - 1)), 1.07)) == 0.96


def test_which_speeds_are_known() -> None:
    nominal, exact = ConditionSettings(speed=30.0), ConditionSettings(speed=30.0, speed_exact=True)
    assert known_sd(Quantity(30.0, "configured"), nominal) is None
    assert known_sd(Quantity(30.0, "block"), nominal) is None
    assert known_sd(Quantity(30.0, "block"), exact) == 0.0
    assert known_sd(Quantity(30.0, "channel", 0.2), nominal) == 0.2
    assert known_sd(Quantity(30.0, "estimate", 0.02), nominal) == 0.02
    assert known_sd(Quantity(30.0, "estimate", 0.3), nominal) is None
