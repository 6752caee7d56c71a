"""The spectra of one block.

What is kept of a block to be looked at: its raw spectrum and the beginning of its waveform.

The spectrum has all lines up to 1 kHz, where shaft, bearing and velocity are read, and above that the highest line in
each of 2048 bins up to the Nyquist frequency: 50 kB a block instead of 250.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.orders import Warp
from monitor.health.signal.velocity import Velocity

FINE_HZ, MAX_FINE_LINES = 1000.0, 12_800
HIGHEST_BINS = 2048
WAVEFORM_SAMPLES = 16_384
"""Samples of the waveform that are kept: 0.64 s at 25,600 Hz."""


@dataclass(frozen=True, eq=False)
class RawSpectra:
    """Single-sided amplitude spectrum of the Hann-windowed block; a line of amplitude A on a bin reads A there.

    Attributes:
        resolution: spacing of the lines, Hz.
        amplitude: (n,) every line from 0 Hz, in the unit of the samples.
        width: of the bins of ``highest``, Hz.
        highest: (m,) highest line in each bin, from 0 Hz to the Nyquist frequency.
    """

    resolution: float
    amplitude: NDArray[np.floating]
    width: float
    highest: NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class BlockView:
    """What is kept of a block.

    Attributes:
        rate: sampling rate, Hz.
        samples: of the whole block.
        waveform: (n,) its first samples, m/s2 or in the channel's unknown unit, the mean included.
        ias: spectrum of the angular speed, rad/s over events per revolution in place of Hz; None where pulses do not
            give one, and but for one channel of a source.
    """

    rate: float
    samples: int
    spectra: RawSpectra
    waveform: NDArray[np.floating]
    ias: RawSpectra | None = None


def raw_spectra(spectrum: NDArray[np.complexfloating], n_used: int, rate: float, scale: float = 1.0) -> RawSpectra:
    """Return the spectra of a block.

    Args:
        spectrum: (n_used // 2 + 1,) real FFT of the samples, without window or scaling.
        n_used: samples.
        rate: sampling rate, Hz.
        scale: factor on the samples.
    """
    resolution = rate / n_used
    # The Hann window is a convolution with [-1/4, 1/2, -1/4]; the last line, Nyquist's, is left out.
    lines = spectrum.view(spectrum.real.dtype)
    parts = lines[2:-2] - 0.5 * (lines[:-4] + lines[4:])
    parts *= parts
    power = np.zeros(spectrum.size - 1, dtype=parts.dtype)
    np.add(parts[::2], parts[1::2], out=power[1:])
    factor = 2.0 / (n_used * scale)
    fine = min(power.size, MAX_FINE_LINES, math.floor(FINE_HZ / resolution) + 1)
    each = max(1, math.ceil(power.size / HIGHEST_BINS))
    starts = np.arange(0, power.size, each)
    return RawSpectra(
        resolution=resolution,
        amplitude=np.sqrt(power[:fine]) * factor,
        width=each * resolution,
        highest=np.sqrt(np.maximum.reduceat(power, starts)) * factor,
    )


Band = tuple[float, float]


@dataclass(frozen=True, eq=False)
class AmplitudeSpectrum:
    """Single-sided amplitude spectrum of a Hann-windowed signal.

    Attributes:
        resolution: spacing of the bins, Hz; bin k stands at k times it.
        amplitude: (n_bins,) in the unit of the signal; a line of amplitude A on a bin reads A there and A/2 beside it,
            so the root of the sum of squares over its bins, divided by sqrt(1.5), is A on and off a bin.
    """

    resolution: float
    amplitude: NDArray[np.floating]

    @property
    def frequency(self) -> NDArray[np.float64]:
        """(n_bins,) frequency of each bin, Hz."""
        return np.arange(self.amplitude.size, dtype=np.float64) * self.resolution


@dataclass(frozen=True, eq=False)
class EnvelopeSpectrum(AmplitudeSpectrum):
    """Spectrum of the envelope (Eq. 95) of one band, its mean removed, up to the width of the band or a lower limit.

    Attributes:
        band: (lo, hi) of the demodulated band, Hz.
        mean: mean of the envelope, in the unit of the signal.
        mesh_factor: speed of the shaft over the stated one, as the mesh of gears shows it; None where none stands high.
    """

    band: Band
    mean: float
    mesh_factor: float | None = None


@dataclass(frozen=True, eq=False)
class BlockSpectra:
    """Result of the transform of one block.

    Attributes:
        n_used: samples used; the rest at the end are cut for a fast length.
        rate: sampling rate, Hz.
        mean: mean of the used samples.
        band_rms: RMS within ``rms_band``, by Parseval's theorem; None without such a band.
        raw: spectrum of the signal up to ``raw_limit``.
        envelopes: one per band.
        velocity: RMS of the velocity from 10 to 1000 Hz.
        view: raw spectrum to be looked at, where it is asked for; always over time.
        warp: by which ``raw`` and ``envelopes`` are over the angle of the shaft; None: they are over time.
    """

    n_used: int
    rate: float
    mean: float
    band_rms: float | None
    raw: AmplitudeSpectrum
    envelopes: tuple[EnvelopeSpectrum, ...]
    velocity: Velocity
    view: RawSpectra | None = None
    warp: Warp | None = None
