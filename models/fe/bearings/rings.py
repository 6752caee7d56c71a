"""What a ring that yields passes on: the force of one element moves the race under the others, and the bore.

A ring is the same at all angles, so that one half of it, loaded at angle zero, tells all: how far the race moves along
the normal there, per newton, under an element at an angle from the load.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from models.words.errors import WrongInputError
from models.words.numerics import smooth_curve

if TYPE_CHECKING:
    from numpy.typing import NDArray

# The bore (and the outside of the outer ring) fixed to a rigid body; the bore under a sinusoidal pressure.
Support = Literal["rigid-shaft", "sinusoidal"]
SUPPORTS: tuple[Support, ...] = get_args(Support)


@dataclass(frozen=True, eq=False)
class RingInfluence:
    """Displacement of a race under the force of one element, along that force, per newton.

    Attributes:
        angle: from the element, rad, ascending, shape (n,); the last is pi, the first not above the closest spacing.
        race: how far the race at each angle moves away from an element there, m/N, shape (n,).
        own: what the race under the element itself moves beyond what the element law has already, m/N: zero where the
            law was computed with the ring on this support.
        support: what holds the ring.
    """

    angle: NDArray[np.float64]
    race: NDArray[np.float64]
    own: float = 0.0
    support: Support = "rigid-shaft"

    def __post_init__(self) -> None:
        """Refuse angles that do not ascend to pi."""
        _check_even(self.angle, self.race)

    def matrix(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the displacement at each element (row) under a newton on each (column), m/N, shape (Z, Z).

        Raises:
            WrongInputError: two elements are closer than the smallest angle.
        """
        apart = np.abs((angles[:, None] - angles[None, :] + np.pi) % (2.0 * np.pi) - np.pi)
        np.fill_diagonal(apart, np.pi)
        if float(apart.min()) < float(self.angle[0]) * (1.0 - 1e-9):
            raise WrongInputError(
                f"expected elements {float(self.angle[0]):.4g} rad apart at least, got {float(apart.min()):.4g} rad"
            )
        matrix = np.asarray(self._curve(apart))
        np.fill_diagonal(matrix, self.own)
        return matrix

    @cached_property
    def _curve(self) -> Any:
        return even_spline(self.angle, self.race)


@dataclass(frozen=True, eq=False)
class BoreLoad:
    """Ring whose bore carries the load as a given pressure, in equilibrium with the elements; no rigid body holds it.

    Displacements are those beyond the rigid motion, which is the first harmonic of the bore's displacement. All are
    per newton; angles are from the direction of the load.

    Attributes:
        angle: rad, from 0 to pi, ascending, shape (n,).
        race: how far the race moves inwards, away from an element there, under the load, m/N, shape (n,).
        bore_at_load: how far the bore's line on the plane of the load moves along the load, m/N.
        bore_under_element: how far that line moves along the load under the force of an element at an angle, m/N,
            shape (n,).
    """

    angle: NDArray[np.float64]
    race: NDArray[np.float64]
    bore_at_load: float
    bore_under_element: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Refuse angles that do not ascend to pi."""
        _check_even(self.angle, self.race)
        _check_even(self.angle, self.bore_under_element)

    def on_elements(self, angles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the race's displacement at elements, and its derivative over the angle, m/N and m/N/rad, each (Z,)."""
        wrapped = (angles + np.pi) % (2.0 * np.pi) - np.pi
        curve = self._race
        return np.asarray(curve(np.abs(wrapped))), np.sign(wrapped) * np.asarray(curve(np.abs(wrapped), 1))

    def bore_line(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ``bore_under_element`` at the angles of elements, m/N, shape (Z,)."""
        return np.asarray(self._bore(np.abs((angles + np.pi) % (2.0 * np.pi) - np.pi)))

    @cached_property
    def _race(self) -> Any:
        return even_spline(self.angle, self.race)

    @cached_property
    def _bore(self) -> Any:
        return even_spline(self.angle, self.bore_under_element)


def even_spline(angle: NDArray[np.float64], values: NDArray[np.float64]) -> Any:
    """Return the cubic spline of values that are even about pi, and about zero where the first angle is zero."""
    return smooth_curve(angle, values, flat_start=float(angle[0]) == 0.0, flat_end=True)


def _check_even(angle: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    if angle.ndim != 1 or angle.shape != values.shape or len(angle) < 4:
        raise WrongInputError(f"expected four or more angles and as many values, got {angle.shape} and {values.shape}")
    rising = bool(np.all(np.diff(angle) > 0.0)) and angle[0] >= 0.0 and abs(float(angle[-1]) - np.pi) < 1e-9
    if not (rising and np.all(np.isfinite(values))):
        raise WrongInputError(f"expected ascending angles up to pi and finite values, got angles {angle.tolist()!r}")
