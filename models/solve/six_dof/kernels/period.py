"""Kernel of one ball period of the six-degree-of-freedom model, by Lawson-RK4 (models.solve.six_dof.kernels.step).

The damping force sets in with a jump, and like a square root, where a ball meets or leaves its contact, which no step
of high order follows. A step in which any ball does so is taken again in parts, which are divided again where the
contact changes within them, with the path interpolated between the nodes of the step. A mean over the period takes such
a step from its parts: a rule of quadrature that runs over the jump would be wrong by a share of the step.

Kernels of quadrature weights over a ball period: fourth order between the places where contacts change.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.step import (
    P_OMEGA,
    STATUS_NOT_FINITE,
    STATUS_OK,
    Balls,
    StepNodes,
    accelerations,
    contact,
    forces,
    propagators,
    step,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.solve.six_dof.kernels.step import Axis, Flow


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
def fill_weights(
    flow: NDArray[np.float64],
    first: NDArray[np.int64],
    smooth: NDArray[np.float64],
    changed: NDArray[np.bool_],
    any_changed: bool,
    weight: NDArray[np.float64],
) -> None:
    """Write the weights of a period's values, in which the steps ``changed`` have no part.

    Args:
        flow, first: see models.solve.six_dof.kernels.period.Period.
        smooth: the weights where no step is changed.
        any_changed: whether one is.
        weight: written, (steps + segments,).
    """
    if not any_changed:
        weight[:] = smooth
        return
    duration = 0.0
    for k in range(first.shape[0] - 1):
        duration += flow[k, 0] * (first[k + 1] - first[k])
    weight[:] = 0.0
    for k in range(first.shape[0] - 1):
        begin = first[k]
        for n in range(first[k], first[k + 1] + 1):
            if n < first[k + 1] and not changed[n]:
                continue
            if n > begin:
                add_quadrature(weight[begin + k : n + k + 1], flow[k, 0] / duration)
            begin = n + 1


# A step in which contacts change is divided into so many parts, and again each part in which they change, until a part
# is one in so many of the step. The damping of a line contact sets in as the ninth root of the approach, nearly a jump.
SUBSTEPS = 4
FINEST_OF_BALLS = SUBSTEPS**3
FINEST_OF_ROLLERS = SUBSTEPS**4


class Period(NamedTuple):
    """One ball period of one scene: its steps in segments, which end at the kinks of the paths.

    Attributes:
        parameter: see the P_ constants of models.solve.six_dof.kernels.step.
        first: first step of each segment and the number of steps, int64, (segments + 1,); steps within a segment are
            equal.
        flow: step length h, s, then what carries half a step (models.solve.six_dof.kernels.step.propagators),
            (segments, 10).
        time: of each recorded value since the start of the period, s, (steps + segments,); the ends of neighbouring
            segments are recorded twice, once from either side.
        weight: quadrature weights of the recorded values over the period where no contact changes, so that
            ``weight @ x`` is a mean.
    """

    parameter: NDArray[np.float64]
    balls: Balls
    nodes: StepNodes
    first: NDArray[np.int64]
    flow: NDArray[np.float64]
    time: NDArray[np.float64]
    weight: NDArray[np.float64]


class PeriodTrace(NamedTuple):
    """What a period records; values in m/s2.

    Attributes:
        wave: acceleration of outer ring and resonator in the sensor's direction at both ends of every step, each
            segment with its own two ends, (steps + segments, 2).
        weight: quadrature weights of ``wave``, (steps + segments,): the values of each run of steps without a change
            of contact have a rule of their own.
        parts: of the steps in which contacts change, their share in the mean over the period of both accelerations and
            of both squares, (steps, 4); zero for all other steps.
        changed: whether contacts change in a step, (steps,).
    """

    wave: NDArray[np.float64]
    weight: NDArray[np.float64]
    parts: NDArray[np.float64]
    changed: NDArray[np.bool_]


@kernel
def blank_trace(period: Period) -> PeriodTrace:
    """Return room for what a period records."""
    steps, values = period.nodes.turn.shape[0], period.time.shape[0]
    return PeriodTrace(
        np.zeros((values, 2)), period.weight.copy(), np.zeros((steps, 4)), np.zeros(steps, dtype=np.bool_)
    )


@kernel
def mean_square(trace: PeriodTrace, sensor: int) -> float:
    """Return the mean square of a recorded period, m2/s4; ``sensor`` is 0 for the outer ring, 1 for the resonator."""
    total = 0.0
    for i in range(trace.weight.shape[0]):
        total += trace.weight[i] * trace.wave[i, sensor] * trace.wave[i, sensor]
    for n in range(trace.changed.shape[0]):
        if trace.changed[n]:
            total += trace.parts[n, 2 + sensor]
    return max(total, 0.0)


@inlined
def _path_within(place: float, node: int, span: float, nodes: StepNodes, n: int, within: StepNodes) -> None:
    """Write d and omega_c d' at a place within step ``n`` of ``span`` s, from its three nodes (quintic Hermite).

    The place, from 0 to 1, is written to row 0, ``node``. In s from -1 to 1 over the step, the polynomial has the
    values and slopes of the nodes at s = -1, 0 and 1.
    """
    depth, rate = nodes.depth, nodes.rate
    s = 2.0 * place - 1.0
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


@inlined
def _add(parts: NDArray[np.float64], n: int, weight: float, a_o: float, a_r: float) -> None:
    """Add the accelerations of outer ring and resonator and their squares to the row of a step."""
    parts[n, 0] += weight * a_o
    parts[n, 1] += weight * a_r
    parts[n, 2] += weight * a_o * a_o
    parts[n, 3] += weight * a_r * a_r


@kernel
def _divided_step(
    x1: Axis, x2: Axis, h: float, share: float, period: Period, n: int, parts: NDArray[np.float64]
) -> tuple[Axis, Axis]:
    """Return both axes after step ``n`` taken in parts, and write its share in the means over the period.

    ``share`` is that of the step in the period.
    """
    p, turn, count = period.parameter, period.nodes.turn, period.balls.moved.shape[1]
    within = StepNodes(np.empty((1, 3, 2)), np.empty((1, 3, count)), np.empty((1, 3, count)), None)
    zero, finest = np.int64(0), FINEST_OF_BALLS if period.balls.power == 0.5 else FINEST_OF_ROLLERS
    place, size = 0, finest // SUBSTEPS
    e, known = propagators(p, h * size / finest), size
    before = 0
    parts[n] = 0.0
    while place < finest:
        length = h * size / finest
        if known != size:
            e, known = propagators(p, length), size
        for node in range(3):
            at = (place + 0.5 * node * size) / finest
            c, s = math.cos(p[P_OMEGA] * h * at), math.sin(p[P_OMEGA] * h * at)
            within.turn[0, node, 0] = turn[n, 0, 0] * c - turn[n, 0, 1] * s
            within.turn[0, node, 1] = turn[n, 0, 1] * c + turn[n, 0, 0] * s
            _path_within(at, node, h, period.nodes, n, within)
        y1, y2, g1, g2, changed = step(x1, x2, length, e, p, forces, (period.balls, within), zero)
        if changed and size > 1:
            size //= SUBSTEPS
            continue
        # The trapezoid rule: half of the part before and half of this one belong to the value between them.
        a_o, a_r = accelerations(x1, x2, g1, g2, p)
        weight = share * 0.5 * (before + size) / finest
        _add(parts, n, weight, a_o, a_r)
        before = size
        x1, x2 = y1, y2
        place += size
        while size < finest // SUBSTEPS and place % (SUBSTEPS * size) == 0:
            size *= SUBSTEPS
    g1, g2, _ = contact(x1, x2, p, period.balls, period.nodes, n, np.int64(2), 0.0)
    a_o, a_r = accelerations(x1, x2, g1, g2, p)
    weight = share * 0.5 * before / finest
    _add(parts, n, weight, a_o, a_r)
    return x1, x2


@kernel
def ball_period(state: NDArray[np.float64], state_out: NDArray[np.float64], trace: PeriodTrace, period: Period) -> int:
    """Carry the state over one ball period and write its ``trace``; return a STATUS_ number.

    ``state`` and ``state_out`` (2, 6): see models.solve.six_dof.kernels.step.
    """
    p, balls, nodes, first, flow = period.parameter, period.balls, period.nodes, period.first, period.flow
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    wave, any_changed = trace.wave, False
    for segment in range(first.shape[0] - 1):
        h = flow[segment, 0]
        e = flow_row(flow, segment, 1)
        for n in range(first[segment], first[segment + 1]):
            y1, y2, g1, g2, changed = step(x1, x2, h, e, p, forces, (balls, nodes), n)
            wave[n + segment, 0], wave[n + segment, 1] = accelerations(x1, x2, g1, g2, p)
            trace.changed[n] = changed
            if changed:
                any_changed = True
                y1, y2 = _divided_step(x1, x2, h, h / period.time[-1], period, n, trace.parts)
            x1, x2 = y1, y2
        last = first[segment + 1] - 1
        g1, g2, _ = contact(x1, x2, p, balls, nodes, last, np.int64(2), 0.0)
        wave[last + segment + 1, 0], wave[last + segment + 1, 1] = accelerations(x1, x2, g1, g2, p)
    fill_weights(flow, first, period.weight, trace.changed, any_changed, trace.weight)
    bad = False
    for k in range(6):
        state_out[0, k], state_out[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
