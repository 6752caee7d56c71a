"""A vibrating sphere over a rigid plane by a series of multipoles at its centre and at its image.

Each term, h_n^(2)(k r) P_n^m(cos theta) cos(m phi) about the centre plus its mirror image, radiates, solves Helmholtz'
equation and leaves the plane z = 0 at rest; the coefficients are those that give the sphere its normal velocity at
Gauss points over the polar angle, by least squares. Phasors exp(+i omega t). No boundary element is in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import lpmv, spherical_jn, spherical_yn

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray


@dataclass(frozen=True)
class SphereOverPlane:
    """Sphere of a radius with its centre at (0, 0, height), m, in air of a density, kg/m3, and speed of sound, m/s.

    ``height`` is None in free space. ``terms`` is the number of multipoles.
    """

    radius: float
    height: float | None
    k: float
    density: float = 1.2
    sound_speed: float = 343.0
    terms: int = 40

    def coefficients(self, order: int, velocity: Callable[[NDArray], NDArray]) -> tuple[NDArray, float]:
        """Return the multipoles of a normal velocity v(cos theta) cos(order phi), and what the velocity misses.

        The second is the largest error of the velocity between the points at which it was prescribed, by its largest
        value.
        """
        cosine, weight = np.polynomial.legendre.leggauss(3 * self.terms)
        slopes, scale = self._slopes(order, cosine)
        load = -1j * self.k * self.sound_speed * self.density
        root = np.sqrt(weight)
        found = np.linalg.lstsq(root[:, None] * slopes, root * load * velocity(cosine), rcond=1e-14)[0] / scale
        between = 0.5 * (cosine[1:] + cosine[:-1])
        slopes, scale = self._slopes(order, between)
        missed = np.abs(slopes @ (found * scale) / load - velocity(between))
        return found, float(missed.max() / np.abs(velocity(between)).max())

    def pressure(self, order: int, coefficients: NDArray, x: NDArray) -> NDArray:
        """Return the pressure at points (points, 3), Pa."""
        sides = [x] if self.height is None else [x, x * (1.0, 1.0, -1.0)]
        total = np.zeros(len(x), complex)
        for side in sides:
            away = side - (0.0, 0.0, self.height or 0.0)
            r = np.linalg.norm(away, axis=1)
            turned = np.cos(order * np.arctan2(away[:, 1], away[:, 0]))
            values, _, _ = self._terms(order, r, away[:, 2] / r)
            total += turned * (values @ coefficients)
        return total

    def _slopes(self, order: int, cosine: NDArray) -> tuple[NDArray, NDArray]:
        """Return radial slopes on the sphere, columns scaled to one, and the scales."""
        a, sine = self.radius, np.sqrt(1.0 - cosine**2)
        _, slope, _ = self._terms(order, np.full(len(cosine), a), cosine)
        total = slope
        if self.height is not None:
            # The image: the mirrored point, along the mirrored normal, both about the true centre.
            across, up = a * sine, -(2.0 * self.height + a * cosine)
            r = np.hypot(across, up)
            _, radial, polar = self._terms(order, r, up / r)
            along = (sine * across - cosine * up) / r
            turning = (sine * up + cosine * across) / r
            total = slope + along[:, None] * radial + turning[:, None] * polar
        scale = np.abs(slope).max(axis=0)
        return total / scale, scale

    def _terms(self, order: int, r: NDArray, cosine: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return the multipoles and their components of the gradient along r and theta, (points, terms) each."""
        n = np.arange(order, order + self.terms)
        z = self.k * r[:, None]
        hankel = spherical_jn(n, z) - 1j * spherical_yn(n, z)
        slope = spherical_jn(n, z, derivative=True) - 1j * spherical_yn(n, z, derivative=True)
        x = cosine[:, None]
        legendre = lpmv(order, n, x)
        sine = np.maximum(np.sqrt(np.maximum(1.0 - x**2, 0.0)), 1e-300)
        polar = np.where(sine > 1e-12, (n * x * legendre - (n + order) * lpmv(order, n - 1, x)) / sine, 0.0)
        return hankel * legendre, self.k * slope * legendre, hankel * polar / r[:, None]


MOTIONS = {
    "pulsating": (0, lambda cosine: np.ones_like(cosine)),
    "up and down": (0, lambda cosine: cosine),
    "sideways": (1, lambda cosine: np.sqrt(1.0 - cosine**2)),
}
"""Order and normal velocity over the cosine of the polar angle; ``sideways`` is along x."""


def exact_pressure(sphere: SphereOverPlane, motion: str, x: NDArray) -> tuple[NDArray, float]:
    """Return the pressure at points of a motion of 1 m/s, Pa, and what the sphere's velocity misses."""
    order, velocity = MOTIONS[motion]
    coefficients, missed = sphere.coefficients(order, velocity)
    # lpmv has the sign (-1)^m of Condon and Shortley in both the fit and the field.
    return sphere.pressure(order, coefficients, x), missed
