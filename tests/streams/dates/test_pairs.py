"""Two loggers of one machine that are out of step."""

from __future__ import annotations

import pytest

from streams.dates.clock import judge_time
from streams.dates.observed import ClockState, TimeObservation
from streams.dates.pairs import apart_words, clocks_apart, disjoint_words
from streams.types.times import TimeStatement

T0 = 1774699200.0
HOUR = 3600.0


@pytest.mark.parametrize(
    ("lags", "words"),
    [
        ((2.0, 3.0), None),
        ((2.0, 600.0), None),
        (
            (2.0, 2.0 + 2 * HOUR),
            "times of a are 2 h ahead of those of b, by the last changes of their files; are they of",
        ),
        ((2.0 + 2 * HOUR, 2.0), "times of b are 2 h ahead of those of a"),
        ((0.0, 1337.0), "times of a are 22.3 min ahead of those of b, by the last changes of their files"),
    ],
)
def test_hours_are_a_zone_and_less_is_said_too(lags: tuple[float, float], words: str | None) -> None:
    found = apart_words("a", "b", lags)
    assert (found is None) if words is None else (found or "").startswith(words)
    assert (found or "").endswith("another zone?") is (abs(lags[0] - lags[1]) == 2 * HOUR)


def test_sources_that_never_recorded_together_are_named() -> None:
    spans = {"a": (T0, T0 + HOUR), "b": (T0 + 2 * HOUR, T0 + 3 * HOUR), "c": (T0 + 2.5 * HOUR, T0 + 4 * HOUR)}
    assert list(disjoint_words(spans)) == ["a ends at 2026-03-28T13:00:00Z, before b begins at 2026-03-28T14:00:00Z"]


def clock(lags: list[float]) -> ClockState:
    state = ClockState()
    for k, lag in enumerate(lags):
        statement = TimeStatement("header", 1.0, witnesses=(("mtime", lag),))
        state, _ = judge_time(state, TimeObservation(T0 + 600.0 * k, 10.0, statement=statement))
    return state


def test_clocks_of_live_sources_are_compared_where_their_files_come_as_they_are_written() -> None:
    clocks = {"a": clock([2.0, 3.0, 2.0]), "b": clock([2.0 - HOUR, 4.0 - HOUR]), "c": clock([5.0, 4.0])}
    assert list(clocks_apart(clocks)) == ["b"]
    assert clocks_apart(clocks)["b"].startswith("times of b are 60 min ahead of those of a")
    # Files that were copied together say nothing.
    assert clocks_apart({**clocks, "b": clock([9000.0, 8400.0, 7800.0]), "c": clock([5.0, 4.0])}) == {}
    assert clocks_apart({"a": clocks["a"], "b": clock([9000.0])}) == {}
