"""Integrals of the Helmholtz Green function over flat panels of constant density, and its normal derivatives.

G = exp(-i k r) / (4 pi r). A panel is a triangle or a plane quadrangle. Far panels are integrated by points. Near ones,
the panel of the point itself among them, are split: the static part 1 / r and its derivatives are integrated exactly
by sums over the edges, the second normal derivative as Hadamard's finite part, and k^2 / (2 r) with them; what is left
is bounded and integrated by points. Over the edges: Wilton et al., IEEE Trans. Antennas Propag. 32 (1984) 276, for the
potential and its gradient; the solid angle's gradient is the field of a current around the panel (Biot and Savart).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

NEAR = 3.0
"""Distance of a point from a panel's middle, by the panel's longest edge, below which the static part is exact."""
# Dunavant, Int. J. Numer. Methods Eng. 21 (1985) 1129: degrees 2 and 6, barycentric coordinates (none at the middle).
_FAR_TRIANGLE = [((2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0), 1.0 / 3.0)]
_NEAR_TRIANGLE = [
    ((0.501426509658179, 0.249286745170910, 0.249286745170910), 0.116786275726379),
    ((0.873821971016996, 0.063089014491502, 0.063089014491502), 0.050844906370207),
    ((0.636502499121399, 0.310352451033785, 0.053145049844816), 0.082851075618374),
]


@dataclass(frozen=True, eq=False)
class Panels:
    """Flat panels with the points of two rules of integration.

    Attributes:
        corners: (panels, 4, 3) m, counterclockwise about the normal; a triangle repeats its last corner.
    """

    corners: NDArray[np.float64]

    @cached_property
    def normal(self) -> NDArray[np.float64]:
        """Unit normals, (panels, 3)."""
        return self._cross / np.linalg.norm(self._cross, axis=1)[:, None]

    @cached_property
    def area(self) -> NDArray[np.float64]:
        """Areas, m2."""
        return 0.5 * np.linalg.norm(self._cross, axis=1)

    @cached_property
    def _cross(self) -> NDArray[np.float64]:
        c = self.corners
        return np.cross(c[:, 2] - c[:, 0], c[:, 3] - c[:, 1])

    @cached_property
    def triangles(self) -> NDArray[np.bool_]:
        """Whether each panel is a triangle."""
        return np.asarray(np.all(self.corners[:, 2] == self.corners[:, 3], axis=1))

    @cached_property
    def longest(self) -> NDArray[np.float64]:
        """Longest edges, m."""
        return np.max(np.linalg.norm(np.roll(self.corners, -1, axis=1) - self.corners, axis=2), axis=1)

    @cached_property
    def middle(self) -> NDArray[np.float64]:
        """Centroids, (panels, 3) m."""
        c = self.corners
        halves = [np.linalg.norm(np.cross(c[:, i] - c[:, 0], c[:, i + 1] - c[:, 0]), axis=1) for i in (1, 2)]
        thirds = [(c[:, 0] + c[:, i] + c[:, i + 1]) / 3.0 for i in (1, 2)]
        return (halves[0][:, None] * thirds[0] + halves[1][:, None] * thirds[1]) / (halves[0] + halves[1])[:, None]

    def points(self, *, near: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return points (panels, points, 3) and weights (panels, points), m2, of the far or the near rule.

        A quadrangle's rule is that of both its triangles, padded with zeros for triangles where both kinds are there.
        """
        shape = _symmetric(_NEAR_TRIANGLE if near else _FAR_TRIANGLE)
        places, shares = np.array([place for place, _ in shape]), np.array([share for _, share in shape])
        found: list[NDArray[np.float64]] = []
        weights: list[NDArray[np.float64]] = []
        for i in (1, 2) if not np.all(self.triangles) else (1,):
            c = self.corners[:, (0, i, i + 1)]
            area = 0.5 * np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1)
            found.append(np.einsum("qc,pcx->pqx", places, c))
            weights.append(area[:, None] * shares)
        return np.concatenate(found, axis=1), np.concatenate(weights, axis=1)

    def mirrored(self) -> Panels:
        """Return the images in the plane z = 0, normals mirrored with them."""
        flipped = self.corners * (1.0, 1.0, -1.0)
        # Reversed, with the repeated corner of a triangle last.
        order = np.where(self.triangles[:, None], (1, 0, 2, 2), (3, 2, 1, 0))
        return Panels(np.take_along_axis(flipped, order[:, :, None], axis=1))


def _symmetric(
    rule: list[tuple[tuple[float, float, float], float]],
) -> list[tuple[tuple[float, float, float], float]]:
    """Return all permutations of the coordinates of a rule's points."""
    found: dict[tuple[float, float, float], float] = {}
    for (a, b, c), weight in rule:
        for place in ((a, b, c), (b, c, a), (c, a, b), (a, c, b), (c, b, a), (b, a, c)):
            found[place] = weight
    return list(found.items())


@dataclass(frozen=True, eq=False)
class StaticIntegrals:
    """Integrals over panels of 1 / r and its normal derivatives at a point each, without 1 / (4 pi), shape (pairs,).

    Attributes:
        single: of 1 / r, m.
        double: of d/dn_y 1 / r, the solid angle.
        adjoint: of d/dn_x 1 / r.
        second: of d2/dn_x dn_y 1 / r, 1/m, finite part.
    """

    single: NDArray[np.float64]
    double: NDArray[np.float64]
    adjoint: NDArray[np.float64]
    second: NDArray[np.float64]


def static_integrals(
    x: NDArray[np.float64], normal_x: NDArray[np.float64], corners: NDArray[np.float64], normal: NDArray[np.float64]
) -> StaticIntegrals:
    """Return the exact static integrals of pairs of a point and a panel.

    Args:
        x, normal_x: points and directions there, (pairs, 3).
        corners, normal: of the panels, (pairs, 4, 3) and (pairs, 3).
    """
    height = np.einsum("px,px->p", x - corners[:, 0], normal)
    size = np.max(np.abs(corners[:, 2] - corners[:, 0]), axis=1)
    height = np.where(np.abs(height) < 1e-12 * size, 0.0, height)
    facing = np.einsum("px,px->p", normal_x, normal)
    flat, angle = np.zeros(len(x)), np.zeros(len(x))
    slope, second = np.zeros(len(x)), np.zeros(len(x))
    for i in range(4):
        begin, end = corners[:, i], corners[:, (i + 1) % 4]
        length = np.linalg.norm(end - begin, axis=1)
        there = length > 0.0
        along = (end - begin) / np.where(there, length, 1.0)[:, None]
        out = np.cross(along, normal)
        t = np.einsum("px,px->p", begin - x, out)
        low = np.einsum("px,px->p", begin - x, along)
        high = low + length
        near2 = t**2 + height**2
        r_low, r_high = np.sqrt(near2 + low**2), np.sqrt(near2 + high**2)
        log = _edge_log(low, high, r_low, r_high, there)
        bend = _edge_angle(t, low, high, near2, np.abs(height), r_low, r_high)
        current = _edge_current(low, high, r_low, r_high, near2, there)
        outwards = np.einsum("px,px->p", normal_x, out)
        flat += np.where(there, t * log, 0.0)
        angle += np.where(there, bend, 0.0)
        slope -= np.where(there, outwards * log, 0.0)
        second -= np.where(there, (t * facing + height * outwards) * current, 0.0)
    side = np.sign(height)
    return StaticIntegrals(flat - np.abs(height) * angle, side * angle, slope - facing * side * angle, second)


def _edge_log(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    r_low: NDArray[np.float64],
    r_high: NDArray[np.float64],
    there: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return ln (r+ + l+) / (r- + l-) in the form without cancellation."""
    behind = low + high < 0.0
    above = np.where(behind, r_low - low, r_high + high)
    below = np.where(behind, r_high - high, r_low + low)
    return np.log(np.where(there, above, 1.0) / np.where(there, below, 1.0))


def _edge_angle(
    t: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    near2: NDArray[np.float64],
    height: NDArray[np.float64],
    r_low: NDArray[np.float64],
    r_high: NDArray[np.float64],
) -> NDArray[np.float64]:
    return np.arctan2(t * high, near2 + height * r_high) - np.arctan2(t * low, near2 + height * r_low)


def _edge_current(
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    r_low: NDArray[np.float64],
    r_high: NDArray[np.float64],
    near2: NDArray[np.float64],
    there: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return (l+ / r+ - l- / r-) / r0^2, in the form without cancellation where the foot lies beside the edge."""
    beside = low * high > 0.0
    product = r_low * r_high * (high * r_low + low * r_high)
    difference = high / np.where(there, r_high, 1.0) - low / np.where(there, r_low, 1.0)
    direct = difference / np.where(beside | (near2 == 0.0), 1.0, near2)
    return np.where(beside, (high**2 - low**2) / np.where(beside, product, 1.0), direct)
