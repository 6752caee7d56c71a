"""Radial spring of a bearing: force over the displacement of its rings, a mean over the places of the elements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from models.machine.hertz import contact_exponent, contact_forces, element_angles
from models.words.numerics import find_root

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from models.machine.bearing import Bearing

_CAGE_ANGLES = 16
_TABLE_POINTS = 25


@dataclass(frozen=True)
class RadialSpring:
    """A force over a displacement beyond a play, and its mirror for the other direction.

    Between the points ln(force) is a monotone cubic of ln(displacement - play), which has a power law exactly; beyond
    them the law of the first or last point goes on.

    Attributes:
        displacement: m, ascending, each beyond the play.
        force: N, positive, ascending.
        play: displacement, m, up to which there is no force.
    """

    displacement: tuple[float, ...]
    force_values: tuple[float, ...]
    play: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of unusable values."""
        for name, values, least in (
            ("displacement", self.displacement, self.play),
            ("force_values", self.force_values, 0.0),
        ):
            array = np.asarray(values, dtype=float)
            if len(array) < 2 or not (np.isfinite(array).all() and array[0] > least and np.all(np.diff(array) > 0.0)):
                raise ValueError(f"spring.{name} needs two ascending numbers or more above {least!r}, got {values!r}")
        if len(self.displacement) != len(self.force_values):
            raise ValueError(
                f"spring.force_values needs one for each of {len(self.displacement)} displacements, "
                f"got {len(self.force_values)}"
            )
        if not (np.isfinite(self.play) and self.play >= 0.0):
            raise ValueError(f"spring.play must be finite and not negative, got {self.play!r}")

    def force(self, displacement: float) -> tuple[float, float]:
        """Return force, N, and stiffness, N/m, at a displacement of either sign."""
        beyond = abs(displacement) - self.play
        if beyond <= 0.0:
            return 0.0, 0.0
        x = float(np.log(beyond))
        low, high, curve, slopes = self._curve
        inside = min(max(x, low), high)
        exponent = float(slopes(inside))
        force = float(np.exp(float(curve(inside)) + exponent * (x - inside)))
        return float(np.copysign(force, displacement)), exponent * force / beyond

    def displacement_at(self, force: float) -> float:
        """Return the displacement, m, under a positive force, N."""
        low, high = self.displacement[0] - self.play, self.displacement[-1] - self.play
        while self.force(self.play + low)[0] > force:
            low *= 0.5
        while self.force(self.play + high)[0] < force:
            high *= 2.0
        return find_root(lambda x: self.force(x)[0] / force - 1.0, self.play + low, self.play + high, rtol=1e-13)

    @cached_property
    def _curve(self) -> tuple[float, float, Any, Any]:
        """First and last ln(displacement - play), the curve of ln(force) and its slope."""
        from scipy.interpolate import PchipInterpolator  # type: ignore[import-untyped]

        x = np.log(np.asarray(self.displacement) - self.play)
        curve: Any = PchipInterpolator(x, np.log(np.asarray(self.force_values)))
        return float(x[0]), float(x[-1]), curve, curve.derivative()


def bearing_spring(bearing: Bearing, k_c: float, clearance: float = 0.0) -> RadialSpring:
    """Return the spring of a bearing whose elements have the contact stiffness k_c (Eqs. 19-25), N/m^n.

    The displacement is along the load; the force is the mean over a passage of the elements.

    Args:
        clearance: radial, m.
    """
    exponent = contact_exponent(bearing)
    period = 2.0 * np.pi / (bearing.n_elements * bearing.rows)
    angles = [element_angles(bearing, period * i / _CAGE_ANGLES) for i in range(_CAGE_ANGLES)]

    def force(displacement: float) -> float:
        u = np.array([displacement, 0.0])
        return float(np.mean([contact_forces(u, places, k_c, clearance, exponent)[0][0] for places in angles]))

    # Without play force and displacement have one exponent throughout.
    points = 2 if clearance == 0.0 else _TABLE_POINTS
    beyond: NDArray[np.float64] = np.geomspace(1e-8, 1e-3, points)
    return RadialSpring(
        tuple((clearance + beyond).tolist()), tuple(force(clearance + float(x)) for x in beyond), clearance
    )


def table_spring(loads: Sequence[float], displacement: Sequence[float], play: float = 0.0) -> RadialSpring:
    """Return the spring of computed displacements, m, under loads, N, both ascending; it goes through each of them."""
    return RadialSpring(tuple(displacement), tuple(loads), play)
