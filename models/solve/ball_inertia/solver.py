"""A bearing whose balls have inertia, over time (Marin, Rubio, Garcia-Prada, Reinoso, JTE 42(1), 2014): Z + 2 freedoms.

Inner ring and rotor move as one in the plane; each ball moves along the radius on which the cage holds it, between the
inner ring and the outer ring, which stands still; it is pressed outwards by its centrifugal force. The sensor "a" is
the acceleration of the inner ring: the source's y''. The motion begins at rest at the static deflection, the beginning
is dropped, and what remains is averaged (``models.solve.engine.over_time``).

Readings; numbers are those of the corrections in docs/evidence/models.md.

* Angles are measured from the load; gravity points where ``Scene.gravity_angle`` says, so the sign of Eq. 37 (6) does
  not arise. It acts on balls and ring.
* The damping of a contact acts on the rate at which ball and race approach each other (3, 4), and the sum of both
  forces never pulls. Neither the profile of a defect nor its edges enter that rate.
* Depth is that of the defect wherever the angle of a ball lies inside (2), however little of the ball fits in; that of
  the inner race is met by the angle between ball and shaft. Both races have their contact on the pitch circle.
* Clearance widens the outer race (9).

It takes no parameters of another model; ``models.solve.mappings`` says what may stand for it.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import BALL_EXPONENT, element_angles, in_series, static_equilibrium
from models.solve.ball_inertia import kernel as kernels
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.engine.motion import Motion, Planned, Trajectories, passage_rate, settled
from models.solve.engine.over_time import LOOKED_AT, SECONDS_A_CALL, answer, duration_of, expected_seconds
from models.solve.engine.passages import in_intervals, passages_over
from models.solve.registry import Solver, check_effects
from models.words.checks import check_positive
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Defect, Scene
    from models.solve.response import Response
    from models.words.request import Sensor

MODEL = "ball_inertia"
EFFECTS = frozenset(
    {
        "outer_defect",
        "inner_defect",
        "several_defects",
        "first_row",
        "clearance",
        "unbalance",
        "gravity",
        "with_ball_inertia",
        "with_centrifugal",
    }
)
SENSORS: tuple[Sensor, ...] = ("a",)
# First step over the longest stable one: a ball may be pressed harder than at rest.
SHARE_OF_STABLE = 0.7
# Dropped at the beginning: ball periods, time constants of the ring on its contacts, and both limits in seconds.
_SETTLE_PERIODS = 4.0
_SETTLE_CONSTANTS = 7.0
_SETTLE_LEAST, _SETTLE_MOST = 0.2, 2.0
# Time of a step, s: of the ring, and of each ball.
_SECONDS_A_STEP, _SECONDS_A_BALL = 1.8e-7, 5.5e-8
_LEAST_ERROR = 1e-5
# Places of a ball that are looked at from where the ring leaves it, m, and halvings of that range.
_REACH, _HALVINGS = 1e-3, 80


@dataclass(frozen=True, eq=False)
class BallTrace:
    """A run as it was integrated, from rest, without filter.

    Attributes:
        step: s; row n of the arrays is at n * step.
        acceleration: of the ring, along the load, m/s2, (steps,).
        ring: its displacement: along the load, across it, m, (steps, 2).
        balls: radial displacement of the balls from the pitch circle, m, (steps, balls).
        finite: whether the state stayed finite.
    """

    step: float
    acceleration: NDArray[np.float64]
    ring: NDArray[np.float64]
    balls: NDArray[np.float64]
    finite: bool


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of the inner ring over the time that a request names.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_effects(scene, EFFECTS, MODEL)
    lines, settle = kinematics(scene.bearing, scene.speed), settling(scene)
    planned = Planned(lambda seconds: prepare_plan(scene, seconds, request.direction), duration_of(request, settle))
    rest = at_rest(scene)

    def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        h, wave = 1.0 / (request.rate * oversampling), np.empty((steps, 1))
        status = kernels.run(rest.copy(), wave, np.empty((0, 2)), h, planned.until(steps * h))
        return wave, status == kernels.STATUS_OK

    motion = Motion(
        from_rest=from_rest,
        sensors=SENSORS,
        model=MODEL,
        solver="time",
        bpfo=lines.bpfo,
        block=1.0 / (lines.bpfo if scene.repeats else scene.speed),
        settle=settle,
        repeats=scene.repeats,
        passages=passage_rate(scene),
    )
    return answer(motion, request, SHARE_OF_STABLE * longest_stable_step(scene))


def trace(scene: Scene, duration: float, step: float) -> BallTrace:
    """Return acceleration and displacements at every step from the beginning, with steps that are given.

    Raises:
        ValueError: if the scene or an argument is outside what is solved here; the message names it.
    """
    check_effects(scene, EFFECTS, MODEL)
    check_positive(duration=duration, step=step)
    steps, plan = max(1, round(duration / step)), prepare_plan(scene, duration + step)
    wave, place = np.empty((steps, 1)), np.empty((steps, 2 + plan.slots.shape[1]))
    finite = kernels.run(at_rest(scene), wave, place, step, plan) == kernels.STATUS_OK
    return BallTrace(step, wave[:, 0], place[:, :2], place[:, 2:], finite)


def trajectories(scene: Scene, request: Request) -> Trajectories | None:
    """Return where the inner ring moves after the beginning, None if the motion diverged; raise as ``trace`` does."""

    def walk(duration: float, step: float) -> NDArray[np.float64] | None:
        found = trace(scene, duration, step)
        return found.ring.T[np.newaxis] if found.finite else None

    step = SHARE_OF_STABLE * longest_stable_step(scene)
    free = (scene.clearance,)
    return settled(walk, scene, request, step=step, settle=settling(scene), points=SENSORS, clearance=free)


def prepare_plan(scene: Scene, duration: float, direction: float = 0.0) -> kernels.BallPlan:
    """Return everything the kernel needs for a run of ``duration`` seconds.

    ``direction``: angle of the sensor from the load, rad.
    """
    angles = _ball_angles(scene)
    columns = [_passages(scene, defect, duration) for defect in scene.defects if defect.moves_balls]
    begin, end, contact, depth, rate, offset = (
        np.concatenate([np.zeros(0), *(column[k] for column in columns)]) for k in range(6)
    )
    cut = in_intervals(begin, end, duration)
    return kernels.BallPlan(
        parameter=_parameters(scene, direction),
        slots=np.stack([np.cos(angles), np.sin(angles)]),
        bounds=cut.bounds,
        first=cut.first,
        ball=contact[cut.record].astype(np.int64),
        depth=depth[cut.record],
        rate=rate[cut.record],
        offset=offset[cut.record],
    )


def _ball_angles(scene: Scene) -> NDArray[np.float64]:
    return element_angles(scene.bearing, scene.rig_as(BallInertiaRig).cage_angle)


def _parameters(scene: Scene, direction: float) -> NDArray[np.float64]:
    rig, shaft = scene.rig_as(BallInertiaRig), 2.0 * math.pi * scene.speed
    p, force = np.zeros(kernels.P_SIZE), _steady_force(scene)
    p[kernels.P_CAGE], p[kernels.P_SHAFT] = _cage_speed(scene), shaft
    p[kernels.P_PITCH], p[kernels.P_CLEARANCE] = 0.5 * scene.bearing.pitch_diameter, scene.clearance
    p[kernels.P_STIFFNESS_INNER], p[kernels.P_STIFFNESS_OUTER] = rig.k_ci, rig.k_co
    p[kernels.P_DAMPING_INNER], p[kernels.P_DAMPING_OUTER] = rig.c_ci, rig.c_co
    p[kernels.P_INVERSE_MASS], p[kernels.P_INVERSE_BALL] = 1.0 / rig.mass, 1.0 / rig.ball_mass(scene.bearing)
    p[kernels.P_FORCE_1], p[kernels.P_FORCE_2] = force.real, force.imag
    p[kernels.P_GRAVITY_1] = scene.gravity * math.cos(scene.gravity_angle)
    p[kernels.P_GRAVITY_2] = scene.gravity * math.sin(scene.gravity_angle)
    p[kernels.P_UNBALANCE] = scene.unbalance * shaft**2
    p[kernels.P_DIRECTION_1], p[kernels.P_DIRECTION_2] = math.cos(direction), math.sin(direction)
    return p


def _cage_speed(scene: Scene) -> float:
    return 2.0 * math.pi * kinematics(scene.bearing, scene.speed).ftf


def _steady_force(scene: Scene) -> complex:
    """Return load and weight of the ring: along the load + i across it, N."""
    return scene.load + scene.gravity * scene.rig_as(BallInertiaRig).mass * cmath.exp(1j * scene.gravity_angle)


def _passages(scene: Scene, defect: Defect, duration: float) -> tuple[NDArray[np.float64], ...]:
    """Return begin, end, contact, depth, rate and offset of the passages over one defect."""
    angles, per_row = _ball_angles(scene), scene.bearing.n_elements
    rows = slice(defect.first_row * per_row, (defect.first_row + defect.rows) * per_row)
    balls, on_outer = np.arange(len(angles))[rows], defect.part == "outer"
    rate = _cage_speed(scene) - (0.0 if on_outer else 2.0 * math.pi * scene.speed)
    half = 0.5 * defect.dphi_d
    edges = (defect.position - half, defect.position + half)
    past = passages_over(angles[rows], rate, 2.0 * math.pi, edges, duration)
    contact = (balls[past.number] + (len(angles) if on_outer else 0)).astype(np.float64)
    along, start = np.zeros(len(contact)), np.full(len(contact), 0.5 * math.pi)
    if scene.rig_as(BallInertiaRig).defect_shape == "half_sine":
        waves = math.pi / defect.dphi_d
        along, start = np.full(len(contact), waves * rate), waves * past.offset
    return past.begin, past.end, contact, np.full(len(contact), defect.h_d), along, start


def at_rest(scene: Scene, halvings: int = _HALVINGS) -> NDArray[np.float64]:
    """Return the state at the beginning, (4 + 2 balls,): the ring where contacts without defects carry load and weight.

    Each ball is in balance there with its centrifugal force, which the ring's place leaves out.
    """
    rig, angles, force = scene.rig_as(BallInertiaRig), _ball_angles(scene), _steady_force(scene)
    towards = cmath.phase(force)
    series = in_series(rig.k_ci, rig.k_co, BALL_EXPONENT)
    place = static_equilibrium(angles - towards, abs(force), series, clearance=scene.clearance)
    ring = complex(*place) * cmath.exp(1j * towards)
    balls = _balls_at_rest(scene, ring, halvings)
    return np.concatenate(([ring.real, ring.imag, 0.0, 0.0], balls, np.zeros(len(balls))))


def _balls_at_rest(scene: Scene, ring: complex, halvings: int) -> NDArray[np.float64]:
    """Return the place of each ball that is in balance beside a ring that stands still, m, by bisection."""
    rig, angles = scene.rig_as(BallInertiaRig), _ball_angles(scene)
    turned = ring * np.exp(-1j * angles)
    along, side = turned.real, turned.imag
    pitch, mass, cage = 0.5 * scene.bearing.pitch_diameter, rig.ball_mass(scene.bearing), _cage_speed(scene)
    weight = mass * scene.gravity * np.cos(angles - scene.gravity_angle)
    low = np.minimum(along, scene.clearance) - _REACH
    high = np.maximum(along, scene.clearance) + _REACH
    for _ in range(halvings):
        place = 0.5 * (low + high)
        apart = pitch + place - along
        rho = np.hypot(apart, side)
        inner = np.maximum(along - place - side**2 / (rho + apart), 0.0) ** BALL_EXPONENT
        outer = np.maximum(place - scene.clearance, 0.0) ** BALL_EXPONENT
        push = mass * (pitch + place) * cage**2 + weight + rig.k_ci * inner * apart / rho - rig.k_co * outer
        low, high = np.where(push > 0.0, place, low), np.where(push > 0.0, high, place)
    return 0.5 * (low + high)


def longest_stable_step(scene: Scene) -> float:
    """Return the longest step with which the Runge-Kutta scheme is stable, s, for a ball that carries all of the load.

    The ball moves on both contacts, with the tangent stiffness of that force and their damping.
    """
    rig = scene.rig_as(BallInertiaRig)
    return _stable_step(rig.ball_mass(scene.bearing), rig.c_ci + rig.c_co, sum(_tangents(scene)))


@lru_cache(maxsize=512)
def _stable_step(mass: float, damping: float, stiffness: float) -> float:
    """Return that of a mass on a spring and a damper."""
    root = cmath.sqrt(damping**2 - 4.0 * mass * stiffness)
    rates = np.array([(-damping + root) / (2.0 * mass), (-damping - root) / (2.0 * mass)])
    fastest = float(np.max(np.abs(rates)))
    steps = np.linspace(0.0, 4.0, 4001)[1:] / fastest
    z = np.outer(steps, rates)
    growth = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)))).max(axis=1)
    beyond = np.flatnonzero(growth > 1.0 + 1e-12)
    return float(steps[beyond[0]]) if len(beyond) else float(steps[-1])


def _tangents(scene: Scene) -> tuple[float, float]:
    """Return the stiffness of the contacts of a ball, inner and outer, that carries all of the load, N/m."""
    rig, turned = scene.rig_as(BallInertiaRig), scene.unbalance * (2.0 * math.pi * scene.speed) ** 2
    flung = rig.ball_mass(scene.bearing) * 0.5 * scene.bearing.pitch_diameter * _cage_speed(scene) ** 2
    force = max(abs(_steady_force(scene)) + turned + flung, 1.0)
    share = 1.0 / BALL_EXPONENT
    k_in, k_out = (BALL_EXPONENT * k**share * force ** (1.0 - share) for k in (rig.k_ci, rig.k_co))
    return k_in, k_out


def settling(scene: Scene) -> float:
    """Return the time to drop at the beginning, s: the ring on one ball decays by both its contacts in a row."""
    rig, (k_in, k_out) = scene.rig_as(BallInertiaRig), _tangents(scene)
    damping = (rig.c_ci * k_out**2 + rig.c_co * k_in**2) / (k_in + k_out) ** 2
    constant = 2.0 * rig.mass / damping if damping > 0.0 else math.inf
    periods = _SETTLE_PERIODS / kinematics(scene.bearing, scene.speed).bpfo
    return min(max(_SETTLE_LEAST, periods, _SETTLE_CONSTANTS * constant), max(_SETTLE_MOST, periods))


def seconds_a_step(balls: int) -> float:
    """Return the expected processor time of a step, s."""
    return _SECONDS_A_STEP + _SECONDS_A_BALL * balls


def _cost(scene: Scene, request: Request) -> float:
    step = min(SHARE_OF_STABLE * longest_stable_step(scene), 0.5 / request.rate)
    seconds = seconds_a_step(len(_ball_angles(scene)))
    simulated = expected_seconds(scene, request) + settling(scene)
    return SECONDS_A_CALL + seconds * (1.0 + 3.0 * LOOKED_AT) * simulated / step


def warm() -> None:
    """Compile the kernel: one healthy scene."""
    from models.machine.bearing import from_catalogue
    from models.machine.scene import Scene

    trace(Scene(40.0, 1000.0, bearing=from_catalogue("6206"), rig=BallInertiaRig()), 1e-3, 5e-6)


SOLVER = Solver(
    model=MODEL,
    name="time",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="the motion is simulated over time, since only that follows the balls",
    rig=BallInertiaRig,
    trajectories=trajectories,
)
