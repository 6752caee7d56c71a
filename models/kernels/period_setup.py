"""Kernels that set up one ball period: positions, steps, propagators, quadrature (arrays: models.kernels.six_dof)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from models.kernels.jit import kernel
from models.kernels.path import D_HALF, D_POSITION, fill_path, segment_bounds
from models.kernels.six_dof import NEAR_SLOPE, SUBSTEPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Tables = tuple[
        NDArray[np.int64], Floats, Floats, Floats, Floats, Floats, Floats, int, Floats, Floats, Floats, Floats
    ]

_NEAR_ANGLE = math.pi / 2.0 + math.atan(NEAR_SLOPE)


@kernel
def arc_distance(start: float, length: float, angle: float) -> float:
    """Return the distance of an angle from the arc that begins at ``start``, rad, zero inside."""
    off = start + 0.5 * length - angle
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    return max(0.0, abs(off) - 0.5 * length)


@kernel
def split_positions(
    path: NDArray[np.float64], positions: NDArray[np.float64], rows: NDArray[np.int64], damaged_rows: int, pitch: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], int]:
    """Return the start of the balls that the defect can touch, rad, the kernel's ``damaged``, ``plain`` and ``near``.

    Arguments are those of ``set_up``; ``damaged_rows`` is how many rows have the defect.
    """
    count = positions.shape[0]
    touches = np.zeros(count, dtype=np.bool_)
    d = 0
    for i in range(count):
        if rows[i] < damaged_rows and arc_distance(positions[i], pitch, path[D_POSITION]) < path[D_HALF]:
            touches[i] = True
            d += 1
    starts, damaged, plain = np.empty(d), np.empty((3, d)), np.empty((3, count - d))
    here, there, near = 0, 0, 0
    power = 1.0
    for i in range(count):
        c, s = math.cos(positions[i]), math.sin(positions[i])
        if touches[i]:
            starts[here] = positions[i]
            damaged[0, here], damaged[1, here], damaged[2, here] = c, s, power
            here += 1
        else:
            plain[0, there], plain[1, there], plain[2, there] = c, s, power
            there += 1
            if arc_distance(positions[i], pitch, 0.0) <= _NEAR_ANGLE:
                near += 1
        power *= 2.0
    return starts, damaged, plain, near


@kernel
def first_steps(bounds: NDArray[np.float64], steps: int, pitch: float) -> NDArray[np.int64]:
    """Return the first step of each segment, and the number of steps, for at least ``steps`` steps a pitch."""
    first = np.zeros(bounds.shape[0], dtype=np.int64)
    for k in range(bounds.shape[0] - 1):
        count = math.ceil((bounds[k + 1] - bounds[k]) * (steps / pitch) - 1e-9)
        first[k + 1] = first[k] + max(1, count)
    return first


@kernel
def oscillator(omega_squared: float, damping: float, h: float) -> tuple[float, float, float, float]:
    """Return the propagator over a time h of x'' + damping x' + omega_squared x = 0, row by row of (x, x')."""
    half = 0.5 * damping
    under = omega_squared - half * half
    decay = math.exp(-half * h)
    if under > 0.0:
        w = math.sqrt(under)
        c, s = math.cos(w * h), math.sin(w * h) / w
    elif under < 0.0:
        w = math.sqrt(-under)
        c, s = math.cosh(w * h), math.sinh(w * h) / w
    else:
        c, s = 1.0, h
    return decay * (c + half * s), decay * s, -decay * omega_squared * s, decay * (c - half * s)


@kernel
def _propagators(linear: NDArray[np.float64], h: float, row: NDArray[np.float64]) -> None:
    """Write the propagators that carry half of a step of length h, s (``flow`` without its first column)."""
    row[0], row[1], row[2], row[3] = oscillator(linear[0], linear[1], 0.5 * h)
    row[4] = 0.5 * h
    row[5], row[6], row[7], row[8] = oscillator(linear[2], linear[3], 0.5 * h)


@kernel
def fill_flow(
    linear: NDArray[np.float64], bounds: NDArray[np.float64], first: NDArray[np.int64], omega: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the kernel's ``flow``, ``part`` and ``advance``.

    ``linear`` (4): squared angular frequency and damping rate of the inner ring, and of the resonator on the outer.
    """
    segments = bounds.shape[0] - 1
    flow, part = np.empty((segments, 10)), np.empty((segments, 9))
    advance = np.empty((segments, 2 * SUBSTEPS + 1, 2))
    for k in range(segments):
        turn = (bounds[k + 1] - bounds[k]) / (first[k + 1] - first[k])
        flow[k, 0] = turn / omega
        _propagators(linear, flow[k, 0], flow[k, 1:])
        _propagators(linear, flow[k, 0] / SUBSTEPS, part[k])
        for m in range(2 * SUBSTEPS + 1):
            angle = turn * (m / (2.0 * SUBSTEPS))
            advance[k, m, 0], advance[k, m, 1] = math.cos(angle), math.sin(angle)
    return flow, part, advance


@kernel
def fill_turn(bounds: NDArray[np.float64], first: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the kernel's ``turn``: by rotation within a segment, anew at each of its beginnings."""
    turn = np.empty((first[-1], 3, 2))
    for k in range(bounds.shape[0] - 1):
        width = 0.5 * (bounds[k + 1] - bounds[k]) / (first[k + 1] - first[k])
        c, s = math.cos(bounds[k]), math.sin(bounds[k])
        step_c, step_s = math.cos(width), math.sin(width)
        for n in range(first[k], first[k + 1]):
            for node in range(3):
                turn[n, node, 0], turn[n, node, 1] = c, s
                if node < 2:
                    c, s = c * step_c - s * step_s, s * step_c + c * step_s
    return turn


@kernel
def add_quadrature(weight: NDArray[np.float64], scale: float) -> None:
    """Write weights of fourth order for equal steps of length ``scale`` between the values, shape (steps + 1,).

    The trapezoid rule with Gregory's end corrections; closed Newton-Cotes rules where there are too few steps for them.
    """
    steps = weight.shape[0] - 1
    weight[:] = scale
    if steps == 1:
        weight[0] = weight[1] = scale / 2.0
    elif steps == 2:
        weight[0] = weight[2] = scale / 3.0
        weight[1] = scale * 4.0 / 3.0
    elif steps == 3:
        weight[0] = weight[3] = scale * 3.0 / 8.0
        weight[1] = weight[2] = scale * 9.0 / 8.0
    elif steps == 4:
        weight[0] = weight[4] = scale * 14.0 / 45.0
        weight[1] = weight[3] = scale * 64.0 / 45.0
        weight[2] = scale * 24.0 / 45.0
    else:
        for end in (0, steps):
            inwards = 1 if end == 0 else -1
            weight[end] -= scale * 5.0 / 8.0
            weight[end + inwards] += scale / 6.0
            weight[end + 2 * inwards] -= scale / 24.0


@kernel
def fill_values(
    bounds: NDArray[np.float64], first: NDArray[np.int64], omega: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the time of each recorded value, s, and its weight in a mean over the period, (steps + segments,) each."""
    segments = bounds.shape[0] - 1
    time, weight = np.empty(first[-1] + segments), np.empty(first[-1] + segments)
    for k in range(segments):
        start, count = first[k] + k, first[k + 1] - first[k]
        width = (bounds[k + 1] - bounds[k]) / count
        add_quadrature(weight[start : start + count + 1], width / bounds[-1])
        for m in range(count + 1):
            time[start + m] = (bounds[k] + m * width) / omega
    return time, weight


@kernel
def set_up(
    path: NDArray[np.float64],
    profile: NDArray[np.float64],
    positions: NDArray[np.float64],
    rows: NDArray[np.int64],
    offsets: NDArray[np.float64],
    pitch: float,
    steps: int,
    omega: float,
    linear: NDArray[np.float64],
) -> Tables:
    """Return all tables of one ball period.

    Args:
        path, profile: the defect and its floor (models.kernels.path).
        positions: of all balls at the start of the period, rad, sorted by their distance from the load direction.
        rows: the row of each.
        offsets: stagger of the rows that have the defect, the first of all rows, rad; none where nothing is damaged.
        pitch: angle between neighbours of a row, rad.
        steps: least number of steps.
        omega: cage speed, rad/s.
        linear: see ``fill_flow``.

    Returns:
        ``first``, ``flow``, ``part``, ``turn``, ``advance``, ``damaged``, ``plain``, ``near``, ``depth`` and ``rate``
        of the kernel, time of each recorded value, s, and its weight in a mean over the period.
    """
    starts, damaged, plain, near = split_positions(path, positions, rows, offsets.shape[0], pitch)
    bounds = segment_bounds(path, profile, offsets if starts.shape[0] > 0 else offsets[:0], pitch)
    first = first_steps(bounds, steps, pitch)
    flow, part, advance = fill_flow(linear, bounds, first, omega)
    turn = fill_turn(bounds, first)
    depth, rate = np.empty((first[-1], 3, starts.shape[0])), np.empty((first[-1], 3, starts.shape[0]))
    fill_path(path, profile, starts, bounds, first, omega, depth, rate)
    time, weight = fill_values(bounds, first, omega)
    return first, flow, part, turn, advance, damaged, plain, near, depth, rate, time, weight
