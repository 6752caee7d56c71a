"""Names tell the places of their files: by a number that counts, by last changes, or not at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from streams.dates.places import FilePlace, NamedTime, counter_in, places_of, without_date
from streams.types.stamps import repeated_by, stamp_in_name, utc_text


def named(paths: Sequence[str], zone: str = "UTC") -> list[NamedTime]:
    found = []
    for path in paths:
        stamp = stamp_in_name(path, zone)
        assert stamp is not None
        assert stamp.fixed is not None
        repeated = repeated_by(stamp.fixed, zone)
        found.append(NamedTime(path, stamp.fixed, repeated, without_date(path, stamp.text)))
    return found


def placed(
    paths: Sequence[str], changes: Mapping[str, float] | None = None, zone: str = "UTC"
) -> tuple[list[str], dict[str, FilePlace]]:
    """Return the paths in order, and their places."""
    both = named(paths, zone)
    places = places_of(both, counter_in(both), changes or {})
    return sorted(paths, key=lambda path: places[path].rank), places


COUNTED = [
    "00_20260328_120000.csv",
    "01_20260328_121000.csv",
    "02_20060101_000012.csv",
    "03_20060101_001012.csv",
    "04_20260328_124000.csv",
]


def times(paths: Sequence[str], places: Mapping[str, FilePlace]) -> list[str]:
    return [utc_text(one.time + (places[one.path].placed_s or 0.0)) for one in named(paths)]


def test_a_number_that_counts_is_more_certain_than_a_clock_that_fell_back() -> None:
    order, places = placed(COUNTED[::-1])
    assert order == COUNTED
    assert times(COUNTED[2:4], places) == ["2026-03-28T12:20:00Z", "2026-03-28T12:30:00Z"]
    assert [places[path].margin_s for path in COUNTED] == [0.0, 0.0, 600.0, 600.0, 0.0]


@pytest.mark.parametrize(("wrong", "right"), [("20060101_0000", "20260328_1220"), ("20270328_1220", "20260328_1220")])
def test_behind_the_date_and_for_one_file(wrong: str, right: str) -> None:
    paths = [f"run_{date}00_{k:04d}.npy" for k, date in enumerate(
        ["20260328_1200", "20260328_1210", wrong, "20260328_1230", "20260328_1240"], 17
    )]  # fmt: skip
    order, places = placed(sorted(paths, reverse=True))
    assert order == paths
    assert times(paths[2:3], places) == [utc_text(named([f"{right}00.npy"])[0].time)]
    assert [places[path].placed_s is not None for path in paths] == [False, False, True, False, False]


def test_at_the_beginning_and_at_the_end_times_go_on_by_the_usual_interval() -> None:
    paths = [f"{k}_{date}00.npy" for k, date in enumerate(
        ["20000101_0000", "20260328_1210", "20260328_1220", "20260328_1230", "20000101_0000"]
    )]  # fmt: skip
    order, places = placed(paths)
    assert order == paths
    assert times([paths[0], paths[-1]], places) == ["2026-03-28T12:00:00Z", "2026-03-28T12:40:00Z"]
    assert [places[path].margin_s for path in (paths[0], paths[-1])] == [600.0, 600.0]


@pytest.mark.parametrize(
    "paths",
    [
        # Numbers of measuring points, in no order of time.
        ["m2_20240101_120000.csv", "m1_20240102_120000.csv", "m3_20240103_120000.csv"],
        ["a3_20240101_1200.csv", "a1_20240102_1200.csv", "a4_20240103_1200.csv", "a2_20240104_1200.csv"],
        # Constant, or beginning again each day.
        ["b1_20240101_120000.csv", "b1_20240102_120000.csv", "b1_20240103_120000.csv"],
        ["20240101_120000_0001.csv", "20240101_120500_0002.csv", "20240102_120000_0001.csv"],
    ],
)
def test_a_number_that_does_not_count_leaves_the_order_to_the_dates(paths: list[str]) -> None:
    paths = [path.replace("_1200.", "_120000.") for path in paths]
    order, places = placed(paths[::-1])
    assert order == paths
    assert all(place.placed_s is None and place.is_known for place in places.values())


PLAIN = [path[3:] for path in COUNTED]


def test_the_last_changes_tell_the_order_where_they_go_with_the_dates() -> None:
    right = [0.0, 600.0, 1200.0, 1800.0, 2400.0]
    changes = {path: named(PLAIN)[0].time + after + 12.0 for path, after in zip(PLAIN, right, strict=True)}
    order, places = placed(sorted(PLAIN), changes)
    assert order == PLAIN
    assert times(PLAIN[2:4], places) == ["2026-03-28T12:20:00Z", "2026-03-28T12:30:00Z"]


def test_without_any_order_the_place_of_a_wrong_date_is_not_known() -> None:
    copied = {path: 1.8e9 + k for k, path in enumerate(sorted(PLAIN))}
    order, places = placed(sorted(PLAIN), copied)
    assert order == [PLAIN[0], PLAIN[1], PLAIN[4], PLAIN[2], PLAIN[3]]
    assert [places[path].is_known for path in PLAIN] == [True, True, False, False, True]


def test_a_pause_of_years_is_no_wrong_clock() -> None:
    paths = [f"2019{month}01_120000.csv" for month in ("03", "04")] + [f"2024030{day}_120000.csv" for day in (1, 2, 3)]
    order, places = placed(paths[::-1])
    assert order == paths
    assert all(place.placed_s is None and place.is_known for place in places.values())


def test_of_two_equal_local_hours_the_second_in_natural_order_is_the_later_one() -> None:
    hours = ["0150", "0200", "0210", "0220", "0200_1", "0210_1", "0220_1", "0300"]
    paths = [f"20261025_{hour[:4]}00{hour[4:]}.csv" for hour in hours]
    assert placed(sorted(paths), zone="Europe/Rome")[0] == paths


def test_the_last_changes_tell_two_equal_local_hours() -> None:
    paths = ["20261025_023000.csv", "20261025_025000.csv", "20261025_021500.csv", "20261025_024500.csv"]
    start = named(paths, "Europe/Rome")[0].time
    changes = {path: start + 60.0 * after for path, after in zip(paths, (1, 21, 46, 76), strict=True)}
    assert placed(sorted(paths), changes, "Europe/Rome")[0] == paths


def test_a_number_counts_through_an_hour_that_was_set_back() -> None:
    hours = ["0130", "0140", "0150", "0200", "0210", "0220", "0200", "0210", "0220", "0300"]
    paths = [f"{k:02d}_20261025_{hour}00.csv" for k, hour in enumerate(hours)]
    assert placed(paths[::-1], zone="Europe/Rome")[0] == paths


@pytest.mark.parametrize("ahead", ["20260329_1220", "20260327_1220", "20260328_0320"])
def test_a_file_that_jumps_for_itself_has_room_between_its_neighbours(ahead: str) -> None:
    dates = [f"20260328_12{minute:02d}" for minute in range(0, 60, 10)]
    paths = [f"{k:02d}_{ahead if k == 2 else date}00.csv" for k, date in enumerate(dates)]
    order, places = placed(paths[::-1])
    assert order == paths
    assert times(paths[2:3], places) == ["2026-03-28T12:20:00Z"]
    assert [places[path].placed_s is not None for path in paths] == [k == 2 for k in range(6)]


def test_a_pause_and_a_clock_that_was_set_back_leave_no_room_and_are_believed() -> None:
    hours = ["1200", "1210", "1220", "1230", "1130", "1140", "1150", "1900", "1910", "1920"]
    paths = [f"{k:02d}_20260328_{hour}00.csv" for k, hour in enumerate(hours)]
    order, places = placed(paths[::-1])
    assert order == paths
    assert all(place.placed_s is None for place in places.values())


def test_three_digits_behind_the_date_may_count_files() -> None:
    paths = [f"20260328_12{10 * k:02d}00_{k:03d}.csv" for k in range(5)]
    paths[2] = "20060101_000012_002.csv"
    order, places = placed(sorted(paths))
    assert order == paths
    assert abs((places[paths[2]].placed_s or 0.0) + named(paths[2:3])[0].time - named(paths[:1])[0].time - 1200.0) < 1.0


def test_more_files_of_a_clock_that_began_again_do_not_outweigh_those_of_one_that_was_set() -> None:
    dates = ["20260328_120000", *(f"20060101_00{10 * k:02d}12" for k in range(3)), "20260328_124000"]
    paths = [f"{k}_{date}.csv" for k, date in enumerate(dates)]
    order, places = placed(paths[::-1])
    assert order == paths
    assert times(paths[1:4], places) == [f"2026-03-28T12:{minute}:00Z" for minute in (10, 20, 30)]


def test_where_nothing_tells_the_hour_it_is_open() -> None:
    paths = [f"20261025_{hour}00.csv" for hour in ("0150", "0200", "0210", "0210_1", "0220", "0300")]
    paths = [path.replace("_100", "00_1") for path in paths]
    order, places = placed(paths[::-1], zone="Europe/Rome")
    assert order == [*paths[:3], paths[4], paths[3], paths[5]]
    assert [path for path in paths if places[path].hour_is_open] == [paths[1], paths[4]]
    hours = ("0140", "0150", "0200", "0210", "0220", "0210", "0300")
    counted = [f"{k:02d}_20261025_{hour}00.csv" for k, hour in enumerate(hours)]
    assert not any(place.hour_is_open for place in placed(counted, zone="Europe/Rome")[1].values())
