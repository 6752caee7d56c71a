"""Kernel parts of models whose Runge-Kutta steps end where a contact changes or an edge is met.

A model brings its kernels ``slope_of`` (the time derivative of a state at a node of the step), ``gap_of`` (the least
gap of a contact at a node, negative where one has changed), ``hold`` (write which contacts are closed at a node) and
``kept`` (the same after a step that was taken, from what is known of its end: whether ``hold`` has to look anew). How
far balls are relieved by the defects that they pass is known before the run, in intervals between edges.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from models.platform.jit import inlined

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.platform.jit import Index


TINY = 1e-13
"""Parts of a step shorter than this are rounding, s."""
TOUCHED = 1e-14
"""Overlap to which the instant of a contact is found, m."""
MOST_TRIALS = 60
"""Trials for that instant, at most."""
MOST_CHANGES = 100
"""A step with more changes of contact than this is taken without looking for more."""
EXACT_ANGLES = 32
"""The angles are computed afresh after so many steps; between, they are turned on."""
NODES = 6
"""Times from which a signal between them is interpolated."""

Kernel = Callable[..., Any]
"""A kernel that is handed to another, which is compiled for it."""


class HasState(Protocol):
    """Places of a Runge-Kutta step."""

    @property
    def slope(self) -> NDArray[np.float64]:
        """Time derivative of the state at four stages, (4, size)."""
        ...

    @property
    def state(self) -> NDArray[np.float64]:
        """At the beginning of the step, (size,)."""
        ...

    @property
    def trial(self) -> NDArray[np.float64]:
        """At a stage, then at the end, (size,)."""
        ...


class HasNodes(HasState, Protocol):
    """Places of a step whose angles and depths are known at its nodes."""

    @property
    def turn(self) -> NDArray[np.float64]:
        """Cosine and sine of each angle at the nodes, (3, 2 K)."""
        ...

    @property
    def half(self) -> NDArray[np.float64]:
        """The same of what they turn in half a whole step, and in half a part of one, (2, 2 K)."""
        ...

    @property
    def depth(self) -> NDArray[np.float64]:
        """How far each ball is relieved at the nodes, m, (3, N)."""
        ...


@inlined
def fill_half(h: float, p: NDArray[np.float64], half: NDArray[np.float64]) -> None:
    """Write what each angle turns in half a step of length h.

    Args:
        p: begins with the speeds of the K angles, rad/s.
        half: cosine and sine of each, (2 K,).
    """
    for k in range(half.shape[0] // 2):
        angle = 0.5 * h * p[k]
        half[2 * k], half[2 * k + 1] = math.cos(angle), math.sin(angle)


@inlined
def fill_start(t: float, p: NDArray[np.float64], turn: NDArray[np.float64]) -> None:
    """Write the angles at the first node of a step that begins at t.

    Args:
        p: begins with the speeds of the K angles, rad/s.
        turn: cosine and sine of each angle at the nodes, (3, 2 K).
    """
    for k in range(turn.shape[1] // 2):
        angle = t * p[k]
        turn[0, 2 * k], turn[0, 2 * k + 1] = math.cos(angle), math.sin(angle)


@inlined
def fill_rest(half: NDArray[np.float64], turn: NDArray[np.float64]) -> None:
    """Write the angles at the other nodes of a step from those at the first.

    Args:
        half: cosine and sine of what each angle turns in half the step, (2 K,).
        turn: cosine and sine of each angle at the nodes, (3, 2 K).
    """
    for node in range(2):
        for k in range(0, half.shape[0], 2):
            c, s = turn[node, k], turn[node, k + 1]
            turn[node + 1, k] = c * half[k] - s * half[k + 1]
            turn[node + 1, k + 1] = s * half[k] + c * half[k + 1]


@inlined
def to_stage(stage: Index, h: float, work: HasState) -> None:
    """Write into ``trial`` the state at which the slope of stage ``stage + 1`` of a step of length h is taken."""
    share = h if stage == 2 else 0.5 * h
    for k in range(work.state.shape[0]):
        work.trial[k] = work.state[k] + share * work.slope[stage, k]


@inlined
def to_end(h: float, work: HasState) -> None:
    """Write into ``trial`` the state after a step of length h, from its four slopes."""
    for k in range(work.state.shape[0]):
        ends, middle = work.slope[0, k] + work.slope[3, k], work.slope[1, k] + work.slope[2, k]
        work.trial[k] = work.state[k] + h / 6.0 * (ends + 2.0 * middle)


@inlined
def accept(work: HasState) -> None:
    """Take the trial as the state."""
    for k in range(work.state.shape[0]):
        work.state[k] = work.trial[k]


@inlined
def runge_kutta(slope_of: Kernel, h: float, plan: HasPassages, work: HasState) -> None:
    """Write into ``trial`` the state after a step, whose nodes and first slope are written."""
    for stage in range(3):
        to_stage(stage, h, work)
        slope_of(work.trial, 2 if stage == 2 else 1, plan, work, stage + 1)
    to_end(h, work)


@inlined
def attempt(
    slope_of: Kernel, gap_of: Kernel, t: float, h: float, interval: Index, plan: HasPassages, work: HasNodes
) -> float:
    """Take a part of a step into ``trial``, whose first slope is written; return what ``gap_of`` says of its end."""
    fill_half(h, plan.parameter, work.half[1])
    fill_rest(work.half[1], work.turn)
    fill_depth(t, h, interval, plan, work.depth)
    runge_kutta(slope_of, h, plan, work)
    return gap_of(work.trial, np.int64(2), plan, work)


@inlined
def to_change(
    attempted: Kernel,
    gap_of: Kernel,
    t: float,
    h: float,
    at_end: float,
    interval: Index,
    plan: HasPassages,
    work: HasNodes,
) -> float:
    """Step to the first change of contact in a step of length h, at whose end the gap is ``at_end`` < 0.

    ``attempted`` is the model's ``attempt``.

    Returns:
        The length of the step, at whose end the change is just past.
    """
    low, high, at_low, at_high = 0.0, h, max(gap_of(work.state, np.int64(0), plan, work), 0.0), at_end
    for trial in range(MOST_TRIALS):
        if found(low, high, at_high):
            break
        middle = next_length(trial, low, high, at_low, at_high)
        gap = attempted(t, middle, interval, plan, work)
        if gap < 0.0:
            high, at_high = middle, gap
        else:
            low, at_low = middle, gap
    attempted(t, high, interval, plan, work)
    return high


@inlined
def found(low: float, high: float, at_high: float) -> bool:
    """Return whether a change between two lengths of a step is found, of which the upper one is just past it."""
    return high - low <= TINY or -at_high <= TOUCHED


@inlined
def next_length(trial: int, low: float, high: float, at_low: float, at_high: float) -> float:
    """Return the length of step to try next, by regula falsi and bisection in turns.

    Args:
        trial: number of the trial.
        low, high: lengths before and past the change.
        at_low, at_high: gaps there, m, the second negative.
    """
    if trial % 2 == 1:
        return 0.5 * (low + high)
    # Aimed a little beyond the root: the upper end, which is taken, shall come down to it.
    share = (at_low + 0.5 * TOUCHED) / (at_low - at_high)
    return low + (high - low) * min(max(share, 1e-3), 1.0 - 1e-3)


class HasPassages(Protocol):
    """A plan with records of passages in the intervals of ``models.solve.engine.passages``."""

    @property
    def parameter(self) -> NDArray[np.float64]:
        """Begins with the speeds of the angles, rad/s."""
        ...

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Times of the edges, s, (I + 1,)."""
        ...

    @property
    def first(self) -> NDArray[np.int64]:
        """The records of interval i are first[i] to first[i + 1], (I + 1,)."""
        ...

    @property
    def ball(self) -> NDArray[np.int64]:
        """The ball of each record."""
        ...

    @property
    def depth(self) -> NDArray[np.float64]:
        """It is deeper by depth * sin(rate * t + offset), m."""
        ...

    @property
    def rate(self) -> NDArray[np.float64]:
        """See ``depth``, rad/s."""
        ...

    @property
    def offset(self) -> NDArray[np.float64]:
        """See ``depth``, rad."""
        ...


@inlined
def fill_depth(t: float, h: float, interval: Index, plan: HasPassages, depth: NDArray[np.float64]) -> None:
    """Write the depths at the nodes of a step of length h that begins at t and lies in one interval."""
    for node in range(3):
        for j in range(depth.shape[1]):
            depth[node, j] = 0.0
        for r in range(plan.first[interval], plan.first[interval + 1]):
            angle = plan.rate[r] * (t + 0.5 * h * node) + plan.offset[r]
            depth[node, plan.ball[r]] += plan.depth[r] * math.sin(angle)


@inlined
def broken_step(
    attempted: Kernel,
    reached: Kernel,
    slope_of: Kernel,
    hold: Kernel,
    kept: Kernel,
    t: float,
    end: float,
    interval: int,
    plan: HasPassages,
    work: HasNodes,
) -> int:
    """Carry the state from t to ``end`` over edges and changes of contact.

    ``attempted`` and ``reached`` are the model's ``attempt`` and ``to_change``.

    Returns:
        The interval at ``end``.
    """
    changes = 0
    while end - t > TINY:
        length = min(end, plan.bounds[interval + 1]) - t
        fill_start(t, plan.parameter, work.turn)
        fill_depth(t, 0.0, interval, plan, work.depth)
        slope_of(work.state, np.int64(0), plan, work, np.int64(0))
        gap = attempted(t, length, interval, plan, work)
        if gap < 0.0 and changes < MOST_CHANGES:
            length = reached(t, length, gap, interval, plan, work)
            changes += 1
        t += length
        accept(work)
        anew = kept(gap < 0.0, work)
        while plan.bounds[interval + 1] - t <= TINY:
            interval += 1
            anew = True
        if anew:
            fill_start(t, plan.parameter, work.turn)
            fill_depth(t, 0.0, interval, plan, work.depth)
            hold(work.state, np.int64(0), plan, work)
    return interval


@inlined
def at_equal_times(written: int, steps: int, h: float, wave: NDArray[np.float64], node: NDArray[np.float64]) -> int:
    """Write what the last NODES of so many steps allow, up to the middle of their times, by Lagrange's polynomial.

    Args:
        written: rows of the wave that are there.
        wave: values at times h seconds apart, (rows, values).
        node: time and values at each node, (NODES, 1 + values).

    Returns:
        How many rows there are then.
    """
    # At the beginning those before the middle too.
    while steps >= NODES and written < wave.shape[0] and written * h <= node[NODES // 2, 0]:
        t, row = written * h, wave[written]
        for k in range(row.shape[0]):
            row[k] = 0.0
        for i in range(NODES):
            weight = 1.0
            for j in range(NODES):
                if j != i:
                    weight *= (t - node[j, 0]) / (node[i, 0] - node[j, 0])
            for k in range(row.shape[0]):
                row[k] += weight * node[i, 1 + k]
        written += 1
    return written
