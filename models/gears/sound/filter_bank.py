# pyright: standard
"""Third-octave filters in time, class 1 of IEC 61260: the way of an analyser, independent of any FFT.

Butterworth band passes of order 2 * 6 whose corners are moved inwards so that the effective bandwidth is the band's:
white noise has the level that ideal edges would give. They are designed as poles in second-order sections and
transformed bilinearly with both corners prewarped; that steepens the upper skirt, by 0.3 dB per 25 dB at a tenth of the
rate and a quarter of it at each doubling of the rate.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from models.gears.sound.levels import ORDER, Bands, bandwidth_factor
from models.words.checks import check_positive

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

SETTLING = 6.0
"""Time left out at the begin, by the inverse bandwidth: what then still rings is 0.01 dB of a steady tone."""
HIGHEST = 0.45
"""Upper edge of the highest band by the rate, beyond which the transformation narrows a filter too much."""


def sections(centre: float, width: float, rate: float) -> NDArray[np.float64]:
    """Return second-order sections of the filter of a band, shape (``ORDER``, 6).

    Args:
        centre: geometric mean of the band's edges, Hz.
        width: between the edges, Hz.
        rate: samples a second.
    """
    from scipy.signal import butter

    half = 0.5 * width * bandwidth_factor()
    middle = math.hypot(centre, half)
    return np.asarray(butter(ORDER, (middle - half, middle + half), "bandpass", fs=rate, output="sos"), np.float64)


def filter_record(record: ArrayLike, rate: float, bands: Bands) -> NDArray[np.float64]:
    """Return the record through each filter, shape (bands, samples), from rest.

    Raises:
        ValueError: if a band reaches beyond ``HIGHEST`` of the rate.
    """
    from scipy.signal import sosfilt

    check_positive(rate=rate)
    _check_rate(bands, rate)
    values: Any = np.asarray(record, np.float64)
    widths = bands.upper - bands.lower
    rows = [sosfilt(sections(float(f), float(w), rate), values) for f, w in zip(bands.centre, widths, strict=True)]
    return np.asarray(rows, np.float64)


def bands_by_filters(record: ArrayLike, rate: float, bands: Bands) -> NDArray[np.float64]:
    """Return the mean square behind each filter, shape (bands,), without the time in which it settles.

    Args:
        record: (samples,), even samples a second.
        rate: samples a second.
        bands: the bands, up to ``HIGHEST`` of the rate.

    Raises:
        ValueError: if the record is shorter than twice the time in which the narrowest filter settles, or a band lies
            too high.
    """
    values = np.asarray(record, np.float64)
    settled = SETTLING / float(bands.upper[0] - bands.lower[0])
    if values.ndim != 1 or len(values) < 2.0 * settled * rate:
        wanted = f"one row of at least {2.0 * settled:.3g} s for the band of {bands.nominal[0]:g} Hz"
        raise ValueError(f"record must be {wanted}, got shape {values.shape} at {rate:g} Hz")
    starts = np.ceil(SETTLING * rate / (bands.upper - bands.lower)).astype(int)
    behind = filter_record(values, rate, bands)
    return np.array([np.mean(row[start:] ** 2) for row, start in zip(behind, starts, strict=True)])


def _check_rate(bands: Bands, rate: float) -> None:
    if bands.upper[-1] > HIGHEST * rate:
        top = f"the band of {bands.nominal[-1]:g} Hz reaches up to {bands.upper[-1]:.2f} Hz"
        raise ValueError(
            f"{top}, its filter needs a rate of at least {bands.upper[-1] / HIGHEST:.0f} Hz, got {rate:g} Hz"
        )
