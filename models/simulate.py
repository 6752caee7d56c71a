"""Simulate the settled vibration of a scene with the model that it names."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.dynamics.orbit import Motion, simulate_on
from models.dynamics.six_dof import (
    LEAST_IN_SEGMENT,
    MOST_STEPS,
    check_scene,
    damaged_rows,
    defect_arrays,
    operating_point,
    steps_for,
)
from models.kernels import settled as kernels
from models.kernels.lines import fourier_coefficients
from models.kernels.orbit import STATE_SCALE, jacobian, newton_steering
from models.kernels.period import mean_square
from models.kernels.period_setup import set_up
from models.kernels.settled import Effort
from models.kernels.step import P_DIRECTION_1, P_DIRECTION_2, P_U_1
from models.response import HARMONICS, Response, Status, check_band, peak_in_band

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.kernels.period import Period, Trace
    from models.scene import Scene

DEFAULT_ACCURACY = 1e-3
# Relative change of the RMS from period to period that counts as none, as a share of the accuracy.
SETTLING_SHARE = 1e-2
# A smaller one is rounding.
_LEAST_TOLERANCE = 1e-11
DEFAULT_MAX_PERIODS = 300
# Periods of the accelerated search on one grid.
SEARCHED = 60
# Times that a motion is simulated on before its level is taken as one that drifts.
_ROUNDS = 4
# Lines are computed up to here, Hz; the model is meant for recorders of up to 20 kHz.
LINES_TO = 30e3
# Lines above this share of the step rate are not resolved by the quadrature (half would be the Nyquist limit).
_RESOLVED = 0.4
# Grids, each with half the steps of the one before: enough for any accuracy that rounding allows.
_GRIDS = 12
# The Jacobian only steers the search for the orbit, so few steps suffice.
_JACOBIAN_STEPS = 96
_WORST_CONDITION = 1e10
# Estimated error of a line over its change by the last halving of the steps.
CHANGE_TO_ERROR = 1.0 / 3.0


def simulate(
    scene: Scene,
    *,
    accuracy: float = DEFAULT_ACCURACY,
    tolerance: float | None = None,
    steps_per_period: int | None = None,
    max_periods: int = DEFAULT_MAX_PERIODS,
    band: tuple[float, float] | None = None,
    lines_to: float | None = None,
    direction: float = 0.0,
) -> Response:
    """Return the settled vibration of a scene.

    Args:
        accuracy: relative error of the RMS that is asked for. Steps are halved until their estimated error is below
            it; ``Response.rms_error`` is the estimate, and the status ``inaccurate`` says that it is not met.
        tolerance: relative change of the RMS from period to period at which the motion counts as settled, by default
            a hundredth of the accuracy.
        steps_per_period: least steps in a ball period, instead of those that the accuracy asks for.
        max_periods: ball periods to simulate where the motion does not settle, at least 20; up to four times as many
            where its level still drifts.
        band: frequencies (lo, hi), Hz, in which RMS and peak are taken; None is the full bandwidth.
        lines_to: frequency up to which the lines of the spectrum are computed, Hz, raised to the end of the band; by
            default 30 kHz, or 0.4 of the step rate if that is less, beyond which the steps do not resolve them.
        direction: angle of the sensor from the load, rad.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    if scene.model != "six_dof":
        raise ValueError(f"unknown model {scene.model!r}; known are: six_dof")
    check_scene(scene)
    effort = effort_for(scene, accuracy, tolerance, steps_per_period, band)
    if lines_to is None:
        lines_to = LINES_TO
    elif steps_per_period is None:
        least = steps_to_resolve(lines_to, 1.0 / kinematics(scene.bearing, scene.speed).bpfo)
        effort = effort._replace(steps=max(effort.steps, math.ceil(0.5 * least)))
    if max_periods < 20:
        raise ValueError(f"max_periods must be at least 20, got {max_periods!r}")
    if not math.isfinite(direction):
        raise ValueError(f"direction must be finite, got {direction!r}")
    search = _Search(scene, effort, direction)
    orbit = search.settle(np.zeros((2, 6)))
    if orbit.stable:
        return _repeating(scene, orbit, effort, band, lines_to)
    # A motion near an unstable orbit does not stay there: it is simulated on from rest.
    begin, earlier = np.zeros((2, 6)) if orbit.settled else orbit.state, orbit.periods
    tolerance, count = effort.tolerance, _lines_to(scene, orbit.period, band, lines_to)
    motion, rounds = simulate_on(orbit.period, begin, max_periods, tolerance, count), 1
    while True:
        earlier += motion.periods
        if motion.settled:
            again = search.settle(motion.state)
            if again.stable:
                return _repeating(scene, again, effort, band, lines_to, earlier)
            tolerance = 0.0
        if motion.stationary or not np.all(np.isfinite(motion.state)) or rounds == _ROUNDS:
            break
        motion, rounds = simulate_on(orbit.period, motion.state, max_periods, tolerance, count), rounds + 1
    return _not_repeating(scene, motion, orbit, band, earlier)


def effort_for(
    scene: Scene,
    accuracy: float,
    tolerance: float | None = None,
    steps_per_period: int | None = None,
    band: tuple[float, float] | None = None,
    harmonics: int = HARMONICS,
) -> Effort:
    """Return how a scene is settled for an accuracy; arguments as in ``simulate``.

    Raises:
        ValueError: if an argument is unusable, or the scene needs too many steps; the message names it.
    """
    if not (math.isfinite(accuracy) and accuracy > 0.0):
        raise ValueError(f"accuracy must be positive and finite, got {accuracy!r}")
    tolerance = max(SETTLING_SHARE * accuracy, _LEAST_TOLERANCE) if tolerance is None else tolerance
    if not tolerance > 0.0:
        raise ValueError(f"tolerance must be positive, got {tolerance!r}")
    steps, grids = steps_for(scene), _GRIDS
    if steps_per_period is not None:
        if steps_per_period < 8:
            raise ValueError(f"steps_per_period must be at least 8, got {steps_per_period!r}")
        steps, grids = math.ceil(0.5 * steps_per_period), 2
    low, high = 1, 0
    if band is not None:
        bpfo = kinematics(scene.bearing, scene.speed).bpfo
        check_band(band)
        most = 2 * steps if grids == 2 else MOST_STEPS // 2
        if band[1] > _RESOLVED * most * bpfo:
            resolved = _RESOLVED * most * bpfo
            raise ValueError(f"the band ends at {band[1]!r} Hz, {most} steps resolve up to {resolved:.0f} Hz")
        low, high = max(1, math.ceil(band[0] / bpfo)), math.floor(band[1] / bpfo)
        steps = max(steps, math.ceil(0.5 * steps_to_resolve(band[1], 1.0 / bpfo)))
    return Effort(
        steps=steps,
        least=LEAST_IN_SEGMENT,
        grids=grids,
        most=MOST_STEPS,
        accuracy=accuracy,
        tolerance=tolerance,
        cap=SEARCHED,
        low=low,
        high=high,
        harmonics=harmonics,
    )


def steps_to_resolve(frequency: float, duration: float) -> int:
    """Return how many steps in ``duration`` s resolve lines up to a frequency, Hz."""
    return math.ceil(frequency * duration / _RESOLVED)


@dataclass(frozen=True, eq=False)
class _Orbit:
    """What a search found: period, state at its start, what it recorded, and the kernel's numbers (R_ constants)."""

    period: Period
    state: NDArray[np.float64]
    trace: Trace
    found: NDArray[np.float64]

    @property
    def settled(self) -> bool:
        return self.found[kernels.R_SETTLED] > 0.0

    @property
    def stable(self) -> bool:
        """Whether it repeats, and attracts what is near."""
        return self.settled and self.found[kernels.R_RADIUS] < 1.0

    @property
    def periods(self) -> int:
        return int(self.found[kernels.R_PERIODS])


class _Search:
    """Searches the motion of one scene that repeats."""

    def __init__(self, scene: Scene, effort: Effort, direction: float = 0.0) -> None:
        """Prepare what does not depend on where a search begins; ``direction`` is the sensor's, rad from the load."""
        healthy = replace(scene, defect=None)
        self._path, self._profile = defect_arrays(scene.bearing, scene.defect)
        self._rows, self._point = damaged_rows(scene.defect), operating_point(healthy)
        if direction != 0.0:
            parameter = self._point.parameter.copy()
            parameter[P_DIRECTION_1], parameter[P_DIRECTION_2] = math.cos(direction), math.sin(direction)
            self._point = self._point._replace(parameter=parameter)
        steer = steering(healthy)
        self._steering = np.eye(12) if steer is None else steer
        self._effort = effort

    def settle(self, begin: NDArray[np.float64]) -> _Orbit:
        """Search from a state, (2, 6)."""
        found = np.empty(kernels.R_LINES + 2 * self._effort.harmonics)
        solved = kernels.solve(
            self._path, self._profile, self._rows, self._point, begin, self._steering, self._effort, found
        )
        return _Orbit(*solved, found)


def _lines_to(scene: Scene, period: Period, band: tuple[float, float] | None, lines_to: float) -> int:
    """Return how many lines are computed: up to a frequency and the end of the band, as far as the steps resolve."""
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    resolved = _RESOLVED * len(period.nodes.turn) * bpfo
    wanted = lines_to if band is None else max(lines_to, band[1])
    return max(HARMONICS, math.ceil(min(wanted, resolved) / bpfo))


def _repeating(
    scene: Scene,
    orbit: _Orbit,
    effort: Effort,
    band: tuple[float, float] | None,
    lines_to: float,
    earlier: int = 0,
) -> Response:
    """Return the response of a motion that repeats."""
    period, found = orbit.period, orbit.found
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    coefficients = fourier_coefficients(orbit.trace, period, _lines_to(scene, period, band, lines_to))
    power = np.array([mean_square(orbit.trace, sensor) for sensor in (0, 1)])
    peak = np.max(np.abs(orbit.trace.wave), axis=0)
    error = float(found[kernels.R_ERROR])
    status: Status = "converged" if error <= effort.accuracy else "inaccurate"
    lines = found[kernels.R_LINES :].reshape(2, HARMONICS)
    return _response(
        *(scene, bpfo, band, coefficients, power, peak),
        periods=earlier + orbit.periods,
        change=float(found[kernels.R_CHANGE]),
        spread=0.0,
        error=error,
        multiplier=float(found[kernels.R_RADIUS]),
        harmonics_error=np.abs(lines[1]) * CHANGE_TO_ERROR,
        status=status,
    )


def _not_repeating(
    scene: Scene, motion: Motion, orbit: _Orbit, band: tuple[float, float] | None, periods: int
) -> Response:
    """Return the response of a motion that does not repeat."""
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    return _response(
        *(scene, bpfo, band, motion.coefficients, motion.power, motion.peak),
        periods=periods,
        change=motion.change,
        spread=motion.spread,
        error=motion.standard_error,
        multiplier=float(orbit.found[kernels.R_RADIUS]),
        harmonics_error=np.full(HARMONICS, math.nan),
        status="not_periodic" if motion.stationary else "not_converged",
    )


def _response(
    scene: Scene,
    bpfo: float,
    band: tuple[float, float] | None,
    coefficients: NDArray[np.complex128],
    power: NDArray[np.float64],
    peak: NDArray[np.float64],
    *,
    periods: int,
    change: float,
    spread: float,
    error: float,
    multiplier: float,
    harmonics_error: NDArray[np.float64],
    status: Status,
) -> Response:
    rms = np.sqrt(power)
    if band is not None:
        rms, peak = _levels_in_band(coefficients, bpfo, band)
    return Response(
        rms=float(rms[0]),
        rms_error=error,
        peak=float(peak[0]),
        rms_resonator=float(rms[1]),
        peak_resonator=float(peak[1]),
        bpfo=bpfo,
        harmonics=2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1]),
        harmonics_error=harmonics_error,
        periods=periods,
        period_change=change,
        spread=spread,
        multiplier=multiplier,
        model=scene.model,
        status=status,
        rms_band=band,
        coefficients=coefficients,
    )


def _levels_in_band(
    coefficients: NDArray[np.complex128], bpfo: float, band: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return RMS and peak of both sensors from the lines within a band, each of shape (2,)."""
    low, high = max(1, math.ceil(band[0] / bpfo)), math.floor(band[1] / bpfo)
    rms = np.sqrt(2.0 * np.sum(np.abs(coefficients[:, low : high + 1]) ** 2, axis=1))
    return rms, np.array([peak_in_band(row, low, high) for row in coefficients])


@lru_cache(maxsize=512)
def steering(scene: Scene) -> NDArray[np.float64] | None:
    """Return the matrix that steers the orbit search of scenes that differ from this healthy one in the defect only.

    It is the inverse of identity minus the scaled Jacobian of the healthy period map, shape (12, 12); None if that is
    ill-conditioned or not finite.
    """
    path, profile = defect_arrays(scene.bearing, None)
    point = operating_point(scene)
    period = set_up(path, profile, point, (0, 0), max(_JACOBIAN_STEPS, steps_for(scene)), 1, 1)
    approach = float(point.parameter[P_U_1]) - scene.clearance
    if approach <= 0.0:
        return None
    size = min(1e-2, 1e-2 * approach / STATE_SCALE[0])
    matrix = jacobian(np.zeros((2, 6)), period, size)
    if not np.all(np.isfinite(matrix)):
        return None
    inverse = newton_steering(matrix)
    if not np.linalg.norm(matrix) * np.linalg.norm(inverse) < _WORST_CONDITION:
        return None
    return inverse
