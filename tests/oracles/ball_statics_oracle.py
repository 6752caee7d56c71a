"""Slow and obvious reference of the statics of a ball bearing: Eqs. 3-11 of Thibault et al. 2022 with scipy.

Shares no code with models/: absolute coordinates of the ball and of both centres of curvature as printed, Hertz with
elliptic integrals and E* as Eq. 10 has it, one search a ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, root_scalar
from scipy.special import ellipe, ellipk


@dataclass(frozen=True)
class Geometry:
    """Lengths, m, modulus, Pa: number of balls, their radius R, pitch radius, groove radii and diametral clearance."""

    balls: int
    radius: float
    pitch: float
    groove_i: float
    groove_o: float
    clearance: float
    modulus: float = 200e9
    poisson: float = 0.3

    def stiffness(self) -> tuple[float, float]:
        """Return C_IR and C_OR, N/m^1.5 (Eq. 10)."""
        inner, outer = self.pitch - self.radius, self.pitch + self.radius
        return (
            self._hertz(1.0 / self.radius + 1.0 / inner, 1.0 / self.radius - 1.0 / self.groove_i),
            self._hertz(1.0 / self.radius - 1.0 / outer, 1.0 / self.radius - 1.0 / self.groove_o),
        )

    def _hertz(self, along: float, across: float) -> float:
        total, difference = along + across, (along - across) / (along + across)

        def wrong(log_kappa: float) -> float:
            k2 = math.exp(2.0 * log_kappa)
            m = 1.0 - 1.0 / k2
            return ((k2 + 1.0) * ellipe(m) - 2.0 * ellipk(m)) / ((k2 - 1.0) * ellipe(m)) - difference

        kappa = math.exp(root_scalar(wrong, bracket=(1e-4, 6.0), xtol=1e-15).root)
        m = 1.0 - kappa**-2
        reduced = 1.0 / (2.0 * (1.0 - self.poisson**2) / self.modulus)
        bent = math.sqrt(ellipe(m) / (ellipk(m) ** 3 * total))
        return 2.0 * math.sqrt(2.0) / 3.0 * math.pi * kappa * reduced * bent


def ball(
    geometry: Geometry, stiffness: tuple[float, float], q: NDArray[np.float64], phi: float, c_f: float
) -> tuple[float, float, float, float]:
    """Return N_i, N_o and both contact angles of the ball at an angle; none of the inner race where N_i is 0."""
    g = geometry
    r_o = g.pitch + g.radius - g.groove_o
    r_i = q[0] * math.cos(phi) + q[1] * math.sin(phi) + g.pitch - g.radius + g.groove_i
    z_i = q[2] + (g.pitch - g.radius + g.groove_i) * (math.sin(phi) * q[3] - math.cos(phi) * q[4])
    k_i, k_o = stiffness

    def forces(z_b: float, r_b: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        result = []
        for z, r, groove, k in ((z_i - z_b, r_i - r_b, g.groove_i, k_i), (-z_b, r_o - r_b, g.groove_o, k_o)):
            length = math.hypot(z, r)
            delta = max(0.0, length - groove + g.radius - g.clearance / 4.0)
            result.append(k * delta**1.5 * np.array([z, r]) / length)
        return result[0], result[1]

    # Everything in units of 0.1 mm about the place where the centrifugal force alone takes the ball.
    outside = r_o + g.groove_o - g.radius + g.clearance / 4.0 + (c_f / k_o) ** (2.0 / 3.0)
    if not forces(0.0, outside)[0].any():
        return 0.0, c_f, 0.0, 0.0

    def unbalanced(u: NDArray[np.float64]) -> NDArray[np.float64]:
        inner, outer = forces(1e-4 * u[0], outside + 1e-4 * u[1])
        return inner + outer + np.array([0.0, c_f])

    best = min(
        (least_squares(unbalanced, np.array(u), xtol=1e-15, ftol=1e-15, gtol=1e-15) for u in ((0.0, 0.0), (1.0, 0.5))),
        key=lambda found: found.cost,
    )
    assert np.abs(best.fun).max() < 1e-6
    z_b, r_b = 1e-4 * best.x[0], outside + 1e-4 * best.x[1]
    inner, outer = forces(z_b, r_b)
    return (
        float(np.hypot(*inner)),
        float(np.hypot(*outer)),
        math.asin((z_i - z_b) / math.hypot(z_i - z_b, r_i - r_b)),
        math.asin(z_b / math.hypot(z_b, r_b - r_o)),
    )


def carried(geometry: Geometry, q: NDArray[np.float64], cage_angle: float, c_f: float) -> NDArray[np.float64]:
    """Return forces and moments that the balls carry: F_x, F_y, F_z, M_x, M_y."""
    total, stiffness = np.zeros(5), geometry.stiffness()
    arm = geometry.pitch - geometry.radius + geometry.groove_i
    for j in range(geometry.balls):
        phi = cage_angle + 2.0 * math.pi * j / geometry.balls
        n_i, _, beta_i, _ = ball(geometry, stiffness, q, phi, c_f)
        f_r, f_z = n_i * math.cos(beta_i), n_i * math.sin(beta_i)
        total += [
            f_r * math.cos(phi),
            f_r * math.sin(phi),
            f_z,
            f_z * arm * math.sin(phi),
            -f_z * arm * math.cos(phi),
        ]
    return total
