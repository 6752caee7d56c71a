"""The time that is known best of a block whose stated time is doubted, and how clocks begin again."""

from __future__ import annotations

from datetime import UTC, datetime

from streams.dates.drift import DAY
from streams.dates.observed import ClockState, TimeObservation
from streams.types.times import MIN_TIME, TimeSource

ROLLOVER_S = 1024 * 7 * DAY
"""After so long the week number of GPS begins again."""
MAX_PAUSE_S = 180 * DAY
"""A longer pause is doubted until the next block confirms it."""
STAMPS = ("name", "header")
"""Witnesses that are stamps of the start; the last change of a file follows a copy."""
RESET_WINDOW_S = 2 * DAY
_MIN_PRESENT = 1767225600.0
"""2026-01-01 UTC, s: a computer whose own clock is before it was never set."""


def latest_of(now: float) -> float | None:
    """Return a time that nothing can state which is recorded by now, s UTC; None where the clock here is wrong.

    Zones that are not known differ by less than a day.
    """
    return now + DAY if now >= _MIN_PRESENT else None


def is_rollover(lag: float, tolerance: float) -> bool:
    """Return whether a time, s, is that after which the week number of GPS begins again, once or twice."""
    return any(abs(lag - count * ROLLOVER_S) <= tolerance for count in (1, 2))


def is_reset(time: float) -> bool:
    """Return whether a time, s since 1970 UTC, is one at which clocks begin again: in the first days of a year."""
    try:
        moment = datetime.fromtimestamp(time, UTC)
    except (OverflowError, ValueError, OSError):
        return False
    return (time - datetime(moment.year, 1, 1, tzinfo=UTC).timestamp()) < RESET_WINDOW_S


def by_witness(state: ClockState, seen: TimeObservation) -> tuple[float, TimeSource, float] | None:
    """Return the start by another witness that went with the clock so far, its source and scatter in s, or None."""
    if seen.statement is None or state.time is None:
        return None
    for source, lag in seen.statement.witnesses:
        usual, scatter = state.lags.get(source, (0.0, None))
        found = seen.time + lag - usual
        if scatter is None and source in STAMPS and found <= state.time + max(10.0 * (state.interval or 0.0), DAY):
            # Another stamp of the same start needs no history where it goes on.
            scatter = 0.0
        if scatter is None or scatter > 0.5 * (state.interval or state.length):
            continue
        if found >= state.time + 0.9 * state.length + scatter and found <= state.time + MAX_PAUSE_S:
            return found, source, scatter
    return None


def goes_on(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether a doubted clock goes on from what it stated before."""
    return state.stated is not None and 0.0 < seen.time - state.stated <= max(10.0 * (state.interval or 0.0), DAY)


def rolled_over(state: ClockState, seen: TimeObservation) -> float | None:
    """Return a time with the weeks that a receiver of GPS has lost, if it goes on from the block before so."""
    if state.time is None:
        return None
    latest = state.time + max(10.0 * (state.interval or 0.0), DAY)
    found = (seen.time + count * ROLLOVER_S for count in (1, 2))
    return next((time for time in found if state.time < time <= latest), None)


def best_of(state: ClockState, seen: TimeObservation) -> tuple[float | None, float | None, TimeSource | None, bool]:
    """Return time, uncertainty and source of a doubted block, and whether it is sure enough to go on from it."""
    statement, last = seen.statement, state.time
    if statement is not None and statement.placed_s is not None:
        placed, other = seen.time + statement.placed_s, by_witness(state, seen)
        if other is not None and other[1] in STAMPS and abs(other[0] - placed) <= statement.margin_s:
            return other[0], seen.resolution or 1.0, other[1], True
        return placed, statement.margin_s, "between", False
    resolution, corrected = seen.resolution or 1.0, rolled_over(state, seen)
    if corrected is not None:
        return corrected, resolution, "rollover", True
    if last is None:
        for source, lag in () if statement is None else statement.witnesses:
            if seen.time + lag >= MIN_TIME:
                return seen.time + lag, resolution if source in STAMPS else max(DAY, -lag), source, source in STAMPS
        return None, None, None, False
    by_others = by_witness(state, seen)
    if by_others is not None:
        other, source, scatter = by_others
        return other, resolution + 2.0 * scatter, source, True
    if goes_on(state, seen) and state.given is not None and state.stated is not None:
        given = state.given + seen.time - state.stated
        return given, given - last, "order", False
    if state.interval is None:
        return None, None, None, False
    given = last + state.interval * (1 + state.doubted)
    # A time far ahead may be true, and the pause before it long.
    return given, max(given - last, seen.time - given), "order", False
