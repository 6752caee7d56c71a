"""Whether the level of a signal is one that a sensor on a machine gives."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from streams.types.block import STANDARD_GRAVITY

_MOST_RMS_G, _MOST_PEAK_G = 100.0, 1000.0
_LEAST_RMS_G = 1e-4
"""RMS below which a signal is the noise of a good accelerometer, or in another unit."""
_BIAS = (7.0, 14.0)
"""Bias voltage of IEPE sensors, V."""
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


def doubts(level: SignalLevel, unit: str, sensitivity_mv_per_g: float | None = None) -> list[str]:
    """Return sentences on what makes a level in a unit ("g", "m/s2", "V", "unknown") doubtful."""
    if level.constant:
        return ["all samples are equal: a dead sensor, or no sensor"]
    found: list[str] = []
    if not level.finite:
        found.append("it holds values that are no numbers")
    if level.clipped:
        found.append(f"{level.clipped:.1%} of the samples are at one end: the range of the input is too small")
    one_g = of_one_g(unit, sensitivity_mv_per_g)
    if unit == "V" and _BIAS[0] <= abs(level.mean) <= _BIAS[1]:
        found.append(f"its mean is {level.mean:.3g} V, the bias of an IEPE sensor: only the alternating part counts")
    if one_g is None:
        return found
    mean, rms, peak = level.mean / one_g, level.rms / one_g, level.peak / one_g
    if unit == "g" and 9.3 <= abs(mean) <= 10.3:
        found.append(f"its mean is {level.mean:.3g} g, which is gravity in m/s2: is the unit m/s2?")
    elif unit == "m/s2" and 0.95 <= abs(level.mean) <= 1.05 and level.rms < 5.0:
        found.append(f"its mean is {level.mean:.3g} m/s2, which is gravity in g: is the unit g?")
    if rms > _MOST_RMS_G or peak > _MOST_PEAK_G:
        found.append(
            f"an RMS of {rms:.3g} g with peaks of {peak:.3g} g is more than machines have: is the unit another one, "
            "such as m/s2, mV or counts?"
        )
    elif rms < _LEAST_RMS_G:
        found.append(f"an RMS of {rms:.2g} g is less than the noise of usual sensors: is it V, or scaled twice?")
    return found
