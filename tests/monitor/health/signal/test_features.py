from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import Bearing, kinematics
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.features import FAULTS, BlockFeatures, FeatureSettings, block_features, fundamentals
from reference import features as oracle
from tests.support.effort import effort_count

RATE = 25_600.0
FUNDAMENTALS = {"outer": 97.8, "inner": 142.2, "ball": 102.9, "cage": 8.15}
SETTINGS = FeatureSettings(RATE, ((7000.0, 9000.0),), FUNDAMENTALS)
CASES = effort_count(quick=20, full=200)


def modulated(
    n: int, fundamental: float, depths: tuple[float, ...], a: float = 1.0, carrier: float = 8000.0, noise: float = 0.0
) -> NDArray[np.float64]:
    """A carrier of amplitude ``a``, modulated by known depths at multiples of one frequency."""
    t = np.arange(n) / RATE
    envelope = 1.0 + sum(m * np.cos(2.0 * np.pi * (k + 1) * fundamental * t) for k, m in enumerate(depths))
    return a * envelope * np.cos(2.0 * np.pi * carrier * t) + noise * np.random.default_rng(0).standard_normal(n)


DEPTHS = (0.3, 0.2, 0.15, 0.1, 0.05)


@given(fault=st.sampled_from(FAULTS[:3]), slip=st.floats(-0.019, 0.019), a=st.floats(1e-3, 1e3))
@settings(max_examples=CASES)
def test_known_depths_come_back(fault: str, slip: float, a: float) -> None:
    features = block_features(modulated(32_000, FUNDAMENTALS[fault] * (1.0 + slip), DEPTHS, a), RATE, SETTINGS)
    lines = features.lines[0][fault]
    np.testing.assert_allclose(lines.amplitude, a * np.array(DEPTHS), rtol=0.04)
    assert lines.detected
    assert lines.total == pytest.approx(a * sum(DEPTHS), rel=0.02)
    assert features.speed_factor == pytest.approx(1.0 + slip, abs=2e-4)
    assert features.envelopes[0].mean == pytest.approx(a, rel=2e-3)


def test_the_sums_are_those_of_each_band() -> None:
    x = modulated(32_000, 97.8, DEPTHS, 2.0) + modulated(32_000, 142.2, DEPTHS, 0.5, carrier=3000.0)
    both = dataclasses.replace(SETTINGS, bands=((7000.0, 9000.0), (2000.0, 4000.0)))
    features = block_features(x, RATE, both)
    assert features.lines[0]["outer"].total == pytest.approx(2.0 * sum(DEPTHS), rel=0.02)
    assert features.lines[1]["inner"].total == pytest.approx(0.5 * sum(DEPTHS), rel=0.02)
    for name, fault in (("h_or", "outer"), ("h_ir", "inner"), ("h_ball", "ball"), ("h_cage", "cage")):
        assert features.values[name] == tuple(band[fault].total for band in features.lines)
    swapped = block_features(x, RATE, dataclasses.replace(both, bands=both.bands[::-1]))
    assert swapped.values["h_ir"] == (features.lines[1]["inner"].total, features.lines[0]["inner"].total)


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_raw_harmonics_and_a_star(kind: str) -> None:
    amplitudes = np.array([1.0, 0.8, 0.6, 0.4, 0.2, 0.1])
    t = np.arange(64_000) / RATE
    x = sum(a * np.cos(2.0 * np.pi * 97.13 * (k + 1) * t + k) for k, a in enumerate(amplitudes)) + 4.0
    features = block_features(np.asarray(x, kind), RATE, SETTINGS)
    np.testing.assert_allclose(features.bpfo_amplitude, amplitudes, rtol=0.04)
    assert features.bpfo_resolved.all()
    assert features.a_star == pytest.approx(float(np.sqrt(np.sum(amplitudes[:5] ** 2))), rel=0.02)
    assert features.rms == pytest.approx(float(np.sqrt(np.sum(amplitudes**2) / 2.0)), rel=1e-3)
    assert features.values["mean"] == pytest.approx(4.0, abs=1e-2)


def test_raw_harmonics_take_the_speed_that_the_envelope_shows() -> None:
    t = np.arange(64_000) / RATE
    x = modulated(64_000, 98.8, DEPTHS, noise=0.05) + 0.2 * np.cos(2.0 * np.pi * 98.8 * t)
    # A stronger line beside it, that a search of the raw spectrum alone would take.
    x += 0.5 * np.cos(2.0 * np.pi * 97.0 * t)
    features = block_features(x, RATE, SETTINGS)
    assert features.lines[0]["outer"].speed_factor == pytest.approx(98.8 / 97.8, abs=1e-4)
    assert features.bpfo_amplitude[0] == pytest.approx(0.2, rel=0.05)


def test_the_rms_band_holds_for_rms_and_a_star() -> None:
    x = np.random.default_rng(0).standard_normal(32_000)
    limited = dataclasses.replace(SETTINGS, rms_band=(200.0, 9500.0))
    features, full = block_features(x, RATE, limited), block_features(x, RATE, SETTINGS)
    assert features.rms == pytest.approx(oracle.band_rms(x, RATE, (200.0, 9500.0)), rel=1e-5)
    assert full.rms == full.indicators.rms == features.indicators.rms
    np.testing.assert_array_equal(features.bpfo_resolved, [False, False, True, True, True, True])
    assert features.bpfo_amplitude[0] == features.bpfo_amplitude[1] == 0.0
    assert features.a_star == pytest.approx(float(np.linalg.norm(full.bpfo_amplitude[2:5])), rel=1e-6)


def test_the_values_are_the_indicators() -> None:
    x = np.random.default_rng(0).standard_normal(8001) + 0.3
    features = block_features(x, RATE, SETTINGS)
    for name, value in oracle.indicators(x).items():
        if name != "rms":
            assert features.values[name] == pytest.approx(value, rel=1e-9), name
    assert features.n_used == 8000


def test_noise_is_not_detected() -> None:
    count = effort_count(quick=60, full=1000)
    rng = np.random.default_rng(11)
    found = [block_features(rng.standard_normal(25_600), RATE, SETTINGS) for _ in range(count)]
    assert sum(f.speed_factor is not None for f in found) <= 1 + count // 500
    assert all(np.isfinite(f.lines[0]["outer"].snr).all() for f in found)


def test_short_records_are_averaged_with_their_neighbours() -> None:
    alone = FeatureSettings(RATE, ((1000.0, 12_000.0),), {"outer": 154.3, "inner": 203.2, "ball": 197.4, "cage": 11.9})
    together = dataclasses.replace(alone, average_blocks=24)
    rng = np.random.default_rng(3)
    t = np.arange(2560) / RATE
    recent = RecentSpectra()
    single: list[bool] = []
    features: BlockFeatures | None = None
    x = np.zeros(0)
    for k in range(24):
        # One record alone seldom shows lines as weak as these.
        depth = 1.0 + 0.08 * sum(np.cos(2.0 * np.pi * 154.3 * h * (t + 0.37 * k)) for h in (1, 2, 3))
        x = depth * rng.standard_normal(2560)
        single.append(block_features(x, RATE, alone).families[0]["outer"].detected)
        features = block_features(x, RATE, together, recent)
        recent = features.recent
    assert features is not None
    assert recent.count == features.sought[0].n_averages == 24
    assert features.families[0]["outer"].detected
    assert sum(single) < 12
    assert not features.families[0]["cage"].resolved.any()
    # What was found in the average is read from the block's own spectrum at that speed.
    assert features.lines[0]["outer"].speed_factor == features.families[0]["outer"].speed_factor
    assert features.lines[0]["outer"].threshold > features.families[0]["outer"].threshold
    # Spectra of another number of bands are not averaged with the earlier ones.
    both = dataclasses.replace(together, bands=(*together.bands, (2000.0, 9000.0)))
    assert block_features(x, RATE, both, recent).recent.count == 1


@pytest.mark.parametrize("value", [0.0, 1.5])
def test_a_flat_block_has_numbers_only(value: float) -> None:
    features = block_features(np.full(5000, value), RATE, SETTINGS)
    assert features.indicators.flat
    assert features.rms == features.a_star == features.values["h_or"] == features.values["kurtosis"] == 0.0
    assert features.speed_factor is None
    for lines in features.lines[0].values():
        assert np.isfinite(lines.snr).all()
        assert not lines.detected


def test_a_block_is_a_pure_function_of_its_samples() -> None:
    x = np.random.default_rng(0).standard_normal(12_800).astype(np.float32)
    x.setflags(write=False)
    first = block_features(x, RATE, SETTINGS)
    block_features(np.zeros(12_800), RATE, SETTINGS)
    second = block_features(x, RATE, SETTINGS)
    np.testing.assert_array_equal(first.envelopes[0].amplitude, second.envelopes[0].amplitude)
    np.testing.assert_array_equal(first.bpfo_amplitude, second.bpfo_amplitude)
    assert first.indicators == second.indicators
    assert first.rms == second.rms


def test_fundamentals_of_a_bearing() -> None:
    kin = kinematics(Bearing("PRONOSTIA", 13, 3.5e-3, 25.6e-3), 30.0)
    lines = fundamentals(kin)
    assert tuple(lines) == FAULTS
    assert lines["outer"] == pytest.approx(168.3, abs=0.1)
    assert lines["ball"] == pytest.approx(215.3, abs=0.1)
    assert lines["cage"] == kin.ftf


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bands": ()}, "at least one band"),
        ({"fundamentals": {"outer": 97.8}}, "expected outer, inner, ball, cage"),
        ({"fundamentals": FUNDAMENTALS | {"inner": -3.0}}, "inner must be positive"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(SETTINGS, **change)


def test_a_block_of_another_rate_is_refused() -> None:
    with pytest.raises(ValueError, match="25600 Hz, the block has 51200 Hz"):
        block_features(np.zeros(5000), 51_200.0, SETTINGS)
