"""The kurtosis of the complex envelope of a band, by sums over all samples: slow and obvious."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def band_kurtosis(x: NDArray[np.float64], first: int, count: int) -> float:
    """Return <|c|^4> / <|c|^2>^2 - 2 of the bins ``first`` to ``first + count - 1`` of the discrete Fourier transform.

    The envelope is evaluated at ``count`` moments, evenly spread over the signal.
    """
    n = x.size
    samples = np.arange(n)
    coefficients = [np.sum(x * np.exp(-2j * np.pi * k * samples / n)) for k in range(first, first + count)]
    moments = np.arange(count) / count
    envelope = np.zeros(count, dtype=np.complex128)
    for k, coefficient in enumerate(coefficients, start=first):
        envelope += coefficient * np.exp(2j * np.pi * k * moments)
    power = np.abs(envelope) ** 2
    return float(np.mean(power**2) / np.mean(power) ** 2 - 2.0)
