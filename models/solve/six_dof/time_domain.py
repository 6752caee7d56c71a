"""The six-degree-of-freedom model simulated over time, for scenes whose motion has no ball period.

Defects that turn (inner race, ball), a force that turns (unbalance) and balls that slip have no common period; several
defects need not have one. They are simulated from rest at the static equilibrium, the beginning is dropped, and what
remains is averaged with its standard error. Waviness and gravity are modelled here too.
``models/solve/six_dof/kernels/time_domain.py`` describes the integration.

Readings: the path coordinate is an angle on the damaged part, kinematics those of pure rolling (``Kinematics``). Slip
shifts when a ball meets the defect, not where it presses: the angle is small. Gravity changes the static equilibrium
and nothing else, because the rest of the model is linear in it.

A speed that changes (``Scene.speed_profile``) has one rate of steps, that of its highest speed. The unbalance pushes
with the square of the speed, and against its change. What the speed changes slowly (grease, temperature) is left out.

The error of the steps is estimated as ``models.solve.engine.over_time`` describes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.rig import Rig
from models.machine.speed_profile import constant
from models.solve.engine.motion import Motion
from models.solve.engine.over_time import LOOKED_AT, answer, duration_of
from models.solve.engine.turning import lead_in, passage_rate
from models.solve.registry import Solver
from models.solve.response import CASING, Response
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import P_DIRECTION_1, P_DIRECTION_2, STATUS_OK
from models.solve.six_dof.setup import MODEL, TIME_EFFECTS, check_scene, steps_for
from models.solve.six_dof.time_plan import prepare_plan
from models.words.checks import check_positive
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Kinematics
    from models.machine.scene import Scene

# Longest step, s: benchmarks/effects.py prints the error that it leaves.
DEFAULT_STEP = 10e-6
# Dropped at the beginning: ball periods, and the minimum in seconds.
_SETTLE_PERIODS = 40
_SETTLE_SECONDS = 0.2
_SECONDS_A_STEP = 4e-7
_LEAST_ERROR = 1e-6


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of a scene over the time that a request names, with steps that meet its accuracy.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    return _simulate(scene, request, None, (math.cos(request.direction), math.sin(request.direction)), None)


def simulate_time(
    scene: Scene,
    duration: float,
    rate: float,
    *,
    settle: float | None = None,
    direction: tuple[float, float] = (1.0, 0.0),
    step: float = DEFAULT_STEP,
) -> Response:
    """Return ``duration`` seconds of the vibration of a scene with all effects that it names, sampled at ``rate`` Hz.

    As ``solve``, with steps that are given.

    Args:
        settle: time that is simulated before and dropped, s; by default 40 ball periods, and 0.2 s at least.
        direction: of the sensor, along the load and across it; made a unit vector.
        step: longest step of the integration, s; taken so that a sample has a whole number of steps, at least 2.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    check_positive(step=step)
    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"direction must be a vector of finite length other than zero, got {direction!r}")
    unit = (direction[0] / length, direction[1] / length)
    return _simulate(scene, Request(duration=duration, rate=rate), settle, unit, step)


def _simulate(
    scene: Scene, request: Request, settle: float | None, direction: tuple[float, float], step: float | None
) -> Response:
    """Return the response with a given step, or where it is None with that of the request or of the accuracy."""
    check_scene(scene, TIME_EFFECTS)
    lines = kinematics(scene.bearing, scene.speed)
    dropped = _settling(settle, lines)
    profile, lead = scene.rotation(request.duration), 0.0
    if profile is not None:
        lead = lead_in(dropped, request.rate)
        dropped = lead - 0.5 / request.rate
    motion = Motion(
        from_rest=_FromRest(scene, request, dropped, direction, lead),
        sensors=CASING,
        model=MODEL,
        solver=SOLVER.name,
        bpfo=lines.bpfo,
        block=1.0 / _block_rate(scene, lines),
        settle=dropped,
        repeats=scene.repeats,
        passages=passage_rate(scene),
        profile=constant(scene.speed, request.duration) if profile is None else profile,
        per_turn=None if profile is None else lines.bpfo / lines.speed,
    )
    return answer(motion, request, _longest_step(scene, lines) if step is None else step, fixed=step is not None)


class _FromRest:
    """The accelerations of one scene from rest at the static equilibrium, with steps of any length."""

    def __init__(
        self, scene: Scene, request: Request, settle: float, direction: tuple[float, float], lead: float
    ) -> None:
        """Keep the scene; which ball meets what is planned at the first call, once for all steps."""
        self._lead = lead
        self._scene, self._rate, self._direction = scene, request.rate, direction
        self._duration = duration_of(request, settle)
        self._plan: kernels.Plan | None = None

    def __call__(self, steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        """Return the accelerations of casing and resonator, (steps, 2), and whether they are finite."""
        if self._plan is None:
            self._plan = prepare_plan(self._scene, self._duration, self._lead)
            self._plan.parameter[P_DIRECTION_1], self._plan.parameter[P_DIRECTION_2] = self._direction
        wave = np.empty((steps, 2))
        status = kernels.run(np.zeros((2, 6)), wave, 1.0 / (self._rate * oversampling), self._plan)
        return wave, status == STATUS_OK


def _cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time, s."""
    lines = kinematics(scene.bearing, scene.speed)
    looked_at = 1.0 + 3.0 * LOOKED_AT
    return _SECONDS_A_STEP * looked_at * (request.duration + default_settling(lines)) / _longest_step(scene, lines)


def _longest_step(scene: Scene, lines: Kinematics) -> float:
    """Return the step to begin with, s."""
    if scene.speed_profile is not None:
        # What a rough floor asks for grows with the speed.
        scene = replace(scene, speed=scene.speed_profile.speed_range[1], speed_profile=None)
        lines = kinematics(scene.bearing, scene.speed)
    return min(DEFAULT_STEP, 1.0 / (lines.bpfo * steps_for(scene)))


def _block_rate(scene: Scene, lines: Kinematics) -> float:
    """Return how many blocks a second has: the slowest of the frequencies with which the level swings, Hz."""
    if scene.repeats:
        return lines.bpfo
    return lines.ftf if "ball_defect" in scene.effects else lines.speed


def default_settling(lines: Kinematics) -> float:
    """Return the time to drop at the beginning, s: the longer of 40 ball periods and 0.2 s."""
    return max(_SETTLE_SECONDS, _SETTLE_PERIODS / lines.bpfo)


def _settling(settle: float | None, lines: Kinematics) -> float:
    """Return the time to drop, s: the given one, or the default."""
    if settle is None:
        return default_settling(lines)
    if not (math.isfinite(settle) and settle >= 0.0):
        raise ValueError(f"settle must be finite and not negative, got {settle!r}")
    return settle


def warm() -> None:
    """Compile the kernels: one steady scene, one with unbalance, one whose speed changes.

    A force that turns with the shaft is left out of the machine code of scenes without one, as is a changing speed.
    """
    from models.machine.scene import Scene

    steady = Scene(40.0, 1000.0)
    for scene in (steady, replace(steady, unbalance=1e-3), replace(steady, speed_profile=constant(40.0, 1.0))):
        simulate_time(scene, 0.005, 25600.0, settle=0.0)


SOLVER = Solver(
    model=MODEL,
    name="time_domain",
    effects=TIME_EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="one ball period would not show all of it, so that it is simulated over time",
    rig=Rig,
)
