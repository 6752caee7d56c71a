"""Zones and orders of dates, rates without a unit: read where one meaning is left, refused where there are two."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

import spallwatch as sw
from tests.support.stated_files import RATE, noise, seconds, write_csv, write_hdf5, write_mat, write_tdms

ROWS = noise()
COUNT = ROWS.shape[1]
WINTER, SUMMER = "2025-01-10 08:15:00", "2025-07-10 08:15:00"
Words = dict[str, Any]


def csv(folder: Path, words: Words) -> Path:
    head = [f"{key}: {value}" for key, value in words.items()]
    return write_csv(folder / "x.csv", ROWS, head, ["acc [g]"])


def hdf5(folder: Path, words: Words) -> Path:
    return write_hdf5(folder / "x.h5", ROWS, {**words, "unit": "g"})


def mat(folder: Path, words: Words) -> Path:
    return write_mat(folder / "x.mat", ROWS, {key.replace(" ", "_"): value for key, value in words.items()}, unit="g")


MAKERS: dict[str, Callable[[Path, Words], Path]] = {"csv": csv, "hdf5": hdf5, "mat": mat}


def utc(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()


def start_of(path: Path, **how: Any) -> float:
    return datetime.fromisoformat(sw.read(path, **how).attrs["start_utc"]).timestamp()


MINUTES_OR_SECONDS = {
    "-300": -5.0,
    "330": 5.5,
    "60": 1.0,
    "3600": 1.0,
    "-18000": -5.0,
    "20700": 5.75,
    "14": 14.0,
    "0": 0,
}


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize(
    ("key", "value", "start", "hours"),
    [
        ("GMT offset h", "-6", WINTER, -6),
        ("UTC offset", "-6.0", WINTER, -6),
        ("UTC offset", "+05:30", WINTER, 5.5),
        ("TZ", "-0600", WINTER, -6),
        ("Time zone", "UTC-6", SUMMER, -6),
        ("Time zone", "Central Standard Time", WINTER, -6),
        ("Time zone", "Central Daylight Time", SUMMER, -5),
        ("Time zone", "W. Europe Standard Time", WINTER, 1),
        ("Time zone", "(UTC+01:00) Amsterdam, Berlin, Rome", WINTER, 1),
        ("Zeitzone", "Mitteleuropaische Sommerzeit", SUMMER, 2),
        ("UTC offset min", "330", WINTER, 5.5),
        *(("TimeZoneOffset", text, WINTER, hours) for text, hours in MINUTES_OR_SECONDS.items()),
        ("Time zone", "Europe/Berlin", SUMMER, 2),
    ],
)
def test_a_zone_is_read(maker: str, key: str, value: str, start: str, hours: float, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": RATE, "start": start, key: value})
    assert start_of(path) == utc(start) - 3600.0 * hours


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize(
    ("key", "value", "start"),
    [
        ("Time zone", "CST", WINTER),
        ("Time zone", "of the plant", WINTER),
        ("TimeZoneOffset", "-500", WINTER),
        ("TimeZoneOffset", "900", WINTER),
        ("TimeZoneOffset", "-100000", WINTER),
        ("UTC offset h", "-300", WINTER),
        ("Time zone", "(UTC+01:00) Amsterdam, Berlin, Rome", SUMMER),
        ("Time zone", "Central Standard Time", SUMMER),
    ],
)
def test_a_zone_that_is_open_leaves_no_time(maker: str, key: str, value: str, start: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": RATE, "start": start, key: value})
    with pytest.raises(sw.SpallwatchError, match=r"the zone of .* is open, by .*timezone.*disregard"):
        sw.read(path)
    assert start_of(path, disregard=[key], timezone="Asia/Kolkata") == utc(start) - 5.5 * 3600.0


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize(("flag", "is_open"), [("on", True), ("off", False)])
def test_summer_time_beside_an_offset_is_open(maker: str, flag: str, is_open: bool, tmp_path: Path) -> None:
    words = {"fs": RATE, "start": SUMMER, "UTC offset": "+1", "Daylight saving": flag}
    path = MAKERS[maker](tmp_path, words)
    if is_open:
        with pytest.raises(sw.SpallwatchError, match=r"is open, by .*'\+1' and .*daylightsaving 'on'|'Daylight"):
            sw.read(path)
    else:
        assert start_of(path) == utc(SUMMER) - 3600.0


def test_a_zone_counts_for_a_column_of_dates(tmp_path: Path) -> None:
    rows = [f"2025-01-10 08:15:{i / RATE:09.6f}" for i in range(COUNT)]
    path = write_csv(tmp_path / "x.csv", ROWS, ["GMT offset (h): -6"], ["acc [g]"], before={"time": rows})
    assert start_of(path) == utc(WINTER) + 6 * 3600.0


def test_two_zones_that_differ_are_refused(tmp_path: Path) -> None:
    path = csv(tmp_path, {"fs": RATE, "start": SUMMER, "Time zone": "Europe/Berlin", "UTC offset": "+1"})
    with pytest.raises(sw.SpallwatchError, match=r"timezone 'Europe/Berlin' and utcoffset '\+1'"):
        sw.read(path)
    assert (
        start_of(csv(tmp_path, {"fs": RATE, "start": SUMMER, "Zone": "3", "UTC offset": "+2"})) == utc(SUMMER) - 7200.0
    )


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("rate", [12.8, 25.6, 51.2, 50, 102.4])
def test_a_rate_that_may_be_in_khz_is_asked(maker: str, rate: float, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": rate})
    with pytest.raises(sw.SpallwatchError, match=rf"may mean {rate:g} or {1e3 * rate:g} Hz"):
        sw.read(path)
    assert sw.read(path, rate_hz=1e3 * rate).attrs["rate_hz"] == 1e3 * rate
    assert sw.read(path, rate_hz=rate).attrs["rate_hz"] == rate


@pytest.mark.parametrize("maker", MAKERS)
def test_a_rate_of_any_vibration_and_one_with_its_unit_are_read(maker: str, tmp_path: Path) -> None:
    for words, rate in (({"fs": 200}, 200.0), ({"fs": 97656.25}, 97656.25), ({"fs_khz": 12.8}, 12800.0)):
        assert sw.read(MAKERS[maker](tmp_path, words)).attrs["rate_hz"] == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("maker", MAKERS)
def test_another_statement_decides_between_hz_and_khz(maker: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": 12.8, "sampling rate": "12800 Hz"})
    assert sw.read(path).attrs["rate_hz"] == 12800.0
    path = MAKERS[maker](tmp_path, {"fs": 12.8, "sampling rate": "25600 Hz"})
    with pytest.raises(sw.SpallwatchError, match="several sampling rates"):
        sw.read(path)


def test_times_decide_between_hz_and_khz(tmp_path: Path) -> None:
    times = {"time [s]": seconds(COUNT, rate=12800.0)}
    assert (
        sw.read(write_csv(tmp_path / "x.csv", ROWS, ["Fs: 12.8"], ["acc [g]"], before=times)).attrs["rate_hz"]
        == 12800.0
    )


def test_a_step_of_labview_is_in_seconds(tmp_path: Path) -> None:
    path = write_tdms(tmp_path / "x.tdms", ROWS, {}, {"wf_increment": 0.02, "unit_string": "g"})
    assert sw.read(path).attrs["rate_hz"] == 50.0


@pytest.mark.parametrize("maker", MAKERS)
def test_decimation_leaves_two_rates(maker: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": 51200, "decimation": 4})
    with pytest.raises(sw.SpallwatchError, match="may mean 51200 or 12800 Hz"):
        sw.read(path)
    assert sw.read(path, disregard=["decimation"]).attrs["rate_hz"] == 51200.0
    assert sw.read(path, rate_hz=12800).attrs["rate_hz"] == 12800.0
    assert sw.read(MAKERS[maker](tmp_path, {"fs": 51200, "decimation": 1})).attrs["rate_hz"] == 51200.0


@pytest.mark.parametrize(
    ("title", "unit", "origin"),
    [("Timestamp (OLE2)", "d", 25569), ("Timestamp (OLE2)", "", 25569), ("Time", "d", 25569), ("datenum", "d", 719529)],
)
def test_days_of_excel_and_matlab_are_read(title: str, unit: str, origin: int, tmp_path: Path) -> None:
    began = utc(WINTER) / 86400.0 + origin
    times = [f"{began + i / 200.0 / 86400.0:.11f}" for i in range(COUNT)]
    path = write_csv(tmp_path / "x.csv", ROWS, [], ["acc"], before={title: times}, units=[unit, "m/s2"])
    assert sw.read(path).attrs["rate_hz"] == pytest.approx(200.0, rel=1e-4)
    assert start_of(path) == pytest.approx(utc(WINTER), abs=1e-3)


@pytest.mark.parametrize(("unit", "size"), [("h", 3600.0), ("min", 60.0), ("d", 86400.0)])
def test_times_in_hours_and_days_need_their_unit(unit: str, size: float, tmp_path: Path) -> None:
    times = [f"{i / 10000.0 / size:.13f}" for i in range(COUNT)]
    path = write_csv(tmp_path / "x.csv", ROWS, [], ["acc [g]"], before={f"Time [{unit}]": times})
    assert sw.read(path).attrs["rate_hz"] == pytest.approx(10000.0, rel=1e-4)
    path = write_csv(tmp_path / "y.csv", ROWS, [], ["acc [g]"], before={"Time": times})
    if size > 60.0:
        with pytest.raises(sw.SpallwatchError, match=r"may mean .* or .*10000 or|may mean .* or 10000"):
            sw.read(path)


TWO_DIGITS = {"25/03/21 08:15:00": "year_first", "25-03-21 08:15:00": "year_first", "21/03/25 08:15:00": "day_first"}


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("text", TWO_DIGITS)
def test_three_parts_of_two_digits_have_an_order_that_is_asked(maker: str, text: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": RATE, "start": text})
    with pytest.raises(
        sw.SpallwatchError, match=r"202\d-03-2\dT08:15:00Z \(day first\) or 202\d-03-2\dT08:15:00Z \(year first\)"
    ):
        sw.read(path)
    other = "day_first" if TWO_DIGITS[text] == "year_first" else "year_first"
    assert start_of(path, date_order=TWO_DIGITS[text]) == utc("2025-03-21 08:15:00")
    assert start_of(path, date_order=other) == utc("2021-03-25 08:15:00")


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize(
    ("text", "read"),
    [("21.03.25 08:15:00", "2025-03-21"), ("03/21/25 08:15:00", "2025-03-21"), ("99/03/21 08:15:00", "1999-03-21"),
     ("25/3/5 08:15:00", "2025-03-05"), ("30/03/25 08:15:00", "2025-03-30")],
)  # fmt: skip
def test_an_order_that_leaves_one_reading_is_read(maker: str, text: str, read: str, tmp_path: Path) -> None:
    assert start_of(MAKERS[maker](tmp_path, {"fs": RATE, "start": text})) == utc(f"{read} 08:15:00")


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("day", ["2025-03-21", "2021-03-25"])
def test_another_statement_decides_the_order(maker: str, day: str, tmp_path: Path) -> None:
    words = {"fs": RATE, "start": "25/03/21 08:15:00"}
    assert start_of(MAKERS[maker](tmp_path, {**words, "recorded": f"{day} 08:15:00"})) == utc(f"{day} 08:15:00")
    path = MAKERS[maker](tmp_path, words)
    named = path.rename(tmp_path / f"{day}T08-15-00{path.suffix}")
    assert start_of(named) == utc(f"{day} 08:15:00")


@pytest.mark.parametrize("first", ["25/03/21", "12/03/21"])
def test_rows_past_midnight_decide_the_order(first: str, tmp_path: Path) -> None:
    def dated(second: float) -> Path:
        begin = datetime.strptime(first, "%y/%m/%d").replace(hour=23, minute=59)
        moments = [begin + timedelta(seconds=second + i / RATE) for i in range(COUNT)]
        times = [f"{moment:%y/%m/%d %H:%M:%S.%f}" for moment in moments]
        return write_csv(tmp_path / "x.csv", ROWS, [], ["acc [g]"], before={"Time": times})

    assert start_of(dated(59.9)) == pytest.approx(utc(f"20{first.replace('/', '-')} 23:59:00") + 59.9)
    with pytest.raises(sw.SpallwatchError, match=r"\(day first\) or .*\(year first\)"):
        sw.read(dated(0.0))
