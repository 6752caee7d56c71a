"""Slow and obvious reference of the six-degree-of-freedom model: scipy's DOP853 on Eqs. 32-52 and 83-89 as they stand.

Shares no code with models/: own coordinates (the six displacements of Eq. 43 from zero load, y along the load), own
path, own start, explicit sums over the balls. Integrated from kink to kink of the path, which are found by bisection.
The two sums over the balls are compiled, because the integrator asks for them a hundred thousand times.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import root

R_O, R_B, R_P, ALPHA = 22.91e-3, 3.56e-3, 18.946e-3, math.radians(10.2)
N_BALLS, N_ROWS = 12, 2
M_I, M_O, M_R, M_B = 3.48, 5.79, 3.01, 1.47e-3
K_I, K_R, K_C = 75e6, 4.25e9, 5927e6
C_I, C_R, ALPHA_C, BETA_C = 2834.1, 186.0, 154.9, 2.5e-5
PITCH = 2.0 * math.pi / N_BALLS
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One scene: shaft speed Hz, load N, extent rad, depth m, clearance m, damaged rows, rough height over angle."""

    speed: float
    load: float
    dphi_d: float = 0.0
    h_d: float = 0.0
    clearance: float = 0.0
    rows: int = 1
    rough: Callable[[float], float] | None = None

    @property
    def omega_c(self) -> float:
        """Cage speed, rad/s (Eq. 33)."""
        return math.pi * self.speed * (1.0 - R_B / R_P * math.cos(ALPHA))


def path(case: Case, angle: float) -> float:
    """Return d at one angle from the defect's centre, m: the shallower of edge path (Eq. 51) and floor (Eq. 88)."""
    angle = math.remainder(angle, 2.0 * math.pi)
    beyond = 0.5 * case.dphi_d - abs(angle)
    if beyond <= 0.0 or case.h_d <= 0.0:
        return 0.0
    beyond = min(beyond, 0.999999 * math.asin(R_B / R_O))
    edge = R_B + R_O * math.cos(beyond) - R_O - math.sqrt(R_B**2 - (R_O * math.sin(beyond)) ** 2)
    floor = case.h_d + (case.rough(angle) if case.rough else 0.0)
    return min(edge, floor) * math.cos(ALPHA)


def kinks(case: Case) -> list[float]:
    """Return where the path is not smooth, rad from the defect's centre."""
    if case.h_d <= 0.0 or case.dphi_d <= 0.0:
        return []
    half = 0.5 * case.dphi_d
    found = [-half, half, 0.0]

    def gap(angle: float) -> float:
        beyond = half - abs(angle)
        edge = R_B + R_O * math.cos(beyond) - R_O - math.sqrt(max(0.0, R_B**2 - (R_O * math.sin(beyond)) ** 2))
        return edge - case.h_d - (case.rough(angle) if case.rough else 0.0)

    scan = np.linspace(-half, half, 20001)
    signs = np.array([gap(a) for a in scan]) > 0.0
    found.extend(bisect(gap, scan[i], scan[i + 1]) for i in np.flatnonzero(signs[1:] != signs[:-1]))
    return found


def bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root between two angles at which the function has opposite signs."""
    sign = function(low) > 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (function(middle) > 0.0) == sign else (low, middle)
    return 0.5 * (low + high)


@numba.njit(cache=True)
def spline_values(x: Floats, piece: NDArray[np.int64], marks: Floats, cubics: Floats) -> Floats:
    """Return value and slope at each x, (2, len(x)), of the spline between two marks that it is said to be on, or 0."""
    out = np.zeros((2, len(x)))
    for i in range(len(x)):
        k = piece[i]
        if k >= 0:
            step = (marks[k + 1] - marks[k]) / cubics.shape[2]
            knot = min(max(int((x[i] - marks[k]) / step), 0), cubics.shape[2] - 1)
            u = x[i] - marks[k] - knot * step
            c3, c2, c1, c0 = cubics[k, :, knot]
            out[0, i] = ((c3 * u + c2) * u + c1) * u + c0
            out[1, i] = (3.0 * c3 * u + 2.0 * c2) * u + c1
    return out


@numba.njit(cache=True)
def contact_sum(
    phi: Floats, path_: Floats, x: Floats, v: Floats, omega: float, clearance: float, k_c: float, exponent: float
) -> Floats:
    """Return the sum of contact and damping forces on the inner ring, N (Eqs. 35, 36, 39, 45, 46, 48)."""
    total = np.zeros(2)
    ux, uy, vx, vy = x[0] - x[2], x[1] - x[3], v[0] - v[2], v[1] - v[3]
    for i in range(len(phi)):
        c, s = np.sin(phi[i]), np.cos(phi[i])  # y lies along the load, x across it
        delta = ux * c + uy * s - path_[0, i] - clearance
        if delta > 0.0:
            rate = vx * c + vy * s + omega * (ux * s - uy * c) - omega * path_[1, i]
            damping = ALPHA_C * M_B + BETA_C * k_c * delta ** (exponent - 1.0)
            force = k_c * delta**exponent + damping * rate
            total[0] += force * c
            total[1] += force * s
    return total


class Oracle:
    """The model of one case as an initial value problem."""

    k_c, exponent = K_C, 1.5

    def __init__(self, case: Case) -> None:
        """Tabulate the path finely (splines between kinks), so that the right-hand side is quick enough."""
        self.case = case
        marks = sorted({round(k, 13) for k in kinks(case)})
        self.marks = marks
        cubics = []
        for a, b in pairwise(marks):
            grid = np.linspace(a, b, 2001)
            cubics.append(CubicSpline(grid, [path(case, float(x)) for x in grid]).c)
        self.splines = np.array(marks), np.array(cubics).reshape(-1, 4, 2000)
        self.known: dict[float, tuple[NDArray[np.float64], NDArray[np.int64]]] = {}
        rows = np.repeat(np.arange(N_ROWS), N_BALLS)
        self.start = rows * PITCH / 2.0 + np.tile(np.arange(N_BALLS), N_ROWS) * PITCH
        self.faulty = rows < case.rows

    def places(self, middle: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return where each ball is at a time, rad from the defect's centre, and on which piece of its path, or -1."""
        if middle not in self.known:
            there = [math.remainder(angle, 2.0 * math.pi) for angle in self.start + self.case.omega_c * middle]
            piece = [
                next((k for k, (a, b) in enumerate(pairwise(self.marks)) if faulty and a < angle < b), -1)
                for angle, faulty in zip(there, self.faulty, strict=True)
            ]
            self.known[middle] = np.array(there), np.array(piece)
        return self.known[middle]

    def path_of_balls(self, t: float, middle: float) -> NDArray[np.float64]:
        """Return d and d' of all balls, (2, balls); each is on the piece on which it is at ``middle``, s."""
        there, piece = self.places(middle)
        return spline_values(there + self.case.omega_c * (t - middle), piece, *self.splines)

    def forces(self, t: float, x: NDArray[np.float64], v: NDArray[np.float64], middle: float) -> NDArray[np.float64]:
        """Return the sum of contact and damping forces on the inner ring, N."""
        case, phi = self.case, self.start + self.case.omega_c * t
        path_ = self.path_of_balls(t, middle)
        return contact_sum(phi, path_, x, v, case.omega_c, case.clearance, self.k_c, self.exponent)

    def rhs(self, t: float, state: NDArray[np.float64], middle: float) -> NDArray[np.float64]:
        """Return the time derivative of (x, v), shape (12,) (Eq. 44); the load pulls the outer ring along -y."""
        x, v = state[:6], state[6:]
        f = self.forces(t, x, v, middle)
        spring = K_R * (x[2:4] - x[4:6]) + C_R * (v[2:4] - v[4:6])
        inner = (-f - K_I * x[:2] - C_I * v[:2]) / M_I
        outer = (f - spring - np.array([0.0, self.case.load])) / M_O
        return np.concatenate((v, inner, outer, spring / M_R))

    def at_rest(self) -> NDArray[np.float64]:
        """Return the static equilibrium of the healthy bearing, shape (12,)."""
        state = np.zeros(12)
        if self.case.load > 0.0:
            c, s = np.sin(self.start), np.cos(self.start)

            def residual(u: NDArray[np.float64]) -> list[float]:
                pressed = np.maximum((u[0] * c + u[1] * s) * 1e-6 - self.case.clearance, 0.0)
                q = self.k_c * pressed**self.exponent
                return [float(np.sum(q * c)), float(np.sum(q * s) - self.case.load)]

            u = root(residual, [0.0, self.case.clearance * 1e6 + 5.0], tol=1e-12).x * 1e-6
            state[1] = -self.case.load / K_I
            state[2:6] = -u[0], state[1] - u[1], -u[0], state[1] - u[1]
        return state

    def breaks(self) -> list[float]:
        """Return the times within a ball period at which a ball meets a kink, with both ends of the period, s."""
        period = PITCH / self.case.omega_c
        times = {0.0, period}
        for mark in self.marks:
            for start in self.start[self.faulty]:
                times.add(((mark - start) % PITCH) / self.case.omega_c)
        ordered = sorted(times)
        return [t for i, t in enumerate(ordered) if i == 0 or t - ordered[i - 1] > 1e-12]

    def period(
        self, state: NDArray[np.float64], rtol: float, samples: int = 0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Integrate one ball period; return the state after it, sampled times and casing acceleration along the load.

        ``samples`` is the number of samples a period has at least; each smooth piece includes both of its ends.
        """
        breaks = self.breaks()
        times, values = [], []
        for a, b in pairwise(breaks):
            middle = 0.5 * (a + b)
            grid = np.linspace(a, b, max(3, math.ceil(samples * (b - a) / breaks[-1])))
            scale = np.array([1e-6] * 6 + [1e-2] * 6)
            solution = solve_ivp(self.rhs, (a, b), state, "DOP853", grid, rtol=rtol, atol=rtol * scale, args=(middle,))
            state = solution.y[:, -1]
            if samples:
                times.append(grid)
                values.append([self.rhs(t, y, middle)[9] for t, y in zip(grid, solution.y.T, strict=True)])
        # After a period every ball stands where the next one stood: the same initial value problem again.
        if not samples:
            return state, np.empty(0), np.empty(0)
        return state, np.concatenate(times), np.concatenate(values)


@dataclass(frozen=True)
class OracleResponse:
    """Settled RMS of the casing along the load, m/s2, and the last period's waveform."""

    rms: float
    time: NDArray[np.float64]
    acceleration: NDArray[np.float64]


def simulate_oracle(case: Case, *, periods: int = 24, rtol: float = 1e-9, samples: int = 3000) -> OracleResponse:
    """Return the settled response: ``periods`` periods from rest, the last at full accuracy and finely sampled."""
    oracle = Oracle(case)
    state = oracle.at_rest()
    for _ in range(periods - 2):
        state, _, _ = oracle.period(state, 1e-6)
    state, _, _ = oracle.period(state, rtol)
    _, time, acceleration = oracle.period(state, rtol, samples)
    power = np.trapezoid(acceleration**2, time) / (time[-1] - time[0])
    return OracleResponse(math.sqrt(float(power)), time, acceleration)
