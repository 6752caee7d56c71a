"""The places of files whose names state their time, told by all names at once: what counts them, which clock was wrong.

A number that counts files is more certain than a clock. By it, or by the times of the last changes, a clock that fell
back or jumped ahead shows as files that do not fit between their neighbours.
"""

from __future__ import annotations

import itertools
import re
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from streams.dates.best import is_reset
from streams.dates.dating import numbers_of
from streams.dates.excursions import excursions
from streams.types.listing import natural_key
from streams.types.stamps import Order, Stamp, repeated_by, utc_text
from streams.types.times import MIN_TIME, TimeStatement

_DAY = 86400.0
_ERA_S = 30 * _DAY
"""Times farther apart, from file to file in order, are of two settings of a clock."""
_MAX_PAUSE_S = 10 * 365.25 * _DAY
_MAX_PAUSE_AFTER_RESET_S = 180 * _DAY
"""A longer pause is no pause: of the files on its sides, the fewer have a wrong clock."""
_MIN_COUNTED, _MIN_COUNTED_PADDED = 6, 4
"""Files from which a number counts them though a clock was set back; with fewer, its times must rise in each era.
Numbers with leading zeros are more likely to count."""
_DENSE = 1.5
_AGREE_S = 900.0
_FRACTION = re.compile(r"[-_.,](\d{3}|\d{6})$")
_PADDED = 2
"""Rank of a number with leading zeros, see ``numbers_of``."""


@dataclass(frozen=True)
class NamedTime:
    """A file whose name states its time.

    Attributes:
        time: s since 1970 UTC, the first one where the local hour occurs twice.
        repeated_s: how much later it is the second time, else 0.
        rest: its path without the date.
    """

    path: str
    time: float
    repeated_s: float
    rest: str


@dataclass(frozen=True)
class FilePlace:
    """Where a file comes among all.

    Attributes:
        rank: from 0.
        placed_s: what its neighbours add to the stated time, None where that is believed; ``margin_s`` its uncertainty.
        is_known: whether anything tells its place.
        hour_is_open: whether nothing tells which of two equal local hours it is of.
    """

    rank: int
    placed_s: float | None = None
    margin_s: float = 0.0
    is_known: bool = True
    hour_is_open: bool = False


def named_time(path: str, full: str, stamp: Stamp, order: Order | None, zone: str) -> NamedTime | None:
    """Return the time in a name, None where its order of day and month is open.

    Args:
        path: of the file; ``full`` the same with the folders above.
        zone: IANA name of the zone of local times.
    """
    time = stamp.fixed if order is None else stamp.at(order)
    if time is None:
        return None
    repeated_s = repeated_by(time, zone) if stamp.local and not stamp.skipped else 0.0
    return NamedTime(path, time, repeated_s, without_date(full, stamp.text))


def without_date(path: str, text: str) -> str:
    """Return a path without the ``text`` of its date; what may be a fraction of a second may count as well."""
    fraction = _FRACTION.search(text)
    return path.replace(text, "_" if fraction is None else f"_{fraction[1]}", 1)


def counter_in(named: Sequence[NamedTime]) -> int | None:
    """Return which number beside the date counts files, from the right; None where none does, or it says no more.

    It is another one in every name, leaves out few numbers, and the times rise with it, but where a clock was wrong.
    """
    rows = [numbers_of(one.rest) for one in named]
    if len(rows) < 3 or len({len(row) for row in rows}) != 1:
        return None
    for place in range(1, len(rows[0]) + 1):
        values = [row[-place].value for row in rows]
        if len(set(values)) < len(values) or max(values) - min(values) >= _DENSE * len(values):
            continue
        times = [one.time for _, one in sorted(zip(values, named, strict=True), key=lambda pair: pair[0])]
        padded = any(row[-place].rank == _PADDED for row in rows)
        if _rises(times, _MIN_COUNTED_PADDED if padded else _MIN_COUNTED):
            return place
    return None


def _rises(times: Sequence[float], many: int) -> bool:
    """Return whether times rise in each era, with few exceptions where there are ``many``."""
    eras: dict[int, list[float]] = {}
    for era, time in zip(_eras(times), times, strict=True):
        eras.setdefault(era, []).append(time)
    falls = sum(after < before for era in eras.values() for before, after in itertools.pairwise(era))
    return falls <= (max(1, len(times) // 8) if len(times) >= many else 0)


def _eras(times: Sequence[float]) -> list[int]:
    """Return the era of each time: those that a walk in order of time reaches by steps below ``_ERA_S``."""
    found: dict[float, int] = {}
    era, last = 0, None
    for time in sorted(set(times)):
        era += last is not None and time - last > _ERA_S
        found[time], last = era, time
    return [found[time] for time in times]


def counted(named: NamedTime, place: int) -> int | None:
    """Return the number of a name that counts files, None where it has no such."""
    numbers = numbers_of(named.rest)
    return numbers[-place].value if len(numbers) >= place else None


def places_of(
    named: Sequence[NamedTime], counter: int | None, changes: Mapping[str, float], latest: float | None = None
) -> dict[str, FilePlace]:
    """Return the place of each file, and the time of those whose clock was wrong, by path.

    Args:
        named: all files whose names state their time.
        counter: which number counts files, see :func:`counter_in`.
        changes: time of the last change of each file, s since 1970 UTC; {} where not known.
        latest: a time that no file can have by now, s since 1970 UTC; None where that is not known.
    """
    ordered, is_open = _in_hours(named, changes)
    if counter is not None:
        is_open = set()
        ordered.sort(key=lambda one: (counted(one, counter) is None, counted(one, counter) or 0))
    wrong = _wrong(ordered, latest) if counter is None else _unfit(ordered, latest)
    if not wrong:
        return {one.path: FilePlace(rank, hour_is_open=one.path in is_open) for rank, one in enumerate(ordered)}
    if counter is None:
        right = [one for one in ordered if one.path not in wrong]
        if not _go_together(right, changes):
            last = [one for one in ordered if one.path in wrong]
            known = {one.path: FilePlace(rank, hour_is_open=one.path in is_open) for rank, one in enumerate(right)}
            return known | {one.path: FilePlace(rank, is_known=False) for rank, one in enumerate(last, len(right))}
        ordered.sort(key=lambda one: changes[one.path])
    return _between(ordered, wrong)


def places_in_order(files: Sequence[NamedTime], latest: float | None = None) -> dict[str, FilePlace]:
    """Return the place of each file of some whose order is known by their names, not by the times that they state.

    Args:
        files: in that order; ``time`` is 0 where a file states none.
        latest: as of :func:`places_of`.

    Returns:
        By path; ``placed_s`` of a file without a time is its time. Empty where the times do not follow the order.
    """
    named = [one for one in files if one.time]
    if len(named) < 2 or not _rises([one.time for one in _through_hour(named)], _MIN_COUNTED_PADDED):
        return {}
    wrong = _unfit(named, latest) | {one.path for one in files if not one.time}
    return _between(files, wrong) if wrong else {}


def placed(stated: TimeStatement, place: FilePlace) -> TimeStatement:
    """Return what a name states with what the others add."""
    if place == FilePlace(place.rank):
        return stated
    return replace(
        stated,
        placed_s=place.placed_s,
        margin_s=place.margin_s,
        hour_is_open=place.hour_is_open,
        has_place=place.is_known,
    )


def wrong_words(named: Iterable[NamedTime], places: Mapping[str, FilePlace]) -> str | None:
    """Return which files have a wrong clock, None where none has."""
    wrong = [one for one in named if places[one.path].placed_s is not None or not places[one.path].is_known]
    if not wrong:
        return None
    files = "1 file states a time that does" if len(wrong) == 1 else f"{len(wrong)} files state times that do"
    return f"{files} not fit those of the other files ({wrong[0].path}: {utc_text(wrong[0].time)})"


def _in_hours(named: Sequence[NamedTime], changes: Mapping[str, float]) -> tuple[list[NamedTime], set[str]]:
    """Return the files in order of time, those of the second of two equal local hours behind those of the first.

    Of two files of the same time, the second in natural order is of the second hour; others are told by their changes.
    The paths are of those of which nothing tells the hour.
    """
    found: list[tuple[float, tuple[tuple[int, int, str], ...], NamedTime]] = []
    seen: set[float] = set()
    is_open: set[str] = set()
    times = Counter(one.time for one in named if one.repeated_s)
    for one in sorted(named, key=lambda one: (one.time, natural_key(one.path))):
        time, changed = one.time, changes.get(one.path)
        if one.repeated_s:
            near = None if changed is None else changed - one.time
            is_second = near is not None and abs(near - one.repeated_s) <= _AGREE_S < abs(near)
            is_first = near is not None and abs(near) <= _AGREE_S < abs(near - one.repeated_s)
            if is_second or (time in seen and not is_first):
                time += one.repeated_s
            if not (is_first or is_second or times[one.time] > 1):
                is_open.add(one.path)
            seen.add(one.time)
        found.append((time, natural_key(one.path), one))
    return [one for *_, one in sorted(found, key=lambda row: row[:2])], is_open


def may_be_wrong(named: Iterable[NamedTime]) -> bool:
    """Return whether times are so far apart that a clock may have been wrong."""
    times = sorted(one.time for one in named)
    return any(after - before > _ERA_S for before, after in itertools.pairwise(times))


def _through_hour(ordered: Sequence[NamedTime]) -> list[NamedTime]:
    """Return files with the later one of two equal local hours where they come after those of the first one."""
    found: list[NamedTime] = []
    for one in ordered:
        is_second = bool(found) and one.repeated_s > 0.0 and one.time <= found[-1].time
        found.append(replace(one, time=one.time + one.repeated_s) if is_second else one)
    return found


def _unfit(ordered: Sequence[NamedTime], latest: float | None) -> set[str]:
    """Return the files of which the time does not fit an order that is known otherwise."""
    wrong = _excursions(ordered)
    wrong |= _wrong([one for one in ordered if one.path not in wrong], latest)
    return wrong | _excursions([one for one in ordered if one.path not in wrong])


def _excursions(ordered: Sequence[NamedTime]) -> set[str]:
    return {ordered[place].path for place in excursions([one.time for one in _through_hour(ordered)])}


def _wrong(ordered: Sequence[NamedTime], latest: float | None = None) -> set[str]:
    """Return the files whose time does not fit those before and after: of eras that contradict, the shorter."""
    segments: list[list[NamedTime]] = []
    for one in ordered:
        if segments and abs(one.time - segments[-1][-1].time) <= _ERA_S:
            segments[-1].append(one)
        else:
            segments.append([one])
    if len(segments) < 2:
        return set()
    segments, out = _without_ahead(segments, latest)
    # The heaviest chain of segments in which time rises without a pause of years.
    best: list[tuple[float, int | None]] = []
    for place, segment in enumerate(segments):
        before = [
            (best[i][0], i)
            for i in range(max(0, place - 200), place)
            if segments[i][-1].time < segment[0].time <= _latest_after(segments[i])
        ]
        weight, link = max(before, default=(0.0, None))
        best.append((weight + _weight(segment), link))
    chosen: set[int] = set()
    # Of two that weigh the same the later one: clocks are set sooner than they are lost.
    place: int | None = max(range(len(best)), key=lambda i: (best[i][0], i))
    while place is not None:
        chosen.add(place)
        place = best[place][1]
    return out | {one.path for i, segment in enumerate(segments) if i not in chosen for one in segment}


def _without_ahead(segments: Sequence[list[NamedTime]], latest: float | None) -> tuple[list[list[NamedTime]], set[str]]:
    """Return the segments without those that were ahead, and the files of these.

    They are later than the present, or the next one goes on from the one before: no clock is set back to where it was,
    but one that begins again.
    """
    past = [one for one in segments if latest is None or one[-1].time <= latest] or list(segments)
    kept = past[:1]
    for segment, after in itertools.zip_longest(past[1:], past[2:]):
        before = kept[-1]
        around = 0.0
        if after is not None and before[-1].time < after[0].time < segment[0].time and not is_reset(after[0].time):
            around = _weight(before) + _weight(after)
        if not around or around < 0.5 * len(segment) or is_reset(before[0].time):
            kept.append(segment)
    paths = {one.path for segment in kept for one in segment}
    return kept, {one.path for segment in segments for one in segment} - paths


def _weight(segment: Sequence[NamedTime]) -> float:
    """Return how much the files of one setting of a clock count: next to nothing where it has begun again."""
    return len(segment) * (1.0 if segment[0].time >= MIN_TIME and not is_reset(segment[0].time) else 1e-3)


def _latest_after(segment: Sequence[NamedTime]) -> float:
    """Return until when files may follow those of a segment without a change of the clock."""
    pause = _MAX_PAUSE_AFTER_RESET_S if is_reset(segment[0].time) else _MAX_PAUSE_S
    return segment[-1].time + pause


def _go_together(right: Sequence[NamedTime], changes: Mapping[str, float]) -> bool:
    """Return whether the last changes of files go with their times, and so tell the order of others."""
    if len(right) < 2 or any(one.path not in changes for one in right):
        return False
    lags = [changes[one.path] - one.time for one in right]
    span = max(one.time for one in right) - min(one.time for one in right)
    return max(lags) - min(lags) <= min(0.1 * span, 3600.0)


def _between(ordered: Sequence[NamedTime], wrong: set[str]) -> dict[str, FilePlace]:
    """FilePlace the files with a wrong clock between their neighbours; that clock tells how far they are apart."""
    found = {one.path: FilePlace(rank) for rank, one in enumerate(ordered)}
    right = [one.time for one in ordered if one.path not in wrong]
    steps = [after - before for before, after in itertools.pairwise(right) if after > before]
    interval = statistics.median_low(steps) if steps else 0.0
    for begin, end in _runs([one.path in wrong for one in ordered]):
        run = ordered[begin:end]
        before = ordered[begin - 1].time if begin else None
        after = ordered[end].time if end < len(ordered) else None
        for one, (time, margin) in zip(run, _times(run, before, after, interval), strict=True):
            found[one.path] = replace(found[one.path], placed_s=time - one.time, margin_s=margin)
    return found


def _runs(flags: Sequence[bool]) -> list[tuple[int, int]]:
    """Return begin and end of each run of true values."""
    edges = [i for i in range(len(flags) + 1) if (i > 0 and flags[i - 1]) != (i < len(flags) and flags[i])]
    return list(zip(edges[::2], edges[1::2], strict=True))


def _times(
    run: Sequence[NamedTime], before: float | None, after: float | None, interval: float
) -> list[tuple[float, float]]:
    """Return time and uncertainty of the files of a run, s, from its neighbours and the interval of the others, s."""
    own = [one.time - run[0].time for one in run]
    steady = all(0.0 < b - a <= max(10.0 * interval, _DAY) for a, b in itertools.pairwise(own))
    if before is not None and after is not None:
        slack = after - before - own[-1]
        if steady and slack > 0.0:
            return [(before + 0.5 * slack + offset, 0.5 * slack) for offset in own]
        step = (after - before) / (len(run) + 1)
        return [
            (before + step * (i + 1), max(step * (i + 1), after - before - step * (i + 1))) for i in range(len(run))
        ]
    if not steady:
        own = [interval * i for i in range(len(run))]
    if before is not None:
        return [(before + interval + offset, interval + offset) for offset in own]
    # Nothing says how long before the others they were.
    end = (after or 0.0) - interval - own[-1]
    return [(end + offset, interval + own[-1] - offset) for offset in own]
