"""How the elements of a bearing share a radial load, and how stiff the bearing is while they roll, healthy or damaged.

Two descriptions: the sum over the elements at their places (Eqs. 19-25 and 61), and the integral that smears them over
the ring (Eqs. 13, 26, 27, 30 and 31), as catalogues and the thesis do. SI units; angles from the load direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.machine.hertz import contact_exponent, contact_forces, element_angles, static_equilibrium
from models.path.defect import ball_path, wrap
from models.words.numerics import find_root, integrate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect


@dataclass(frozen=True, eq=False)
class LoadDistribution:
    """The loads of all elements at one cage angle, N, row after row, and their angles within -pi and pi, rad.

    The displacement is that of the inner against the outer ring, m, shape (2,): along the load, across it.
    """

    angles: NDArray[np.float64]
    loads: NDArray[np.float64]
    displacement: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StiffnessPassage:
    """The stiffness of a bearing while its cage turns by one spacing of the elements of a row.

    Attributes:
        cage_angle: cage angles, rad, shape (points,).
        matrix: stiffness at each, N/m, shape (points, 2, 2); [:, 0, 0] is k_yy of the thesis (along the load),
            [:, 1, 1] its k_xx (across), [:, 0, 1] its k_xy.
    """

    cage_angle: NDArray[np.float64]
    matrix: NDArray[np.float64]

    @property
    def mean(self) -> NDArray[np.float64]:
        """Mean over the passage, N/m, shape (2, 2)."""
        return np.mean(self.matrix, axis=0)

    @property
    def swing(self) -> NDArray[np.float64]:
        """Largest less smallest value of both diagonal terms, divided by their mean, shape (2,): along, across."""
        diagonal = np.diagonal(self.matrix, axis1=1, axis2=2)
        return np.ptp(diagonal, axis=0) / np.mean(diagonal, axis=0)

    @property
    def largest_coupling(self) -> float:
        """Largest absolute value of the cross term, N/m."""
        return float(np.abs(self.matrix[:, 0, 1]).max())


def load_integral(extent: float, exponent: float) -> float:
    """Return J_r, the share of the load that the smeared elements carry (Eqs. 13 and 31; Sjoevall's integral).

    J_r = 1/(2 pi) * integral over the loaded zone of (1 - (1 - cos psi) / (2 extent))**exponent cos psi.

    ``extent`` is the load factor (1 - h/delta_r) / 2: 0.5 without clearance, less with it.

    Raises:
        ValueError: if the extent is not within (0, 0.5].
    """
    if not 0.0 < extent <= 0.5:
        raise ValueError(f"load factor must lie above 0 and not above 0.5, got {extent!r}")
    edge = math.acos(max(-1.0, 1.0 - 2.0 * extent))

    def density(psi: float) -> float:
        return max(0.0, 1.0 - (1.0 - math.cos(psi)) / (2.0 * extent)) ** exponent * math.cos(psi)

    return integrate(density, 0.0, edge, rtol=1e-10) / math.pi


def ring_approach(bearing: Bearing, load: float, k_c: float, clearance: float = 0.0) -> float:
    """Return the radial displacement delta_r of the ring on smeared elements, m (Eq. 31, solved).

    Raises:
        ValueError: if the load is not positive, or the clearance negative.
    """
    if not (math.isfinite(load) and load > 0.0):
        raise ValueError(f"load must be finite and positive, got {load!r}")
    if not (math.isfinite(clearance) and clearance >= 0.0):
        raise ValueError(f"clearance must be finite and not negative, got {clearance!r}")
    n = contact_exponent(bearing)
    elements = bearing.n_elements * bearing.rows
    tight = (load / (elements * k_c * load_integral(0.5, n))) ** (1.0 / n)
    if clearance == 0.0:
        return tight

    def missing(squeeze: float) -> float:
        extent = 0.5 * squeeze / (squeeze + clearance)
        return elements * k_c * squeeze**n * load_integral(extent, n) / load - 1.0

    # With clearance fewer elements carry the load, so they are squeezed more.
    high = 2.0 * tight
    while missing(high) < 0.0:
        high *= 2.0
    return clearance + find_root(missing, tight, high, xtol=1e-18, rtol=1e-13)


def load_zone(approach: float, clearance: float = 0.0) -> float:
    """Return the extent of the loaded zone, rad (Eq. 26), zero where the rings do not touch the elements."""
    if approach <= clearance:
        return 0.0
    return 2.0 * math.acos(clearance / approach)


def largest_element_load(bearing: Bearing, load: float, k_c: float, clearance: float = 0.0) -> float:
    """Return Q_max of the smeared elements, N (Eq. 30; Eq. 13 without clearance)."""
    return k_c * (ring_approach(bearing, load, k_c, clearance) - clearance) ** contact_exponent(bearing)


def elements_in_zone(bearing: Bearing, zone: float) -> int:
    """Return how many elements of a row the loaded zone holds from the load direction to one side (Table 12).

    One element stands in the load direction and is counted, so that the whole zone holds twice the number less one.
    """
    return 1 + math.floor(0.5 * zone / (2.0 * math.pi / bearing.n_elements))


def load_distribution(
    bearing: Bearing, load: float, k_c: float, *, clearance: float = 0.0, cage_angle: float = 0.0
) -> LoadDistribution:
    """Return the load of every element at one cage angle (Eqs. 20, 23 and 24).

    Raises:
        ValueError: if load or clearance is negative or not finite.
    """
    angles, exponent = element_angles(bearing, cage_angle), contact_exponent(bearing)
    u = static_equilibrium(angles, load, k_c, clearance=clearance, exponent=exponent)
    delta = np.maximum(u[0] * np.cos(angles) + u[1] * np.sin(angles) - clearance, 0.0)
    return LoadDistribution(wrap(angles), k_c * delta**exponent, u)


def stiffness_over_passage(
    bearing: Bearing, load: float, k_c: float, *, clearance: float = 0.0, defect: Defect | None = None, points: int = 96
) -> StiffnessPassage:
    """Return the stiffness while one element of a row follows the other (Eq. 61; Figs. 36 and 37).

    An element over a defect sinks by d(phi), by which its contact loosens: the clearance there is h + d.

    The defect is one of the outer race; ``points`` cage angles lie evenly over one spacing of a row.

    Raises:
        ValueError: if load or clearance is negative, or the defect does not fit the bearing.
    """
    if defect is not None:
        _check_defect(bearing, defect)
    path, exponent = ball_path(bearing, defect), contact_exponent(bearing)
    cage_angle = 2.0 * math.pi / bearing.n_elements * np.arange(points) / points
    matrix = np.empty((points, 2, 2))
    for i, turn in enumerate(cage_angle):
        angles = element_angles(bearing, float(turn))
        gaps = np.full(len(angles), clearance)
        if path is not None and defect is not None:
            first = defect.first_row * bearing.n_elements
            damaged = slice(first, first + defect.rows * bearing.n_elements)
            gaps[damaged] += path(wrap(angles[damaged]))[0]
        u = static_equilibrium(angles, load, k_c, clearance=gaps, exponent=exponent)
        matrix[i] = contact_forces(u, angles, k_c, gaps, exponent)[1]
    return StiffnessPassage(cage_angle, matrix)


def _check_defect(bearing: Bearing, defect: Defect) -> None:
    if defect.part != "outer":
        raise ValueError(f"defect.part must be 'outer', which stands still, got {defect.part!r}")
    if not (defect.first_row >= 0 and 1 <= defect.rows <= bearing.rows - defect.first_row):
        raise ValueError(
            f"{bearing.designation} has {bearing.rows} rows, got defect.rows {defect.rows!r} "
            f"from defect.first_row {defect.first_row!r}"
        )


def stiffness_against_load(
    bearing: Bearing, loads: Sequence[float], k_c: float, *, clearance: float = 0.0, points: int = 64
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return displacement along the load, m, shape (loads,), and stiffness, N/m, shape (loads, 2, 2), of several loads.

    Both are means over a passage of the elements. For one cage angle k_yy is the slope dF/d delta of Eqs. 28 and 29
    where the elements stand symmetrically about the load.
    """
    spacing = 2.0 * math.pi / (bearing.n_elements * bearing.rows)
    exponent = contact_exponent(bearing)
    displacement, stiffness = np.zeros(len(loads)), np.zeros((len(loads), 2, 2))
    for i, load in enumerate(loads):
        for k in range(points):
            angles = element_angles(bearing, spacing * k / points)
            u = static_equilibrium(angles, load, k_c, clearance=clearance, exponent=exponent)
            displacement[i] += u[0] / points
            stiffness[i] += contact_forces(u, angles, k_c, clearance, exponent)[1] / points
    return displacement, stiffness
