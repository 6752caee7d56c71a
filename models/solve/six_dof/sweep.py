"""A motion that repeats, followed along a parameter of its scene: where it folds, and where it loses its stability.

The branch is that of models.solve.six_dof.branch. Each of its points is settled as ``simulate`` does, from the state
that was found, with steps of its own; levels, errors and status are those of this answer. Events are located on the
grid of the branch and on one with half its steps, between the two points that show them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from models.solve.response import HARMONICS
from models.solve.six_dof.branch import (
    ALONG,
    PARAMETERS,
    BranchPoint,
    BranchStep,
    Ended,
    MotionLostError,
    PeriodFamily,
    ahead,
    located,
    stepped,
)
from models.solve.six_dof.kernels.orbit import STATE_SCALE, newton_steering
from models.solve.six_dof.periodic import response_of, search
from models.words.checks import check_choice
from models.words.request import Request

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.scene import Scene
    from models.solve.response import Response

    Floats = NDArray[np.float64]

SweepStatus = Literal["converged", "unstable", "parted", "inaccurate"]
Change = Literal["fold", "branch", "period_doubling", "neimark_sacker", "parting", "grazing"]

# Turn of the branch in a step (its cosine) and iterations of a corrector up to which the next step is longer, by this
# factor; shortest step over the longest.
_STRAIGHT, _QUICK, _GROWTH, _SHORTEST = 0.92, 5, 1.6, 1e-5
# Resolution of events over a step: of what changes steadily, and of counts.
_LOCATED, _LOCATED_COUNT = 1e-7, 1e-4
# Distance over the size of the state up to which the motion that was settled is the one that was followed.
_SAME = 0.05
# A multiplier with a smaller imaginary part counts as real.
_REAL = 1e-6


@dataclass(frozen=True)
class SweepEvent:
    """What happens to the motion between two points of a sweep.

    Attributes:
        kind: "fold" (the branch turns back), "period_doubling", "neimark_sacker" or "branch" (a multiplier leaves or
            enters the unit circle at -1, as a complex pair, or at +1 where the branch does not turn), "parting" (the
            rings begin or cease to part for a moment) or "grazing" (another number of contacts opens and closes in a
            period).
        value: of the parameter, SI.
        error: of ``value``, estimated: of the search, and the difference to a grid of half the steps.
        rms: full-bandwidth RMS of the casing there, m/s2.
        multiplier: nearest to the unit circle; NaN of partings and grazings.
        stability: "lost" or "regained" along the sweep, "" where it does not change.
        after: index of the point before it.
    """

    kind: Change
    value: float
    error: float
    rms: float
    multiplier: complex
    stability: Literal["lost", "regained", ""]
    after: int


@dataclass(frozen=True, eq=False)
class Sweep:
    """A motion along a parameter, SI; its points are in the order of the branch, which may turn back.

    Attributes:
        parameter: its name, of PARAMETERS.
        values: of it, (points,).
        rms, peak: of the casing in the band, m/s2, (points,).
        rms_error, peak_error: their relative errors, estimated; NaN where unknown.
        harmonics: single-sided amplitudes of the first six lines k * bpfo, m/s2, (points, 6).
        multiplier: largest Floquet multiplier of each, complex.
        contacts: how many times a contact opens or closes in a period, (points,).
        status: of each: "converged" (stable, and the error of the RMS is within the accuracy), "unstable" (within the
            accuracy, but what is near leaves it), "parted" (as converged, but the rings part for a moment: a motion
            from rest may be another) or "inaccurate"; without levels (NaN) where no answer is surely this motion.
        events: in the order of the branch.
        ended: "reached" the last value, "returned" to the first one, "points" (their number was reached), "lost" (the
            shortest step found no motion: it ends, or changes too abruptly) or "no_orbit" (none found at the first).
    """

    parameter: str
    values: Floats
    rms: Floats
    rms_error: Floats
    peak: Floats
    peak_error: Floats
    harmonics: Floats
    multiplier: NDArray[np.complex128]
    contacts: NDArray[np.int64]
    status: tuple[SweepStatus, ...]
    events: tuple[SweepEvent, ...]
    ended: Ended


def sweep(
    scene: Scene,
    parameter: str,
    begin: float,
    end: float,
    *,
    accuracy: float = Request.accuracy,
    band: tuple[float, float] | None = None,
    direction: float = 0.0,
    points: int = 40,
    max_points: int = 1000,
) -> Sweep:
    """Follow the motion of a scene that repeats along a parameter.

    Args:
        scene: of the six-degree-of-freedom model, driven by the ball passages alone; its own value is not used.
        parameter: "speed", "load", "clearance"; "dphi_d", "h_d" of its defect; or a field of its rig.
        begin, end: first and last value, SI. At the first the motion is searched from rest.
        accuracy, band, direction: as of ``models.solve.simulate.simulate``.
        points: between first and last value, about; more where the motion changes fast.
        max_points: at which the sweep ends.

    Raises:
        ValueError: if a value is outside what the model describes; the message names it.
    """
    check_choice(parameter, "parameter", PARAMETERS)
    for name, count in (("points", points), ("max_points", max_points)):
        if count < 2:
            raise ValueError(f"{name} must be at least 2, got {count!r}")
    if not (math.isfinite(begin) and math.isfinite(end) and begin != end):
        raise ValueError(f"{parameter} must be swept between two numbers, got {begin!r} to {end!r}")
    family = PeriodFamily(scene, parameter, (begin, end), Request(accuracy=accuracy, band=band, direction=direction))
    return _followed(family, 1.0 / points, max_points)


def _followed(family: PeriodFamily, longest: float, max_points: int) -> Sweep:
    """Return the branch from the motion at the first value, which is searched from rest."""
    rows, events = list[_Row](), list[SweepEvent]()
    ended: Ended | None = None
    try:
        place = _first(family)
    except MotionLostError:
        return _collected(family, rows, events, "no_orbit")
    finer = family.refined()
    rows.append(_row(family, place))
    heading, length = ahead(place, ALONG), longest
    while ended is None:
        try:
            step, ended = stepped(family, place, heading, length)
        except MotionLostError:
            length *= 0.5
            if length < _SHORTEST * longest:
                ended = "lost"
            continue
        events += _events(step, family, finer, len(rows) - 1)
        place, heading = step.end, step.turned
        rows.append(_row(family, place))
        if ended is None and len(rows) >= max_points:
            ended = "points"
        if step.cosine > _STRAIGHT and place.iterations <= _QUICK:
            length = min(_GROWTH * length, longest)
    return _collected(family, rows, events, ended)


def _first(family: PeriodFamily) -> BranchPoint:
    """Return the point at the first value, and set the steps of the family to those that it needs."""
    motion = search(family.at(family.ends[0]), family.request)
    if not motion.settled:
        raise MotionLostError
    family.fold = max(1, math.ceil(len(motion.period.nodes.turn) / len(family.period(0.0).nodes.turn)))
    return family.correct(np.append((motion.state / STATE_SCALE).ravel(), 0.0), ALONG)


@dataclass(frozen=True, eq=False)
class _Row:
    """What is said of a point."""

    place: BranchPoint
    response: Response | None
    status: SweepStatus


def _row(family: PeriodFamily, place: BranchPoint) -> _Row:
    """Settle the motion of a point as ``simulate`` does; no response where that ends elsewhere."""
    scene = family.at(family.value(place.share))
    found = search(scene, family.request, place.state, newton_steering(place.matrix))
    if not found.settled:
        return _Row(place, None, "inaccurate")
    away = float(np.linalg.norm((found.state - place.state) / STATE_SCALE))
    # Beside a fold the other motion is near.
    same = found.stable == (abs(place.multipliers[0]) < 1.0)
    if not same or away > _SAME * (1.0 + float(np.linalg.norm(place.z[:12]))):
        return _Row(place, None, "inaccurate")
    status: SweepStatus = "converged"
    response = response_of(scene, family.request, found)
    if response.status != "converged":
        status = "inaccurate"
    elif not found.stable:
        status = "unstable"
    elif place.parted:
        status = "parted"
    return _Row(place, response, status)


def _collected(family: PeriodFamily, rows: list[_Row], events: list[SweepEvent], ended: Ended) -> Sweep:
    def of(name: str) -> Floats:
        return np.array([math.nan if row.response is None else getattr(row.response, name) for row in rows])

    none = np.full(HARMONICS, math.nan)
    lines = [none if row.response is None else row.response.harmonics for row in rows]
    return Sweep(
        parameter=family.parameter,
        values=np.array([family.value(row.place.share) for row in rows]),
        rms=of("rms"),
        rms_error=of("rms_error"),
        peak=of("peak"),
        peak_error=of("peak_error"),
        harmonics=np.array(lines).reshape(-1, HARMONICS),
        multiplier=np.array([row.place.multipliers[0] for row in rows], dtype=np.complex128),
        contacts=np.array([row.place.seen[0] for row in rows], dtype=np.int64),
        status=tuple(row.status for row in rows),
        events=tuple(events),
        ended=ended,
    )


def _events(step: BranchStep, family: PeriodFamily, finer: PeriodFamily, after: int) -> list[SweepEvent]:
    """Return what happens in a step, in its order."""
    begin, end, heading = step.begin, step.end, step.heading
    stable = [abs(place.multipliers[0]) < 1.0 for place in (begin, end)]
    stability = "" if stable[0] == stable[1] else "regained" if stable[1] else "lost"
    found: list[tuple[float, SweepEvent]] = []

    def add(measure: Callable[[BranchPoint], float], kind: Change | None) -> None:
        """Add what is where a measure changes its sign: a count, or by the multiplier that is nearest to one."""
        counted = kind in ("parting", "grazing")
        place, error = located(step, family, finer, measure, _LOCATED_COUNT if counted else _LOCATED)
        multiplier = complex(math.nan)
        if not counted:
            multiplier = complex(place.multipliers[np.argmin(np.abs(np.abs(place.multipliers) - 1.0))])
        at = float(step.across() @ (place.z - begin.z))
        named, changed = kind or _kind(multiplier), "" if counted else stability
        found.append(
            (at, SweepEvent(named, family.value(place.share), error, place.seen[1], multiplier, changed, after))
        )

    if heading[12] * step.turned[12] < 0.0:
        add(lambda place: float(ahead(place, heading)[12]), "fold")
    elif stability:
        add(lambda place: abs(place.multipliers[0]) - 1.0, None)
    if begin.parted != end.parted:
        add(lambda place: 1.0 if place.parted == begin.parted else -1.0, "parting")
    if begin.seen[0] != end.seen[0]:
        add(lambda place: 1.0 if place.seen[0] == begin.seen[0] else -1.0, "grazing")
    return [event for _, event in sorted(found, key=lambda one: one[0])]


def _kind(multiplier: complex) -> Change:
    if abs(multiplier.imag) > _REAL:
        return "neimark_sacker"
    return "period_doubling" if multiplier.real < 0.0 else "branch"
