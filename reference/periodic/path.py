"""The path of the elements over a defect, cut into smooth pieces: Eq. 51 at the edges, Eqs. 83 and 88 on the floor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from reference.periodic.kernel import BRANCHES, ON_ENTRY, ON_EXIT, ON_FLOOR, ON_RACE, PAST_REACH
from reference.periodic.rig import OracleScene, Pit, Rough

_SCAN = 20001


@lru_cache(maxsize=8)
def rough_profile(rough: Rough, race_radius: float) -> tuple[NDArray[np.float64], float]:
    """Return the cubic pieces of a rough floor, (pieces, 4), lowest power first, and the depth of its lowest point.

    The scene names the profile by seed and spectrum: white Gaussian noise at equal angles around the race, times
    1 / (1 + (wavenumber / cutoff)^8), without mean, scaled to its sd, joined by a periodic cubic spline.
    """
    samples = round(2.0 * math.pi / rough.pitch)
    spectrum = np.fft.rfft(np.random.default_rng(rough.seed).standard_normal(samples))
    wavenumber = np.arange(len(spectrum)) / (2.0 * math.pi * race_radius)
    spectrum = spectrum / (1.0 + (wavenumber / rough.cutoff) ** 8)
    spectrum[0] = 0.0
    heights = np.fft.irfft(spectrum, samples)
    heights *= rough.sd / np.std(heights)
    angles = np.linspace(0.0, 2.0 * math.pi, samples + 1)
    spline = CubicSpline(angles, np.append(heights, heights[0]), bc_type="periodic")
    turning = spline.derivative().roots(extrapolate=False)
    return np.ascontiguousarray(spline.c[::-1].T), float(-np.min(spline(turning)))


def cutoff_of(element_radius: float, roughness: float = 10e-6) -> float:
    """Return the cut-off of Eq. 87, cycles per metre."""
    return 1.0 / (math.pi * math.sqrt(4.0 * roughness * element_radius))


@dataclass(frozen=True)
class Pieces:
    """Angles from a defect's centre at which the path is not smooth, ascending, and the branch between them.

    ``roughness``: factor on the rough profile, 0 to 1.
    """

    pit: Pit
    marks: list[float]
    branches: list[int]
    roughness: float

    def branch(self, angle: float) -> tuple[int, float]:
        """Return the branch at an angle of the race, and the angle reduced to -pi to pi from the centre."""
        x = math.remainder(angle - self.pit.position, 2.0 * math.pi)
        for (a, b), branch in zip(pairwise(self.marks), self.branches, strict=True):
            if a < x < b:
                return branch, x
        return ON_RACE, x


def profile_of(scene: OracleScene) -> tuple[NDArray[np.float64], float]:
    """Return the rough profile of a scene's race as ``rough_profile`` does; without pieces where floors are smooth."""
    if scene.rough is None or not scene.pits:
        return np.empty((0, 4)), 1.0
    return rough_profile(scene.rough, scene.geometry.outer_race_radius)


def pieces_of(scene: OracleScene) -> list[Pieces]:
    """Return the pieces of the path over each defect of a scene."""
    rough, lowest = profile_of(scene)
    return [_pieces(scene, pit, rough, min(1.0, pit.depth / lowest) if len(rough) else 0.0) for pit in scene.pits]


def _pieces(scene: OracleScene, pit: Pit, rough: NDArray[np.float64], roughness: float) -> Pieces:
    g = scene.geometry
    half, reach = 0.5 * pit.extent, math.asin(g.element_radius / g.outer_race_radius)

    def gap(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return edge path (Eq. 51) less floor, m, at angles from the centre."""
        b = np.minimum(half - np.abs(x), reach)
        root = np.sqrt(np.maximum(g.element_radius**2 - (g.outer_race_radius * np.sin(b)) ** 2, 0.0))
        across = (g.outer_race_radius * np.sin(b)) ** 2
        edge = across / (g.element_radius + root) - 2.0 * g.outer_race_radius * np.sin(0.5 * b) ** 2
        return edge - pit.depth - (_heights(x + pit.position, rough) * roughness if len(rough) else 0.0)

    marks = {-half, half, 0.0}
    marks.update(mark for mark in (reach - half, half - reach) if abs(mark) < half and reach < half)
    for a, b in ((-half, 0.0), (0.0, half)):
        # Denser towards the edge, where a shallow floor is met at once.
        t = np.linspace(0.0, 1.0, _SCAN)
        scan = a + (b - a) * (t**3 if a < 0.0 else 1.0 - (1.0 - t) ** 3)
        above = gap(scan) > 0.0
        marks.update(_bisect(gap, scan[i], scan[i + 1]) for i in np.flatnonzero(above[1:] != above[:-1]))
    ordered = sorted(marks)
    branches = []
    for a, b in pairwise(ordered):
        middle = 0.5 * (a + b)
        if gap(np.array([middle]))[0] > 0.0:
            branches.append(ON_FLOOR)
        elif half - abs(middle) > reach:
            branches.append(PAST_REACH)
        else:
            branches.append(ON_ENTRY if middle < 0.0 else ON_EXIT)
    return Pieces(pit, ordered, branches, roughness)


def _heights(angle: NDArray[np.float64], rough: NDArray[np.float64]) -> NDArray[np.float64]:
    spacing = 2.0 * math.pi / len(rough)
    whole = np.floor(angle / spacing)
    t = angle - whole * spacing
    c0, c1, c2, c3 = rough[whole.astype(int) % len(rough)].T
    return c0 + t * (c1 + t * (c2 + t * c3))


def _bisect(function: Callable[[NDArray[np.float64]], NDArray[np.float64]], low: float, high: float) -> float:
    sign = function(np.array([low]))[0] > 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if (function(np.array([middle]))[0] > 0.0) == sign else (low, middle)
    return float(0.5 * (low + high))


def intervals(
    scene: OracleScene, paths: list[Pieces]
) -> tuple[NDArray[np.float64], NDArray[np.int8], NDArray[np.float64]]:
    """Return the kernel's ``bounds`` (intervals + 1), ``codes`` and ``middles`` (intervals, elements).

    The bounds are the cage angles at which an element of a damaged row meets a mark of a path, and those at which one
    on a rough floor meets a joint of the profile (where only the third derivative jumps).
    """
    starts, count = scene.angles, scene.geometry.n_elements
    found = {0.0, scene.pitch}
    for path in paths:
        for row in range(path.pit.rows):
            found.update((mark + path.pit.position - starts[row * count]) % scene.pitch for mark in path.marks)
        if path.roughness > 0.0:
            found.update(_joints(scene, path, starts))
    ordered = np.array(sorted(found))
    bounds = ordered[np.concatenate(([True], np.diff(ordered) > 1e-11))]
    bounds[-1] = scene.pitch
    codes = np.zeros((len(bounds) - 1, len(starts)), dtype=np.int8)
    middles = np.zeros(codes.shape)
    for number, path in enumerate(paths):
        for i, (a, b) in enumerate(pairwise(bounds)):
            for j in range(path.pit.rows * count):
                branch, x = path.branch(starts[j] + 0.5 * (a + b))
                if branch != ON_RACE:
                    codes[i, j], middles[i, j] = number * BRANCHES + branch, x
    return bounds, codes, middles


def _joints(scene: OracleScene, path: Pieces, starts: NDArray[np.float64]) -> list[float]:
    """Return the cage angles at which an element that the load can press meets a joint of the rough floor."""
    spacing = 2.0 * math.pi / len(profile_of(scene)[0])
    found = []
    for start in starts[: path.pit.rows * scene.geometry.n_elements]:
        first = math.ceil(start / spacing)
        for k in range(first, math.floor((start + scene.pitch) / spacing) + 1):
            on_floor = path.branch(k * spacing)[0] == ON_FLOOR
            if on_floor and abs(math.remainder(k * spacing, 2.0 * math.pi)) < 0.6 * math.pi:
                found.append(k * spacing - start)
    return [theta for theta in found if 0.0 < theta < scene.pitch]
