"""Doubts of signals: levels that no sensor gives, signals that are one signal, sensors that alternate."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from monitor.config.plausible.doubt import Doubt, Severity
from monitor.health.signal.quality import STOPPED_RMS
from streams.files.plausible import SignalLevel, of_one_g
from streams.types.block import STANDARD_GRAVITY, VELOCITY

_MAX_RMS_G, _MAX_PEAK_G = 100.0, 1000.0
_USUAL_RMS_G, _MAX_MEAN_G = 30.0, 10.0
_MIN_RMS_G = 1e-4
"""RMS below which a signal is the noise of a good accelerometer, or in another unit."""
_VELOCITY_RMS = (1e-3, 500.0)
_RESTING_RMS_G = STOPPED_RMS / STANDARD_GRAVITY
_BIAS = (7.0, 14.0)
"""Bias voltage of IEPE sensors, V."""
_OF_UNIT = ("gravity", "high_level", "low_level")
"""Rules that doubt the unit, and not the signal."""
_SAME_RESIDUAL = 1e-3
"""Residual of one signal fitted by another, over its RMS, below which both are one; sensors differ by their noise."""
_MAX_SQUARED = 1e150
_MIN_ALTERNATING, _MIN_RATIO, _MIN_GAP = 6, 1.3, 3.0
"""Fewest blocks, least ratio of the two levels, and least gap between them over the spread of each."""


def doubts(level: SignalLevel, unit: str, sensitivity_mv_per_g: float | None = None) -> list[Doubt]:
    """Return what makes a level in one of our units doubtful."""
    if level.constant:
        return [_doubt("constant", "a signal that varies", "all samples are equal: a dead sensor, or no sensor")]
    found: list[Doubt] = []
    if not level.finite:
        found.append(_doubt("numbers", "numbers", "it holds values that are no numbers"))
        if level.peak == 0.0:
            return found
    if level.clipped:
        words = f"{level.clipped:.1%} of the samples are at one end: the range of the input is too small"
        found.append(_doubt("clipping", "a range that holds the signal", words, "warning"))
    one_g = of_one_g(unit, sensitivity_mv_per_g)
    if unit == "V" and _BIAS[0] <= abs(level.mean) <= _BIAS[1]:
        words = f"its mean is {level.mean:.3g} V, the bias of an IEPE sensor, which the peak would contain"
        found.append(_doubt("bias", "the alternating part of the signal (AC coupling)", words))
    if one_g is not None:
        found += _level_doubts(level, unit, one_g)
    elif unit == VELOCITY:
        found += _velocity_doubts(level)
    return found


def _velocity_doubts(level: SignalLevel) -> list[Doubt]:
    """Return what is doubtful in a velocity, mm/s."""
    least, most = _VELOCITY_RMS
    expected, came = f"an RMS from {least:g} to {most:g} mm/s", f"an RMS of {level.rms:.3g} mm/s"
    if level.rms > most:
        words = f"{came} is more than machines have: is the unit another one, such as um/s, mV or counts?"
        return [_doubt("high_level", expected, words)]
    if level.rms < least:
        return [_doubt("low_level", expected, f"{came} is less than machines have: is the unit m/s?", "warning")]
    return []


def _level_doubts(level: SignalLevel, unit: str, one_g: float) -> list[Doubt]:
    """Return what is doubtful in a level whose unit says what one g is."""
    found: list[Doubt] = []
    mean, rms, peak = level.mean / one_g, level.rms / one_g, level.peak / one_g
    if unit == "g" and 9.3 <= abs(mean) <= 10.3:
        words = f"its mean is {level.mean:.3g} g, which is gravity in m/s2: is the unit m/s2?"
        found.append(_doubt("gravity", "a mean of 0, or 1 g of gravity", words))
    elif unit == "m/s2" and 0.95 <= abs(level.mean) <= 1.05 and level.rms < 5.0:
        words = f"its mean is {level.mean:.3g} m/s2, which is gravity in g: is the unit g?"
        found.append(_doubt("gravity", "a mean of 0, or 9.81 m/s2 of gravity", words))
    elif abs(mean) > max(_MAX_MEAN_G, rms):
        words = f"its mean is {mean:.3g} g, an offset that the peak would contain"
        found.append(_doubt("bias", f"a mean up to {_MAX_MEAN_G:g} g", words))
    if rms > _MAX_RMS_G or peak > _MAX_PEAK_G:
        words = (
            f"an RMS of {rms:.3g} g with peaks of {peak:.3g} g is more than machines have: is the unit another one, "
            "such as m/s2, mV or counts?"
        )
        found.append(_doubt("high_level", f"an RMS up to {_MAX_RMS_G:g} g, peaks up to {_MAX_PEAK_G:g} g", words))
    elif rms > _USUAL_RMS_G:
        words = f"an RMS of {rms:.3g} g is more than most machines have"
        found.append(_doubt("high_level", f"an RMS up to {_USUAL_RMS_G:g} g", words, "warning"))
    elif rms < _MIN_RMS_G:
        words = f"an RMS of {rms:.2g} g is less than the noise of usual sensors: is it V, or scaled twice?"
        found.append(_doubt("low_level", f"an RMS of at least {_MIN_RMS_G:g} g", words))
    elif rms < _RESTING_RMS_G:
        words = f"an RMS of {rms:.2g} g is that of a resting machine: such blocks have the flag stopped"
        found.append(_doubt("low_level", f"an RMS above {_RESTING_RMS_G:.2g} g while it runs", words, "warning"))
    return found


def _doubt(rule: str, expected: str, came: str, severity: Severity = "problem") -> Doubt:
    return Doubt(rule, severity, expected, came, ("unit",) if rule in _OF_UNIT else ())


def same_signals(rows: Mapping[str, NDArray[np.floating]]) -> list[tuple[str, str, float]]:
    """Return the pairs of rows of one length that are one signal, and the factor from the first to the second."""
    centred: dict[str, NDArray[np.float64]] = {}
    for name, row in rows.items():
        values = np.asarray(row, dtype=np.float64)
        if values.size > 2 and np.isfinite(values).all() and np.ptp(values) > 0.0:
            centred[name] = (values - values.mean()) / np.max(np.abs(values))
    sizes = {name: float(np.max(np.abs(rows[name]))) for name in centred}
    found: list[tuple[str, str, float]] = []
    names = list(centred)
    for at, first in enumerate(names):
        x = centred[first]
        for second in names[at + 1 :]:
            y = centred[second]
            if x.shape != y.shape:
                continue
            factor = float(x @ y / (x @ x))
            if np.linalg.norm(y - factor * x) < _SAME_RESIDUAL * np.linalg.norm(y):
                found.append((first, second, factor * sizes[second] / sizes[first]))
    return found


def shape_of(row: NDArray[np.floating]) -> tuple[float, float, float]:
    """Return three logarithms by which sensors differ: RMS, mean frequency (a sample), and crest factor of a row.

    They are NaN where the samples do not vary, or are too large to be squared.
    """
    values = np.asarray(row, dtype=np.float64)
    values = values[np.isfinite(values)]
    peak = float(np.max(np.abs(values), initial=0.0))
    if values.size < 3 or not 0.0 < peak < _MAX_SQUARED or np.ptp(values) == 0.0:
        return math.nan, math.nan, math.nan
    values = (values - values.mean()) / peak
    rms = float(np.sqrt(np.mean(values**2)))
    steps = float(np.sqrt(np.mean(np.diff(values) ** 2)))
    if not rms > 0.0:
        return math.nan, math.nan, math.nan
    return math.log(rms * peak), math.log(max(steps / rms, 1e-9)), math.log(float(np.max(np.abs(values))) / rms)


def alternates(values: Sequence[float]) -> float | None:
    """Return the ratio of the levels of every second block, where logarithms of levels alternate; None where not."""
    if len(values) < _MIN_ALTERNATING or not all(map(math.isfinite, values)):
        return None
    odd, even = np.asarray(values[0::2]), np.asarray(values[1::2])
    if odd.mean() < even.mean():
        odd, even = even, odd
    gap, spread = float(odd.min() - even.max()), float(max(np.ptp(odd), np.ptp(even)))
    if gap <= max(_MIN_GAP * spread, math.log(_MIN_RATIO)):
        return None
    return math.exp(float(odd.mean() - even.mean()))
