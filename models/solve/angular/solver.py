"""An elastic shaft on two ball bearings in the angular domain (Thibault et al. 2022): its instantaneous angular speed.

``models/solve/angular/plan.py`` states what moves, ``models/solve/angular/kernel.py`` how it is integrated:
Runge-Kutta steps of order four and of equal angle of the encoder's node, or in proportion to a nominal speed that
changes.
Sensors: "ias" is the angular speed at that node less the nominal one, rad/s; "a", "b" and "c" are the accelerations of
both inner rings and of the disc. The motion begins at rest in the equilibrium of the turning shaft, the beginning is
dropped, and what remains is averaged (``models.solve.engine.over_time``). ``trace`` gives it over the angle.

Readings of the source; numbers are those of the corrections in docs/evidence/models.md.

* Balls are in equilibrium in their own plane at all times (A3), with the force over a spall, whose law holds for the
  contact angle at which the ball touches. ``Defect.position`` is the middle, on the inner race in the shaft's frame.
* The cage turns with the mean contact angle of the moment (Eqs. 13 and 14); the centrifugal force, which that angle
  depends on, takes its mean over a passage of the balls.
* Left out are the gyroscopic moments of shaft and balls, as there, and the push of an unbalance against a change of the
  speed. Modes, load torque and governor are those of the scene's speed where that changes.

It takes no parameters of another model: torsion and contact angles have no counterpart in those.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.solve.angular import kernel as kernels
from models.solve.angular.ball_ring_kernel import CARRIED, LEFT, TORQUE
from models.solve.angular.plan import GOVERNOR_RATIO, Assembly, assemble, at_rest, prepare_plan
from models.solve.angular.rig import AngularRig
from models.solve.engine.motion import Motion, lead_in
from models.solve.engine.over_time import LOOKED_AT, answer, expected_seconds, timed
from models.solve.registry import Solver, check_effects
from models.words.checks import check_positive
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Sensor

MODEL = "angular"
EFFECTS = frozenset(
    {
        "outer_defect",
        "inner_defect",
        "several_defects",
        "clearance",
        "unbalance",
        "defect_width",
        "second_bearing",
        "axial_load",
        "changing_speed",
        "with_centrifugal",
        "with_elastic_shaft",
        "with_torsion",
    }
)
SENSORS: tuple[Sensor, ...] = ("ias", "a", "b", "c")
# First step over the longest stable one of the fastest mode, 2.7 over its angular frequency.
_SHARE_OF_STABLE = 0.7
_STABLE = 2.7
# Stiffness of the bearings over that in equilibrium, beside what further loads do.
_STIFFER = 1.5
# Steps of an angle are taken for a speed that is lower than the nominal one by what the shaft oscillates.
_LOWEST = 0.999
_SETTLE_CONSTANTS = 7.0
_BUILD_UP_CONSTANTS = 2.0
"""Time constants of the couplings' mode after which the error of the steps is looked at."""
_SETTLE_MOST = 2.0
_SAME_CAGE = 1e-9
# Time of a step, s: of the modes, and of each ball.
_SECONDS_A_STEP, _SECONDS_A_BALL = 2e-6, 5e-7
_LEAST_ERROR = 1e-5


@dataclass(frozen=True, eq=False)
class AngularTrace:
    """A run as it was integrated, in steps of equal angle, without filter.

    Attributes:
        step: angle of a step, rad.
        time: at the beginning of each step, s, (steps,).
        angle: of the encoder's node, from the nominal rotation, rad, (steps,).
        ias: angular speed there less the nominal one, rad/s, (steps,).
        acceleration: of A, B and disc along the load, m/s2, (steps, 3).
        carried: what the balls of A and B carry: see the constants of models.solve.angular.ball_ring_kernel, (steps,
            2, CARRIED).
        finite: whether the run went to its end.
    """

    step: float
    time: NDArray[np.float64]
    angle: NDArray[np.float64]
    ias: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    carried: NDArray[np.float64]
    finite: bool

    @property
    def torque(self) -> NDArray[np.float64]:
        """Torques that resist the shaft in A and B, N m, (steps, 2)."""
        return self.carried[:, :, TORQUE]

    @property
    def unbalanced(self) -> float:
        """Largest sum of the forces on a ball in its equilibrium, N."""
        return float(self.carried[:, :, LEFT].max())


def solve(scene: Scene, request: Request) -> Response:
    """Return angular speed and accelerations over the time that a request names.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_effects(scene, EFFECTS, MODEL)
    request, profile = timed(scene, request)
    settle, nominal = settling(scene), None
    if profile is not None:
        lead = lead_in(settle, request.rate)
        settle, nominal = lead - 0.5 / request.rate, profile.delayed(lead)
    assembly = assemble(scene)
    plan = prepare_plan(scene, assembly, request.direction, nominal)
    rest, turned = at_rest(plan, assembly), _LOWEST * 2.0 * math.pi * scene.speed

    def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        wave, h = np.zeros((steps, len(SENSORS))), 1.0 / (request.rate * oversampling)
        status = kernels.carry_over(rest.copy(), kernels.NO_ROWS, wave, h, h * turned, plan)
        finite = status == kernels.STATUS_OK
        if not finite:
            # Not what was written before it broke off: shorter steps shall be tried.
            wave[:] = math.inf
        return wave, finite

    motion = Motion(
        from_rest=from_rest,
        sensors=SENSORS,
        model=MODEL,
        solver="angle",
        bpfo=_bpfo(scene, assembly),
        block=1.0 / _block_rate(scene, assembly),
        settle=settle,
        repeats=_repeats(scene, assembly),
        build_up=_build_up(scene),
        profile=profile,
        per_turn=None if profile is None else _bpfo(scene, assembly) / scene.speed,
        speed=scene.speed,
    )
    return answer(motion, request, longest_step(scene, plan))


def trace(scene: Scene, turns: float, step: float) -> AngularTrace:
    """Return angular speed, accelerations and forces over the angle from the beginning, with steps that are given.

    Args:
        turns: of the shaft.
        step: angle of a step, rad; steps of more than some 10 us are unstable.

    Raises:
        ValueError: if the scene or an argument is outside what is solved here; the message names it.
    """
    check_effects(scene, EFFECTS, MODEL)
    check_positive(turns=turns, step=step)
    assembly = assemble(scene)
    plan = prepare_plan(scene, assembly, profile=scene.rotation(_slope_over(scene, turns)))
    rows = np.zeros((max(1, round(2.0 * math.pi * turns / step)), kernels.TRACE))
    status = kernels.carry_over(at_rest(plan, assembly), rows, kernels.NO_WAVE, 0.0, step, plan)
    carried = rows[:, 2 + kernels.SENSORS :].reshape(len(rows), 2, CARRIED)
    finite = status == kernels.STATUS_OK
    return AngularTrace(step, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3 : 2 + kernels.SENSORS], carried, finite)


def _slope_over(scene: Scene, turns: float) -> float:
    """Return how long a changing speed takes for some turns, s, and a little more, but not until it stops."""
    slope, speed = scene.speed_slope, scene.speed
    if slope == 0.0:
        return turns / speed
    left = speed * speed + 2.0 * slope * turns
    stop = math.inf if slope > 0.0 else -(1.0 - 1e-9) * speed / slope
    return min(stop, 1.1 * 2.0 * turns / (speed + math.sqrt(max(left, 0.0))))


def longest_step(scene: Scene, plan: kernels.AngularPlan) -> float:
    """Return the step to begin with, s, stable where the bearings are as stiff as under all loads at once."""
    highest = scene.speed if scene.speed_profile is None else scene.speed_profile.speed_range[1]
    turning = scene.unbalance * (2.0 * math.pi * highest) ** 2
    loads = max(scene.load + abs(scene.axial_load), 1.0)
    stiffer = _STIFFER * ((loads + turning) / loads) ** (1.0 / 3.0) - 1.0
    matrix = np.diag(plan.lateral.square)
    for side in range(2):
        rows = slice(5 * side, 5 * side + 5)
        matrix = matrix + stiffer * plan.lateral.push[rows].T @ plan.tangent[side] @ plan.lateral.shape[rows]
    fastest = float(np.max(np.abs(np.linalg.eigvals(matrix))))
    return _SHARE_OF_STABLE * _STABLE / math.sqrt(max(fastest, float(plan.torsion.square.max())))


def _bpfo(scene: Scene, assembly: Assembly) -> float:
    """Return that of the bearing with the first defect, Hz, at its contact angles in equilibrium; else that of A."""
    side = 1 if any(defect.support == "b" for defect in scene.defects[:1]) else 0
    return scene.speed * assembly.rings[side].bpfo


def _repeats(scene: Scene, assembly: Assembly) -> bool:
    """Whether nothing but the passages of the balls drives the motion, at one rate in both bearings."""
    a, b = (ring.ftf * ring.statics.bearing.n_elements for ring in assembly.rings)
    return scene.repeats and abs(a - b) <= _SAME_CAGE * a


def _block_rate(scene: Scene, assembly: Assembly) -> float:
    """Return how many blocks a second has: the slowest of the frequencies with which the level swings, Hz."""
    if _repeats(scene, assembly):
        return scene.speed * assembly.rings[0].bpfo
    return scene.speed * min(ring.ftf for ring in assembly.rings)


def settling(scene: Scene) -> float:
    """Return the time to drop at the beginning, s: of the governor, and of the couplings' mode."""
    rig = scene.rig_as(AngularRig)
    slowest = min(GOVERNOR_RATIO * 2.0 * math.pi * rig.governor * scene.speed, _ringing(scene))
    return min(_SETTLE_CONSTANTS / slowest, _SETTLE_MOST)


def _build_up(scene: Scene) -> float:
    """Return the time after which the modes have gathered most of the error of the steps, s."""
    return _BUILD_UP_CONSTANTS / _ringing(scene)


def _ringing(scene: Scene) -> float:
    """Return the rate at which the couplings' mode, the slowest of those that ring, dies away, 1/s."""
    rig = scene.rig_as(AngularRig)
    return rig.damping * math.sqrt(rig.coupling / rig.end_inertia)


def _cost(scene: Scene, request: Request) -> float:
    balls = scene.bearing.n_elements + (scene.second_bearing or scene.bearing).n_elements
    step = min(_STABLE / (4.0 * math.pi * scene.rig_as(AngularRig).mode_limit), 0.5 / request.rate)
    seconds = _SECONDS_A_STEP + _SECONDS_A_BALL * balls
    whole = expected_seconds(scene, request) + settling(scene)
    looked_at = min(whole, LOOKED_AT * whole + _build_up(scene))
    return seconds * (whole + 3.0 * looked_at) / step


def warm() -> None:
    """Compile the kernels; with such couplings, damping and governor little is simulated before the record."""
    from models.machine.bearing import from_catalogue
    from models.machine.scene import Scene

    rig = AngularRig(mode_limit=5e3, coupling=1e5, damping=0.5, governor=10.0)
    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6206"), rig=rig)
    trace(scene, 0.1, 1e-2)
    solve(scene, Request(duration=1e-3, rate=5120.0, accuracy=1.0))


SOLVER = Solver(
    model=MODEL,
    name="angle",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="the motion is simulated over the angle of the shaft, since only that has its torsion and contact angles",
    rig=AngularRig,
)
