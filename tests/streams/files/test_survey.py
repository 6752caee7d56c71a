"""What is told of names, levels and rows before anything is configured."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streams.dates.dating import find_readings, nearest_change
from streams.files.survey import surveyed_rows
from streams.types.samples import Samples

LATEST = datetime(2030, 1, 1, tzinfo=UTC).timestamp()
PATTERNS = ("%y%m%d_%H%M%S", "%d%m%Y-%H%M", "%Y-%m-%d", "%d%b%Y_%H-%M-%S", "%Y%j", "%m.%d.%Y %H.%M.%S")


@given(
    st.sampled_from(PATTERNS),
    st.datetimes(datetime(1991, 1, 1), datetime(2029, 1, 1)),
    st.sampled_from(["", "log_", "unit7 ", "x-"]),
)
def test_a_written_date_is_among_the_readings(pattern: str, begin: datetime, prefix: str) -> None:
    begin = begin.replace(microsecond=0, tzinfo=UTC)
    times = [begin + timedelta(days=day) for day in (0, 1, 40)]
    if "%b" not in pattern and "%S" not in pattern:
        times = [time.replace(second=0) for time in times]
    if "%H" not in pattern:
        times = [time.replace(hour=0, minute=0, second=0) for time in times]
    readings = find_readings([f"{prefix}{time:{pattern}}.csv" for time in times], "UTC", LATEST)
    assert times[0].timestamp() in [reading.first for reading in readings]


def test_names_without_a_date_or_with_one_for_all_have_no_reading() -> None:
    for names in (["a1.csv", "a2.csv"], ["run_0001.csv"], ["20240102_1.csv", "20240102_2.csv"], ["991399.csv"], []):
        assert find_readings(names, "UTC", LATEST) == []


def test_a_date_after_the_latest_is_another_number() -> None:
    name = ["300105_120000.csv"]
    assert [r.pattern for r in find_readings(name, "UTC", LATEST)] == ["%d%m%y_%H%M%S"]


def test_the_last_change_decides_between_readings_if_it_is_near_one() -> None:
    readings = find_readings(["240102_1000.csv"], "UTC", LATEST)
    assert len(readings) == 2
    at = datetime(2024, 1, 2, 10, 5, tzinfo=UTC).timestamp()
    assert [r.pattern for r in nearest_change(readings, at)] == ["%y%m%d_%H%M"]
    assert nearest_change(readings, at + 400 * 86400.0) == readings
    assert nearest_change(readings, None) == readings


NOISE = np.random.default_rng(1).normal(size=4000)


def test_rows_are_told_apart_by_titles_and_units() -> None:
    titles = ("acc x", "n [1/min]", "Kraft (kN)", "Temp °C", "vel", "t", "ax")
    units = (None, None, None, None, "mm/s", None, "mg")
    values = np.vstack([NOISE] * 5 + [np.arange(4000.0), NOISE])
    rows = surveyed_rows(Samples(values, names=titles, channels=titles, units=units), None)
    assert [row.kind for row in rows] == ["vibration", "speed", "load", "other", "other", "time", "vibration"]
    assert (rows[-1].unit, rows[-1].factor, rows[-1].written) == ("g", 1e-3, "mg")
    assert rows[-1].level.rms == pytest.approx(1e-3 * NOISE.std())
