"""Kernel of the lines of a ball period.

Kernel of the largest acceleration in a ball period, between the recorded values too.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.period import Period, Trace


@kernel
def largest(wave: NDArray[np.float64], first: NDArray[np.int64], sensor: int, stride: int) -> float:
    """Return the largest absolute value of a sensor, as seen at every ``stride``-th value of each segment.

    Between three of them it is that of the parabola through them, where that has its vertex there. ``wave`` and
    ``first``: see models.solve.six_dof.kernels.period.
    """
    found = 0.0
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        for n in range(start, end + 1, stride):
            at = wave[n, sensor]
            size = abs(at)
            if n - stride >= start and n + stride <= end:
                before, after = wave[n - stride, sensor], wave[n + stride, sensor]
                slope, bend = 0.5 * (after - before), after - 2.0 * at + before
                if at * bend < 0.0 and abs(slope) < abs(bend):
                    size += 0.5 * slope * slope / abs(bend)
            found = max(found, size)
    return found


@kernel
def _fill_turns(angle: float, c: NDArray[np.float64], s: NDArray[np.float64]) -> None:
    """Write cosine and sine of the multiples 0, 1, ... of an angle, each from the one before."""
    c_1, s_1 = math.cos(angle), math.sin(angle)
    c[0], s[0] = 1.0, 0.0
    for i in range(1, c.shape[0]):
        c[i], s[i] = c[i - 1] * c_1 - s[i - 1] * s_1, s[i - 1] * c_1 + c[i - 1] * s_1


@kernel
def lines(
    trace: Trace, time: NDArray[np.float64], first: NDArray[np.int64], count: int, sensors: int
) -> NDArray[np.float64]:
    """Return the Fourier coefficients 0..count of a period, (sensors, 2, count + 1): sensor, real and imaginary part.

    The values of each segment are equally spaced, so that each line turns by the same angle from one to the next.

    Args:
        trace, time, first: of the period (models.solve.six_dof.kernels.period).
        count: of the last line.
        sensors: 1 for the casing, 2 for the resonator as well.
    """
    wave, weight, duration = trace.wave, trace.weight, time[-1]
    sums = np.zeros((sensors, 2, count + 1))
    c, s, step_c, step_s = np.empty(count + 1), np.empty(count + 1), np.empty(count + 1), np.empty(count + 1)
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        _fill_turns(2.0 * math.pi * (time[end] - time[start]) / duration / (end - start), step_c, step_s)
        for sensor in range(sensors):
            real, imaginary = sums[sensor, 0], sums[sensor, 1]
            _fill_turns(2.0 * math.pi * time[start] / duration, c, s)
            for n in range(start, end + 1):
                a = weight[n] * wave[n, sensor]
                for i in range(count + 1):
                    real[i] += a * c[i]
                    imaginary[i] -= a * s[i]
                    turned = c[i] * step_c[i] - s[i] * step_s[i]
                    s[i] = s[i] * step_c[i] + c[i] * step_s[i]
                    c[i] = turned
        for n in range(first[k], first[k + 1]):
            if trace.changed[n]:
                _fill_turns(math.pi * (time[n + k] + time[n + k + 1]) / duration, c, s)
                for sensor in range(sensors):
                    for i in range(count + 1):
                        sums[sensor, 0, i] += trace.parts[n, sensor] * c[i]
                        sums[sensor, 1, i] -= trace.parts[n, sensor] * s[i]
    return sums


def fourier_coefficients(trace: Trace, period: Period, count: int) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..count of the accelerations of a period, shape (sensors, count + 1)."""
    parts = lines(trace, period.time, period.first, count, 2)
    return parts[:, 0] + 1j * parts[:, 1]
