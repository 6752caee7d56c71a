"""Acoustic transfer vectors: sound pressure at microphones from the normal velocity of a radiating surface.

p(f) = atv(f)^T v_n(f) (Eqs. 100 and 101 of the thesis, appendix A), phasors exp(+i omega t), velocity along normals
that point into the air. They depend on surface, air and microphones only, so that loads are exchanged at no cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

NEIGHBOURS = 4
"""Frequencies between which a value is interpolated."""


class TransferVectorError(WrongInputError):
    """Transfer vectors that cannot be used, or a use beyond them; the message names what, and what was expected."""


@dataclass(frozen=True, eq=False)
class TransferVectors:
    """Transfer vectors of several microphones over frequency.

    Attributes:
        frequency: (frequencies,) Hz, ascending, positive.
        h: (frequencies, microphones, points) complex, Pa s/m.
        microphones: names.
        points: names of the points (elements or nodes) of the surface.
        microphone_position: (microphones, 3) m, or None where it is not known.
        point_position: (points, 3) m, or None.
        normal: (points, 3) unit vectors into the air, or None.
        sound_speed: m/s; with both positions it takes the time of flight out of the interpolation.
        over_plane: whether the plane z = 0 reflects, so that sound arrives twice.
    """

    frequency: NDArray[np.float64]
    h: NDArray[np.complex128]
    microphones: tuple[str, ...]
    points: tuple[str, ...]
    microphone_position: NDArray[np.float64] | None = None
    point_position: NDArray[np.float64] | None = None
    normal: NDArray[np.float64] | None = None
    sound_speed: float = 343.0
    over_plane: bool = False

    def __post_init__(self) -> None:
        """Raise a TransferVectorError that names the field which does not fit."""
        f, shape = np.asarray(self.frequency), np.shape(self.h)
        if f.ndim != 1 or not len(f) or not np.all(np.isfinite(f)) or f[0] <= 0.0 or np.any(np.diff(f) <= 0.0):
            raise TransferVectorError("frequency must be positive and ascending, at least one")
        wanted = (len(f), len(self.microphones), len(self.points))
        if shape != wanted or 0 in wanted:
            raise TransferVectorError(f"h must have the shape (frequencies, microphones, points) {wanted}, got {shape}")
        if not np.all(np.isfinite(self.h)):
            raise TransferVectorError("h must be finite")
        for name, rows in (("microphone_position", wanted[1]), ("point_position", wanted[2]), ("normal", wanted[2])):
            given = getattr(self, name)
            if given is not None and (np.shape(given) != (rows, 3) or not np.all(np.isfinite(given))):
                raise TransferVectorError(f"{name} must be finite, of shape {(rows, 3)}, got {np.shape(given)}")
        for name in ("microphones", "points"):
            if len(set(getattr(self, name))) != len(getattr(self, name)):
                raise TransferVectorError(f"{name} must have different names")
        if not (math.isfinite(self.sound_speed) and self.sound_speed > 0.0):
            raise TransferVectorError(f"sound_speed must be positive and finite, got {self.sound_speed!r}")

    def at(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Return the vectors at other frequencies, shape (frequencies, microphones, points).

        The cubic through the four nearest frequencies (fewer where there are fewer), in real and imaginary part, after
        the phase of the path, exp(-i k r), was taken out where positions are known: the direct one, or over a plane
        the mean of the direct and the reflected one. Else the phase that all points of a microphone have in common is
        followed from one frequency to the next. See ``interpolation_error_db``.

        Args:
            frequency: (frequencies,) Hz, within those of the vectors.

        Raises:
            TransferVectorError: for a frequency outside, which is not extrapolated.
        """
        wanted = np.atleast_1d(np.asarray(frequency, np.float64))
        low, high = float(self.frequency[0]), float(self.frequency[-1])
        outside = ~((wanted >= low) & (wanted <= high))
        if np.any(outside):
            worst = float(wanted[outside][0])
            raise TransferVectorError(f"{worst:.6g} Hz is outside the transfer vectors' {low:.6g} to {high:.6g} Hz")
        distance = self._distance()
        found = np.empty((len(wanted), *self.h.shape[1:]), np.complex128)
        for place, f in enumerate(wanted):
            nodes, weights = _lagrange(self.frequency, float(f))
            near = self.h[nodes]
            if distance is None:
                ahead = np.angle(np.sum(near[1:] * near[:-1].conj(), axis=2))
                phase = np.concatenate((np.zeros((1, near.shape[1])), np.cumsum(ahead, axis=0)))
                turn = (weights @ phase - phase)[:, :, None]
            else:
                turn = 2.0 * np.pi / self.sound_speed * (self.frequency[nodes, None, None] - f) * distance
            found[place] = np.einsum("i,ijk->jk", weights, near * np.exp(1j * turn))
        return found

    def pressure(self, frequency: ArrayLike, velocity: ArrayLike) -> NDArray[np.complex128]:
        """Return the pressures at the microphones, Pa, shape (frequencies, microphones).

        Args:
            frequency: (frequencies,) Hz, within those of the vectors.
            velocity: (frequencies, points) complex normal velocity, m/s; amplitudes give amplitudes.

        Raises:
            TransferVectorError: for a frequency outside, or velocities of another shape.
        """
        f, v = np.atleast_1d(np.asarray(frequency, np.float64)), np.asarray(velocity, np.complex128)
        if v.shape != (len(f), len(self.points)):
            wanted = f"(frequencies, points) {(len(f), len(self.points))}"
            raise TransferVectorError(f"velocity must have the shape {wanted}, got {v.shape}")
        found = np.empty((len(f), len(self.microphones)), np.complex128)
        for place in range(len(f)):
            found[place] = self.at(f[place])[0] @ v[place]
        return found

    def interpolation_error_db(self) -> NDArray[np.float64]:
        """Return what interpolation would miss at each inner frequency without it, dB, largest of the microphones.

        The error of the vector, root mean square over the points, as the change of a level: 20 lg (1 + error). It is
        that of twice the distance between the frequencies: at the true distance a very smooth curve misses a sixteenth,
        a sphere a fifth. Shape (frequencies - 2,); empty of two.
        """
        errors = np.empty(max(len(self.frequency) - 2, 0))
        for place in range(1, len(self.frequency) - 1):
            others = np.delete(np.arange(len(self.frequency)), place)
            found = replace(self, frequency=self.frequency[others], h=self.h[others]).at(self.frequency[place])[0]
            missed = np.linalg.norm(found - self.h[place], axis=1)
            size = np.linalg.norm(self.h[place], axis=1)
            errors[place - 1] = np.max(np.divide(missed, size, out=np.zeros_like(missed), where=size > 0.0))
        return 20.0 * np.log10(1.0 + errors)

    def _distance(self) -> NDArray[np.float64] | None:
        """Return the paths, m, shape (microphones, points), or None where positions are not known."""
        if self.microphone_position is None or self.point_position is None:
            return None
        between = self.microphone_position[:, None] - self.point_position[None]
        direct = np.linalg.norm(between, axis=2)
        if not self.over_plane:
            return direct
        between[..., 2] = self.microphone_position[:, None, 2] + self.point_position[None, :, 2]
        return 0.5 * (direct + np.linalg.norm(between, axis=2))


def _lagrange(grid: NDArray[np.float64], x: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the places of the nearest grid points, two on either side where there are, and their weights at x."""
    count = min(NEIGHBOURS, len(grid))
    above = int(np.searchsorted(grid, x))
    first = min(max(above - count // 2, 0), len(grid) - count)
    nodes = np.arange(first, first + count)
    near = grid[nodes]
    weights = np.ones(count)
    for i in range(count):
        others = np.delete(near, i)
        weights[i] = np.prod((x - others) / (near[i] - others))
    return nodes, weights
