"""Synchronous average and indicators of a wheel, slowly: lines by projection on the samples, moments by loops."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def projected_lines(
    samples: NDArray[np.float64], turns: NDArray[np.float64], count: int, orders: int
) -> NDArray[np.complex128]:
    """Return the lines of the mean of the first ``count`` turns by an integral over the angle.

    Args:
        samples: (sample,).
        turns: (sample,) of the wheel at each sample, from 0.
        count: whole turns.
        orders: highest.
    """
    used = turns < count
    weight = np.gradient(turns)[used] / count
    return np.array(
        [
            (1.0 if k == 0 else 2.0) * np.sum(samples[used] * np.exp(-2j * np.pi * k * turns[used]) * weight)
            for k in range(orders + 1)
        ]
    )


def indicators(
    lines: NDArray[np.complex128], teeth: int, per_turn: int, others: tuple[int, ...] = ()
) -> dict[str, float]:
    """Return FM0, FM4, M6A, the numerator of NA4 over its variance squared, the sideband level and the variance.

    Args:
        lines: (order,) peak amplitudes of the mean turn.
        teeth: of the wheel.
        per_turn: samples of a turn.
        others: orders that another wheel has too.
    """
    angle = np.arange(per_turn) / per_turn

    def turn(left_out: set[int]) -> list[float]:
        total = np.zeros(per_turn)
        for k, line in enumerate(lines):
            if k not in left_out:
                total += np.real(line * np.exp(2j * np.pi * k * angle))
        return total.tolist()

    mesh = set(range(teeth, len(lines), teeth))
    sidebands = {z + sign for z in range(teeth, len(lines) + 1, teeth) for sign in (-1, 1)}
    regular = {0, 1, 2} | mesh | (set(others) - sidebands)
    x, r, d = turn(set()), turn(regular), turn(regular | sidebands)
    n = per_turn
    mean = sum(x) / n
    deviation = math.sqrt(sum((value - mean) ** 2 for value in x) / n)
    return {
        "fm0": (max(x) - min(x)) / sum(abs(lines[k]) for k in mesh),
        "fm4": n * sum(value**4 for value in d) / sum(value**2 for value in d) ** 2,
        "m6a": n**2 * sum(value**6 for value in d) / sum(value**2 for value in d) ** 3,
        "unlike": n * sum(value**4 for value in r) / sum(value**2 for value in r) ** 2,
        "sideband_level": (abs(lines[teeth - 1]) + abs(lines[teeth + 1])) / deviation,
        "variance": sum(value**2 for value in r) / n,
    }
