"""A rotor on two bearings (Ceruti, master thesis, Torino 2021): rigid shaft; its accelerations, and where it moves.

``models/solve/rotor/plan.py`` states the readings, ``models/solve/rotor/kernel.py`` the integration. Sensors:
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
from models.solve.engine.over_time import LOOKED_AT, SECONDS_A_CALL, answer, duration_of, expected_seconds
from models.solve.registry import Solver, check_effects
from models.solve.rotor import kernel as kernels
from models.solve.rotor.plan import at_rest, bearings_of, check_rotor, inverse_mass, prepare_plan, stiffness_of
from models.solve.rotor.rig import RotorRig
from models.words.checks import check_positive

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Request, Sensor

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


class Rigid:
    """The rotor with a rigid shaft from rest, with steps of any length."""

    solver = "rigid"
    effects = EFFECTS
    freedoms = 4
    positions = 4
    sensors: tuple[Sensor, ...] = SENSORS
    seconds_a_step = 3.3e-7

    def __init__(self, scene: Scene, direction: float = 0.0) -> None:
        """Keep what the plan is made of; ``direction``: angle of the sensors from the load, rad."""
        self.scene, self.direction = scene, direction
        self._plan: tuple[float, kernels.RotorPlan] | None = None

    def check(self) -> None:
        """Raise a ValueError that names the effects that are not described with this shaft, or a wrong bearing."""
        check_effects(self.scene, self.effects, MODEL, "with this shaft")
        check_rotor(self.scene)

    def plan(self, duration: float) -> kernels.RotorPlan:
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

    def at_rest(self) -> NDArray[np.float64]:
        """Return the eight positions at the beginning, in static equilibrium."""
        return at_rest(self.scene, elastic=False)

    def state(self, rest: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the state of the kernel at rest from the eight positions."""
        return np.concatenate((rest[: self.freedoms], np.zeros(self.freedoms)))

    def run(
        self, state: NDArray[np.float64], step: float, wave: NDArray[np.float64], place: NDArray[np.float64]
    ) -> bool:
        """Fill wave (steps, sensors) and place (steps, positions) from a state; return whether it stayed finite."""
        plan = self.plan(step * (len(wave) + 1))
        return kernels.run(state, wave, place, step, plan) == kernels.STATUS_OK

    def ends(self, place: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the displacements of A and B from the recorded positions."""
        rig = self.scene.rig_as(RotorRig)
        line, tilt = place[:, 0] + 1j * place[:, 1], place[:, 2] + 1j * place[:, 3]
        return line + rig.a * tilt, line - rig.b * tilt

    def solve(self, request: Request) -> Response:
        """Return the vibration over the time that a request names.

        Raises:
            ValueError: if the scene or the request is outside what is solved here; the message names it.
        """
        self.check()
        scene, settle = self.scene, settling(self.scene)
        self.plan(duration_of(request, settle))
        rest = self.at_rest()

        def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
            wave = np.empty((steps, len(self.sensors)))
            finite = self.run(self.state(rest), 1.0 / (request.rate * oversampling), wave, np.empty((0, 8)))
            return wave, finite

        motion = Motion(
            from_rest=from_rest,
            sensors=self.sensors,
            model=MODEL,
            solver=self.solver,
            bpfo=kinematics(scene.bearing, scene.speed).bpfo,
            block=1.0 / _block_rate(scene),
            settle=settle,
            repeats=repeats(scene),
            passages=passage_rate(scene),
        )
        return answer(motion, request, self.longest_step())

    def trace(self, duration: float, step: float, *, rest: NDArray[np.float64] | None = None) -> RotorTrace:
        """Return accelerations and displacements at every step from the beginning.

        Steps are taken as given: much longer ones than ``longest_step`` may be unstable.

        Args:
            rest: the positions at the beginning, (8,), as ``at_rest`` returns them; by default those.

        Raises:
            ValueError: if the scene or an argument is outside what is solved here; the message names it.
        """
        self.check()
        check_positive(duration=duration, step=step)
        rig, steps = self.scene.rig_as(RotorRig), max(1, round(duration / step))
        wave, place = np.empty((steps, len(self.sensors))), np.empty((steps, self.positions))
        finite = self.run(self.state(self.at_rest() if rest is None else rest), step, wave, place)
        a, b = self.ends(place)
        line, tilt = place[:, 0] + 1j * place[:, 1], place[:, 2] + 1j * place[:, 3]
        turned = np.exp(1j * (2.0 * math.pi * self.scene.speed * step * np.arange(steps) + rig.bow_angle))
        return RotorTrace(step, wave, self.sensors, a, b, line + self.scene.bow * turned, tilt, finite)

    def trajectories(self, request: Request) -> Trajectories | None:
        """Return where A, B and C move after the beginning, None if the motion diverged; raise as ``trace`` does."""
        self.check()
        scene, rest = self.scene, self.at_rest()

        def walk(duration: float, step: float) -> NDArray[np.float64] | None:
            found = self.trace(duration, step, rest=rest)
            places = np.array([[point.real, point.imag] for point in (found.a, found.b, found.c)])
            return places if found.finite else None

        free = (scene.clearance, scene.clearance, math.nan)
        step, settle = 0.5 * self.longest_step(), settling(scene)
        return settled(walk, scene, request, step=step, settle=settle, points=SENSORS, clearance=free)

    def cost(self, request: Request) -> float:
        """Return the expected processor time, s."""
        step = min(self.longest_step(), 0.5 / request.rate)
        seconds = expected_seconds(self.scene, request) + settling(self.scene)
        steps = (1.0 + 3.0 * LOOKED_AT) * seconds / step
        return SECONDS_A_CALL + self.seconds_a_step * steps


def contact_step(scene: Scene, inverse: float, side: int, balls: int) -> float:
    """Return the longest step for a mass 1 / ``inverse`` on the contacts of a bearing, s."""
    rig = scene.rig_as(RotorRig)
    exponent, stiffness = contact_exponent(bearings_of(scene)[side]), stiffness_of(rig, side)
    force = max(scene.load * (rig.b if side == 0 else rig.a) / rig.length, 1.0)
    tangent = exponent * stiffness ** (1.0 / exponent) * force ** (1.0 - 1.0 / exponent)
    step = _CONTACT_ANGLE / math.sqrt(tangent * inverse)
    return min(step, _DAMPING_STEP / (0.5 * balls * rig.c_b * inverse)) if rig.c_b > 0.0 else step


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


SOLVER = Solver(
    model=MODEL,
    name=Rigid.solver,
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=lambda scene, request: Rigid(scene).cost(request),
    solve=lambda scene, request: Rigid(scene, request.direction).solve(request),
    reason="the shaft counts as rigid, since the scene does not ask for an elastic one",
    rig=RotorRig,
    whole=lambda scene: scene.rig_as(RotorRig).end_mass == 0.0,
    trajectories=lambda scene, request: Rigid(scene).trajectories(request),
)
