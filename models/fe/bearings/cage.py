"""What a cage does to the stiffness of a bearing: where it holds the elements, and how its bars resist their bulging.

A cage spaces the elements. Where pockets have play the spacing is not even: ``spaced_state`` takes any angles.

A cage whose bars touch the rollers without play also resists their bulge: under the force Q of the races a roller
becomes wider by beta Q across; by reciprocity a force P of the bars on both sides takes beta P from the approach of the
races. Without friction a roller moves along the races until both bars press alike, so that each pocket has one force:

    squeeze(P_j) + sum over k of C_jk P_k = beta Q_j - play   where P_j > 0, not below it where P_j = 0,
    approach of the races at j = lambda(Q_j) - beta P_j,

with the pockets' opening C of the meshed cage. SI units; angles from the load, axes as in ``models.machine.hertz``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.fe.bearings.balance import Balance, Law, pressed_together, settle
from models.fe.bearings.law import ElementLaw
from models.words.checks import check_numbers, check_positive, check_whole

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Change of a bar's force, as a share of the largest, at which bars and races agree.
_SAME_FORCE = 1e-10
_ROUNDS = 60


def even_angles(n_elements: int, cage_angle: float = 0.0) -> NDArray[np.float64]:
    """Return the angles of evenly spaced elements from the load, rad, shape (n_elements,)."""
    return np.asarray(cage_angle + 2.0 * math.pi / n_elements * np.arange(n_elements), dtype=np.float64)


def drawn_angles(
    n_elements: int, play: float, pitch_radius: float, rng: np.random.Generator, cage_angle: float = 0.0
) -> NDArray[np.float64]:
    """Return angles of elements that lie anywhere in pockets with play, rad, shape (n_elements,).

    Args:
        play: by which a pocket is wider than its element, m; an element lies within half of it from the middle.
        rng: each place is equally likely and independent.
    """
    check_positive(pitch_radius=pitch_radius)
    if not (math.isfinite(play) and play >= 0.0):
        raise ValueError(f"play must be finite and not negative, got {play!r} m")
    offset = rng.uniform(-0.5, 0.5, n_elements) * play / pitch_radius
    return even_angles(n_elements, cage_angle) + offset


def spaced_state(
    law: Law,
    angles: NDArray[np.float64],
    load: float,
    *,
    influence: NDArray[np.float64] | None = None,
    clearance: float | NDArray[np.float64] = 0.0,
) -> Balance:
    """Return the equilibrium of radial elements at any angles under a load along angle zero.

    Args:
        influence: of the elements on each other through the rings at these angles, m/N, shape (elements, elements),
            such as ``RingInfluence.matrix(angles)``; None where the rings yield at the contacts alone.

    Raises:
        ValueError: if the load is not positive, or shapes do not fit.
        RuntimeError: if no equilibrium is found.
    """
    check_positive(load=load)
    return settle(_normals(angles), law, np.array([load, 0.0]), influence=influence, clearance=clearance)


def spacing_bound(
    law: Law, angles: NDArray[np.float64], load: float, offset: float, *, clearance: float = 0.0
) -> NDArray[np.float64]:
    """Return by how much the stiffness changes at most, to first order, if each element moves by an angle of its own.

    The sum over the elements of the magnitude of the derivative by each angle, times ``offset``, rad; shape (2,): along
    the load, across it, as shares of the stiffness there.
    """
    base = np.diagonal(spaced_state(law, angles, load, clearance=clearance).stiffness)
    step, total = 1e-4, np.zeros(2)
    for j in range(len(angles)):
        ends: list[NDArray[np.float64]] = []
        for side in (1.0, -1.0):
            moved = angles.copy()
            moved[j] += side * step
            ends.append(np.diagonal(spaced_state(law, moved, load, clearance=clearance).stiffness))
        total += np.abs(ends[0] - ends[1]) / (2.0 * step)
    return total * offset / base


def squeeze_law(
    radius: float,
    length: float,
    modulus: float,
    poisson: float,
    strip: float | None,
    *,
    highest: float,
    lowest: float | None = None,
) -> ElementLaw:
    """Return the force of two opposite bars over the squeeze of a roller between them, beyond that of the cage's mesh.

    Squeeze is how much closer the bars come than touching: both halves of the roller,
    2 P' / (pi E') (2 ln(4 R / b) - 1) (Johnson, Contact Mechanics, section 5.6), and what the bars yield at the line of
    contact beyond the mean of the strip over which the cage's mesh was loaded, 4 P' / (pi E') (ln(4 s / b) - 1), by the
    logarithm of the half plane; P' = P / length, E' = E / (1 - nu^2), b of Eq. 4.

    Args:
        radius, length: of the roller, m; the bars are flat and as long.
        strip: half width s of the strip on the cage's mesh, m, more than the half width of the contact; None for bars
            that do not yield at all: b is then smaller by the root of two, and their part is left out.
        highest, lowest: forces between which the law is tabulated, N; a thousandth part by default.

    Raises:
        ValueError: if an argument is out of range, or the contact is as wide as the strip.
    """
    check_positive(radius=radius, length=length, modulus=modulus, highest=highest)
    effective = modulus / (1.0 - poisson**2)
    loads = np.geomspace(highest * 1e-3 if lowest is None else lowest, highest, 13)
    widths = np.sqrt((4.0 if strip is None else 8.0) * radius * loads / (math.pi * length * effective))
    share = 2.0 * loads / (math.pi * effective * length)
    approach = share * (2.0 * np.log(4.0 * radius / widths) - 1.0)
    if strip is not None:
        if not widths[-1] < strip:
            raise ValueError(f"strip {strip!r} m must exceed the half width of the contact, {float(widths[-1])!r} m")
        approach = approach + 2.0 * share * (np.log(4.0 * strip / widths) - 1.0)
    return ElementLaw(loads, approach, 0.0)


def plane_bulge(length: float, modulus: float, poisson: float) -> float:
    """Return beta of a long roller, m/N: how much wider a cylinder becomes under opposite line loads, per newton.

    From the stresses of a disc under two forces on a diameter (Timoshenko and Goodier, section 41), with which the
    Brazilian test measures moduli: (4 / pi - 1 + nu) / (E length) in plane stress, here in plane strain.
    """
    check_positive(length=length, modulus=modulus)
    plane, ratio = modulus / (1.0 - poisson**2), poisson / (1.0 - poisson)
    return (4.0 / math.pi - 1.0 + ratio) / (plane * length)


@dataclass(frozen=True, eq=False)
class CageCoupling:
    """Elastic cage around the rollers of a bearing.

    Attributes:
        bulge: beta, by which a roller becomes wider per newton of the races' force, m/N.
        squeeze: force of both bars over the squeeze of a roller, without the cage's own opening.
        opening: how much each pocket (row) opens per newton of the pair of forces in each (column), m/N, symmetric,
            shape (pockets, pockets).
        play: by which a pocket is wider than its roller, m, not negative.
    """

    bulge: float
    squeeze: Law
    opening: NDArray[np.float64]
    play: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names an unusable value."""
        check_numbers(self, "", "positive", "bulge")
        check_numbers(self, "", "not negative", "play")
        check_whole(len(self.opening), "pockets of opening", 3)
        if not np.allclose(self.opening, self.opening.T, atol=1e-6 * float(np.abs(self.opening).max())):
            raise ValueError("opening must be symmetric")

    def bar_forces(self, forces: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the bars' forces, N, under the races' forces, N, and their derivatives by these, (pockets,) * 2."""
        wanted = self.bulge * forces - self.play
        touching = pressed_together(self.squeeze, self.opening, wanted, wanted)
        bars, tangent = self.squeeze.force(touching)
        slope = np.linalg.solve(np.eye(len(bars)) + tangent[:, None] * self.opening, np.diag(tangent))
        return bars, np.asarray(self.bulge * slope, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class CagedState:
    """Equilibrium of a bearing with an elastic cage.

    Attributes:
        balance: of the ring; the stiffness takes the cage into account.
        bars: force of both bars on each roller, N, shape (elements,).
        rounds: solutions of races and bars in turn.
        change: largest change of a bar's force in the last round, as a share of the largest.
    """

    balance: Balance
    bars: NDArray[np.float64]
    rounds: int
    change: float


def caged_state(
    law: Law,
    coupling: CageCoupling,
    angles: NDArray[np.float64],
    load: float,
    *,
    influence: NDArray[np.float64] | None = None,
    clearance: float = 0.0,
) -> CagedState:
    """Return the equilibrium with an elastic cage; arguments as of :func:`spaced_state`.

    Raises:
        ValueError: if the number of pockets is not that of the elements, or as ``spaced_state``.
        RuntimeError: if bars and races do not settle.
    """
    count = len(angles)
    if len(coupling.opening) != count:
        raise ValueError(f"expected {count} pockets, one for each element, got {len(coupling.opening)}")
    bars, change = np.zeros(count), 0.0
    for turn in range(1, _ROUNDS + 1):
        state = spaced_state(law, angles, load, influence=influence, clearance=clearance - coupling.bulge * bars)
        before = bars
        bars, slope = coupling.bar_forces(state.forces)
        change = float(np.abs(bars - before).max()) / max(float(bars.max()), 1e-300)
        if change <= _SAME_FORCE or not bars.any():
            mutual = np.zeros((count, count)) if influence is None else influence
            stiffness = _stiffness(_normals(angles), law.force(state.approach)[1], mutual - coupling.bulge * slope)
            whole = replace(state, stiffness=stiffness)
            return CagedState(whole, bars, turn, change)
    raise RuntimeError(f"bars and races do not settle: the bars' forces still change by {change:.3g} of the largest")


def _normals(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _stiffness(
    normals: NDArray[np.float64], tangent: NDArray[np.float64], mutual: NDArray[np.float64]
) -> NDArray[np.float64]:
    coupled = np.linalg.solve(np.eye(len(tangent)) + tangent[:, None] * mutual, tangent[:, None] * normals)
    matrix = normals.T @ coupled
    return 0.5 * (matrix + matrix.T)
