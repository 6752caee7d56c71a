"""The six-degree-of-freedom model solved for one ball period: scenes that nothing but the ball passages drives.

The motion that repeats is searched with steps that are halved until the estimated error is within what is asked
(models.solve.six_dof.kernels.settled). Where it is unstable, or none is found, the motion is simulated on
(models.solve.six_dof.orbit).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.rig import Rig
from models.solve.registry import Solver
from models.solve.response import HARMONICS, Response, Status, band_lines, judged, levels_of_lines, lines_error
from models.solve.six_dof.derivatives import check_derivatives, of_orbit, withheld
from models.solve.six_dof.kernels import settled as kernels
from models.solve.six_dof.kernels.errors import Q_LINES, Q_RMS, Q_WAVE
from models.solve.six_dof.kernels.period_setup import set_up
from models.solve.six_dof.kernels.settled import Effort, fourier_coefficients, largest
from models.solve.six_dof.kernels.step import P_DIRECTION_1, P_DIRECTION_2, P_U_1
from models.solve.six_dof.orbit import PeriodicMotion, simulate_on
from models.solve.six_dof.setup import (
    DERIVATIVES,
    LEAST_IN_SEGMENT,
    MODEL,
    MOST_STEPS,
    PERIODIC_EFFECTS,
    check_resonance,
    check_scene,
    defect_arrays,
    operating_point,
    periodic_cost,
    steps_for,
)
from models.words.request import Request

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Derivative
    from models.solve.six_dof.kernels.period import Period, PeriodTrace
    from models.words.request import Quantity

# What the kernel halves the steps for; the volume is told by the RMS.
_QUANTITIES: dict[Quantity, int] = {"waveform": Q_WAVE, "rms": Q_RMS, "lines": Q_LINES, "v_eq": Q_RMS}
# Share of the accuracy of a waveform that is left to its steps: where it is summed from lines it is less exact.
_OF_WAVE = 0.25
# Relative change of the RMS from period to period that counts as none, as a share of the accuracy.
SETTLING_SHARE = 1e-2
# Periods of the accelerated search on one grid.
SEARCHED = 60
# Times that a motion is simulated on before its level is taken as one that drifts.
_ROUNDS = 4
# Beside a stable orbit in which the rings part, a motion from rest is given this many times the decay time of the
# slowest disturbance, and this many periods at most (transients can last for thousands: docs/evidence/engine.md).
_DECAY_TIMES = 2.0
_MOST_PERIODS = 4000
# Relative distance of all its last levels from that of an orbit within which it has come to it.
_NEAR = 1e-2
# Lines are computed up to here, Hz, and up to this number; the model is meant for recorders of up to 20 kHz.
LINES_TO = 30e3
LINES = 10_000
# More would take longer than the motion itself.
MOST_LINES = 50_000
# Lines above this share of the step rate are not resolved by the quadrature (half would be the Nyquist limit).
_RESOLVED = 0.4
# Of a waveform, at which the quadrature leaves a smaller error than the steps.
_RESOLVED_WAVE = 0.2
# Grids, each with half the steps of the one before: enough for any accuracy that rounding allows.
_GRIDS = 12
# The Jacobian only steers the search for the orbit, so few steps suffice.
_JACOBIAN_STEPS = 96
_WORST_CONDITION = 1e10
# Standard errors of a mean over ten parts that bound its error in 95 of 100 (Student).
_SURE = 2.26
# No finer accuracy is asked of the steps.
_LEAST_ERROR = 1e-9
# A smaller peak counts as zero, m/s2.
_SMALL = 1e-9


def solve(scene: Scene, request: Request) -> Response:
    """Return the settled vibration of a scene that repeats with the ball passage.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_scene(scene)
    if request.derivatives:
        check_derivatives(scene, request.derivatives)
    return judged(_solve(scene, request), request)


def _solve(scene: Scene, request: Request) -> Response:
    """Return the response with steps at which its quantity meets the accuracy of a request."""
    effort = effort_for(scene, request)
    search = _Search(scene, effort, request.direction)
    orbit = search.settle(np.zeros((2, 6)))
    if orbit.stable and not orbit.doubted:
        return _repeating(scene, orbit, request)
    # A motion near an unstable orbit does not stay there, and beside a stable one there may be others: it is simulated
    # on from rest.
    begin, earlier = np.zeros((2, 6)) if orbit.settled else orbit.state, orbit.periods
    tolerance, count, periods = effort.tolerance, _line_count(scene, orbit.period, request), request.max_periods
    if orbit.stable:
        periods = max(periods, min(math.ceil(_DECAY_TIMES / (1.0 - orbit.multiplier)), _MOST_PERIODS))
    motion, rounds = simulate_on(orbit.period, begin, periods, tolerance, count), 1
    while True:
        earlier += motion.periods
        if motion.settled:
            again = search.settle(motion.state)
            if again.stable:
                return _repeating(scene, again, request, earlier)
            tolerance = 0.0
        if motion.stationary or not np.all(np.isfinite(motion.state)) or rounds == _ROUNDS:
            break
        motion, rounds = simulate_on(orbit.period, motion.state, periods, tolerance, count), rounds + 1
    if orbit.stable and motion.near(math.sqrt(orbit.found[kernels.R_POWER]), _NEAR):
        return _repeating(scene, orbit, request, earlier)
    steps_error = float(orbit.found[kernels.R_ERROR]) if orbit.settled else math.nan
    if not math.isfinite(steps_error) and motion.stationary and _SURE * motion.standard_error <= request.accuracy:
        # Where halving the steps did not tell what they leave, a motion with half of them does.
        rms, motion = motion.rms, simulate_on(search.finer(orbit.period), motion.state, periods, 0.0, count)
        earlier, steps_error = earlier + motion.periods, abs(rms - motion.rms) / max(motion.rms, _SMALL)
    return _not_repeating(scene, motion, orbit, request, earlier, 0.0 if math.isnan(steps_error) else steps_error)


def search(
    scene: Scene,
    request: Request,
    begin: NDArray[np.float64] | None = None,
    steer: NDArray[np.float64] | None = None,
) -> Orbit:
    """Return what the search for the motion that repeats ends with, stable or not; errors as of ``solve``.

    Args:
        begin: state to search from, (2, 6), by default rest.
        steer: what residuals are multiplied by (models.solve.six_dof.kernels.orbit.settle), (12, 12), by default that
            of the healthy bearing.
    """
    begin = np.zeros((2, 6)) if begin is None else begin
    return _Search(scene, effort_for(scene, request), request.direction, steer).settle(begin)


def response_of(scene: Scene, request: Request, orbit: Orbit) -> Response:
    """Return the response of an orbit that was found, stable or not."""
    return judged(_repeating(scene, orbit, request), request)


def effort_for(scene: Scene, request: Request, harmonics: int = HARMONICS) -> Effort:
    """Return how a scene is settled for a request.

    Raises:
        ValueError: if the scene needs too many steps or its rig is too stiff for its speed, or the steps do not resolve
            the band or the lines; the message names it.
    """
    check_resonance(scene.healthy)
    accuracy, tolerance = request.accuracy, request.tolerance
    accuracy = max(accuracy * (_OF_WAVE if request.quantity == "waveform" else 1.0), _LEAST_ERROR)
    if tolerance is None:
        tolerance = max(SETTLING_SHARE * accuracy, kernels.LEAST_TOLERANCE)
    steps, grids = steps_for(scene), _GRIDS
    if request.steps_per_period is not None:
        steps, grids = math.ceil(0.5 * request.steps_per_period), 2
    bpfo, low, high = kinematics(scene.bearing, scene.speed).bpfo, 1, 0
    most = 2 * steps if grids == 2 else MOST_STEPS // 2
    resolved = min(_resolved(request) * most, MOST_LINES) * bpfo
    highest = request.highest(resolved, f"{MOST_LINES} lines of {bpfo:.4g} Hz and {most} steps resolve up to")
    if request.band is not None:
        low, high = band_lines(bpfo, request.band)
    steps = max(steps, math.ceil(0.5 * steps_to_resolve(highest, 1.0 / bpfo, _resolved(request))))
    return Effort(
        steps=steps,
        least=LEAST_IN_SEGMENT,
        grids=grids,
        most=MOST_STEPS,
        accuracy=accuracy,
        quantity=_QUANTITIES[request.quantity],
        tolerance=tolerance,
        cap=SEARCHED,
        low=low,
        high=high,
        harmonics=harmonics,
    )


def steps_to_resolve(frequency: float, duration: float, resolved: float = _RESOLVED) -> int:
    """Return how many steps in ``duration`` s resolve lines up to a frequency, Hz, to a share of the step rate."""
    return math.ceil(frequency * duration / resolved)


def _resolved(request: Request) -> float:
    return _RESOLVED_WAVE if request.quantity == "waveform" else _RESOLVED


@dataclass(frozen=True, eq=False)
class Orbit:
    """What a search found: period, state at its start, what it recorded, and the kernel's numbers (R_ constants)."""

    period: Period
    state: NDArray[np.float64]
    trace: PeriodTrace
    found: NDArray[np.float64]

    @property
    def settled(self) -> bool:
        """Whether the search ended."""
        return self.found[kernels.R_SETTLED] > 0.0

    @property
    def stable(self) -> bool:
        """Whether it repeats, and attracts what is near."""
        return self.settled and self.multiplier < 1.0

    @property
    def multiplier(self) -> float:
        """Largest absolute Floquet multiplier."""
        return float(self.found[kernels.R_RADIUS])

    @property
    def doubted(self) -> bool:
        """Whether there may be other motions beside it: the rings part for a moment, or the motion from rest strays."""
        return self.found[kernels.R_DOUBTED] > 0.0

    @property
    def periods(self) -> int:
        """Periods that were simulated."""
        return int(self.found[kernels.R_PERIODS])


class _Search:
    """Searches the motion of one scene that repeats."""

    def __init__(
        self, scene: Scene, effort: Effort, direction: float = 0.0, steer: NDArray[np.float64] | None = None
    ) -> None:
        """Prepare what does not depend on where a search begins; ``direction`` is the sensor's, rad from the load.

        ``steer``: by default that of the healthy bearing.
        """
        healthy = scene.healthy
        self._paths, self._profile = defect_arrays(scene.bearing, scene.defects)
        self._point = operating_point(healthy)
        if direction != 0.0:
            parameter = self._point.parameter.copy()
            parameter[P_DIRECTION_1], parameter[P_DIRECTION_2] = math.cos(direction), math.sin(direction)
            self._point = self._point._replace(parameter=parameter)
        steer = steering(healthy) if steer is None else steer
        self._steering = np.eye(12) if steer is None else steer
        self._effort = effort

    def settle(self, begin: NDArray[np.float64]) -> Orbit:
        """Search from a state, (2, 6)."""
        found = np.empty(kernels.R_LINES + 2 * self._effort.harmonics)
        solved = kernels.solve(self._paths, self._profile, self._point, begin, self._steering, self._effort, found)
        return Orbit(*solved, found)

    def finer(self, period: Period) -> Period:
        """Return a period with half the steps."""
        return set_up(self._paths, self._profile, self._point, 2 * len(period.nodes.turn), self._effort.least, 1)


def _line_count(scene: Scene, period: Period, request: Request) -> int:
    """Return how many lines are computed: up to what is asked for and the end of the band, as far as steps resolve."""
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    wanted = min(LINES_TO, LINES * bpfo) if request.lines_to is None else request.lines_to
    if request.band is not None:
        wanted = max(wanted, request.band[1])
    resolved = _resolved(request) * len(period.nodes.turn)
    return max(HARMONICS, math.ceil(min(wanted / bpfo, resolved)))


def _repeating(scene: Scene, orbit: Orbit, request: Request, earlier: int = 0) -> Response:
    """Return the response of a motion that repeats."""
    period, found, names = orbit.period, orbit.found, request.derivatives
    coefficients = fourier_coefficients(orbit.trace, period, _line_count(scene, period, request))
    peak = np.array([largest(orbit.trace, period.first, np.int64(sensor)) for sensor in (0, 1)])
    return _response(
        *(scene, request, coefficients, found[kernels.R_POWER : kernels.R_POWER + 2], peak),
        periods=earlier + orbit.periods,
        change=float(found[kernels.R_CHANGE]),
        spread=0.0,
        error=float(found[kernels.R_ERROR]),
        standard_error=0.0,
        peak_error=float(found[kernels.R_PEAK]),
        waveform_error=float(found[kernels.R_WAVE]),
        multiplier=orbit.multiplier,
        harmonics_error=found[kernels.R_LINES + HARMONICS :].copy(),
        # "judged" tells whether it is accurate.
        status="inaccurate",
        derivatives=of_orbit(scene, request, period, orbit.state, names) if names else {},
    )


def _not_repeating(
    scene: Scene, motion: PeriodicMotion, orbit: Orbit, request: Request, periods: int, steps_error: float
) -> Response:
    """Return the response of a motion that does not repeat; ``steps_error`` is its relative error by the steps."""
    return _response(
        *(scene, request, motion.coefficients, motion.power, motion.peak),
        periods=periods,
        change=motion.change,
        spread=motion.spread,
        error=_SURE * motion.standard_error + steps_error,
        standard_error=motion.standard_error,
        peak_error=motion.peak_spread + steps_error,
        waveform_error=math.nan,
        multiplier=orbit.multiplier,
        harmonics_error=np.full(HARMONICS, math.nan),
        status="not_periodic" if motion.stationary else "not_converged",
        derivatives=withheld(request.derivatives, "the motion does not repeat, or what repeats is unstable"),
    )


def _response(
    scene: Scene,
    request: Request,
    coefficients: NDArray[np.complex128],
    power: NDArray[np.float64],
    peak: NDArray[np.float64],
    *,
    periods: int,
    change: float,
    spread: float,
    error: float,
    standard_error: float,
    peak_error: float,
    waveform_error: float,
    multiplier: float,
    harmonics_error: NDArray[np.float64],
    status: Status,
    derivatives: Mapping[str, Derivative],
) -> Response:
    """Return the response; the errors are relative."""
    rms, bpfo = np.sqrt(power), kinematics(scene.bearing, scene.speed).bpfo
    if request.band is not None:
        # The error of the peak is known over full bandwidth.
        whole = float(peak[0])
        rms, peak = levels_of_lines(coefficients, bpfo, request.band)
        peak_error *= whole / max(float(peak[0]), _SMALL)
    harmonics = 2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1])
    return Response(
        levels=tuple(zip(rms.tolist(), peak.tolist(), strict=True)),
        rms_error=error,
        averaging_error=_SURE * standard_error,
        rms_se=standard_error * float(rms[0]),
        peak_error=peak_error,
        waveform_error=waveform_error,
        bpfo=bpfo,
        harmonics=harmonics,
        harmonics_error=harmonics_error,
        lines_error=lines_error(harmonics, harmonics_error),
        periods=periods,
        period_change=change,
        spread=spread,
        multiplier=multiplier,
        model=MODEL,
        solver=SOLVER.name,
        status=status,
        rms_band=request.band,
        coefficients=coefficients,
        derivatives=derivatives,
    )


@lru_cache(maxsize=512)
def steering(scene: Scene) -> NDArray[np.float64] | None:
    """Return the matrix that steers the orbit search of scenes that differ from this healthy one in the defect only.

    It is the inverse of identity minus the scaled Jacobian of the healthy period map, shape (12, 12); None if that is
    ill-conditioned or not finite.
    """
    paths, profile = defect_arrays(scene.bearing, ())
    point = operating_point(scene)
    approach = float(point.parameter[P_U_1]) - scene.clearance
    if approach <= 0.0:
        return None
    matrix, inverse = kernels.healthy_steering(paths, profile, point, max(_JACOBIAN_STEPS, steps_for(scene)))
    if not np.all(np.isfinite(matrix)):
        return None
    if not np.linalg.norm(matrix) * np.linalg.norm(inverse) < _WORST_CONDITION:
        return None
    return inverse


SOLVER = Solver(
    model=MODEL,
    name="periodic",
    effects=PERIODIC_EFFECTS,
    error=_LEAST_ERROR,
    cost=periodic_cost,
    solve=solve,
    reason="the motion repeats with the ball passage, so that one period is solved",
    rig=Rig,
    derivatives=DERIVATIVES,
)
