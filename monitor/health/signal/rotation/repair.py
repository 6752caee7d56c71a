"""Repair of pulses: which mark passed at which pulse, which pulses are missing, and which are too many.

The interval between two pulses is compared with a median of nine neighbours or more. Pulses
between intervals that agree with it are taken as they are. Between two of these, the number of marks follows from the
time that passed and the speeds on both sides; pulses that stand at none of these marks are extra, and marks without a
pulse are missing. Where a wheel lacks teeth, the gap of each turn tells whether the count has slipped.
Pulses of a dense wheel that scatter too much for this are counted, where none is missing and none too many.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.rotation.intervals import PulseTrain, running_median

_GROUPS_A_TURN, _MIN_GROUP, _GROUP_NEIGHBOURS = 8, 16, 9
_STEP = 0.5
"""A change of the interval by more than this many marks is that of a pulse which is missing or too many."""


def are_complete(times: NDArray[np.float64], per_revolution: int) -> bool:
    """Return whether no pulse is missing and none too many, as far as means over an eighth of a turn tell.

    Jitter averages out in them. A single fault within a block may not be seen: it puts the angle wrong by one mark.

    Args:
        times: shape (pulse,), s, rising.
        per_revolution: marks of a whole turn, all of them there.
    """
    group = per_revolution // _GROUPS_A_TURN
    groups = times.size // max(group, 1)
    if group < _MIN_GROUP or groups < 4 * _GROUP_NEIGHBOURS:
        return False
    between = np.diff(times[: groups * group].reshape(groups, group).mean(axis=1))
    change = np.diff(between) / between[1:] * group
    return bool(np.max(np.abs(change - running_median(change, _GROUP_NEIGHBOURS))) < _STEP)


MIN_PULSES = 4
MAX_REPAIRED = 0.1
"""Largest share of pulses that are missing or too many, those right behind another one not counted."""
MAX_SILENCE = 3.5
"""Intervals without a pulse at an end of the block, from which on the shaft counts as stopped."""
_NEIGHBOURS, _MAX_NEIGHBOURS = 9, 64
"""Intervals of the running median, at least and at most."""
_AGREES, _MAX_AGREES, _SPREADS = 0.2, 0.4, 5.0
"""Largest relative difference of an interval from the median of its neighbours: the resolution of time, or so many
times the median of these differences, within two limits."""
_WHOLE, _WIDENED = 0.3, 4
"""Largest distance of the number of marks in a gap from a whole number; how often a gap is widened until it is met."""
_UNCLEAR = 0.01
"""Revolutions by which gaps that are counted wrong may put the angle wrong: many marks a turn allow some."""
_AT_MARK = 0.2
"""Largest distance of a pulse from its mark, in intervals."""
_BOUNCE, _OFTEN = 0.1, 0.05
"""A pulse within this share of an interval behind another is a bounce, where so large a share of them is."""
_CLOSE = 0.02
"""Of two pulses, the first counts that is within this share of an interval of where its mark is expected."""
_MOVED = 0.15
"""A single pulse that stands further than this from the middle of its neighbours, in intervals, is not of its mark."""
_MAX_SLIP = 2
_MAX_MARKS, _MAX_LOOKED = 2.0**31, 50_000
"""Marks of a block, at the speed where it is highest, and gaps or pulses that are looked at one by one, at most."""
_AVERAGED = 16
"""Pulses whose mean interval tells of the silence at an end, where single ones do not."""
_INDEX_SHARE = 0.6
"""Share of the turns that must show the gap of a wheel at one place."""


@dataclass(frozen=True, eq=False)
class Repaired:
    """What the repair found.

    Attributes:
        status: "ok", "too_few", "irregular" or "stopped".
        train: the pulses with the numbers of their marks; None unless "ok".
        missing: marks without a pulse.
        extra: pulses without a mark.
        slips: expected number of gaps whose marks were counted wrong by one, from how far they are from whole numbers.
    """

    status: str
    train: PulseTrain | None = None
    missing: int = 0
    extra: int = 0
    slips: float = 0.0


def repaired(
    times: NDArray[np.float64], duration: float, per_revolution: int, missing_teeth: int = 0, resolution: float = 0.0
) -> Repaired:
    """Number the pulses of a block by their marks.

    Args:
        times: shape (pulse,), s from the first sample of the block, never falling.
        duration: of the block, s.
        per_revolution: marks of a whole turn, missing teeth included.
        missing_teeth: consecutive teeth that the wheel lacks once a turn.
        resolution: to which the times are known, s.
    """
    found = _by_time(times, duration, per_revolution, missing_teeth, resolution)
    unclear = found.status == "irregular" or found.slips > _UNCLEAR
    if not unclear or missing_teeth or np.any(np.diff(times) <= 0.0) or not are_complete(times, per_revolution):
        return found
    numbers = np.arange(times.size, dtype=np.int64)
    ends = [0, _AVERAGED, -1 - _AVERAGED, -1]
    if _has_stopped(times[ends], numbers[ends], duration, 0):
        return found
    return Repaired("ok", PulseTrain(times, numbers, per_revolution))


def _by_time(
    times: NDArray[np.float64], duration: float, per_revolution: int, missing_teeth: int, resolution: float
) -> Repaired:
    """Number pulses by the time between them; arguments as of :func:`repaired`."""
    given = times.size
    times = _without_bounces(times[np.diff(times, prepend=-np.inf) > 0.0])
    if times.size < MIN_PULSES:
        return Repaired("too_few")
    bounces = given - times.size
    step = np.diff(times)
    usual = _usual(step, per_revolution)
    if times[-1] - times[0] > _MAX_MARKS * np.min(usual):
        return Repaired("irregular")
    away = np.abs(step / usual - 1.0)
    agrees = away < np.clip(np.maximum(1.05 * resolution / usual, _SPREADS * np.median(away)), _AGREES, _MAX_AGREES)
    # Two extra pulses may stand as far apart as two marks: an interval counts where one beside it agrees as well.
    agrees &= np.append(agrees[1:], agrees[-2]) | np.insert(agrees[:-1], 0, agrees[1])
    if 2 * np.count_nonzero(agrees) < agrees.size:
        return Repaired("irregular")
    numbered = _numbered(times, usual, agrees)
    if numbered is None:
        return Repaired("irregular")
    times, numbers, slips = numbered
    if slips > _UNCLEAR * per_revolution:
        return Repaired("irregular")
    times, numbers = _without_moved(times, numbers)
    absent = 0
    if missing_teeth:
        found = _from_gap(times, numbers, per_revolution, missing_teeth)
        if found is None:
            return Repaired("irregular")
        (times, numbers), slips = found, 0.0
        places = np.arange(int(numbers[0]), int(numbers[-1]) + 1) % per_revolution
        absent = int(np.count_nonzero(places >= per_revolution - missing_teeth))
    if times.size < MIN_PULSES:
        return Repaired("too_few")
    missing, extra = int(numbers[-1] - numbers[0]) + 1 - absent - times.size, given - times.size
    if _has_stopped(times, numbers, duration, missing_teeth):
        return Repaired("stopped", None, missing, extra)
    if missing + extra - bounces > MAX_REPAIRED * (times.size + missing):
        return Repaired("irregular", None, missing, extra)
    return Repaired("ok", PulseTrain(times, numbers, per_revolution, missing_teeth > 0), missing, extra, slips)


def _without_bounces(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Leave out pulses right behind another one where many come so; that is told by the longer intervals beside.

    Single ones are left to :func:`_fill`, which sees which of two is at its mark.
    """
    step = np.diff(times)
    if step.size < _NEIGHBOURS or float(step.min()) > _BOUNCE * float(step.max()):
        return times
    longer = running_median(step, _NEIGHBOURS, above=2)
    short = step < _BOUNCE * longer
    return times[np.append(True, ~short)] if np.count_nonzero(short) > _OFTEN * step.size else times


def _usual(step: NDArray[np.float64], per_revolution: int) -> NDArray[np.float64]:
    """Return the interval that is usual around each, s, shape (interval,): a running median, straight at the ends.

    It is of nine intervals, or of about half a turn where that is more.
    """
    neighbours = max(min(per_revolution // 2, _MAX_NEIGHBOURS) // 2 * 2 + 1, _NEIGHBOURS)
    if step.size < 2 * neighbours:
        return running_median(step, min(_NEIGHBOURS, step.size - 1 + step.size % 2))
    usual = running_median(step, neighbours, stride=max(1, neighbours // _NEIGHBOURS))
    half = neighbours // 2
    ahead = np.arange(half, 0, -1) / half
    for values in (usual, usual[::-1]):
        slope = np.clip(np.log(values[2 * half] / values[half]), -np.log(2.0), np.log(2.0))
        values[:half] = values[half] * np.exp(-slope * ahead)
    return usual


def _has_stopped(times: NDArray[np.float64], numbers: NDArray[np.int64], duration: float, missing_teeth: int) -> bool:
    """Return whether the pulses begin too late, or end too early, for a shaft that turned all the time."""
    longest = MAX_SILENCE + missing_teeth
    begin = (times[1] - times[0]) / (numbers[1] - numbers[0])
    end = (times[-1] - times[-2]) / (numbers[-1] - numbers[-2])
    return bool(times[0] > longest * begin or duration - times[-1] > longest * end)


def _numbered(
    times: NDArray[np.float64], usual: NDArray[np.float64], agrees: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.int64], float] | None:
    """Return the pulses that stand at marks, the numbers of these, and how many gaps may be counted wrong.

    None where too many would have to be looked at one by one.

    Args:
        times: shape (pulse,), s.
        usual: shape (pulse - 1,), the interval between neighbouring marks around each, s.
        agrees: shape (pulse - 1,), whether an interval is one between neighbouring marks.
    """
    agrees = agrees.copy()
    first, last, begins, ends, marks = _gaps(times, usual, agrees)
    for _ in range(_WIDENED):
        unclear = np.abs(marks - np.rint(marks)) > _WHOLE
        wider = agrees.copy()
        wider[begins[unclear] - 1] = wider[ends[unclear]] = False
        if not np.any(unclear) or 2 * np.count_nonzero(wider) < wider.size:
            break
        agrees = wider
        first, last, begins, ends, marks = _gaps(times, usual, agrees)
    counts, keep, whole = np.ones(usual.size), np.ones(times.size, dtype=bool), np.rint(marks)
    looked = (ends - begins > 1) | (whole == 0.0)
    if np.count_nonzero(looked) + first + times.size - last > _MAX_LOOKED:
        return None
    counts[begins[~looked]] = whole[~looked]
    for begin, end, count in zip(begins[looked].tolist(), ends[looked].tolist(), whole[looked].tolist(), strict=True):
        _fill(times, usual, begin, end, int(count), counts, keep)
    _fill_ends(times, usual, first, last, counts, keep)
    numbers = np.concatenate(([0.0], np.cumsum(counts)))
    return times[keep], numbers[keep].astype(np.int64), _slips_of(marks)


def _slips_of(marks: NDArray[np.float64]) -> float:
    """Return how many gaps are expected to be counted wrong, of the marks of gaps before they are rounded, (gap,).

    Those further than ``_WHOLE`` from whole numbers count half each, the others as the tails of a normal distribution
    beyond a half.
    """
    away = (marks - np.rint(marks))[marks > 0.5]
    clear = away[np.abs(away) <= _WHOLE]
    slips = 0.5 * (away.size - clear.size)
    if clear.size:
        spread = math.sqrt(float(np.mean(np.square(clear))))
        slips += clear.size * math.erfc(0.5 / (spread * math.sqrt(2.0))) if spread > 0.0 else 0.0
    return slips


def _gaps(
    times: NDArray[np.float64], usual: NDArray[np.float64], agrees: NDArray[np.bool_]
) -> tuple[int, int, NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return the first and the last interval that agrees; of each gap between, the pulses at its ends and the marks."""
    first, last = np.flatnonzero(agrees)[[0, -1]].tolist()
    odd = np.flatnonzero(~agrees[first : last + 1]) + first
    begins = odd[np.diff(odd, prepend=-2) > 1]
    ends = odd[np.diff(odd, append=times.size + 2) > 1] + 1
    marks = (times[ends] - times[begins]) * (0.5 / usual[begins - 1] + 0.5 / usual[ends])
    return first, last, begins, ends, marks


def _fill(
    times: NDArray[np.float64],
    usual: NDArray[np.float64],
    begin: int,
    end: int,
    count: int,
    counts: NDArray[np.float64],
    keep: NDArray[np.bool_],
) -> None:
    """Write the marks of each interval from pulse ``begin`` to ``end``, ``count`` in all, into ``counts``."""
    counts[begin:end] = 0.0
    if count == 0:
        before, after = float(usual[begin - 1]), float(usual[end])
        expected = times[begin - 1] + (times[end + 1] - times[begin - 1]) * before / (before + after)
        away = np.abs(times[begin : end + 1] - expected)
        close = np.flatnonzero(away <= max(_CLOSE * before, 2.0 * float(away.min())))
        chosen = begin + int(close[0])
        keep[begin : end + 1] = False
        keep[chosen] = True
        return
    share = (times[begin + 1 : end] - times[begin]) / (times[end] - times[begin])
    slower = (usual[end] - usual[begin - 1]) / (usual[end] + usual[begin - 1])
    place = count * share * (1.0 + slower * (1.0 - share))
    mark = np.rint(place)
    away = np.abs(place - mark)
    near = np.flatnonzero((mark >= 1.0) & (mark < count) & (away < _AT_MARK))
    near = near[np.lexsort((away[near], mark[near]))]
    # Of those at one mark the nearest comes first.
    at, before = near[np.diff(mark[near], prepend=0.0) > 0.0], 0.0
    keep[begin + 1 : end] = False
    for pulse in at.tolist():
        keep[begin + 1 + pulse] = True
        counts[begin + pulse] = mark[pulse] - before
        before = float(mark[pulse])
    counts[end - 1] += count - before


def _fill_ends(
    times: NDArray[np.float64],
    usual: NDArray[np.float64],
    first: int,
    last: int,
    counts: NDArray[np.float64],
    keep: NDArray[np.bool_],
) -> None:
    """Number the pulses before the first interval that agrees and after the last, at the speed there and its change."""
    inner = min(first + 1, last), max(last - 1, first)
    ways = ((last + 1, range(last + 2, times.size), last, inner[1]), (first, range(first - 1, -1, -1), first, inner[0]))
    for at, pulses, beside, further in ways:
        speed = 1.0 / usual[beside]
        change = speed - 1.0 / usual[further]
        for pulse in pulses:
            away = abs(times[pulse] - times[at])
            # The middle of the gap is half as many intervals away as the gap holds, and half an interval more.
            marks = away * np.clip(speed + 0.5 * change * (away * speed + 1.0), 0.5 * speed, 2.0 * speed)
            low, high = min(at, pulse), max(at, pulse)
            counts[low:high] = 0.0
            if round(marks) >= 1 and abs(marks - round(marks)) < _WHOLE:
                counts[low], at = round(marks), pulse
            else:
                keep[pulse] = False


def _without_moved(
    times: NDArray[np.float64], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Leave out single pulses that do not stand between their neighbours."""
    if times.size < 2 * _NEIGHBOURS:
        return times, numbers
    before, after = np.diff(numbers)[:-1], np.diff(numbers)[1:]
    pitch = (times[2:] - times[:-2]) / (before + after)
    away = (times[1:-1] - times[:-2]) / pitch - before
    if float(np.max(np.abs(away))) < _MOVED:
        return times, numbers
    away = np.abs(away - running_median(away, _NEIGHBOURS))
    beside = np.maximum(np.append(away[1:], 0.0), np.insert(away[:-1], 0, 0.0))
    keep = np.ones(times.size, dtype=bool)
    keep[1:-1] = (away < max(_MOVED, _SPREADS * float(np.median(away)))) | (away < beside)
    return times[keep], numbers[keep]


def _from_gap(
    times: NDArray[np.float64], numbers: NDArray[np.int64], per_revolution: int, missing_teeth: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
    """Count the marks from the first tooth after the gap of a wheel, and leave out pulses in it; None without a gap."""
    step = np.diff(numbers)
    at_gap = numbers[:-1][step == missing_teeth + 1]
    if at_gap.size == 0:
        return None
    place = int(np.argmax(np.bincount(at_gap % per_revolution, minlength=per_revolution)))
    numbers = numbers - (place - (per_revolution - missing_teeth - 1))
    last_tooth = per_revolution - missing_teeth - 1
    numbers = numbers - _slips(numbers[:-1][step == missing_teeth + 1] - last_tooth, numbers, per_revolution)
    rising = np.diff(numbers, prepend=numbers[0] - 1) > 0
    times, numbers = times[rising], numbers[rising]
    places = numbers[:-1][np.diff(numbers) == missing_teeth + 1] % per_revolution
    passed = np.arange(int(numbers[0]), int(numbers[-1]) - missing_teeth) % per_revolution == last_tooth
    if np.count_nonzero(places == last_tooth) < _INDEX_SHARE * np.count_nonzero(passed):
        return None
    is_tooth = numbers % per_revolution <= last_tooth
    return times[is_tooth], numbers[is_tooth]


def _slips(gaps: NDArray[np.int64], numbers: NDArray[np.int64], per_revolution: int) -> NDArray[np.int64]:
    """Return by how many marks pulses are numbered too high, shape (pulse,), by where the gap is in each turn.

    Args:
        gaps: shape (gap,), places of gaps of the right width: whole turns but for slips, and for gaps by lost pulses.
        numbers: shape (pulse,), of the marks.
    """
    turn = np.floor_divide(gaps + per_revolution // 2, per_revolution)
    off = gaps - turn * per_revolution
    near = np.abs(off) <= _MAX_SLIP
    turn, off = turn[near], off[near]
    by_turn = np.zeros(int(turn.max()) - int(turn.min()) + 1, dtype=np.int64) if turn.size else np.zeros(1, np.int64)
    first = int(turn.min()) if turn.size else 0
    for is_zero in (False, True):  # A turn with a gap in its place has no slip, whatever else is missing in it.
        chosen = (off == 0) == is_zero
        by_turn[turn[chosen] - first] = off[chosen]
    if not np.any(by_turn):
        return np.zeros(numbers.size, dtype=np.int64)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(by_turn, 2), 5)
    by_turn = np.median(around, axis=1).astype(np.int64)
    # A gap at the end of turn n tells of the marks before it and after the gap of the turn before.
    of_pulse = np.floor_divide(numbers + per_revolution - 1, per_revolution) - first
    return by_turn[np.clip(of_pulse, 0, by_turn.size - 1)]
