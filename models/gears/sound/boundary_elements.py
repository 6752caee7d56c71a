"""Transfer vectors of a radiating surface by boundary elements, in free space or over a rigid plane.

Direct collocation at the centroids of flat elements of constant pressure p and normal velocity v, phasors
exp(+i omega t):

    p / 2 - K p - c N p = i omega rho (V + c (1 / 2 + K')) v   on the surface (Burton and Miller 1971),
    - K p               = i omega rho V v                      at points inside (Schenck's CHIEF, 1968),

solved together by least squares. The first alone has one solution at every frequency, with c = -i / k as usual, but N
of constant elements errs by a share of the elements' size, 0.4 dB where 0.04 is the rest. With c only ``COUPLING`` of
that size the error is of its square away from the resonances of the enclosed space, and there the points inside decide,
a side of the elements or more away from them; the first still holds where all of them lie on nodes. A rigid plane z = 0
is met by images. The adjoint is solved, one right-hand side a microphone.
"""

from __future__ import annotations

import importlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from models.gears.sound.influence import Influence, influence
from models.gears.sound.panels import static_integrals
from models.gears.sound.surface import Surface, SurfaceError
from models.gears.sound.transfer_vectors import TransferVectors
from models.words.checks import check_positive

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

GAPS = (1.0, 0.5, 0.25)
"""Distances from the surface's elements, by the root of their mean area, tried one after the other."""
_CANDIDATES, _ROUNDS = 64, 12
_PAIRS = 200_000


def enclosed(surface: Surface, x: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each point (points, 3) lies inside, by the solid angle of the surface and its image."""
    panels = surface.panels
    sides = (panels, panels.mirrored()) if surface.over_plane else (panels,)
    angle = np.zeros(len(x))
    step = max(_PAIRS // len(surface), 1)
    for side in sides:
        for first in range(0, len(x), step):
            part = x[first : first + step]
            points, places = (found.ravel() for found in np.indices((len(part), len(surface))))
            static = static_integrals(part[points], part[points], side.corners[places], side.normal[places])
            angle[first : first + step] += static.double.reshape(len(part), -1).sum(axis=1)
    return angle < -2.0 * np.pi


def interior_points(surface: Surface, count: int, seed: int = 0) -> NDArray[np.float64]:
    """Return points inside, (at most count, 3) m, at random, away from the elements; none in a body too thin for it."""
    rng = np.random.default_rng(seed)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    size = float(np.sqrt(surface.area.mean()))
    found = np.empty((0, 3))
    for gap in GAPS:
        found = found[:0]
        for _ in range(_ROUNDS):
            x = rng.uniform(low, high, (max(_CANDIDATES, count), 3))
            x = x[_away(surface, x, gap * size)]
            found = np.concatenate((found, x[enclosed(surface, x)]))[:count]
            if len(found) == count:
                return found
        if 2 * len(found) >= count:
            return found
    return found


def _away(surface: Surface, x: NDArray[np.float64], gap: float) -> NDArray[np.bool_]:
    """Return whether points keep a distance from the middles of all elements and the planes of those beside them."""
    between = x[:, None] - surface.middle
    distance2 = np.sum(between**2, axis=2)
    beside = distance2 < surface.panels.longest**2
    height = np.abs(np.einsum("pex,ex->pe", between, surface.normal))
    return np.all((distance2 > gap**2) & ~(beside & (height < gap)), axis=1)


def gram(matrix: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the Cholesky factor, of the conjugate, of A* A for A of shape (rows, columns), rows >= columns.

    Raises:
        numpy.linalg.LinAlgError: if the columns are not independent.
    """
    linalg: Any = importlib.import_module("scipy.linalg")
    # The transpose of a matrix by rows is one by columns, which needs no copy; it gives the conjugate.
    square = linalg.blas.zherk(1.0, np.ascontiguousarray(matrix).T, lower=1)
    factor, info = linalg.lapack.zpotrf(square, lower=1, overwrite_a=1)
    if info != 0:
        raise np.linalg.LinAlgError(f"the columns are not independent: pivot {info} is not positive")
    return factor


def solve_gram(factor: NDArray[np.complex128], right: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return (A* A)^-1 right from ``gram``; right has the shape (columns, cases)."""
    linalg: Any = importlib.import_module("scipy.linalg")
    return np.conj(linalg.cho_solve((factor, True), np.conj(right), check_finite=False))


AIR_DENSITY, SOUND_SPEED = 1.2, 343.0
"""kg/m3 and m/s, those of the thesis' appendix."""
MIN_PER_WAVELENGTH = 6.0
"""Least wavelength by the longest edge of any element; fewer are refused."""
COUPLING = 0.1
"""The constant c by the root of the elements' mean area, at most 1 / k."""
MAX_RESIDUAL = 0.005
"""Pressure left inside by that on the surface, above which a frequency is "inaccurate"; at the microphones 0.3 dB."""
MIN_GAP = 0.5
"""Least height over the plane, by the longest edge, of an element that faces it; below, all is "inaccurate"."""
_POINTS, _CHECKS = 30, 10
_ELEMENTS_A_POINT = 50
SECONDS = (2.7e-7, 1.0e-10)
"""Processor time of a frequency with n elements, s: a n^2 (assembly, twice over a plane) + b n^3."""
BYTES = 64.0
"""Memory at the peak by n^2: both matrices, the normal equations and what assembly holds."""


@dataclass(frozen=True)
class RadiationCost:
    """Estimate for the transfer vectors of a surface: memory at the peak, bytes, and processor time, s."""

    elements: int
    frequencies: int
    memory: float
    seconds: float

    def __str__(self) -> str:
        """Return both in words."""
        amounts = f"about {self.memory / 1e9:.2g} GB and {self.seconds:.2g} s of processor time"
        return f"{self.elements:,} elements at {self.frequencies} frequencies need {amounts}"


@dataclass(frozen=True, eq=False)
class Radiation:
    """Transfer vectors with what is known of their accuracy.

    Attributes:
        vectors: points are the elements in their order, named by their numbers.
        per_wavelength: wavelength by the longest edge at each frequency.
        residual: pressure left at points inside by the root mean square on the surface, the largest of uniform motion
            and of the rigid ones, at each frequency; NaN where no point is.
        gap: least height over the plane, by its longest edge, of an element that faces the plane; infinite without.
        status: of each frequency "ok", "inaccurate" where the residual exceeds ``MAX_RESIDUAL`` or the gap is less than
            ``MIN_GAP``, or "unchecked" where no point is inside.
    """

    vectors: TransferVectors
    per_wavelength: NDArray[np.float64]
    residual: NDArray[np.float64]
    gap: float
    status: tuple[str, ...]


def radiation_cost(surface: Surface, frequencies: int, microphones: int = 1) -> RadiationCost:
    """Return what the transfer vectors of a surface cost, before they are computed."""
    n = len(surface)
    sides = 2 if surface.over_plane else 1
    seconds = frequencies * (SECONDS[0] * sides * n * (n + microphones) + SECONDS[1] * n**3)
    return RadiationCost(n, frequencies, BYTES * n**2 + 64.0 * frequencies * microphones * n, seconds)


def transfer_vectors(
    surface: Surface,
    frequency: ArrayLike,
    microphones: ArrayLike,
    *,
    names: Sequence[str] | None = None,
    density: float = AIR_DENSITY,
    sound_speed: float = SOUND_SPEED,
    max_memory: float = math.inf,
    min_per_wavelength: float = MIN_PER_WAVELENGTH,
    tell: Callable[[str], None] | None = None,
) -> Radiation:
    """Return the transfer vectors from the normal velocity of each element to the microphones.

    Args:
        surface: the radiating surface.
        frequency: (frequencies,) ascending, Hz.
        microphones: (microphones, 3) m, outside the body, above the plane if there is one.
        names: of the microphones; "mic1" and so on without.
        density, sound_speed: of the air, kg/m3 and m/s.
        max_memory: bytes.
        min_per_wavelength: least wavelength by the longest edge.
        tell: called with the cost before anything is computed, then with each frequency that is done.

    Raises:
        SurfaceError: if the mesh is too coarse for a frequency, the memory too small, or a microphone is inside the
            body or below the plane.
        ValueError: if density or speed of sound are not positive.
        TransferVectorError: if the frequencies are not positive and ascending.
    """
    check_positive(density=density, sound_speed=sound_speed)
    f = np.atleast_1d(np.asarray(frequency, np.float64))
    x = np.atleast_2d(np.asarray(microphones, np.float64))
    called = tuple(names) if names is not None else tuple(f"mic{number}" for number in range(1, len(x) + 1))
    _check_microphones(surface, x, called)
    shape = len(f), len(x), len(surface)
    vectors = TransferVectors(
        f,
        np.zeros(shape, np.complex128),
        called,
        tuple(map(str, range(len(surface)))),
        x,
        surface.middle,
        surface.normal,
        sound_speed,
        surface.over_plane,
    )
    per_wavelength = sound_speed / f / float(surface.panels.longest.max())
    _check_cost(surface, vectors, per_wavelength, min_per_wavelength, max_memory, tell)
    system = _system(surface, x)
    residual = np.empty(len(f))
    for place, hertz in enumerate(f):
        k = 2.0 * math.pi * float(hertz) / sound_speed
        h, residual[place] = _solve(system, k, 1j * k * sound_speed * density)
        vectors.h[place] = h
        if tell is not None:
            tell(f"{hertz:g} Hz: pressure left inside {100.0 * residual[place]:.2g} %")
    gap = _gap(surface)
    status = tuple(_status(float(value), gap) for value in residual)
    return Radiation(vectors, per_wavelength, residual, gap, status)


def _gap(surface: Surface) -> float:
    facing = surface.normal[:, 2] < -0.5
    if not surface.over_plane or not np.any(facing):
        return math.inf
    return float(np.min(surface.middle[facing, 2] / surface.panels.longest[facing]))


def _status(residual: float, gap: float) -> str:
    if gap < MIN_GAP or residual > MAX_RESIDUAL:
        return "inaccurate"
    return "unchecked" if math.isnan(residual) else "ok"


@dataclass(frozen=True, eq=False)
class _System:
    """What serves all frequencies: influences on the elements, the points inside, the checks and the microphones."""

    size: float
    on: Influence
    inside: Influence
    check: Influence
    off: Influence
    motions: NDArray[np.float64]


def _system(surface: Surface, microphones: NDArray[np.float64]) -> _System:
    def to(x: NDArray[np.float64]) -> Influence:
        return influence(x, np.tile((0.0, 0.0, 1.0), (len(x), 1)), surface.panels, over_plane=surface.over_plane)

    count = max(_POINTS, len(surface) // _ELEMENTS_A_POINT)
    points = interior_points(surface, count + _CHECKS)
    checks = min(_CHECKS, len(points) // 2)
    on = influence(surface.middle, surface.normal, surface.panels, over_plane=surface.over_plane)
    motions = np.column_stack((np.ones(len(surface)), surface.normal))
    size = float(np.sqrt(surface.area.mean()))
    return _System(size, on, to(points[checks:]), to(points[:checks]), to(microphones), motions)


def _solve(system: _System, k: float, load: complex) -> tuple[NDArray[np.complex128], float]:
    """Return the vectors (microphones, elements) at a wave number, and the residual; ``load`` is i omega rho."""
    c = -1j * min(COUPLING * system.size, 1.0 / k)
    left, right = system.on.matrices(k, c)
    elements = np.arange(len(left))
    np.negative(left, out=left)
    left[elements, elements] += 0.5
    right[elements, elements] += 0.5 * c
    if len(system.inside.x):
        # So weighted, the points count as much as the whole surface.
        weight = math.sqrt(len(left) / len(system.inside.x))
        double, single = system.inside.matrices(k, 0j)
        left = np.concatenate((left, -weight * double))
        right = np.concatenate((right, weight * single))
    factor = gram(left)
    double, single = system.off.matrices(k, 0j)
    adjoint = left @ solve_gram(factor, double.conj().T)
    h = load * (adjoint.conj().T @ right + single)
    if not len(system.check.x):
        return h, math.nan
    pressure = load * solve_gram(factor, left.conj().T @ (right @ system.motions))
    double, single = system.check.matrices(k, 0j)
    left_inside = double @ pressure + load * (single @ system.motions)
    size = np.sqrt(np.mean(np.abs(pressure) ** 2, axis=0))
    return h, float(np.max(np.sqrt(np.mean(np.abs(left_inside) ** 2, axis=0)) / size))


def _check_microphones(surface: Surface, x: NDArray[np.float64], names: tuple[str, ...]) -> None:
    if x.ndim != 2 or x.shape[1] != 3 or not len(x) or not np.all(np.isfinite(x)):
        raise SurfaceError(f"microphones must be finite, of shape (microphones, 3), got {x.shape}")
    if len(names) != len(x):
        raise SurfaceError(f"names must be those of {len(x)} microphones, got {len(names)}")
    for place in np.flatnonzero(x[:, 2] < 0.0) if surface.over_plane else ():
        raise SurfaceError(f"microphone {names[place]} is below the plane z = 0, at {x[place, 2]:g} m")
    for place in np.flatnonzero(enclosed(surface, x)):
        raise SurfaceError(f"microphone {names[place]} is inside the body, at {x[place].tolist()} m")


def _check_cost(
    surface: Surface,
    vectors: TransferVectors,
    per_wavelength: NDArray[np.float64],
    least: float,
    max_memory: float,
    tell: Callable[[str], None] | None,
) -> None:
    if per_wavelength.min() < least:
        longest, highest = float(surface.panels.longest.max()), float(vectors.frequency[-1])
        finest = vectors.sound_speed / highest / least
        raise SurfaceError(
            f"the longest edge of {longest:.4g} m is too coarse for {highest:g} Hz: {per_wavelength.min():.1f} "
            f"elements a wavelength, at least {least:g} are needed (edges up to {finest:.3g} m)"
        )
    cost = radiation_cost(surface, len(vectors.frequency), len(vectors.microphones))
    if tell is not None:
        tell(str(cost))
    if cost.memory > max_memory:
        raise SurfaceError(f"{cost}, {max_memory / 1e9:.2g} GB are allowed: take a coarser mesh or lower frequencies")
