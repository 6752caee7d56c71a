"""The spectra of one block."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.block_view import RawSpectra
from monitor.health.signal.orders import Warp
from monitor.health.signal.velocity import Velocity

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
