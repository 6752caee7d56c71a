"""When balls pass defects within a run, in the intervals between the edges that kernels step over.

What rolls past turns evenly, so that all instants are known before a run begins.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.machine.bearing import kinematics

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing
    from models.machine.scene import Defect

# Edges closer than this are one, s.
_SAME_TIME = 1e-11


class Passages(NamedTuple):
    """Passages over one defect, each array of shape (passages,).

    Attributes:
        begin, end: when the edges are reached, s; some lie before the run begins.
        number: which of the balls, int64.
        offset: angle past the first edge at t = 0, rad; it grows with the rate that was given.
    """

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    number: NDArray[np.int64]
    offset: NDArray[np.float64]


class PassageIntervals(NamedTuple):
    """The time of a run, cut at all edges into I intervals.

    Attributes:
        bounds: times of the edges, s, the first zero, the last after the end, (I + 1,).
        first: the records of interval i are first[i] to first[i + 1], int64, (I + 1,).
        record: the passage of each record, int64.
    """

    bounds: NDArray[np.float64]
    first: NDArray[np.int64]
    record: NDArray[np.int64]


def passages_over(
    angles: NDArray[np.float64], rate: float, every: float, edges: tuple[float, float], duration: float
) -> Passages:
    """Return all passages over a defect that touch a run.

    Args:
        angles: of the balls on the damaged part at t = 0, rad, (balls,).
        rate: at which they turn on it, rad/s, not zero.
        every: angle after which they meet it again, rad.
        edges: where the defect begins and ends, rad.
        duration: of the run, s.
    """
    extent = edges[1] - edges[0]
    sweep = sorted((0.0, rate * duration))
    turns = np.arange(math.floor(sweep[0] / every) - 3, math.ceil(sweep[1] / every) + 4)
    number, turn = (x.ravel() for x in np.meshgrid(np.arange(len(angles)), turns, indexing="ij"))
    # Angle from the edge: offset + rate t.
    offset = angles[number] - edges[0] - every * turn
    times = np.sort(np.stack((-offset / rate, (extent - offset) / rate)), axis=0)
    keep = (times[1] > 0.0) & (times[0] < duration)
    return Passages(times[0][keep], times[1][keep], number[keep].astype(np.int64), offset[keep])


def in_intervals(begin: NDArray[np.float64], end: NDArray[np.float64], duration: float) -> PassageIntervals:
    """Return the intervals of a run in which the same passages last."""
    bounds = np.sort(np.concatenate((begin, end)))
    bounds = np.concatenate(([0.0], bounds[(bounds > 0.0) & (bounds < duration)]))
    bounds = bounds[np.concatenate(([True], np.diff(bounds) > _SAME_TIME))]
    low = np.maximum(np.searchsorted(bounds, begin + _SAME_TIME, side="right") - 1, 0)
    high = np.searchsorted(bounds, np.minimum(end, duration) - _SAME_TIME, side="left")
    counts = high - low
    record = np.repeat(np.arange(len(counts)), counts)
    interval = np.arange(len(record)) - np.repeat(np.cumsum(counts) - counts, counts) + low[record]
    first = np.concatenate(([0], np.cumsum(np.bincount(interval, minlength=len(bounds))))).astype(np.int64)
    return PassageIntervals(np.append(bounds, duration + 1.0), first, record[np.argsort(interval, kind="stable")])


class Meetings(NamedTuple):
    """Passages of a bearing's elements over a defect whose depth is a half-wave, each array of shape (passages,).

    Attributes:
        begin, end: when the edges are reached, s.
        element: int64.
        depth, rate, offset: it is deeper by depth * sin(rate * t + offset), m.
    """

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    element: NDArray[np.int64]
    depth: NDArray[np.float64]
    rate: NDArray[np.float64]
    offset: NDArray[np.float64]


def half_wave_meetings(
    bearing: Bearing, speed: float, angles: NDArray[np.float64], defect: Defect, duration: float
) -> Meetings:
    """Return the passages over a defect that relieves an element by h_d sin(pi psi / dphi_d), psi from its edge.

    A defect of an element relieves it by h_d while it lies within dphi_d of either contact (Ceruti, 2.4.1).

    Args:
        speed: of the shaft, Hz; negative where it turns the other way.
        angles: of all elements at t = 0, rad, (rows * n_elements,).
        duration: of the run, s.
    """
    lines = kinematics(bearing, abs(speed))
    cage, shaft, spin = (math.copysign(2.0 * math.pi * rate, speed) for rate in (lines.ftf, abs(speed), lines.bsf))
    rate = {"outer": cage, "inner": cage - shaft, "ball": spin}[defect.part]
    every = math.pi if defect.part == "ball" else 2.0 * math.pi
    rows = range(defect.first_row, defect.first_row + defect.rows)
    count = 1 if defect.part == "ball" else bearing.n_elements
    elements = np.array([row * bearing.n_elements + k for row in rows for k in range(count)])
    edge = defect.position - 0.5 * defect.dphi_d
    past = passages_over(
        np.zeros(len(elements)) if defect.part == "ball" else angles[elements],
        rate,
        every,
        (edge, edge + defect.dphi_d),
        duration,
    )
    offset, size = past.offset, len(past.offset)
    if defect.part == "ball":
        along, start = np.zeros(size), np.full(size, 0.5 * math.pi)
    else:
        waves = math.pi / defect.dphi_d
        along, start = np.full(size, waves * rate), waves * offset
    return Meetings(past.begin, past.end, elements[past.number], np.full(size, defect.h_d), along, start)
