"""What the kernels of the rotor need for a run: parameters, balls, edges of defects, and the beginning at rest.

Readings of Ceruti's thesis; numbers are those of the corrections in docs/evidence/models.md.

* Contact: Hertz, f = k_c delta^1.5, with the damping c_b of a loaded ball beside it (1, 2); the rate of compression is
  that of the ring alone, neither the turn of the cage nor the profile of a defect enters it (section 2.4.1).
* A defect of a race relieves a ball by h_d sin(pi psi / dphi_d), psi from its edge (4); that of the inner race is
  met by the angle between ball and shaft (5). One of a ball relieves it by h_d while it lies within dphi_d of either
  contact (6). ``Defect.position`` is the middle.
* The bow of the shaft is a load that turns: with r = r~ + b e^{i(Omega t + alpha_b)} the line through the bearings r~
  obeys the equations without a bow, and the inertia, damping and gyroscopic moment of what turns with it (9).
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent, element_angles, static_equilibrium
from models.solve.engine.passages import half_wave_meetings, in_intervals
from models.solve.rotor import kernel as kernels
from models.solve.rotor.rig import RotorRig

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect, Scene

Rows = tuple["NDArray[np.float64]", ...]


def bearings_of(scene: Scene) -> tuple[Bearing, Bearing]:
    """Return the bearings at A and B; they are alike where the scene has no second one."""
    return scene.bearing, scene.bearing if scene.second_bearing is None else scene.second_bearing


def check_rotor(scene: Scene) -> RotorRig:
    """Return the parameters of a scene's rotor; raise a ValueError that names what they cannot belong to."""
    rig = scene.rig_as(RotorRig)
    rig.check_bearing(bearings_of(scene)[1])
    return rig


def prepare_plan(scene: Scene, duration: float, freedoms: int, direction: float = 0.0) -> kernels.RotorPlan:
    """Return everything the kernels need for a run of ``duration`` seconds.

    ``freedoms``: 4 where the state is that of the disc alone, 8 where the ends of an elastic shaft have a mass.
    ``direction``: angle of the sensors from the load, rad.
    """
    rig = check_rotor(scene)
    angles = ball_angles(scene)
    begin, end, ball, depth, rate, offset = _meetings(scene, duration)
    cut = in_intervals(begin, end, duration)
    record = cut.record
    return kernels.RotorPlan(
        parameter=_parameters(scene, rig, freedoms, direction),
        slots=np.stack([np.cos(np.concatenate(angles)), np.sin(np.concatenate(angles))]),
        of_a=np.array([len(angles[0])], dtype=np.int64),
        bounds=cut.bounds,
        first=cut.first,
        ball=ball[record].astype(np.int64),
        depth=depth[record],
        rate=rate[record],
        offset=offset[record],
    )


def ball_angles(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the angles of the balls of A and of B from the load at the beginning, rad."""
    rig, (bearing_a, bearing_b) = scene.rig_as(RotorRig), bearings_of(scene)
    return element_angles(bearing_a, rig.cage_angle_a), element_angles(bearing_b, rig.cage_angle_b)


def _parameters(scene: Scene, rig: RotorRig, freedoms: int, direction: float) -> NDArray[np.float64]:
    p, shaft = np.zeros(kernels.P_SIZE), 2.0 * math.pi * scene.speed
    p[kernels.P_COUNT] = freedoms
    p[kernels.P_A], p[kernels.P_B] = rig.a, rig.b
    p[kernels.P_LOAD] = scene.load
    p[kernels.P_DISC_DAMPING], p[kernels.P_TILT_DAMPING] = rig.c_n, rig.c_t
    p[kernels.P_GYRATION], p[kernels.P_SHAFT] = shaft * rig.j_p, shaft
    p[kernels.P_INVERSE_11], p[kernels.P_INVERSE_12], p[kernels.P_INVERSE_22] = inverse_mass(rig, rigid=freedoms == 4)
    # exp(i bow_angle) times bow: what the disc is away from the line through the bearings.
    bow = scene.bow * cmath.exp(1j * rig.bow_angle)
    force = scene.unbalance * shaft**2 + (rig.m * shaft**2 - 1j * shaft * rig.c_n) * bow
    gyration = (rig.j_t - rig.j_p) * shaft**2 - 1j * shaft * rig.c_t
    moment = scene.couple_unbalance * shaft**2 * cmath.exp(1j * rig.couple_angle) + gyration * rig.bow_slope * bow
    p[kernels.P_FORCE_1], p[kernels.P_FORCE_2] = force.real, force.imag
    p[kernels.P_MOMENT_1], p[kernels.P_MOMENT_2] = moment.real, moment.imag
    p[kernels.P_BOW_1], p[kernels.P_BOW_2] = -(shaft**2) * bow.real, -(shaft**2) * bow.imag
    p[kernels.P_INVERSE_END] = 1.0 / rig.end_mass if rig.end_mass > 0.0 else 0.0
    p[kernels.P_SHAFT_LOSS] = rig.internal_damping
    p[kernels.P_DIRECTION_1], p[kernels.P_DIRECTION_2] = math.cos(direction), math.sin(direction)
    for k, bearing in enumerate(bearings_of(scene)):
        at = kernels.P_PER_BEARING + k * kernels.B_SIZE
        p[kernels.P_CAGE + k] = 2.0 * math.pi * kinematics(bearing, scene.speed).ftf
        p[at + kernels.B_STIFFNESS] = stiffness_of(rig, k)
        p[at + kernels.B_DAMPING], p[at + kernels.B_CLEARANCE] = rig.c_b, scene.clearance
        p[at + kernels.B_POWER] = contact_exponent(bearing)
        p[at + kernels.B_SPRING] = rig.shaft_stiffness[k]
    return p


def inverse_mass(rig: RotorRig, *, rigid: bool) -> tuple[float, float, float]:
    """Return 11, 12 and 22 of the inverse of the matrix of masses of r and phi; a rigid shaft has its ends in it."""
    end = rig.end_mass if rigid else 0.0
    m_11, m_12 = rig.m + 2.0 * end, end * (rig.a - rig.b)
    m_22 = rig.j_t + end * (rig.a**2 + rig.b**2)
    determinant = m_11 * m_22 - m_12**2
    return m_22 / determinant, -m_12 / determinant, m_11 / determinant


def stiffness_of(rig: RotorRig, bearing: int) -> float:
    """Return the contact stiffness of the balls of A (0) or B (1)."""
    return rig.k_c if bearing == 0 or rig.k_c_b is None else rig.k_c_b


def at_rest(scene: Scene, *, elastic: bool) -> NDArray[np.float64]:
    """Return the static equilibrium at t = 0: x, y, p, s of the disc, x, y of A and of B, m and rad, shape (8,)."""
    rig = scene.rig_as(RotorRig)
    reactions = scene.load * rig.b / rig.length, scene.load * rig.a / rig.length
    ends = [
        static_equilibrium(
            angles,
            reactions[k],
            stiffness_of(rig, k),
            clearance=scene.clearance,
            exponent=contact_exponent(bearings_of(scene)[k]),
        )
        for k, angles in enumerate(ball_angles(scene))
    ]
    sag = np.array(
        [[reactions[k] / rig.shaft_stiffness[k] if elastic else 0.0, 0.0] for k in range(2)], dtype=np.float64
    )
    above = np.array(ends) + sag
    disc = (rig.b * above[0] + rig.a * above[1]) / rig.length
    return np.concatenate((disc, (above[0] - above[1]) / rig.length, *ends))


def _meetings(scene: Scene, duration: float) -> Rows:
    """Return begin, end, ball, depth, rate and offset of all passages over defects within a run."""
    found = [_passages(scene, defect, duration) for defect in scene.defects if defect.moves_balls]
    if not found:
        return tuple(np.zeros(0) for _ in range(6))
    return tuple(np.concatenate(column) for column in zip(*found, strict=True))


def _passages(scene: Scene, defect: Defect, duration: float) -> Rows:
    side = 0 if defect.support == "a" else 1
    angles = ball_angles(scene)
    found = half_wave_meetings(bearings_of(scene)[side], scene.speed, angles[side], defect, duration)
    number = (found.element + side * len(angles[0])).astype(np.float64)
    return found.begin, found.end, number, found.depth, found.rate, found.offset
