"""Lines of other origin: removed where present, all other bins unchanged; and proposed where none are configured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.name.naming import name_fault
from monitor.health.signal.bands import find_band
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.interference import Interference, all_combs, remove_lines
from monitor.health.signal.interference_search import propose
from reference.signals import RESONANCE
from tests.support.interference import BAND, LINES, RATE, SPEED, damaged, mesh

GEAR = Interference(orders=(23.0,), sidebands=3)


def features(x: NDArray[np.float64], *interference: Interference) -> BlockFeatures:
    settings = FeatureSettings(RATE, (BAND,), fundamentals(LINES), speed=SPEED, rms_band=(10.0, 10_000.0))
    combs = all_combs(interference, SPEED)
    return block_features(x.astype(np.float32), RATE, replace(settings, interference=combs))


def named(found: BlockFeatures) -> str | None:
    return name_fault(found.sought[0], LINES, found.families[0]).fault


@pytest.mark.parametrize("fault", ["outer", "inner"])
def test_removal_gives_depth_and_name_back(fault: str) -> None:
    x = damaged(fault=fault)
    y = x + mesh(x.size, 2.0)
    alone, covered, freed = features(x), features(y), features(y, GEAR)
    assert named(covered) is None
    assert named(freed) == fault
    depths = [found.families[0][fault].depth for found in (alone, covered, freed)]
    assert depths[1] < 0.4 * depths[0]
    assert depths[2] > 0.75 * depths[0]


def test_a_comb_that_is_not_there_changes_no_bit() -> None:
    x = damaged()
    others = (GEAR, Interference(lines=(50.0, 333.3)), Interference(lines=(2345.6,), harmonics=1))
    before, after = features(x), features(x, *others)
    assert np.array_equal(before.envelopes[0].amplitude, after.envelopes[0].amplitude)
    assert before.envelopes[0].mean == after.envelopes[0].mean


def test_raw_spectrum_and_rms_keep_the_lines() -> None:
    x = damaged() + mesh(51_200, 2.0)
    before, after = features(x), features(x, GEAR)
    assert (after.rms, after.a_star, after.indicators) == (before.rms, before.a_star, before.indicators)
    assert after.envelopes[0].mean < 0.7 * before.envelopes[0].mean


def test_a_single_line_in_hz_is_removed_and_what_is_far_from_it_stays() -> None:
    rng, n = np.random.default_rng(1), 51_200
    x = rng.standard_normal(n) + 3.0 * np.cos(2.0 * np.pi * 4321.3 * np.arange(n) / RATE)
    before = np.fft.rfft(x)
    after = before.copy()
    remove_lines(after, RATE / n, Interference(lines=(4320.0,), harmonics=1).combs(None), *BAND)
    changed = np.flatnonzero(after != before) * RATE / n
    assert changed.size
    assert changed.min() > 4280.0
    assert changed.max() < 4360.0
    assert np.abs(after[8600:8700]).max() < 4.0 * np.sqrt(np.mean(np.abs(before[9000:12000]) ** 2))
    assert np.allclose(np.angle(after), np.angle(before))


def test_nothing_outside_the_band_is_touched() -> None:
    spectrum = np.fft.rfft(mesh(51_200, 2.0) + np.random.default_rng(2).standard_normal(51_200))
    after = spectrum.copy()
    remove_lines(after, RATE / 51_200, GEAR.combs(SPEED), *BAND)
    changed = np.flatnonzero(after != spectrum) * RATE / 51_200
    assert changed.min() >= BAND[0]
    assert changed.max() <= BAND[1]


def test_lines_that_the_block_cannot_separate_stay() -> None:
    spectrum = np.fft.rfft(mesh(2560, 5.0)[:2560] + np.random.default_rng(3).standard_normal(2560))
    after = spectrum.copy()
    remove_lines(after, 10.0, Interference(orders=(2.0,)).combs(SPEED), *BAND)
    assert np.array_equal(after, spectrum)
    remove_lines(after, 10.0, GEAR.combs(SPEED), *BAND)
    assert not np.array_equal(after, spectrum)


def test_orders_need_a_speed() -> None:
    assert GEAR.combs(None) == ()
    fixed = Interference(orders=(23.0,), lines=(50.0,), sidebands=2).combs(None)
    assert [(comb.fundamental, comb.sidebands) for comb in fixed] == [(50.0, 0)]


@given(
    order=st.floats(0.3, 90.0),
    sidebands=st.integers(0, 6),
    tolerance=st.floats(0.0, 0.05),
    n=st.integers(64, 4000),
    seed=st.integers(0, 1000),
)
def test_power_never_rises_and_stays_finite(order: float, sidebands: int, tolerance: float, n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft(rng.standard_normal(n) + 20.0 * np.cos(np.arange(n) * rng.uniform(0.3, 2.0)))
    after = spectrum.astype(np.complex64)
    before = after.copy()
    combs = Interference(orders=(order,), sidebands=sidebands, tolerance=tolerance).combs(SPEED)
    remove_lines(after, RATE / n, combs, 500.0, 12_000.0)
    assert np.isfinite(after).all()
    assert (np.abs(after) <= np.abs(before) * (1.0 + 1e-6)).all()


def test_digital_silence_stays_silent() -> None:
    spectrum = np.zeros(25_601, dtype=np.complex64)
    remove_lines(spectrum, 0.5, GEAR.combs(SPEED), *BAND)
    assert not spectrum.any()


def test_a_mesh_is_proposed_and_damage_is_not() -> None:
    x = damaged()
    own = [features(x).families[0]["outer"].fundamental]
    assert propose(x, RATE, BAND, SPEED, own) == ()
    (found,) = propose(x + mesh(x.size, 1.0, SPEED), RATE, BAND, SPEED, own)
    assert (found.order, found.sidebands) == (23, True)
    assert found.harmonics >= 5
    assert found.fundamental == pytest.approx(690.0, rel=1e-4)
    assert found.share > 0.2


def test_what_is_configured_is_not_proposed() -> None:
    x = damaged() + mesh(51_200, 1.0, SPEED)
    own = [features(damaged()).families[0]["outer"].fundamental]
    assert propose(x, RATE, BAND, SPEED, own, GEAR.combs(SPEED)) == ()


def test_a_band_is_chosen_without_the_lines() -> None:
    x = damaged(duration=1.0)
    lines = fundamentals(LINES)
    chosen = find_band([x], RATE, lines)
    covered = x + mesh(x.size, 2.0)
    assert find_band([x], RATE, lines, GEAR.combs(SPEED)) == chosen
    low, high = find_band([covered], RATE, lines)
    assert not low < RESONANCE < high
    low, high = find_band([covered], RATE, lines, GEAR.combs(SPEED))
    assert low < RESONANCE < high


def test_a_comb_of_the_bearing_is_not_proposed() -> None:
    t = np.arange(51_200) / RATE
    x = np.random.default_rng(4).standard_normal(t.size)
    x += sum(np.cos(2.0 * np.pi * 10 * k * 107.3 * t) for k in range(1, 8))
    assert propose(x, RATE, BAND, SPEED, [107.3]) == ()
    assert [round(found.fundamental) for found in propose(x, RATE, BAND, SPEED)] == [1073]


def test_an_order_that_the_speed_cannot_tell_is_proposed_in_hz() -> None:
    t = np.arange(51_200) / RATE
    x = np.random.default_rng(5).standard_normal(t.size) + np.cos(2.0 * np.pi * 150 * SPEED * t)
    (found,) = propose(x, RATE, BAND, SPEED)
    assert found.order is None
    assert found.fundamental == pytest.approx(4500.0, abs=0.5)
    assert propose(x, RATE, (5000.0, 9000.0), SPEED) == ()
