"""Ball periods of scenes as the kernels take them, and what a motion comes to when it is simulated on plainly."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.machine.scene import Scene
from models.solve.six_dof.kernels.errors import Q_LINES
from models.solve.six_dof.kernels.orbit import CALM_PERIODS, PLAIN_FIRST, newton_steering, settle
from models.solve.six_dof.kernels.period import Period, PeriodTrace, ball_period, blank_trace, mean_square
from models.solve.six_dof.kernels.period_setup import set_up
from models.solve.six_dof.kernels.settled import R_LINES, R_STEPS, ask_again, solve
from models.solve.six_dof.kernels.step import STATUS_OK
from models.solve.six_dof.kernels.tangent import tangent_jacobian
from models.solve.six_dof.periodic import effort_for, steering
from models.solve.six_dof.setup import LEAST_IN_SEGMENT, defect_arrays, operating_point, steps_for
from models.words.request import Request


def period_of(scene: Scene, steps: int | None = None, *, fold: int = 1) -> Period:
    """Return a scene's ball period on the coarsest grid, or one with at least ``steps``, each cut into ``fold``."""
    paths, profile = defect_arrays(scene.bearing, scene.defects)
    point = operating_point(scene.healthy)
    least = steps_for(scene) if steps is None else steps
    return set_up(paths, profile, point, least, LEAST_IN_SEGMENT, fold)


@dataclass(frozen=True, eq=False)
class Solved:
    """What the kernel made of a scene: its last ball period, the state at its start and its numbers (R_ constants)."""

    period: Period
    state: NDArray[np.float64]
    found: NDArray[np.float64]

    @property
    def steps(self) -> int:
        """Steps in a period of the last grid."""
        return int(self.found[R_STEPS])


def solve_scene(scene: Scene, accuracy: float, tolerance: float | None = None, steps: int | None = None) -> Solved:
    """Search a scene's motion that repeats as ``simulate`` does first, and show on which grid it ended."""
    request = Request(accuracy=accuracy, tolerance=tolerance, steps_per_period=steps)
    healthy, effort = scene.healthy, effort_for(scene, request)
    paths, profile = defect_arrays(scene.bearing, scene.defects)
    steer, found = steering(healthy), np.empty(R_LINES + 2 * effort.harmonics)
    period, state, _ = solve(
        *(paths, profile, operating_point(healthy), np.zeros((2, 6))),
        *(np.eye(12) if steer is None else steer, effort, found),
    )
    return Solved(period, state, found)


def ask(scene: Scene, solved: Solved, accuracy: float) -> Callable[[], int]:
    """Return what takes a second opinion of a solved scene, and returns the periods that it takes."""
    paths, profile = defect_arrays(scene.bearing, scene.defects)
    steer = newton_steering(tangent_jacobian(solved.state, solved.period)[0])
    effort = effort_for(scene, Request(accuracy=accuracy))
    fold, values = round(solved.steps / len(period_of(scene).nodes.turn)), np.zeros(Q_LINES + 3 * effort.harmonics)
    return lambda: ask_again(
        *(paths, profile, operating_point(scene.healthy), solved.state, steer, effort),
        *(fold, 1, effort.tolerance, math.inf, values),
    )


def run(period: Period, state: NDArray[np.float64], trace: PeriodTrace) -> NDArray[np.float64]:
    """Return the state one period later, (2, 6), and write what the period records."""
    after = np.empty((2, 6))
    assert ball_period(state, after, trace, period) == STATUS_OK
    return after


@dataclass(frozen=True, eq=False)
class SimulatedOn:
    """The casing's RMS of each period that was kept, m/s2, and the state at the end, (2, 6)."""

    levels: NDArray[np.float64]
    state: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """RMS over all of them, m/s2."""
        return math.sqrt(float(np.mean(self.levels**2)))

    @property
    def spread(self) -> float:
        """Standard deviation from period to period, m/s2."""
        return float(np.std(self.levels))


def simulate_plainly(
    period: Period, periods: int, dropped: int, begin: NDArray[np.float64] | None = None
) -> SimulatedOn:
    """Simulate period after period, from rest unless a state is given; the first ``dropped`` are not kept."""
    state, trace = np.zeros((2, 6)) if begin is None else begin.copy(), blank_trace(period)
    levels = []
    for n in range(periods):
        state = run(period, state, trace)
        if n >= dropped:
            levels.append(math.sqrt(mean_square(trace, 0)))
    return SimulatedOn(np.array(levels), state)


def orbit_of(scene: Scene, steps: int | None = None) -> tuple[Period, NDArray[np.float64]]:
    """Return a scene's period and the fixed point of its map, stable or not."""
    period, steer, state = period_of(scene, steps), steering(scene.healthy), np.empty((2, 6))
    found = settle(
        *(np.zeros((2, 6)), state, blank_trace(period), period),
        *(np.eye(12) if steer is None else steer, PLAIN_FIRST, CALM_PERIODS, 1e-10, 400, math.inf),
    )
    assert found[3]
    return period, state
