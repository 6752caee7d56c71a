"""Scenes, references and runs of the work-precision diagram (benchmarks/integrators.py draws it).

Every method starts on the settled motion, integrates WARM + KEPT ball periods, and is judged over the last KEPT of
them, when its own errors have settled: at its own sample times (the start of every step, weighted with the step)
against the reference at the same times, so that what differs is the integration, not the quadrature.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from benchmarks import opponents as op
from models.machine.scene import Defect, Floor, Scene
from models.path.defect import RaceProfile, ball_path
from models.solve.six_dof.kernels.orbit import CALM_PERIODS, PLAIN_FIRST, settle
from models.solve.six_dof.kernels.period import blank_trace, mean_square
from models.solve.six_dof.kernels.step import P_OMEGA, P_PITCH
from models.solve.six_dof.periodic import steering
from tests.oracles import six_dof_oracle as oracle
from tests.support.periods import period_of, run

WARM, KEPT = 4, 7
DT0 = 1.0 / 51200.0
"""The step of the thesis, s."""
REFERENCE_STEPS = 32768
SCALE = np.array([1e-6] * 6 + [1e-2] * 6)

SCENES = {
    "healthy, 4 kN": Scene(40.0, 4000.0),
    "D2, 2 kN, 30 Hz": Scene(30.0, 2000.0, defect=Defect(math.radians(4.236), 500e-6)),
    "20 deg, 20 um, smooth": Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6)),
    "20 deg, 20 um, rough": Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6, Floor("rough"))),
    "50 deg, 32 um, smooth": Scene(40.0, 4000.0, defect=Defect(math.radians(50.0), 32e-6)),
}


@dataclass(frozen=True)
class Run:
    """What one method made of one scene: sample times, s, acceleration, m/s2, weights; steps and evaluations taken."""

    time: NDArray[np.float64]
    wave: NDArray[np.float64]
    weight: NDArray[np.float64]
    evaluations: int


@dataclass(frozen=True)
class Judged:
    """Relative errors of the RMS (signed) and of the waveform, evaluations and thread milliseconds per second."""

    rms_error: float
    wave_error: float
    evaluations_per_s: float
    ms_per_s: float


class Problem:
    """One scene: parameters for the opponents, and the reference."""

    def __init__(self, scene: Scene) -> None:
        """Find the settled motion and lay out what the kernels take."""
        self.scene, self.case = scene, case_of(scene)
        self.exact = oracle.Oracle(self.case)
        self.period = oracle.PITCH / self.case.omega_c
        self.end = (WARM + KEPT) * self.period
        self.arrays, self.rest = opponent_arrays(scene)
        self.fine = period_of(scene, REFERENCE_STEPS)
        self.state, trace, steer = np.empty((2, 6)), blank_trace(self.fine), steering(replace(scene, defect=None))
        found = settle(
            *(np.zeros((2, 6)), self.state, trace, self.fine),
            *(np.eye(12) if steer is None else steer, PLAIN_FIRST, CALM_PERIODS, 1e-11, 200, math.inf),
        )
        self.settled = found[3]
        self.wave = np.ascontiguousarray(trace.wave[:, 0])
        self.rms = math.sqrt(mean_square(trace, 0))

    def from_rest(self) -> NDArray[np.float64]:
        """Return the start of the settled motion for exponential methods, shape (12,)."""
        return self.state.ravel().copy()

    def from_zero_load(self) -> NDArray[np.float64]:
        """Return the start of the settled motion for explicit methods, shape (12,)."""
        share = oracle.M_R / (oracle.M_O + oracle.M_R)
        x = np.empty(12)
        for axis, (inner, v_inner, s, v_s, r, v_r) in enumerate(self.state):
            x[axis::2] = (
                inner,
                s + share * r,
                s + (share - 1.0) * r,
                v_inner,
                v_s + share * v_r,
                v_s + (share - 1) * v_r,
            )
        return x + self.rest

    def reference(self, when: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the casing's acceleration of the settled motion, m/s2; at a kink that after it."""
        fine, values = self.fine, np.empty(len(when))
        phase = np.mod(when + op.NUDGE, float(fine.parameter[P_PITCH] / fine.parameter[P_OMEGA]))
        starts = np.array([fine.time[fine.first[k] + k] for k in range(len(fine.first) - 1)])
        place = np.clip(np.searchsorted(starts, phase, "right") - 1, 0, len(starts) - 1)
        for k in range(len(starts)):
            rows = slice(fine.first[k] + k, fine.first[k + 1] + k + 1)
            here = place == k
            values[here] = CubicSpline(fine.time[rows], self.wave[rows])(phase[here])
        return values

    def judge(self, work: Callable[[], Run], rounds: int) -> Judged:
        """Run a method, compare its last periods, and time it (median; one round is the run itself)."""
        times = []
        run = None
        if rounds > 1:
            work()
        for _ in range(rounds):
            begin = time.thread_time()
            run = work()
            times.append(time.thread_time() - begin)
        assert run is not None
        kept = run.time >= run.time[0] + WARM / (WARM + KEPT) * self.end - 1e-9
        if len(run.time) < 8 or not np.all(np.isfinite(run.wave)):
            return Judged(math.inf, math.inf, run.evaluations / self.end, 1e3 * statistics.median(times) / self.end)
        wave, weight, truth = run.wave[kept], run.weight[kept], self.reference(run.time[kept])
        power = float(weight @ truth**2)
        return Judged(
            math.sqrt(float(weight @ wave**2) / power) - 1.0,
            math.sqrt(float(weight @ (wave - truth) ** 2) / power),
            run.evaluations / self.end,
            1e3 * statistics.median(times) / self.end,
        )

    def against_oracle(self) -> tuple[float, float]:
        """Return how far DOP853 leads away from the reference in two periods: RMS of the second, and its waveform."""
        x = self.from_zero_load()
        state = x.reshape(6, 2)[:, ::-1].ravel()
        state, _, _ = self.exact.period(state, 1e-9)
        _, when, wave = self.exact.period(state, 1e-10, 3000)
        # Each piece includes both of its ends; the nudge keeps them on their side of the kink.
        inward = np.where(np.append(np.diff(when) < 1e-12, True), -3.0 * op.NUDGE, 0.0)
        truth = self.reference(np.maximum(when + inward, 0.0))
        power = np.trapezoid(wave**2, when)
        rms = math.sqrt(np.trapezoid(truth**2, when) / power) - 1.0
        return rms, math.sqrt(np.trapezoid((wave - truth) ** 2, when) / power)


def opponent_arrays(scene: Scene) -> tuple[op.Scene, NDArray[np.float64]]:
    """Return what the opponents take of a scene, and its static equilibrium in displacements from zero load, (12,)."""
    case = case_of(scene)
    exact = oracle.Oracle(case)
    still = exact.at_rest()
    rest = np.array([still[1], still[0], still[3], still[2], still[5], still[4], *np.zeros(6)])
    par = np.zeros(op.PARAMETERS)
    rough, path = np.zeros((4, 0)), ball_path(scene.bearing, scene.defect)
    par[op.P_RACE], par[op.P_BALL], par[op.P_COSINE] = oracle.R_O, oracle.R_B, math.cos(oracle.ALPHA)
    par[op.P_HALF], par[op.P_DEPTH] = 0.5 * case.dphi_d, case.h_d
    par[op.P_REACH] = 0.999999 * math.asin(oracle.R_B / oracle.R_O)
    if path is not None and path.profile is not None:
        rough = np.array(path.profile.coefficients)
        par[op.P_ROUGHNESS], par[op.P_SPACING] = path.roughness, path.profile.spacing
    par[op.P_K_C], par[op.P_ALPHA] = oracle.K_C, oracle.ALPHA_C * oracle.M_B
    par[op.P_BETA], par[op.P_CLEARANCE] = oracle.BETA_C * oracle.K_C, case.clearance
    par[op.P_OMEGA], par[op.P_LOAD] = case.omega_c, case.load
    par[op.P_M_I], par[op.P_M_O], par[op.P_M_R] = oracle.M_I, oracle.M_O, oracle.M_R
    par[op.P_K_I], par[op.P_C_I], par[op.P_K_R], par[op.P_C_R] = oracle.K_I, oracle.C_I, oracle.K_R, oracle.C_R
    par[op.P_U_1], par[op.P_U_2] = rest[0] - rest[2], rest[1] - rest[3]
    start = exact.start
    ball = np.ascontiguousarray([start, np.cos(start), np.sin(start)])
    return (par, ball, exact.faulty.astype(np.float64), rough), rest


def case_of(scene: Scene) -> oracle.Case:
    """Return the oracle's description of a scene; a rough floor is handed over as numbers."""
    defect = scene.defect
    if defect is None:
        return oracle.Case(scene.speed, scene.load, clearance=scene.clearance)
    path = ball_path(scene.bearing, defect)
    rough = None if path is None or path.profile is None else roughness_of(path.profile, path.roughness)
    return oracle.Case(scene.speed, scene.load, defect.dphi_d, defect.h_d, scene.clearance, defect.rows, rough)


def roughness_of(profile: RaceProfile, factor: float) -> Callable[[float], float]:
    """Return the height of a rough floor over the angle, m."""
    return lambda angle: factor * float(profile(np.array([angle]))[0][0])


def nodes_of(problem: Problem, step: float, landed: bool) -> tuple[NDArray[np.float64], NDArray[np.int64], list[float]]:
    """Return the ends of all steps, the segment of each and the segments' steps: equal ones, or landed on kinks."""
    if not landed:
        count = math.ceil(problem.end / step)
        return step * np.arange(count + 1, dtype=np.float64), np.zeros(count, dtype=np.int64), [step]
    times: list[NDArray[np.float64]] = []
    segments: list[int] = []
    steps: list[float] = []
    for k, (a, b) in enumerate(pairwise(problem.exact.breaks())):
        count = math.ceil((b - a) / step)
        steps.append((b - a) / count)
        times.append(np.linspace(a, b, count + 1)[:-1])
        segments += [k] * count
    one = np.concatenate(times)
    ends = [one + k * problem.period for k in range(WARM + KEPT)]
    return np.concatenate([*ends, np.array([problem.end])]), np.array(segments * (WARM + KEPT), dtype=np.int64), steps


def oscillators() -> list[NDArray[np.float64]]:
    """Return the matrices of the three oscillators of an axis: inner ring, centre of mass, outer ring on resonator."""
    m_red = oracle.M_O * oracle.M_R / (oracle.M_O + oracle.M_R)
    pairs = ((oracle.K_I / oracle.M_I, oracle.C_I / oracle.M_I), (0.0, 0.0), (oracle.K_R / m_red, oracle.C_R / m_red))
    return [np.array([[0.0, 1.0], [-stiffness, -damping]]) for stiffness, damping in pairs]


def propagators(step: float) -> NDArray[np.float64]:
    """Return the propagators of the three oscillators over a step, shape (3, 2, 2)."""
    return np.array([expm(matrix * step) for matrix in oscillators()], dtype=np.float64)


def multistep_weights(step: float, order: int) -> NDArray[np.float64]:
    """Return what one newton at the latest time, one step earlier, ... adds to an axis within a step, (order, 6).

    The force is the polynomial through its last values; its powers are integrated with the propagator exactly.
    """
    inverse_masses = (-1.0 / oracle.M_I, 1.0 / (oracle.M_O + oracle.M_R), 1.0 / oracle.M_O)
    # Coefficients of the polynomials in (t / step) that are one at one of the times 0, -1, -2, ... and zero elsewhere.
    basis = np.linalg.inv(np.vander(-np.arange(order, dtype=float), order, increasing=True))
    weights = np.zeros((order, 6))
    for m, (matrix, inverse_mass) in enumerate(zip(oscillators(), inverse_masses, strict=True)):
        for power in range(order):
            chain = np.zeros((3 + power, 3 + power))
            chain[:2, :2] = matrix * step
            chain[1, 2] = inverse_mass * step
            chain[range(2, 2 + power), range(3, 3 + power)] = 1.0
            # The last entry starts at one; the chain makes of it (t / step)^power / power!.
            moment = math.factorial(power) * expm(chain)[:2, -1]
            weights[:, 2 * m : 2 * m + 2] += np.outer(basis[power], moment)
    return weights


def run_rk4(problem: Problem, step: float, *, landed: bool) -> Callable[[], Run]:
    """Return the classical explicit method, its steps equal or landed on kinks with one-sided slopes."""
    nodes, _, _ = nodes_of(problem, step, landed)

    def work() -> Run:
        wave = np.empty(len(nodes) - 1)
        op.runge_kutta_4(nodes, landed, problem.from_zero_load(), wave, problem.arrays)
        return Run(nodes[:-1], wave, np.diff(nodes), 4 * len(wave))

    return work


def run_lawson(problem: Problem, step: float, *, landed: bool, sided: bool, refined: bool) -> Callable[[], Run]:
    """Return Lawson-RK4 with the ingredients asked for."""
    nodes, segment, steps = nodes_of(problem, step, landed)
    whole = np.array([propagators(0.5 * h) for h in steps])
    part = np.array([propagators(0.5 * h / op.SUBSTEPS) for h in steps])

    def work() -> Run:
        wave = np.empty(len(nodes) - 1)
        count = op.lawson(nodes, segment, whole, part, sided, refined, problem.from_rest(), wave, problem.arrays)
        return Run(nodes[:-1], wave, np.diff(nodes), count)

    return work


def run_multistep(problem: Problem, step: float, order: int) -> Callable[[], Run]:
    """Return exponential Adams-Bashforth of an order, started with finer Lawson steps."""
    full, weights = propagators(step), multistep_weights(step, order)
    fine = propagators(step / 16.0)[None]
    count = math.ceil(problem.end / step)
    times = step * np.arange(count, dtype=np.float64)

    def work() -> Run:
        y, wave, history = problem.from_rest(), np.empty(count), np.zeros((order, 2))
        one = np.empty(8)
        for k in range(order - 1):
            t = k * step
            history[order - 1 - k] = op.excess(t, t, y, problem.arrays)[:2]
            nodes = t + step / 8.0 * np.arange(9, dtype=np.float64)
            op.lawson(nodes, np.zeros(8, dtype=np.int64), fine, fine, False, False, y, one, problem.arrays)
            wave[k] = one[0]
        op.exponential_multistep(step, order - 1, full, weights, history, y, wave[order - 1 :], problem.arrays)
        return Run(times, wave, np.full(count, step), count)

    return work


def run_dormand_prince(problem: Problem, rtol: float, atol: NDArray[np.float64]) -> Callable[[], Run]:
    """Return the adaptive pair under MATLAB's step control."""

    def work() -> Run:
        times, wave = np.empty(200_000), np.empty(200_000)
        count, evaluations = op.dormand_prince(
            problem.end, rtol, atol, problem.from_zero_load(), times, wave, problem.arrays
        )
        count = max(count, 0)
        steps = np.diff(np.append(times[:count], problem.end))
        return Run(times[:count], wave[:count], steps, evaluations)

    return work


def run_scipy(problem: Problem, method: str, rtol: float, atol: NDArray[np.float64] | float) -> Callable[[], Run]:
    """Return a method of scipy's solve_ivp on the compiled right-hand side."""

    def rhs(t: float, x: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.empty(12)
        op.derivative(t, t, x, out, problem.arrays)
        return out

    def work() -> Run:
        found = solve_ivp(rhs, (0.0, problem.end), problem.from_zero_load(), method, rtol=rtol, atol=atol)
        wave = np.array([rhs(t, x)[8] for t, x in zip(found.t[:-1], found.y.T[:-1], strict=True)])
        return Run(found.t[:-1], wave, np.diff(found.t), int(found.nfev))

    return work


def run_product(problem: Problem, steps: int) -> Callable[[], Run]:
    """Return the project's own kernel on ``steps`` steps a ball period, its tables made beforehand."""
    period = period_of(problem.scene, steps)
    segments = np.repeat(np.arange(len(period.first) - 1), np.diff(period.first) + 1)
    first = np.append(True, np.diff(segments) > 0)
    last = np.append(np.diff(segments) > 0, True)
    times = period.time + np.where(last, -3.0 * op.NUDGE, 0.0) * ~first
    count = WARM + KEPT

    def work() -> Run:
        state, trace = problem.state, blank_trace(period)
        for _ in range(count):
            state = run(period, state, trace)
        shown = np.append(times + (count - 1) * problem.period, problem.end)
        return Run(
            np.concatenate(([0.0], shown[:-1])),
            np.concatenate(([0.0], trace.wave[:, 0])),
            np.concatenate(([0.0], period.weight * problem.period)),
            4 * int(period.first[-1]) * count,
        )

    return work
