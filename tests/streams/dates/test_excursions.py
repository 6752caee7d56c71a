"""Runs of files whose clock jumps and comes back, in the order of their names."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from streams.dates.excursions import excursions
from streams.dates.places import NamedTime, places_in_order
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block
from streams.types.spec import SourceSpec

T0 = datetime(2026, 3, 2, 12, tzinfo=UTC).timestamp()
STEP, HOUR, DAY = 600.0, 3600.0, 86400.0


def shifted(count: int, begin: int, end: int, by: float) -> list[float]:
    return [T0 + STEP * k + (by if begin <= k < end else 0.0) for k in range(count)]


@pytest.mark.parametrize("by", [400 * DAY, 20 * DAY, 5 * HOUR, -2 * HOUR, -DAY, -3000 * DAY])
@pytest.mark.parametrize(("begin", "end"), [(3, 4), (3, 9), (10, 40), (40, 79)])
def test_a_run_that_jumps_and_comes_back_is_found_whole(begin: int, end: int, by: float) -> None:
    assert excursions(shifted(120, begin, end, by)) == set(range(begin, end))


def test_two_runs_are_found() -> None:
    times = shifted(60, 5, 9, 2 * DAY)
    times[20:30] = [time - DAY for time in times[20:30]]
    assert excursions(times) == {*range(5, 9), *range(20, 30)}


@pytest.mark.parametrize(
    "times",
    [
        shifted(50, 20, 50, 3 * DAY),
        shifted(50, 20, 50, -HOUR),
        [*shifted(20, 9, 20, 2 * DAY), *shifted(40, 0, 40, 9 * DAY)[20:]],
        # The time of summer, for seven months: the zone is another one.
        [T0 + HOUR * k + (HOUR if 700 <= k < 5800 else 0.0) for k in range(20000)],
        # Most of the files are ahead: they are right, and the others were not set yet.
        shifted(60, 3, 57, 30 * DAY),
    ],
)
def test_a_pause_and_a_clock_that_is_set_are_none(times: list[float]) -> None:
    assert excursions(times) == set()


def in_order(times: list[float]) -> list[NamedTime]:
    return [NamedTime(f"{k:03d}", time, 0.0, f"{k:03d}") for k, time in enumerate(times)]


def test_files_ahead_and_files_without_a_time_are_put_between_their_neighbours() -> None:
    right = shifted(30, 0, 0, 0.0)
    stated = shifted(30, 10, 15, 200 * DAY)
    stated[3] = stated[20] = stated[21] = stated[29] = 0.0
    found = places_in_order(in_order(stated))
    wrong = {3, 20, 21, 29, *range(10, 15)}
    assert {k for k in range(30) if found[f"{k:03d}"].placed_s is not None} == wrong
    for k in wrong:
        place = found[f"{k:03d}"]
        assert place.margin_s >= STEP
        assert abs(stated[k] + (place.placed_s or 0.0) - right[k]) <= place.margin_s


def test_a_pause_behind_a_run_that_was_ahead_does_not_make_it_right() -> None:
    stated = [*shifted(20, 10, 20, 400 * DAY), *shifted(30, 0, 0, 0.0)]
    stated[20:] = [time + 40 * DAY for time in stated[20:]]
    found = places_in_order(in_order(stated))
    assert {k for k in range(50) if found[f"{k:03d}"].placed_s is not None} == set(range(10, 20))


def test_what_is_later_than_the_present_is_wrong_however_many_it_is() -> None:
    stated = shifted(30, 5, 30, 400 * DAY)
    found = places_in_order(in_order(stated), latest=T0 + 100 * DAY)
    assert {k for k in range(30) if found[f"{k:03d}"].placed_s is not None} == set(range(5, 30))
    assert places_in_order(in_order(stated)) == {}


def test_names_that_say_nothing_of_the_order_place_no_file() -> None:
    times = [float(time) for time in np.random.default_rng(3).permutation(shifted(40, 0, 0, 0.0))]
    assert places_in_order(in_order(times)) == {}


def test_a_recording_reads_on_once_where_a_start_is_odd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for k, time in enumerate(shifted(12, 4, 7, 300 * DAY)):
        start = datetime.fromtimestamp(time, UTC).isoformat()
        rows = "\n".join(f"{0.01 * ((i + k) % 7)}" for i in range(1000))
        (tmp_path / f"{k:02d}.csv").write_text(f"Start: {start}\nfs: 1000\nUnit: g\nacc\n{rows}\n")
    source = open_source(SourceSpec("s", f"folder:{tmp_path}", block_s="file"))
    assert isinstance(source, Recording)
    looks = []
    given = source._undated_files
    monkeypatch.setattr(source, "_undated_files", lambda known: looks.append(1) or given(known))
    for _ in range(2):
        blocks = [item for item in source if isinstance(item, Block)]
        assert [k for k, one in enumerate(blocks) if one.stated and one.stated.placed_s is not None] == [4, 5, 6]
    assert looks == [1]
    assert any("3 files state times that do not fit" in words for words in source.remarks)
