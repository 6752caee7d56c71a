"""Acceleration of a sensor that measures a velocity: its signal times i omega, up to a frequency.

Noise of the sensor grows with the frequency, so that there is no acceleration beyond that to which the sensor measures.
The differences of neighbouring samples are transformed, and what differences do to each frequency is undone exactly. A
block is no period of its signal: it goes on beyond its ends as its mirror image, which is faded out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.plans import FftPlan, kept_by_thread, next_smooth, planning

USUAL_LIMIT = 2000.0
"""Highest frequency of usual velocity sensors (electrodynamic, or integrating), Hz."""
_CACHED_PLANS = 4
_FADED_PERIODS = 32.0
"""Length of the mirror image at each end, in periods of the highest frequency."""
_ROLL_OFF = 0.1
"""Share of the highest frequency within which what lies above it fades: a sharp edge would ring."""


class _Derivative:
    """Plans, factors and fade for blocks of one length, whose highest frequency is a share of the sampling rate."""

    def __init__(self, n: int, share: float) -> None:
        self.beyond = min(n - 1, math.ceil(_FADED_PERIODS / min(share, 0.5)))
        length = next_smooth(n - 1 + 2 * self.beyond)
        with planning():
            self.forward = FftPlan(length, "real", "float64")
            self.back = FftPlan(length, "synthesis", "float64")
        half_turn = np.pi * np.arange(length // 2 + 1) / length
        self.factor = np.exp(-1j * half_turn) / (np.sinc(half_turn / np.pi) * length)
        beyond = np.clip((np.arange(half_turn.size) / (share * length) - 1.0) / _ROLL_OFF, 0.0, 1.0)
        self.factor *= np.cos(0.5 * np.pi * beyond) ** 2
        self.fade = np.sin(0.5 * np.pi * (np.arange(self.beyond) + 0.5) / self.beyond) ** 2

    def __call__(self, velocity: NDArray[np.floating], rate: float) -> NDArray[np.float64]:
        steps, at, n = self.forward.input, self.beyond, velocity.size
        end = at + n - 1
        steps[end + at :] = 0.0
        np.subtract(velocity[1:], velocity[:-1], out=steps[at:end], dtype=np.float64)
        steps[at:end] *= rate
        steps[:at] = steps[at : 2 * at][::-1] * self.fade
        steps[end : end + at] = steps[end - at : end][::-1] * self.fade[::-1]
        self.forward.execute()
        np.multiply(self.forward.output, self.factor, out=self.back.input)
        self.back.execute()
        return self.back.output[at : at + n]


_kept_derivative = kept_by_thread(_Derivative, _CACHED_PLANS)


def acceleration_of(velocity: NDArray[np.floating], rate: float, limit: float) -> NDArray[np.floating]:
    """Return the acceleration of a velocity up to a frequency, of the same shape (sample,) and precision.

    Args:
        velocity: m/s gives m/s2; finite, at least two samples.
        rate: sampling rate, Hz.
        limit: highest frequency to which it holds, Hz, with nothing from a tenth above.
    """
    return _kept_derivative(velocity.size, limit / rate)(velocity, rate).astype(velocity.dtype)
