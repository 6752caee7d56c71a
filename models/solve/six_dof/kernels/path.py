"""Kernels of the path of the balls over defects: its kinks and its tables (rule: models.path.defect).

``path`` (float64) describes a defect by the D_ constants; ``paths`` has a row for each of a scene, none of which
overlap. ``profile`` (4, pieces) holds the cubic pieces of all rough floors, highest power first.
``models.path.defect.BallPath`` is the oracle.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Places in ``path``.
D_RACE = 0  # radius of the outer race r_o, m
D_BALL = 1  # radius of the ball r_b, m
D_COSINE = 2  # cosine of the contact angle
D_HALF = 3  # half the extent, rad
D_DEPTH = 4  # depth of the floor h_d, m; infinite where there is none
D_POSITION = 5  # angle of the centre from the load direction, rad
D_REACH = 6  # angle beyond an edge where the edge path ends, rad
D_ROUGHNESS = 7  # factor on the profile, 0 to 1
D_SPACING = 8  # length of a piece of the profile, rad
D_HIGHEST = 9  # largest value of the profile, m
D_PIECE = 10  # first piece of the floor's profile
D_PIECES = 11  # how many it has, 0 where the floor is smooth
D_ROW = 12  # first row with the defect
D_ROWS_END = 13  # the one after the last
DEFECT = 14

SCAN_POINTS = 200
_ROOT_STEPS = 60
# Kinks closer than this are one; it exceeds the rounding of any angle, and the nudge exceeds it in turn.
_SAME_ANGLE = 1e-7
# Path slopes at the ends of a segment are taken this far within it, so that they are the one-sided limits.
NUDGE = 1e-9


@kernel
def edge(delta: float, r_o: float, r_b: float, reach: float) -> tuple[float, float]:
    """Return depth, m, and slope, m/rad, of the path ``delta`` rad beyond an edge (models.path.defect.edge_path)."""
    clamped = min(max(delta, 0.0), reach)
    sine = math.sin(clamped)
    cosine = math.sqrt(1.0 - sine * sine)
    across = r_o * sine
    root = math.sqrt(r_b * r_b - across * across)
    # 2 sin(x/2)^2 = sin(x)^2 / (1 + cos(x))
    depth = across * (across / (r_b + root) - sine / (1.0 + cosine))
    slope = across * (r_o * cosine / root - 1.0) if delta <= reach else 0.0
    return depth, slope


@kernel
def floor_at(path: NDArray[np.float64], profile: NDArray[np.float64], angle: float) -> tuple[float, float]:
    """Return depth, m, and slope, m/rad, of the floor at an angle of the race."""
    if path[D_PIECES] == 0.0:
        return path[D_DEPTH], 0.0
    spacing, roughness = path[D_SPACING], path[D_ROUGHNESS]
    wrapped = angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
    piece = min(int(wrapped / spacing), int(path[D_PIECES]) - 1)
    x = wrapped - piece * spacing
    piece += int(path[D_PIECE])
    c3, c2, c1, c0 = profile[0, piece], profile[1, piece], profile[2, piece], profile[3, piece]
    height = ((c3 * x + c2) * x + c1) * x + c0
    return path[D_DEPTH] + roughness * height, roughness * ((3.0 * c3 * x + 2.0 * c2) * x + c1)


@kernel
def touch_angle(h_d: float, r_o: float, r_b: float) -> float:
    """Return how far beyond an edge a ball meets a floor of depth h_d, rad; infinite where it never does."""
    if h_d >= math.sqrt(r_o * r_o - r_b * r_b) - (r_o - r_b):
        return math.inf
    return 2.0 * math.asin(math.sqrt(h_d * (2.0 * r_b - h_d) / (4.0 * r_o * (r_o - r_b + h_d))))


@kernel
def _gap(path: NDArray[np.float64], profile: NDArray[np.float64], delta: float, side: float) -> tuple[float, float]:
    """Return edge path minus floor beyond one edge, m, and its derivative, m/rad."""
    depth, slope = edge(delta, path[D_RACE], path[D_BALL], path[D_REACH])
    floor, floor_slope = floor_at(path, profile, path[D_POSITION] + side * (path[D_HALF] - delta))
    return depth - floor, slope + side * floor_slope


@kernel
def _root(
    path: NDArray[np.float64], profile: NDArray[np.float64], side: float, low: float, high: float, below: bool
) -> float:
    """Return where edge path and floor cross between two angles beyond one edge: Newton within a bracket."""
    root = 0.5 * (low + high)
    for _ in range(_ROOT_STEPS):
        gap, slope = _gap(path, profile, root, side)
        if (gap < 0.0) == below:
            low = root
        else:
            high = root
        moved = root - gap / slope if slope != 0.0 else low
        if not low < moved < high:
            moved = 0.5 * (low + high)
        done = abs(moved - root) < 1e-14 or high - low < 1e-14
        root = moved
        if done:
            break
    return root


@kernel
def _switches(path: NDArray[np.float64], profile: NDArray[np.float64], side: float, out: NDArray[np.float64]) -> int:
    """Write the angles beyond one edge where edge path and floor cross, rad; return their number."""
    half, h_d, r_o, r_b = path[D_HALF], path[D_DEPTH], path[D_RACE], path[D_BALL]
    if path[D_PIECES] == 0.0:
        out[0] = touch_angle(h_d, r_o, r_b)
        return 1 if out[0] < half else 0
    end = min(half, 1.001 * touch_angle(h_d + path[D_ROUGHNESS] * path[D_HIGHEST], r_o, r_b))
    count = 0
    width = end / (SCAN_POINTS - 1)
    below = _gap(path, profile, 0.0, side)[0] < 0.0
    for n in range(1, SCAN_POINTS):
        next_below = _gap(path, profile, n * width, side)[0] < 0.0
        if next_below != below:
            out[count] = _root(path, profile, side, (n - 1) * width, n * width, below)
            count += 1
        below = next_below
    return count


@kernel
def path_kinks(path: NDArray[np.float64], profile: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angles at which the path is not smooth, rad, in no order (models.path.defect.BallPath.kinks)."""
    half, position = path[D_HALF], path[D_POSITION]
    kinks = np.empty(2 * SCAN_POINTS + 5)
    kinks[0], kinks[1] = position - half, position + half
    count = 2
    found = np.empty(SCAN_POINTS)
    for k in range(2):
        side = 2.0 * k - 1.0
        for i in range(_switches(path, profile, side, found)):
            kinks[count] = position + side * (half - found[i])
            count += 1
    middle, _ = edge(half, path[D_RACE], path[D_BALL], path[D_REACH])
    if middle < floor_at(path, profile, position)[0]:
        kinks[count] = position
        count += 1
    if path[D_REACH] < half and path[D_DEPTH] >= middle:
        kinks[count], kinks[count + 1] = position - half + path[D_REACH], position + half - path[D_REACH]
        count += 2
    return kinks[:count]


@kernel
def segment_bounds(
    paths: NDArray[np.float64], profile: NDArray[np.float64], offsets: NDArray[np.float64], pitch: float
) -> NDArray[np.float64]:
    """Return the cage angles at which segments begin and end, rad, from 0 to the pitch.

    ``offsets``: by how much the positions of each row are staggered, rad.
    """
    times = np.empty(0)
    for d in range(paths.shape[0]):
        kinks, rows = path_kinks(paths[d], profile), offsets[int(paths[d, D_ROW]) : int(paths[d, D_ROWS_END])]
        count, earlier = times.shape[0], times
        times = np.empty(count + kinks.shape[0] * rows.shape[0])
        for place in range(count):
            times[place] = earlier[place]
        for kink in kinks:
            for offset in rows:
                time = (kink - offset) - pitch * math.floor((kink - offset) / pitch)
                place = count
                while place > 0 and times[place - 1] > time:
                    times[place] = times[place - 1]
                    place -= 1
                times[place] = time
                count += 1
    bounds = np.empty(times.shape[0] + 2)
    bounds[0] = 0.0
    last = 0
    for time in times:
        if _SAME_ANGLE < time < pitch - _SAME_ANGLE and time - bounds[last] > _SAME_ANGLE:
            last += 1
            bounds[last] = time
    bounds[last + 1] = pitch
    return bounds[: last + 2]


@kernel
def fill_path(
    path: NDArray[np.float64],
    profile: NDArray[np.float64],
    starts: NDArray[np.float64],
    rows: NDArray[np.int64],
    bounds: NDArray[np.float64],
    first: NDArray[np.int64],
    omega: float,
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
) -> None:
    """Write d, m, and omega d', m/s, of balls that start at ``starts`` (D,), rad, in ``rows``, where they are over a
    defect; both have shape (steps, 3, D).

    Segments end on kinks, so within one a ball is either outside the defect, over an edge or on a smooth floor.
    """
    half, cosine = path[D_HALF], path[D_COSINE]
    bottom = touch_angle(path[D_DEPTH] + path[D_ROUGHNESS] * path[D_HIGHEST], path[D_RACE], path[D_BALL])
    for k in range(bounds.shape[0] - 1):
        middle, count = 0.5 * (bounds[k] + bounds[k + 1]), first[k + 1] - first[k]
        width = 0.5 * (bounds[k + 1] - bounds[k]) / count
        for j in range(starts.shape[0]):
            turn = middle + starts[j] - path[D_POSITION]
            x = turn - 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
            side = 1.0 if x > 0.0 else -1.0
            if abs(x) >= half or not path[D_ROW] <= rows[j] < path[D_ROWS_END]:
                continue
            level = (
                path[D_PIECES] == 0.0
                and edge(half - abs(x), path[D_RACE], path[D_BALL], path[D_REACH])[0] > path[D_DEPTH]
            )
            d, slope = cosine * path[D_DEPTH], 0.0
            for m in range(2 * count + 1):
                if not level:
                    nudge = NUDGE if m == 0 else -NUDGE if m == 2 * count else 0.0
                    cage = bounds[k] + m * width + nudge
                    d, slope = _depth(path, profile, half - side * (x + cage - middle), side, cage + starts[j], bottom)
                    d, slope = cosine * d, omega * cosine * slope
                _put(depth, first[k], m, j, d, 2 * count)
                _put(rate, first[k], m, j, slope, 2 * count)


@kernel
def _depth(
    path: NDArray[np.float64], profile: NDArray[np.float64], delta: float, side: float, angle: float, bottom: float
) -> tuple[float, float]:
    """Return the shallower of edge path and floor, m, and its slope, m/rad, ``delta`` within the defect."""
    floor, floor_slope = floor_at(path, profile, angle)
    if delta > bottom:
        return floor, floor_slope
    on_edge, slope = edge(delta, path[D_RACE], path[D_BALL], path[D_REACH])
    if on_edge <= floor or path[D_PIECES] == 0.0:
        return on_edge, -side * slope
    return floor, floor_slope


@kernel
def _put(table: NDArray[np.float64], first: int, node: int, ball: int, value: float, last: int) -> None:
    """Write a value to the step that begins or has its middle at a node, and to the one that ends there."""
    if node < last:
        table[first + node // 2, node % 2, ball] = value
    if node > 0 and node % 2 == 0:
        table[first + node // 2 - 1, 2, ball] = value
