"""Kernels that set up one ball period: positions, steps, propagators, quadrature (``period.Period``)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import kernel
from models.solve.six_dof.kernels.path import D_HALF, D_POSITION, D_ROW, D_ROWS_END, fill_path, segment_bounds
from models.solve.six_dof.kernels.period import Period, add_quadrature
from models.solve.six_dof.kernels.step import NEAR_SLOPE, P_OMEGA, P_PITCH, Balls, StepNodes, propagators

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index

_NEAR_ANGLE = math.pi / 2.0 + math.atan(NEAR_SLOPE)


class OperatingPoint(NamedTuple):
    """What all scenes share that differ in an outer-race defect only.

    Attributes:
        parameter: see the P_ constants of models.solve.six_dof.kernels.step.
        positions: of all balls at the start of the period, rad, sorted by their distance from the load direction.
        rows: the row of each, int64.
        offsets: stagger of each row, rad.
        waves: amplitude along the contact, m, order and phase, rad, of each wave of the outer race, (W, 3).
        power: see ``models.solve.six_dof.kernels.step.Balls``.
    """

    parameter: NDArray[np.float64]
    positions: NDArray[np.float64]
    rows: NDArray[np.int64]
    offsets: NDArray[np.float64]
    waves: NDArray[np.float64]
    power: float


@kernel
def arc_distance(start: float, length: float, angle: float) -> float:
    """Return the distance of an angle from the arc that begins at ``start``, rad, zero inside."""
    off = start + 0.5 * length - angle
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    return max(0.0, abs(off) - 0.5 * length)


@kernel
def _is_touched(paths: NDArray[np.float64], position: float, row: Index, pitch: float) -> bool:
    """Return whether a ball that starts at a position of a row, rad, comes to a defect within a pitch."""
    for d in range(paths.shape[0]):
        in_row = paths[d, D_ROW] <= row < paths[d, D_ROWS_END]
        if in_row and arc_distance(position, pitch, paths[d, D_POSITION]) < paths[d, D_HALF]:
            return True
    return False


@kernel
def split_positions(
    paths: NDArray[np.float64], point: OperatingPoint
) -> tuple[NDArray[np.float64], NDArray[np.int64], int, Balls]:
    """Return the start of the moved balls, rad, their rows, how many of them, the first, defects can touch, and all.

    Every ball is moved where the race has waves.
    """
    positions, count = point.positions, point.positions.shape[0]
    pitch, waves = point.parameter[P_PITCH], point.waves.shape[0] > 0
    touches = np.zeros(count, dtype=np.bool_)
    d = 0
    for i in range(count):
        touches[i] = _is_touched(paths, positions[i], point.rows[i], pitch)
        d += 1 if touches[i] else 0
    m = count if waves else d
    starts, rows, moved, plain = np.empty(m), np.empty(m, np.int64), np.empty((3, m)), np.empty((3, count - m))
    here, there, near = 0, 0, 0
    power = 1.0
    for second in range(2):
        for i in range(count):
            if touches[i] != (second == 0):
                continue
            c, s = math.cos(positions[i]), math.sin(positions[i])
            if touches[i] or waves:
                starts[here], rows[here] = positions[i], point.rows[i]
                moved[0, here], moved[1, here], moved[2, here] = c, s, power
                here += 1
            else:
                plain[0, there], plain[1, there], plain[2, there] = c, s, power
                there += 1
                if arc_distance(positions[i], pitch, 0.0) <= _NEAR_ANGLE:
                    near += 1
            power *= 2.0
    return starts, rows, d, Balls(moved, plain, m, near, point.power)


@kernel
def _first_steps(bounds: NDArray[np.float64], steps: int, least: int, fold: int, pitch: float) -> NDArray[np.int64]:
    """Return the first step of each segment, and the number of steps.

    There are ``fold`` times at least ``steps`` a pitch, and ``least`` a segment.
    """
    first = np.zeros(bounds.shape[0], dtype=np.int64)
    for k in range(bounds.shape[0] - 1):
        count = math.ceil((bounds[k + 1] - bounds[k]) * (steps / pitch) - 1e-9)
        first[k + 1] = first[k] + fold * max(least, count)
    return first


@kernel
def _fill_flow(
    parameter: NDArray[np.float64], bounds: NDArray[np.float64], first: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the period's ``flow``."""
    segments = bounds.shape[0] - 1
    flow = np.empty((segments, 10))
    for k in range(segments):
        h = (bounds[k + 1] - bounds[k]) / (first[k + 1] - first[k]) / parameter[P_OMEGA]
        flow[k, 0] = h
        whole = propagators(parameter, h)
        for i in range(9):
            flow[k, i + 1] = whole[i]
    return flow


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
def add_waves(
    waves: NDArray[np.float64],
    starts: NDArray[np.float64],
    bounds: NDArray[np.float64],
    first: NDArray[np.int64],
    omega: float,
    nodes: StepNodes,
) -> None:
    """Add the waves of the outer race to the path of all balls, which start at ``starts``, rad."""
    for k in range(bounds.shape[0] - 1):
        width = 0.5 * (bounds[k + 1] - bounds[k]) / (first[k + 1] - first[k])
        for n in range(first[k], first[k + 1]):
            for node in range(3):
                cage = bounds[k] + (2 * (n - first[k]) + node) * width
                for j in range(starts.shape[0]):
                    for w in range(waves.shape[0]):
                        angle = waves[w, 1] * (cage + starts[j]) + waves[w, 2]
                        nodes.depth[n, node, j] += waves[w, 0] * math.cos(angle)
                        nodes.rate[n, node, j] -= waves[w, 0] * waves[w, 1] * omega * math.sin(angle)


@kernel
def set_up(
    paths: NDArray[np.float64],
    profile: NDArray[np.float64],
    point: OperatingPoint,
    steps: int,
    least: int,
    fold: int,
) -> Period:
    """Return one ball period of a scene.

    Args:
        paths, profile: the defects and their floors (models.solve.six_dof.kernels.path).
        steps, least, fold: ``fold`` times at least ``steps`` a period and ``least`` a segment.
    """
    omega, pitch = point.parameter[P_OMEGA], point.parameter[P_PITCH]
    starts, rows, touched, balls = split_positions(paths, point)
    if touched == 0:
        paths = paths[:0]
    bounds = segment_bounds(paths, profile, point.offsets, pitch)
    first = _first_steps(bounds, steps, least, fold, pitch)
    flow = _fill_flow(point.parameter, bounds, first)
    shape = (first[-1], 3, balls.moved.shape[1])
    nodes = StepNodes(fill_turn(bounds, first), np.zeros(shape), np.zeros(shape), None)
    for path in paths:
        fill_path(path, profile, starts[:touched], rows, bounds, first, omega, nodes.depth, nodes.rate)
    if point.waves.shape[0] > 0:
        add_waves(point.waves, starts, bounds, first, omega, nodes)
    time, weight = fill_values(bounds, first, omega)
    return Period(point.parameter, balls, nodes, first, flow, time, weight)
