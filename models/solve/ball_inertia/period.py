"""A bearing whose balls have inertia, solved for one ball period where nothing but the ball passages drives it.

After a ball period each ball stands where the next one stood: the state is carried over periods, with the balls
renumbered, until it no longer changes, first with the longest steps and then with half of them, until the error of the
steps is within what is asked. A motion that does not come to repeat is followed over time (``ball_inertia``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.solve.ball_inertia import kernel as kernels
from models.solve.ball_inertia import solver as over_time
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.engine.motion import ERROR_OF_WAVE
from models.solve.registry import Solver, check_effects
from models.solve.response import HARMONICS, Response, judged, levels_of_lines, lines_error
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene

EFFECTS = over_time.EFFECTS - {"inner_defect", "unbalance"}
# Distance of the waveform from the one that repeats, over the error that is asked for, on the last grid and the first.
_SETTLED, _SETTLED_FIRST = 0.05, 0.5
# Periods on one grid at most; a change that falls by less than this share in so many periods does not settle.
_MOST_PERIODS, _WATCHED, _FALLS = 150, 12, 0.5
# Fewest steps in a period, most halvings of them, and lines over the steps that are resolved.
_FEWEST_STEPS, _HALVINGS = 128, 7
_RESOLVED, _LINES_TO = 0.4, 30e3
_MOST_RATIO, _TINY = 0.95, 1e-300
# Halvings of the place of a ball at the beginning, to 0.1 nm.
_BEGIN_HALVINGS = 24
# A halving that leaves more of the change does not help.
_HELPS = 0.7
_LEAST_ERROR = 1e-5
# A smaller vibration counts as none, m/s2.
_SILENCE = 1e-9
# Steps that are taken in all over those of a period at first, and time of a call, s.
_PERIODS_TAKEN, _SECONDS_A_CALL = 9.0, 2e-3


@dataclass(frozen=True, eq=False)
class _Orbit:
    """A motion that repeats.

    Attributes:
        state: at its beginning.
        wave: acceleration at the steps of a period, m/s2.
        left: distance of that from the wave that repeats, relative, estimated.
        falls: share of a change that the next period leaves.
        periods: that were run.
    """

    state: NDArray[np.float64]
    wave: NDArray[np.float64]
    left: float
    falls: float
    periods: int


def solve(scene: Scene, request: Request) -> Response:
    """Return the settled vibration of the inner ring; of a motion that does not repeat, over the time of the request.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_effects(scene, EFFECTS, over_time.MODEL, "for one ball period")
    found = _refined(scene, request)
    return over_time.solve(scene, request) if found is None else judged(found, request)


def _refined(scene: Scene, request: Request) -> Response | None:
    """Return the response with steps that meet the accuracy, None where the motion does not come to repeat."""
    period = 1.0 / kinematics(scene.bearing, scene.speed).bpfo
    given = request.steps_per_period
    longest = over_time.SHARE_OF_STABLE * over_time.longest_stable_step(scene)
    highest = request.highest(kernels_limit(period, longest), "the steps resolve up to")
    steps = max(_FEWEST_STEPS, math.ceil(period / longest), math.ceil(highest * period / _RESOLVED))
    steps, halvings = (steps, _HALVINGS) if given is None else (math.ceil(0.5 * given), 1)
    plan, earlier = over_time.prepare_plan(scene, period, request.direction), 0
    begin = over_time.at_rest(scene, _BEGIN_HALVINGS)
    coarse = _settle(scene, begin, steps, plan, _SETTLED_FIRST * request.accuracy, None)
    best: Response | None = None
    change = math.inf
    for _ in range(halvings):
        if coarse is None:
            break
        earlier, steps = earlier + coarse.periods, 2 * steps
        fine = _settle(scene, coarse.state, steps, plan, _SETTLED * request.accuracy, coarse)
        if fine is None:
            break
        before, change = change, _rms(coarse.wave - fine.wave[::2])
        if best is not None and not change < _HELPS * before:
            break
        best = _response(scene, request, coarse, fine, earlier + fine.periods)
        if judged(best, request).status == "converged":
            break
        coarse = fine
    return best


def kernels_limit(period: float, longest: float) -> float:
    """Return the highest frequency that a period's finest grid resolves, Hz."""
    return _RESOLVED * max(_FEWEST_STEPS / period, 1.0 / longest) * 2.0 ** (_HALVINGS - 1)


def _settle(
    scene: Scene, begin: NDArray[np.float64], steps: int, plan: kernels.BallPlan, accuracy: float, coarse: _Orbit | None
) -> _Orbit | None:
    """Return the motion that repeats with so many steps a period, None where none is come to.

    ``accuracy``: distance of its waveform from the one that repeats, relative; ``coarse``: what was found with half the
    steps, from whose end the motion begins.
    """
    state, wave = begin.copy(), np.empty((steps, 1))
    step = 1.0 / (kinematics(scene.bearing, scene.speed).bpfo * steps)
    earlier, changes = (None, [math.inf]) if coarse is None else (coarse.wave, [])
    falls = 1.0 if coarse is None else coarse.falls
    periods = 0
    while periods < _MOST_PERIODS:
        if kernels.run(state, wave, np.empty((0, 2)), step, plan) != kernels.STATUS_OK:
            return None
        state, now, periods = _renumbered(state, scene), wave[:, 0].copy(), periods + 1
        level = max(_rms(now), _SILENCE)
        if earlier is not None:
            changes.append(_rms(now[:: steps // len(earlier)] - earlier) / level)
        earlier = now
        if len(changes) > 2:
            falls = max(min(one / max(before, _TINY), _MOST_RATIO) for before, one in pairwise(changes[-3:]))
        left = changes[-1] * falls / (1.0 - falls) if falls < 1.0 else math.inf
        if left <= accuracy or level <= _SILENCE:
            return _Orbit(state, now, left, falls, periods)
        if len(changes) > _WATCHED and changes[-1] > _FALLS * changes[-1 - _WATCHED]:
            return None
    return None


def _renumbered(state: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
    """Return a state in which each ball has the number of the one whose place it has taken."""
    size = scene.bearing.n_elements
    balls = state[kernels.RING :].reshape(2, scene.bearing.rows, size)
    return np.concatenate((state[: kernels.RING], np.roll(balls, 1, axis=2).ravel()))


def _response(scene: Scene, request: Request, coarse: _Orbit, fine: _Orbit, periods: int) -> Response:
    """Return the response on the finer of two grids; its errors are of first order, for the force may jump."""
    bpfo, steps = kinematics(scene.bearing, scene.speed).bpfo, len(fine.wave)
    level = _rms(fine.wave)
    scale = max(level, _SILENCE)
    change = _rms(coarse.wave - fine.wave[::2]) / scale
    error = max(abs(_rms(coarse.wave) - level) / scale, ERROR_OF_WAVE * change)
    count = max(HARMONICS, math.ceil(min(_highest(request), _RESOLVED * steps * bpfo) / bpfo))
    lines, before = (np.fft.rfft(orbit.wave) / len(orbit.wave) for orbit in (fine, coarse))
    coefficients = np.zeros((1, count + 1), dtype=np.complex128)
    coefficients[0, : min(count + 1, len(lines))] = lines[: count + 1]
    harmonics = 2.0 * np.abs(lines[1 : HARMONICS + 1])
    harmonics_error = np.abs(harmonics - 2.0 * np.abs(before[1 : HARMONICS + 1])) + fine.left * scale
    levels, share = (level, float(np.max(np.abs(fine.wave)))), 1.0
    peak_error = abs(levels[1] - float(np.max(np.abs(coarse.wave)))) / max(levels[1], _SILENCE) + change
    if request.band is not None:
        inside = levels_of_lines(coefficients, bpfo, request.band)
        levels = float(inside[0][0]), float(inside[1][0])
        share = scale / max(levels[0], _SILENCE)
    return Response(
        levels=(levels,),
        rms_error=share * (error + fine.left),
        rms_se=0.0,
        peak_error=share * (peak_error + fine.left),
        waveform_error=change + fine.left,
        bpfo=bpfo,
        harmonics=harmonics,
        harmonics_error=harmonics_error,
        lines_error=lines_error(harmonics, harmonics_error),
        periods=periods,
        period_change=fine.left,
        spread=0.0,
        multiplier=math.nan,
        model=over_time.MODEL,
        solver=SOLVER.name,
        status="inaccurate",
        rms_band=request.band,
        coefficients=coefficients,
        sensors=over_time.SENSORS,
    )


def _highest(request: Request) -> float:
    asked = _LINES_TO if request.lines_to is None else request.lines_to
    return asked if request.band is None else max(asked, request.band[1])


def _rms(wave: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.mean(wave * wave)))


def _cost(scene: Scene, request: Request) -> float:
    del request
    period = 1.0 / kinematics(scene.bearing, scene.speed).bpfo
    steps = period / (over_time.SHARE_OF_STABLE * over_time.longest_stable_step(scene))
    balls = scene.bearing.n_elements * scene.bearing.rows
    return _SECONDS_A_CALL + over_time.seconds_a_step(balls) * _PERIODS_TAKEN * max(steps, _FEWEST_STEPS)


SOLVER = Solver(
    model=over_time.MODEL,
    name="periodic",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="the motion repeats with the ball passage, so that one period is solved",
    rig=BallInertiaRig,
    trajectories=over_time.trajectories,
)
