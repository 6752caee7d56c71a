"""Slow reference of ``models.solve.six_dof.kernels.orbit.settle``: the same search, interpreted, for any period map."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from models.solve.six_dof.kernels.orbit import DEPTH, RESIDUAL_FLOOR, SILENCE, anderson

Floats = NDArray[np.float64]


class PeriodMap(Protocol):
    """One period of a model."""

    def run(self, state: Floats) -> tuple[Floats, int, float]:
        """Return the state one period later, a status, zero where it is finite, and the RMS over the period."""
        ...


def settle(
    period: PeriodMap,
    begin: Floats,
    scale: Floats,
    steering: Floats,
    plain: int,
    tolerance: float,
    cap: int,
) -> tuple[Floats, int, float, float, bool]:
    """Iterate until the RMS has settled or ``cap`` periods; return the last state and what the kernel returns."""
    x = begin.ravel() / scale
    last = x
    change, rms, calm = float("inf"), float("nan"), 0
    xs: list[Floats] = []
    fs: list[Floats] = []
    for number in range(1, cap + 1):
        last = x
        after, status, level = period.run((x * scale).reshape(2, 6))
        if status != 0:
            # The extrapolation left the basin: begin again at rest, plainly.
            x, change, rms, calm = np.zeros(12), float("inf"), float("nan"), 0
            xs.clear()
            fs.clear()
            continue
        change = 0.0 if max(level, rms) <= SILENCE else abs(level - rms) / max(level, SILENCE)
        if not np.isfinite(change):
            change = float("inf")
        calm = calm + 1 if change < tolerance else 0
        rms = level
        if calm >= 2:
            return (last * scale).reshape(2, 6), number, change, rms, True
        image = after.ravel() / scale
        # Residuals of rounding errors point nowhere.
        rounding = float(np.abs(image - x).max()) < RESIDUAL_FLOOR * float(np.abs(image).max())
        xs.append(x)
        fs.append(steering @ (image - x))
        del xs[: -DEPTH - 1], fs[: -DEPTH - 1]
        x = image
        if number > plain and not rounding:
            x = np.empty(12)
            anderson(np.array(xs), np.array(fs), len(xs), x)
    return (last * scale).reshape(2, 6), cap, change, rms, False
