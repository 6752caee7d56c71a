"""Runs of files whose clock jumped and came back, in an order that is known otherwise."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Sequence

from streams.dates.drift import DAY
from streams.types.samples import Samples

_MAX_RUN, _MIN_STEPS, _MAX_LOOKS = 20, 3, 1000
_ODD_INTERVALS = 10.0
_MIN_SHARE, _MAX_SHARE = 0.8, 2.5
"""Time that files between two others take each, in usual intervals."""
_SUMMER_S, _MIN_SUMMER_S = 3600.0, 30 * DAY
"""A clock that is an hour ahead for so long shows the time of summer, in a zone that is not the configured one."""
_NOT_STATED = ("count", "mtime", "name", "name_local", "folder")
"""What is no statement of a header; names are all known at once."""


def excursions(times: Sequence[float]) -> set[int]:
    """Return which times, s in the order of the files, jump ahead or back for a while: those around have room."""
    steps = [after - before for before, after in itertools.pairwise(times) if after > before]
    interval = statistics.median_low(steps) if len(steps) >= _MIN_STEPS else 0.0
    found: set[int] = set()
    place, looks = 1, _MAX_LOOKS
    while interval and place < len(times) and looks:
        before = times[place - 1]
        fits = before < times[place] <= before + _ODD_INTERVALS * interval
        run = 0 if fits else _run_ahead(times, place, interval) or _run_of_a_clock(times, place, interval)
        looks -= not fits
        found |= {*range(place, place + run)}
        place += run + 1
    return found


def _run_ahead(times: Sequence[float], place: int, interval: float) -> int:
    """Return how many files from a place on do not fit between that before and the first behind that does, or 0."""
    before = times[place - 1]
    for run in range(1, min(_MAX_RUN, len(times) - place - 1) + 1):
        behind = times[place + run] - before
        if _MIN_SHARE * (run + 1) * interval <= behind <= _MAX_SHARE * (run + 1) * interval:
            inside = any(before < one < before + behind for one in times[place : place + run])
            return 0 if inside else run
    return 0


def _run_of_a_clock(times: Sequence[float], place: int, interval: float) -> int:
    """Return how many files from a place on are of a clock that jumped and came back by as much, or 0.

    What it counted itself leaves the two steps there and back; one of them leads back in time, which none does.
    """
    before, first = times[place - 1], times[place]
    for end in range(place + 1, len(times)):
        step = times[end] - times[end - 1]
        if 0.0 < step <= _ODD_INTERVALS * interval:
            continue
        slack = times[end] - before - (times[end - 1] - first)
        if 0.0 < slack <= 2.0 * _MAX_SHARE * interval and (step <= 0.0 or first <= before):
            run, off = end - place, abs(first - before - 0.5 * slack)
            is_summer = abs(off - _SUMMER_S) <= interval and times[end - 1] - first > _MIN_SUMMER_S
            # A clock that is right for less than half of the files is set, not wrong for a while.
            return 0 if is_summer or 2 * run > len(times) else run
        if step <= 0.0:
            return 0
    return 0


class Steps:
    """Tells from file to file in order whether a start is odd, once."""

    def __init__(self, *, looked: bool) -> None:
        """Begin before the first file, or behind others; not ``looked``: those are known to have had a wrong clock."""
        self._last: float | None = None
        self._interval: float | None = None
        self._is_due, self._done = not looked, False

    def is_odd(self, result: object) -> bool:
        """Return whether the start of what was loaded is missing, or does not go on from that before, the first time.

        Other files are read for it, so that a pause is not odd that is about as long as others.
        """
        if (
            self._done
            or not isinstance(result, Samples)
            or result.stated is None
            or result.stated.source in _NOT_STATED
        ):
            return False
        start, last = result.start, self._last
        odd = self._is_due or start is None or not result.stated.is_stated
        if start is not None and last is not None and not odd:
            step = start - last
            odd = step <= 0.0 or (self._interval is not None and step > _ODD_INTERVALS * self._interval)
            self._interval = step if self._interval is None else min(step, self._interval)
        self._last, self._done = start, odd
        return odd
