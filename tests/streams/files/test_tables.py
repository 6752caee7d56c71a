"""Workbooks and Parquet tables: the sheet that is read, what its head states, what is refused and in which words."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import spallwatch as sw
from streams.files.formats.parquet import read_parquet
from streams.files.formats.xlsx import read_xlsx
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block
from streams.types.samples import COUNTS, ReaderError
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.folders import csv_bytes
from tests.streams.table_makers import Row, days, parquet_bytes, workbook

RATE = 4096.0
NOON = datetime(2024, 5, 1, 12)
START = 1714564800.0
NOISE = np.random.default_rng(5).normal(size=600)
TIMES = [i / RATE for i in range(600)]
MOMENTS = [NOON + timedelta(seconds=time) for time in TIMES]


def table(*head: Row, times: bool = True) -> list[Row]:
    rows: list[Row] = [[time, float(value)] for time, value in zip(TIMES, NOISE, strict=True)]
    return [*head, *(rows if times else [row[1:] for row in rows])]


PLAIN = table(["Time", "DE"], ["s", "g"])
STATED = [["Pump 3; floor 2"], ["Sampling rate", 4.096, "kHz"], ["Start", NOON], [None], ["DE [m/s2]"]]


def refusal(read: Callable[..., object], data: bytes, *arguments: object) -> tuple[str, str]:
    with pytest.raises(ReaderError) as caught:
        read(data, "x", *arguments)
    return caught.value.status, str(caught.value)


@pytest.mark.parametrize(
    "data",
    [
        workbook({"Data": PLAIN}),
        workbook({"Data": PLAIN}, shared=False, prefix="x:"),
        workbook({"Data": PLAIN}, places=False),
        workbook({"Data": [[None, None, *row] for row in PLAIN]}),
        workbook({"Data": [[None], *PLAIN]}),
        workbook({"About": [["Unit", "g"], ["fs", 4096]], "Data": table(["DE"], times=False)}),
        workbook(
            {"Data": [[None, "Time [s]", "DE"], [None, None, "g"], *([i, *row] for i, row in enumerate(PLAIN[2:]))]}
        ),
        workbook({"Few": [[1, 2], [3, 4]], "Data": PLAIN}),
    ],
    ids=[
        "shared",
        "own words",
        "without places",
        "column C",
        "row 2",
        "facts in another sheet",
        "index",
        "small table",
    ],
)
def test_a_sheet_is_read_as_the_text_that_it_would_be(data: bytes) -> None:
    found = read_xlsx(data, "x")
    assert (found.names, found.units, found.rate) == (("DE",), ("g",), RATE)
    assert_array_equal(found.values, [NOISE])


def test_a_head_of_key_number_and_unit_and_a_date() -> None:
    found = read_xlsx(workbook({"Data": table(*STATED, times=False)}), "x", (), "Europe/Rome")
    assert (found.channels, found.units, found.rate) == (("DE",), ("m/s2",), RATE)
    assert found.start == START - 7200.0


@pytest.mark.parametrize("since", [1900, 1904])
def test_cells_of_dates_give_start_and_rate(since: int) -> None:
    rows: list[Row] = [["When", "DE [g]"], *([when, float(x)] for when, x in zip(MOMENTS, NOISE, strict=True))]
    found = read_xlsx(workbook({"Data": rows}, since=since), "x")
    assert (found.names, found.rate, found.start) == (("DE [g]",), RATE, START)
    assert_array_equal(found.values, [NOISE])


@pytest.mark.parametrize("day", [0.0, days(NOON)], ids=["times of day", "dates shown as times of day"])
def test_times_of_day(day: float) -> None:
    rows: list[Row] = [["Time", "DE [g]"], *([day + t / 86400, float(x)] for t, x in zip(TIMES, NOISE, strict=True))]
    found = read_xlsx(workbook({"Data": rows}, styles={0: 2}), "x")
    assert (found.names, found.rate, found.start) == (("DE [g]",), RATE, START if day else None)


def test_numbers_with_a_word_in_their_format_are_no_dates() -> None:
    rows: list[Row] = [["fs", 4096], ["DE [g]"], *([float(x)] for x in NOISE)]
    assert_array_equal(read_xlsx(workbook({"D": rows}, styles={0: 3}), "x").values, [NOISE])


def test_of_several_tables_a_key_names_the_sheet(tmp_path: Path) -> None:
    two = workbook({"Raw": PLAIN, "Filtered": [[*row[:1], 0.5] for row in PLAIN[2:]]})
    status, reason = refusal(read_xlsx, two)
    assert (status, "'Raw', 'Filtered'" in reason, '"Raw/COLUMN"' in reason) == ("wrong_shape", True, True)
    found = read_xlsx(two, "x", ["Raw/*"])
    assert (found.names, found.channels) == (("Raw/DE",), ("DE",))
    (tmp_path / "x.xlsx").write_bytes(two)
    channel = ChannelSpec("de", key="Raw/DE", unit="g")
    (block,) = open_source(SourceSpec("s", str(tmp_path / "x.xlsx"), block_s="file", channels=(channel,)))
    assert_allclose(sw.read(tmp_path / "x.xlsx", channels=["Raw/DE"]).values[0], NOISE * 9.80665, rtol=1e-12)
    with pytest.raises(sw.SpallwatchError, match="'Raw', 'Filtered'"):
        sw.read(tmp_path / "x.xlsx")
    assert isinstance(block, Block)
    assert_array_equal(block.samples, [NOISE])


def changed(row: int, value: object) -> bytes:
    rows = [list(each) for each in PLAIN]
    rows[row - 1][1] = value  # type: ignore[call-overload]
    return workbook({"Data": rows})


ENTITY = '<?xml version="1.0"?><!DOCTYPE w [<!ENTITY a SYSTEM "file:///etc/hostname">]><worksheet>&a;</worksheet>'


@pytest.mark.parametrize(
    ("data", "status", "words"),
    [
        (changed(11, "#N/A"), "unreadable", "sheet 'Data', row 11, column 2: expected a number, found '#N/A'"),
        (changed(11, "=A1*2"), "unreadable", "row 11, column 2: a formula without its value"),
        (changed(11, None), "wrong_shape", "sheet 'Data', row 11: expected 2 columns, found 1"),
        (workbook({"Data": [["Time", "DE"]]}), "empty", "no line of numbers in the sheets 'Data'"),
        (workbook({"Data": PLAIN})[:-50], "incomplete", "without the list that ends a workbook"),
        (workbook({"D": PLAIN}, more={"xl/worksheets/sheet1.xml": ENTITY}), "unreadable", "a document type"),
        (workbook({"D": table(["fs", 4096], ["Time", "DE"], ["ms", "g"])}), "wrong_rate", "several sampling rates"),
    ],
    ids=["error", "formula", "hole", "no numbers", "cut", "entity", "contradiction"],
)
def test_what_is_refused_of_a_workbook(data: bytes, status: str, words: str) -> None:
    found, reason = refusal(read_xlsx, data)
    assert found == status
    assert words in reason


def test_a_workbook_that_claims_much_is_refused() -> None:
    blown = workbook({"Data": PLAIN}, more={"xl/media/picture": " " * (70 << 20)})
    status, reason = refusal(read_xlsx, blown)
    assert status == "refused"
    assert "bytes when loaded, 67108864 are allowed" in reason


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_table_whose_metadata_state_all(kind: type[np.floating]) -> None:
    stated = {"Sampling rate": "4.096 kHz", "start": "2024-05-01T12:00:00Z"}
    found = read_parquet(parquet_bytes({"DE": NOISE.astype(kind)}, stated, {"DE": {"unit": "g"}}, 100), "x")
    assert (found.names, found.units, found.rate, found.start) == (("DE",), ("g",), RATE, START)
    assert found.values.dtype == kind
    assert_array_equal(found.values, [NOISE.astype(kind)])


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_a_column_of_dates_gives_rate_and_start(unit: str) -> None:
    moments = np.datetime64("2024-05-01T12:00:00", "ns") + (np.arange(600) * 10**9 // 1000).astype("m8[ns]")
    column = pa.array(moments).cast(pa.timestamp(unit, "UTC"))
    words = pa.array(["run 7"] * 600)
    found = read_parquet(parquet_bytes({"DE [g]": NOISE, "at": column, "run": words}), "x", "Europe/Rome")
    assert (found.names, found.rate, found.start) == (("DE [g]",), 1000.0, START)


def test_dates_without_a_zone_are_local() -> None:
    moments = np.datetime64("2024-05-01T12:00:00", "us") + (np.arange(600) * 1000).astype("m8[us]")
    found = read_parquet(parquet_bytes({"at": moments, "DE [g]": NOISE}), "x", "Europe/Rome")
    assert (found.rate, found.start) == (1000.0, START - 7200.0)


def test_durations_are_times_and_integers_have_no_level() -> None:
    since = (np.arange(600) * 1000).astype("m8[us]")
    counts = np.round(NOISE * 1000).astype(np.int16)
    found = read_parquet(parquet_bytes({"time": since, "DE": counts}), "x")
    assert (found.names, found.rate, found.stored) == (("DE",), 1000.0, (COUNTS,))


def test_missing_values_are_nan() -> None:
    column = pa.array([None if place == 7 else float(value) for place, value in enumerate(NOISE)])
    found = read_parquet(parquet_bytes({"DE": column}), "x").values[0]
    assert np.flatnonzero(np.isnan(found)).tolist() == [7]


@pytest.mark.parametrize(
    ("data", "status", "words"),
    [
        (parquet_bytes({"DE": NOISE})[:-9], "incomplete", "without the description that ends"),
        (parquet_bytes({"run": pa.array(["a", "b"])}), "wrong_shape", "no column of numbers: run (string)"),
        (parquet_bytes({"DE": NOISE[:0]}), "empty", "holds no row"),
        (parquet_bytes({"DE": np.zeros(20_000_000, np.int8)}), "refused", "67108864 are allowed"),
        (
            parquet_bytes({"DE": NOISE, "a": np.array(MOMENTS), "b": np.array(MOMENTS)}),
            "wrong_shape",
            "a, b; write one",
        ),
        (parquet_bytes({"DE": NOISE}, {"fs": "4096", "sampling_rate": "5000"}), "wrong_rate", "several sampling rates"),
        (
            parquet_bytes({"DE": NOISE, "at": pa.array([None, *MOMENTS[1:]])}),
            "unreadable",
            "1 dates are missing in 'at'",
        ),
    ],
    ids=["cut", "words", "no rows", "huge", "two of dates", "contradiction", "date missing"],
)
def test_what_is_refused_of_a_table(data: bytes, status: str, words: str) -> None:
    found, reason = refusal(read_parquet, data)
    assert found == status
    assert words in reason


@pytest.mark.parametrize("name", ["x.xlsx", "x.parquet"])
def test_python_reads_tables(name: str, tmp_path: Path) -> None:
    made = {"x.xlsx": workbook({"Data": PLAIN}), "x.parquet": parquet_bytes({"DE [g]": NOISE}, {"fs": "4096"})}
    (tmp_path / name).write_bytes(made[name])
    found = sw.read(tmp_path / name)
    assert list(found.channel.values) == ["DE"]
    assert found.attrs["rate_hz"] == RATE
    assert_allclose(found.values[0], NOISE * 9.80665, rtol=1e-12)


def test_a_workbook_among_texts_is_ignored_by_name(tmp_path: Path) -> None:
    (tmp_path / "1.csv").write_bytes(csv_bytes(NOISE))
    (tmp_path / "2.xlsx").write_bytes(workbook({"Data": PLAIN}))
    (tmp_path / "3.parquet").write_bytes(parquet_bytes({"DE": NOISE}))
    channel = ChannelSpec("x", unit="g")
    found = open_source(SourceSpec("s", f"folder:{tmp_path}", rate=RATE, block_s="file", channels=(channel,)))
    assert isinstance(found, Recording)
    assert len(list(found)) == 1
    assert {name: "format = " in reason for name, reason in found.ignored().items()} == {
        "2.xlsx": True,
        "3.parquet": True,
    }
