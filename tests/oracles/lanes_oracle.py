"""Slow and obvious reference of slip: explicit Runge-Kutta on the equations of six_dof_oracle, a sigma for each ball.

The displacement of each ball from its place in the cage is given for every ball and passage; it enters position and
path (Eqs. 32 and 82) and is never differentiated. Steps are so small that no propagator is needed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.oracles.six_dof_oracle import ALPHA_C, BETA_C, K_C, M_B, N_BALLS, N_ROWS, PITCH, Case, Oracle, path

_DIFFERENCE = 1e-7


class SlipOracle(Oracle):
    """The model with balls that stand off by angles which are redrawn at the point opposite to the load."""

    def __init__(self, case: Case, draws: NDArray[np.float64]) -> None:
        """Take the angles, rad, shape (periods, rows): ball of row r that passes the far point in each period."""
        super().__init__(case)
        self.draws = draws
        self.row = np.repeat(np.arange(N_ROWS), N_BALLS)
        grid = np.linspace(-math.pi, math.pi, 200_001)
        self.table_angle, self.table = grid, np.array([path(case, float(a)) for a in grid])

    def sigma(self, t: float) -> NDArray[np.float64]:
        """Return the angle of each ball: the draw of the period in which it began its present round.

        A ball begins a round where the period begins in which its place first lies within a pitch beyond the far point.
        """
        now = min(math.floor(t * self.case.omega_c / PITCH + 1e-9), len(self.draws) - 1)
        out = np.zeros(len(self.start))
        for ball, start in enumerate(self.start):
            place = (start + now * PITCH + math.pi) % (2.0 * math.pi)
            since = math.floor(place / PITCH + 1e-9)
            born = now - since
            if born >= 0:
                out[ball] = self.draws[born, self.far_order(ball, born)]
        return out

    def far_order(self, ball: int, period: int) -> int:
        """Return which of the places just beyond the far point, counted in angle, a ball stands at in a period."""
        place = (self.start[ball] + period * PITCH + math.pi) % (2.0 * math.pi)
        return round(place / (PITCH / N_ROWS))

    def forces(self, t: float, x: NDArray[np.float64], v: NDArray[np.float64], middle: float) -> NDArray[np.float64]:
        """Return the sum of contact and damping forces on the inner ring, N, as the base class does without slip."""
        omega = self.case.omega_c
        phi = self.start + omega * t + self.sigma(middle)
        around = np.mod(phi + math.pi, 2.0 * math.pi) - math.pi
        faulty = np.where(self.faulty, 1.0, 0.0)
        d = faulty * np.interp(around, self.table_angle, self.table)
        ahead = faulty * np.interp(around + _DIFFERENCE, self.table_angle, self.table)
        c, s = np.sin(phi), np.cos(phi)
        ux, uy = x[0] - x[2], x[1] - x[3]
        delta = ux * c + uy * s - d - self.case.clearance
        rate = (v[0] - v[2]) * c + (v[1] - v[3]) * s + omega * (ux * s - uy * c) - omega * (ahead - d) / _DIFFERENCE
        on = delta > 0.0
        pressed = np.where(on, delta, 0.0)
        force = K_C * pressed**1.5 + np.where(on, (ALPHA_C * M_B + BETA_C * K_C * np.sqrt(pressed)) * rate, 0.0)
        return np.array([np.sum(force * c), np.sum(force * s)])

    def acceleration(self, steps: int) -> NDArray[np.float64]:
        """Return the casing's acceleration along the load at the beginning of each step, from rest over all periods."""
        h = len(self.draws) * PITCH / self.case.omega_c / steps
        y, out = self.at_rest(), np.empty(steps)
        for n in range(steps):
            t = n * h
            middle = t + 0.5 * h
            k1 = self.rhs(t, y, middle)
            out[n] = k1[9]
            k2 = self.rhs(middle, y + 0.5 * h * k1, middle)
            k3 = self.rhs(middle, y + 0.5 * h * k2, middle)
            k4 = self.rhs(t + h, y + h * k3, middle)
            y = y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return out
