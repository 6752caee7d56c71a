"""The path of a rolling element over a localised or extended defect of the outer race.

One rule serves every defect (thesis, Eqs. 49-52 and 83-89): the ball follows whichever is shallower, the path over the
edges or the floor,

    d(phi) = cos(alpha) * min(edge path, h_d + h_dr(phi)),

which is Eq. 83 for a smooth floor, Eq. 51 where the floor is deeper than the ball can reach, and is continuous in
every parameter down to no defect at all. (Eq. 88 as printed jumps by h_dr where the floor begins.)

Angles are measured from the load direction in the frame of the outer race, which stands still.

A rough floor is one profile of the whole race, drawn from its seed alone: it does not change with speed, sampling
rate, depth or extent, so that a growing defect uncovers it. Its peaks cannot stand above the undamaged race: where the
defect is shallower than the deepest trough-to-mean distance p of the profile, the profile is scaled by h_d / p. So a
floor without depth is no defect, whatever its roughness, and a map's row h_d = 0 is the healthy bearing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.words.numerics import periodic_spline

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect, Floor

# The roughness from which Eq. 87 takes the cut-off where the scene names none (thesis, section 5.2.1).
_DEFAULT_ROUGHNESS = 10e-6
_SCAN_POINTS = 200
_ROOT_STEPS = 60
# Short of the angle where the edge path ends in a vertical tangent, so that its slope stays finite.
_REACH = 1.0 - 1e-9


@dataclass(frozen=True, eq=False)
class FloorProfile:
    """A rough profile once around the race: periodic, twice continuously differentiable, zero mean.

    Attributes:
        coefficients: cubic pieces, highest power first, shape (4, pieces), m and powers of 1/rad.
        spacing: length of one piece, rad.
        lowest: depth of the highest peak towards the ball below the mean, m, positive (minus the least value).
        highest: largest value, m.
    """

    coefficients: NDArray[np.float64]
    spacing: float
    lowest: float
    highest: float

    def __call__(self, angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the profile (m) and its exact derivative (m/rad) at angles of any shape."""
        wrapped = np.mod(angle, 2.0 * math.pi)
        piece = np.minimum((wrapped / self.spacing).astype(np.int64), self.coefficients.shape[1] - 1)
        x = wrapped - piece * self.spacing
        c3, c2, c1, c0 = self.coefficients[:, piece]
        return ((c3 * x + c2) * x + c1) * x + c0, (3.0 * c3 * x + 2.0 * c2) * x + c1


def profile_cutoff(floor: Floor, ball_radius: float) -> float:
    """Return the spatial cut-off of a rough floor, cycles per metre: the floor's own, or Eq. 87 with R = 10 um."""
    if floor.cutoff is not None:
        return floor.cutoff
    return 1.0 / (math.pi * math.sqrt(4.0 * _DEFAULT_ROUGHNESS * ball_radius))


@lru_cache(maxsize=256)
def race_profile(sd: float, pitch: float, cutoff: float, seed: int, race_radius: float) -> FloorProfile:
    """Return the rough profile of a race: white Gaussian noise, low-passed around the circle, cubic between samples.

    The filter is the squared magnitude of a Butterworth filter of order 4 (as a forward and backward pass has), without
    the mean.

    Args:
        sd: standard deviation after filtering, m.
        pitch: spacing of the samples, rad (rounded to a whole number around the race).
        cutoff: spatial cut-off, cycles per metre.

    Raises:
        ValueError: if sd is negative, or pitch or cutoff not positive, or the pitch too coarse for the cut-off.
    """
    if not (sd >= 0.0 and pitch > 0.0 and cutoff > 0.0):
        raise ValueError(
            f"rough floor: sd {sd!r} m must not be negative, pitch {pitch!r} rad and cutoff {cutoff!r} 1/m positive"
        )
    samples = max(8, round(2.0 * math.pi / pitch))
    circumference = 2.0 * math.pi * race_radius
    if cutoff * circumference > 0.4 * samples:
        raise ValueError(f"rough floor: pitch {pitch!r} rad is too coarse for the cut-off {cutoff!r} cycles per metre")
    noise = np.fft.rfft(np.random.default_rng(seed).standard_normal(samples))
    wavenumber = np.arange(len(noise)) / circumference
    noise *= 1.0 / (1.0 + (wavenumber / cutoff) ** 8)
    noise[0] = 0.0
    values = np.fft.irfft(noise, samples)
    values *= sd / float(np.sqrt(np.mean(values * values)))
    angles = np.asarray(np.arange(samples + 1) * (2.0 * math.pi / samples), dtype=np.float64)
    pieces, extrema = periodic_spline(angles, np.append(values, values[0]))
    coefficients = np.ascontiguousarray(pieces)
    coefficients.flags.writeable = False
    return FloorProfile(coefficients, 2.0 * math.pi / samples, float(-extrema.min()), float(extrema.max()))


def edge_path(delta: NDArray[np.float64], r_o: float, r_b: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far a ball has sunk over an edge, m, and its slope, m/rad (Eq. 51, free of cancellation).

    ``delta`` is the angle beyond the edge, rad, not negative; beyond asin(r_b / r_o) the path stays at its end.
    """
    reach = math.asin(r_b / r_o) * _REACH
    clamped = np.minimum(delta, reach)
    sine = r_o * np.sin(clamped)
    cosine = np.cos(clamped)
    root = np.sqrt(r_b * r_b - sine * sine)
    depth = sine * sine / (r_b + root) - 2.0 * r_o * np.sin(0.5 * clamped) ** 2
    slope = np.where(delta <= reach, sine * (r_o * cosine / root - 1.0), 0.0)
    return depth, slope


def shallower(
    x: NDArray[np.float64],
    half_width: float,
    cos_alpha: float,
    edge: tuple[NDArray[np.float64], NDArray[np.float64]],
    floor: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return d (m) and its derivative (m/rad) at angles x from the centre, from depth and slope of edge and floor."""
    on_edge, inside = edge[0] <= floor[0], half_width - np.abs(x) > 0.0
    depth = np.where(on_edge, edge[0], floor[0])
    slope = np.where(on_edge, -np.sign(x) * edge[1], floor[1])
    return np.where(inside, cos_alpha * depth, 0.0), np.where(inside, cos_alpha * slope, 0.0)


@dataclass(frozen=True, eq=False)
class BallPath:
    """Radial path d(phi) of a ball over one defect.

    Attributes:
        r_o, r_b: radii of the outer race and of the ball, m.
        half_width: half the extent of the defect, rad.
        h_d: depth of the floor, m (infinite: no floor).
        position: angle of the centre from the load direction, rad.
        roughness: factor on the profile, 0 to 1 (see the module's text).
    """

    r_o: float
    r_b: float
    cos_alpha: float
    half_width: float
    h_d: float
    position: float
    profile: FloorProfile | None = None
    roughness: float = 0.0

    @property
    def reach(self) -> float:
        """Angle beyond an edge where the edge path ends, rad."""
        return math.asin(self.r_b / self.r_o) * _REACH

    def __call__(self, angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return d (m) and its derivative by the angle (m/rad) at angles of any shape, rad.

        At a kink the derivative is one of the two one-sided ones; a small offset of the angle selects it.
        """
        x = wrap(angle - self.position)
        edge = edge_path(np.maximum(self.half_width - np.abs(x), 0.0), self.r_o, self.r_b)
        return shallower(x, self.half_width, self.cos_alpha, edge, self._floor(angle))

    def _floor(self, angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self.profile is None or self.roughness == 0.0:
            return np.full_like(angle, self.h_d), np.zeros_like(angle)
        height, slope = self.profile(angle)
        return self.h_d + self.roughness * height, self.roughness * slope

    def kinks(self) -> NDArray[np.float64]:
        """Return the angles at which the path is not smooth, rad, ascending, around ``position``.

        These are both edges (where only the curvature jumps), the switches between edge and floor (where the slope
        jumps), the middle of a defect whose floor the ball does not reach, and the ends of the edges' reach.
        """
        if self.half_width <= 0.0 or self.h_d <= 0.0:
            return np.empty(0)
        switches: list[float] = []
        for side in (-1.0, 1.0):
            switches.extend(side * (self.half_width - delta) for delta in self._switches(side))
        kinks = [-self.half_width, self.half_width, *switches]
        reach = self.reach
        edge_middle = float(edge_path(np.array(self.half_width), self.r_o, self.r_b)[0])
        floor_middle = float(self._floor(np.array(self.position))[0])
        if edge_middle < floor_middle:
            kinks.append(0.0)
        if reach < self.half_width and self.h_d >= edge_middle:
            kinks += [reach - self.half_width, self.half_width - reach]
        return np.sort(np.array(kinks)) + self.position

    def _switches(self, side: float) -> NDArray[np.float64]:
        """Return the angles beyond the edge on one side (-1 entry, 1 exit) where edge path and floor cross, rad."""
        if self.profile is None or self.roughness == 0.0:
            delta = floor_angle(self.h_d, self.r_o, self.r_b)
            return np.array([delta]) if delta is not None and delta < self.half_width else np.empty(0)
        deepest = floor_angle(self.h_d + self.roughness * self.profile.highest, self.r_o, self.r_b)
        end = self.half_width if deepest is None else min(self.half_width, 1.001 * deepest)

        scan = np.linspace(0.0, end, _SCAN_POINTS)
        below = self._gap(scan, side)[0] < 0.0
        index = np.flatnonzero(below[1:] != below[:-1])
        low, high, sign = scan[index], scan[index + 1], below[index]
        root = 0.5 * (low + high)
        for _ in range(_ROOT_STEPS):
            if len(root) == 0 or float(np.max(high - low)) < 1e-14:
                break
            gap, slope = self._gap(root, side)
            same = (gap < 0.0) == sign
            low, high = np.where(same, root, low), np.where(same, high, root)
            # Newton inside the bracket, a bisection where it would leave it; done when it no longer moves.
            newton = root - gap / np.where(slope == 0.0, 1.0, slope)
            moved = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))
            settled = float(np.max(np.abs(moved - root))) < 1e-14
            root = moved
            if settled:
                break
        return root

    def _gap(self, delta: NDArray[np.float64], side: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return edge path minus floor at angles beyond one edge, m, and its derivative, m/rad."""
        edge, edge_slope = edge_path(delta, self.r_o, self.r_b)
        floor, floor_slope = self._floor(self.position + side * (self.half_width - delta))
        return edge - floor, edge_slope + side * floor_slope


def floor_angle(h_d: float, r_o: float, r_b: float) -> float | None:
    """Return how far beyond an edge a ball touches a floor of depth h_d, rad, or None if it never does.

    The closed form of Eqs. 84 and 85, written so that shallow floors lose no digits.
    """
    if h_d >= math.sqrt(r_o * r_o - r_b * r_b) - (r_o - r_b):
        return None
    rho = r_o - r_b + h_d
    return 2.0 * math.asin(math.sqrt(h_d * (2.0 * r_b - h_d) / (4.0 * r_o * rho)))


def race_radius(bearing: Bearing) -> float:
    """Return r_o, m: the catalogue's, or pitch radius plus r_b cos(alpha) where that is unknown."""
    if bearing.outer_race_radius is not None:
        return bearing.outer_race_radius
    return 0.5 * (bearing.pitch_diameter + bearing.element_diameter * math.cos(bearing.contact_angle))


def ball_path(bearing: Bearing, defect: Defect | None) -> BallPath | None:
    """Return the path over a defect, or None without extent or depth.

    Raises:
        ValueError: if extent or depth is negative, not a number, or the extent is more than the race.
    """
    if defect is None:
        return None
    if defect.dphi_d == 0.0 or defect.h_d == 0.0:
        return None
    r_b = 0.5 * bearing.element_diameter
    r_o = race_radius(bearing)
    profile, roughness = None, 0.0
    if defect.floor.kind == "rough" and defect.floor.sd > 0.0:
        cutoff = profile_cutoff(defect.floor, r_b)
        profile = race_profile(defect.floor.sd, defect.floor.pitch, cutoff, defect.floor.seed, r_o)
        roughness = min(1.0, defect.h_d / profile.lowest)
    return BallPath(
        r_o, r_b, math.cos(bearing.contact_angle), 0.5 * defect.dphi_d, defect.h_d, defect.position, profile, roughness
    )


def wrap(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles reduced to -pi to pi."""
    return angle - 2.0 * math.pi * np.round(angle / (2.0 * math.pi))
