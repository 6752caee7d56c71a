"""One pass in the frequency domain: from a block of samples to its raw and envelope spectra.

One planned real FFT of the block serves everything. For each band its bins are copied to the start of a short array
whose inverse FFT is the analytic signal of that band, shifted to zero frequency and decimated (Eqs. 94-95 need only its
magnitude, which the shift does not change). The spacing of the bins stays one over the duration, so no frequency axis
is resampled. Spectra are single-sided, of Hann-windowed signals; a line on a bin reads its amplitude.

With the angle of the shaft, the envelopes and the raw spectrum are over that angle (:mod:`monitor.health.signal.
orders`), on an axis in Hz of a shaft at the mean speed of the block; all else stays over time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.indicators import MIN_RANGE, sample_range
from monitor.health.signal.interference import Comb, envelope_beside, fixed_combs, remove_lines
from monitor.health.signal.orders import Warp, angle_amplitude, order_amplitude, warp_of
from monitor.health.signal.plans import FftPlan, Precision, envelope_length, kept_by_thread, planning, previous_smooth
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.spectra import AmplitudeSpectrum as AmplitudeSpectrum
from monitor.health.signal.spectra import Band as Band
from monitor.health.signal.spectra import BlockSpectra as BlockSpectra
from monitor.health.signal.spectra import EnvelopeSpectrum as EnvelopeSpectrum
from monitor.health.signal.spectra import raw_spectra
from monitor.health.signal.velocity import velocity_of

MIN_SAMPLES = 64
"""Shorter blocks are refused."""

OVERSAMPLING = 4.0
"""Samples of the envelope per bin of its band.

The envelope has no band limit: what lies above half of this rate folds back (``python -m benchmarks.features``).
"""

_CACHED_TRANSFORMS = 16
_EXPONENT_LIMIT = 40


def fast_length(n_samples: int) -> int:
    """Return the largest length up to ``n_samples`` whose prime factors are 2, 3 and 5 only.

    Raises:
        ValueError: the block is shorter than ``MIN_SAMPLES``.
    """
    if n_samples < MIN_SAMPLES:
        raise ValueError(f"a block needs at least {MIN_SAMPLES} samples, got {n_samples}")
    return previous_smooth(n_samples)


def band_bins(band: Band, n_used: int, rate: float) -> tuple[int, int]:
    """Return the first and the last bin of a band, both included, never the mean nor the Nyquist bin.

    Raises:
        ValueError: the band is empty, reversed, below zero or above the Nyquist frequency.
    """
    lo, hi = band
    if not (0.0 <= lo < hi <= 0.5 * rate):
        raise ValueError(f"band must satisfy 0 <= lo < hi <= {0.5 * rate:g} Hz (Nyquist), got {lo:g} to {hi:g} Hz")
    resolution = rate / n_used
    # The tolerance of a billionth of a bin keeps an edge on a bin inside despite rounding.
    first = max(1, math.ceil(lo / resolution - 1e-9))
    last = min((n_used - 1) // 2, math.floor(hi / resolution + 1e-9))
    if last - first < 3:
        raise ValueError(f"band {lo:g} to {hi:g} Hz holds fewer than 4 bins of {resolution:g} Hz")
    return first, last


class _EnvelopePlan:
    """Analytic signal to envelope spectrum for one length, shared by bands of equal length.

    It takes the workspace of the samples, of at least that length, for the envelope, and that of the analytic signal
    for the spectrum: the arrays of a long block are larger than the cache.
    """

    def __init__(self, n_samples: int, n_used: int, precision: Precision, workspace: NDArray[np.floating]) -> None:
        self.n = n_samples
        self.scale = 2.0 / n_used
        self.analytic = FftPlan(n_samples, "inverse", precision)
        self.envelope = FftPlan(n_samples, "real", precision, source=workspace, target=self.analytic.output)
        hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_samples) / n_samples)
        # 2/n_used makes the analytic signal of the bins, 4/n the Hann-windowed line amplitude of its envelope.
        self.window = (hann * self.scale * (4.0 / n_samples)).astype(precision)
        self._filled = 0

    def __call__(self, bins: NDArray[np.complexfloating], n_keep: int) -> tuple[NDArray[np.floating], float]:
        """Return the first ``n_keep`` amplitudes of the envelope spectrum, and the mean of the envelope."""
        mean = self._demodulate(bins)
        self.envelope.input[:] *= self.window
        self.envelope.execute()
        return np.abs(self.envelope.output[:n_keep]), mean * self.scale

    def in_orders(
        self, bins: NDArray[np.complexfloating], first: int, warp: Warp, limit: float, combs: Sequence[Comb]
    ) -> tuple[NDArray[np.floating], float]:
        """Return the amplitudes of the envelope spectrum up to a limit, Hz, and the mean, both over the angle.

        Args:
            bins: of the band; ``first`` is the number of the first of them.
            combs: of the shaft, which are removed before.
        """
        if combs:
            mean, envelope = 0.0, envelope_beside(bins, first, warp, combs, self.n)
            amplitude, rest = angle_amplitude(envelope, warp, limit)
        else:
            mean = self._demodulate(bins)
            self.envelope.execute()
            below = self.envelope.output[: (self.n + 1) // 2]
            amplitude, rest = order_amplitude(below, self.n, warp, limit)
        amplitude *= amplitude.dtype.type(self.scale)
        return amplitude, (mean + rest) * self.scale

    def _demodulate(self, bins: NDArray[np.complexfloating]) -> float:
        """Leave the envelope of a band, its mean removed, in the workspace; return the mean, not scaled."""
        workspace = self.analytic.input
        workspace[: bins.size] = bins
        workspace[bins.size : self._filled] = 0
        self._filled = bins.size
        self.analytic.execute()
        envelope = self.envelope.input
        np.abs(self.analytic.output, out=envelope)
        mean = envelope.mean()
        envelope -= mean
        return float(mean)


class BlockTransform:
    """The plans and the workspace for blocks of one length, rate and set of bands.

    An instance owns its workspace and must not be used by two threads at once; ``get_transform`` gives each thread its
    own. The samples are not written to, and the results do not point into the workspace.
    """

    def __init__(
        self,
        n_samples: int,
        rate: float,
        bands: Sequence[Band],
        *,
        rms_band: Band | None = None,
        raw_limit: float | None = None,
        envelope_limit: float = math.inf,
        precision: Precision = "float32",
        oversampling: float = OVERSAMPLING,
    ) -> None:
        """Plan the transforms.

        Args:
            n_samples: length of the blocks; it is cut to the fast length below.
            rms_band: band of the RMS, Hz, or None.
            raw_limit: highest frequency of the raw spectrum, Hz, or None for the Nyquist frequency.
            envelope_limit: highest frequency of the envelope spectra, Hz; they are no wider than their bands.
            precision: storage and arithmetic of the transforms.

        Raises:
            ValueError: a band does not fit below the Nyquist frequency, or the block is too short.
        """
        if not (math.isfinite(rate) and rate > 0.0):
            raise ValueError(f"rate must be positive and finite, got {rate!r} Hz")
        self.n_samples = n_samples
        self.n_used = fast_length(n_samples)
        self.rate = rate
        self.bands = tuple(bands)
        self.resolution = rate / self.n_used
        self._bins = [band_bins(band, self.n_used, rate) for band in self.bands]
        self._rms_bins = None if rms_band is None else band_bins(rms_band, self.n_used, rate)
        limit = 0.5 * rate if raw_limit is None else min(raw_limit, 0.5 * rate)
        self._n_raw = min(self.n_used // 2, math.floor(limit / self.resolution)) + 1
        self._n_envelope = math.floor(min(envelope_limit, 0.5 * rate) / self.resolution) + 1
        with planning():
            self._forward = FftPlan(self.n_used, "real", precision)
            plans: dict[int, _EnvelopePlan] = {}
            self._envelope_plans: list[_EnvelopePlan] = []
            for first, last in self._bins:
                length = envelope_length(last - first + 1, self.n_used, oversampling)
                if length not in plans:
                    plans[length] = _EnvelopePlan(length, self.n_used, precision, self._forward.input)
                self._envelope_plans.append(plans[length])

    def __call__(
        self,
        x: NDArray[np.number],
        span: tuple[float, float] | None = None,
        interference: Sequence[Comb] = (),
        *,
        rotation: Rotation | None = None,
        needed: tuple[float, float] = (math.inf, math.inf),
        view: bool = False,
    ) -> BlockSpectra:
        """Return the spectra of one block.

        Args:
            x: (n_samples,), any real type.
            span: what ``sample_range`` gives for x, where that is known.
            interference: combs that are removed before the envelopes; raw spectrum and RMS keep them.
            rotation: of the shaft over the block: raw spectrum and envelopes are over its angle, up to
                ``MAX_SPEED_RATIO``; beyond, and without it, they are over time.
            needed: frequencies up to which raw spectrum and envelopes over the angle are made, Hz, within the limits.
            view: whether the spectrum to be looked at is asked for.

        Raises:
            ValueError: another shape, a sample that is not finite or beyond 1e30, or a rotation of another duration.
        """
        if x.shape != (self.n_samples,):
            raise ValueError(f"the transform is planned for shape ({self.n_samples},), got {x.shape}")
        warp = None if rotation is None else self._warp(rotation)
        used = x[: self.n_used]
        mean, scale = self._load(used, sample_range(used) if span is None or used.size < x.size else span)
        self._forward.execute()
        spectrum = self._forward.output
        raw = self._raw_amplitude(spectrum) if warp is None else self._raw_in_orders(spectrum, warp, needed[0])
        band_rms = None if self._rms_bins is None else _rms(spectrum, self._rms_bins, self.n_used) / scale
        velocity = velocity_of(spectrum, self.n_used, self.rate, scale)
        seen = raw_spectra(spectrum, self.n_used, self.rate, scale) if view else None
        of_shaft = [comb for comb in interference if comb.of_shaft] if warp else []
        interference = fixed_combs(interference) if warp else interference
        mesh: float | None = None
        if interference:
            low, high = min(low for low, _ in self.bands), max(high for _, high in self.bands)
            mesh = remove_lines(spectrum, self.resolution, interference, low, high)
        resolution = self.resolution if warp is None else warp.resolution
        envelopes: list[EnvelopeSpectrum] = []
        for band, (first, last), plan in zip(self.bands, self._bins, self._envelope_plans, strict=True):
            n_keep = min(last - first + 1, plan.n // 2 + 1, self._n_envelope)
            bins = spectrum[first : last + 1]
            limit = min((n_keep - 1) * self.resolution, needed[1])
            amplitude, level = (
                plan(bins, n_keep) if warp is None else plan.in_orders(bins, first, warp, limit, of_shaft)
            )
            if scale != 1.0:
                amplitude = amplitude.astype(np.float64) / scale
            envelopes.append(EnvelopeSpectrum(resolution, amplitude, band, level / scale, mesh))
        if scale != 1.0:
            raw = raw.astype(np.float64) / scale
        return BlockSpectra(
            n_used=self.n_used,
            rate=self.rate,
            mean=mean,
            band_rms=band_rms,
            raw=AmplitudeSpectrum(resolution, raw),
            envelopes=tuple(envelopes),
            velocity=velocity,
            view=seen,
            warp=warp,
        )

    def _warp(self, rotation: Rotation) -> Warp | None:
        duration = self.n_samples / self.rate
        if abs(rotation.duration - duration) * self.rate > 0.5:
            raise ValueError(f"the block lasts {duration:g} s, its rotation {rotation.duration:g} s")
        return warp_of(rotation, self.n_used / self.rate)

    def _load(self, x: NDArray[np.number], span: tuple[float, float]) -> tuple[float, float]:
        """Load the samples less their mean; return the mean and the factor applied."""
        low, high = span
        workspace = self._forward.input
        if high - low < MIN_RANGE:
            workspace[:] = 0
            return 0.5 * low + 0.5 * high, 1.0
        # Pairwise sums in the samples' own type are exact enough: what is left of the mean is in bin 0, not used.
        mean = float(x.sum()) / x.size
        exponent = math.frexp(high - low)[1]
        if abs(exponent) <= _EXPONENT_LIMIT:
            np.subtract(x, mean, out=workspace, casting="same_kind")
            return mean, 1.0
        # Powers of two are exact, and keep the squares of very large or small samples inside float32.
        scale = math.ldexp(1.0, -exponent)
        workspace[:] = (x.astype(np.float64) - mean) * scale
        return mean, scale

    def _raw_in_orders(self, spectrum: NDArray[np.complexfloating], warp: Warp, needed: float) -> NDArray[np.floating]:
        """Hann-windowed amplitude of the signal over the angle."""
        limit = min((self._n_raw - 1) * self.resolution, needed)
        below = spectrum[: (self.n_used + 1) // 2]
        amplitude, _ = order_amplitude(below, self.n_used, warp, limit)
        amplitude[0] = 0.0
        return amplitude

    def _raw_amplitude(self, spectrum: NDArray[np.complexfloating]) -> NDArray[np.floating]:
        """Hann-windowed amplitude of the lowest bins: the window is a convolution with [-1/4, 1/2, -1/4]."""
        n = self._n_raw
        if n == 1:
            return np.zeros(1, spectrum.real.dtype)
        middle = spectrum[:n] * spectrum.real.dtype.type(2.0 / self.n_used)
        middle[1:] -= spectrum[: n - 1] * spectrum.real.dtype.type(1.0 / self.n_used)
        n_right = min(n, spectrum.size - 1)
        middle[:n_right] -= spectrum[1 : n_right + 1] * spectrum.real.dtype.type(1.0 / self.n_used)
        amplitude = np.abs(middle)
        amplitude[0] = 0.0
        return amplitude


def _rms(spectrum: NDArray[np.complexfloating], bins: tuple[int, int], n_used: int) -> float:
    """Return the RMS over some bins of a real signal's transform, without the mean and Nyquist bins."""
    first, last = bins
    parts = spectrum[first : last + 1].view(spectrum.real.dtype)
    return math.sqrt(2.0 * float(np.sum(parts * parts))) / n_used


_kept_transform = kept_by_thread(BlockTransform, _CACHED_TRANSFORMS)


def get_transform(
    n_samples: int,
    rate: float,
    bands: Sequence[Band],
    precision: Precision = "float32",
    *,
    rms_band: Band | None = None,
    raw_limit: float | None = None,
    envelope_limit: float = math.inf,
) -> BlockTransform:
    """Return this thread's transform for such blocks; the 16 used last are kept.

    Arguments and errors are those of ``BlockTransform``.
    """
    return _kept_transform(
        n_samples,
        rate,
        tuple(bands),
        rms_band=rms_band,
        raw_limit=raw_limit,
        envelope_limit=envelope_limit,
        precision=precision,
    )
