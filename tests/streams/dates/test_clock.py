"""Clocks that fall back, jump, are set, repeat an hour or drift: what is doubted, and which time a block gets."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import pytest

from streams.dates.clock import judge_time
from streams.dates.drift import drift_words
from streams.dates.observed import ClockState, JudgedTime, TimeObservation
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block
from streams.types.spec import SourceSpec
from streams.types.times import TimeSource, TimeStatement

T0 = datetime(2026, 3, 28, 12, tzinfo=UTC).timestamp()
STEP = 600.0
HOUR, DAY, YEAR = 3600.0, 86400.0, 365 * 86400.0
ROLLOVER = 619315200.0


def at(*date: int) -> float:
    return datetime(*date, tzinfo=UTC).timestamp()


def judged(
    times: Sequence[float],
    length: float = 10.0,
    statements: Sequence[TimeStatement | None] | None = None,
    now: Sequence[float] | None = None,
) -> tuple[ClockState, list[JudgedTime]]:
    state, found = ClockState(), []
    for k, time in enumerate(times):
        seen = TimeObservation(time, length, statement=None if statements is None else statements[k])
        state, one = judge_time(state, seen, None if now is None else now[k])
        found.append(one)
    return state, found


def steps(first: float, count: int, step: float = STEP) -> list[float]:
    return [first + step * k for k in range(count)]


class Case(NamedTuple):
    """Stated times, which of them are doubted, and the times of all blocks."""

    stated: list[float]
    doubted: set[int]
    times: list[float | None]


GOOD = steps(T0, 12)
CASES = {
    "good": Case(GOOD, set(), [*GOOD]),
    "a gap is none": Case([*GOOD[:5], *steps(T0 + 20 * DAY, 4)], set(), [*GOOD[:5], *steps(T0 + 20 * DAY, 4)]),
    "two of 2006": Case([*GOOD[:4], *steps(at(2006, 1, 1), 2), *GOOD[6:]], {4, 5}, [*GOOD]),
    "two of another day of 2007": Case([*GOOD[:4], *steps(at(2007, 5, 20, 7), 2), *GOOD[6:]], {4, 5}, [*GOOD]),
    "back to 1970 and there": Case([*GOOD[:4], *steps(30.0, 8)], {*range(4, 12)}, [*GOOD]),
    "back to 1980": Case([*GOOD[:4], *steps(at(1980, 1, 6), 8)], {*range(4, 12)}, [*GOOD]),
    "back to 2000, and again": Case(
        [*GOOD[:4], *steps(at(2000, 1, 1), 3), *steps(at(2000, 1, 1), 3), *GOOD[10:]], {*range(4, 10)}, [*GOOD]
    ),
    "the week begins again": Case([*GOOD[:4], *(t - ROLLOVER for t in GOOD[4:])], {*range(4, 12)}, [*GOOD]),
    "a year ahead for one": Case([*GOOD[:4], GOOD[4] + YEAR, *GOOD[5:]], {4}, [*GOOD]),
    "a year ahead to stay": Case(
        [*GOOD[:4], *(t + YEAR for t in GOOD[4:])], {4}, [*GOOD[:5], *(t + YEAR for t in GOOD[5:])]
    ),
    "set back by an hour": Case(
        [*GOOD[:4], *(t - HOUR for t in GOOD[4:])], {4}, [*GOOD[:5], *(t - HOUR for t in GOOD[5:])]
    ),
    "set back by a day for one": Case([*GOOD[:4], GOOD[4] - DAY, *GOOD[5:]], {4}, [*GOOD]),
    "a day ahead for one": Case([*GOOD[:4], GOOD[4] + DAY, *GOOD[5:]], {5}, [*GOOD[:4], GOOD[4] + DAY, *GOOD[5:]]),
    "the same time again": Case([*GOOD[:4], GOOD[3], *GOOD[5:]], {4}, [*GOOD]),
    "set after its start": Case([*steps(at(2006, 1, 1), 3), *GOOD[3:]], {3}, [*steps(at(2006, 1, 1), 3), *GOOD[3:]]),
    "never set": Case(steps(30.0, 4), {0, 1, 2, 3}, [None] * 4),
    "not set at its start": Case([*steps(30.0, 3), *GOOD[3:]], {0, 1, 2}, [None, None, None, *GOOD[3:]]),
    "2000 at its start": Case([*steps(at(2000, 1, 1), 3), *GOOD[3:]], {0, 1, 2}, [None, None, None, *GOOD[3:]]),
    "the first one a year ahead": Case(
        [GOOD[0] + YEAR, *GOOD[1:]], {1, 2, 3}, [GOOD[0] + YEAR, None, None, None, *GOOD[4:]]
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_what_is_doubted_and_which_time_it_gets(name: str) -> None:
    case = CASES[name]
    _, found = judged(case.stated)
    assert {k for k, one in enumerate(found) if one.doubt} == case.doubted
    assert [one.time for one in found] == case.times
    for one, stated in zip(found, case.stated, strict=True):
        if one.doubt and one.time != stated:
            assert one.stated == stated
            assert one.time is None or (one.uncertainty or 0.0) > 0.0
        else:
            assert one.source == "source"


def test_an_estimated_time_is_less_sure_from_block_to_block() -> None:
    _, found = judged([*GOOD[:4], *steps(30.0, 5)])
    assert [one.uncertainty for one in found[4:]] == [STEP * k for k in range(1, 6)]
    assert {one.source for one in found[4:]} == {"order"}
    # From the third one on that clock tells at least how far the blocks are apart.
    assert [one.holds for one in found] == [*[True] * 4, *[False] * 3, *[True] * 2]


def test_a_clock_that_was_set_says_how_much_time_has_passed() -> None:
    _, found = judged([*GOOD[:4], *(t - HOUR for t in GOOD[4:])])
    assert [one.advance for one in found] == [*[None] * 5, 2 * STEP, *[None] * 6]


def test_a_clock_that_was_never_set_counts_from_the_first_block() -> None:
    _, found = judged([*steps(30.0, 3), *GOOD[3:5]])
    assert [one.elapsed for one in found] == [0.0, STEP, 2 * STEP, None, None]


def test_the_present_shows_what_lies_ahead() -> None:
    _, found = judged(GOOD, now=[*GOOD[:4], GOOD[4] - 120.0, GOOD[5] - 10 * DAY, *GOOD[6:]])
    assert [bool(one.doubt) for one in found] == [k in (4, 5) for k in range(12)]
    assert (found[4].time, found[4].uncertainty) == (GOOD[4], 120.0)
    assert (found[5].time, found[5].stated) == (GOOD[5], GOOD[5])


def local(witness: float | None = None, repeated_s: float = 0.0, skipped_s: float = 0.0) -> TimeStatement:
    witnesses: dict[TimeSource, float] = {} if witness is None else {"mtime": witness}
    return TimeStatement("header_local", 1.0, repeated_s, skipped_s, witnesses=tuple(witnesses.items()))


def test_the_hour_that_occurs_twice_follows_the_order() -> None:
    first = at(2026, 10, 25, 0, 0)
    # From 1:40 on; what is stated of the second hour is read as the first.
    right = steps(first - 20 * 60, 16)
    stated = [t if t < first + HOUR else t - HOUR if t < first + 2 * HOUR else t for t in right]
    statements = [local(repeated_s=HOUR if first <= t < first + HOUR else 0.0) for t in stated]
    _, found = judged(stated, statements=statements)
    assert [one.time for one in found] == right
    assert not any(one.doubt for one in found)


def test_where_nothing_tells_the_hour_it_is_doubted() -> None:
    first = at(2026, 10, 25, 0, 0)
    stated = [first - 5 * HOUR, first - 2.5 * HOUR, first + 0.5 * HOUR]
    _, found = judged(stated, statements=[local(), local(), local(repeated_s=HOUR)])
    assert (found[2].time, found[2].uncertainty) == (stated[2], HOUR)
    assert "occurs twice" in found[2].doubt


@pytest.mark.parametrize("late", [0.0, HOUR])
def test_the_last_change_tells_the_hour(late: float) -> None:
    first = at(2026, 10, 25, 0, 0)
    stated = [first - 5 * HOUR, first + 0.5 * HOUR]
    _, found = judged(stated, statements=[local(2.0), local(late + 2.0, repeated_s=HOUR)])
    assert (found[1].time, found[1].doubt) == (stated[1] + late, "")


def test_the_hour_that_is_left_out_is_doubted() -> None:
    _, found = judged(GOOD[:2], statements=[local(), local(skipped_s=HOUR)])
    assert (found[1].time, found[1].uncertainty) == (GOOD[1], HOUR)
    assert "does not exist" in found[1].doubt


@pytest.mark.parametrize("source", ["mtime", "name"])
def test_another_witness_dates_a_block_whose_clock_fell_back(source: TimeSource) -> None:
    # The pauses differ, so that no usual interval tells the time.
    right = [T0, T0 + 500.0, T0 + 1700.0, T0 + 2600.0, T0 + 5600.0]
    stated = [*right[:3], at(2006, 1, 1, 5), right[4]]
    lag = [3.0, 4.0, 3.0, right[3] - stated[3] + 3.5, 3.0]
    statements = [TimeStatement("header", 1.0, witnesses=((source, one),)) for one in lag]
    _, found = judged(stated, statements=statements)
    assert [bool(one.doubt) for one in found] == [False, False, False, True, False]
    assert found[3].time == pytest.approx(right[3], abs=1.0)
    assert found[3].source == source
    assert abs((found[3].time or 0.0) - right[3]) <= (found[3].uncertainty or 0.0)


def test_a_name_shows_that_the_week_began_again_from_the_first_block_on() -> None:
    statements = [TimeStatement("header", 1.0, witnesses=(("name", ROLLOVER),))] * 4
    _, found = judged([t - ROLLOVER for t in GOOD[:4]], statements=statements)
    assert [one.time for one in found] == GOOD[:4]
    assert all(one.doubt for one in found)


def test_a_name_dates_a_block_whose_clock_had_begun_again_before_the_first_one() -> None:
    begin = at(2006, 1, 1)
    stated = [begin + t - T0 + 5.0 for t in GOOD[:6]] + GOOD[6:]
    statements = [TimeStatement("header", 1.0, witnesses=(("name", t - s),)) for t, s in zip(GOOD, stated, strict=True)]
    _, found = judged(stated, statements=statements)
    assert [one.time for one in found] == GOOD
    assert [one.source for one in found] == [*["name"] * 6, *["header"] * 6]
    assert [bool(one.doubt) for one in found] == [k < 6 for k in range(12)]


@pytest.mark.parametrize("ppm", [0.0, 40.0, -200.0, 3000.0])
def test_a_clock_that_drifts_against_the_samples(ppm: float) -> None:
    length = 60.0
    statement = TimeStatement("header", 1e-3)
    stated = [T0 + length * (1.0 + 1e-6 * ppm) * k for k in range(100)]
    state, found = judged(stated, length, [statement] * 100)
    assert state.drift == pytest.approx((99 * length * 1e-6 * ppm, 99 * length), abs=1e-4)
    assert bool(found[-1].doubt) is (ppm > 1000.0)
    assert found[-1].time == stated[-1]
    ahead = abs(99 * length * 1e-6 * ppm)
    assert found[-1].uncertainty == pytest.approx(1e-3 + ahead if ahead > 2e-3 else 1e-3, abs=1e-4)
    assert ppm == 0.0 or f"({ppm:+.3g} ppm)" in drift_words(state.drift or (0.0, 1.0))


def test_times_of_whole_seconds_are_no_drift() -> None:
    state, found = judged([float(int(T0 + 5.12 * k)) for k in range(200)], 5.12)
    assert not any(one.doubt for one in found)
    assert abs((state.drift or (9.0, 1.0))[0]) <= 1.0


def test_a_block_that_begins_before_the_end_of_the_one_before_is_doubted_once() -> None:
    follow = [T0 + 5.0 * k for k in range(10)]
    stated = [*follow[:5], *(t - 3.0 for t in follow[5:])]
    statements = [TimeStatement("header", 1e-3)] * 10
    _, found = judged(stated, 5.0, statements)
    assert [bool(one.doubt) for one in found] == [k == 5 for k in range(10)]
    assert [one.time for one in found] == [*follow[:6], *stated[6:]]
    # Those that overlap all the time are of such a logger.
    assert not any(one.doubt for one in judged([T0 + 2.5 * k for k in range(10)], 5.0, statements)[1])


def test_a_name_that_contradicts_the_header_is_said_once(tmp_path: Path) -> None:
    rows = "\n".join(f"{0.01 * (i % 7)}" for i in range(2000))
    for number in (1, 2):
        text = f"Start: 2024-05-0{number}T12:00:00Z\nfs: 1000\nUnit: g\nacc\n{rows}\n"
        (tmp_path / f"x_2023050{number}_120000.csv").write_text(text)
    source = open_source(SourceSpec("s", f"folder:{tmp_path}", block_s="file"))
    assert isinstance(source, Recording)
    assert len([item for item in source if isinstance(item, Block)]) == 2
    (said,) = [words for words in source.remarks if "x_20230501" in words]
    assert "its header states 2024-05-01T12:00:00Z, its name 2023-05-01T12:00:00Z" in said


@pytest.mark.parametrize("ahead", [20 * DAY, YEAR])
@pytest.mark.parametrize("count", [2, 5, 40])
def test_a_clock_that_comes_back_says_that_the_blocks_before_were_ahead(ahead: float, count: int) -> None:
    right = steps(T0, 60)
    stated = [t + ahead if 8 <= k < 8 + count else t for k, t in enumerate(right)]
    _, found = judged(stated)
    back = found[8 + count]
    assert (back.time, back.stated) == (right[8 + count], None)
    assert f"the {count} blocks before were ahead" in back.doubt
    assert back.advance == STEP
    assert [one.time for one in found[8 + count :]] == right[8 + count :]
    assert not any(one.doubt for one in found[9 + count :])


def test_a_pause_and_a_clock_that_falls_back_to_its_end_are_no_run_that_was_ahead() -> None:
    stated = [*steps(T0, 6), *steps(T0 + 5 * DAY, 6), *steps(T0 + 5 * DAY - HOUR, 3)]
    _, found = judged(stated)
    assert [bool(one.doubt) for one in found] == [k == 12 for k in range(15)]
    assert "were ahead" not in found[12].doubt


@pytest.mark.parametrize("source", ["header", "name", "count"])
def test_nothing_recorded_is_later_than_the_present(source: TimeSource) -> None:
    stated = [*GOOD[:4], *steps(T0 + YEAR, 3), *GOOD[7:]]
    state, found = ClockState(), []
    for time in stated:
        seen = TimeObservation(time, 10.0, statement=TimeStatement(source, 1.0))
        state, one = judge_time(state, seen, latest=GOOD[-1] + DAY)
        found.append(one)
    doubted = [k for k, one in enumerate(found) if "ahead of the present" in one.doubt]
    # What the configuration counts may lie ahead.
    assert doubted == ([] if source == "count" else [4, 5, 6])
    if source != "count":
        assert [one.time for one in found] == GOOD


def test_a_file_is_not_changed_last_before_it_begins() -> None:
    statements = [TimeStatement("header", 1.0, witnesses=(("mtime", lag),)) for lag in (10.0, 11.0, -3 * DAY, 10.0)]
    _, found = judged([*GOOD[:2], GOOD[2] + 3 * DAY, GOOD[3]], statements=statements)
    assert [bool(one.doubt) for one in found] == [False, False, True, False]
    assert "after its last change" in found[2].doubt
    assert found[2].time == pytest.approx(GOOD[2], abs=20.0)
    # A copy keeps no time, and a computer whose clock was never set dates nothing.
    never_set = at(2000, 1, 1) - T0
    for lag in (400 * DAY, never_set):
        copied = [TimeStatement("header", 1.0, witnesses=(("mtime", lag - t + T0),)) for t in GOOD]
        assert not any(one.doubt for one in judged(GOOD, statements=copied)[1])


def undated(*witnesses: tuple[TimeSource, float]) -> TimeObservation:
    return TimeObservation(0.0, 10.0, statement=TimeStatement("order", is_stated=False, witnesses=witnesses))


def test_a_block_without_a_date_is_estimated_and_doubted() -> None:
    state, found = ClockState(), []
    for time in GOOD[:4]:
        state, _ = judge_time(state, TimeObservation(time, 10.0))
    for seen in (undated(), undated(), TimeObservation(GOOD[6], 10.0)):
        state, one = judge_time(state, seen)
        found.append(one)
    assert [one.time for one in found] == GOOD[4:7]
    assert [one.source for one in found] == ["order", "order", "source"]
    assert [one.uncertainty for one in found] == [STEP, 2 * STEP, 1.0]
    assert [bool(one.doubt) for one in found] == [True, True, False]
    assert [one.holds for one in found] == [False, False, True]


def test_the_last_change_dates_a_block_without_a_date_where_it_went_with_the_clock() -> None:
    state = ClockState()
    for time in GOOD[:4]:
        seen = TimeObservation(time, 10.0, statement=TimeStatement("header", 1.0, witnesses=(("mtime", 30.0),)))
        state, _ = judge_time(state, seen)
    _, one = judge_time(state, undated(("mtime", GOOD[4] + 95.0)))
    assert (one.time, one.source) == (GOOD[4] + 65.0, "mtime")
    assert one.doubt


def test_seconds_among_dates_are_no_dates_and_dates_after_seconds_are() -> None:
    state, found = ClockState(), []
    for time, dated in ((0.0, False), (600.0, False), (T0, True), (T0 + STEP, True), (2400.0, False), (GOOD[3], True)):
        state, one = judge_time(state, TimeObservation(time, 10.0, dated))
        found.append(one)
    assert [one.time for one in found] == [0.0, 600.0, *GOOD[:2], GOOD[2], GOOD[3]]
    assert [bool(one.doubt) for one in found] == [False, False, False, False, True, False]
