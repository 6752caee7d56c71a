"""Kernels that tabulate the paths of the balls for many scenes at once; arrays as in ``lanes``.

The path is that of models/path/defect.py: the shallower of edge path (Eq. 51) and floor. Its geometry comes as ``path``
(7, L), see the D_ constants, and ``profiles`` (p, pieces, 4): cubic pieces of the rough floors that the lanes name,
highest power first, each once around the race.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.lane_instants import LANES, ON_THE_END, passed_after

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.lane_instants import Splitting

# Rows of ``path``.
D_HALF = 0  # half the extent, rad; not positive where a lane has no defect
D_DEPTH = 1  # h_d, m
D_POSITION = 2  # angle of the centre, rad
D_ROUGHNESS = 3  # factor on the profile
D_PROFILE = 4  # index of the profile
D_BEYOND = 5  # angle beyond an edge from which on a ball is on the floor for certain, rad
PATH_ROWS = 6

# Places in ``geometry``.
G_R_O = 0
G_R_B = 1
G_COS_ALPHA = 2
G_REACH = 3  # angle beyond the edge at which the edge path ends, rad
G_OMEGA = 4  # cage speed, rad/s
G_STEP = 5  # step, s
GEOMETRY = 6

_TURN = 2.0 * math.pi


@inlined
def _edge(delta: float, geometry: NDArray[np.float64]) -> tuple[float, float]:
    """Return edge path, m, and slope, m/rad; the series are exact to rounding up to a quarter of a radian."""
    x = min(delta, geometry[G_REACH])
    y = x * x
    sine = x * (1.0 - y / 6.0 * (1.0 - y / 20.0 * (1.0 - y / 42.0 * (1.0 - y / 72.0 * (1.0 - y / 110.0)))))
    versine = 0.5 * y * (1.0 - y / 12.0 * (1.0 - y / 30.0 * (1.0 - y / 56.0 * (1.0 - y / 90.0 * (1.0 - y / 132.0)))))
    r_o, r_b = geometry[G_R_O], geometry[G_R_B]
    along = r_o * sine
    root = math.sqrt(r_b * r_b - along * along)
    depth = along * along / (r_b + root) - r_o * versine
    slope = along * (r_o * (1.0 - versine) / root - 1.0) if delta <= geometry[G_REACH] else 0.0
    return depth, slope


@inlined
def _path_at(
    angle: float, i: int, path: NDArray[np.float64], profiles: NDArray[np.float64], geometry: NDArray[np.float64]
) -> tuple[float, float]:
    """Return d, m, and d', m/rad, of lane ``i`` at an angle."""
    x = angle - path[D_POSITION, i]
    x -= _TURN * math.floor(x / _TURN + 0.5)
    delta = path[D_HALF, i] - abs(x)
    if delta <= 0.0:
        return 0.0, 0.0
    depth, slope = path[D_DEPTH, i], 0.0
    if path[D_ROUGHNESS, i] > 0.0:
        pieces = profiles.shape[1]
        spacing = _TURN / pieces
        around = angle - _TURN * math.floor(angle / _TURN)
        piece = min(int(around / spacing), pieces - 1)
        z = around - piece * spacing
        p = int(path[D_PROFILE, i])
        c3, c2, c1, c0 = (
            profiles[p, piece, 0],
            profiles[p, piece, 1],
            profiles[p, piece, 2],
            profiles[p, piece, 3],
        )
        depth += path[D_ROUGHNESS, i] * (((c3 * z + c2) * z + c1) * z + c0)
        slope = path[D_ROUGHNESS, i] * ((3.0 * c3 * z + 2.0 * c2) * z + c1)
    if delta < path[D_BEYOND, i]:
        edge, edge_slope = _edge(delta, geometry)
        if edge <= depth:
            depth, slope = edge, -math.copysign(edge_slope, x)
    return geometry[G_COS_ALPHA] * depth, geometry[G_COS_ALPHA] * slope


@kernel
def fill(
    begin: int,
    end: int,
    cage: NDArray[np.float64],
    start: NDArray[np.float64],
    path: NDArray[np.float64],
    profiles: NDArray[np.float64],
    geometry: NDArray[np.float64],
    depth: NDArray[np.float64],
    rate: NDArray[np.float64],
) -> None:
    """Write ``depth`` and ``rate`` of steps ``begin`` to ``end``.

    ``cage`` (n,) is the cage angle at the beginning of each step, ``start`` (k, L) the angles of the damaged slots.
    """
    omega = geometry[G_OMEGA]
    turn = omega * geometry[G_STEP]
    for n in range(begin, end):
        follows = n > begin and cage[n] > cage[n - 1]
        for k in range(start.shape[0]):
            for i in range(LANES):
                angle = cage[n] + start[k, i]
                if follows:
                    d0, r0 = depth[n - 1, 2, k, i], rate[n - 1, 2, k, i] / omega
                else:
                    d0, r0 = _path_at(angle, i, path, profiles, geometry)
                d1, _ = _path_at(angle + 0.5 * turn, i, path, profiles, geometry)
                d2, r2 = _path_at(angle + turn, i, path, profiles, geometry)
                depth[n, 0, k, i], depth[n, 1, k, i], depth[n, 2, k, i] = d0, d1, d2
                rate[n, 0, k, i], rate[n, 2, k, i] = omega * r0, omega * r2
                # Simpson's rule over the three slopes then gives the change of depth, kink or not.
                rate[n, 1, k, i] = omega * (1.5 * (d2 - d0) / turn - 0.25 * (r0 + r2))


@kernel
def redraw(
    draws: NDArray[np.float64],
    slip: NDArray[np.float64],
    ring: NDArray[np.float64],
    damaged_at: NDArray[np.int64],
    plain_at: NDArray[np.int64],
    start: NDArray[np.float64],
    damaged: NDArray[np.float64],
    plain: NDArray[np.float64],
) -> None:
    """Begin a period in which every ball stands off by its own angle: move balls on, redraw those at the far point.

    - ``draws`` (rows, L): angles for the balls that pass the point opposite to the load in this period, rad.
    - ``slip`` (slots, L): angle by which the ball in each slot of the ring stands off, rad, updated.
    - ``ring`` (slots,): angles of all slots, ascending; a ball moves on by ``rows`` slots a period.
    - ``damaged_at``, ``plain_at``, int64: places of the damaged and the plain slots in the ring.
    - ``start`` (k, L), ``damaged``, ``plain``, written: as in ``fill`` and ``advance``, with the angles added.
    """
    rows = draws.shape[0]
    for j in range(ring.shape[0] - 1, rows - 1, -1):
        for i in range(LANES):
            slip[j, i] = slip[j - rows, i]
    for j in range(rows):
        for i in range(LANES):
            slip[j, i] = draws[j, i]
    for k in range(damaged_at.shape[0]):
        for i in range(LANES):
            angle = ring[damaged_at[k]] + slip[damaged_at[k], i]
            start[k, i] = angle
            damaged[k, 0, i], damaged[k, 1, i] = math.cos(angle), math.sin(angle)
    for j in range(plain_at.shape[0]):
        for i in range(LANES):
            angle = ring[plain_at[j]] + slip[plain_at[j], i]
            plain[j, 0, i], plain[j, 1, i] = math.cos(angle), math.sin(angle)


@kernel
def mark_kinks(begin: int, end: int, bounds: NDArray[np.int64], turn: float, split: Splitting) -> None:
    """Write ``marks`` of steps ``begin`` to ``end``, in each of which the cage turns by ``turn``, rad.

    ``bounds``: first step of each ball period, and the number of steps.
    """
    split.marks[begin:end] = 0
    for period in range(bounds.shape[0] - 1):
        first, stop = bounds[period], bounds[period + 1]
        if first < begin or stop > end:
            continue
        for i in range(LANES):
            for kink in split.kinks[i]:
                if not math.isfinite(kink):
                    break
                for k in range(split.start.shape[0]):
                    at = passed_after(kink, split.start[k, i]) - split.cage[first]
                    for side in (-ON_THE_END, ON_THE_END):
                        n = first + math.floor((at + side) / turn)
                        if first <= n < stop:
                            split.marks[n] |= 1 << i
