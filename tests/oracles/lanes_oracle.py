"""Slow and obvious reference of slip: explicit Runge-Kutta on the equations of six_dof_oracle, a sigma for each ball.

The displacement of each ball from its place in the cage is given for every ball and passage; it enters position and
path (Eqs. 32 and 82) and is never differentiated. Steps are so small that no propagator is needed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.oracles.six_dof_oracle import N_BALLS, N_ROWS, PITCH, Case, Oracle, contact_sum, path

_DIFFERENCE = 1e-7


class SlipOracle(Oracle):
    """The model with balls that stand off by angles which are redrawn at the point opposite to the load."""

    def __init__(self, case: Case, draws: NDArray[np.float64]) -> None:
        """Take the angles, rad, shape (periods, rows): ball of row r that passes the far point in each period."""
        super().__init__(case)
        self.draws = draws
        self.row = np.repeat(np.arange(N_ROWS), N_BALLS)
        self.stood: tuple[int, NDArray[np.float64]] = (-1, np.zeros(0))
        grid = np.linspace(-math.pi, math.pi, 200_001)
        self.table_angle, self.table = grid, np.array([path(case, float(a)) for a in grid])

    def sigma(self, t: float) -> NDArray[np.float64]:
        """Return the angle of each ball: the draw of the period in which it began its present round.

        A ball begins a round where the period begins in which its place first lies within a pitch beyond the far point.
        """
        now = min(math.floor(t * self.case.omega_c / PITCH + 1e-9), len(self.draws) - 1)
        if now == self.stood[0]:
            return self.stood[1]
        out = np.zeros(len(self.start))
        for ball, start in enumerate(self.start):
            place = (start + now * PITCH + math.pi) % (2.0 * math.pi)
            since = math.floor(place / PITCH + 1e-9)
            born = now - since
            if born >= 0:
                out[ball] = self.draws[born, self.far_order(ball, born)]
        self.stood = now, out
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
        path_ = np.stack((d, (ahead - d) / _DIFFERENCE))
        return contact_sum(phi, path_, x, v, omega, self.case.clearance, self.k_c, self.exponent)

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
