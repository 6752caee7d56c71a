"""The oracle's own description of a scene in plain numbers, its statics and the resonances of the linearised rig."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

BALL_EXPONENT, ROLLER_EXPONENT = 1.5, 10.0 / 9.0


@dataclass(frozen=True)
class Geometry:
    """One bearing: elements in a row, radii, m, contact angle, rad, and the radius r_o of the outer race."""

    name: str
    element: str
    n_elements: int
    rows: int
    element_radius: float
    pitch_radius: float
    contact_angle: float
    outer_race_radius: float


@dataclass(frozen=True)
class Rough:
    """A rough floor: sd after filtering, m, sample pitch, rad, cut-off, cycles per metre, and seed."""

    sd: float
    pitch: float
    cutoff: float
    seed: int


@dataclass(frozen=True)
class Parameters:
    """Masses, stiffness and damping of the rig, SI units, by the symbols of the thesis (Table 18)."""

    m_i: float
    m_o: float
    m_r: float
    m_b: float
    k_i: float
    k_r: float
    k_c: float
    c_i: float
    c_r: float
    alpha_c: float
    beta_c: float


@dataclass(frozen=True)
class Pit:
    """One defect of the outer race: extent, rad, depth, m, angle of its centre from the load, rad, and damaged rows."""

    extent: float
    depth: float
    position: float
    rows: int


@dataclass(frozen=True)
class Wave:
    """One wave of the outer race, which recedes by amplitude * cos(order * phi + phase): m, waves around it, rad."""

    amplitude: float
    order: int
    phase: float


@dataclass(frozen=True)
class OracleScene:
    """One scene, SI units: shaft speed in Hz, extent and position (of the defect's centre from the load) in rad.

    ``rows`` is the number of damaged rows, from the first on; none is a healthy bearing. ``more``: further defects,
    apart from the first and each other; all have the floor of the first. ``beyond``: the highest resonance exceeds what
    an engine must take.
    """

    speed: float
    load: float
    clearance: float
    extent: float
    depth: float
    rows: int
    geometry: Geometry
    rough: Rough | None
    parameters: Parameters
    position: float = 0.0
    kind: str = "any"
    beyond: bool = False
    more: tuple[Pit, ...] = ()
    waves: tuple[Wave, ...] = ()

    @property
    def pits(self) -> tuple[Pit, ...]:
        """The defects that move an element."""
        first = Pit(self.extent, self.depth, self.position, self.rows)
        return tuple(p for p in (first, *self.more) if p.rows > 0 and p.extent > 0.0 and p.depth > 0.0)

    @property
    def exponent(self) -> float:
        """Exponent of the contact force."""
        return BALL_EXPONENT if self.geometry.element == "ball" else ROLLER_EXPONENT

    @property
    def omega_c(self) -> float:
        """Cage speed, rad/s (Eq. 33)."""
        g = self.geometry
        return math.pi * self.speed * (1.0 - g.element_radius / g.pitch_radius * math.cos(g.contact_angle))

    @property
    def pitch(self) -> float:
        """Spacing of the elements of a row, rad."""
        return 2.0 * math.pi / self.geometry.n_elements

    @property
    def period(self) -> float:
        """Time in which an element of a row takes the place of the next one, s."""
        return self.pitch / self.omega_c

    @property
    def angles(self) -> NDArray[np.float64]:
        """Angles of all elements from the load at cage angle zero, rad (Eq. 32): row after row, evenly staggered."""
        g = self.geometry
        rows = np.repeat(np.arange(g.rows), g.n_elements)
        return rows * self.pitch / g.rows + np.tile(np.arange(g.n_elements), g.rows) * self.pitch

    @cached_property
    def approach(self) -> float:
        """Relative displacement along the load at rest, m: the elements lie symmetrically about it (Eqs. 20-25)."""
        c = np.cos(self.angles)

        def missing(u: float) -> float:
            pressed = np.maximum((self.clearance + u) * c - self.clearance, 0.0)
            return float(np.sum(self.parameters.k_c * pressed**self.exponent * c)) / self.load - 1.0

        # One element alone in the load direction is pressed the most that any load can press it.
        most = (self.load / self.parameters.k_c) ** (1.0 / self.exponent)
        return self.clearance + _root(missing, 1.000001 * most)

    def contact_stiffness(self, approach: float | None = None) -> tuple[float, float]:
        """Return the tangent stiffness of the bearing along and across the load, N/m (Eq. 61), by default at rest."""
        u = self.approach if approach is None else approach
        c, s = np.cos(self.angles), np.sin(self.angles)
        pressed = np.maximum(u * c - self.clearance, 0.0)
        tangent = np.where(pressed > 0.0, self.exponent * self.parameters.k_c * pressed ** (self.exponent - 1.0), 0.0)
        return float(np.sum(tangent * c * c)), float(np.sum(tangent * s * s))

    def rates(self) -> NDArray[np.complex128]:
        """Return the twelve eigenvalues of the linearised damped rig at rest, 1/s."""
        found = []
        mass = np.diag([self.parameters.m_i, self.parameters.m_o, self.parameters.m_r])
        spring = self.parameters.k_r * np.array([[0, 0, 0], [0, 1, -1], [0, -1, 1]])
        dashpot = self.parameters.c_r * np.array([[0, 0, 0], [0, 1, -1], [0, -1, 1]])
        contact = np.array([[1, -1, 0], [-1, 1, 0], [0, 0, 0]])
        touching = float(np.sum(self.approach * np.cos(self.angles) > self.clearance))
        for k_b in self.contact_stiffness():
            k = spring + k_b * contact + np.diag([self.parameters.k_i, 0.0, 0.0])
            c_b = (
                self.parameters.beta_c * k_b / self.exponent + self.parameters.alpha_c * self.parameters.m_b * touching
            )
            c = dashpot + c_b * contact + np.diag([self.parameters.c_i, 0.0, 0.0])
            inverse = np.linalg.inv(mass)
            matrix = np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse @ k, -inverse @ c]])
            found.append(np.linalg.eigvals(matrix))
        return np.concatenate(found)

    def highest_resonance(self, approach: float | None = None) -> float:
        """Return the highest natural frequency of the undamped linearised rig, Hz, by default at rest (Eqs. 59, 60)."""
        root = np.sqrt(np.array([self.parameters.m_i, self.parameters.m_o, self.parameters.m_r]))
        highest = 0.0
        for k_b in self.contact_stiffness(approach):
            k = np.array(
                [
                    [k_b + self.parameters.k_i, -k_b, 0.0],
                    [-k_b, k_b + self.parameters.k_r, -self.parameters.k_r],
                    [0.0, -self.parameters.k_r, self.parameters.k_r],
                ]
            )
            highest = max(highest, float(np.linalg.eigvalsh(k / np.outer(root, root))[-1]))
        return math.sqrt(highest) / (2.0 * math.pi)

    def as_dict(self) -> dict[str, object]:
        """Return the fields as plain numbers, for JSON; ``more`` and ``waves`` where there are any."""
        return {name: value for name, value in asdict(self).items() if name not in ("more", "waves") or value}

    def key(self) -> str:
        """Return a digest of all fields, by which stored results are found again."""
        return hashlib.sha256(json.dumps(self.as_dict(), sort_keys=True).encode()).hexdigest()[:16]


def _root(function: Callable[[float], float], high: float) -> float:
    """Return the root of a rising function that is negative at zero, by bisection to the last digit."""
    low = 0.0
    for _ in range(200):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        low, high = (low, middle) if function(middle) > 0.0 else (middle, high)
    return 0.5 * (low + high)


def from_dict(fields: dict[str, Any]) -> OracleScene:
    """Return the scene of ``as_dict``."""
    values = dict(fields)
    values["geometry"] = Geometry(**values["geometry"])
    values["parameters"] = Parameters(**values["parameters"])
    values["rough"] = None if values["rough"] is None else Rough(**values["rough"])
    values["more"] = tuple(Pit(**pit) for pit in values.get("more", ()))
    values["waves"] = tuple(Wave(**wave) for wave in values.get("waves", ()))
    return OracleScene(**values)
