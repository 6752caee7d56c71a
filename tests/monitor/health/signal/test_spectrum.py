from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.fft import next_fast_len, prev_fast_len

from monitor.health.signal import plans
from monitor.health.signal.transform import (
    BlockTransform,
    band_bins,
    fast_length,
    get_transform,
)
from reference import features as oracle
from tests.support.effort import effort_count

RATE = 25_600.0
CASES = effort_count(quick=15, full=300)


def noise(n: int, seed: int = 0) -> NDArray[np.float64]:
    return np.random.default_rng(seed).standard_normal(n)


def modulated(n: int, rate: float, depths: tuple[float, ...], f_m: float, f_c: float, a: float) -> NDArray[np.float64]:
    t = np.arange(n) / rate
    envelope = 1.0 + sum(m * np.cos(2.0 * np.pi * (k + 1) * f_m * t) for k, m in enumerate(depths))
    return a * envelope * np.cos(2.0 * np.pi * f_c * t + 0.3)


def impacts(n: int, rate: float, f_m: float, f_c: float, seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    t = np.arange(n) / rate
    x = 0.05 * rng.standard_normal(n)
    ring = np.exp(-1500.0 * t[:400]) * np.sin(2.0 * np.pi * f_c * t[:400])
    for start in np.arange(0.0, n - 400.0, rate / f_m):
        x[int(start) : int(start) + 400] += ring
    return x


@given(st.integers(64, 300_000))
@settings(max_examples=CASES)
def test_fast_lengths_are_those_of_scipy(n: int) -> None:
    assert fast_length(n) == prev_fast_len(n, real=True)
    assert plans.next_smooth(n) == next_fast_len(n, real=True)


@pytest.mark.parametrize("seed", range(effort_count(quick=3, full=20)))
@pytest.mark.parametrize(("n", "rate", "band"), [(32_000, 25_600.0, (7000.0, 9000.0)), (64_000, 51_200.0, (2e3, 2e4))])
def test_envelope_of_impacts_agrees_with_the_full_length_brick_wall(
    n: int, rate: float, band: tuple[float, float], seed: int
) -> None:
    x = impacts(n, rate, 97.8, 8000.0, seed)
    found = BlockTransform(n, rate, [band])(x).envelopes[0]
    expected, mean = oracle.envelope_spectrum(x, rate, band)
    assert found.mean == pytest.approx(mean, rel=1e-3)
    for h in range(1, 6):
        amplitude = oracle.line_amplitude(found.amplitude, found.resolution, h * 97.8)
        assert amplitude == pytest.approx(oracle.line_amplitude(expected, rate / n, h * 97.8), rel=1e-3)
    low = round(1000.0 * n / rate)
    assert np.max(np.abs(found.amplitude[:low] - expected[:low])) < 1e-3 * expected.max()


def test_an_envelope_at_the_full_rate_is_the_oracle_to_rounding() -> None:
    x = noise(6000)
    found = BlockTransform(6000, RATE, [(500.0, 12_800.0)], precision="float64", oversampling=8.0)(x).envelopes[0]
    expected, mean = oracle.envelope_spectrum(x, RATE, (500.0, 12_800.0))
    np.testing.assert_allclose(found.amplitude, expected[: found.amplitude.size], atol=1e-13)
    assert found.mean == pytest.approx(mean, rel=1e-12)


@given(
    n=st.sampled_from([4001, 4999, 5000, 7919, 8191, 8192]),
    lo=st.floats(0.0, 11_000.0),
    width=st.floats(500.0, 12_800.0),
    seed=st.integers(0, 100),
)
@settings(max_examples=CASES)
def test_any_band_and_length_agree_with_the_oracle_on_the_used_samples(
    n: int, lo: float, width: float, seed: int
) -> None:
    band = (lo, min(lo + width, 0.5 * RATE))
    x = noise(n, seed)
    spectra = BlockTransform(n, RATE, [band], rms_band=band)(x)
    used = x[: spectra.n_used]
    expected, _ = oracle.envelope_spectrum(used, RATE, band)
    found = spectra.envelopes[0].amplitude
    # White noise is the worst case for the aliases of a decimated envelope: near zeros of |z| it has kinks.
    assert np.max(np.abs(found - expected[: found.size])) < 0.03 * expected.max()
    assert spectra.band_rms == pytest.approx(oracle.band_rms(used, RATE, band), rel=1e-5)
    np.testing.assert_allclose(spectra.raw.amplitude[1:-1], oracle.hann_spectrum(used - used.mean())[1:-1], atol=1e-6)


@pytest.mark.parametrize("n", [5000, 5625])
def test_the_edges_of_the_raw_spectrum_and_of_the_whole_band(n: int) -> None:
    x = noise(n)
    transform = BlockTransform(n, RATE, [(0.0, 0.5 * RATE)], rms_band=(0.0, 0.5 * RATE))
    spectra = transform(x)
    assert spectra.n_used == n
    assert spectra.raw.amplitude.size == n // 2 + 1
    nyquist = abs(np.sum(x * (-1.0) ** np.arange(n))) / n if n % 2 == 0 else 0.0
    assert spectra.band_rms == pytest.approx(np.sqrt(x.var() - nyquist**2), rel=1e-5)
    assert spectra.raw.frequency[-1] == pytest.approx(0.5 * RATE, rel=1e-3)
    assert spectra.envelopes[0].band == (0.0, 0.5 * RATE)


@given(st.floats(-1e4, 1e4), st.sampled_from(["float32", "float64"]))
@settings(max_examples=CASES)
def test_a_constant_offset_changes_nothing(offset: float, kind: str) -> None:
    x = np.round(noise(4000) * 64.0) / 64.0
    offset = round(offset * 64.0) / 64.0
    transform = get_transform(4000, RATE, [(3000.0, 9000.0)], rms_band=(0.0, 12_000.0))
    plain, shifted = transform(x.astype(kind)), transform((x + offset).astype(kind))
    # A float32 sample beside a large offset has kept only so many digits; the samples here lose none.
    assert shifted.mean == pytest.approx(plain.mean + offset, abs=1e-6 * max(1.0, abs(offset)))
    assert shifted.band_rms == pytest.approx(plain.band_rms, rel=1e-5)
    np.testing.assert_allclose(shifted.envelopes[0].amplitude, plain.envelopes[0].amplitude, atol=2e-5)


@given(st.floats(1e-25, 1e25))
@settings(max_examples=CASES)
def test_amplitudes_scale_with_the_signal(factor: float) -> None:
    x = noise(4000)
    transform = get_transform(4000, RATE, [(3000.0, 9000.0)], rms_band=(0.0, 12_000.0))
    plain, scaled = transform(x), transform(factor * x)
    assert plain.band_rms is not None
    assert scaled.band_rms == pytest.approx(factor * plain.band_rms, rel=1e-5)
    np.testing.assert_allclose(scaled.raw.amplitude, factor * plain.raw.amplitude, rtol=1e-3, atol=1e-6 * factor)
    found, expected = scaled.envelopes[0].amplitude / factor, plain.envelopes[0].amplitude
    np.testing.assert_allclose(found, expected, atol=1e-5)


@given(st.integers(1, 255))
@settings(max_examples=CASES)
def test_a_shift_of_a_periodic_signal_changes_no_amplitude(shift: int) -> None:
    ring = np.exp(-np.arange(256) / 20.0) * np.sin(2.0 * np.pi * 8000.0 / RATE * np.arange(256))
    x = np.tile(ring, 40)
    transform = get_transform(x.size, RATE, [(6000.0, 10_000.0)])
    plain, shifted = transform(x), transform(np.roll(x, shift))
    np.testing.assert_allclose(shifted.raw.amplitude, plain.raw.amplitude, atol=1e-6)
    low = slice(0, 5 * 40 + 3)
    atol = 1e-3 * float(plain.envelopes[0].amplitude.max())
    np.testing.assert_allclose(shifted.envelopes[0].amplitude[low], plain.envelopes[0].amplitude[low], atol=atol)


def test_float32_agrees_with_float64() -> None:
    x = noise(32_000)
    band = (7000.0, 9000.0)
    single, double = (
        BlockTransform(32_000, RATE, [band], rms_band=band, precision=p)(x) for p in ("float32", "float64")
    )
    assert single.band_rms == pytest.approx(double.band_rms, rel=1e-6)
    scale = float(double.envelopes[0].amplitude.max())
    np.testing.assert_allclose(single.envelopes[0].amplitude, double.envelopes[0].amplitude, atol=1e-5 * scale)


@pytest.mark.parametrize("kind", ["int16", "int32", "float32", "float64"])
def test_samples_of_any_type_are_taken_and_left_alone(kind: str) -> None:
    x = (1000.0 * noise(4000)).astype(kind)
    x.setflags(write=False)
    copy = x.copy()
    transform = get_transform(4000, RATE, [(3000.0, 9000.0)], rms_band=(0.0, 12_800.0))
    spectra = transform(x)
    np.testing.assert_array_equal(x, copy)
    assert spectra.band_rms == pytest.approx(float(x.astype(float).std()), rel=1e-3)
    kept = spectra.envelopes[0].amplitude.copy(), spectra.raw.amplitude.copy()
    transform(np.zeros(4000))
    np.testing.assert_array_equal(spectra.envelopes[0].amplitude, kept[0])
    np.testing.assert_array_equal(spectra.raw.amplitude, kept[1])


def test_several_bands_give_what_each_gives_alone() -> None:
    x = noise(8000)
    bands = [(1000.0, 3000.0), (7000.0, 9000.0), (500.0, 12_000.0)]
    together = BlockTransform(8000, RATE, bands)(x).envelopes
    for band, envelope in zip(bands, together, strict=True):
        alone = BlockTransform(8000, RATE, [band])(x).envelopes[0]
        np.testing.assert_array_equal(alone.amplitude, envelope.amplitude)
        assert alone.mean == envelope.mean
        assert alone.band == envelope.band == band


def test_a_line_on_a_bin_leaks_into_its_two_neighbours_only() -> None:
    n, f_m = 25_600, 100.0
    spectrum = BlockTransform(n, RATE, [(7000.0, 9000.0)])(modulated(n, RATE, (0.4,), f_m, 8000.0, 3.0)).envelopes[0]
    assert spectrum.mean == pytest.approx(3.0, rel=1e-5)
    np.testing.assert_allclose(spectrum.amplitude[98:103], [0.0, 0.6, 1.2, 0.6, 0.0], atol=1e-4)


def test_zeros_and_constants_are_silent() -> None:
    transform = get_transform(4000, RATE, [(3000.0, 9000.0)], rms_band=(0.0, 12_800.0))
    for value in (0.0, 0.1, -7e5, 1e-20):
        spectra = transform(np.full(4000, value))
        assert spectra.mean == pytest.approx(value)
        assert spectra.band_rms == 0.0
        assert not spectra.envelopes[0].amplitude.any()
        assert not spectra.raw.amplitude.any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e31])
def test_samples_that_are_no_numbers_are_refused(bad: float) -> None:
    x = noise(4000)
    x[7] = bad
    with pytest.raises(ValueError, match="samples must be finite"):
        get_transform(4000, RATE, [(3000.0, 9000.0)])(x)


@pytest.mark.parametrize("band", [(-1.0, 100.0), (9000.0, 7000.0), (7000.0, 7000.0), (7000.0, 12_801.0)])
def test_a_band_that_does_not_fit_is_refused_by_name(band: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="Nyquist"):
        band_bins(band, 8000, RATE)


def test_other_wrong_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="fewer than 4 bins"):
        band_bins((100.0, 105.0), 8000, RATE)
    with pytest.raises(ValueError, match="at least 64 samples"):
        fast_length(63)
    with pytest.raises(ValueError, match="planned for shape"):
        get_transform(4000, RATE, [(3000.0, 9000.0)])(np.zeros(4001))
    with pytest.raises(ValueError, match="rate must be positive"):
        BlockTransform(4000, 0.0, [(3000.0, 9000.0)])


def test_transforms_are_kept_for_each_thread_and_not_for_ever() -> None:
    first = get_transform(4000, RATE, [(3000.0, 9000.0)])
    assert get_transform(4000, RATE, [(3000.0, 9000.0)]) is first
    other: list[BlockTransform] = []
    thread = threading.Thread(target=lambda: other.append(get_transform(4000, RATE, [(3000.0, 9000.0)])))
    thread.start()
    thread.join()
    assert other[0] is not first
    for n in range(100, 120):
        get_transform(n, RATE, [(3000.0, 9000.0)])
    assert get_transform(4000, RATE, [(3000.0, 9000.0)]) is not first


def test_the_bits_are_the_same_whatever_was_measured_before() -> None:
    fftw, x = plans.load_fftw(), noise(5120)
    before = BlockTransform(5120, RATE, [(3000.0, 9000.0)])(x).envelopes[0].amplitude
    kept = fftw.export_wisdom()
    try:
        samples, spectrum = fftw.zeros_aligned(5120, "float32"), fftw.zeros_aligned(2561, "complex64")
        fftw.FFTW(samples, spectrum, flags=("FFTW_MEASURE",))
        learned = fftw.export_wisdom()
        after = BlockTransform(5120, RATE, [(3000.0, 9000.0)])(x).envelopes[0].amplitude
        np.testing.assert_array_equal(after, before)
        assert [set(w.split(b"\n")) for w in fftw.export_wisdom()] == [set(w.split(b"\n")) for w in learned]
    finally:
        fftw.forget_wisdom()
        fftw.import_wisdom(kept)
