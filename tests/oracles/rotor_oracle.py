"""Slow and obvious reference of the rotor on two bearings: scipy on the complex equations of Ceruti's thesis.

Shares no code with models/: SI constants of Tables 5.1 and 5.2 written out, complex r and phi, sums over the balls,
matrices M, C, G and K as printed (with the corrections that the test names), and the bow as K (q - q_b), not as a load
that turns. The integration is cut where a contact opens or closes (an event of ``solve_ivp``) and where the angle of a
ball or of its spot reaches an edge of the defect.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

N = 7
D_BALL, D_PITCH = 11.274e-3, 43.385e-3
K_C, C_B = 8.4484e9, 1000.0
M, J_P, J_T, C_N = 5.0, 2.0, 1.2, 200.0
YOUNG, D_SHAFT = 2e11, 0.025


@dataclass(frozen=True)
class Case:
    """One rotor: shaft speed Hz, load N, distances of A and B from the disc m, cage angles rad (none with a single ball
    exactly under the load, which is in balance anywhere across it), gap (half the clearance) m, defect of bearing A or
    B (part, middle rad, extent rad, depth m), unbalance kg m, couple kg m2, bow m, its slope rad, angle by which bow
    and couple lead rad, end mass kg, internal damping s, and whether the shaft is elastic.
    """

    speed: float = 1000.0 / 60.0
    load: float = 100.0
    a: float = 0.4
    b: float = 0.4
    cage: tuple[float, float] = (math.pi / 7.0, 0.05)
    gap: float = 11.285e-6
    part: str = "none"
    side: int = 0
    middle: float = 0.0
    extent: float = 0.0
    depth: float = 0.0
    unbalance: float = 0.0
    couple: float = 0.0
    bow: float = 0.0
    slope: float = 0.0
    lead: float = 0.0
    end_mass: float = 0.0
    loss: float = 0.0
    elastic: bool = False

    @property
    def shaft(self) -> float:
        """Shaft speed, rad/s."""
        return 2.0 * math.pi * self.speed

    @property
    def cage_speed(self) -> float:
        """Speed of both cages, rad/s."""
        return 0.5 * self.shaft * (1.0 - D_BALL / D_PITCH)

    @property
    def springs(self) -> tuple[float, float]:
        """Stiffness of the shaft on either side, N/m."""
        inertia = math.pi * D_SHAFT**4 / 64.0
        return 3.0 * YOUNG * inertia / self.a**3, 3.0 * YOUNG * inertia / self.b**3

    def ball(self, side: int, i: int, t: float) -> float:
        """Angle of a ball, rad."""
        return self.cage[side] + 2.0 * math.pi * i / N + self.cage_speed * t

    def lost(self, side: int, i: int, t: float) -> float:
        """By how much a defect relieves a ball, m."""
        if side != self.side or self.part == "none":
            return 0.0
        if self.part == "ball":
            spin = self.shaft * D_PITCH / (2.0 * D_BALL) * (1.0 - (D_BALL / D_PITCH) ** 2)
            off = math.remainder(spin * t - self.middle, math.pi)
            return self.depth if i == 0 and abs(off) <= 0.5 * self.extent else 0.0
        moved = self.shaft * t if self.part == "inner" else 0.0
        along = (self.ball(side, i, t) - moved - self.middle + 0.5 * self.extent) % (2.0 * math.pi)
        return self.depth * math.sin(math.pi * along / self.extent) if along <= self.extent else 0.0

    def turned(self, t: float, lead: float = 0.0) -> complex:
        """A unit vector that turns with the shaft."""
        return cmath.exp(1j * (self.shaft * t + lead))


def compression(case: Case, side: int, i: int, t: float, ring: complex) -> float:
    """Return the approach of the rings at a ball, negative for a gap, m."""
    normal = cmath.exp(1j * case.ball(side, i, t))
    return (ring * normal.conjugate()).real - case.gap - case.lost(side, i, t)


def bearing_force(
    case: Case, side: int, t: float, ring: complex, rate: complex, loaded: set[tuple[int, int]]
) -> complex:
    """Return the force of the loaded balls, N."""
    total = 0.0 + 0.0j
    for i in range(N):
        if (side, i) in loaded:
            normal = cmath.exp(1j * case.ball(side, i, t))
            delta = max(compression(case, side, i, t, ring), 0.0)
            total += (K_C * delta**1.5 + C_B * (rate * normal.conjugate()).real) * normal
    return total


def accelerations(
    case: Case, t: float, q: NDArray[np.complex128], v: NDArray[np.complex128], loaded: set[tuple[int, int]]
) -> list[complex]:
    """Return r'', phi'', r_A'', r_B'' of q = (r, phi[, r_A, r_B])."""
    bow = np.array([case.bow, case.slope]) * case.turned(t, case.lead)
    bow_rate, bow_twice = 1j * case.shaft * bow, -(case.shaft**2) * bow
    straight, straight_rate = q[:2] - bow, v[:2] - bow_rate
    arms = (case.a, -case.b)
    external = np.array(
        [
            case.load + case.unbalance * case.shaft**2 * case.turned(t) - C_N * v[0],
            case.couple * case.shaft**2 * case.turned(t, case.lead) + 1j * case.shaft * J_P * v[1],
        ]
    )
    if not case.elastic:
        forces = [
            bearing_force(
                case, k, t, straight[0] + arms[k] * straight[1], straight_rate[0] + arms[k] * straight_rate[1], loaded
            )
            for k in (0, 1)
        ]
        external -= np.array([forces[0] + forces[1], case.a * forces[0] - case.b * forces[1]])
        e = case.end_mass
        ends = np.array([[2.0 * e, e * (case.a - case.b)], [e * (case.a - case.b), e * (case.a**2 + case.b**2)]])
        # The ends move on the straight line: their inertia acts on q - q_b.
        found = np.linalg.solve(np.diag([M, J_T]) + ends, external + ends @ bow_twice)
        straight_twice = found - bow_twice
        return [*found, straight_twice[0] + case.a * straight_twice[1], straight_twice[0] - case.b * straight_twice[1]]
    found, at_ends = [], []
    for k in (0, 1):
        bent = straight[0] + arms[k] * straight[1] - q[2 + k]
        bent_rate = straight_rate[0] + arms[k] * straight_rate[1] - v[2 + k]
        spring = case.springs[k] * (bent + case.loss * (bent_rate - 1j * case.shaft * bent))
        external -= spring * np.array([1.0, arms[k]])
        at_ends.append((spring - bearing_force(case, k, t, q[2 + k], v[2 + k], loaded)) / case.end_mass)
    found = [external[0] / M, external[1] / J_T]
    return [*found, *at_ends]


def rings(case: Case, t: float, q: NDArray[np.complex128]) -> tuple[complex, complex]:
    """Return the places of the inner rings."""
    if case.elastic:
        return q[2], q[3]
    straight = q - np.array([case.bow, case.slope]) * case.turned(t, case.lead)
    return straight[0] + case.a * straight[1], straight[0] - case.b * straight[1]


def at_rest(case: Case) -> NDArray[np.complex128]:
    """Return the static equilibrium of the rings without the defect, by a general solver, and the disc above them."""
    case = replace(case, part="none")
    shares = (case.load * case.b / (case.a + case.b), case.load * case.a / (case.a + case.b))
    ends = []
    for k in (0, 1):

        def miss(u: NDArray[np.float64], k: int = k) -> list[float]:
            ring = complex(*u) * 1e-6
            all_balls = {(k, i) for i in range(N) if compression(case, k, i, 0.0, ring) > 0.0}
            force = bearing_force(case, k, 0.0, ring, 0.0, all_balls)
            return [force.real - shares[k], force.imag]

        best: Any = min(
            (
                fsolve(miss, [case.gap * 1e6 + x, y], full_output=True, xtol=1e-13)
                for x in (3.0, 6.0)
                for y in (0.0, -2.0, 2.0, -5.0, 5.0, -8.0, 8.0)
            ),
            key=lambda found: math.hypot(*miss(found[0])),
        )
        assert math.hypot(*miss(best[0])) < 1e-6 * case.load
        ends.append(complex(*best[0]) * 1e-6)
    above = [end + (shares[k] / case.springs[k] if case.elastic else 0.0) for k, end in enumerate(ends)]
    line = np.array(
        [(case.b * above[0] + case.a * above[1]) / (case.a + case.b), (above[0] - above[1]) / (case.a + case.b)]
    )
    disc = line + np.array([case.bow, case.slope]) * case.turned(0.0, case.lead)
    return np.array([*disc, *ends]) if case.elastic else disc


def edges(case: Case, duration: float) -> list[float]:
    """Return the instants at which a ball reaches an edge of the defect, by scanning the time."""
    if case.part == "none":
        return []
    times = np.linspace(0.0, duration, round(duration / 2e-6) + 1)
    found: list[float] = []
    for i in range(1 if case.part == "ball" else N):

        def inside(t: float, i: int = i) -> float:
            if case.part == "ball":
                spin = case.shaft * D_PITCH / (2.0 * D_BALL) * (1.0 - (D_BALL / D_PITCH) ** 2)
                return math.cos(2.0 * (spin * t - case.middle)) - math.cos(case.extent)
            moved = case.shaft * t if case.part == "inner" else 0.0
            return math.cos(case.ball(case.side, i, t) - moved - case.middle) - math.cos(0.5 * case.extent)

        values = np.array([inside(t) for t in times])
        crossings = np.flatnonzero(values[:-1] * values[1:] < 0.0)
        found += [float(cast("Any", brentq(inside, times[k], times[k + 1], xtol=1e-15))) for k in crossings]
    return sorted(found)


def simulate(case: Case, times: NDArray[np.float64], tolerance: float = 1e-9) -> NDArray[np.float64]:
    """Return the accelerations along the load of A, B and C at ascending times from 0, m/s2, (times, 3)."""
    size = 4 if case.elastic else 2
    q = at_rest(case)
    v = np.zeros(size, dtype=np.complex128)
    # At rest against the turning bow: the line through the bearings stands still.
    v[:2] += 1j * case.shaft * np.array([case.bow, case.slope]) * case.turned(0.0, case.lead)
    z = np.concatenate((q, v))
    out = np.empty((len(times), 3))
    marks = [0.0, *edges(case, float(times[-1])), float(times[-1]) + 1e-9]
    for begin, end in pairwise(marks):
        t = begin
        inner = 0.5 * (begin + end)
        while t < end - 1e-13:
            places = rings(case, t, z[:size])
            # Just inside the interval: at an edge the depth of a ball's defect jumps.
            just = min(t + 1e-12, inner) if t == begin else t
            loaded = {(k, i) for k in (0, 1) for i in range(N) if compression(case, k, i, just, places[k]) > 0.0}
            z, t = _until_change(case, z, t, end, loaded, times, out, tolerance)
    return out


def _until_change(
    case: Case,
    z: NDArray[np.complex128],
    t: float,
    end: float,
    loaded: set[tuple[int, int]],
    times: NDArray[np.float64],
    out: NDArray[np.float64],
    tolerance: float,
) -> tuple[NDArray[np.complex128], float]:
    """Integrate to the next change of contact or the end, and fill what lies between."""
    size = len(z) // 2

    def rate(at: float, y: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.concatenate((y[size:], accelerations(case, at, y[:size], y[size:], loaded)[:size]))

    def event(k: int, i: int) -> Callable[[float, NDArray[np.complex128]], float]:
        def overlap(at: float, y: NDArray[np.complex128]) -> float:
            # Past the interval the depth may jump; it is continued from within.
            inside = min(max(at, t + 1e-13), end - 1e-13)
            return 1e6 * compression(case, k, i, inside, rings(case, at, y[:size])[k])

        marked: Any = overlap
        marked.terminal = True
        marked.direction = -1.0 if (k, i) in loaded else 1.0
        return marked

    events = [event(k, i) for k in (0, 1) for i in range(N)]
    wanted = times[(times >= t) & (times < end)]
    solved = solve_ivp(
        rate, (t, end), z, method="DOP853", rtol=tolerance, atol=1e-15, events=events, dense_output=True, max_step=1e-4
    )
    for at in wanted[wanted < solved.t[-1]]:
        y = solved.sol(at)
        found = accelerations(case, at, y[:size], y[size:], loaded)
        out[np.searchsorted(times, at)] = [found[2].real, found[3].real, found[0].real]
    reached = float(solved.t[-1])
    # A hair beyond the root, so that the contact has changed.
    hair = 1e-12 if solved.status == 1 else 0.0
    return solved.y[:, -1] + hair * rate(reached, solved.y[:, -1]), reached + hair
