"""A clock that jumps, falls back or repeats an hour: no time of it is taken without a flag, in any format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from tests.support.dated_files import DOUBTED
from tests.support.stated_files import (
    RATE,
    iso,
    noise,
    stamps,
    write_csv,
    write_hdf5,
    write_lvm,
    write_mat,
    write_tdms,
    write_uff,
)
from tests.support.ways_in import by_hand, channel_table

FIRST = datetime(2026, 3, 28, 12, 0, tzinfo=UTC)
EVERY = timedelta(minutes=10)
RIGHT = [FIRST + index * EVERY for index in range(6)]


def _samples(index: int) -> np.ndarray:
    return noise(seed=index + 1)


Make = Callable[[Path, int, datetime], object]
FORMATS: dict[str, tuple[str, str, Make]] = {
    "names of csv": (
        "column = 1",
        f'rate_hz = {RATE}\ntime_name = "%Y%m%d_%H%M%S.csv"',
        lambda folder, index, clock: write_csv(folder / f"{index:02d}_{clock:%Y%m%d_%H%M%S}.csv", _samples(index)),
    ),
    "head of csv": (
        'column = "acc"',
        "",
        lambda folder, index, clock: write_csv(
            folder / f"{index:02d}.csv", _samples(index), [f"fs: {RATE:g}", "Unit: g", f"Start: {iso(clock)}"]
        ),
    ),
    "rows of csv": (
        'column = "acc [g]"',
        "",
        lambda folder, index, clock: write_csv(
            folder / f"{index:02d}.csv", _samples(index), (), ["acc [g]"], before={"timestamp": stamps(1024, clock)}
        ),
    ),
    "hdf5": (
        'key = "acc_1"',
        "",
        lambda folder, index, clock: write_hdf5(
            folder / f"{index:02d}.h5", _samples(index), {"fs": RATE, "start_utc": iso(clock)}, {"unit": "g"}
        ),
    ),
    "tdms": (
        'key = "Vibration/acc_1"',
        "",
        lambda folder, index, clock: write_tdms(
            folder / f"{index:02d}.tdms",
            _samples(index),
            None,
            {
                "wf_increment": 1 / RATE,
                "unit_string": "g",
                "wf_start_time": np.datetime64(clock.replace(tzinfo=None), "us"),
            },
        ),
    ),
    "mat": (
        'key = "acc_1"',
        "",
        lambda folder, index, clock: write_mat(
            folder / f"{index:02d}.mat", _samples(index), {"fs": RATE, "unit": "g", "start_utc": iso(clock)}
        ),
    ),
    "lvm": (
        'column = "acc_1"',
        "",
        lambda folder, index, clock: write_lvm(folder / f"{index:02d}.lvm", _samples(index), "g", clock, clock),
    ),
    "uff": (
        'key = "acc_1"',
        "",
        lambda folder, index, clock: write_uff(
            folder / f"{index:02d}.uff", [(_samples(index)[0], 1 / RATE, "s", "g")], clock
        ),
    ),
}
"""By what dates the files: the channel, further keys of the source, and a maker of the file of a number and a clock."""


def replayed(folder: Path, form: str, clocks: Sequence[datetime]) -> dict[int, tuple[float, set[str]]]:
    """Return time and flags of each file by its number."""
    place, source, make = FORMATS[form]
    (folder / "data").mkdir()
    for index, clock in enumerate(clocks):
        make(folder / "data", index, clock)
    came = by_hand(folder, channel_table(place, "g"), source)
    assert len(came.names) == len(clocks), came.said
    return {int(name[:2]): (time, flags) for name, time, flags in zip(came.names, came.times, came.flags, strict=True)}


def check(found: dict[int, tuple[float, set[str]]], wrong: Sequence[int]) -> None:
    """Assert that the files of a wrong clock are flagged or undated, and that all others have their right time."""
    for index, (time, flags) in found.items():
        if index in wrong:
            assert np.isnan(time) or flags & DOUBTED, f"file {index} is dated {time} without a flag"
        else:
            near = abs(time - RIGHT[index].timestamp()) < 1e-3
            assert near or np.isnan(time) or flags & DOUBTED, f"file {index} is dated {time}, flags {flags}"


@pytest.mark.parametrize("form", FORMATS)
def test_a_right_clock_is_believed(form: str, tmp_path: Path) -> None:
    found = replayed(tmp_path, form, RIGHT)
    assert [found[index][0] for index in range(6)] == [each.timestamp() for each in RIGHT]
    assert not any(flags & DOUBTED for _, flags in found.values())


YEARS = [(form, year) for number, form in enumerate(FORMATS) for year in ((1970, 2006), (1980, 2000, 2019))[number % 2]]


@pytest.mark.parametrize(("form", "year"), YEARS)
def test_a_clock_that_falls_back_to_its_first_year(form: str, year: int, tmp_path: Path) -> None:
    fallen = datetime(year, 1, 1, 0, 0, 12, tzinfo=UTC)
    found = replayed(tmp_path, form, [*RIGHT[:2], fallen, fallen + EVERY, *RIGHT[4:]])
    check(found, (2, 3))


@pytest.mark.parametrize("form", ["names of csv"])
def test_a_clock_that_jumps_ahead_and_back(form: str, tmp_path: Path) -> None:
    ahead = timedelta(days=400)
    check(replayed(tmp_path, form, [*RIGHT[:2], RIGHT[2] + ahead, RIGHT[3] + ahead, *RIGHT[4:]]), (2, 3))


@pytest.mark.parametrize("form", ["names of csv", "head of csv", "lvm", "uff"])
def test_a_clock_that_is_set_back_an_hour_is_flagged_where_it_was(form: str, tmp_path: Path) -> None:
    back = timedelta(hours=1)
    found = replayed(tmp_path, form, [*RIGHT[:3], *(each - back for each in RIGHT[3:])])
    assert found[3][1] & DOUBTED
    assert [found[index][0] for index in range(3)] == [each.timestamp() for each in RIGHT[:3]]
