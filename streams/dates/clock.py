"""Judge the times that blocks state: against their order, their lengths, other witnesses of time, and each other.

One state and one observation in, one state and one judged time out. A time is believed while it goes on from those
before. A clock that falls back far, or to where clocks restart, is doubted as long as it stays there; one that was
set is doubted once. A doubted block gets the time that is known best otherwise, with its uncertainty and source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from streams.dates.best import (
    MAX_PAUSE_S,
    RESET_WINDOW_S,
    STAMPS,
    best_of,
    by_witness,
    goes_on,
    is_reset,
    is_rollover,
    rolled_over,
)
from streams.dates.drift import DAY, drift_doubt, span_text, uncertainty_of, with_run
from streams.dates.observed import ClockState, JudgedTime, TimeObservation
from streams.types.stamps import utc_text
from streams.types.times import MIN_TIME

_MAX_SET_BACK_S = 30 * DAY
"""Farther back than this no clock is set in use; it has fallen back."""
_MAX_AHEAD_S = 60.0
_MAX_INTERVALS = 2.5
"""A longer step, in usual intervals, is a gap."""
_MIN_SHARE = 0.9
"""Part of a block that the next one must be later."""
_MIN_BLOCKS, _MAX_BLOCKS = 1.5, 2.5
"""Usual intervals from the last block but one, where the one between was ahead for itself."""
STEADY_BLOCKS = 3
"""Blocks after which the differences of a doubted clock that runs on are used."""
_EPOCH_2000 = 946684800.0
_NO_CLOCK = ("source", "count")
"""What the configuration dates, or a model, may lie in the future."""
_AGREE_S = 900.0


def judge_time(
    state: ClockState, seen: TimeObservation, now: float | None = None, latest: float | None = None
) -> tuple[ClockState, JudgedTime]:
    """Take the time that a block states into the state.

    Args:
        now: the present, s UTC, for a live stream; None in a replay.
        latest: a time that no file can have by then, s UTC: a day after the present, as zones differ; None: not known.
    """
    counts = state.time is not None and state.time < MIN_TIME
    if not seen.dated and (state.time is None or counts):
        return _judge_count(state, seen)
    if not seen.dated or not (seen.statement is None or seen.statement.is_stated):
        return _judge_undated(state, seen)
    if counts:
        state = ClockState(interval=state.interval)
    seen, open_hour = _in_right_hour(state, seen)
    reason = _impossible(state, seen)
    if reason is None and latest is not None and seen.time > latest and seen.source not in _NO_CLOCK:
        reason = f", {span_text(seen.time - latest + DAY)} ahead of the present"
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
    if (ahead := _were_ahead(state, seen)) is not None:
        # Those between were ahead, and their records say nothing of it.
        before, blocks = ahead
        among = replace(state, time=before, before=None, jumped=None, doubted=state.doubted + blocks, stated=None)
        state, found = _believe(among, seen)
        many = f"; the {blocks} blocks before were ahead" if blocks > 1 else ""
        return state, replace(found, doubt=reason + many, advance=state.interval if blocks > 1 else None)
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
    if state.time is None and 0.0 <= seen.time - _EPOCH_2000 < RESET_WINDOW_S and seen.source != "count":
        return ", where clocks begin that were never set"
    for source, lag in () if statement is None else statement.witnesses:
        usual, changed = state.lags.get(source, (0.0, None))[0], seen.time + lag
        is_late = source == "mtime" and lag < min(0.0, usual) - DAY
        if is_late and changed >= MIN_TIME and not is_reset(changed):
            return f", {span_text(-lag)} after its last change"
        if lag > DAY and is_rollover(lag, 2 * DAY) and source not in state.lags:
            return f", {span_text(lag)} before its {source}: the week number of GPS began again"
        if lag > MAX_PAUSE_S and source in STAMPS and is_reset(seen.time):
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
    by_others = by_witness(state, seen)
    limit = _MAX_INTERVALS * (1 + state.doubted) * (state.interval or step)
    if step > limit and by_others is not None:
        other, source, scatter = by_others
        if abs(other - seen.time) <= _AGREE_S + scatter:
            return None
        if other - state.time <= limit:
            return f", {span_text(step)} after {_before(state)}, but its {source} says {span_text(other - state.time)}"
    if step > MAX_PAUSE_S:
        return f", {span_text(step)} after {_before(state)}"
    return None


def _before(state: ClockState) -> str:
    return f"the block before ({utc_text(state.time or 0.0)})"


def _is_confirmed(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether a block goes on from a doubted one so that the clock of both is the one that holds."""
    if state.stated is None or not goes_on(state, seen) or rolled_over(state, seen) is not None:
        return False
    # One that runs as long as the one before is no worse, unless it began as one that was reset.
    begin = state.stated - state.steady * (state.interval or 0.0)
    longer = state.steady + 1 >= max(STEADY_BLOCKS, state.believed) and not is_reset(begin)
    return state.may_hold or longer


def _were_ahead(state: ClockState, seen: TimeObservation) -> tuple[float, int] | None:
    """Return the last time before blocks that were ahead, and their number, where a time goes on from there."""
    if state.interval is None or state.time is None or state.doubted or state.time <= seen.time:
        return None
    if state.before is not None:
        step = seen.time - state.before
        if _MIN_BLOCKS * state.interval <= step <= _MAX_BLOCKS * state.interval:
            return state.before, 1
    if state.jumped is None:
        return None
    # What that clock counted itself leaves the two steps to it and back.
    before, first, blocks = state.jumped
    slack = seen.time - before - (state.time - first)
    return (before, blocks) if 0.0 < slack <= 2.0 * _MAX_INTERVALS * state.interval else None


def _jumped(state: ClockState, seen: TimeObservation) -> tuple[float, float, int] | None:
    """Return the latest jump ahead with a block that is believed."""
    last, interval = state.time, state.interval
    if last is None or interval is None or state.doubted or seen.time - last <= _MAX_INTERVALS * interval:
        return None if state.jumped is None else (*state.jumped[:2], state.jumped[2] + 1)
    return last, seen.time, 1


def _is_after_reset(state: ClockState, seen: TimeObservation) -> bool:
    """Return whether the blocks before are those of a clock that began again, and this is the one that was set."""
    if state.time is None or state.began is None or seen.time - state.time <= MAX_PAUSE_S:
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
        jumped=_jumped(state, seen),
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
    if state.stated is not None and goes_on(state, seen):
        held = state.steady >= STEADY_BLOCKS or state.given is None or state.time is None
        advance = seen.time - state.stated + (0.0 if held or state.given is None else state.given - (state.time or 0.0))
    jumped = None
    if state.time is not None and state.stated is not None and state.stated > state.time:
        first = state.stated - state.steady * (state.interval or 0.0)
        jumped = state.time, first, state.steady + 1
    fresh = ClockState(interval=state.interval, drift=state.drift, lags=state.lags, jumped=jumped)
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
    follows = goes_on(state, seen)
    steady = state.steady + 1 if follows else 0
    given, uncertainty, source, sure = best_of(state, seen)
    found = JudgedTime(given, uncertainty, source, reason, stated=seen.time, holds=sure or steady >= STEADY_BLOCKS)
    after = replace(
        state,
        stated=seen.time,
        given=given,
        doubted=state.doubted + 1,
        steady=steady,
        may_hold=state.may_hold if follows else _may_hold(state, seen),
    )
    if sure and given is not None:
        return replace(after, time=given, length=seen.length, doubted=0), found
    if given is not None or state.time is not None:
        return after, found
    # Nothing but this clock tells how far the blocks are apart.
    step = seen.time - state.stated if follows and state.stated is not None else None
    unset = state.unset + (step or 0.0)
    return replace(after, unset=unset), replace(found, elapsed=unset, advance=step)


def _judge_undated(state: ClockState, seen: TimeObservation) -> tuple[ClockState, JudgedTime]:
    """Take a block that states no date where others do; its time is an estimate, if there is one."""
    reason = "states no date, though others of its source do"
    after = replace(state, stated=None, doubted=state.doubted + 1, steady=0, may_hold=False)
    if seen.statement is not None and seen.source == "between":
        return replace(after, given=seen.time), JudgedTime(
            seen.time, seen.statement.margin_s, "between", reason, holds=False
        )
    by_others = by_witness(state, replace(seen, time=0.0))
    if by_others is not None:
        given, source, scatter = by_others
        after = replace(after, time=given, length=seen.length, doubted=0)
        return after, JudgedTime(given, 1.0 + 2.0 * scatter, source, reason)
    if state.time is None or state.interval is None:
        return after, JudgedTime(None, doubt=reason, holds=False)
    follows = state.interval * (1 + state.doubted)
    given = state.time + follows
    return replace(after, given=given), JudgedTime(given, follows, "order", reason, holds=False)


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
