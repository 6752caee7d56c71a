from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from monitor.health.signal.bands import candidate_bands, find_band, rank_bands

RATE = 25_600.0
FUNDAMENTALS = {"outer": 97.8, "inner": 142.2, "ball": 102.9, "cage": 8.15}
HIGHEST = 142.2


def noise(n: int, seed: int) -> NDArray[np.float64]:
    return np.random.default_rng(seed).standard_normal(n)


def ringing(n: int, resonance: float, height: float, seed: int) -> NDArray[np.float64]:
    """Impacts at 97.8 Hz that ring a resonance, in white noise."""
    x = noise(n, seed)
    t = np.arange(200) / RATE
    ring = height * np.exp(-1200.0 * t) * np.sin(2.0 * np.pi * resonance * t)
    for start in np.arange(0.0, n - 200.0, RATE / 97.8):
        x[int(start) : int(start) + 200] += ring
    return x


@pytest.mark.parametrize("resonance", [2500.0, 4000.0, 6000.0, 8500.0, 10_500.0])
def test_the_resonance_that_impacts_ring_is_found(resonance: float) -> None:
    lo, hi = find_band([ringing(64_000, resonance, 6.0, 1)], RATE, FUNDAMENTALS)
    assert lo < resonance < hi
    assert hi - lo < 0.6 * 0.5 * RATE


def test_noise_alone_keeps_the_whole_range() -> None:
    for seed in range(5):
        band = find_band([noise(32_000, 10 * seed + k) for k in range(4)], RATE, FUNDAMENTALS)
        assert band == candidate_bands(RATE, HIGHEST)[0]


def test_steady_tones_that_beat_do_not_attract_it() -> None:
    t = np.arange(64_000) / RATE
    x = noise(64_000, 3) + 3.0 * np.cos(2.0 * np.pi * 9000.0 * t) + 3.0 * np.cos(2.0 * np.pi * 9110.0 * t)
    assert find_band([x], RATE, FUNDAMENTALS) == candidate_bands(RATE, HIGHEST)[0]


def test_a_burst_in_one_block_of_many_does_not_choose_it() -> None:
    blocks = [noise(12_800, seed) for seed in range(9)]
    blocks[4][5000:5400] += 200.0 * np.sin(2.0 * np.pi * 6000.0 * np.arange(400) / RATE)
    assert find_band(blocks, RATE, FUNDAMENTALS) == candidate_bands(RATE, HIGHEST)[0]


def test_it_is_deterministic_and_knows_no_scale() -> None:
    x = ringing(32_000, 6000.0, 6.0, 2)
    band = find_band([x], RATE, FUNDAMENTALS)
    assert find_band([x.astype(np.float32)], RATE, FUNDAMENTALS) == band
    assert find_band([1e-6 * x], RATE, FUNDAMENTALS) == band
    assert find_band([x + 5.0], RATE, FUNDAMENTALS) == band


def test_silence_is_survived() -> None:
    ranked = rank_bands([np.zeros(12_800)], RATE, FUNDAMENTALS)
    assert all(candidate.score == 0.0 for candidate in ranked)
    assert find_band([np.zeros(12_800)], RATE, FUNDAMENTALS) == ranked[0].band


def test_long_windows_are_thinned_evenly() -> None:
    blocks = [ringing(32_000, 6000.0, 6.0, 2)] * 200
    assert find_band(blocks, RATE, FUNDAMENTALS) == find_band(blocks[:3], RATE, FUNDAMENTALS)


@pytest.mark.parametrize("rate", [12_000.0, 25_600.0, 51_200.0])
def test_candidates_hold_five_harmonics_and_stay_below_nyquist(rate: float) -> None:
    bands = candidate_bands(rate, HIGHEST)
    assert len(set(bands)) == len(bands)
    for lo, hi in bands:
        assert lo >= 5.0 * HIGHEST
        assert hi <= 0.5 * rate
        assert hi - lo >= 6.0 * HIGHEST


def test_wrong_input_is_refused() -> None:
    with pytest.raises(ValueError, match="no block"):
        find_band([], RATE, FUNDAMENTALS)
    with pytest.raises(ValueError, match="different lengths"):
        find_band([np.zeros(100), np.zeros(101)], RATE, FUNDAMENTALS)
    with pytest.raises(ValueError, match="too low"):
        find_band([np.zeros(12_800)], 3000.0, FUNDAMENTALS)
    with pytest.raises(ValueError, match="finite"):
        find_band([np.full(12_800, np.nan)], RATE, FUNDAMENTALS)
