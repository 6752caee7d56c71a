"""Kernels of what a period shows, the mean square and the lines of an acceleration, and of how the columns change it.

A mean is a sum over values at places of the period, which are shares of its segments: it changes by the values, by the
length of the segments, and lines by the phase of the places as well.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.platform.jit import inlined, kernel
from models.solve.six_dof.kernels.step import P_OMEGA
from models.solve.six_dof.kernels.varied_step import Columns, Varied, pair_of, sensed, sensed_change

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index
    from models.solve.six_dof.kernels.step import Axis

    Values = NDArray[np.float64]

# Sums over a period: the mean square, real and imaginary parts of lines 1, 2, ..., and the power in a band.
S_POWER = 0
S_LINES = 1


class Shown(NamedTuple):
    """What a period shows, and how it changes.

    Attributes:
        sensor: 0 for the outer ring, 1 for the resonator.
        lines: whose coefficients are wanted.
        band: coefficients of the lines of a band, conjugate, complex parts (2, lines); none of them where there is no
            band.
        low: first line of the band.
        value: sums by the S_ constants, (S_LINES + 2 lines + 1,).
        change: of the sums by each column, (C + 1, sums).
        at: what a value at a place counts in the sums, and the slopes of that by the phase, (2, sums).
    """

    sensor: int
    lines: int
    band: Values
    low: int
    value: Values
    change: Values
    at: Values


@inlined
def _weigh(phase: float, shown: Shown) -> None:
    """Write what a value at a phase, from 0 to 1, counts in the sums."""
    at = shown.at
    angle = 2.0 * math.pi * phase
    step_c, step_s = math.cos(angle), math.sin(angle)
    c, s = step_c, step_s
    for k in range(shown.lines):
        w, i = 2.0 * math.pi * (k + 1), S_LINES + 2 * k
        at[0, i], at[1, i] = c, -w * s
        at[0, i + 1], at[1, i + 1] = -s, -w * c
        c, s = c * step_c - s * step_s, s * step_c + c * step_s
    last = S_LINES + 2 * shown.lines
    at[0, last] = at[1, last] = 0.0
    if shown.band.shape[1] > 0:
        c, s = math.cos(shown.low * angle), math.sin(shown.low * angle)
        for k in range(shown.band.shape[1]):
            real, imaginary = shown.band[0, k], shown.band[1, k]
            # The real part of conj(c_k) exp(-i k angle), and its slope.
            at[0, last] += real * c + imaginary * s
            at[1, last] -= 2.0 * math.pi * (shown.low + k) * (real * s - imaginary * c)
            c, s = c * step_c - s * step_s, s * step_c + c * step_s


@inlined
def add_end(phase: float, a: float, sign: float, p: Values, shown: Shown, duration: float, out: Values) -> None:
    """Add what a value counts over a time of one second at a place, over the period, to ``out``, (sums,)."""
    _weigh(phase, shown)
    out[S_POWER] += sign * a * a / duration
    for i in range(S_LINES, out.shape[0]):
        out[i] += sign * a * shown.at[0, i] / duration


class StepPlace(NamedTuple):
    """Where a step is: its segment, the share of it at its start, and the shares that it takes; pitch, rad."""

    segment: int
    begin: float
    share: float
    pitch: float


@inlined
def phase_at(place: float, where: StepPlace, bounds: Values) -> float:
    """Return the phase at a place, from 0 to 1 over a step."""
    share = where.begin + place * where.share
    return (bounds[where.segment] + share * (bounds[where.segment + 1] - bounds[where.segment])) / where.pitch


@inlined
def turned_by(place: float, where: StepPlace, varied: Varied, m: Index) -> float:
    """Return the change of the cage angle at a place of a step by a parameter."""
    share = where.begin + place * where.share
    return (1.0 - share) * varied.bounds[where.segment, m] + share * varied.bounds[where.segment + 1, m]


@kernel
def add_row(
    weight: float,
    place: float,
    where: StepPlace,
    x1: Axis,
    x2: Axis,
    source: Values,
    p: Values,
    stage: Index,
    bounds: Values,
    varied: Varied,
    columns: Columns,
    shown: Shown,
    shifted: bool,
) -> None:
    """Add a value at a place of a step to the sums and its changes by the columns, whose state is in ``source``."""
    if weight == 0.0:
        return
    sensor, last = shown.sensor, varied.start.shape[0] - 1
    force, lightness = sensed(x1, x2, columns.force[stage, 0], columns.force[stage, 1], p, np.int64(sensor))
    a = force * lightness
    _weigh(phase_at(place, where, bounds), shown)
    at, sums, duration = shown.at, shown.value.shape[0], bounds[-1] / p[P_OMEGA]
    shown.value[S_POWER] += weight * a * a
    for i in range(S_LINES, sums):
        shown.value[i] += weight * a * shown.at[0, i]
    width = bounds[where.segment + 1] - bounds[where.segment]
    for k in range(12 + last + (1 if shifted else 0)):
        t1, t2 = pair_of(source, k)
        m = k - 12
        da = sensed_change(t1, t2, x1, x2, p, varied, columns, stage, np.int64(k), np.int64(sensor))
        later, longer = 0.0, 0.0
        if m == last:
            later = 1.0 / duration
        elif m >= 0:
            later = turned_by(place, where, varied, m) / where.pitch
            longer = (varied.bounds[where.segment + 1, m] - varied.bounds[where.segment, m]) / width
        out, plain, turned = shown.change[k], weight * (da + longer * a), weight * later * a
        out[S_POWER] += weight * a * (2.0 * da + longer * a)
        for i in range(S_LINES, sums):
            out[i] += at[0, i] * plain + at[1, i] * turned
