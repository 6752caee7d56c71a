"""Judge the times that blocks state: against their order, their lengths, other witnesses of time, and each other.

One state and one observation in, one state and one judged time out. A time is believed while it goes on from those
before. A clock that falls back far, or to where clocks restart, is doubted as long as it stays there; one that was
set is doubted once. A doubted block gets the time that is known best otherwise, with its uncertainty and source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime

from streams.dates.drift import DAY, drift_doubt, span_text, uncertainty_of, with_run
from streams.dates.observed import ClockState, JudgedTime, TimeObservation
from streams.types.stamps import utc_text
from streams.types.times import MIN_TIME, TimeSource

ROLLOVER_S = 1024 * 7 * DAY
"""After so long the week number of GPS begins again."""
_MAX_SET_BACK_S = 30 * DAY
"""Farther back than this no clock is set in use; it has fallen back."""
_MAX_PAUSE_S = 180 * DAY
"""A longer pause is doubted until the next block confirms it."""
_MAX_AHEAD_S = 60.0
_MAX_INTERVALS = 2.5
"""A longer step, in usual intervals, is a gap."""
_MIN_SHARE = 0.9
"""Part of a block that the next one must be later."""
_MIN_BLOCKS, _MAX_BLOCKS = 1.5, 2.5
"""Usual intervals from the last block but one, where the one between was ahead for itself."""
_STAMPS = ("name", "header")
"""Witnesses that are stamps of the start; the last change of a file follows a copy."""
STEADY_BLOCKS = 3
"""Blocks after which the differences of a doubted clock that runs on are used."""
_RESET_WINDOW_S = 2 * DAY
_EPOCH_2000 = 946684800.0
_AGREE_S = 900.0


def judge_time(state: ClockState, seen: TimeObservation, now: float | None = None) -> tuple[ClockState, JudgedTime]:
    """Take the time that a block states into the state.

    Args:
        now: the present, s UTC, for a live stream; None in a replay.
    """
    if not seen.dated:
        return _judge_count(state, seen)
    seen, open_hour = _in_right_hour(state, seen)
    reason = _impossible(state, seen)
    if reason is not None:
        return _doubt(state, seen, _states(seen) + reason)
    if now is not None and seen.time > now + _MAX_AHEAD_S:
        return _doubt_ahead(state, seen, seen.time - now)
    reason = _contradicted(state, seen)
    if reason is None:
        state, found = _believe(state, seen)
        return state, _with_own_doubts(found, seen, open_hour, state)
    reason = _states(seen) + reason
    if _is_confirmed(state, seen):
        return _believe_new(state, seen)
    if _was_ahead(state, seen):
        # The block before was ahead, and its record says nothing of it.
        state, found = _believe(replace(state, time=state.before, before=None, doubted=state.doubted + 1), seen)
        return state, replace(found, doubt=reason)
    if _is_after_reset(state, seen):
        state, found = _believe_new(state, seen)
        return state, replace(found, doubt=reason, holds=False)
    return _doubt(state, seen, reason)


def _states(seen: TimeObservation) -> str:
    return f"states {utc_text(seen.time)}"


def _judge_count(state: ClockState, seen: TimeObservation) -> tuple[ClockState, JudgedTime]:
    """Take seconds from the first block."""
    source = seen.source
    if state.time is not None and seen.time <= state.time:
        doubt = f"{seen.time:g} s are not after {state.time:g} s of the block before"
        return state, JudgedTime(seen.time, None, source, doubt, holds=False)
    gap, interval = _interval(state, seen)
    return replace(state, time=seen.time, interval=interval), JudgedTime(seen.time, None, source, gap=gap)


def _interval(state: ClockState, seen: TimeObservation) -> tuple[bool, float | None]:
    """Return whether there is a gap before a block that is believed, and the usual interval with it."""
    if state.time is None:
        return False, state.interval
    blocks, step = 1 + state.doubted, seen.time - state.time
    gap = seen.in_order and state.interval is not None and step > _MAX_INTERVALS * blocks * state.interval
    if state.interval is None:
        return gap, step / blocks
    return gap, state.interval if state.doubted else min(state.interval, step)


def _in_right_hour(state: ClockState, seen: TimeObservation) -> tuple[TimeObservation, float]:
    """Return the observation in the right one of two equal local hours, and s by which it may be the other one."""
    statement = seen.statement
    if statement is None or statement.repeated_s <= 0.0:
        return seen, 0.0
    later = replace(seen, time=seen.time + statement.repeated_s)
    half = 0.25 * statement.repeated_s
    for source, lag in statement.witnesses:
        # What changes with the file is near the right one, or near none.
        if source == "mtime" and min(abs(lag), abs(lag - statement.repeated_s)) <= min(_AGREE_S, half):
            return (seen if abs(lag) < abs(lag - statement.repeated_s) else later), 0.0
    if state.time is None or statement.hour_is_open:
        return seen, statement.repeated_s
    least = state.time if state.given is None else max(state.time, state.given)
    if seen.time <= least:
        return later, 0.0
    if state.interval is None:
        # The hour before begins without a jump only where files follow each other.
        follows = abs(seen.time - state.time - state.length) <= min(half, max(state.length, 1.0))
        return seen, 0.0 if follows else statement.repeated_s
    expected = state.time + state.interval * (1 + state.doubted)
    if abs(seen.time - expected) <= half:
        return seen, 0.0
    return (later, 0.0) if abs(later.time - expected) <= half else (seen, statement.repeated_s)


def _impossible(state: ClockState, seen: TimeObservation) -> str | None:
    """Return why a time cannot be true whatever was before, behind what is stated, or None."""
    statement = seen.statement
    if statement is not None and not statement.has_place:
        return ", which does not fit the other files, and nothing tells its place"
    if statement is not None and statement.placed_s is not None:
        return ", which does not fit the files before and after"
    if seen.time < MIN_TIME:
        return ": the clock was never set"
    if state.time is None and 0.0 <= seen.time - _EPOCH_2000 < _RESET_WINDOW_S and seen.source != "count":
        return ", where clocks begin that were never set"
    for source, lag in () if statement is None else statement.witnesses:
        if lag > DAY and _is_rollover(lag, 2 * DAY) and source not in state.lags:
            return f", {span_text(lag)} before its {source}: the week number of GPS began again"
        if lag > _MAX_PAUSE_S and source in _STAMPS and is_reset(seen.time):
            return f", where clocks begin, {span_text(lag)} before its {source}"
    return None


def _contradicted(state: ClockState, seen: TimeObservation) -> str | None:
    """Return why a time contradicts those of the blocks before, behind what is stated, or None."""
    if state.time is None:
        return None
    step = seen.time - state.time
    if step <= 0.0:
        return f", {span_text(-step)} before {_before(state)}" if step else f", as {_before(state)} does"
    overlap = state.length - step
    # Those of some loggers overlap by themselves.
    usual = max(state.length - (state.interval or 0.0), 0.0) + (1.0 - _MIN_SHARE) * state.length
    if seen.resolution is not None and overlap > max(usual, 2.0 * seen.resolution):
        return f", {span_text(overlap)} before the end of the block before"
    by_others = _by_witness(state, seen)
    limit = _MAX_INTERVALS * (1 + state.doubted) * (state.interval or step)
    if step > limit and by_others is not None:
        other, source, scatter = by_others
        if abs(other - seen.time) <= _AGREE_S + scatter:
            return None
        if other - state.time <= limit:
            return f", {span_text(step)} after {_before(state)}, but its {source} says {span_text(other - state.time)}"
    if step > _MAX_PAUSE_S:
        return f", {span_text(step)} after {_before(state)}"
    return None


def _before(state: ClockState) -> str:
    return f"the block before ({utc_text(state.time or 0.0)})"


def _is_rollover(lag: float, tolerance: float) -> bool:
    return any(abs(lag - count * ROLLOVER_S) <= tolerance for count in (1, 2))


def is_reset(time: float) -> bool:
    """Return whether a time, s since 1970 UTC, is one at which clocks begin again: in the first days of a year."""
    try:
        moment = datetime.fromtimestamp(time, UTC)
    except (OverflowError, ValueError, OSError):
        return False
    return (time - datetime(moment.year, 1, 1, tzinfo=UTC).timestamp()) < _RESET_WINDOW_S


def _by_witness(state: ClockState, seen: TimeObservation) -> tuple[float, TimeSource, float] | None:
    """Return the start by another witness that went with the clock so far, its source and scatter in s, or None."""
    if seen.statement is None or state.time is None:
        return None
    for source, lag in seen.statement.witnesses:
        usual, scatter = state.lags.get(source, (0.0, None))
        found = seen.time + lag - usual
        if scatter is None and source in _STAMPS and found <= state.time + max(10.0 * (state.interval or 0.0), DAY):
            # Another stamp of the same start needs no history where it goes on.
            scatter = 0.0
        if scatter is None or scatter > 0.5 * (state.interval or state.length):
            continue
        if found >= state.time + 0.9 * state.length + scatter and found <= state.time + _MAX_PAUSE_S:
            return found, source, scatter
    return None


def _is_confirmed(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether a block goes on from a doubted one so that the clock of both is the one that holds."""
    if state.stated is None or not _goes_on(state, seen) or _rolled_over(state, seen) is not None:
        return False
    # One that runs as long as the one before is no worse, unless it began as one that was reset.
    begin = state.stated - state.steady * (state.interval or 0.0)
    longer = state.steady + 1 >= max(STEADY_BLOCKS, state.believed) and not is_reset(begin)
    return state.may_hold or longer


def _goes_on(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether a doubted clock goes on from what it stated before."""
    return state.stated is not None and 0.0 < seen.time - state.stated <= max(10.0 * (state.interval or 0.0), DAY)


def _was_ahead(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether a time goes on from the last block but one, so that the one between was ahead for itself."""
    if state.before is None or state.interval is None or state.time is None or state.doubted:
        return False
    step = seen.time - state.before
    return state.time > seen.time and _MIN_BLOCKS * state.interval <= step <= _MAX_BLOCKS * state.interval


def _is_after_reset(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether the blocks before are those of a clock that began again, and this is the one that was set."""
    if state.time is None or state.began is None or seen.time - state.time <= _MAX_PAUSE_S:
        return False
    return is_reset(state.began) and not is_reset(seen.time)


def _believe(state: ClockState, seen: TimeObservation) -> tuple[ClockState, JudgedTime]:
    """Take a time that is believed."""
    gap, interval = _interval(state, seen)
    advance = None
    if state.doubted and state.given is None and state.stated is not None:
        # Those before have no date: nothing says how long it was.
        advance = interval or 0.0
    began, counted, drift = with_run(state, seen)
    after = replace(
        state,
        run_began=began,
        run_counted=counted,
        drift=drift,
        time=seen.time,
        length=seen.length,
        interval=interval,
        before=None if state.doubted else state.time,
        began=seen.time if state.began is None else state.began,
        believed=state.believed + 1,
        lags=_lags(state, seen),
        stated=None,
        given=None,
        doubted=0,
        steady=0,
        may_hold=False,
    )
    return after, JudgedTime(seen.time, uncertainty_of(after, seen), seen.source, gap=gap, advance=advance)


def _believe_new(state: ClockState, seen: TimeObservation) -> tuple[ClockState, JudgedTime]:
    """Take the time of a clock that was set: what was before does not count for it, but the usual interval."""
    advance = state.interval or 0.0
    if state.stated is not None and _goes_on(state, seen):
        held = state.steady >= STEADY_BLOCKS or state.given is None or state.time is None
        advance = seen.time - state.stated + (0.0 if held or state.given is None else state.given - (state.time or 0.0))
    fresh = ClockState(interval=state.interval, drift=state.drift, lags=state.lags)
    after, found = _believe(fresh, seen)
    return after, replace(found, advance=advance)


def _lags(state: ClockState, seen: TimeObservation) -> Mapping[str, tuple[float, float | None]]:
    """Return how far the other witnesses are from the stated start, and how much that has changed."""
    if seen.statement is None or not seen.statement.witnesses:
        return state.lags
    found: dict[str, tuple[float, float | None]] = {}
    for source, lag in seen.statement.witnesses:
        usual, scatter = state.lags.get(source, (None, None))
        change = None if usual is None else abs(lag - usual)
        found[source] = lag, change if scatter is None or change is None else max(change, 0.9 * scatter)
    return found


def _with_own_doubts(found: JudgedTime, seen: TimeObservation, open_hour: float, state: ClockState) -> JudgedTime:
    """Add the doubts of a time that is the best there is."""
    statement = seen.statement
    if open_hour:
        doubt = f"{_states(seen)} or {span_text(open_hour)} later: the local hour occurs twice, and no file tells which"
        return replace(found, uncertainty=open_hour, doubt=doubt)
    if statement is not None and statement.skipped_s:
        doubt = (
            f"{_states(seen)}: its local time does not exist, {span_text(statement.skipped_s)} are left out in spring"
        )
        return replace(found, uncertainty=statement.skipped_s, doubt=doubt)
    doubt = drift_doubt(state, seen)
    return found if doubt is None else replace(found, doubt=doubt)


def _doubt(state: ClockState, seen: TimeObservation, reason: str) -> tuple[ClockState, JudgedTime]:
    """Give a block whose time is doubted the time that is known best otherwise."""
    if seen.statement is not None and not seen.statement.has_place:
        return state, JudgedTime(None, doubt=reason, stated=seen.time, holds=False)
    goes_on = _goes_on(state, seen)
    steady = state.steady + 1 if goes_on else 0
    given, uncertainty, source, sure = _given(state, seen)
    found = JudgedTime(given, uncertainty, source, reason, stated=seen.time, holds=sure or steady >= STEADY_BLOCKS)
    after = replace(
        state,
        stated=seen.time,
        given=given,
        doubted=state.doubted + 1,
        steady=steady,
        may_hold=state.may_hold if goes_on else _may_hold(state, seen),
    )
    if sure and given is not None:
        return replace(after, time=given, length=seen.length, doubted=0), found
    if given is not None or state.time is not None:
        return after, found
    # Nothing but this clock tells how far the blocks are apart.
    step = seen.time - state.stated if goes_on and state.stated is not None else None
    unset = state.unset + (step or 0.0)
    return replace(after, unset=unset), replace(found, elapsed=unset, advance=step)


def _may_hold(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether a clock that jumps to a time may have been set, which the next block shows."""
    if state.time is None or seen.time < MIN_TIME or (seen.statement and seen.statement.placed_s is not None):
        return False
    back = state.time - seen.time
    return back < 0.0 or (back <= _MAX_SET_BACK_S and not is_reset(seen.time))


def _doubt_ahead(state: ClockState, seen: TimeObservation, ahead: float) -> tuple[ClockState, JudgedTime]:
    """Doubt a time that lies ahead of the present; one less than a day ahead is the best there is."""
    reason = f"states {utc_text(seen.time)}, {span_text(ahead)} ahead of the present"
    if ahead > DAY or (state.time is not None and seen.time <= state.time):
        return _doubt(state, seen, reason)
    after = replace(state, stated=seen.time, given=seen.time, doubted=state.doubted + 1)
    return after, JudgedTime(seen.time, ahead, seen.source, reason)


def _rolled_over(state: ClockState, seen: TimeObservation) -> float | None:
    """Return a time with the weeks that a receiver of GPS has lost, if it goes on from the block before so."""
    if state.time is None:
        return None
    latest = state.time + max(10.0 * (state.interval or 0.0), DAY)
    found = (seen.time + count * ROLLOVER_S for count in (1, 2))
    return next((time for time in found if state.time < time <= latest), None)


def _given(state: ClockState, seen: TimeObservation) -> tuple[float | None, float | None, TimeSource | None, bool]:
    """Return time, uncertainty and source of a doubted block, and whether it is sure enough to go on from it."""
    statement, last = seen.statement, state.time
    if statement is not None and statement.placed_s is not None:
        return seen.time + statement.placed_s, statement.margin_s, "between", False
    resolution, corrected = seen.resolution or 1.0, _rolled_over(state, seen)
    if corrected is not None:
        return corrected, resolution, "rollover", True
    if last is None:
        for source, lag in () if statement is None else statement.witnesses:
            if seen.time + lag >= MIN_TIME:
                return seen.time + lag, resolution if source in _STAMPS else DAY, source, source in _STAMPS
        return None, None, None, False
    by_others = _by_witness(state, seen)
    if by_others is not None:
        other, source, scatter = by_others
        return other, resolution + 2.0 * scatter, source, True
    if _goes_on(state, seen) and state.given is not None and state.stated is not None:
        given = state.given + seen.time - state.stated
        return given, given - last, "order", False
    if state.interval is None:
        return None, None, None, False
    given = last + state.interval * (1 + state.doubted)
    # A time far ahead may be true, and the pause before it long.
    return given, max(given - last, seen.time - given), "order", False
