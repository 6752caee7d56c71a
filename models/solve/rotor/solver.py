"""A rotor on two bearings (Ceruti, master thesis, Torino 2021): rigid shaft; its accelerations, and where it moves.

``models/solve/rotor/plan.py`` states the readings, ``models/solve/rotor/kernels/rigid.py`` the integration. Sensors:
"a" and "b" are the inner rings of the bearings, "c" is the disc. The outer rings stand still. The motion begins at rest
at the static equilibrium, the beginning is dropped, and what remains is averaged (``models.solve.engine.over_time``).

It stands for balls with inertia and for an elastic shaft where ``models.solve.mappings`` says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent
from models.solve.engine.motion import Motion, Trajectories, passage_rate, settled
from models.solve.engine.over_time import LOOKED_AT, SECONDS_A_CALL, answer, duration_of
from models.solve.registry import Solver, check_effects
from models.solve.rotor.kernels import rigid as kernels
from models.solve.rotor.kernels.forces import STATUS_OK, RotorPlan
from models.solve.rotor.plan import at_rest, bearings_of, check_rotor, inverse_mass, prepare_plan, stiffness_of
from models.solve.rotor.rig import RotorRig
from models.words.checks import check_positive
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Sensor

MODEL = "rotor"
EFFECTS = frozenset(
    {
        "outer_defect",
        "inner_defect",
        "ball_defect",
        "several_defects",
        "first_row",
        "clearance",
        "roller",
        "unbalance",
        "second_bearing",
        "couple_unbalance",
        "bow",
        "with_gyroscopic",
    }
)
SENSORS: tuple[Sensor, ...] = ("a", "b", "c")
# Longest step, s, over the shortest period of the linear motion on its contacts, rad, and over their damping.
LONGEST_STEP = 40e-6
_CONTACT_ANGLE = 0.3
_DAMPING_STEP = 0.5
# Dropped at the beginning: ball periods, time constants of the disc's damping, and both limits in seconds.
_SETTLE_PERIODS = 20.0
_SETTLE_CONSTANTS = 7.0
_SETTLE_LEAST, _SETTLE_MOST = 0.2, 2.0
_SAME_CAGE = 1e-12
_SECONDS_A_STEP = 3.3e-7
_LEAST_ERROR = 1e-6


@dataclass(frozen=True, eq=False)
class RotorTrace:
    """A run as it was integrated, from rest, without filter.

    Attributes:
        step: s; row n of the arrays is at n * step.
        acceleration: of the sensors in their direction, m/s2, (steps, sensors).
        sensors: of its columns.
        a, b, c: displacement of A, B and C: along the load + i across it, m, (steps,).
        tilt: phi_y - i phi_x of the line through the bearings, rad, (steps,).
        finite: whether the state stayed finite.
    """

    step: float
    acceleration: NDArray[np.float64]
    sensors: tuple[Sensor, ...]
    a: NDArray[np.complex128]
    b: NDArray[np.complex128]
    c: NDArray[np.complex128]
    tilt: NDArray[np.complex128]
    finite: bool


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of a rotor with a rigid shaft over the time that a request names.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_shaft(scene, EFFECTS)
    return solve_motion(scene, request, Rigid(scene, request.direction), "rigid")


def check_shaft(scene: Scene, able: frozenset[str]) -> None:
    """Raise a ValueError that names the effects that are not described with a shaft, or a wrong bearing."""
    check_effects(scene, able, MODEL, "with this shaft")
    check_rotor(scene)


class Rigid:
    """The rotor with a rigid shaft from rest, with steps of any length."""

    freedoms = 4
    positions = 4
    sensors: tuple[Sensor, ...] = SENSORS

    def __init__(self, scene: Scene, direction: float) -> None:
        """Keep what the plan is made of."""
        self.scene, self.direction = scene, direction
        self._plan: tuple[float, RotorPlan] | None = None

    def plan(self, duration: float) -> RotorPlan:
        """Return the plan of a run of at least ``duration`` seconds."""
        if self._plan is None or self._plan[0] < duration:
            self._plan = duration, prepare_plan(self.scene, duration, self.freedoms, self.direction)
        return self._plan[1]

    def longest_step(self) -> float:
        """Return the step to begin with, s."""
        rig = self.scene.rig_as(RotorRig)
        i_11, i_12, i_22 = inverse_mass(rig, rigid=True)
        step = LONGEST_STEP
        for k, (arm, bearing) in enumerate(zip((rig.a, -rig.b), bearings_of(self.scene), strict=True)):
            inverse = i_11 + 2.0 * arm * i_12 + arm**2 * i_22
            step = min(step, contact_step(self.scene, inverse, k, bearing.n_elements * bearing.rows))
        return step

    def state(self, rest: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the state of the kernel at rest from the eight positions."""
        return np.concatenate((rest[: self.freedoms], np.zeros(self.freedoms)))

    def run(
        self, state: NDArray[np.float64], step: float, wave: NDArray[np.float64], place: NDArray[np.float64]
    ) -> bool:
        """Fill wave (steps, sensors) and place (steps, positions) from a state; return whether it stayed finite."""
        plan = self.plan(step * (len(wave) + 1))
        return kernels.run(state, wave, place, step, plan) == STATUS_OK

    def ends(self, place: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the displacements of A and B from the recorded positions."""
        rig = self.scene.rig_as(RotorRig)
        line, tilt = place[:, 0] + 1j * place[:, 1], place[:, 2] + 1j * place[:, 3]
        return line + rig.a * tilt, line - rig.b * tilt


def contact_step(scene: Scene, inverse: float, side: int, balls: int) -> float:
    """Return the longest step for a mass 1 / ``inverse`` on the contacts of a bearing, s."""
    rig = scene.rig_as(RotorRig)
    exponent, stiffness = contact_exponent(bearings_of(scene)[side]), stiffness_of(rig, side)
    force = max(scene.load * (rig.b if side == 0 else rig.a) / rig.length, 1.0)
    tangent = exponent * stiffness ** (1.0 / exponent) * force ** (1.0 - 1.0 / exponent)
    step = _CONTACT_ANGLE / math.sqrt(tangent * inverse)
    return min(step, _DAMPING_STEP / (0.5 * balls * rig.c_b * inverse)) if rig.c_b > 0.0 else step


def solve_motion(scene: Scene, request: Request, shaft: Rigid, solver: str) -> Response:
    """Return the response of a rotor from what integrates it."""
    settle = settling(scene)
    lines = kinematics(scene.bearing, scene.speed)
    shaft.plan(duration_of(request, settle))
    rest = at_rest(scene, elastic=solver != "rigid")

    def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        wave = np.empty((steps, len(shaft.sensors)))
        finite = shaft.run(shaft.state(rest), 1.0 / (request.rate * oversampling), wave, np.empty((0, 8)))
        return wave, finite

    motion = Motion(
        from_rest=from_rest,
        sensors=shaft.sensors,
        model=MODEL,
        solver=solver,
        bpfo=lines.bpfo,
        block=1.0 / _block_rate(scene),
        settle=settle,
        repeats=repeats(scene),
        passages=passage_rate(scene),
    )
    return answer(motion, request, shaft.longest_step())


def trace_of(scene: Scene, duration: float, step: float, shaft: Rigid, rest: NDArray[np.float64]) -> RotorTrace:
    """Return a run from given positions at rest, (8,), as ``at_rest`` returns them, with steps that are given."""
    check_positive(duration=duration, step=step)
    rig, steps = scene.rig_as(RotorRig), max(1, round(duration / step))
    wave, place = np.empty((steps, len(shaft.sensors))), np.empty((steps, shaft.positions))
    finite = shaft.run(shaft.state(rest), step, wave, place)
    a, b = shaft.ends(place)
    line, tilt = place[:, 0] + 1j * place[:, 1], place[:, 2] + 1j * place[:, 3]
    turned = np.exp(1j * (2.0 * math.pi * scene.speed * step * np.arange(steps) + rig.bow_angle))
    return RotorTrace(step, wave, shaft.sensors, a, b, line + scene.bow * turned, tilt, finite)


def trace(scene: Scene, duration: float, step: float, *, rest: NDArray[np.float64] | None = None) -> RotorTrace:
    """Return accelerations and displacements of a rotor with a rigid shaft, at every step from the beginning.

    Steps are taken as given: much longer ones than ``Rigid.longest_step`` may be unstable.

    Args:
        rest: the positions at the beginning, (8,), as ``rotor_plan.at_rest`` returns them; by default those.

    Raises:
        ValueError: if the scene or an argument is outside what is solved here; the message names it.
    """
    check_shaft(scene, EFFECTS)
    return trace_of(scene, duration, step, Rigid(scene, 0.0), at_rest(scene, elastic=False) if rest is None else rest)


def trajectories_of(scene: Scene, request: Request, shaft: Rigid, rest: NDArray[np.float64]) -> Trajectories | None:
    """Return where A, B and C move after the beginning from rest, None if the motion diverged."""

    def walk(duration: float, step: float) -> NDArray[np.float64] | None:
        found = trace_of(scene, duration, step, shaft, rest)
        places = np.array([[point.real, point.imag] for point in (found.a, found.b, found.c)])
        return places if found.finite else None

    free = (scene.clearance, scene.clearance, math.nan)
    step, settle = 0.5 * shaft.longest_step(), settling(scene)
    return settled(walk, scene, request, step=step, settle=settle, points=SENSORS, clearance=free)


def trajectories(scene: Scene, request: Request) -> Trajectories | None:
    """Return where A, B and C of a rotor with a rigid shaft move, None if the motion diverged.

    Raises:
        ValueError: if the scene is outside what is solved here; the message names it.
    """
    check_shaft(scene, EFFECTS)
    return trajectories_of(scene, request, Rigid(scene, 0.0), at_rest(scene, elastic=False))


def repeats(scene: Scene) -> bool:
    """Whether nothing but the passages of the balls drives the motion, at one rate in both bearings."""
    rates = [kinematics(bearing, scene.speed) for bearing in bearings_of(scene)]
    return scene.repeats and abs(rates[0].bpfo - rates[1].bpfo) <= _SAME_CAGE * rates[0].bpfo


def _block_rate(scene: Scene) -> float:
    """Return how many blocks a second has: the slowest of the frequencies with which the level swings, Hz."""
    lines = [kinematics(bearing, scene.speed) for bearing in bearings_of(scene)]
    if repeats(scene):
        return lines[0].bpfo
    apart = abs(lines[0].ftf - lines[1].ftf) > _SAME_CAGE * lines[0].ftf
    return min(line.ftf for line in lines) if apart or "ball_defect" in scene.effects else scene.speed


def settling(scene: Scene) -> float:
    """Return the time to drop at the beginning, s."""
    rig, lines = scene.rig_as(RotorRig), kinematics(scene.bearing, scene.speed)
    constant = 2.0 * (rig.m + 2.0 * rig.end_mass) / rig.c_n if rig.c_n > 0.0 else math.inf
    wished = max(_SETTLE_LEAST, _SETTLE_PERIODS / lines.bpfo, _SETTLE_CONSTANTS * constant)
    return min(wished, max(_SETTLE_MOST, _SETTLE_PERIODS / lines.bpfo))


def cost_of(scene: Scene, request: Request, shaft: Rigid, seconds_a_step: float) -> float:
    """Return the expected processor time, s."""
    step = min(shaft.longest_step(), 0.5 / request.rate)
    steps = (1.0 + 3.0 * LOOKED_AT) * (request.duration + settling(scene)) / step
    return SECONDS_A_CALL + seconds_a_step * steps


def _cost(scene: Scene, request: Request) -> float:
    return cost_of(scene, request, Rigid(scene, 0.0), _SECONDS_A_STEP)


SOLVER = Solver(
    model=MODEL,
    name="rigid",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="the shaft counts as rigid, since the scene does not ask for an elastic one",
    rig=RotorRig,
    whole=lambda scene: scene.rig_as(RotorRig).end_mass == 0.0,
    trajectories=trajectories,
)
