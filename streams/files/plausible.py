"""What a row of samples measures: mean, RMS, peak, and whether it is constant or clipped."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from streams.types.block import STANDARD_GRAVITY

_CLIPPED_SHARE = 1e-3
_MIN_CLIPPED, _MIN_STEPS = 10, 64


@dataclass(frozen=True)
class SignalLevel:
    """What a row of samples measures, in the unit in which it is stored.

    Attributes:
        mean: of the samples.
        rms: without the mean.
        peak: largest magnitude.
        constant: all samples are equal.
        clipped: share of the samples at one end of the range, where runs of them show a limit.
        finite: whether all samples are numbers.
    """

    mean: float
    rms: float
    peak: float
    constant: bool = False
    clipped: float = 0.0
    finite: bool = True

    def times(self, factor: float) -> SignalLevel:
        """Return the level of the samples times a factor."""
        size = abs(factor)
        return replace(self, mean=self.mean * factor, rms=self.rms * size, peak=self.peak * size)


def level_of(row: NDArray[np.floating]) -> SignalLevel:
    """Return the level of a row of samples; numbers that are not finite are left out."""
    values = np.asarray(row, dtype=np.float64)
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return SignalLevel(0.0, 0.0, 0.0, finite=False)
    # Damaged files hold any number.
    with np.errstate(over="ignore", invalid="ignore"):
        mean = float(np.mean(finite))
        rms = float(np.sqrt(np.mean((finite - mean) ** 2)))
    low, high = float(np.min(finite)), float(np.max(finite))
    clipped = max(_share_at(finite, finite == low), _share_at(finite, finite == high)) if high > low else 0.0
    return SignalLevel(
        mean=mean,
        rms=rms,
        peak=max(abs(low), abs(high)),
        constant=low == high,
        clipped=clipped,
        finite=finite.size == values.size,
    )


def _share_at(values: NDArray[np.float64], at_end: NDArray[np.bool_]) -> float:
    """Return the share of samples at an end of the range, 0 unless some follow each other there, as clipped ones do."""
    count = int(np.count_nonzero(at_end))
    if count < max(_MIN_CLIPPED, _CLIPPED_SHARE * values.size):
        return 0.0
    runs = bool(np.any(at_end[2:] & at_end[1:-1] & at_end[:-2]))
    # A coarsely quantised small signal meets its ends often.
    fine = np.unique(values[:: max(1, values.size // 4096)]).size > _MIN_STEPS
    return count / values.size if runs and fine else 0.0


def of_one_g(unit: str, sensitivity_mv_per_g: float | None) -> float | None:
    """Return what one g is in a unit, None where the unit does not say."""
    if unit == "V":
        return None if sensitivity_mv_per_g is None else 1e-3 * sensitivity_mv_per_g
    return {"g": 1.0, "m/s2": STANDARD_GRAVITY}.get(unit)
