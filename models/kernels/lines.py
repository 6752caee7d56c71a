"""Kernel of the lines of a ball period."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.kernels.period import Period, Trace


@kernel
def lines(trace: Trace, time: NDArray[np.float64], first: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Return the Fourier coefficients 0..count of both sensors, shape (2, 2, count + 1): sensor, real and imaginary.

    The values of each segment are equally spaced, so that each line turns by the same angle from one to the next.
    """
    wave, weight, duration = trace.wave, trace.weight, time[-1]
    sums = np.zeros((2, 2, count + 1))
    c, s, step_c, step_s = np.empty(count + 1), np.empty(count + 1), np.empty(count + 1), np.empty(count + 1)
    for k in range(first.shape[0] - 1):
        start, end = first[k] + k, first[k + 1] + k
        angle = 2.0 * math.pi * time[start] / duration
        step = 2.0 * math.pi * (time[end] - time[start]) / duration / (end - start)
        for i in range(count + 1):
            c[i], s[i] = math.cos(i * angle), math.sin(i * angle)
            step_c[i], step_s[i] = math.cos(i * step), math.sin(i * step)
        for n in range(start, end + 1):
            a, b = weight[n] * wave[n, 0], weight[n] * wave[n, 1]
            for i in range(count + 1):
                sums[0, 0, i] += a * c[i]
                sums[0, 1, i] -= a * s[i]
                sums[1, 0, i] += b * c[i]
                sums[1, 1, i] -= b * s[i]
                turned = c[i] * step_c[i] - s[i] * step_s[i]
                s[i] = s[i] * step_c[i] + c[i] * step_s[i]
                c[i] = turned
        for n in range(first[k], first[k + 1]):
            if trace.changed[n]:
                _add_part(trace.parts, n, math.pi * (time[n + k] + time[n + k + 1]) / duration, sums)
    return sums


@kernel
def _add_part(parts: NDArray[np.float64], n: int, angle: float, sums: NDArray[np.float64]) -> None:
    """Add the share of a step in which contacts change, whose middle stands at ``angle`` of the first line."""
    for i in range(sums.shape[2]):
        c, s = math.cos(i * angle), math.sin(i * angle)
        sums[0, 0, i] += parts[n, 0] * c
        sums[0, 1, i] -= parts[n, 0] * s
        sums[1, 0, i] += parts[n, 1] * c
        sums[1, 1, i] -= parts[n, 1] * s


def fourier_coefficients(trace: Trace, period: Period, count: int) -> NDArray[np.complex128]:
    """Return the Fourier coefficients 0..count of the accelerations of a period, shape (sensors, count + 1)."""
    parts = lines(trace, period.time, period.first, count)
    return parts[:, 0] + 1j * parts[:, 1]
