"""The regression of a library: linear in its inputs and in random Fourier features of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
