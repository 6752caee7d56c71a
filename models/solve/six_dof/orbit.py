"""The settled motion of a periodically driven model: a fixed point of its map over one period, or what it is instead.

Plain iteration (simulating on) settles with the slowest mode of the contact, slowly with clearance and a light load.
Anderson acceleration of depth 5, with the residual preconditioned by the Jacobian of the healthy bearing, needs several
times fewer periods. The steered residual estimates the distance to the orbit: where it falls fast, the search knows
what is left and ends without a period that shows it. It also finds fixed points that repel: a motion near them does not
stay there. The Jacobian of the period map at the fixed point tells them apart (Floquet multipliers); where one is
beyond the unit circle, or nothing was found, the motion is simulated on plainly, from rest or from where the search
ended. So it is where the rings part for a moment in the orbit that was found: other motions, some of which never
repeat, can exist beside it, and then the one that begins at rest is reported.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.solve.six_dof.kernels.orbit import SILENCE
from models.solve.six_dof.kernels.period import ball_period, blank_trace, mean_square
from models.solve.six_dof.kernels.settled import fourier_coefficients, largest
from models.solve.six_dof.kernels.step import STATUS_OK

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.period import Period

# Shares of the periods that are simulated on: dropped at the beginning, then averaged.
_DROPPED = 0.3
# Standard errors by which the levels of two spans may differ, and parts of a half that these come from.
_SAME = 4.0
_PARTS = 5


@dataclass(frozen=True, eq=False)
class PeriodicMotion:
    """A motion that was simulated on plainly.

    Attributes:
        state: at its end, (2, 6).
        periods: that were simulated.
        change: relative change of the RMS of the casing between the last two.
        settled: whether it came to repeat; the levels are then unknown.
        power: mean squares of both sensors over the periods that were kept, m2/s4, (2,).
        peak: largest absolute values, m/s2, (2,).
        coefficients: Fourier coefficients of the last period with the mean power of all that were kept, m/s2,
            (2, lines + 1).
        levels, peaks: RMS and largest absolute value of the casing in each period that was kept, m/s2.
    """

    state: NDArray[np.float64]
    periods: int
    change: float
    settled: bool
    power: NDArray[np.float64]
    peak: NDArray[np.float64]
    coefficients: NDArray[np.complex128]
    levels: NDArray[np.float64]
    peaks: NDArray[np.float64]

    @property
    def rms(self) -> float:
        """RMS of the casing over the periods that were kept, m/s2."""
        return math.sqrt(float(self.power[0]))

    @property
    def peak_spread(self) -> float:
        """Standard deviation of the peaks of the periods over the largest."""
        return float(np.std(self.peaks)) / float(self.peak[0]) if self.peak[0] > 0.0 else math.nan

    @property
    def spread(self) -> float:
        """Standard deviation of the RMS from period to period, m/s2."""
        return float(np.std(self.levels)) if len(self.levels) else math.nan

    @property
    def standard_error(self) -> float:
        """Relative standard error of the RMS, from means of ten parts: neighbouring periods are alike."""
        squares = self.levels**2
        if len(squares) < 20 or not squares.any():
            return math.nan
        parts = np.array([part.mean() for part in np.array_split(squares, 10)])
        return 0.5 * float(np.std(parts, ddof=1)) / math.sqrt(10.0) / float(squares.mean())

    @property
    def stationary(self) -> bool:
        """Whether the level neither drifts nor steps, within its scatter.

        The first quarter is compared with the last half, and the last quarter with the first half, each within the
        scatter of that half: the scatter of the whole would be as wide as what is sought.
        """
        squares = self.levels**2
        if len(squares) < 20:
            return False
        half, quarter = len(squares) // 2, len(squares) // 4
        for side, other in ((squares[half:], squares[:quarter]), (squares[:half], squares[-quarter:])):
            parts = [part.mean() for part in np.array_split(side, _PARTS)]
            # Of the mean over the half, and over a quarter with twice its variance; a cycle of a few periods leaves
            # the parts alike and yet the ends of spans unlike.
            error = math.sqrt(max(3.0 * float(np.var(parts, ddof=1)) / _PARTS, float(np.var(side)) / quarter))
            if abs(float(np.mean(side) - np.mean(other))) > max(_SAME * error, 1e-3 * float(np.mean(squares))):
                return False
        return True

    def near(self, level: float, distance: float) -> bool:
        """Whether the levels of the last quarter are all within a relative distance of one, m/s2."""
        last = self.levels[-max(1, len(self.levels) // 4) :]
        return len(last) > 0 and bool(np.all(np.abs(last - level) <= distance * level))


def simulate_on(
    period: Period, state: NDArray[np.float64], periods: int, tolerance: float, count: int
) -> PeriodicMotion:
    """Simulate plainly until the motion repeats or ``periods`` periods are over.

    Args:
        state: to begin from, (2, 6).
        tolerance: relative change of the RMS from period to period that counts as none; it repeats where the change
            stays below it three times in succession.
        count: of the lines.
    """
    trace, after = blank_trace(period), np.empty((2, 6))
    state = state.copy()
    power, peak, spectrum = np.zeros(2), np.zeros(2), np.zeros((2, count + 1))
    last = np.zeros((2, count + 1), dtype=np.complex128)
    levels: list[float] = []
    peaks: list[float] = []
    rms, change, calm, done = math.nan, math.inf, 0, 0
    while done < periods and calm < 3:
        done += 1
        if ball_period(state, after, trace, period) != STATUS_OK:
            none = np.empty(0)
            return PeriodicMotion(
                state, done, math.inf, False, power * math.nan, peak * math.nan, last * math.nan, none, none
            )
        state[:] = after
        squares = np.array([mean_square(trace, k) for k in (0, 1)])
        before, rms = rms, math.sqrt(squares[0])
        change = 0.0 if max(rms, before) <= SILENCE else abs(rms - before) / max(rms, SILENCE)
        calm = calm + 1 if change < tolerance else 0
        if done > _DROPPED * periods:
            last = fourier_coefficients(trace, period, count)
            power += squares
            spectrum += np.abs(last) ** 2
            highest = np.array([largest(trace, period.first, np.int64(k)) for k in (0, 1)])
            peak = np.maximum(peak, highest)
            levels.append(rms)
            peaks.append(float(highest[0]))
    kept = max(len(levels), 1)
    size = np.abs(last)
    phases = np.where(size > 0.0, last / np.where(size > 0.0, size, 1.0), 1.0)
    return PeriodicMotion(
        state=state,
        periods=done,
        change=change,
        settled=calm >= 3,
        power=power / kept,
        peak=peak,
        coefficients=np.sqrt(spectrum / kept) * phases,
        levels=np.array(levels),
        peaks=np.array(peaks),
    )
