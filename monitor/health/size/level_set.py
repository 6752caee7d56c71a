"""The points of an RMS map with a given RMS, and the least damaged volume among them.

Inside one cell of the grid the map is the bilinear patch X = a + b u + c v + d u v with u and v from 0 to 1, so its
level set is a hyperbola (or a line). On it the volume of Eq. 90, r (x0 + u dx)(y0 + v dy), is least where the curve
meets an edge of the cell or where the volume is stationary. Eliminating v leaves a quadratic in u,

    d dx q u^2 + 2 c dx q u + c (x0 q + dx p) - d x0 p = 0,    p = y0 c - dy (a - X),    q = y0 d - dy b,

so every candidate has a closed form and no grid is scanned. A bilinear patch cut along u = const or v = const is again
a bilinear patch, so a quadrant of the map is a smaller map.

The map of a block within which the speed varies: mean squares over its speeds.

The speed is taken to be below its mean for half of the block and above it for the other half, evenly in each: the map
is looked up at five speeds and averaged by Simpson's rule. Where one of them is outside the map, so is the block.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from monitor.health.size import DamageInput, EdvStatus

if TYPE_CHECKING:
    from models.maps.data import MapSlice

Slice = TypeVar("Slice", "LevelMap", "MapSlice")
Lookup = Callable[[float | None, float | None], "tuple[Slice | None, EdvStatus | None]"]
MIN_RANGE = 0.01
"""Range of the speed over its mean below which a block has one speed."""
_WEIGHTS = np.array((1.0, 4.0, 2.0, 4.0, 1.0)) / 12.0
_SQUARED = ("rms", "harmonic_amplitude")
_LINEAR = ("rms_error", "rms_std", "harmonic_std", "rms_rig_std", "harmonic_rig_std")


def map_of_block(lookup: Lookup[Slice], block: DamageInput) -> tuple[Slice | None, EdvStatus | None]:
    """Return the map at the load and over the speeds of a block, or the status that says why there is none."""
    speeds = speeds_of(block)
    if not speeds:
        return lookup(block.load, block.speed)
    slices: list[Slice] = []
    for speed in speeds:
        found, refused = lookup(block.load, speed)
        if found is None:
            return None, refused
        slices.append(found)
    return _mean(slices), None


def speeds_of(block: DamageInput) -> tuple[float, ...]:
    """Return the five speeds of a block that varies, Hz; () of one that turns at one speed."""
    if block.speed is None or block.speed_range is None:
        return ()
    low, high = block.speed_range
    if high - low < MIN_RANGE * block.speed:
        return ()
    return low, 0.5 * (low + block.speed), block.speed, 0.5 * (block.speed + high), high


def _mean(slices: list[Slice]) -> Slice:
    def of(name: str, *, squared: bool) -> NDArray[np.float64]:
        values = np.stack([getattr(one, name) for one in slices])
        mean = np.tensordot(_WEIGHTS, np.square(values) if squared else values, axes=1)
        return np.asarray(np.sqrt(mean) if squared else mean, dtype=np.float64)

    middle = slices[2]
    if isinstance(middle, LevelMap):
        return replace(middle, rms=of("rms", squared=True))
    changed = {name: of(name, squared=name in _SQUARED) for name in (*_SQUARED, *_LINEAR)}
    return replace(middle, **changed)


Array = NDArray[np.float64]
LEVEL_TOLERANCE = 1e-12
"""Values within this fraction of the map's largest RMS are equal (rounding)."""
VOLUME_TOLERANCE = 1e-12
"""Volumes within this fraction of each other are the same volume."""
BOUND_SLACK = 1e-9
"""Fraction by which bounds of the volume are widened against rounding."""
MAX_SCANNED_CELLS = 16
"""With more candidate cells than this, arrays first select those that can hold the least volume."""


@dataclass(frozen=True, eq=False)
class LevelMap:
    """RMS over extent and depth of the defect at one load and speed, bilinear between the grid points.

    Derived values are cached: pass the same object for all blocks of one condition.

    Attributes:
        dphi_d: extents, shape (n,), rad, ascending, not negative.
        h_d: depths, shape (m,), m, ascending, not negative.
        rms: shape (m, n), m/s2; NaN is a hole, and the cells that touch it are left out.
        part_radius: r_o of Eq. 90, or that of the damaged inner race or ball, m.
    """

    dphi_d: Array
    h_d: Array
    rms: Array
    part_radius: float

    def __post_init__(self) -> None:
        """Copy to float64 and validate.

        Raises:
            ValueError: axes that do not ascend, shapes that do not fit, infinite values, or no complete cell.
        """
        for name in ("dphi_d", "h_d", "rms"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=np.float64))
        for name in ("dphi_d", "h_d"):
            axis = getattr(self, name)
            if axis.ndim != 1 or axis.size < 2 or not np.all(np.isfinite(axis)):
                raise ValueError(f"map slice: {name} must be two or more finite values, got shape {axis.shape}")
            if axis[0] < 0 or not np.all(np.diff(axis) > 0):
                raise ValueError(f"map slice: {name} must ascend from zero or more, got {axis.tolist()}")
        if self.rms.shape != (self.h_d.size, self.dphi_d.size):
            expected = (self.h_d.size, self.dphi_d.size)
            raise ValueError(f"map slice: rms must have shape (h_d, dphi_d) = {expected}, got {self.rms.shape}")
        if np.any(np.isinf(self.rms)):
            raise ValueError("map slice: rms must be finite, or NaN where the map has a hole; got an infinite value")
        if not (math.isfinite(self.part_radius) and self.part_radius > 0):
            raise ValueError(f"map slice: part_radius must be positive, got {self.part_radius}")
        if not np.any(np.isfinite(self.cell_min)):
            raise ValueError("map slice: rms has no cell with four finite corners")

    @cached_property
    def cell_min(self) -> Array:
        """Least RMS of each cell, shape (m - 1, n - 1), m/s2; NaN in a hole."""
        z = self.rms
        return np.minimum(np.minimum(z[:-1, :-1], z[:-1, 1:]), np.minimum(z[1:, :-1], z[1:, 1:]))

    @cached_property
    def cell_max(self) -> Array:
        """Largest RMS of each cell, shape (m - 1, n - 1), m/s2; NaN in a hole."""
        z = self.rms
        return np.maximum(np.maximum(z[:-1, :-1], z[:-1, 1:]), np.maximum(z[1:, :-1], z[1:, 1:]))

    @cached_property
    def rms_min(self) -> float:
        """Least RMS of all complete cells, m/s2."""
        return float(np.nanmin(self.cell_min))

    @cached_property
    def rms_max(self) -> float:
        """Largest RMS of all complete cells, m/s2."""
        return float(np.nanmax(self.cell_max))

    @cached_property
    def has_holes(self) -> bool:
        """Whether any value is missing."""
        return bool(np.any(np.isnan(self.rms)))

    @cached_property
    def tolerance(self) -> float:
        """Difference of RMS below which two values are equal, m/s2."""
        return LEVEL_TOLERANCE * max(abs(self.rms_min), abs(self.rms_max))

    def value_at(self, dphi_d: float, h_d: float) -> float:
        """Return the RMS at a point, bilinear, m/s2; clamped to the map, NaN in a hole."""
        i, u = locate(self.dphi_d, dphi_d)
        j, v = locate(self.h_d, h_d)
        z = self.rms
        lower = z[j, i] + u * (z[j, i + 1] - z[j, i])
        upper = z[j + 1, i] + u * (z[j + 1, i + 1] - z[j + 1, i])
        return float(lower + v * (upper - lower))

    def volume(self, dphi_d: float, h_d: float) -> float:
        """Return V_eq of Eq. 90, m2 (volume per width)."""
        return self.part_radius * dphi_d * h_d


@dataclass(frozen=True)
class LevelPoint:
    """A point of the map: extent in rad, depth in m and V_eq (Eq. 90) in m2."""

    dphi_d: float
    h_d: float
    v_eq: float


def locate(axis: Array, value: float) -> tuple[int, float]:
    """Return the cell of an ascending axis that holds a value (clamped), and the fraction in it.

    With index i and u in [0, 1] the value is axis[i] + u (axis[i+1] - axis[i]).
    """
    i = min(max(int(axis.searchsorted(value, "right")) - 1, 0), axis.size - 2)
    low, high = float(axis[i]), float(axis[i + 1])
    return i, min(max((value - low) / (high - low), 0.0), 1.0)


def step_back(axis: Array, value: float, steps: int) -> float:
    """Return the value a number of grid steps before another, on the continuous index; clamped to the first."""
    i, u = locate(axis, value)
    if i - steps < 0:
        return float(axis[0])
    low, high = float(axis[i - steps]), float(axis[i - steps + 1])
    return low + u * (high - low)


def least_volume(map_slice: LevelMap, level: float, dphi_from: float, h_from: float) -> LevelPoint | None:
    """Return the least volume with RMS ``level`` where dphi_d >= dphi_from, h_d >= h_from (Eq. 91).

    Of several points with the same volume (zero, on the axes), the one nearest the quadrant's corner, relative to the
    map's size, is taken. None where the quadrant holds no such RMS.
    """
    x, y, z = _quadrant(map_slice, dphi_from, h_from)
    s = z - level
    s[np.abs(s) <= map_slice.tolerance] = 0.0
    if s[0, 0] == 0.0:
        return _point(map_slice, float(x[0]), float(y[0]))
    below, above = s < 0, s > 0
    apart = (below[:-1] & below[1:]) | (above[:-1] & above[1:])
    # Two neighbouring columns that are both wholly below, or both wholly above, close a cell that the level misses.
    misses = apart[:, :-1] & apart[:, 1:] & (below[:-1, :-1] == below[:-1, 1:])
    if map_slice.has_holes:
        misses |= np.isnan(s[:-1, :-1] + s[:-1, 1:] + s[1:, :-1] + s[1:, 1:])
    cells = np.flatnonzero(~misses)
    if cells.size == 0:
        return None
    row, column = np.divmod(cells, x.size - 1)
    # Every cell left holds the level, so the least volume is at most the least volume of their far corners.
    useful = x[column] * y[row] <= (x[column + 1] * y[row + 1]).min()
    row, column = row[useful], column[useful]
    if row.size > MAX_SCANNED_CELLS:
        useful = _shortlist(x, y, s, row, column)
        row, column = row[useful], column[useful]
    points = [
        point
        for i, j in zip(column.tolist(), row.tolist(), strict=True)
        for point in _candidates(x[i : i + 2].tolist(), y[j : j + 2].tolist(), s[j : j + 2, i : i + 2].tolist())
    ]
    return _choose(map_slice, points, float(x[0]), float(y[0]))


def widened_steps(map_slice: LevelMap, level: float, dphi_from: float, h_from: float) -> int | None:
    """Return the least number of grid steps (>= 1) by which widening can reach RMS ``level``.

    A cell that holds the level is touched by the quadrant after this many steps and lies inside after one more, so a
    point is found after this number or the next. None where no cell of the map holds the level.
    """
    tolerance = map_slice.tolerance
    holds = (map_slice.cell_min <= level + tolerance) & (map_slice.cell_max >= level - tolerance)
    row, column = np.nonzero(holds)
    if row.size == 0:
        return None
    i, u = locate(map_slice.dphi_d, dphi_from)
    j, v = locate(map_slice.h_d, h_from)
    away = np.maximum(i + u - (column + 1), j + v - (row + 1))
    return max(1, math.ceil(float(away.min())))


def _quadrant(map_slice: LevelMap, dphi_from: float, h_from: float) -> tuple[Array, Array, Array]:
    """Return axes and RMS of the quadrant as a map; its first row and column lie between grid points."""
    i, u = locate(map_slice.dphi_d, dphi_from)
    j, v = locate(map_slice.h_d, h_from)
    x, y = map_slice.dphi_d[i:].copy(), map_slice.h_d[j:].copy()
    z = map_slice.rms[j:, i:].copy()
    # The corner itself: recomputed from the fraction it could begin a rounding error too early.
    x[0] = min(max(dphi_from, float(x[0])), float(x[-1]))
    y[0] = min(max(h_from, float(y[0])), float(y[-1]))
    if u > 0:
        z[:, 0] += u * (z[:, 1] - z[:, 0])
    if v > 0:
        z[0, :] += v * (z[1, :] - z[0, :])
    return x, y, z


def _shortlist(x: Array, y: Array, s: Array, row: NDArray[np.intp], column: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which cells can hold the least volume, a mask of shape (cells,).

    A branch of a hyperbola is monotone, so the least extent and the least depth on the level set of a cell are both on
    its edges. Their product is a lower bound, and any crossing an upper bound.

    Args:
        x: extents, shape (n,).
        y: depths, shape (m,).
        s: RMS less the level, shape (m, n).
        row, column: index of each cell in depth and in extent, shape (cells,).
    """
    f00, f10, f01, f11 = s[row, column], s[row, column + 1], s[row + 1, column], s[row + 1, column + 1]
    start, end = np.stack([f00, f01, f00, f10]), np.stack([f10, f11, f01, f11])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = start / (start - end)
    hit = (share >= 0.0) & (share <= 1.0)
    u, v = np.where(hit, share, 1.0), np.where(hit, share, 1.0)
    u[2], u[3] = ~hit[2], 1.0
    v[0], v[1] = ~hit[0], 1.0
    x0, y0 = x[column], y[row]
    dx, dy = x[column + 1] - x0, y[row + 1] - y0
    corner = f00 == 0.0
    least = np.where(corner, x0 * y0, (x0 + dx * u.min(axis=0)) * (y0 + dy * v.min(axis=0)))
    crossing = np.where(hit, (x0 + dx * u) * (y0 + dy * v), np.inf)
    best = min(float(crossing.min()), float(np.where(corner, least, np.inf).min()))
    return least <= best * (1.0 + BOUND_SLACK)


def _candidates(x: list[float], y: list[float], f: list[list[float]]) -> Iterator[tuple[float, float]]:
    """Yield the points (extent, depth) of a cell at which the volume can be least on the level set.

    ``f`` is the RMS less the level at the corners, by depth and then by extent. The near corner stands for a plateau.
    """
    (f00, f10), (f01, f11) = f
    dx, dy = x[1] - x[0], y[1] - y[0]
    if f00 == 0.0:
        yield x[0], y[0]
    for k, start, end in ((0, f00, f10), (1, f01, f11)):
        if start != end and 0.0 <= (u := start / (start - end)) <= 1.0:
            yield min(x[0] + u * dx, x[1]), y[k]
    for k, start, end in ((0, f00, f01), (1, f10, f11)):
        if start != end and 0.0 <= (v := start / (start - end)) <= 1.0:
            yield x[k], min(y[0] + v * dy, y[1])
    b, c = f10 - f00, f01 - f00
    d = f11 - f10 - c
    p, q = y[0] * c - dy * f00, y[0] * d - dy * b
    for u in _roots(d * dx * q, c * dx * q, c * (x[0] * q + dx * p) - d * x[0] * p):
        slope = c + d * u
        if 0.0 <= u <= 1.0 and slope != 0.0 and 0.0 <= (v := -(f00 + b * u) / slope) <= 1.0:
            yield min(x[0] + u * dx, x[1]), min(y[0] + v * dy, y[1])


def _roots(a: float, half_b: float, c: float) -> Iterator[float]:
    """Yield real roots of a u^2 + 2 half_b u + c without cancellation; for a = 0 the finite one."""
    discriminant = half_b * half_b - a * c
    if discriminant < 0.0:
        return
    larger = half_b + math.copysign(math.sqrt(discriminant), half_b)
    if a != 0.0:
        yield -larger / a
    if larger != 0.0:
        yield -c / larger


def _choose(map_slice: LevelMap, points: list[tuple[float, float]], x_from: float, y_from: float) -> LevelPoint | None:
    """Return the point of least volume, of several the one nearest the corner."""
    if not points:
        return None
    most = min(x * y for x, y in points) * (1.0 + VOLUME_TOLERANCE)
    dphi_range = float(map_slice.dphi_d[-1] - map_slice.dphi_d[0])
    h_range = float(map_slice.h_d[-1] - map_slice.h_d[0])
    _, x, y = min(((x - x_from) / dphi_range + (y - y_from) / h_range, x, y) for x, y in points if x * y <= most)
    return _point(map_slice, x, y)


def _point(map_slice: LevelMap, dphi_d: float, h_d: float) -> LevelPoint:
    return LevelPoint(dphi_d, h_d, map_slice.volume(dphi_d, h_d))
