"""Time-domain indicators of Ceruti (thesis, section 4.2) and of Sassi et al. (J. Vib. Control 13, 2007, Table 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MAX_SAMPLE = 1e30
"""Larger samples are refused: their fourth powers would leave float32."""

MIN_RANGE = 1e-30
"""A block whose samples differ by less is flat."""

_CHUNK = 65536
"""Samples processed at a time, so that their powers stay in the cache."""

_SUMMED, _MULTIPLIED = 16384, 1024
"""Samples, and products of them, that are summed in their own type; these sums are added as float64."""


@dataclass(frozen=True)
class TimeIndicators:
    """Indicators of one block of samples x, in the unit of x or dimensionless.

    A flat block (all samples within ``MIN_RANGE``) has rms, half range, kurtosis, skewness and all factors 0.

    Attributes:
        rms: without the mean, over the full bandwidth.
        peak: max |x|, mean included.
        peak_half_range: (max x - min x) / 2, Ceruti's peak value.
        kurtosis: fourth central moment over the squared variance (Gaussian noise: 3).
        skewness: third central moment over the variance to 3/2.
        crest_factor: peak / rms.
        shape_factor: rms / mean |x|.
        impulse_factor: peak / mean |x|.
        clearance_factor: peak / (mean sqrt |x|)^2.
    """

    mean: float
    rms: float
    peak: float
    peak_half_range: float
    kurtosis: float
    skewness: float
    crest_factor: float
    shape_factor: float
    impulse_factor: float
    clearance_factor: float
    flat: bool


def time_indicators(x: NDArray[np.number], span: tuple[float, float] | None = None) -> TimeIndicators:
    """Return the time-domain indicators of one block.

    The ratios are those of Sassi: the peak is max |x|, where Ceruti takes half the range. RMS leaves out the mean, near
    zero for accelerometers. The clearance factor has the root that Ceruti's formula means: printed is that of x^2.

    Args:
        x: (n_samples,), real; float32 is processed as such, everything else as float64.
        span: what :func:`sample_range` gives for it, where that is known.

    Raises:
        ValueError: no samples, another dimension, or a sample that is not finite or beyond ``MAX_SAMPLE``.
    """
    if x.ndim != 1 or x.size == 0:
        raise ValueError(f"expected samples of shape (n,), n >= 1, got shape {x.shape}")
    low, high = sample_range(x) if span is None else span
    peak = max(abs(low), abs(high))
    half_range = 0.5 * (high - low)
    if high - low < MIN_RANGE:
        return TimeIndicators(0.5 * (low + high), 0.0, peak, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, flat=True)
    # In units of a power of two near the peak, so that fourth powers neither overflow nor vanish and no digit is lost.
    unit = math.ldexp(1.0, math.frexp(peak)[1])
    mean = float(x.mean(dtype=np.float64))
    spread = math.ldexp(1.0, math.frexp(half_range)[1])
    moments, mean_abs, mean_root = _sums(x, unit, mean / unit, spread / unit)
    rms = math.sqrt(moments[0]) * spread
    mean_abs *= unit
    return TimeIndicators(
        mean=mean,
        rms=rms,
        peak=peak,
        peak_half_range=half_range,
        kurtosis=moments[2] / moments[0] ** 2,
        skewness=moments[1] / moments[0] ** 1.5,
        crest_factor=peak / rms,
        shape_factor=rms / mean_abs,
        impulse_factor=peak / mean_abs,
        clearance_factor=peak / (mean_root**2 * unit),
        flat=False,
    )


def span_of(x: NDArray[np.number]) -> tuple[float, float]:
    """Return the least and the largest sample, NaN where any is; ValueError where there is none."""
    return float(x.min()), float(x.max())


def sample_range(x: NDArray[np.number], span: tuple[float, float] | None = None) -> tuple[float, float]:
    """Return the least and the largest sample; ``span`` is what :func:`span_of` gives, where that is known.

    Raises:
        ValueError: a sample is not finite or beyond ``MAX_SAMPLE``.
    """
    low, high = span_of(x) if span is None else span
    if not (low > -MAX_SAMPLE and high < MAX_SAMPLE):
        raise ValueError(f"samples must be finite and below {MAX_SAMPLE:g}, the block has {low:g} to {high:g}")
    return low, high


def _sums(
    x: NDArray[np.number], unit: float, centre: float, spread: float
) -> tuple[tuple[float, float, float], float, float]:
    """Return central moments 2 to 4 in units of ``spread``, mean |x| and mean sqrt |x|; x in units of ``unit``."""
    work = np.float32 if x.dtype == np.float32 else np.float64
    scaled, square, other = (np.empty(min(_CHUNK, x.size), work) for _ in range(3))
    second = third = fourth = absolute = root = 0.0
    factor = work(1.0 / unit)
    # The mean in two parts: with a large offset its rounding to float32 would bias the third moment.
    coarse = work(centre)
    rest = work((centre - float(coarse)) / spread)
    for start in range(0, x.size, _CHUNK):
        part = x[start : start + _CHUNK]
        u, u2, v = scaled[: part.size], square[: part.size], other[: part.size]
        np.multiply(part, factor, out=u, casting="same_kind")
        np.abs(u, out=v)
        np.sqrt(v, out=v)
        absolute += _sum_of_squares(v)
        root += _sum(v)
        u -= coarse
        u *= work(1.0 / spread)
        u -= rest
        np.multiply(u, u, out=u2)
        second += _sum(u2)
        np.multiply(u2, u, out=v)
        third += _sum(v)
        fourth += _sum_of_squares(u2)
    n = x.size
    return (second / n, third / n, fourth / n), absolute / n, root / n


def _sum(values: NDArray[np.floating]) -> float:
    """Return the sum of values, shape (n,)."""
    whole = values.size - values.size % _SUMMED
    total = float(values[whole:].sum()) if whole < values.size else 0.0
    return sum(values[:whole].reshape(-1, _SUMMED).sum(axis=1).tolist(), total) if whole else total


def _sum_of_squares(values: NDArray[np.floating]) -> float:
    """Return the sum of the squares of values, shape (n,)."""
    whole = values.size - values.size % _MULTIPLIED
    rows, rest = values[:whole].reshape(-1, _MULTIPLIED), values[whole:]
    return float(np.vecdot(rows, rows).sum(dtype=np.float64)) + float(np.vecdot(rest, rest))
