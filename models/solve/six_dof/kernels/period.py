"""Kernel of one ball period of the six-degree-of-freedom model, by Lawson-RK4 (models.solve.six_dof.kernels.step).

A step in which a ball meets or leaves its contact, or that is near to one, is taken again in parts
(models.solve.six_dof.kernels.instants). A mean over the period takes such a step from its parts: a rule of quadrature
that runs over the jump of the damping force would be wrong by a share of the step.

Kernels of quadrature weights over a ball period: fourth order between the places where contacts change.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.instants import retake
from models.solve.six_dof.kernels.parts import MEANS, SUMS, Room, make_room
from models.solve.six_dof.kernels.step import (
    STATUS_NOT_FINITE,
    STATUS_OK,
    Balls,
    StepNodes,
    accelerations,
    contact,
    forces,
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
def copy_values(values: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Write values, (n,), to others; ``out[:] = values`` compiles the text of an error of shapes as well."""
    for i in range(out.shape[0]):
        out[i] = values[i]


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
        copy_values(smooth, weight)
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


# Time from an instant at which contacts change over the period within which steps are graded, where a step is shorter:
# outside of it what is left of the root with which damping sets in is lost on steps of any length.
REACH = 1.0 / 400.0


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
        parts: of the steps that are taken in parts, their share in the mean over the period of both accelerations,
            both squares, and both accelerations times the time from the middle of the step, s m/s2, and the largest
            sizes of both, (steps, SUMS).
        changed: whether a step was taken in parts, because contacts change in it or near it, (steps,).
        instants: how many contacts change in a step, int64, (steps,).
        grazing: how many times a gap nearly touches zero in a step, so that a coarser one may not tell on which side,
            int64, (steps,).
    """

    wave: NDArray[np.float64]
    weight: NDArray[np.float64]
    parts: NDArray[np.float64]
    changed: NDArray[np.bool_]
    instants: NDArray[np.int64]
    grazing: NDArray[np.int64]


@kernel
def blank_trace(period: Period) -> PeriodTrace:
    """Return room for what a period records."""
    steps, values = period.nodes.turn.shape[0], period.time.shape[0]
    parts, changed = np.zeros((steps, SUMS)), np.zeros(steps, dtype=np.bool_)
    instants, grazing = np.zeros(steps, dtype=np.int64), np.zeros(steps, dtype=np.int64)
    return PeriodTrace(np.zeros((values, 2)), period.weight.copy(), parts, changed, instants, grazing)


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
def _alone(changed: NDArray[np.bool_], first: int, n: int) -> bool:
    """Return whether a step was taken in one, and the one before it was not, or is before ``first``."""
    return n >= first and not changed[n] and (n == first or changed[n - 1])


@kernel
def _retaken(
    x1: Axis,
    x2: Axis,
    y1: Axis,
    y2: Axis,
    h: float,
    reach: float,
    changed: bool,
    period: Period,
    n: int,
    room: Room,
    trace: PeriodTrace,
) -> tuple[Axis, Axis]:
    """Return both axes after step ``n`` as ``retake`` does, and write what it records."""
    parts = trace.parts[n]
    y1, y2, taken, trace.instants[n], trace.grazing[n] = retake(
        *(x1, x2, y1, y2, h, reach, changed), *(period.parameter, period.balls, period.nodes, n, room, parts)
    )
    trace.changed[n] = taken
    if taken:
        for k in range(MEANS):
            parts[k] /= period.time[-1]
    return y1, y2


@kernel
def ball_period(state: NDArray[np.float64], state_out: NDArray[np.float64], trace: PeriodTrace, period: Period) -> int:
    """Carry the state over one ball period and write its ``trace``; return a STATUS_ number.

    ``state`` and ``state_out`` (2, 6): see models.solve.six_dof.kernels.step.
    """
    p, balls, nodes, first, flow = period.parameter, period.balls, period.nodes, period.first, period.flow
    x1 = (state[0, 0], state[0, 1], state[0, 2], state[0, 3], state[0, 4], state[0, 5])
    x2 = (state[1, 0], state[1, 1], state[1, 2], state[1, 3], state[1, 4], state[1, 5])
    w1, w2 = x1, x2
    wave, any_changed, room = trace.wave, False, make_room(balls, nodes)
    for segment in range(first.shape[0] - 1):
        h = flow[segment, 0]
        reach = max(h, REACH * period.time[-1])
        e = flow_row(flow, segment, 1)
        for n in range(first[segment], first[segment + 1]):
            y1, y2, g1, g2, changed, near = step(x1, x2, h, e, p, forces, (balls, nodes), n, reach)
            wave[n + segment, 0], wave[n + segment, 1] = accelerations(x1, x2, g1, g2, p)
            trace.changed[n], trace.instants[n], trace.grazing[n] = False, 0, 0
            if changed or near:
                y1, y2 = _retaken(x1, x2, y1, y2, h, reach, changed, period, n, room, trace)
                if trace.changed[n] and _alone(trace.changed, first[segment], n - 1):
                    _retaken(w1, w2, x1, x2, h, reach, True, period, n - 1, room, trace)
                any_changed = any_changed or trace.changed[n]
            w1, w2 = x1, x2
            x1, x2 = y1, y2
        last = first[segment + 1] - 1
        if any_changed and _alone(trace.changed, first[segment], last):
            _retaken(w1, w2, x1, x2, h, reach, True, period, last, room, trace)
        g1, g2, _, _ = contact(x1, x2, p, balls, nodes, last, np.int64(2), 0.0)
        wave[last + segment + 1, 0], wave[last + segment + 1, 1] = accelerations(x1, x2, g1, g2, p)
    fill_weights(flow, first, period.weight, trace.changed, any_changed, trace.weight)
    bad = False
    for k in range(6):
        state_out[0, k], state_out[1, k] = x1[k], x2[k]
        bad = bad or not math.isfinite(x1[k]) or not math.isfinite(x2[k])
    return STATUS_NOT_FINITE if bad else STATUS_OK
