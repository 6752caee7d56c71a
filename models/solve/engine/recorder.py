"""How a recorder samples a signal that was simulated with whole numbers of steps a sample."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.solve.response import PASSBAND
from models.words.numerics import filter_valid, kaiser_order

if TYPE_CHECKING:
    from numpy.typing import NDArray

_STOPBAND_DB = 80.0


def anti_alias_filter(oversampling: int) -> NDArray[np.float64]:
    """Return the taps (an odd number) of the filter before every ``oversampling``-th sample is kept."""
    width = (1.0 - PASSBAND) / oversampling
    count, beta = kaiser_order(_STOPBAND_DB, width)
    half = count // 2 + 1
    cutoff = 0.5 * (1.0 + PASSBAND) / oversampling
    taps = cutoff * np.sinc(cutoff * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


def margin_of(oversampling: int) -> int:
    """Return half the filter's length, samples."""
    return math.ceil(len(anti_alias_filter(oversampling)) // 2 / oversampling)


def sampled_at(signal: NDArray[np.float64], oversampling: int, first: int, samples: int) -> NDArray[np.float64]:
    """Return a signal as a recorder samples it, from sample ``first`` on."""
    taps = anti_alias_filter(oversampling)
    half, begin = len(taps) // 2, first * oversampling
    return filter_valid(signal[begin - half : begin + (samples - 1) * oversampling + half + 1], taps)[::oversampling]
