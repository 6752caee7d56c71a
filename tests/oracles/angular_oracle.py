"""A shaft on two ball bearings (Thibault et al. 2022), written anew: all coordinates, over time, by scipy.

Shares no code with the product. Elements with consistent mass in the closed form of Friedman and Kosmatka (1993),
Hertz's contact from elliptic integrals, balls by scipy's root finder or a vectorised Newton method, pressures over
spalls by quadrature over strips. The motion is that of the physical coordinates over time, not of modes over angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import root, root_scalar
from scipy.special import ellipe, ellipk

Array = NDArray[np.float64]
E, NU, RHO, D, DM = 200e9, 0.3, 7800.0, 12.7e-3, 80e-3
LENGTH, OUTSIDE, INSIDE, ELEMENTS = 0.4, 0.04, 0.03, 4
COUPLING, END, DISC, LOAD_TORQUE, CR = 1300.0, 1.91e-3, (0.017, 8.5e-6, 4.3e-6), 10.0, 0.0015
GROOVE, PLAY, ZETA, GOVERNOR, SLIDE = 0.51 * D, 35e-6, 0.02, 0.1, 1e-4
STRIPS = (np.arange(500) + 0.5) / 500.0


@dataclass(frozen=True)
class Pit:
    """A spall: bearing (0, 1), race, middle, extent and width, rad (None: all of the groove), depth, m."""

    bearing: int
    race: str
    middle: float
    extent: float
    width: float | None
    depth: float


@dataclass(frozen=True)
class Case:
    """What differs between runs; speed in Hz, slope in Hz/s, unbalance in kg m, cages in rad.

    The speed swings by ``swing`` Hz as a sine of ``pace`` Hz.
    """

    speed: float = 100.0
    load: float = 600.0
    axial: float = 200.0
    balls: tuple[int, int] = (11, 10)
    slope: float = 0.0
    unbalance: float = 0.0
    cages: tuple[float, float] = (0.0, 0.0)
    play: float = PLAY
    pits: tuple[Pit, ...] = field(default=())
    swing: float = 0.0
    pace: float = 1.0

    def nominal(self, t: Any) -> tuple[Any, Any, Any]:
        """Return angle, speed and acceleration of the nominal rotation, in rad."""
        whole, rate = 2.0 * math.pi, 2.0 * math.pi * self.pace
        swung = self.swing / rate * (1.0 - np.cos(rate * t))
        turned = self.speed * t + 0.5 * self.slope * t * t + swung
        speed = self.speed + self.slope * t + self.swing * np.sin(rate * t)
        return whole * turned, whole * speed, whole * (self.slope + self.swing * rate * np.cos(rate * t))


def beam() -> tuple[Array, Array]:
    """Return stiffness and mass of bending in one plane, (shift, slope) of each node."""
    h, area = LENGTH / ELEMENTS, math.pi / 4.0 * (OUTSIDE**2 - INSIDE**2)
    second, g = math.pi / 64.0 * (OUTSIDE**4 - INSIDE**4), E / (2.0 * (1.0 + NU))
    m = INSIDE / OUTSIDE
    cowper = 6 * (1 + NU) * (1 + m**2) ** 2 / ((7 + 6 * NU) * (1 + m**2) ** 2 + (20 + 12 * NU) * m**2)
    f = 12.0 * E * second / (cowper * g * area * h * h)
    k = E * second / ((1 + f) * h**3) * np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, (4 + f) * h * h, -6 * h, (2 - f) * h * h],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, (2 - f) * h * h, -6 * h, (4 + f) * h * h],
        ]
    )  # fmt: skip
    a, b = 70 * f * f + 147 * f + 78, (35 * f * f + 77 * f + 44) * h / 4
    c, d = 35 * f * f + 63 * f + 27, (35 * f * f + 63 * f + 26) * h / 4
    e, i = (7 * f * f + 14 * f + 8) * h * h / 4, (7 * f * f + 14 * f + 6) * h * h / 4
    shift = np.array([[a, b, c, -d], [b, e, d, -i], [c, d, a, -b], [-d, -i, -b, e]])
    u, v, w = (15 * f - 3) * h, (10 * f * f + 5 * f + 4) * h * h, (5 * f * f - 5 * f - 1) * h * h
    turn = np.array([[36, -u, -36, -u], [-u, v, u, w], [-36, u, 36, u], [-u, w, u, v]])
    mass = RHO * area * h / (210 * (1 + f) ** 2) * shift + RHO * second / (30 * (1 + f) ** 2 * h) * turn
    return chain(k, 2), chain(mass, 2)


def rod(stiff: float, inert: float) -> tuple[Array, Array]:
    """Return stiffness and mass of a rod or of torsion, from E A or G J and rho A or rho J."""
    h = LENGTH / ELEMENTS
    return chain(stiff / h * np.array([[1.0, -1], [-1, 1]]), 1), chain(inert * h / 6 * np.array([[2.0, 1], [1, 2]]), 1)


def block_diag(*parts: Array) -> Array:
    """Return a matrix with others on its diagonal."""
    whole, at = np.zeros((sum(len(part) for part in parts),) * 2), 0
    for part in parts:
        whole[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return whole


def chain(element: Array, per_node: int) -> Array:
    """Return the matrix of all elements in a row."""
    whole = np.zeros((per_node * (ELEMENTS + 1),) * 2)
    for n in range(ELEMENTS):
        part = slice(per_node * n, per_node * (n + 2))
        whole[part, part] += element
    return whole


def hertz(r_roll: float, r_across: float) -> tuple[float, float, float]:
    """Return stiffness, N/m^1.5, and the semi-axes along and across at 1 N, m, of positive relative radii."""
    modulus, total = E / (1.0 - NU**2), 1.0 / r_roll + 1.0 / r_across
    ratio = r_across / r_roll

    def miss(k: float) -> float:
        m = 1.0 - 1.0 / k**2
        first, second = float(ellipk(m)), float(ellipe(m))
        return (k * k * second - first) / (first - second) - ratio

    k = float(root_scalar(miss, bracket=(1.0 + 1e-6, 200.0), xtol=1e-15).root)
    m = 1.0 - 1.0 / k**2
    first, second = float(ellipk(m)), float(ellipe(m))
    # d = F (9 S / (2 e (pi k E')^2))^(1/3) N^(2/3), with curvature sum S; a = (6 k^2 e N / (pi S E'))^(1/3).
    stiffness = math.pi * k * modulus * math.sqrt(2.0 * second / (9.0 * first**3 * total))
    across = (6.0 * k * k * second / (math.pi * total * modulus)) ** (1.0 / 3.0)
    return stiffness, across / k, across


def strip_share(x: tuple[float, float], y: tuple[float, float]) -> float:
    """Return the share of half an ellipsoid over a rectangle in units of the semi-axes, by strips."""
    if x[0] <= -1.0 and x[1] >= 1.0 and y[0] <= -1.0 and y[1] >= 1.0:
        return 1.0
    low, high = (math.asin(max(-1.0, min(1.0, v))) for v in x)
    if high <= low:
        return 0.0
    t = low + (high - low) * STRIPS
    reach = np.cos(t)

    def area(v: float) -> Array:
        w = np.clip(v, -reach, reach)
        return 0.5 * (w * np.sqrt(np.maximum(reach**2 - w**2, 0.0)) + reach**2 * np.arcsin(w / reach))

    return float(np.mean((area(y[1]) - area(y[0])) * reach) * (high - low) * 1.5 / math.pi)


class Bearing:
    """One bearing; races are (inner, outer)."""

    def __init__(self, balls: int, cage: float, case: Case, side: int) -> None:
        self.balls, self.cage, self.play = balls, cage, case.play
        self.pits = [pit for pit in case.pits if pit.bearing == side]
        r_i, r_o, r, g = DM / 2 - D / 2, DM / 2 + D / 2, D / 2, GROOVE
        across = 1.0 / (1.0 / r - 1.0 / g)
        self.contacts = (hertz(1.0 / (1 / r + 1 / r_i), across), hertz(1.0 / (1 / r - 1 / r_o), across))
        self.radii = (r_i, r_o)
        self.centre = (r_i + g, r_o - g)
        self.last: dict[int, Array] = {}

    def force(self, race: int, d: float, angle: float, contact_angle: float) -> float:
        """Return the force of one contact, over pits too."""
        k, along, across = self.contacts[race]
        if d <= 0.0:
            return 0.0
        total = k * d**1.5
        for pit in self.pits:
            if pit.race != ("inner", "outer")[race]:
                continue
            x = self.radii[race] * math.remainder(angle - pit.middle, 2.0 * math.pi)
            y = GROOVE * contact_angle
            half = 0.5 * self.radii[race] * pit.extent, 1e3 if pit.width is None else 0.5 * GROOVE * pit.width
            for depth, sign in ((0.0, -1.0), (pit.depth, 1.0)):
                n = k * max(d - depth, 0.0) ** 1.5
                if n > 0.0:
                    b, a = along * n ** (1 / 3), across * n ** (1 / 3)
                    share = strip_share(
                        ((-half[0] - x) / b, (half[0] - x) / b), ((-half[1] - y) / a, (half[1] - y) / a)
                    )
                    total += sign * n * share
        return max(total, 0.0)

    def near(self, angle: float, turned: float) -> bool:
        """Whether a ball may touch a pit."""
        for pit in self.pits:
            on = angle - (turned if pit.race == "inner" else 0.0) - pit.middle
            if abs(math.remainder(on, 2.0 * math.pi)) < 0.5 * pit.extent + 0.005:
                return True
        return False

    def balance(
        self, u: Array, p: Array, c_f: float, angle: float, turned: float
    ) -> tuple[Array, tuple[float, float], tuple[float, float]]:
        """Return the forces on a ball, normal forces and contact angles (inner, outer)."""
        gap = GROOVE - D / 2 + self.play / 4
        rho_i, rho_o = p - u, u
        l_i, l_o = math.hypot(*rho_i), math.hypot(*rho_o)
        beta = math.atan2(rho_i[0], rho_i[1]), math.atan2(rho_o[0], rho_o[1])
        n_i = self.force(0, l_i - gap, angle - turned, beta[0])
        n_o = self.force(1, l_o - gap, angle, beta[1])
        return n_i * rho_i / l_i - n_o * rho_o / l_o + np.array([0.0, c_f]), (n_i, n_o), beta

    def ball(
        self, number: int, p: Array, c_f: float, angle: float, turned: float
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return normal forces and contact angles of a ball in equilibrium."""
        gap = GROOVE - D / 2 + self.play / 4
        # Out to where the outer race alone bears the centrifugal force.
        deepest = sum(pit.depth for pit in self.pits)
        if self.near(angle, turned):
            bracket = (0.0, 1e-4 + deepest)
            d = root_scalar(lambda v: self.force(1, v, angle, 0.0) - c_f, bracket=bracket, xtol=1e-15).root
        else:
            d = (c_f / self.contacts[1][0]) ** (2.0 / 3.0)
        begin = np.array([0.0, gap + float(d)])
        if math.hypot(*(p - begin)) <= gap:
            return (0.0, c_f), (0.0, 0.0)
        size, forces, beta = math.inf, (0.0, 0.0), (0.0, 0.0)
        for start, method in ((self.last.get(number, begin), "hybr"), (begin, "hybr"), (0.5 * p, "lm"), (begin, "lm")):
            found = root(
                lambda v, start=start: 1e-2 * self.balance(start + 1e-6 * v, p, c_f, angle, turned)[0],
                np.zeros(2),
                # Of 1e-6 m: the forces balance to 1e-6 N, which is checked.
                tol=1e-9,
                method=method,
            )
            place = start + 1e-6 * found.x
            left, forces, beta = self.balance(place, p, c_f, angle, turned)
            size = math.hypot(*left)
            if size < 1e-6:
                self.last[number] = place
                break
        assert size < 1e-4, (size, p, c_f)
        return forces, beta

    def load(self, q: Array, cage: float, c_f: float, turned: float) -> tuple[Array, float, float]:
        """Return the load from inner to outer ring (5,), the resisting torque and the cosine of the mean angle."""
        total, torque, weight, mean = np.zeros(5), 0.0, 0.0, 0.0
        for j in range(self.balls):
            phi = cage + 2.0 * math.pi * j / self.balls
            c, s = math.cos(phi), math.sin(phi)
            z = q[2] + self.centre[0] * (s * q[3] - c * q[4])
            r = self.centre[0] + q[0] * c + q[1] * s - self.centre[1]
            (n_i, n_o), (b_i, b_o) = self.ball(j, np.array([z, r]), c_f, phi, turned)
            f_z, f_r = n_i * math.sin(b_i), n_i * math.cos(b_i)
            total += np.array([f_r * c, f_r * s, f_z, self.centre[0] * s * f_z, -self.centre[0] * c * f_z])
            torque += 0.5 * CR * (n_i + n_o) * (DM / 2 - D / 2 * math.cos(b_i))
            weight, mean = weight + n_i, mean + n_i * 0.5 * (b_i + b_o)
        return total, torque, math.cos(mean / weight) if weight > 0.0 else 1.0


class Machine:
    """Shaft, bearings, drive and load. Coordinates: x plane, y plane, z, then torsion with drive and load."""

    def __init__(self, case: Case) -> None:
        self.case = case
        self.bearings = [Bearing(case.balls[k], case.cages[k], case, k) for k in range(2)]
        area, second = math.pi / 4.0 * (OUTSIDE**2 - INSIDE**2), math.pi / 64.0 * (OUTSIDE**4 - INSIDE**4)
        (k_b, m_b), (k_r, m_r) = beam(), rod(E * area, RHO * area)
        k_t, m_t = rod(E / (2 * (1 + NU)) * 2 * second, RHO * 2 * second)
        nodes, mid = ELEMENTS + 1, ELEMENTS // 2
        m_b = m_b.copy()
        m_b[2 * mid, 2 * mid] += DISC[0]
        m_b[2 * mid + 1, 2 * mid + 1] += DISC[2]
        m_r[mid, mid] += DISC[0]
        m_t[mid, mid] += DISC[1]
        self.k, self.m = block_diag(k_b, k_b, k_r), block_diag(m_b, m_b, m_r)
        # In the y plane the slope of the beam is minus the turn about x.
        size = 2 * nodes
        self.rows = [
            ([2 * n, size + 2 * n, 2 * size + n, size + 2 * n + 1, 2 * n + 1], [1.0, 1, 1, -1, 1])
            for n in (0, ELEMENTS, mid)
        ]
        self.m_t, self.k_t = block_diag(m_t, END * np.eye(2)), block_diag(k_t, np.zeros((2, 2)))
        for node, end in ((0, nodes), (ELEMENTS, nodes + 1)):
            for a, b, sign in ((node, node, 1), (end, end, 1), (node, end, -1), (end, node, -1)):
                self.k_t[a, b] += sign * COUPLING
        self.inertia = float(self.m_t.sum())
        self.k_t[nodes, nodes] += self.inertia * (2 * math.pi * GOVERNOR * case.speed) ** 2
        self.node = {"a": 0, "b": ELEMENTS, "c": mid, "drive": nodes, "load": nodes + 1}

    def ring(self, x: Array, side: int, slide: float) -> Array:
        """Return the displacement of an inner against its outer ring."""
        rows, signs = self.rows[side]
        q = x[rows] * np.array(signs)
        q[2] -= slide if side == 0 else 0.0
        return q

    def prepare(self, x: Array, slide: float, cosines: tuple[float, float]) -> None:
        """Find damping, sliding and the torque of the drive at a place in equilibrium."""
        case, tangent, torque = self.case, [], []
        for side, bearing in enumerate(self.bearings):
            healthy = Bearing(bearing.balls, bearing.cage, Case(play=case.play), side)
            c_f = self.flung(2.0 * math.pi * case.speed, cosines[side])
            q, matrix = self.ring(x, side, slide), np.zeros((5, 5))
            for k, h in enumerate((1e-9, 1e-9, 1e-9, 1e-8, 1e-8)):
                plus, minus = (healthy.load(q + v * np.eye(5)[k], bearing.cage, c_f, 0.0)[0] for v in (h, -h))
                matrix[:, k] = (plus - minus) / (2 * h)
            tangent.append(0.5 * (matrix + matrix.T))
            torque.append(healthy.load(q, bearing.cage, c_f, 0.0)[1])
        self.slide_loss = tangent[0][2, 2] * SLIDE
        a = tangent[0] - np.outer(tangent[0][:, 2], tangent[0][2]) / tangent[0][2, 2]
        whole = self.k.copy()
        for matrix, (rows, signs) in zip((a, tangent[1]), self.rows[:2], strict=True):
            whole[np.ix_(rows, rows)] += matrix * np.outer(signs, signs)
        self.c, self.c_t = damping(whole, self.m), damping(self.k_t, self.m_t, 0.7)
        self.steady = np.zeros(len(self.k_t))
        self.steady[self.node["drive"]] += LOAD_TORQUE + sum(torque)
        self.steady[self.node["load"]] -= LOAD_TORQUE
        rest = self.steady + self.inert(float(case.nominal(0.0)[2]))
        rest[self.node["a"]] -= torque[0]
        rest[self.node["b"]] -= torque[1]
        self.twist = np.linalg.solve(self.k_t, rest)
        self.m_inverse, self.m_t_inverse = np.linalg.inv(self.m), np.linalg.inv(self.m_t)

    def inert(self, change: float) -> Array:
        """Return the torques by which all resists a nominal acceleration, and the drive's that balances their sum."""
        torque = -change * self.m_t.sum(axis=1)
        torque[self.node["drive"]] += change * self.inertia
        return torque

    def flung(self, speed: float, cosine: float) -> float:
        """Return the centrifugal force on a ball."""
        return RHO * math.pi / 6 * D**3 * DM / 2 * (speed * 0.5 * (1 - D / DM * cosine)) ** 2

    def rate(self, t: float, z: Array) -> Array:
        """Return the time derivative: x, x', twist, twist', cages, mean cosines, slide."""
        case, n, m = self.case, len(self.k), len(self.k_t)
        x, v, w, s = z[:n], z[n : 2 * n], z[2 * n : 2 * n + m], z[2 * n + m : 2 * n + 2 * m]
        cages, cosines, slide = z[-5:-3], z[-3:-1], z[-1]
        turned, nominal, change = case.nominal(t)
        force, torque, last = np.zeros(n), self.steady + self.inert(change), np.zeros(5)
        rows, _ = self.rows[2]
        force[rows[0]] += case.load
        force[rows[2]] -= case.axial
        speed_c, angle_c = nominal + s[self.node["c"]], turned + w[self.node["c"]]
        force[rows[0]] += case.unbalance * speed_c**2 * math.cos(angle_c)
        force[rows[1]] += case.unbalance * speed_c**2 * math.sin(angle_c)
        for side, name in enumerate("ab"):
            speed, bearing = nominal + s[self.node[name]], self.bearings[side]
            turn = turned + w[self.node[name]] - self.twist[self.node[name]]
            c_f = self.flung(speed, cosines[side])
            load, resisted, cosine = bearing.load(self.ring(x, side, slide), cages[side], c_f, turn)
            rows, signs = self.rows[side]
            force[rows] -= load * np.array(signs)
            torque[self.node[name]] -= resisted
            last[side] = 0.5 * speed * (1 - D / DM * cosine)
            passages = bearing.balls * 0.5 * speed * (1 - D / DM * cosines[side]) / (2 * math.pi)
            last[2 + side] = (cosine - cosines[side]) * passages
            if side == 0:
                last[4] = load[2] / self.slide_loss
        torque[self.node["load"]] -= LOAD_TORQUE / (2 * math.pi * case.speed) * s[self.node["load"]]
        a = self.m_inverse @ (force - self.k @ x - self.c @ v)
        b = self.m_t_inverse @ (torque - self.k_t @ w - self.c_t @ s)
        return np.concatenate((v, a, s, b, last))


def damping(k: Array, m: Array, first: float = ZETA) -> Array:
    """Return the damping matrix that gives each mode its ratio."""
    values, vectors = eigh(k, m)
    ratios = np.full(len(values), ZETA)
    ratios[0] = first
    return m @ vectors @ np.diag(2 * ratios * np.sqrt(np.maximum(values, 0.0))) @ vectors.T @ m


def simulate(case: Case, x: Array, slide: float, cosines: tuple[float, float], times: Array) -> dict[str, Array]:
    """Return ias and angle of the disc and the accelerations of A, B and disc along the load at some times.

    Args:
        x: lateral displacements at the beginning: (x, y, z, turn about x, turn about y) of all nodes, (nodes, 5).
    """
    machine, nodes = Machine(case), ELEMENTS + 1
    begin = np.concatenate((np.stack([x[:, 0], x[:, 4]], 1).ravel(), np.stack([x[:, 1], -x[:, 3]], 1).ravel(), x[:, 2]))
    machine.prepare(begin, slide, cosines)
    n, m = 5 * nodes, nodes + 2
    z = np.concatenate((begin, np.zeros(n), machine.twist, np.zeros(m), case.cages, cosines, [slide]))
    scale: Any = np.concatenate(
        (np.full(n, 1e-6), np.full(n, 1e-2), np.full(m, 1e-6), np.full(m, 1e-3), [1e-3] * 4, [1e-6])
    )
    solved = solve_ivp(
        machine.rate, (0.0, float(times[-1])), z, method="DOP853", t_eval=times, rtol=1e-6, atol=1e-5 * scale,
        first_step=1e-6, max_step=2e-5,
    )  # fmt: skip
    rates = np.array([machine.rate(t, column) for t, column in zip(solved.t, solved.y.T, strict=True)])
    disc = machine.node["c"]
    turned = case.nominal(times)[0]
    return {
        "ias": solved.y[2 * n + m + disc],
        "angle": turned + solved.y[2 * n + disc],
        "acceleration": np.stack([rates[:, n + machine.rows[k][0][0]] for k in range(3)], axis=1),
    }
