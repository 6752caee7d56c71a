"""The regression of a library: linear in its inputs and in random Fourier features of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

ACCELERATION = 0.1
"""Probability that growth accelerates at once, whatever the past tells: then what is left of TT is any share of it.
Found on the development lives of ``benchmarks.unseen.seeds``."""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def accelerated(left: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what is left where growth accelerates, s: so many that ``ACCELERATION`` is their share.

    Args:
        left: ascending sample of the time to a threshold, s.
    """
    count = round(ACCELERATION / (1.0 - ACCELERATION) * len(left))
    if count == 0:
        return np.zeros(0)
    # Shares and times are paired by a sequence that fills the square evenly.
    levels = [(k * _GOLDEN) % 1.0 for k in range(1, count + 1)]
    return (np.arange(count) + 0.5) / count * np.interp(levels, np.linspace(0.0, 1.0, len(left)), left)


Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Regression:
    """A ridge regression on inputs and on random Fourier features of them (Rahimi and Recht, 2007).

    Attributes:
        centre: mean of each input, shape (d,).
        scale: standard deviation of each input, shape (d,).
        weights: frequencies of the random features, shape (d, c).
        phases: their phases, shape (c,).
        coefficients: shape (1 + d + c, targets).
    """

    centre: Array
    scale: Array
    weights: Array
    phases: Array
    coefficients: Array

    def design(self, x: Array) -> Array:
        """Return the regressors of inputs (n, d), clipped at three SD, shape (n, 1 + d + c)."""
        z = np.clip((x - self.centre) / self.scale, -3.0, 3.0)
        return np.concatenate((np.ones((len(z), 1)), z, np.cos(z @ self.weights + self.phases)), axis=1)

    def predict(self, x: Array) -> Array:
        """Return the targets of inputs (n, d), shape (n, targets)."""
        return self.design(x) @ self.coefficients
