"""The six-degree-of-freedom model of a bearing on its rig (thesis, Eqs. 32-52 and 83-89), set up for its kernels.

Without slip the settled motion repeats exactly with every passage of a ball of one row, T = 1 / BPFO.

Scheme: Lawson-RK4. The linear part (Eqs. 40-42, static contact force included) is carried by exact propagators, so the
7.4 kHz resonator costs no accuracy; the contact force is integrated with four evaluations a step. The force jumps where
the path of the balls has a kink (its slope enters the damping, Eq. 36); steps therefore end on the kinks and use the
one-sided slope at either side, without which the error falls only slowly with the step and never averages out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent, contact_forces, element_angles, static_equilibrium
from models.machine.rig import Rig, natural_frequencies
from models.path.defect import ball_path, wrap
from models.solve.engine.over_time import LOOKED_AT, expected_seconds
from models.solve.six_dof.kernels import path as kernel_path
from models.solve.six_dof.kernels import step as kernels
from models.solve.six_dof.kernels.period_setup import OperatingPoint

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from models.machine.bearing import Bearing, Kinematics
    from models.machine.scene import Defect, Scene
    from models.words.request import Request

_NO_PROFILE = np.zeros((4, 0))

# The name of the model, and what its three ways of solving have (models.machine.scene.EFFECTS).
MODEL = "six_dof"
# What a derivative can be asked by: fields of the rig, of the scene (and the sensor's direction), and of its defect.
OF_RIG = (*Rig.uncertain, "m_b")
OF_SCENE = ("load", "speed", "clearance", "gravity", "gravity_angle", "direction")
OF_DEFECT = ("dphi_d", "h_d", "position")
DERIVATIVES = (*OF_RIG, *OF_SCENE, *OF_DEFECT)
_OUTER = frozenset({"outer_defect", "rough_floor", "clearance", "with_casing"})
PERIODIC_EFFECTS = _OUTER | {"several_defects", "first_row", "roller", "waviness", "gravity"}
LANE_EFFECTS = _OUTER | {"slip", "mean_force_slip"}
TIME_EFFECTS = PERIODIC_EFFECTS | {
    "inner_defect",
    "ball_defect",
    "inner_waviness",
    "unbalance",
    "slip",
    "changing_speed",
}

# Periodic: steps of the coarsest grid that are taken in all, and processor time of one, s. Mean force: time of all for
# each step in a ball period, s, of which there are this many at least, and the longest, s. Over time: longest step, and
# time of one, s.
_STEPS_TAKEN, _SECONDS_A_STEP = 6.0, 1e-6
MIN_LANE_STEPS, LANE_STEP, _SECONDS_A_LANE_STEP = 256, 20e-6, 2.5e-3
DEFAULT_STEP, _SECONDS_A_TIME_STEP = 10e-6, 4e-7
# Dropped at the beginning of what is simulated over time: ball periods, and the minimum in seconds.
_SETTLE_PERIODS, _SETTLE_SECONDS = 40, 0.2

# The coarsest grid. Longest step times the angular frequency of the resonator (whose motion the contact follows) and of
# the rings on the contacts, and times the damping rate of the contacts.
_RESONATOR_ANGLE = 2.0
_CONTACT_ANGLE = 0.5
_DAMPING_STEP = 1.0
# Contacts are stiffer in the motion than at rest, where balls are pressed harder.
_STIFFENING = 1.5
FEWEST_STEPS = 64
LEAST_IN_SEGMENT = 2
# Of independent samples of a rough floor a step.
_FLOOR_SAMPLES = 2.0
# Steps in a period of the finest grid: less than half a gigabyte of tables, half a minute.
MOST_STEPS = 2_000_000
# Highest resonance over the ball rate: the error estimate has been held against an oracle up to here.
HIGHEST_RESONANCE = 1e5


def check_scene(scene: Scene, effects: frozenset[str] = PERIODIC_EFFECTS) -> None:
    """Raise a ValueError that names the effects of a scene which are not among those given, or another model.

    Slip does not go together with a defect of a ball.
    """
    if scene.model not in ("auto", MODEL):
        raise ValueError(f"model {scene.model!r}: this solves {MODEL}")
    missing = [name for name in scene.effects if name not in effects]
    if missing:
        raise ValueError(
            f"{', '.join(missing)}: not modelled here; models.solve.simulate.simulate takes the solver that has it"
        )
    if {"slip", "ball_defect"} <= set(scene.effects):
        raise ValueError("slip moves a ball to or from a defect of a race; the defect is of a ball")


@lru_cache(maxsize=512)
def steps_for(scene: Scene) -> int:
    """Return the least steps in a ball period of the coarsest grid of a scene, from its stiffest rates and its floor.

    Raises:
        ValueError: if they are more than MOST_STEPS / 2: the ball rate is too low for such a stiff rig.
    """
    duration = 1.0 / kinematics(scene.bearing, scene.speed).bpfo
    point = operating_point(scene.healthy)
    parameter = point.parameter
    inverse_mass = float(parameter[kernels.P_INV_M_I] + parameter[kernels.P_INV_M_O])
    resonance = math.sqrt(float(parameter[kernels.P_SQUARE_R]))
    pressed = math.hypot(parameter[kernels.P_U_1], parameter[kernels.P_U_2]) - scene.clearance
    force = math.hypot(parameter[kernels.P_LOAD_1], parameter[kernels.P_LOAD_2])
    stiffness = _STIFFENING * contact_exponent(scene.bearing) * force / pressed if pressed > 0.0 else 0.0
    damping = scene.rig_as(Rig).beta_c * stiffness + float(parameter[kernels.P_ALPHA]) * len(point.positions)
    step = min(
        _RESONATOR_ANGLE / resonance,
        _CONTACT_ANGLE / math.sqrt(stiffness * inverse_mass) if stiffness > 0.0 else math.inf,
        _DAMPING_STEP / (damping * inverse_mass) if damping > 0.0 else math.inf,
    )
    steps = max(FEWEST_STEPS, math.ceil(duration / step))
    for defect in scene.defects:
        if defect.floor.kind == "rough":
            pitch = float(parameter[kernels.P_PITCH])
            steps = max(steps, math.ceil(pitch / (_FLOOR_SAMPLES * defect.floor.pitch)))
    if steps > MOST_STEPS // 2:
        raise ValueError(
            f"the stiffest motion of the rig needs {steps} steps in a ball period of {duration:.3g} s, "
            f"at most {MOST_STEPS // 2} are taken: the speed, {scene.speed!r} Hz, is too low for it"
        )
    return steps


def periodic_cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time of one ball period, s."""
    return _SECONDS_A_STEP * _STEPS_TAKEN * steps_for(scene) * max(1.0, (1e-3 / request.accuracy) ** 0.2)


def mean_force_cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time of the mean force of slip, s."""
    finer = max(1.0, (1e-3 / request.accuracy) ** 0.5)
    steps = max(MIN_LANE_STEPS, 1.0 / (kinematics(scene.bearing, scene.speed).bpfo * LANE_STEP))
    return _SECONDS_A_LANE_STEP * finer * steps


def time_cost(scene: Scene, request: Request) -> float:
    """Return the expected processor time of a simulation over time, s."""
    lines = kinematics(scene.bearing, scene.speed)
    looked_at = 1.0 + 3.0 * LOOKED_AT
    simulated = expected_seconds(scene, request) + default_settling(lines)
    return _SECONDS_A_TIME_STEP * looked_at * simulated / longest_step(scene, lines)


def longest_step(scene: Scene, lines: Kinematics) -> float:
    """Return the step with which a simulation over time begins, s."""
    if scene.speed_profile is not None:
        # What a rough floor asks for grows with the speed.
        scene = replace(scene, speed=scene.speed_profile.speed_range[1], speed_profile=None)
        lines = kinematics(scene.bearing, scene.speed)
    return min(DEFAULT_STEP, 1.0 / (lines.bpfo * steps_for(scene)))


def default_settling(lines: Kinematics) -> float:
    """Return the time to drop at the beginning, s: the longer of 40 ball periods and 0.2 s."""
    return max(_SETTLE_SECONDS, _SETTLE_PERIODS / lines.bpfo)


@lru_cache(maxsize=512)
def check_resonance(scene: Scene) -> None:
    """Raise a ValueError where a healthy scene has a resonance, at rest, above HIGHEST_RESONANCE ball rates."""
    rig, parameter = scene.rig_as(Rig), operating_point(scene).parameter
    duration = 1.0 / kinematics(scene.bearing, scene.speed).bpfo
    u = np.array([parameter[kernels.P_U_1], parameter[kernels.P_U_2]])
    angles, exponent = element_angles(scene.bearing), contact_exponent(scene.bearing)
    stiffness = contact_forces(u, angles, rig.k_c, scene.clearance, exponent)[1]
    # The sum of the squares of all is at least the highest: most scenes need no more.
    k_b = float(np.trace(stiffness))
    most = math.sqrt((k_b + rig.k_i) / rig.m_i + (k_b + rig.k_r) / rig.m_o + rig.k_r / rig.m_r)
    if most * duration <= 2.0 * math.pi * HIGHEST_RESONANCE:
        return
    highest = float(natural_frequencies(rig, float(stiffness[1, 1]), float(stiffness[0, 0]))[-1])
    if highest * duration > HIGHEST_RESONANCE:
        raise ValueError(
            f"the highest resonance of the rig, {highest:.4g} Hz, is {highest * duration:.3g} times the ball rate of "
            f"{1.0 / duration:.4g} Hz, at most {HIGHEST_RESONANCE:.0e} times it are resolved: "
            f"the speed, {scene.speed!r} Hz, is too low for it"
        )


@lru_cache(maxsize=512)
def operating_point(scene: Scene) -> OperatingPoint:
    """Return what scenes share that differ from this one, which is healthy, in their defect only."""
    bearing = scene.bearing
    pitch = 2.0 * math.pi / bearing.n_elements
    offsets = np.linspace(0.0, pitch, bearing.rows, endpoint=False)
    starts = (offsets[:, None] + pitch * np.arange(bearing.n_elements)).ravel()
    # By the distance from the load of the arc that each passes in a period.
    order = np.argsort(np.maximum(np.abs(wrap(starts + 0.5 * pitch)) - 0.5 * pitch, 0.0), kind="stable")
    return OperatingPoint(
        parameter=scene_parameters(scene),
        positions=starts[order],
        rows=np.repeat(np.arange(bearing.rows), bearing.n_elements)[order],
        offsets=offsets,
        waves=np.array(
            [
                [w.amplitude * math.cos(bearing.contact_angle), float(w.order), w.phase]
                for w in scene.waviness
                if w.amplitude != 0.0
            ]
        ).reshape(-1, 3),
        power=contact_power(bearing),
    )


def contact_power(bearing: Bearing) -> float:
    """Return the kernels' ``power`` of the contacts of a bearing."""
    return contact_exponent(bearing) - 1.0


def defect_arrays(bearing: Bearing, defects: Iterable[Defect]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the kernel's ``paths`` and ``profile`` of defects of the outer race that move a ball
    (models.solve.six_dof.kernels.path).
    """
    arrays: list[NDArray[np.float64]] = []
    profiles = [_NO_PROFILE]
    for defect in defects:
        path = ball_path(bearing, defect)
        if path is None:
            continue
        array = np.zeros(kernel_path.DEFECT)
        array[kernel_path.D_RACE], array[kernel_path.D_BALL] = path.r_o, path.r_b
        array[kernel_path.D_COSINE], array[kernel_path.D_POSITION] = path.cos_alpha, path.position
        array[kernel_path.D_HALF], array[kernel_path.D_DEPTH] = path.half_width, path.h_d
        array[kernel_path.D_REACH] = path.reach
        array[kernel_path.D_ROW], array[kernel_path.D_ROWS_END] = defect.first_row, defect.first_row + defect.rows
        if path.profile is not None and path.roughness > 0.0:
            array[kernel_path.D_ROUGHNESS], array[kernel_path.D_SPACING] = path.roughness, path.profile.spacing
            array[kernel_path.D_HIGHEST] = path.profile.highest
            pieces = path.profile.coefficients
            array[kernel_path.D_PIECE] = sum(each.shape[1] for each in profiles)
            array[kernel_path.D_PIECES] = pieces.shape[1]
            profiles.append(pieces)
        arrays.append(array)
    profile = np.concatenate(profiles, axis=1) if len(profiles) > 1 else _NO_PROFILE
    return np.array(arrays).reshape(-1, kernel_path.DEFECT), profile


@lru_cache(maxsize=512)
def _unit_equilibrium(bearing: Bearing) -> NDArray[np.float64]:
    """Return the displacement of a bearing without clearance where load over contact stiffness is one."""
    return static_equilibrium(element_angles(bearing), 1.0, 1.0, exponent=contact_exponent(bearing))


def _equilibrium(scene: Scene, force: tuple[float, float]) -> tuple[float, float]:
    """Return the static displacement along and across the load under a force, m."""
    # It is sought in a frame whose first axis lies along the force.
    size, angle = math.hypot(*force), math.atan2(force[1], force[0])
    k_c, exponent = scene.rig_as(Rig).k_c, contact_exponent(scene.bearing)
    if scene.clearance == 0.0 and angle == 0.0:
        # All contact forces then grow with the same power of the displacement.
        u = _unit_equilibrium(scene.bearing) * (size / k_c) ** (1.0 / exponent)
    else:
        angles = element_angles(scene.bearing, -angle)
        u = static_equilibrium(angles, size, k_c, clearance=scene.clearance, exponent=exponent)
    c, s = math.cos(angle), math.sin(angle)
    return float(u[0] * c - u[1] * s), float(u[0] * s + u[1] * c)


def scene_parameters(scene: Scene) -> NDArray[np.float64]:
    """Return the kernels' ``parameter`` array, for a sensor along the load."""
    rig, pitch = scene.rig_as(Rig), 2.0 * math.pi / scene.bearing.n_elements
    parameter = rig_parameters(rig, scene.clearance, pitch * kinematics(scene.bearing, scene.speed).bpfo)
    weight = scene.gravity * (rig.m_o + rig.m_r)
    force = (scene.load + weight * math.cos(scene.gravity_angle), weight * math.sin(scene.gravity_angle))
    parameter[kernels.P_PITCH] = pitch
    parameter[kernels.P_LOAD_1], parameter[kernels.P_LOAD_2] = force
    parameter[kernels.P_U_1], parameter[kernels.P_U_2] = _equilibrium(scene, force)
    return parameter


def rig_parameters(rig: Rig, clearance: float, omega: float) -> NDArray[np.float64]:
    """Return the kernels' ``parameter`` array without load and equilibrium; ``omega`` is that of the cage, rad/s."""
    reduced = rig.m_o * rig.m_r / (rig.m_o + rig.m_r)
    parameter = np.zeros(kernels.PARAMETERS)
    parameter[kernels.P_K_C] = rig.k_c
    parameter[kernels.P_ALPHA] = rig.alpha_c * rig.m_b
    parameter[kernels.P_BETA] = rig.beta_c * rig.k_c
    parameter[kernels.P_CLEARANCE] = clearance
    parameter[kernels.P_OMEGA] = omega
    parameter[kernels.P_TURN] = omega if rig.cage_in_rate else 0.0
    parameter[kernels.P_INV_M_I] = 1.0 / rig.m_i
    parameter[kernels.P_INV_M] = 1.0 / (rig.m_o + rig.m_r)
    parameter[kernels.P_INV_M_O] = 1.0 / rig.m_o
    parameter[kernels.P_INV_M_R] = 1.0 / rig.m_r
    parameter[kernels.P_SHARE_R] = rig.m_r / (rig.m_o + rig.m_r)
    parameter[kernels.P_K_R] = rig.k_r
    parameter[kernels.P_C_R] = rig.c_r
    parameter[kernels.P_SQUARE_I] = rig.k_i / rig.m_i
    parameter[kernels.P_DAMPING_I] = rig.c_i / rig.m_i
    parameter[kernels.P_SQUARE_R] = rig.k_r / reduced
    parameter[kernels.P_DAMPING_R] = rig.c_r / reduced
    parameter[kernels.P_DIRECTION_1] = 1.0
    return parameter
