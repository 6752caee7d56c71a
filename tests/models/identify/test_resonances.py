"""Resonances found in simulated recordings and accelerances."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.identify.resonances import Density, find_resonances, welch

RATE = 12800.0


def _recorded(modes: list[tuple[float, float, float]], seconds: float, seed: int, lines: float = 0.0) -> np.ndarray:
    """Return the acceleration of uncoupled modes (Hz, ratio, gain) under white forces, with lines of one rate."""
    rng = np.random.default_rng(seed)
    count = int(RATE * seconds)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE)
    signal = np.zeros(count)
    for place, ratio, gain in modes:
        force = np.fft.rfft(rng.standard_normal(count))
        x = frequency / place
        signal += np.fft.irfft(gain * force * x**2 / (1.0 - x**2 + 2j * ratio * x), count)
    time = np.arange(count) / RATE
    for k in range(1, 30):
        signal += lines * np.sin(2.0 * math.pi * 97.3 * k * time + k)
    return signal


def test_resonances_are_found_between_lines() -> None:
    signal = _recorded([(600.0, 0.03, 1.0), (3100.0, 0.008, 0.5)], 12.0, 5, lines=1.0)
    found = find_resonances(welch([signal], RATE), (50.0, 5500.0))
    assert len(found) == 2
    for resonance, (frequency, damping) in zip(found, ((600.0, 0.03), (3100.0, 0.008)), strict=True):
        assert resonance.frequency == pytest.approx(frequency, abs=3.0 * resonance.frequency_sd)
        assert resonance.frequency_sd < 0.02 * frequency
        assert resonance.damping == pytest.approx(damping, abs=3.0 * resonance.damping_sd)
        assert resonance.damping_sd < 0.5 * damping


def test_noise_and_lines_hold_no_resonance() -> None:
    rng = np.random.default_rng(2)
    signal = rng.standard_normal(int(8 * RATE))
    assert find_resonances(welch([signal], RATE)) == ()
    time = np.arange(signal.size) / RATE
    signal += sum(3.0 * np.sin(2.0 * math.pi * 130.0 * k * time) for k in range(1, 20))
    assert find_resonances(welch([signal], RATE), (50.0, 5500.0)) == ()


def test_several_recordings_are_averaged() -> None:
    parts = [_recorded([(900.0, 0.02, 1.0)], 1.0, seed) for seed in range(6)]
    one, all_of_them = welch(parts[:1], RATE), welch(parts, RATE)
    assert all_of_them.scatter < one.scatter / 2.0
    # Parseval: the density holds the power of the signal.
    power = float(np.sum(all_of_them.power)) * float(all_of_them.frequency[1])
    assert power == pytest.approx(float(np.mean([np.var(part) for part in parts])), rel=0.05)
    with pytest.raises(ValueError, match="at least 3200 samples as the first, got 10"):
        welch([parts[0], np.zeros(10)], RATE)
    with pytest.raises(ValueError, match="no recording"):
        welch([], RATE)


def test_a_measured_accelerance_gives_its_level() -> None:
    frequency = np.arange(20.0, 3000.0, 2.0)
    x = frequency / 800.0
    level = np.abs(0.4 * x**2 / (1.0 - x**2 + 2j * 0.02 * x))
    (found,) = find_resonances(Density(frequency, level**2, 1e-3, windowed=False))
    assert found.frequency == pytest.approx(800.0, rel=1e-3)
    assert found.damping == pytest.approx(0.02, rel=0.02)
    assert found.level == pytest.approx(0.4 / (2.0 * 0.02), rel=0.02)


def test_too_few_bins_hold_nothing() -> None:
    assert find_resonances(Density(np.arange(5.0), np.ones(5), 0.1)) == ()
