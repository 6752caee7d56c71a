"""Slow and obvious reference of the bearing whose balls have inertia: scipy on the equations of Marin et al.

Shares no code with models/: absolute radii R_in, R_out and r_i, vectors in the plane, contacts as printed (with the
corrections that the product names). y points along the load, so that weight and load have one sign; angles are
measured from it. The integration is cut at every edge of a defect and where an open contact closes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

R_BALL, R_IN, R_OUT, R_0 = 4.75e-3, 18.25e-3, 27.75e-3, 23e-3
C_IN, C_OUT = 2.46398e10, 2.83896e10
M_BALL, M_RING = 0.0035, 1.561


@dataclass(frozen=True)
class Spot:
    """A defect: on which race, its middle and extent (rad), depth (m)."""

    race: str
    middle: float
    extent: float
    depth: float


@dataclass(frozen=True)
class Case:
    """One bearing: balls, shaft speed Hz, load N, clearance m, gravity m/s2 and its angle rad, unbalance kg m, damping
    of the contacts N s/m, angle of the first ball rad, defects and whether they are half sines.
    """

    balls: int = 9
    speed: float = 40.0
    load: float = 1000.0
    gap: float = 0.0
    gravity: float = 0.0
    down: float = 0.0
    unbalance: float = 0.0
    damping: tuple[float, float] = (200.0, 200.0)
    cage: float = 0.3
    spots: tuple[Spot, ...] = ()
    half_sine: bool = False

    @property
    def shaft(self) -> float:
        """Shaft speed, rad/s."""
        return 2.0 * math.pi * self.speed

    @property
    def cage_speed(self) -> float:
        """Speed of the cage, rad/s."""
        return 0.5 * self.shaft * (1.0 - R_BALL / R_0)

    def angle(self, i: int, t: float) -> float:
        """Angle of a ball, rad."""
        return self.cage + 2.0 * math.pi * i / self.balls + self.cage_speed * t

    def depth(self, race: str, i: int, t: float) -> float:
        """By how much the defects of a race let a ball sink, m."""
        total = 0.0
        for spot in self.spots:
            if spot.race != race:
                continue
            moved = self.shaft * t if race == "inner" else 0.0
            along = (self.angle(i, t) - moved - spot.middle + 0.5 * spot.extent) % (2.0 * math.pi)
            if along <= spot.extent:
                total += spot.depth * (math.sin(math.pi * along / spot.extent) if self.half_sine else 1.0)
        return total


def contacts(case: Case, t: float, z: NDArray[np.float64], relief: Relief) -> tuple[Any, ...]:
    """Return for all balls: angle, n (2, balls), rate of rho, and overlap inside and outside."""
    n = case.balls
    angle = np.array([case.angle(i, t) for i in range(n)])
    out, tangent = np.stack([np.cos(angle), np.sin(angle)]), np.stack([-np.sin(angle), np.cos(angle)])
    r, r_dot = z[4 : 4 + n], z[4 + n :]
    from_ring = r * out - z[:2, None]
    rho = np.hypot(*from_ring)
    normal = from_ring / rho
    rho_dot = np.sum(normal * (r_dot * out + r * case.cage_speed * tangent - z[2:4, None]), axis=0)
    inside, outside = relief(t)
    return angle, normal, rho_dot, R_IN - inside + R_BALL - rho, r + R_BALL - (R_OUT + case.gap + outside)


Relief = Callable[[float], tuple[NDArray[np.float64], NDArray[np.float64]]]


def derivative(
    case: Case, t: float, z: NDArray[np.float64], closed: NDArray[np.bool_], relief: Relief
) -> NDArray[np.float64]:
    """Return the time derivative of x, y, x', y', r_i, r_i' (x along the load)."""
    n = case.balls
    angle, normal, rho_dot, d_in, d_out = contacts(case, t, z, relief)
    r, r_dot = z[4 : 4 + n], z[4 + n :]
    f_in = np.where(closed[:n] & (d_in > 0), C_IN * np.maximum(d_in, 0) ** 1.5 - case.damping[0] * rho_dot, 0.0)
    f_out = np.where(closed[n:] & (d_out > 0), C_OUT * np.maximum(d_out, 0) ** 1.5 + case.damping[1] * r_dot, 0.0)
    f_in, f_out = np.maximum(f_in, 0.0), np.maximum(f_out, 0.0)
    out = np.stack([np.cos(angle), np.sin(angle)])
    weight = case.gravity * np.array([math.cos(case.down), math.sin(case.down)])
    turning = case.unbalance * case.shaft**2 * np.array([math.cos(case.shaft * t), math.sin(case.shaft * t)])
    ring = (np.array([case.load, 0.0]) + turning - np.sum(f_in * normal, axis=1)) / M_RING + weight
    ball = r * case.cage_speed**2 + weight @ out + (f_in * np.sum(normal * out, axis=0) - f_out) / M_BALL
    return np.concatenate((z[2:4], ring, r_dot, ball))


def edges(case: Case, duration: float) -> list[float]:
    """Return the instants at which a ball reaches an edge of a defect, by scanning the time."""
    times = np.linspace(0.0, duration, round(duration / 1e-5) + 1)
    found: list[float] = []
    for spot in case.spots:
        for i in range(case.balls):

            def inside(t: float, i: int = i, spot: Spot = spot) -> float:
                moved = case.shaft * t if spot.race == "inner" else 0.0
                return math.cos(case.angle(i, t) - moved - spot.middle) - math.cos(0.5 * spot.extent)

            values = np.array([inside(t) for t in times])
            crossings = np.flatnonzero(values[:-1] * values[1:] < 0.0)
            found += [float(cast("Any", brentq(inside, times[k], times[k + 1], xtol=1e-15))) for k in crossings]
    return sorted(found)


def simulate(
    case: Case, state: NDArray[np.float64], times: NDArray[np.float64], tolerance: float = 1e-9
) -> NDArray[np.float64]:
    """Return the acceleration of the ring at ascending times from 0, (times, 2), from a state with absolute radii."""
    z, out = state.copy(), np.empty((len(times), 2))
    for begin, end in pairwise([0.0, *edges(case, float(times[-1])), float(times[-1]) + 1e-9]):
        middle = 0.5 * (begin + end)

        def relief(t: float, begin: float = begin, end: float = end) -> tuple[Any, Any]:
            # Just inside the interval: at an edge the depth jumps.
            t = min(max(t, begin + 1e-12), end - 1e-12)
            inner, outer = ([case.depth(race, i, t) for i in range(case.balls)] for race in ("inner", "outer"))
            return np.array(inner), np.array(outer)

        def frozen(t: float, steady: tuple[Any, Any] = relief(middle)) -> tuple[Any, Any]:
            return steady

        chosen, t = relief if case.half_sine and case.spots else frozen, begin
        while t < end - 1e-13:
            z, t = _until_closed(case, z, t, end, chosen, times, out, tolerance)
    return out


def _until_closed(
    case: Case,
    z: NDArray[np.float64],
    t: float,
    end: float,
    relief: Relief,
    times: NDArray[np.float64],
    out: NDArray[np.float64],
    tolerance: float,
) -> tuple[NDArray[np.float64], float]:
    """Integrate to the end or to where an open contact closes, and fill what lies between."""
    overlaps = np.concatenate(contacts(case, t, z, relief)[3:])
    # The contact that ended the last part is closed, whatever rounding says.
    closed = overlaps > -1e-15

    def least_gap(at: float, y: NDArray[np.float64]) -> float:
        return 1e6 * float(np.min(-np.concatenate(contacts(case, at, y, relief)[3:])[~closed], initial=1.0))

    marked: Any = least_gap
    marked.terminal, marked.direction = True, -1.0
    solved = solve_ivp(
        lambda at, y: derivative(case, at, y, closed, relief), (t, end), z,
        method="DOP853", rtol=tolerance, atol=1e-14, events=[marked], dense_output=True, max_step=2e-5,
    )  # fmt: skip
    last = float(solved.t[-1])
    reached = last if solved.status == 1 else end
    for k in np.flatnonzero((times >= t) & (times < reached)):
        out[k] = derivative(case, times[k], cast("Any", solved.sol)(times[k]), closed, relief)[2:4]
    return solved.y[:, -1], reached
