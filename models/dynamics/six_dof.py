"""The six-degree-of-freedom model of a bearing on its rig (thesis, Eqs. 32-52 and 83-89), set up for its kernel.

Without slip the settled motion repeats exactly with every passage of a ball of one row, T = 1 / BPFO.

Scheme: Lawson-RK4. The linear part (Eqs. 40-42, static contact force included) is carried by exact propagators, so the
7.4 kHz resonator costs no accuracy; the contact force is integrated with four evaluations a step. The force jumps where
the path of the balls has a kink (its slope enters the damping, Eq. 36); steps therefore end on the kinks and use the
one-sided slope at either side, without which the error falls only slowly with the step and never averages out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.hertz import BALL_EXPONENT, element_angles, static_equilibrium
from models.kernels import path as kernel_path
from models.kernels import six_dof as kernels
from models.kernels.orbit import settle
from models.kernels.period_setup import arc_distance, set_up
from models.path.defect import ball_path

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.bearing import Bearing
    from models.scene import Defect, Rig, Scene

    _Floats = NDArray[np.float64]
    _Arguments = tuple[
        NDArray[np.int64], _Floats, _Floats, _Floats, _Floats, _Floats, _Floats, int, _Floats, _Floats, _Floats
    ]

# Longest step, s, and fewest steps a period with a relative error of the RMS below the key (rms over
# scenes); benchmarks/six_dof.py prints the actual error. The default is the finest.
GRADES = {2e-3: (28e-6, 128), 1e-3: (20e-6, 128), 2e-4: (10e-6, 512)}

# Read-only as the profiles of rough floors are: another type of array would be another kernel.
_NO_PROFILE = np.zeros((4, 0))
_NO_PROFILE.flags.writeable = False


@dataclass(frozen=True, eq=False)
class BallPeriod:
    """One ball period of one scene, ready for the kernel (array shapes: models/kernels/six_dof.py).

    Attributes:
        duration: T = 1 / BPFO, s.
        time: time of each recorded value since the start of the period, s, shape (steps + segments,); the ends of
            neighbouring segments are recorded twice, once from either side.
        weight: quadrature weights of the recorded values divided by the period, so that ``weight @ x`` is a mean.
    """

    duration: float
    steps: int
    parameter: NDArray[np.float64]
    first: NDArray[np.int64]
    flow: NDArray[np.float64]
    part: NDArray[np.float64]
    turn: NDArray[np.float64]
    advance: NDArray[np.float64]
    damaged: NDArray[np.float64]
    plain: NDArray[np.float64]
    near: int
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    time: NDArray[np.float64]
    weight: NDArray[np.float64]

    def run(self, state: NDArray[np.float64], wave: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        """Return the state (2, 6) after one period and the kernel's status; write accelerations into ``wave``.

        ``state`` is the deviation from the static equilibrium at the start, m and m/s; ``wave``, shape
        (steps + segments, 2), takes the acceleration of m_o and m_r along the load, m/s2.
        """
        after = np.empty((2, 6))
        return after, kernels.ball_period(state, after, wave, *self._arguments())

    def settle(
        self,
        state: NDArray[np.float64],
        wave: NDArray[np.float64],
        scale: NDArray[np.float64],
        steering: NDArray[np.float64],
        tolerance: float,
        cap: int,
    ) -> tuple[NDArray[np.float64], int, float, float, bool]:
        """Search from ``state`` for the motion that repeats, in at most ``cap`` periods (models.kernels.orbit.settle).

        Returns:
            State at the start of the last period, periods, relative change and value of the RMS, whether it settled.
        """
        last = np.empty((2, 6))
        found = settle(state, last, wave, *self._arguments(), self.weight, scale, steering, tolerance, cap)
        return last, *found

    def _arguments(self) -> _Arguments:
        """Return the arguments that both kernels share, in their order."""
        return (
            self.first,
            self.flow,
            self.part,
            self.turn,
            self.advance,
            self.damaged,
            self.plain,
            self.near,
            self.depth,
            self.rate,
            self.parameter,
        )

    def new_wave(self) -> NDArray[np.float64]:
        """Return an array for ``run`` to write to."""
        return np.empty((len(self.time), 2))


def check_scene(scene: Scene) -> None:
    """Raise a ValueError that names a field which the model does not describe, its value and the expected one."""
    if scene.effects:
        raise ValueError(f"{', '.join(scene.effects)}: only models.dynamics.time_domain.simulate_time models this")
    if scene.bearing.element != "ball":
        raise ValueError(f"six_dof models ball bearings, {scene.bearing.designation} has {scene.bearing.element}s")
    if scene.bearing.rotating_ring != "inner":
        raise ValueError("six_dof models a turning inner ring; rotating_ring is 'outer'")
    for name, value in (("load", scene.load), ("clearance", scene.clearance)):
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} must be finite and not negative, got {value!r}")
    for name in ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c"):
        value = getattr(scene.rig, name)
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"rig.{name} must be positive and finite, got {value!r}")
    for name in ("m_b", "c_i", "c_r", "alpha_c", "beta_c"):
        value = getattr(scene.rig, name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"rig.{name} must be finite and not negative, got {value!r}")
    if scene.defect is not None and not 1 <= scene.defect.rows <= scene.bearing.rows:
        raise ValueError(f"defect.rows must lie between 1 and {scene.bearing.rows}, got {scene.defect.rows!r}")


def check_steps(steps_per_period: int) -> None:
    """Raise a ValueError for fewer than 8 steps, with which nothing can be integrated."""
    if steps_per_period < 8:
        raise ValueError(f"steps_per_period must be at least 8, got {steps_per_period!r}")


def steps_for(scene: Scene, accuracy: float | None = None) -> int:
    """Return the default number of steps per ball period of a scene.

    ``accuracy`` is the target of the relative error of the RMS (rms over scenes), at least 2e-4, the default.

    Raises:
        ValueError: if accuracy is finer than the finest grade, or not a number.
    """
    grades = [grade for grade in GRADES if accuracy is None or grade <= accuracy]
    if not grades:
        raise ValueError(f"accuracy must be at least {min(GRADES)!r}, got {accuracy!r}; name steps_per_period for less")
    step, fewest = GRADES[min(grades) if accuracy is None else max(grades)]
    return max(fewest, math.ceil(1.0 / (kinematics(scene.bearing, scene.speed).bpfo * step)))


def prepare(scene: Scene, steps_per_period: int | None = None, accuracy: float | None = None) -> BallPeriod:
    """Return one ball period of a scene.

    ``steps_per_period`` is a minimum (steps end on kinks, so a few more are taken), by default that of ``accuracy``.

    Raises:
        ValueError: if the scene is outside the model, steps_per_period is less than 8, or accuracy too fine.
    """
    check_scene(scene)
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    if steps_per_period is None:
        steps_per_period = steps_for(scene, accuracy)
    check_steps(steps_per_period)
    point = operating_point(replace(scene, defect=None))
    path, profile = defect_arrays(scene.bearing, scene.defect)
    found = set_up(
        path,
        profile,
        point.positions,
        point.rows,
        point.offsets[: damaged_rows(scene.defect)],
        point.pitch,
        steps_per_period,
        point.omega,
        point.linear,
    )
    return BallPeriod(1.0 / bpfo, len(found[3]), point.parameter, *found)


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """What all scenes of one operating point share (arrays: models.kernels.period_setup.set_up)."""

    positions: NDArray[np.float64]
    rows: NDArray[np.int64]
    offsets: NDArray[np.float64]
    pitch: float
    omega: float
    linear: NDArray[np.float64]
    parameter: NDArray[np.float64]


@lru_cache(maxsize=512)
def operating_point(scene: Scene) -> OperatingPoint:
    """Return what scenes share that differ from this one, which is healthy, in their defect only."""
    bearing, rig = scene.bearing, scene.rig
    pitch = 2.0 * math.pi / bearing.n_elements
    omega = pitch * kinematics(bearing, scene.speed).bpfo
    offsets = np.linspace(0.0, pitch, bearing.rows, endpoint=False)
    places = [(offset + k * pitch, row) for row, offset in enumerate(offsets) for k in range(bearing.n_elements)]
    places.sort(key=lambda place: arc_distance(place[0], pitch, 0.0))
    reduced = rig.m_o * rig.m_r / (rig.m_o + rig.m_r)
    return OperatingPoint(
        positions=np.array([start for start, _ in places]),
        rows=np.array([row for _, row in places], dtype=np.int64),
        offsets=offsets,
        pitch=pitch,
        omega=omega,
        linear=np.array([rig.k_i / rig.m_i, rig.c_i / rig.m_i, rig.k_r / reduced, rig.c_r / reduced]),
        parameter=_parameters(scene, omega),
    )


def damaged_rows(defect: Defect | None) -> int:
    """Return the number of rows with a defect that moves a ball."""
    return 0 if defect is None or defect.dphi_d == 0.0 or defect.h_d == 0.0 else defect.rows


def defect_arrays(bearing: Bearing, defect: Defect | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the kernel's ``path`` and ``profile`` of a defect (models.kernels.path)."""
    array, profile = np.zeros(kernel_path.DEFECT), _NO_PROFILE
    path = ball_path(bearing, defect)
    if path is None:
        return array, profile
    array[kernel_path.D_RACE], array[kernel_path.D_BALL] = path.r_o, path.r_b
    array[kernel_path.D_COSINE], array[kernel_path.D_POSITION] = path.cos_alpha, path.position
    array[kernel_path.D_HALF], array[kernel_path.D_DEPTH] = path.half_width, path.h_d
    array[kernel_path.D_REACH] = path.reach
    if path.profile is not None and path.roughness > 0.0:
        profile = path.profile.coefficients
        array[kernel_path.D_ROUGHNESS], array[kernel_path.D_SPACING] = path.roughness, path.profile.spacing
        array[kernel_path.D_HIGHEST] = path.profile.highest
    return array, profile


@lru_cache(maxsize=512)
def _unit_equilibrium(bearing: Bearing) -> NDArray[np.float64]:
    """Return the displacement of a bearing without clearance where load over contact stiffness is one."""
    return static_equilibrium(element_angles(bearing), 1.0, 1.0)


def _equilibrium(scene: Scene) -> NDArray[np.float64]:
    """Return the static displacement along and across the load, m."""
    k_c = scene.rig.k_c
    if scene.clearance == 0.0:
        # All contact forces then grow with the power 3/2 of the displacement.
        return _unit_equilibrium(scene.bearing) * (scene.load / k_c) ** (1.0 / BALL_EXPONENT)
    return static_equilibrium(element_angles(scene.bearing), scene.load, k_c, clearance=scene.clearance)


def _parameters(scene: Scene, omega: float) -> NDArray[np.float64]:
    """Return the kernel's ``parameter`` array."""
    parameter = rig_parameters(scene.rig, scene.clearance, omega)
    parameter[kernels.P_LOAD] = scene.load
    parameter[kernels.P_U_1], parameter[kernels.P_U_2] = _equilibrium(scene)
    return parameter


def rig_parameters(rig: Rig, clearance: float, omega: float) -> NDArray[np.float64]:
    """Return the kernel's ``parameter`` array without load and equilibrium; ``omega`` is that of the cage, rad/s."""
    parameter = np.zeros(kernels.PARAMETERS)
    parameter[kernels.P_K_C] = rig.k_c
    parameter[kernels.P_ALPHA] = rig.alpha_c * rig.m_b
    parameter[kernels.P_BETA] = rig.beta_c * rig.k_c
    parameter[kernels.P_CLEARANCE] = clearance
    parameter[kernels.P_OMEGA] = omega
    parameter[kernels.P_INV_M_I] = 1.0 / rig.m_i
    parameter[kernels.P_INV_M] = 1.0 / (rig.m_o + rig.m_r)
    parameter[kernels.P_INV_M_O] = 1.0 / rig.m_o
    parameter[kernels.P_INV_M_R] = 1.0 / rig.m_r
    parameter[kernels.P_SHARE_R] = rig.m_r / (rig.m_o + rig.m_r)
    parameter[kernels.P_K_R] = rig.k_r
    parameter[kernels.P_C_R] = rig.c_r
    return parameter
