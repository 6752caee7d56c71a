"""Slow and obvious reference of the effects: scipy's DOP853 on the equations of motion with every effect written out.

Shares no code with models/: own coordinates (the six displacements from zero load, y along the load, x across it), own
geometry (distances between points and circles, solved by bisection), explicit sums over the balls. The integration is
cut at the instants at which a ball meets a kink of its path, found by scanning the time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import root, root_scalar

R_O, R_I, R_B, R_P, ALPHA = 22.91e-3, 16.64e-3, 3.56e-3, 18.946e-3, math.radians(10.2)
N_BALLS, N_ROWS = 12, 2
M_I, M_O, M_R, M_B = 3.48, 5.79, 3.01, 1.47e-3
K_I, K_R, K_C = 75e6, 4.25e9, 5927e6
C_I, C_R, ALPHA_C, BETA_C = 2834.1, 186.0, 154.9, 2.5e-5
PITCH = 2.0 * math.pi / N_BALLS


@dataclass(frozen=True)
class Turning:
    """A shaft whose speed changes evenly, by ``slope`` rad/s2, and swings by ``swing`` rad/s at ``pace`` rad/s."""

    slope: float = 0.0
    swing: float = 0.0
    pace: float = 1.0

    def angle(self, t: float) -> float:
        """Return what the shaft has turned beyond its speed at t = 0 less the swing's."""
        return 0.5 * self.slope * t**2 + self.swing / self.pace * (1.0 - math.cos(self.pace * t))

    def speed(self, t: float) -> float:
        """Return the derivative of the angle."""
        return self.slope * t + self.swing * math.sin(self.pace * t)

    def change(self, t: float) -> float:
        """Return the derivative of the speed."""
        return self.slope + self.swing * self.pace * math.cos(self.pace * t)


@dataclass(frozen=True)
class Case:
    """One scene: shaft speed Hz, load N, defect (part, extent rad, depth m, rows), waves (amplitude m, order, race,
    phase rad), unbalance kg m, gravity m/s2 and its angle from the load rad, clearance m, cases of whose the defects
    are there too, and how the speed changes.
    """

    speed: float
    load: float
    part: str = "none"
    dphi_d: float = 0.0
    h_d: float = 0.0
    rows: tuple[int, ...] = (0,)
    waves: tuple[tuple[float, int, str, float], ...] = ()
    unbalance: float = 0.0
    gravity: float = 0.0
    gravity_angle: float = 0.0
    clearance: float = 0.0
    others: tuple[Case, ...] = ()
    turning: Turning = Turning()

    def turned(self, t: float) -> float:
        """Return the angle of the shaft, rad."""
        return self.shaft * t + self.turning.angle(t)

    def over(self, t: float) -> float:
        """Return the speed over that at t = 0."""
        return 1.0 + self.turning.speed(t) / self.shaft

    @property
    def shaft(self) -> float:
        """Shaft speed, rad/s."""
        return 2.0 * math.pi * self.speed

    @property
    def cage(self) -> float:
        """Cage speed, rad/s."""
        return 0.5 * self.shaft * (1.0 - R_B / R_P * math.cos(ALPHA))

    @property
    def spin(self) -> float:
        """Spin of a ball against the cage, rad/s."""
        ratio = R_B / R_P * math.cos(ALPHA)
        return 0.5 * self.shaft * R_P / R_B * (1.0 - ratio**2)


def edge_depth(beyond: float, contact: str) -> float:
    """Return how far the centre of a ball has moved over an edge, m, from the distances of points, by bisection.

    ``contact``: "outer" and "inner" for a race with an edge, "spot_outer" and "spot_inner" for a ball with one.
    """
    race = R_O if contact.endswith("outer") else R_I
    inwards = contact.endswith("inner")
    healthy = race + R_B if inwards else race - R_B

    def miss(sunk: float) -> float:
        centre = healthy - sunk if inwards else healthy + sunk
        if contact.startswith("spot"):
            # The edge of the spot, R_B from the ball's centre, lies on the race.
            toward = -1.0 if inwards else 1.0
            x, y = centre + toward * R_B * math.cos(beyond), R_B * math.sin(beyond)
            return (math.hypot(x, y) - race) * toward
        # The edge of the race lies on the ball.
        return R_B - math.hypot(centre - race * math.cos(beyond), race * math.sin(beyond))

    return 0.0 if beyond <= 0.0 else float(root_scalar(miss, bracket=(-1e-9, 0.9 * R_B), xtol=1e-17, rtol=1e-14).root)


class Oracle:
    """The model of one case as an initial value problem."""

    def __init__(self, case: Case) -> None:
        """Tabulate nothing: every depth is solved for where it is needed, slopes by central differences."""
        self.case = case
        self.start = np.concatenate([r * PITCH / N_ROWS + PITCH * np.arange(N_BALLS) for r in range(N_ROWS)])
        self.row = np.repeat(np.arange(N_ROWS), N_BALLS)
        if case.part == "none":
            self.faulty = np.empty(0, dtype=int)
        elif case.part == "ball":
            self.faulty = np.array([r * N_BALLS for r in case.rows])
        else:
            self.faulty = np.flatnonzero(np.isin(self.row, case.rows))
        contacts = {"none": (), "ball": ("spot_outer", "spot_inner")}.get(case.part, (case.part,))
        self.on_floor = {contact: self._floor(contact) for contact in contacts}
        self.others = [Oracle(other) for other in case.others]

    def _floor(self, contact: str) -> float:
        """Return the angle beyond an edge at which the floor is reached, or the largest possible where it is not."""
        half = 0.5 * self.case.dphi_d
        if contact in ("outer", "inner"):
            # Far beyond an edge of a race a ball no longer rests on it; every floor tried is reached before.
            half = min(half, 0.8 * math.asin(R_B / (R_O if contact == "outer" else R_I)))
        if half == 0.0 or edge_depth(half, contact) <= self.case.h_d:
            return half
        return float(
            root_scalar(lambda b: edge_depth(b, contact) - self.case.h_d, bracket=(0.0, half), xtol=1e-15).root
        )

    def place(self, ball: int, t: float) -> tuple[float, str]:
        """Return the angle from the defect's centre and which contact it concerns."""
        case, turned = self.case, self.case.turned(t) / self.case.shaft
        if case.part == "outer":
            return math.remainder(self.start[ball] + case.cage * turned, 2.0 * math.pi), "outer"
        if case.part == "inner":
            return math.remainder(self.start[ball] + (case.cage - case.shaft) * turned, 2.0 * math.pi), "inner"
        spot = math.remainder(case.spin * turned, 2.0 * math.pi)
        if abs(spot) < 0.5 * math.pi:
            return spot, "spot_outer"
        return math.remainder(spot - math.pi, 2.0 * math.pi), "spot_inner"

    def depth(self, ball: int, t: float, piece: int) -> float:
        """Return d, m, on a smooth piece: 0 none, 1 the first edge, 2 the floor, 3 the last edge."""
        x, contact = self.place(ball, t)
        if piece == 0:
            return 0.0
        if piece == 2:
            return math.cos(ALPHA) * self.case.h_d
        sign = 1.0 if piece == 1 else -1.0
        return math.cos(ALPHA) * edge_depth(0.5 * self.case.dphi_d + sign * x, contact)

    def piece(self, ball: int, t: float) -> int:
        """Return on which piece a ball is."""
        x, contact = self.place(ball, t)
        beyond = 0.5 * self.case.dphi_d - abs(x)
        if beyond <= 0.0:
            return 0
        reached = self.on_floor[contact] < 0.5 * self.case.dphi_d
        if reached and beyond >= self.on_floor[contact]:
            return 2
        return 1 if x < 0.0 else 3

    def breaks(self, end: float) -> list[float]:
        """Return the instants, s, from 0 to the end between which every ball stays on one piece."""
        times = [0.0, end]
        scan = np.linspace(0.0, end, max(50, math.ceil(end / 2e-6)))
        for ball in self.faulty:
            found = [self.piece(int(ball), float(t)) for t in scan]
            for k in np.flatnonzero(np.diff(found)):
                low, high = float(scan[k]), float(scan[k + 1])
                before = found[k]
                while high - low > 1e-15 + 4e-16 * high:
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if self.piece(int(ball), middle) == before else (low, middle)
                    if middle in (low, high) and high - low < 1e-14:
                        break
                times.append(high)
        for other in self.others:
            times += other.breaks(end)
        return sorted(times)

    def pieces(self, t: float) -> list[NDArray[np.int_]]:
        """Return on which piece of each defect the balls are that meet it."""
        own = np.array([self.piece(int(ball), t) for ball in self.faulty], dtype=int)
        return [own, *(other.pieces(t)[0] for other in self.others)]

    def over_defect(self, t: float, pieces: NDArray[np.int_]) -> NDArray[np.float64]:
        """Return how far the path over the first defect has receded, m, and how fast, m/s, (2, balls)."""
        out, dt = np.zeros((2, len(self.start))), 1e-8
        for ball, piece in zip(self.faulty, pieces, strict=True):
            if piece:
                out[0, ball] += self.depth(int(ball), t, int(piece))
                if piece != 2:
                    after, before = (self.depth(int(ball), t + s * dt, int(piece)) for s in (1.0, -1.0))
                    out[1, ball] += (after - before) / (2.0 * dt)
        return out

    def paths(self, t: float, pieces: list[NDArray[np.int_]]) -> NDArray[np.float64]:
        """Return how far the path has receded from every ball, m, and how fast, m/s, (2, balls)."""
        case, out = self.case, self.over_defect(t, pieces[0])
        for other, met in zip(self.others, pieces[1:], strict=True):
            out += other.over_defect(t, met)
        for amplitude, order, race, phase in case.waves:
            turning = case.cage - (case.shaft if race == "inner" else 0.0)
            angle = order * (self.start + turning * case.turned(t) / case.shaft) + phase
            out[0] += math.cos(ALPHA) * amplitude * np.cos(angle)
            out[1] -= math.cos(ALPHA) * amplitude * order * turning * case.over(t) * np.sin(angle)
        return out

    def rhs(self, t: float, state: NDArray[np.float64], pieces: list[NDArray[np.int_]]) -> NDArray[np.float64]:
        """Return the time derivative of (x, v) of inner ring, outer ring and resonator, shape (12,)."""
        case = self.case
        x, v = state[:6], state[6:]
        cage = case.cage * case.over(t)
        phi = self.start + case.cage * case.turned(t) / case.shaft
        receded, receding = self.paths(t, pieces)
        c, s = np.sin(phi), np.cos(phi)
        ux, uy = x[0] - x[2], x[1] - x[3]
        delta = ux * c + uy * s - receded - case.clearance
        speed = (v[0] - v[2]) * c + (v[1] - v[3]) * s + cage * (ux * s - uy * c) - receding
        pressed = np.maximum(delta, 0.0)
        damping = np.where(delta > 0.0, ALPHA_C * M_B + BETA_C * K_C * np.sqrt(pressed), 0.0)
        force = K_C * pressed**1.5 + damping * speed
        f = np.array([np.sum(force * c), np.sum(force * s)])
        spring = K_R * (x[2:4] - x[4:6]) + C_R * (v[2:4] - v[4:6])
        down = -case.gravity * np.array([math.sin(case.gravity_angle), math.cos(case.gravity_angle)])
        # The mass is at (sin, cos) of the angle: outwards with the speed squared, against its change along the circle.
        sine, cosine = math.sin(case.turned(t)), math.cos(case.turned(t))
        outwards, back = (case.shaft * case.over(t)) ** 2, case.turning.change(t)
        turning = case.unbalance * np.array([outwards * sine - back * cosine, outwards * cosine + back * sine])
        inner = (-f - K_I * x[:2] - C_I * v[:2] + turning) / M_I + down
        outer = (f - spring - np.array([0.0, case.load])) / M_O + down
        return np.concatenate((v, inner, outer, spring / M_R + down))

    def at_rest(self) -> NDArray[np.float64]:
        """Return the static equilibrium of the undamaged bearing at t = 0, shape (12,)."""
        case = self.case
        c, s = np.sin(self.start), np.cos(self.start)
        pull = case.gravity * np.array([math.sin(case.gravity_angle), math.cos(case.gravity_angle)])
        carried = (M_O + M_R) * pull + np.array([0.0, case.load])

        def residual(u: NDArray[np.float64]) -> NDArray[np.float64]:
            q = np.maximum(u[0] * c + u[1] * s - case.clearance * 1e6, 0.0) ** 1.5 * K_C * 1e-9
            return np.array([np.sum(q * c), np.sum(q * s)]) - carried

        direction = carried / np.hypot(*carried)
        u = root(residual, direction * (case.clearance * 1e6 + 8.0), tol=1e-13).x * 1e-6
        inner = -(carried + M_I * pull) / K_I
        outer = inner - u
        state = np.zeros(12)
        state[:2], state[2:4], state[4:6] = inner, outer, outer - M_R * pull / K_R
        return state

    def run(self, times: NDArray[np.float64], rtol: float = 1e-9) -> NDArray[np.float64]:
        """Return the acceleration of casing and resonator along (index 0) and across (1) the load at ascending times,
        s, from rest at t = 0, shape (times, 2, 2), m/s2.
        """
        state, out = self.at_rest(), np.empty((len(times), 2, 2))
        breaks = self.breaks(float(times[-1]) + 1e-9)
        scale = np.array([1e-6] * 6 + [1e-2] * 6)
        for a, b in pairwise(breaks):
            if b - a < 1e-12:
                continue
            pieces = self.pieces(0.5 * (a + b))
            inside = np.flatnonzero((times >= a - 1e-12) & (times < b - 1e-12))
            grid = np.append(np.maximum(times[inside], a), b)
            solution = solve_ivp(self.rhs, (a, b), state, "DOP853", grid, rtol=rtol, atol=rtol * scale, args=(pieces,))
            state = solution.y[:, -1]
            for k, y in zip(inside, solution.y.T[:-1], strict=True):
                derivative = self.rhs(float(times[k]), y, pieces)
                out[k] = [derivative[[9, 8]], derivative[[11, 10]]]
        return out
