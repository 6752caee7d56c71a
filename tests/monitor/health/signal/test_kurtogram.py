"""The kurtogram: against direct sums, on noise, tones and bursts, and where it is kept."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from monitor.health.signal.interference import Interference
from monitor.health.signal.kurtogram import MAX_SAMPLES, PARTS, Kurtogram, kurtogram
from monitor.records.spectra import read_spectra
from monitor.service.replay import replay
from reference.signals import RESONANCE, bearing_lines, impacts
from tests.oracles.kurtogram_oracle import band_kurtosis
from tests.support.pipeline import RATE, life
from tests.support.records_spectra import machine


def noise(n: int, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).standard_normal(n)


def made(x: NDArray[np.number], rate: float = 25600.0) -> Kurtogram:
    found = kurtogram(x, rate)
    assert found is not None
    return found


@pytest.mark.parametrize("n", [512, 1000, 1215])
def test_each_band_is_as_direct_sums_give_it(n: int) -> None:
    x = noise(n) * (1.0 + 5.0 * (np.arange(n) % 97 == 0))
    x -= x.mean()
    found = made(x)
    half = n // 2
    assert [len(level) for level in found.levels] == [parts for parts in PARTS if half // parts >= 64]
    for level in found.levels:
        edges = np.rint(np.linspace(0, half, len(level) + 1)).astype(int)
        width = int(np.diff(edges).min())
        for place, value in enumerate(level):
            assert value == pytest.approx(band_kurtosis(x, int(edges[place]), width), abs=2e-3)


def test_bands_of_a_level_fill_the_range() -> None:
    found = made(noise(4096))
    for level, row in enumerate(found.levels):
        edges = [found.band(level, place) for place in range(len(row))]
        assert edges[0][0] == 0.0
        assert edges[-1][1] == pytest.approx(found.nyquist)
        assert [high for _, high in edges[:-1]] == pytest.approx([low for low, _ in edges[1:]])


def test_noise_has_no_best_band() -> None:
    assert sum(made(noise(2560, seed)).best() is not None for seed in range(200)) <= 4


def test_a_tone_is_minus_one_and_repeated_bursts_are_found_at_their_resonance() -> None:
    n = 12_800
    tone = made(np.cos(2.0 * np.pi * 0.2 * np.arange(n)))
    assert tone.levels[0][0] == pytest.approx(-1.0, abs=1e-3)
    _, lines = bearing_lines("6205", 30.0)
    found = made(impacts(np.random.default_rng(0), "outer", lines, duration=1.0))
    best = found.best()
    assert best is not None
    low, high = found.band(*best)
    assert low < RESONANCE < high


def test_it_does_not_depend_on_level_unit_or_offset() -> None:
    x = noise(4096)
    first = np.array(made(x).levels[3])
    others: list[NDArray[np.number]] = [1e-9 * x, 1e9 * x, x + 1e3, (1000 * x).astype(np.int32)]
    for other in others:
        assert np.array(made(other).levels[3]) == pytest.approx(first, abs=2e-2)


def test_interference_is_removed_before() -> None:
    n = 25_600
    tone = 3.0 * np.cos(2.0 * np.pi * 3000.3 * np.arange(n) / 25600.0)
    x = noise(n) + tone
    combs = Interference(lines=(3000.0,), harmonics=1).combs(None)
    freed = kurtogram(x, 25600.0, combs)
    assert freed is not None
    assert made(x).levels[0][0] < -0.5
    assert abs(freed.levels[0][0]) < 0.2


def test_what_has_none() -> None:
    assert kurtogram(np.zeros(1000), 1000.0) is None
    assert kurtogram(np.full(1000, 7), 1000.0) is None
    assert kurtogram(noise(100), 1000.0) is None
    assert made(noise(4 * MAX_SAMPLES)).samples == MAX_SAMPLES // 2


def test_it_survives_json_to_two_decimals() -> None:
    found = made(noise(4096))
    back = Kurtogram.from_dict(json.loads(json.dumps(found.to_dict())))
    assert (back.nyquist, back.samples) == (found.nyquist, found.samples)
    for one, other in zip(back.levels, found.levels, strict=True):
        assert one == pytest.approx(other, abs=0.0051)


def test_kept_spectra_have_one_and_the_newest_has_none(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    for number, block in enumerate(life()[:4], start=1):
        np.savetxt(tmp_path / "in" / f"b{number}.csv", block)
    config = machine(tmp_path / "in", interval=1e6)
    done = replay(config, None, tmp_path / "out")
    rows = read_spectra(done.store_path, "x")
    assert [(row.sequence, row.kurtogram is None) for row in rows] == [(1, False), (4, True)]
    kept = rows[0].kurtogram
    assert kept is not None
    assert kept.nyquist == 0.5 * RATE
