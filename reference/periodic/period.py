"""DOP853 over one ball period; steps end on the kinks of the path and where contacts open and close.

A step knows the gap of every element (delta, negative where it is apart) and its rate at both ends. A sign that
changes is located by Newton steps within a bracket, each of which takes the step anew up to the place that is looked
at, so that the instant is as exact as the method. A gap that keeps its sign but may have left it and come back within
the step (``dip``) has the step end at its extremum, where the same is asked again. The forces do not depend on any of
this: what were overlooked would cost accuracy only, and the estimate of the error of a step in which a contact changes
between its stages is raised (EVENT_CARE).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numba
import numpy as np

from reference.periodic.kernel import P_APPROACH, P_CLEARANCE, P_OMEGA, P_PITCH, Model, Piece, derivative, gaps
from reference.periodic.tableau import ERROR_3, ERROR_5, STAGES, A, B, C

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from reference.periodic.kernel import Floats

# Quadratures over the period: square of a_o, work put in, work of damping, and a_o by cosine and sine of six lines.
LINES = 6
SUMS = 3 + 2 * LINES
NO_ERROR, TOO_MANY_STEPS, NOT_FINITE = range(3)
SAFETY, SHRINK, GROW, EVENT_CARE = 0.9, 0.333, 6.0, 100.0
# Times that a step is cut at extrema and instants; attempts at one instant.
CUTS, TRIES = 40, 60
# Share of a step to which an instant within it is located.
CLOSE = 1e-13
# A gap is zero within this share of the largest motion, and within rounding of the displacement.
DUST, ROUNDING = 1e-12, 2e-15
# An extremum of a gap within this share of the largest motion is a graze.
GRAZE = 1e-3
# First step after an instant, as a share of the one that would have been tried.
RESTART = 0.05
# Places within a step at which a crest is looked for, where a stage comes near the largest value of the period before.
PLACES, NEAR_TOP = 8, 0.9
# Places in ``counts``: contacts that opened or closed, and extrema of gaps that came near zero without a change.
INSTANTS, GRAZES = range(2)


class Work(NamedTuple):
    """Memory of the attempts at a step: stages, (STAGES, 12), and what ``attempt`` writes.

    Attributes:
        stages, stage: derivatives of all stages and the state of one.
        trial: state at the end of the step, (12,).
        nodes: a_o, power put in and power lost at the stages, (STAGES, 3).
        before, after: gap and rate of every element at both ends of the step, (elements, 2).
        sides: 1 for an element that is in contact, -1 for one that is not.
    """

    stages: Floats
    stage: Floats
    trial: Floats
    nodes: Floats
    before: Floats
    after: Floats
    sides: Floats


@numba.njit(cache=True)
def work_for(elements: int) -> Work:
    """Return the memory for so many elements."""
    return Work(
        np.empty((STAGES, 12)),
        np.empty(12),
        np.empty(12),
        np.empty((STAGES, 3)),
        np.empty((elements, 2)),
        np.empty((elements, 2)),
        np.ones(elements),
    )


@numba.njit(cache=True)
def attempt(theta: float, h: float, y: Floats, scale: Floats, piece: Piece, model: Model, work: Work) -> float:
    """Write state and stages of a step of h s to ``work.trial`` and ``work.nodes``.

    Return the estimated error of the step in units of ``scale`` (Hairer's combination of orders 5 and 3), times
    EVENT_CARE where a contact opens or closes within the step: the force is not smooth there, and the estimate with it.
    """
    k, stage, trial, nodes, omega = work.stages, work.stage, work.trial, work.nodes, model.p[P_OMEGA]
    before, care = 0, 1.0
    for i in range(STAGES):
        for m in range(12):
            stage[m] = y[m]
        for j in range(i):
            factor = h * A[i, j]
            if factor != 0.0:
                for m in range(12):
                    stage[m] += factor * k[j, m]
        a, driven, lost, touching = derivative(theta + omega * C[i] * h, stage, k[i], piece, model)
        nodes[i, 0], nodes[i, 1], nodes[i, 2] = a, driven, lost
        if i > 0 and touching != before:
            care = EVENT_CARE
        before = touching
    fifth, third = 0.0, 0.0
    for m in range(12):
        total, e5, e3 = 0.0, 0.0, 0.0
        for i in range(STAGES):
            total += B[i] * k[i, m]
            e5 += ERROR_5[i] * k[i, m]
            e3 += ERROR_3[i] * k[i, m]
        trial[m] = y[m] + h * total
        fifth += (e5 / scale[m // 2]) ** 2
        third += (e3 / scale[m // 2]) ** 2
    e5, e3 = 0.0, 0.0
    for i in range(STAGES):
        e5 += ERROR_5[i] * nodes[i, 0] ** 2
        e3 += ERROR_3[i] * nodes[i, 0] ** 2
    fifth += (e5 / scale[6]) ** 2
    third += (e3 / scale[6]) ** 2
    norm = math.sqrt(13.0 * (fifth + 0.01 * third))
    return care * h * fifth / norm if norm > 0.0 else 0.0


@numba.njit(cache=True)
def dip(q0: float, v0: float, q1: float, v1: float, least: float) -> float:
    """Return the place, 0 to 1, of an extremum within a step at which a gap may be beyond zero; 0 where there is none.

    ``q`` and ``v``: gap at both ends, counted positive on the side on which the element is, and its rate per step. The
    gap is taken for the cubic through them, whose least value lies ``bend`` below the chord: a value within another
    bend of zero is looked at. Bends up to ``least`` are none.
    """
    if min(q0, q1) > abs(v0) + abs(v1):
        return 0.0
    rise = q1 - q0
    b, c = 3.0 * rise - 2.0 * v0 - v1, v0 + v1 - 2.0 * rise
    square = b * b - 3.0 * c * v0
    if square <= 0.0 or (b <= 0.0 and c == 0.0):
        return 0.0
    root = math.sqrt(square)
    place = -v0 / (b + root) if b > 0.0 else (root - b) / (3.0 * c)
    if not 0.0 < place < 1.0:
        return 0.0
    lowest = q0 + place * (v0 + place * (b + place * c))
    bend = q0 + place * rise - lowest
    return place if lowest < bend and bend > least else 0.0


@numba.njit(cache=True)
def first_change(h: float, ending: int, least: float, work: Work) -> tuple[int, float]:
    """Return an element whose contact may change within a step, and the place of its extremum, or 1 for its end.

    Return -1 and 1 where there is none. ``ending``: the element with whose change the step ends, -1 for none.
    """
    found, first = -1, 1.0
    for j in range(work.sides.shape[0]):
        side = work.sides[j]
        q0, v0 = side * work.before[j, 0], side * h * work.before[j, 1]
        q1, v1 = side * work.after[j, 0], side * h * work.after[j, 1]
        if j == ending:
            q1 = max(q1, 0.0)
        place = dip(q0, v0, q1, v1, least)
        # Where it has just changed, a gap that is still beyond zero by rounding but grows is no change.
        if place == 0.0 and q1 < -least and (q0 > least or v0 <= 0.0 or q1 < q0):
            place = 1.0
        if place > 0.0 and (found < 0 or place < first):
            found, first = j, place
    return found, first


@numba.njit(cache=True)
def instant(
    j: int, theta: float, h: float, y: Floats, scale: Floats, piece: Piece, model: Model, least: float, work: Work
) -> tuple[float, int]:
    """Return the place within a step, s, at which the gap of element j changes its sign, and the attempts it took.

    ``work`` holds the gaps at both ends: the sign at the beginning is that of the element's side, the other at the end.
    """
    side, omega = work.sides[j], model.p[P_OMEGA]
    low, high = 0.0, h
    q_low, q_high = side * work.before[j, 0], side * work.after[j, 0]
    place = h * q_low / (q_low - q_high)
    for tries in range(1, TRIES + 1):
        attempt(theta, place, y, scale, piece, model, work)
        gaps(theta + omega * place, work.trial, piece, model, work.after)
        q, v = side * work.after[j, 0], side * work.after[j, 1]
        if abs(q) <= max(least, CLOSE * h * abs(v)) or high - low <= CLOSE * h:
            return place, tries
        if q > 0.0:
            low = place
        else:
            high = place
        place = place - q / v if v < 0.0 else low
        if not low < place < high:
            place = 0.5 * (low + high)
    return place, TRIES


@numba.njit(cache=True)
def bounded_attempt(
    theta: float,
    h: float,
    y: Floats,
    scale: Floats,
    piece: Piece,
    model: Model,
    least: float,
    work: Work,
    counts: NDArray[np.int64],
) -> tuple[float, float, int, int, int]:
    """Attempt a step that ends where the first contact changes, or at an extremum of a gap that may be a change.

    Return its error, length, s, the element whose contact changes at its end, that whose extremum it is (-1 for none),
    and the attempts it took.
    """
    omega, ending, turning, tries, error = model.p[P_OMEGA], -1, -1, 0, 0.0
    for cut in range(CUTS + 1):
        error = attempt(theta, h, y, scale, piece, model, work)
        tries += 1
        if not math.isfinite(error):
            break
        gaps(theta + omega * h, work.trial, piece, model, work.after)
        j, place = first_change(h, ending, least, work)
        if j < 0 or cut == CUTS:
            break
        if place < 1.0:
            h, ending, turning = place * h, -1, j
        elif work.sides[j] * work.before[j, 0] > least:
            h, more = instant(j, theta, h, y, scale, piece, model, least, work)
            tries += more
            ending, turning = j, -1
        elif work.sides[j] * work.before[j, 1] <= 0.0:
            # It changes where the step begins.
            work.sides[j] = -work.sides[j]
            counts[INSTANTS] += 1
        else:
            # It has just changed, and changes again within the step.
            h, ending, turning = 0.5 * h, -1, -1
    return error, h, ending, turning, tries


@numba.njit(cache=True)
def crest(theta: float, h: float, y: Floats, scale: Floats, piece: Piece, model: Model, probe: Work) -> float:
    """Return the largest absolute a_o within a step, m/s2: the true one at its places and where a parabola peaks."""
    values, omega = np.empty(PLACES + 1), model.p[P_OMEGA]
    top = 0
    for i in range(PLACES + 1):
        values[i] = _a_at(theta, i * h / PLACES, y, scale, piece, model, probe, omega)
        if values[i] > values[top]:
            top = i
    middle = min(max(top, 1), PLACES - 1)
    left, here, right = values[middle - 1], values[middle], values[middle + 1]
    bend = left - 2.0 * here + right
    if bend >= 0.0:
        return values[top]
    place = min(max((middle + 0.5 * (left - right) / bend) / PLACES, 0.0), 1.0)
    return max(values[top], _a_at(theta, place * h, y, scale, piece, model, probe, omega))


@numba.njit(cache=True)
def _a_at(
    theta: float, h: float, y: Floats, scale: Floats, piece: Piece, model: Model, probe: Work, omega: float
) -> float:
    """Return the absolute a_o h s after the beginning of a step, m/s2."""
    attempt(theta, h, y, scale, piece, model, probe)
    return abs(derivative(theta + omega * h, probe.trial, probe.stage, piece, model)[0])


@numba.njit(cache=True)
def add_sums(
    sums: Floats, weight: float, theta: float, lines_per_rad: float, a: float, driven: float, lost: float
) -> None:
    """Add one node of the quadratures."""
    sums[0] += weight * a * a
    sums[1] += weight * driven
    sums[2] += weight * lost
    c1, s1 = math.cos(lines_per_rad * theta), math.sin(lines_per_rad * theta)
    c, s = c1, s1
    for k in range(LINES):
        sums[3 + 2 * k] += weight * a * c
        sums[4 + 2 * k] += weight * a * s
        c, s = c * c1 - s * s1, s * c1 + c * s1


@numba.njit(cache=True)
def accept(
    theta: float,
    h: float,
    y: Floats,
    p: Floats,
    work: Work,
    ending: int,
    turning: int,
    near: float,
    sums: Floats,
    largest: Floats,
    counts: NDArray[np.int64],
) -> None:
    """Take a step of h s: add its share to ``sums``, write the new state to ``y``, and keep the largest values.

    ``ending``, ``turning``: as ``bounded_attempt`` returns them; ``near``: what counts as a graze, m.
    """
    lines_per_rad, nodes = 2.0 * math.pi / p[P_PITCH], work.nodes
    for i in range(STAGES):
        if B[i] != 0.0:
            where = theta + p[P_OMEGA] * C[i] * h
            add_sums(sums, B[i] * h, where, lines_per_rad, nodes[i, 0], nodes[i, 1], nodes[i, 2])
    for m in range(12):
        y[m] = work.trial[m]
        largest[m // 2] = max(largest[m // 2], abs(y[m]))
    work.before[:] = work.after
    if ending >= 0:
        work.sides[ending] = -work.sides[ending]
        counts[INSTANTS] += 1
    elif turning >= 0 and abs(work.after[turning, 0]) < near:
        counts[GRAZES] += 1


@numba.njit(cache=True)
def fitted(h: float, left: float) -> tuple[float, bool]:
    """Return the step to try where ``left`` s remain of an interval, and whether it ends there."""
    if h >= 0.999 * left:
        return left, True
    return (0.5 * left if h > 0.55 * left else h), False


@numba.njit(cache=True)
def next_step(h: float, error: float, growth: float, whole: float, ending: int, short: bool) -> float:
    """Return the step to try after one of h s, of an error relative to the tolerance, before which ``whole`` was tried.

    ``short``: whether an instant, an extremum or the end of an interval cut it, which says little about the next one.
    """
    if ending >= 0:
        return RESTART * whole
    grown = h * (min(growth, SAFETY * error**-0.125) if error > 0.0 else growth)
    return max(whole, grown) if short else grown


@numba.njit(cache=True)
def ball_period(
    y: Floats,
    begin: float,
    tolerance: float,
    scale: Floats,
    bounds: Floats,
    codes: NDArray[np.int8],
    middles: Floats,
    model: Model,
    most: int,
    earlier: float,
    sums: Floats,
    largest: Floats,
    counts: NDArray[np.int64],
) -> tuple[int, int, float, float]:
    """Carry ``y`` over one ball period with DOP853; steps end at ``bounds`` (intervals + 1), rad of cage angle.

    ``begin`` is the first step tried, s; ``scale`` (7) the sizes to which ``tolerance`` refers: of u, o, e, of their
    velocities, and of the first of ``sums``. ``earlier``: largest absolute a_o of the period before, near which crests
    are looked for, m/s2. ``sums`` (SUMS), ``largest`` (6, largest absolute values of the groups of the state) and
    ``counts`` are written. Return a status, the steps tried, the next step, s, and the largest absolute a_o, m/s2.
    """
    p, elements = model.p, model.directions.shape[0]
    omega, work, probe, dy = p[P_OMEGA], work_for(elements), work_for(elements), np.empty(12)
    least = max(DUST * scale[0], ROUNDING * (p[P_APPROACH] + p[P_CLEARANCE]))
    h, steps, peak = begin, 0, 0.0
    sums[:], largest[:], counts[:] = 0.0, 0.0, 0
    gaps(bounds[0], y, Piece(0.5 * (bounds[0] + bounds[1]), codes[0], middles[0]), model, work.before)
    work.sides[:] = 2.0 * (work.before[:, 0] > 0.0) - 1.0
    for interval in range(bounds.shape[0] - 1):
        piece = Piece(0.5 * (bounds[interval] + bounds[interval + 1]), codes[interval], middles[interval])
        span = (bounds[interval + 1] - bounds[interval]) / omega
        gaps(bounds[interval], y, piece, model, work.before)
        t, growth = 0.0, GROW
        while t < span:
            whole = h
            tried, last = fitted(h, span - t)
            theta = bounds[interval] + omega * t
            error, h, ending, turning, tries = bounded_attempt(
                theta, tried, y, scale, piece, model, least, work, counts
            )
            error /= tolerance
            steps += tries
            if steps > most:
                return TOO_MANY_STEPS, steps, h, peak
            if not error <= 1.0:
                h *= max(SHRINK, SAFETY * error**-0.125) if math.isfinite(error) else 0.1
                growth = 1.0
                if h < 1e-20:
                    return NOT_FINITE, steps, h, peak
                continue
            peak = max(peak, abs(work.nodes[0, 0]))
            if np.max(np.abs(work.nodes[:, 0])) > NEAR_TOP * max(earlier, peak):
                peak = max(peak, crest(theta, h, y, scale, piece, model, probe))
            accept(theta, h, y, p, work, ending, turning, GRAZE * scale[0], sums, largest, counts)
            last = last and h == tried
            t = span if last else t + h
            h = next_step(h, error, growth, whole, ending, last or h < tried)
            growth = GROW
        peak = max(peak, abs(derivative(bounds[interval + 1], y, dy, piece, model)[0]))
    return NO_ERROR, steps, h, peak
