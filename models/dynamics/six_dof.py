"""The six-degree-of-freedom model of a bearing on its rig (thesis, Eqs. 32-52 and 83-89), set up for its kernel.

Without slip the settled motion repeats exactly with every passage of a ball of one row, T = 1 / BPFO. A ``BallPeriod``
holds everything that one such period needs; ``models.dynamics.orbit`` finds the motion that repeats.

Scheme: Lawson-RK4. The linear part (Eqs. 40-42, static contact force included) is carried by exact propagators, so the
7.4 kHz resonator costs no accuracy; the contact force is integrated with four evaluations a step. The force jumps where
the path of the balls has a kink (its slope enters the damping, Eq. 36); steps therefore end on the kinks and use the
one-sided slope at either side, without which the error falls only slowly with the step and never averages out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.defect import BallPath, ball_path
from models.hertz import element_angles, static_equilibrium
from models.kernels import six_dof as kernels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.bearing import Bearing
    from models.scene import Rig, Scene

# Default step: benchmarks/six_dof.py prints the error that it leaves.
DEFAULT_STEP = 10e-6
MIN_STEPS = 512
# Kinks closer than this are one; it exceeds the rounding of any angle, and the nudge exceeds it in turn.
_SAME_ANGLE = 1e-7
_NUDGE = 1e-9
_NEAR_ANGLE = math.pi / 2.0 + math.atan(kernels.NEAR_SLOPE)


@dataclass(frozen=True, eq=False)
class BallPeriod:
    """One ball period of one scene, ready for the kernel (array shapes: models/kernels/six_dof.py).

    Attributes:
        duration: T = 1 / BPFO, s.
        steps: number of steps.
        time: time of each recorded value since the start of the period, s, shape (steps + segments,); the ends of
            neighbouring segments are recorded twice, once from either side.
        weight: quadrature weights of the recorded values divided by the period, so that ``weight @ x`` is a mean.
    """

    duration: float
    steps: int
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
    parameter: NDArray[np.float64]
    time: NDArray[np.float64]
    weight: NDArray[np.float64]

    def run(self, state: NDArray[np.float64], wave: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        """Return the state (2, 6) after one period and the kernel's status; write accelerations into ``wave``.

        Args:
            state: deviation from the static equilibrium at the start, shape (2, 6), m and m/s.
            wave: shape (steps + segments, 2), written: acceleration of m_o and m_r along the load, m/s2.
        """
        after = np.empty((2, 6))
        status = kernels.ball_period(
            state,
            after,
            wave,
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
        return after, status

    def new_wave(self) -> NDArray[np.float64]:
        """Return an array for ``run`` to write to."""
        return np.empty((len(self.time), 2))


def check_scene(scene: Scene) -> None:
    """Refuse what the model cannot describe.

    Raises:
        ValueError: naming the field, what it is and what is expected.
    """
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


def default_steps(scene: Scene) -> int:
    """Return the steps per ball period with which a scene is simulated unless another number is asked for."""
    return max(MIN_STEPS, math.ceil(1.0 / (kinematics(scene.bearing, scene.speed).bpfo * DEFAULT_STEP)))


def prepare(scene: Scene, steps_per_period: int | None = None) -> BallPeriod:
    """Return one ball period of a scene.

    Args:
        scene: what is modelled.
        steps_per_period: steps a ball period is to have at least (a few more, because steps end on kinks); by default
            so many that a step is 10 us at most, and 512 at least.

    Raises:
        ValueError: if the scene is outside the model, or steps_per_period is less than 8.
    """
    check_scene(scene)
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    if steps_per_period is None:
        steps_per_period = default_steps(scene)
    if steps_per_period < 8:
        raise ValueError(f"steps_per_period must be at least 8, got {steps_per_period!r}")
    path = ball_path(scene.bearing, scene.defect)
    pitch = 2.0 * math.pi / scene.bearing.n_elements
    damaged, plain, near = _positions(scene, path)
    bounds = _segments(path, damaged, pitch)
    first, angles, weight = _grid(bounds, steps_per_period, pitch)
    omega = 2.0 * math.pi * bpfo / scene.bearing.n_elements
    depth, rate = _path_table(path, damaged, angles)
    fractions = np.linspace(0.0, 1.0, 2 * kernels.SUBSTEPS + 1)
    step = np.diff(bounds) / np.diff(first) / omega
    ends = [np.linspace(bounds[k], bounds[k + 1], first[k + 1] - first[k] + 1) for k in range(len(first) - 1)]
    return BallPeriod(
        duration=1.0 / bpfo,
        steps=int(first[-1]),
        first=first,
        flow=np.array([[h, *_propagators(scene.rig, h)] for h in step]),
        part=np.array([_propagators(scene.rig, h / kernels.SUBSTEPS) for h in step]),
        turn=_turns(angles),
        advance=_turns(omega * step[:, None] * fractions),
        damaged=_positions_table(damaged, 0),
        plain=_positions_table(plain, len(damaged)),
        near=near,
        depth=depth,
        rate=omega * rate,
        parameter=_parameters(scene, omega),
        time=np.concatenate(ends) / omega,
        weight=weight,
    )


def _positions(scene: Scene, path: BallPath | None) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return the ball positions at the start that the defect can and cannot touch, rad, and how many of the latter are
    near the load direction (the others cannot touch while the displacement across the load is small).
    """
    bearing = scene.bearing
    pitch = 2.0 * math.pi / bearing.n_elements
    damaged: list[float] = []
    plain: list[float] = []
    rows_damaged = 0 if path is None or scene.defect is None else scene.defect.rows
    for row in range(bearing.rows):
        for element in range(bearing.n_elements):
            start = row * pitch / bearing.rows + element * pitch
            touches = (
                row < rows_damaged and path is not None and _arc_distance(start, pitch, path.position) < path.half_width
            )
            (damaged if touches else plain).append(start)
    plain.sort(key=lambda start: _arc_distance(start, pitch, 0.0))
    near = sum(_arc_distance(start, pitch, 0.0) <= _NEAR_ANGLE for start in plain)
    return np.array(damaged), np.array(plain), near


def _arc_distance(start: float, length: float, angle: float) -> float:
    """Return the distance of an angle from the arc that begins at ``start``, rad, zero inside."""
    middle = start + 0.5 * length - angle
    off = abs(math.remainder(middle, 2.0 * math.pi))
    return max(0.0, off - 0.5 * length)


def _segments(path: BallPath | None, damaged: NDArray[np.float64], pitch: float) -> NDArray[np.float64]:
    """Return the cage angles at which segments begin and end, rad, from 0 to the pitch."""
    bounds = [0.0]
    if path is not None and len(damaged):
        # Rows that are staggered by a part of the pitch meet the same kink at different times.
        offsets = np.unique(np.round(np.mod(damaged, pitch), 12))
        times = np.sort(np.mod(path.kinks()[:, None] - offsets, pitch).ravel())
        for time in times:
            if _SAME_ANGLE < time < pitch - _SAME_ANGLE and time - bounds[-1] > _SAME_ANGLE:
                bounds.append(float(time))
    return np.array([*bounds, pitch])


def _grid(
    bounds: NDArray[np.float64], steps: int, pitch: float
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the first step of each segment, cage angles (steps, 3) and quadrature weights (a mean over the period)."""
    lengths = np.diff(bounds)
    counts = np.maximum(1, np.ceil(lengths * (steps / pitch) - 1e-9).astype(np.int64))
    first = np.concatenate(([0], np.cumsum(counts)))
    angles = np.empty((int(first[-1]), 3))
    weights = []
    for k, count in enumerate(counts):
        nodes = np.linspace(bounds[k], bounds[k + 1], 2 * count + 1)
        part = angles[first[k] : first[k + 1]]
        # The ends are nudged inwards, so that path slopes are the limits from within the step.
        part[:, 0], part[:, 1], part[:, 2] = nodes[0:-1:2] + _NUDGE, nodes[1::2], nodes[2::2] - _NUDGE
        weights.append(quadrature(int(count)) * (lengths[k] / count / pitch))
    return first.astype(np.int64), angles, np.concatenate(weights)


def quadrature(steps: int) -> NDArray[np.float64]:
    """Return weights of fourth order for ``steps`` equal steps of length one, shape (steps + 1,).

    The trapezoid rule with Gregory's end corrections; closed Newton-Cotes rules where there are too few steps for them.
    """
    few = {
        1: [0.5, 0.5],
        2: [1 / 3, 4 / 3, 1 / 3],
        3: [3 / 8, 9 / 8, 9 / 8, 3 / 8],
        4: [14 / 45, 64 / 45, 24 / 45, 64 / 45, 14 / 45],
    }
    if steps in few:
        return np.array(few[steps])
    weights = np.ones(steps + 1)
    correction = np.array([-5 / 8, 1 / 6, -1 / 24])
    weights[:3] += correction
    weights[-3:] += correction[::-1]
    return weights


def _path_table(
    path: BallPath | None, damaged: NDArray[np.float64], angles: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return depth d, m, and slope d', m/rad, of the damaged positions at the grid's cage angles, (steps, 3, D)."""
    if path is None or len(damaged) == 0:
        empty = np.zeros((*angles.shape, 0))
        return empty, empty
    depth, slope = path(angles[:, :, None] + damaged)
    return np.ascontiguousarray(depth), np.ascontiguousarray(slope)


def _turns(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack((np.cos(angles), np.sin(angles)), axis=-1)


def _positions_table(angles: NDArray[np.float64], first: int) -> NDArray[np.float64]:
    """Return cosine, sine and a distinct power of two of positions, (3, positions); the powers begin at 2**first."""
    powers = np.ldexp(1.0, np.arange(first, first + len(angles)))
    return np.stack((np.cos(angles), np.sin(angles), powers))


def oscillator(omega_squared: float, damping: float, h: float) -> tuple[float, float, float, float]:
    """Return the propagator over a time h of x'' + damping x' + omega_squared x = 0, row by row of (x, x')."""
    half = 0.5 * damping
    under = omega_squared - half * half
    decay = math.exp(-half * h)
    if under > 0.0:
        w = math.sqrt(under)
        c, s = math.cos(w * h), math.sin(w * h) / w
    elif under < 0.0:
        w = math.sqrt(-under)
        c, s = math.cosh(w * h), math.sinh(w * h) / w
    else:
        c, s = 1.0, h
    return decay * (c + half * s), decay * s, -decay * omega_squared * s, decay * (c - half * s)


def _propagators(rig: Rig, h: float) -> list[float]:
    """Return the propagators that carry half of a step of length h, s (the kernel's ``flow`` without h)."""
    reduced = rig.m_o * rig.m_r / (rig.m_o + rig.m_r)
    inner = oscillator(rig.k_i / rig.m_i, rig.c_i / rig.m_i, 0.5 * h)
    resonator = oscillator(rig.k_r / reduced, rig.c_r / reduced, 0.5 * h)
    return [*inner, 0.5 * h, *resonator]


@lru_cache(maxsize=512)
def _equilibrium(bearing: Bearing, load: float, k_c: float, clearance: float) -> tuple[float, float]:
    u = static_equilibrium(element_angles(bearing), load, k_c, clearance=clearance)
    return float(u[0]), float(u[1])


def _parameters(scene: Scene, omega: float) -> NDArray[np.float64]:
    """Return the kernel's ``parameter`` array."""
    rig = scene.rig
    u = _equilibrium(scene.bearing, scene.load, rig.k_c, scene.clearance)
    parameter = np.zeros(kernels.PARAMETERS)
    parameter[kernels.P_K_C] = rig.k_c
    parameter[kernels.P_ALPHA] = rig.alpha_c * rig.m_b
    parameter[kernels.P_BETA] = rig.beta_c * rig.k_c
    parameter[kernels.P_CLEARANCE] = scene.clearance
    parameter[kernels.P_OMEGA] = omega
    parameter[kernels.P_LOAD] = scene.load
    parameter[kernels.P_INV_M_I] = 1.0 / rig.m_i
    parameter[kernels.P_INV_M] = 1.0 / (rig.m_o + rig.m_r)
    parameter[kernels.P_INV_M_O] = 1.0 / rig.m_o
    parameter[kernels.P_INV_M_R] = 1.0 / rig.m_r
    parameter[kernels.P_SHARE_R] = rig.m_r / (rig.m_o + rig.m_r)
    parameter[kernels.P_K_R] = rig.k_r
    parameter[kernels.P_C_R] = rig.c_r
    parameter[kernels.P_U_1] = u[0]
    parameter[kernels.P_U_2] = u[1]
    return parameter
