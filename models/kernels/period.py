"""Kernel of one ball period of the six-degree-of-freedom model, by Lawson-RK4 (models.kernels.step).

The damping force sets in like a square root where a ball meets or leaves its contact, which no step of high order
follows. A step in which any ball does so is taken again as SUBSTEPS smaller ones, with the path interpolated between
the nodes of the step.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.kernels.jit import inlined, kernel
from models.kernels.step import STATUS_NOT_FINITE, STATUS_OK, Balls, Nodes, contact, forces, record, step

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.kernels.step import Axis, Flow

# Parts of a step in which a contact opens or closes.
SUBSTEPS = 4


class Period(NamedTuple):
    """One ball period of one scene: its steps in segments, which end at the kinks of the paths.

    Attributes:
        parameter: see the P_ constants of models.kernels.step.
        first: first step of each segment and the number of steps, int64, (segments + 1,); steps within a segment are
            equal.
        flow: step length h, s, then what carries half a step (models.kernels.step.propagators), (segments, 10).
        part: the last nine of ``flow`` for a step of h / SUBSTEPS, (segments, 9).
        advance: cosine and sine of the cage's turn within a step, in steps of h / (2 SUBSTEPS),
            (segments, 2 SUBSTEPS + 1, 2).
        time: of each recorded value since the start of the period, s, (steps + segments,); the ends of neighbouring
            segments are recorded twice, once from either side.
        weight: quadrature weights of the recorded values over the period, so that ``weight @ x`` is a mean.
    """

    parameter: NDArray[np.float64]
    balls: Balls
    nodes: Nodes
    first: NDArray[np.int64]
    flow: NDArray[np.float64]
    part: NDArray[np.float64]
    advance: NDArray[np.float64]
    time: NDArray[np.float64]
    weight: NDArray[np.float64]


@inlined
def _path_within(index: int, node: int, span: float, nodes: Nodes, n: int, within: Nodes) -> None:
    """Write d and omega_c d' at a place within step ``n`` of ``span`` s, from its three nodes (quintic Hermite).

    The place is ``index`` of 2 SUBSTEPS; it is written to row 0, ``node``. In s from -1 to 1 over the step, the
    polynomial has the values and slopes of the nodes at s = -1, 0 and 1.
    """
    depth, rate = nodes.depth, nodes.rate
    s = index / SUBSTEPS - 1.0
    half = 0.5 * span
    for j in range(depth.shape[2]):
        middle, m_slope = depth[n, 1, j], half * rate[n, 1, j]
        even = 0.5 * (depth[n, 2, j] + depth[n, 0, j]) - middle
        odd = 0.5 * (depth[n, 2, j] - depth[n, 0, j]) - m_slope
        even_slope = 0.5 * half * (rate[n, 2, j] - rate[n, 0, j])
        odd_slope = 0.5 * half * (rate[n, 2, j] + rate[n, 0, j]) - m_slope
        a4, a5 = 0.5 * even_slope - even, 0.5 * (odd_slope - 3.0 * odd)
        a2, a3 = even - a4, odd - a5
        within.depth[0, node, j] = middle + s * (m_slope + s * (a2 + s * (a3 + s * (a4 + s * a5))))
        within.rate[0, node, j] = (m_slope + s * (2.0 * a2 + s * (3.0 * a3 + s * (4.0 * a4 + s * 5.0 * a5)))) / half


@inlined
def flow_row(values: NDArray[np.float64], row: int, offset: int) -> Flow:
    """Return nine entries of a row, which carry half a step."""
    return (
        values[row, offset],
        values[row, offset + 1],
        values[row, offset + 2],
        values[row, offset + 3],
        values[row, offset + 4],
        values[row, offset + 5],
        values[row, offset + 6],
        values[row, offset + 7],
        values[row, offset + 8],
    )


@kernel
def _refined_step(x1: Axis, x2: Axis, h: float, e: Flow, period: Period, segment: int, n: int) -> tuple[Axis, Axis]:
    """Return both axes after step ``n`` taken in SUBSTEPS parts; ``e`` carries half of a part."""
    turn, advance, count = period.nodes.turn, period.advance, period.balls.moved.shape[1]
    within = Nodes(np.empty((1, 3, 2)), np.empty((1, 3, count)), np.empty((1, 3, count)), None)
    for part in range(SUBSTEPS):
        for node in range(3):
            index = 2 * part + node
            c, s = advance[segment, index, 0], advance[segment, index, 1]
            within.turn[0, node, 0] = turn[n, 0, 0] * c - turn[n, 0, 1] * s
            within.turn[0, node, 1] = turn[n, 0, 1] * c + turn[n, 0, 0] * s
            _path_within(index, node, h, period.nodes, n, within)
        x1, x2, _, _, _ = step(x1, x2, h / SUBSTEPS, e, period.parameter, forces, (period.balls, within), np.int64(0))
    return x1, x2


@kernel
def ball_period(
    state: NDArray[np.float64], state_out: NDArray[np.float64], wave: NDArray[np.float64], period: Period
) -> int:
    """Carry the state over one ball period; return a STATUS_ number.

    ``state`` and ``state_out`` (2, 6): see models.kernels.step. ``wave`` (steps + segments, 2), written: acceleration
    of outer ring and resonator in the sensor's direction, m/s2, at both ends of every step, each segment with its own
    two ends.
    """
    p, balls, nodes, first, flow = period.parameter, period.balls, period.nodes, period.first, period.flow
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    for segment in range(first.shape[0] - 1):
        h = flow[segment, 0]
        e, e_part = flow_row(flow, segment, 1), flow_row(period.part, segment, 0)
        for n in range(first[segment], first[segment + 1]):
            y1, y2, g1, g2, changed = step(x1, x2, h, e, p, forces, (balls, nodes), n)
            record(wave, n + segment, x1, x2, g1, g2, p)
            if changed:
                y1, y2 = _refined_step(x1, x2, h, e_part, period, segment, n)
            x1, x2 = y1, y2
        last = first[segment + 1] - 1
        g1, g2, _ = contact(x1, x2, p, balls, nodes, last, np.int64(2))
        record(wave, last + segment + 1, x1, x2, g1, g2, p)
    bad = False
    for k in range(6):
        state_out[0, k], state_out[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
