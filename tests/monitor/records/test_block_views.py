"""What is kept of blocks to be looked at: raw spectrum and waveform, beside the envelope spectra."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from monitor.health.signal.spectra import BlockView, RawSpectra, raw_spectra
from monitor.health.signal.transform import BlockTransform
from monitor.records.spectra import kept_blocks, pack_view, read_block_view, read_spectra, unpack_view, viewed_blocks
from monitor.records.store import Store
from tests.support.effort import effort_count
from tests.support.pipeline import RATE
from tests.support.records_spectra import blocks, machine, steps_of, take

CHANNEL = "x"


@given(
    st.integers(64, 9000),
    st.floats(100.0, 50_000.0),
    st.integers(0, 2**32 - 1),
    st.sampled_from([1e-12, 1.0, 1e12]),
)
@settings(max_examples=effort_count(quick=20, full=500), deadline=None)
def test_the_spectra_are_those_of_the_windowed_block(n: int, rate: float, seed: int, level: float) -> None:
    x = level * np.random.default_rng(seed).normal(size=n)
    found = raw_spectra(np.fft.rfft(x - x.mean()), n, rate)
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n) / n)
    expected = np.abs(np.fft.rfft((x - x.mean()) * hann))[:-1] * 4.0 / n
    expected[0] = 0.0
    lines = found.amplitude.size
    # In the first bin the window meets the mean, which is not in the signal.
    assert found.amplitude[2:] == pytest.approx(expected[2:lines], rel=1e-9, abs=1e-12 * level)
    each = round(found.width / found.resolution)
    starts = np.arange(0, expected.size, each)
    assert found.highest[1:] == pytest.approx(np.maximum.reduceat(expected, starts)[1:], rel=1e-9)
    assert found.highest.size <= 2048


def test_a_line_reads_its_amplitude_at_any_scale() -> None:
    t = np.arange(25_600) / 25_600.0
    for level in (1e-20, 1.0, 1e20):
        x = (level * (2.0 * np.cos(2 * np.pi * 50.0 * t) + np.cos(2 * np.pi * 6000.0 * t))).astype(np.float32)
        view = BlockTransform(x.size, 25_600.0, [(500.0, 5000.0)])(x, view=True).view
        assert view is not None
        assert view.amplitude[50] == pytest.approx(2.0 * level, rel=1e-5)
        assert view.highest[round(6000.0 // view.width)] == pytest.approx(level, rel=1e-5)


@given(st.integers(0, 300), st.integers(1, 300), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1e-30, 1.0, 1e25]))
@settings(max_examples=effort_count(quick=20, full=500))
def test_a_view_comes_back_from_its_bytes(fine: int, samples: int, seed: int, level: float) -> None:
    random = np.random.default_rng(seed)
    spectra = RawSpectra(0.2, level * random.random(fine), 12.5, level * random.random(7))
    waveform = level * random.normal(size=samples)
    again = unpack_view(*pack_view(BlockView(100.0, 1000, spectra, waveform)))
    assert (again.rate, again.samples, again.spectra.resolution, again.spectra.width) == (100.0, 1000, 0.2, 12.5)
    assert again.spectra.amplitude == pytest.approx(spectra.amplitude, rel=6e-4, abs=1e-8 * level)
    assert again.spectra.highest == pytest.approx(spectra.highest, rel=6e-4, abs=1e-8 * level)
    assert again.waveform == pytest.approx(waveform, abs=2e-5 * np.abs(waveform).max(initial=0.0))


def test_every_kept_block_and_the_newest_have_a_view(tmp_path: Path) -> None:
    config = machine()
    made = blocks(30)
    with Store.open(tmp_path / "state.db", machine="m") as store:
        take(store, steps_of(config), made, batch=4)
        kept = [number for number, _ in kept_blocks(store, CHANNEL)]
        assert viewed_blocks(store, CHANNEL) == kept
        newest = read_block_view(store, CHANNEL)
        assert newest is not None
        assert newest.view is not None
        assert newest.sequence == 30
        block = made[29].samples[0]
        assert newest.view.waveform == pytest.approx(block, abs=2e-5 * float(np.abs(block).max()))
        assert (newest.view.rate, newest.view.samples) == (RATE, block.size)
        hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(block.size) / block.size)
        expected = np.abs(np.fft.rfft((block - block.mean()) * hann))[: newest.view.spectra.amplitude.size]
        assert newest.view.spectra.amplitude[2:] == pytest.approx(expected[2:] * 4.0 / block.size, rel=1e-2)
        assert read_block_view(store, CHANNEL, at=kept[0]) is not None
        assert read_block_view(store, CHANNEL, at=10_000) is None


def test_a_store_of_an_earlier_version_has_spectra_without_views(tmp_path: Path) -> None:
    path = tmp_path / "state.db"
    with Store.open(path, machine="m") as store:
        take(store, steps_of(machine()), blocks(8))
    with sqlite3.connect(path) as connection:
        connection.execute("ALTER TABLE spectra DROP COLUMN view")
    assert read_block_view(path, CHANNEL) is None
    assert read_spectra(path, CHANNEL)
    # Opened for writing, it gets the column; what an earlier version wrote into such a row is not taken for its view.
    with Store.open(path, machine="m") as store, store.transaction() as connection:
        assert viewed_blocks(store, CHANNEL) == []
        connection.execute("UPDATE spectra SET view = x'00', header = json_remove(header, '$.view')")
    assert read_block_view(path, CHANNEL) is None
    with sqlite3.connect(path) as connection:
        assert not connection.execute("SELECT 1 FROM spectra WHERE instr(header, '\"view\"')").fetchall()


def test_without_kept_spectra_nothing_is_computed(tmp_path: Path) -> None:
    with Store.open(tmp_path / "state.db", machine="m") as store:
        take(store, steps_of(machine(rows=0)), blocks(4))
        assert read_block_view(store, CHANNEL) is None
