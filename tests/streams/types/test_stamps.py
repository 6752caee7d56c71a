"""Dates in headers and in names of files, as loggers write them, and which number of a name counts."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from streams.dates.dating import place_in_names
from streams.dates.order import evidence, orders_left
from streams.files.formats.text import read_layout
from streams.files.statements import plain_key, time_statements
from streams.types.stamps import ORDERS, Order, compiled, read_stamp, stamp_in_name, utc_text

EVENING = datetime(2024, 1, 31, 23, 59, 58, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("2024-01-31T23-59-58.npy", 0.0),
        ("log_1706745598.csv", 0.0),
        ("log_1706745598250.csv", 0.25),
        ("press_2024-01-31_23-59-58_x.csv", 0.0),
        ("2024.01.31.23.59.58.wav", 0.0),
        ("2024-01-31 23.59.58.wav", 0.0),
        ("2024-01-31T23:59:58Z.npy", 0.0),
        ("2024-01-31T23-59-58+0100.npy", -3600.0),
        ("2024-01-31T23_59_58+01_00.npy", -3600.0),
        ("m_20240131_235958CET.npy", -3600.0),
        ("m_20240131_235958 MESZ.npy", -7200.0),
        ("m_20240131_235958_UTC.npy", 0.0),
        ("m_20240131_235958_GMTX.npy", 0.0),
        ("20240131_235958.npy", 0.0),
        ("rec20240131T235958.npy", 0.0),
        ("20240131235958.h5", 0.0),
        ("20240131-235958_123.npy", 0.123),
        ("20240131_235958.123456.npy", 0.123456),
        ("20240131235958250.npy", 0.25),
        ("20240131_235958_0001.npy", 0.0),
        ("31.01.2024_23.59.58.csv", 0.0),
        ("31-01-2024_23-59-58.csv", 0.0),
        ("01-31-2024_11-59-58 PM.csv", 0.0),
        ("2024-01-31_23-59.csv", -58.0),
        ("2024-01-31/23-59-58.npy", 0.0),
        ("20240131/a_235958.npy", None),
        ("20240131/235958.npy", 0.0),
        ("rec_0001.npy", None),
        ("20240131.npy", None),
        ("2024-01-31_0001.npy", None),
        ("20240131_240000.npy", None),
        ("20240231_235958.npy", None),
        ("20240131_235958_20240201_000458.npy", None),
        ("20240131_235958_20240131_235958.npy", 0.0),
        ("1231231231231234.npy", None),
    ],
)
def test_dates_in_names(name: str, more: float | None) -> None:
    stamp = stamp_in_name(name, "UTC")
    assert (None if stamp is None else stamp.fixed or stamp.at(stamp.orders[0])) == (
        None if more is None else pytest.approx(EVENING + more, abs=1e-6)
    )


def test_a_name_is_in_the_zone_of_the_machine() -> None:
    stamp = stamp_in_name("20240201_005958.npy", "Europe/Berlin")
    assert stamp is not None
    assert stamp.fixed == EVENING


@pytest.mark.parametrize(
    ("pattern", "name"),
    [
        ("%Y%m%d_%H%M%S", "press_20240131_235958_7.npy"),
        ("%d-%m-%Y_%H-%M-%S", "31-01-2024_23-59-58.npy"),
        ("%m-%d-%Y_%H-%M-%S", "01-31-2024_23-59-58.npy"),
        ("%y%m%d%H%M%S", "240131235958.wav"),
        ("%Y%j-%H%M%S", "2024031-235958.wav"),
        ("%Y-%m-%d/%H%M%S", "2024-01-31/235958.wav"),
        ("x%d%b%Y %I.%M.%S%p", "x31Jan2024 11.59.58PM.wav"),
    ],
)
def test_dates_by_a_pattern(pattern: str, name: str) -> None:
    stamp = stamp_in_name(name, "UTC", pattern)
    assert stamp is not None
    assert stamp.fixed == EVENING
    assert stamp_in_name("rec_0001.npy", "UTC", pattern) is None


@pytest.mark.parametrize("pattern", ["%H%M%S", "%Y%m", "%Q%Y%m%d", "%Y%Y%m%d", "%Y%m%d%"])
def test_patterns_that_date_nothing_are_refused(pattern: str) -> None:
    with pytest.raises(ValueError, match="%"):
        compiled(pattern)


@pytest.mark.parametrize(
    ("text", "day", "month", "year"),
    [
        ("2024-01-31T23:59:58", "2024-01-31T23:59:58Z", "2024-01-31T23:59:58Z", None),
        ("2024/01/31 23:59:58", "2024-01-31T23:59:58Z", "2024-01-31T23:59:58Z", None),
        ("31.01.2024 23:59:58", "2024-01-31T23:59:58Z", "2024-01-31T23:59:58Z", None),
        ("03.04.2024 10:00:00 Uhr", "2024-04-03T10:00:00Z", "2024-04-03T10:00:00Z", None),
        ("03.04.24, 10:00", "2024-04-03T10:00:00Z", "2024-04-03T10:00:00Z", None),
        ("31-Jan-2024 23:59:58", "2024-01-31T23:59:58Z", "2024-01-31T23:59:58Z", None),
        ("03/04/2024 10:00:00.250", "2024-04-03T10:00:00.250Z", "2024-03-04T10:00:00.250Z", None),
        ("03/04/24 10:00:00,25", "2024-04-03T10:00:00.250Z", "2024-03-04T10:00:00.250Z", "2003-04-24T10:00:00.250Z"),
        ("3/4/2024 10:00:00 PM", "2024-04-03T22:00:00Z", "2024-03-04T22:00:00Z", None),
        ("3/4/24 10:00:00 PM", "2024-04-03T22:00:00Z", "2024-03-04T22:00:00Z", None),
        ("03-04-2024 12:00:00 am", "2024-04-03T00:00:00Z", "2024-03-04T00:00:00Z", None),
        ("13/04/2024 10:00:00", "2024-04-13T10:00:00Z", None, None),
        ("04/13/2024 10:00:00 +02:00", None, "2024-04-13T08:00:00Z", None),
        ("04.13.2024 10:00:00", None, "2024-04-13T10:00:00Z", None),
        ("13/13/2024 10:00:00", None, None, None),
        ("24-03-04 10:00:00", "2004-03-24T10:00:00Z", None, "2024-03-04T10:00:00Z"),
        ("25/03/21 10:00", "2021-03-25T10:00:00Z", None, "2025-03-21T10:00:00Z"),
        ("03/25/21 10:00", None, "2021-03-25T10:00:00Z", None),
        ("25/3/5 10:00", None, None, "2025-03-05T10:00:00Z"),
        ("99.03.21 10:00", None, None, "1999-03-21T10:00:00Z"),
        ("03/04/2024", None, None, None),
        ("soon", None, None, None),
    ],
)
def test_stamps_have_the_readings_that_their_text_allows(
    text: str, day: str | None, month: str | None, year: str | None
) -> None:
    stamp = read_stamp(text, "UTC")
    found = (None,) * 3 if stamp is None else tuple(map(stamp.at, ORDERS))
    assert tuple(None if time is None else utc_text(time) for time in found) == (day, month, year)


def left(*texts: str) -> tuple[frozenset[Order], list[str]]:
    """What stamps of files a, b, ... leave at the end of 2026."""
    stamps = [(name, read_stamp(text, "UTC")) for name, text in zip("abcd", texts, strict=False)]
    return orders_left(evidence([(name, stamp) for name, stamp in stamps if stamp is not None], 1798675200.0))


def test_only_open_stamps_decide_the_order() -> None:
    assert left("03/04/2024 10:00", "2024-04-13 10:00", "31.01.2024 10:00", "04/13/2024 10:00") == (
        {"month_first"},
        ["d ('04/13/2024 10:00')"],
    )


def test_files_decide_the_order_together() -> None:
    assert left("25/03/21 10:00", "24/03/21 10:00")[0] == {"day_first", "year_first"}
    # No clock is ahead by years.
    assert left("25/03/21 10:00", "30/03/21 10:00") == ({"day_first"}, ["b ('30/03/21 10:00')"])
    assert left("25/03/21 10:00", "03/04/2024 10:00") == (
        {"day_first"},
        ["a ('25/03/21 10:00')", "b ('03/04/2024 10:00')"],
    )
    assert left("25/03/21 10:00", "03/25/2021 10:00")[0] == set()


HEADERS = [
    "Start: 2024-01-31 23:59:58",
    "Timestamp=2024-01-31T23:59:58Z",
    "Date: 2024-01-31\nTime: 23:59:58",
    "Date\t2024/01/31\nTime\t23:59:58,000000",
    "Date,31.01.2024\nTime,23:59:58",
    "Date/Time: 2024/01/31 23:59:58",
    "Acquisition Date: 31-Jan-2024 23:59:58",
    "Recording start: 2024-01-31 23:59:58",
    "Datum: 31.01.2024\nUhrzeit: 23:59:58",
    "Datum;31.01.2024\nUhrzeit;23:59:58",
    "Datum/Uhrzeit: 31.01.2024 23:59:58",
    "Startzeit: 31.01.2024 23:59:58",
    "Startdatum: 31.01.2024\nStartzeit: 23:59:58",
    "Messbeginn: 31.01.2024, 23:59:58 Uhr",
    "Aufnahmezeit; 31.01.2024 23:59:58",
    "Zeitstempel = 2024-01-31T23:59:58",
]


@pytest.mark.parametrize("head", HEADERS)
@pytest.mark.parametrize("below", ["", "x[g]\n"])
def test_headers_of_loggers_state_the_start(head: str, below: str) -> None:
    samples = read_layout(f"{head}\n{below}1\n2\n3\n".encode(), "a.csv")
    assert (samples.start, samples.stamp) == (EVENING, None)
    np.testing.assert_array_equal(samples.values, [[1, 2, 3]])


def test_an_open_order_stays_a_text() -> None:
    samples = read_layout(b"Date,03/04/2024\nTime,10:00:00\n1\n2\n", "a.csv")
    assert (samples.start, samples.stamp) == (None, "03/04/2024 10:00:00")


def test_a_day_or_a_time_of_day_alone_is_no_start() -> None:
    for head in ({"Date": "31.01.2024"}, {"Time": "23:59:58"}, {"Uhrzeit": "23:59:58"}, {"Messzeit": "10 s"}):
        assert time_statements({plain_key(key): value for key, value in head.items()}, "UTC") == []


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["rec_0001.npy"], (1, 1, 1)),
        (["rec_0000.npy", "rec_0001.npy"], (1, 1, 0)),
        (["f9.csv", "f10.csv"], (1, 1, 1)),
        (["f48211.csv"], (1, 1, 48211)),
        (["motor2_0005_ch1.npy"], (2, 3, 1)),
        (["motor2_5_ch1.npy", "motor2_6_ch1.npy"], (2, 3, 1)),
        (["rec_0005_25600Hz.npy"], (1, 1, 1)),
        (["0005.mp3"], (1, 1, 1)),
        (["measured.001"], (1, 1, 1)),
        (["a.npy"], None),
        (["a/1.npy", "b/1.npy"], None),
        (["5_1.npy", "5_2.npy", "6_1.npy", "6_2.npy"], None),
        (["12.npy", "a1_3c4.npy", "b1_4_5.npy", "7_7_7.npy"], None),
    ],
)
def test_which_number_counts(names: list[str], expected: tuple[int, int, int] | None) -> None:
    assert place_in_names(names[0], names) == expected


@pytest.mark.parametrize(
    "text", ["2016-12-31T23:59:60Z", "2016-12-31 23:59:60", "31/12/2016 23:59:60", "31-Dec-2016 23:59:60"]
)
def test_a_leap_second_is_the_first_of_the_next_year(text: str) -> None:
    stamp = read_stamp(text, "UTC")
    assert stamp is not None
    assert stamp.day_first == datetime(2017, 1, 1, tzinfo=UTC).timestamp()
    assert read_stamp(text.replace(":59:60", ":58:60"), "UTC") is None


@pytest.mark.parametrize("pattern", [None, "%Y%m%d_%H%M%S"])
def test_a_leap_second_in_a_name(pattern: str | None) -> None:
    stamp = stamp_in_name("a_20161231_235960.csv", "UTC", pattern)
    assert stamp is not None
    assert stamp.fixed == datetime(2017, 1, 1, tzinfo=UTC).timestamp()
    assert stamp_in_name("a_20161231_235860.csv", "UTC", pattern) is None


def test_rows_go_on_through_a_leap_second() -> None:
    clocks = [f"2016-12-31T23:59:{second}" for second in ("59.0", "59.5", "60.0", "60.5")]
    clocks += [f"2017-01-01T00:00:{second}" for second in ("00.0", "00.5")]
    samples = read_layout(("time,x\n" + "".join(f"{clock},1.5\n" for clock in clocks)).encode(), "a.csv")
    assert (samples.rate, samples.start) == (2.0, datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC).timestamp())


BELOW_FOLDERS = {
    "2024/11/04/081500_ch1.csv.gz": 1.0,
    "2024-11-04/08.15.00.csv": 1.0,
    "2024-11-04/ch1_08.15.00.csv": 1.0,
    "logger/2024/11/04/08/15.00.csv": 1.0,
    "2024/11/04/08/1500.csv": 1.0,
    "d/20241104/x/08h15m00.csv": 1.0,
    "04.11.2024/081500.csv": 1.0,
    "2024/11/04/08-15.csv": 60.0,
    "2024/11/04/081500.000_a.npy": 1e-3,
}


@pytest.mark.parametrize("path", BELOW_FOLDERS)
def test_a_time_of_day_below_folders_of_a_date(path: str) -> None:
    stamp = stamp_in_name(path, "UTC")
    assert stamp is not None
    assert stamp.fixed == datetime(2024, 11, 4, 8, 15, tzinfo=UTC).timestamp()
    assert stamp.resolution == BELOW_FOLDERS[path]


@pytest.mark.parametrize(
    "path",
    ["2024/11/04/ch1_00012.csv", "2024/11/04/run_123456.csv", "11/04/0815.csv"],
)
def test_other_numbers_below_folders_of_a_date_are_no_time(path: str) -> None:
    assert stamp_in_name(path, "UTC") is None
