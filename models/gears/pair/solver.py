"""A scene with a bearing on the driving shaft of a pair of gears: accelerations of both shafts.

The train is that of ``models.gears.train.motion``, the bearing is described element by element. Sensors: "a" is the
shaft in the bearing, "b" the other one. The load acts on shaft A along x, beside the force of the mesh. The motion
begins near rest, the beginning is dropped, and what remains is averaged (``models.solve.engine.over_time``). Lines are
those of the passages of the bearing's elements, whether it is damaged or not; those of the mesh are in the record, and
with them the motion does not repeat with the passages.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from models.gears.pair.rig import GearPairRig
from models.gears.teeth.mesh import MeshStiffness
from models.gears.train import kernel as kernels
from models.gears.train.bearings import RollingElements, with_bearings
from models.gears.train.linear import matrices, mesh_mass
from models.gears.train.motion import at_rest, course_of, longest_step, places_of, plan_of, settling
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Wheel, alike, line_of_action
from models.machine.bearing import kinematics
from models.solve.engine.motion import Motion, passage_rate
from models.solve.engine.over_time import LOOKED_AT, SECONDS_A_CALL, answer, duration_of, expected_seconds
from models.solve.registry import Solver, check_effects
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Sensor

MODEL = "gear_pair"
EFFECTS = frozenset(
    {"outer_defect", "inner_defect", "ball_defect", "several_defects", "first_row", "clearance", "roller"}
)
SENSORS: tuple[Sensor, ...] = ("a", "b")
_SAMPLES = 64
_CHUNK = 65536
# A force without which the bearing would have no stiffness to begin with, N.
_LEAST_FORCE = 1.0
_SETTLE_LEAST, _SETTLE_MOST = 0.1, 2.0
_SETTLE_PERIODS = 10.0
_SECONDS_A_STEP = 3e-6
_LEAST_ERROR = 1e-6


def train_of(scene: Scene) -> tuple[GearTrain, RollingElements]:
    """Return the train of a scene, its first support with the stiffness of the bearing at the mean force, and that."""
    rig = scene.rig_as(GearPairRig)
    turns = 0.5 * rig.module * math.cos(rig.pressure_angle)
    wheels = (
        Wheel("gear a", "a", rig.teeth, turns * rig.teeth),
        Wheel("gear b", "b", rig.teeth_b, turns * rig.teeth_b),
    )
    lines = [
        line_of_action(rig.direction_b, rig.pressure_angle, counterclockwise=True, back=back) for back in (False, True)
    ]
    bodies = (
        Body("a", rig.m, rig.inertia, (Support("bearing a", alike(rig.k_b), alike(rig.c_n)),), force=(scene.load, 0.0)),
        Body(
            "b",
            rig.m_b,
            rig.inertia_b,
            (Support("bearing b", alike(rig.k_b), alike(rig.c_nb)),),
            torque=-rig.torque * rig.teeth_b / rig.teeth,
        ),
    )
    mesh = Mesh("gear a", "gear b", _stiffness(rig), lines[0], lines[1], backlash=rig.backlash)
    train = GearTrain(bodies, wheels, (mesh,), drive="a", speed=scene.speed)
    damping = 2.0 * rig.mesh_damping * math.sqrt(rig.k_mesh * mesh_mass(train, mesh))
    train = replace(train, meshes=(replace(mesh, damping=damping),))
    bearing = RollingElements(
        "bearing a", scene.bearing, rig.k_c, scene.clearance, rig.c_b, rig.cage_angle, scene.defects
    )
    if math.hypot(scene.load, rig.torque) > 0.0:
        return with_bearings(train, [bearing]), bearing
    pressed = replace(train, bodies=(replace(bodies[0], force=(_LEAST_FORCE, 0.0)), bodies[1]))
    found = with_bearings(pressed, [bearing]).bodies[0]
    return replace(train, bodies=(replace(found, force=(0.0, 0.0)), bodies[1])), bearing


def _stiffness(rig: GearPairRig) -> MeshStiffness:
    """Return stiffness and error of the mesh; eccentric wheels err once a turn."""
    teeth = (rig.teeth, rig.teeth_b)
    if rig.smooth:
        return MeshStiffness.harmonic(teeth, rig.k_mesh, [], samples=1)
    found = MeshStiffness.harmonic(teeth, rig.k_mesh, [rig.mesh_variation * rig.k_mesh], samples=_SAMPLES)
    errors = [
        amount * np.sin(2.0 * math.pi * np.arange(z * _SAMPLES) / (z * _SAMPLES)) if amount != 0.0 else None
        for amount, z in zip((rig.eccentricity, rig.eccentricity_b), teeth, strict=True)
    ]
    return replace(found, driver_error=errors[0], driven_error=errors[1])


def _damped(scene: Scene, train: GearTrain) -> GearTrain:
    """Return a train with dampers like those of the loaded elements, for its time scales: half of all are loaded."""
    rig, bearing = scene.rig_as(GearPairRig), scene.bearing
    elements = 0.25 * rig.c_b * bearing.n_elements * bearing.rows
    first = train.bodies[0]
    support = replace(first.supports[0], damping=alike(rig.c_n + elements))
    return replace(train, bodies=(replace(first, supports=(support,)), *train.bodies[1:]))


def solve(scene: Scene, request: Request) -> Response:
    """Return the vibration of both shafts over the time that a request names.

    Raises:
        ValueError: if the scene or the request is outside what is solved here; the message names it.
    """
    check_effects(scene, EFFECTS, MODEL)
    train, bearing = train_of(scene)
    lines, damped = kinematics(scene.bearing, scene.speed), _damped(scene, train)
    settle = _settle(scene, damped)
    parts, rest = matrices(train), at_rest(train)
    along = np.array([math.cos(request.direction), math.sin(request.direction)])
    columns = [parts.names.index(f"{name}.x") for name in SENSORS]
    smooth = scene.rig_as(GearPairRig).smooth
    repeats = scene.repeats and smooth
    longest = duration_of(request, settle)

    def from_rest(steps: int, oversampling: int) -> tuple[NDArray[np.float64], bool]:
        step = 1.0 / (request.rate * oversampling)
        plan = plan_of(train, parts, 0.0, [bearing], max(longest, steps * step))
        course = course_of(plan, rest)
        wave = np.empty((steps, len(SENSORS)))
        for begin in range(0, steps, _CHUNK):
            places = places_of(plan, min(_CHUNK, steps - begin))
            if kernels.integrate(plan, course, 0.0, step, begin, step, *places) != kernels.STATUS_OK:
                return np.full_like(wave, math.nan), False
            for k, column in enumerate(columns):
                wave[begin : begin + len(places[0]), k] = places[0][:, 2, column : column + 2] @ along
        return wave, True

    slowest = min(train.speeds().values())
    motion = Motion(
        from_rest=from_rest,
        sensors=SENSORS,
        model=MODEL,
        solver="time",
        bpfo=lines.bpfo,
        block=1.0 / (lines.bpfo if repeats else min(slowest, lines.ftf)),
        settle=settle,
        repeats=repeats,
        passages=passage_rate(scene),
    )
    return answer(motion, request, longest_step(damped))


def _settle(scene: Scene, damped: GearTrain) -> float:
    """Return the time to drop at the beginning, s."""
    periods = _SETTLE_PERIODS / kinematics(scene.bearing, scene.speed).bpfo
    return min(max(_SETTLE_LEAST, periods, settling(damped)), max(_SETTLE_MOST, periods))


def _cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time, s."""
    damped = _damped(scene, train_of(scene)[0])
    step = min(longest_step(damped), 0.5 / request.rate)
    seconds = expected_seconds(scene, request)
    steps = (1.0 + 3.0 * LOOKED_AT) * (seconds + _settle(scene, damped)) / step
    samples = scene.speed * scene.rig_as(GearPairRig).teeth * damped.meshes[0].stiffness.samples
    return SECONDS_A_CALL + _SECONDS_A_STEP * (steps + samples * seconds)


def warm() -> None:
    """Compile the kernels: one healthy scene."""
    from models.machine.bearing import from_catalogue
    from models.machine.scene import Scene

    scene = Scene(40.0, 1000.0, bearing=from_catalogue("6305"), rig=GearPairRig())
    solve(scene, Request(duration=1e-3, rate=5120.0, accuracy=1.0))


SOLVER = Solver(
    model=MODEL,
    name="time",
    effects=EFFECTS,
    error=_LEAST_ERROR,
    cost=_cost,
    solve=solve,
    reason="it is integrated over time",
    rig=GearPairRig,
)
