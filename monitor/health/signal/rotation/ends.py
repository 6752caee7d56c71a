"""The angle before the first pulse of a block and after its last, by a polynomial over time through pulses beside.

Its degree and the pulses that it takes are those that best tell pulses of the block from the ones before them, and from
the ones after; how well they do is the error that is stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_TRIED = ((1, 3), (2, 5), (2, 9), (3, 6))
"""Degree and pulses of the polynomials that are tried."""
_PLACES = 24
"""Places in the block at which they are tried, in both directions."""
_SLOWER = 2.0
"""Largest ratio, either way, of the speed at an end to the mean of the last two pulses."""


@dataclass(frozen=True)
class Predictor:
    """How the angle beyond pulses is told.

    Attributes:
        degree: of the polynomial over time.
        pulses: that it takes.
        sd: standard deviation of its error at the next pulse, in marks.
    """

    degree: int
    pulses: int
    sd: float


def best_predictor(times: NDArray[np.float64], marks: NDArray[np.float64]) -> Predictor:
    """Choose how the angle beyond pulses is told.

    Args:
        times: shape (pulse,), s, rising; at least three.
        marks: shape (pulse,), how many marks had passed, rising.
    """
    found: list[Predictor] = []
    for degree, pulses in _TRIED:
        if times.size <= pulses:
            continue
        first = np.unique(np.linspace(0, times.size - pulses - 1, _PLACES).astype(np.intp))
        forward = first[:, np.newaxis] + np.arange(pulses + 1)
        window = np.concatenate((forward, forward[:, ::-1]))
        told = _told(times[window[:, :-1]], marks[window[:, :-1]], times[window[:, -1]], degree)
        away = told - marks[window[:, -1]]
        found.append(Predictor(degree, pulses, float(np.sqrt(np.mean(np.square(away))))))
    if found:
        return min(found, key=lambda predictor: predictor.sd)
    return Predictor(1, 2, 0.5)


def _told(
    times: NDArray[np.float64], marks: NDArray[np.float64], at: NDArray[np.float64], degree: int
) -> NDArray[np.float64]:
    """Return the polynomials through windows of pulses, (window, pulse), at a time of each, (window,), in marks."""
    span = times[:, -1:] - times[:, :1]
    powers = np.arange(degree + 1.0)
    design: NDArray[np.float64] = np.power(((times - at[:, np.newaxis]) / span)[:, :, np.newaxis], powers)
    across = design.transpose(0, 2, 1)
    base = marks[:, :1]
    # The first coefficient is the value at the time itself.
    found = np.linalg.solve(across @ design, across @ (marks - base)[:, :, np.newaxis])
    return found[:, 0, 0] + base[:, 0]


def end_knot(
    times: NDArray[np.float64], marks: NDArray[np.float64], at: float, predictor: Predictor
) -> tuple[float, float]:
    """Return the marks that have passed at a time beyond pulses, and the marks per second there.

    Args:
        times: shape (pulse,), s; the last ones are the nearest to ``at``, before it or after.
        marks: shape (pulse,).
        at: s.
        predictor: how it is told.
    """
    time, mark = times[-predictor.pulses :] - at, marks[-predictor.pulses :] - marks[-1]
    unit = float(np.ptp(time))
    powers = np.arange(min(predictor.degree, time.size - 1) + 1.0)
    design: NDArray[np.float64] = np.power((time / unit)[:, np.newaxis], powers)
    found = np.asarray(np.linalg.solve(design.T @ design, design.T @ mark), dtype=np.float64)
    speed, last = float(found[1]) / unit, float((marks[-1] - marks[-2]) / (times[-1] - times[-2]))
    ahead = at - float(times[-1])
    mean = float(found[0]) / ahead
    if not (last / _SLOWER < speed < last * _SLOWER and last / _SLOWER < mean < last * _SLOWER):
        return float(marks[-1]) + last * ahead, last
    return float(marks[-1] + found[0]), speed
