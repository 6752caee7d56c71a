"""The settled motion of a periodically driven model: a fixed point of its map over one period.

Plain iteration (simulating on) settles with the slowest mode of the contact, slowly with clearance and a light load.
Anderson acceleration of depth 5, with the residual preconditioned by the Jacobian of the healthy bearing, needs several
times fewer periods. Where it does not settle the motion is simulated plainly; a status says if it does not repeat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from models.kernels.orbit import SILENCE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.response import Status

# Sizes of the state that count as one: displacements, velocities, and for the stiff resonator a smaller displacement.
STATE_SCALE = np.array([1e-6, 1e-2, 1e-6, 1e-2, 2e-7, 1e-2])
SCALE = np.tile(STATE_SCALE, 2)
WINDOW = 40
ACCELERATED = 60


class PeriodMap(Protocol):
    """One period of a model, and the search for its settled motion: see models.dynamics.six_dof.BallPeriod."""

    @property
    def weight(self) -> NDArray[np.float64]:
        """Weights of the recorded values, so that ``weight @ x`` is a mean over the period."""
        ...

    def run(self, state: NDArray[np.float64], wave: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        """Return the state one period later and a status; write the accelerations."""
        ...

    def settle(
        self,
        state: NDArray[np.float64],
        wave: NDArray[np.float64],
        scale: NDArray[np.float64],
        steering: NDArray[np.float64],
        tolerance: float,
        cap: int,
    ) -> tuple[NDArray[np.float64], int, float, float, bool]:
        """Return the last state, periods, relative change and value of the RMS, and whether it settled."""
        ...

    def new_wave(self) -> NDArray[np.float64]:
        """Return an array that ``run`` can write to."""
        ...


@dataclass(frozen=True, eq=False)
class Orbit:
    """The settled motion.

    Attributes:
        waves: accelerations over the last period, or over WINDOW periods where it does not repeat, shape
            (periods kept, values, sensors), m/s2.
        state: at the start of the last period, shape (2, 6).
        period_change: relative change of the RMS of sensor 0 between the last two of ``periods`` that were simulated.
        spread: standard deviation of that RMS from period to period, m/s2; zero where the motion repeats.
        status: "converged", "not_periodic" (bounded and stationary, but it does not repeat), "not_converged".
    """

    waves: NDArray[np.float64]
    state: NDArray[np.float64]
    periods: int
    period_change: float
    spread: float
    status: Status


@dataclass
class _Watch:
    """Count periods; the RMS has settled after two successive changes below the tolerance."""

    period: PeriodMap
    tolerance: float
    periods: int
    change: float
    rms: float
    calm: int = 0

    def run(self, state: NDArray[np.float64], wave: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the state one period later, or None where it left the finite numbers."""
        after, status = self.period.run(state, wave)
        self.periods += 1
        if status != 0:
            self.calm, self.change, self.rms = 0, float("inf"), float("nan")
            return None
        rms = float(np.sqrt(max(0.0, self.period.weight @ (wave[:, 0] * wave[:, 0]))))
        self.change = 0.0 if max(rms, self.rms) <= SILENCE else abs(rms - self.rms) / max(rms, SILENCE)
        if not np.isfinite(self.change):
            self.change = float("inf")
        self.calm = self.calm + 1 if self.change < self.tolerance else 0
        self.rms = rms
        return after

    @property
    def settled(self) -> bool:
        return self.calm >= 2


def find_orbit(
    period: PeriodMap, *, tolerance: float, max_periods: int, steering: NDArray[np.float64] | None = None
) -> Orbit:
    """Return the settled motion, starting from the static equilibrium at rest.

    Args:
        tolerance: relative change of the RMS that counts as none; it must stay below it twice in succession.
        max_periods: periods to simulate at most, at least 2 (fewer than 4 cannot settle).
        steering: approximation of (identity minus Jacobian)^-1 of the scaled period map, by which residuals are
            multiplied, shape (12, 12); None is the identity.

    Raises:
        ValueError: if tolerance is not positive or max_periods is less than 2.
    """
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be positive, got {tolerance!r}")
    if max_periods < 2:
        raise ValueError(f"max_periods must be at least 2, got {max_periods!r}")
    wave, cap = period.new_wave(), min(ACCELERATED, max_periods)
    steering = np.eye(12) if steering is None else steering
    state, periods, change, rms, settled = period.settle(np.zeros((2, 6)), wave, SCALE, steering, tolerance, cap)
    if settled:
        return Orbit(wave[None], state, periods, change, 0.0, "converged")
    return _simulate_on(_Watch(period, tolerance, periods, change, rms), wave, state, max_periods)


def _simulate_on(watch: _Watch, wave: NDArray[np.float64], state: NDArray[np.float64], max_periods: int) -> Orbit:
    """Simulate plainly until the motion settles; where it does not, keep the last WINDOW periods and judge them."""
    window = min(WINDOW, max(2, max_periods // 4))
    values: list[float] = []
    waves: list[NDArray[np.float64]] = []
    while watch.periods < max_periods and not watch.settled:
        here = state
        after = watch.run(here, wave)
        state = np.zeros((2, 6)) if after is None else after
        if after is None:
            values.clear()
            waves.clear()
            continue
        values.append(watch.rms)
        waves.append(wave.copy())
        del values[:-window], waves[:-window]
        if watch.settled:
            return Orbit(wave[None], here, watch.periods, watch.change, 0.0, "converged")
    if not waves:
        return Orbit(wave[None], state, watch.periods, watch.change, float("nan"), "not_converged")
    spread = float(np.std(values))
    half = len(values) // 2
    early, late = float(np.mean(values[:half] or values)), float(np.mean(values[half:]))
    stationary = half >= 2 and abs(early - late) <= 3.0 * spread * np.sqrt(2.0 / half)
    status: Status = "not_periodic" if stationary else "not_converged"
    return Orbit(np.array(waves), state, watch.periods, watch.change, spread, status)


def period_jacobian(period: PeriodMap, size: float = 1e-2) -> NDArray[np.float64]:
    """Return the Jacobian of the scaled period map minus identity at the equilibrium, by differences, (12, 12).

    ``size`` of the differences in scaled coordinates must be small against the static approach of the contacts.
    """
    scale, wave = SCALE, period.new_wave()
    base = period.run(np.zeros((2, 6)), wave)[0].ravel() / scale
    columns: list[NDArray[np.float64]] = []
    for k in range(12):
        x = np.zeros(12)
        x[k] = size
        columns.append((period.run((x * scale).reshape(2, 6), wave)[0].ravel() / scale - base) / size)
    return np.array(columns).T - np.eye(12)
