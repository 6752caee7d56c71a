"""Text files in the layouts of loggers, side-cars, and the words in which files speak of themselves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from streams.files.abscissa import rate_of_times
from streams.files.formats.text import read_layout
from streams.files.judge import stated_rate
from streams.files.load import choose_channels
from streams.files.statements import known_unit, number_of, seconds_utc
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.format_makers import RATE, npy_bytes, signal
from tests.support.effort import effort_count

NOON = 1714564800.0


def read(text: str) -> tuple[tuple[str, ...], tuple[int, ...], float | None, tuple[str | None, ...], float | None]:
    reading = read_layout(text.encode(), "x.csv")
    units = reading.units if any(reading.units) else ()
    return reading.names, reading.columns, reading.rate, units, reading.start


LINES = "".join(f"{i / 1000:.4f},{i % 7},{i % 5}\n" for i in range(200))


def test_headers_of_german_loggers() -> None:
    text = "Zeit in s;Beschleunigung [m/s²];Spannung [mV]\r\n" + "".join(
        f"{i / 1000:.4f};{i % 7},5;{i % 5}\r\n" for i in range(200)
    ).replace(".", ",")
    for coding in ("utf-8", "cp1252"):
        found = read_layout(text.encode(coding), "x.csv")
        assert found.channels == ("Beschleunigung", "Spannung")
        assert found.names == ("Beschleunigung [m/s²]", "Spannung [mV]")
        assert (found.units, found.rate) == (("m/s2", "mV"), 1000.0)
        assert_array_equal(found.values[:, 1], [1.5, 1.0])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1,2\n3,4\n", (("column_1", "column_2"), (1, 2), None, (), None)),
        ("a,b\n1,2\n3,4\n", (("a", "b"), (1, 2), None, (), None)),
        ("time,a,b\n" + LINES, (("a", "b"), (2, 3), 1000.0, (), None)),
        ("Time [s],a [g],b (m/s^2)\n" + LINES, (("a [g]", "b (m/s^2)"), (2, 3), 1000.0, ("g", "m/s2"), None)),
        ("t,a,b\ns,g,g\n" + LINES, (("a", "b"), (2, 3), 1000.0, ("g", "g"), None)),
        (
            "# Sampling rate: 1 kHz\n# Unit = g\n1,2\n3,4\n",
            (("column_1", "column_2"), (1, 2), 1000.0, ("g", "g"), None),
        ),
        ("Date,2024-05-01 12:00:00\nSample Rate,25600\na,b\n1,2\n", (("a", "b"), (1, 2), 25600.0, (), NOON)),
        ("Start: 2024-05-01T12:00:00Z\n\nacc\n1\n2\n", (("acc",), (1,), None, (), NOON)),
        (
            "LabVIEW Measurement\t\nDelta_X\t0.001\n***End_of_Header***\t\n"
            "X_Value\tA\tComment\n0\t1\n0.001\t2\n0.002\t1\n",
            (("A",), (2,), 1000.0, (), None),
        ),
        ("Zeit;a\n0,0;1,5\n0,001;2,5\n0,002;3,5\n", (("a",), (2,), 1000.0, (), None)),
        ("Acceleration axial [m/s2]\n1\n2\n", (("Acceleration axial [m/s2]",), (1,), None, ("m/s2",), None)),
        ("x (g)  y (g)\n1 2\n3 4\n", (("x (g)", "y (g)"), (1, 2), None, ("g", "g"), None)),
        ("\ufeffa;b\r\n1,5;2\r\n2,5;3\r\n", (("a", "b"), (1, 2), None, (), None)),
    ],
)
def test_layouts(text: str, expected: object) -> None:
    assert read(text) == expected


@pytest.mark.parametrize("column", ["Accel X [g]", "Accel X"])
def test_a_column_is_found_with_its_unit_or_without(column: str) -> None:
    found = read_layout(b"Accel X [g],Accel Y [g]\n1,2\n3,4\n", "x.csv")
    chosen = choose_channels(found, (ChannelSpec("drive_end", column=column, unit="g"),), None, "x.csv")
    assert_array_equal(chosen.values, [[1.0, 3.0]])


def test_decimal_commas_and_columns_are_kept() -> None:
    reading = read_layout(b"Zeit;a;b\n0,0;1,5;7\n0,001;2,5;8\n", "x")
    assert_array_equal(reading.values, [[1.5, 2.5], [7.0, 8.0]])


@pytest.mark.parametrize(
    ("text", "status", "words"),
    [
        ("", "empty", "0 bytes"),
        ("a,b\n", "empty", "line 1"),
        ("a,b\n1,2\nx,3\n", "unreadable", "line 3, column 1"),
        ("a,b\n1,2,3\n", "wrong_shape", "2 names in the header, 3 columns in line 2"),
        (
            "fs: 10\ntime,a\n0,1\n1,2\n2,3\n",
            "wrong_rate",
            "fs 10 or 10000 Hz, the times in 'time' 1 or",
        ),
        ("time,a\n0,1\n1,2\n5,3\n6,3\n", "wrong_rate", "not evenly spaced"),
        ("time,a\n0,1\n-1,2\n", "wrong_rate", "do not increase"),
        ("fs: 0\na\n1\n2\n", "wrong_rate", "positive number in fs"),
        ("fs: 10\nsample rate: 20\na\n1\n2\n", "wrong_rate", "several sampling rates"),
        ("nothing here\nis a number\n", "empty", "expected a number"),
    ],
)
def test_what_a_layout_cannot_be(text: str, status: str, words: str) -> None:
    with pytest.raises(ReaderError, match=words) as caught:
        read_layout(text.encode(), "x.csv")
    assert caught.value.status == status


@pytest.mark.parametrize("decimals", [9, 7, 6])
@pytest.mark.parametrize("rate", [25600.0, 51200.0, 12800.0])
def test_rate_of_rounded_times(rate: float, decimals: int) -> None:
    times = np.round(np.arange(100_000) / rate, decimals)
    assert rate_of_times(times, "x") == rate


def test_times_too_coarse_to_tell_the_rate_say_nothing() -> None:
    assert rate_of_times(np.round(np.arange(100) / 25600, 3), "x") is None


@given(place=st.integers(1, 98), count=st.integers(1, 50))
def test_a_missing_sample_is_seen(place: int, count: int) -> None:
    times = np.delete(np.arange(200) / 1000.0, np.arange(place, place + count))
    with pytest.raises(ReaderError, match="not evenly spaced"):
        rate_of_times(times, "x")


@pytest.mark.parametrize(
    ("text", "unit"),
    [("m/s²", "m/s2"), ("[g]", "g"), ("G", "g"), ("", None), ("V", "V"), ("Pa", "Pa"), (3, None), ("m/s^2", "m/s2")],
)
def test_units(text: object, unit: str | None) -> None:
    assert known_unit(text) == unit


def test_numbers_rates_and_stamps() -> None:
    assert [number_of(text) for text in ("25.6 kHz", "1e3", "25600,0", "x", True, float("nan"))] == [
        25600.0, 1000.0, 25600.0, None, None, None,
    ]  # fmt: skip
    assert stated_rate({"dt": 1 / 25600, "fs": 25600}, "x") == 25600.0
    assert stated_rate({"x": 1}, "x") is None
    for stamp in (
        "2024-05-01T12:00:00Z",
        "2024-05-01T14:00:00+02:00",
        "01-May-24 12:00:00",
        NOON,
        np.datetime64("2024-05-01T12"),
    ):
        assert seconds_utc(stamp, "UTC") == NOON
    assert seconds_utc("2024-05-01 14:00:00", "Europe/Rome") == NOON
    assert [seconds_utc(stamp, "UTC") for stamp in ("soon", None, 5, True)] == [None] * 4


WORDS = st.sampled_from(
    [
        "time",
        "t",
        "x [g]",
        "fs",
        "Start",
        "25600",
        "0",
        "1",
        "2.5",
        "-1e308",
        "nan",
        "inf",
        "",
        "2024-05-01",
        "Pa",
        "g",
        "s",
    ]
)
LINE = st.builds(
    lambda words, separator, head: head + separator.join(words),
    st.lists(WORDS, max_size=4),
    st.sampled_from([",", ";", "\t", " ", ": ", "="]),
    st.sampled_from(["", "", "", "# ", '"']),
)


@settings(max_examples=effort_count(quick=30, full=5000))
@given(lines=st.lists(LINE, max_size=12), end=st.sampled_from(["\n", "\r\n", "\r"]))
def test_any_text_is_read_or_refused(lines: list[str], end: str) -> None:
    data = end.join(lines).encode()
    reading, reason = None, ""
    try:
        reading = read_layout(data, "x.csv")
    except ReaderError as error:
        reason = str(error)
    if reading is None:
        assert reason.startswith("x.csv")
        return
    assert reading.values.shape[0] == len(reading.names) == len(reading.columns) == len(reading.channels)
    assert len(reading.units) in (0, len(reading.names))
    assert reading.rate is None or 0 < reading.rate < np.inf


def put(folder: Path, sidecar: dict[str, object] | str, name: str = "x.npy.json") -> str:
    (folder / "x.npy").write_bytes(npy_bytes(signal()))
    (folder / name).write_text(sidecar if isinstance(sidecar, str) else json.dumps(sidecar))
    return str(folder / "x.npy")


ALL = {
    "rate_hz": RATE,
    "start_utc": "2024-05-01T12:00:00Z",
    "unit": "g",
    "speed_hz": 30,
    "load_newton": 4000,
    "channels": ["h", "v"],
}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("x.npy.json", json.dumps(ALL)),
        ("spallwatch.json", json.dumps(ALL)),
        (
            "spallwatch.toml",
            'rate_hz = 25600\nstart_utc = 2024-05-01T12:00:00Z\nunit = "g"\nspeed_hz = 30\n'
            'load_newton = 4000\nchannels = ["h", "v"]',
        ),
    ],
)
def test_a_side_car_says_what_the_file_does_not(name: str, text: str, tmp_path: Path) -> None:
    url = put(tmp_path, text, name)
    for place in (url, str(tmp_path)):
        (block,) = open_source(SourceSpec("s", place, block_s="file"))
        assert isinstance(block, Block)
        assert (block.rate, block.start, block.speed, block.load) == (RATE, NOON, 30.0, 4000.0)
        assert (block.channels, block.units) == (("h", "v"), ("g", "g"))
        assert_array_equal(block.samples, signal())


def test_the_nearest_side_car_wins(tmp_path: Path) -> None:
    url = put(tmp_path, {"rate_hz": 1000, "unit": "g"})
    put(tmp_path, {"rate_hz": 2000, "unit": "g"}, "spallwatch.json")
    (block,) = open_source(SourceSpec("s", url, block_s="file"))
    assert isinstance(block, Block)
    assert block.rate == 1000.0


def test_scale_and_sensitivity(tmp_path: Path) -> None:
    url = put(tmp_path, {"rate_hz": RATE, "unit": "V", "scale": 0.5, "sensitivity_mv_per_g": 100})
    (block,) = open_source(SourceSpec("s", url, block_s="file"))
    assert isinstance(block, Block)
    assert block.units == ("g", "g")
    assert_allclose(block.samples, signal() * 5.0)


@pytest.mark.parametrize(
    ("sidecar", "spec", "status", "words"),
    [
        ({"rate_hz": 1000, "unit": "g"}, {"rate": 2000.0}, "wrong_rate", "do not agree"),
        (
            {"rate_hz": 1000, "unit": "m/s2"},
            {"channels": (ChannelSpec("a", column=1, unit="g"),)},
            "wrong_unit",
            "m/s2",
        ),
        (
            {"rate_hz": 1000, "scale": 2},
            {"channels": (ChannelSpec("a", column=1, unit="g", scale=3),)},
            "wrong_unit",
            "scales it already",
        ),
        ({"rate_hz": 1000, "unit": "g", "channels": ["a"]}, {}, "wrong_shape", "names 1 channels"),
        ({"rate_hz": 1000, "unit": "g", "sensitivity_mv_per_g": 100}, {}, "wrong_unit", "rows in V"),
    ],
)
def test_side_cars_that_contradict(
    sidecar: dict[str, object], spec: dict[str, object], status: str, words: str, tmp_path: Path
) -> None:
    url = put(tmp_path, sidecar)
    (item,) = open_source(SourceSpec("s", url, block_s="file", **spec))  # pyright: ignore[reportArgumentType]
    assert isinstance(item, Rejected)
    assert item.status == status
    assert words in item.reason


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("{", "unreadable"),
        ("[1]", "unreadable"),
        ('{"rate": 1}', "unreadable"),
        ('{"rate_hz": 0}', "unreadable"),
        ('{"rate_hz": "fast"}', "unreadable"),
        ('{"scale": 0}', "unreadable"),
        ('{"scale": NaN}', "unreadable"),
        ('{"scale": 1' + 400 * "0" + "}", "unreadable"),
        ('{"start_utc": 1' + 400 * "0" + "}", "unreadable"),
        ('{"start_utc": NaN}', "unreadable"),
        ('{"unit": "Pa"}', "wrong_unit"),
        ('{"start_utc": "soon"}', "unreadable"),
        ('{"channels": ["a", "a"]}', "unreadable"),
        ("[" * 50_000, "unreadable"),
        (" " * 70_000, "refused"),
    ],
)
def test_side_cars_that_cannot_be_read(text: str, status: str, tmp_path: Path) -> None:
    url = put(tmp_path, text)
    channels = (ChannelSpec("a", column=1, unit="g"),)
    (item,) = open_source(SourceSpec("s", url, block_s="file", rate=1000.0, channels=channels))
    assert isinstance(item, Rejected)
    assert item.status == status
    assert "x.npy.json" in item.reason


def test_a_linked_side_car_is_not_followed_out_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.json").write_text('{"rate_hz": 1000, "unit": "g"}')
    folder = tmp_path / "recording"
    folder.mkdir()
    (folder / "x.npy").write_bytes(npy_bytes(signal()))
    (folder / "x.npy.json").symlink_to(tmp_path / "secret.json")
    (item,) = open_source(
        SourceSpec("s", str(folder), block_s="file", rate=1000.0, channels=(ChannelSpec("a", column=1, unit="g"),))
    )
    assert isinstance(item, Rejected)
    assert item.status == "refused"


def test_without_any_statement_the_configuration_is_asked(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("1,2\n3,4\n")
    with pytest.raises(SourceError, match="rate_hz is missing"):
        open_source(SourceSpec("s", str(tmp_path / "x.csv"), channels=(ChannelSpec("a", column=1, unit="g"),)))


@pytest.mark.parametrize(
    ("head", "name", "unit"),
    [
        ("Zeit/s;Beschleunigung/g", "Beschleunigung", "g"),
        ("Zeit in s;Schwingbeschleunigung in m/s²", "Schwingbeschleunigung", "m/s2"),
        ("Zeit [s];Beschleunigung / m/s^2", "Beschleunigung", "m/s2"),
        ("Zeit/s;Sensor/mV", "Sensor", "mV"),
        ("Zeit [s];left/right", "left/right", None),
        ("Zeit [s];in", "in", None),
    ],
)
def test_a_unit_may_stand_behind_a_stroke(head: str, name: str, unit: str | None) -> None:
    rows = "".join(f"{k / 1000:.3f};{value:.4f}\n".replace(".", ",") for k, value in enumerate(signal(1, 300)[0]))
    found = read_layout(f"{head}\n{rows}".encode(), "x.csv")
    assert (found.channels, found.units, found.rate) == ((name,), (unit,), 1000.0)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_a_single_column_with_decimal_commas_behind_stamps(separator: str) -> None:
    values = signal(1, 300)[0]
    lines = (
        f"04.11.2024{separator}08:15:00,{k:03d}{separator}{value:.4f}".replace(".", ",").replace(
            "04,11,2024", "04.11.2024"
        )
        for k, value in enumerate(values)
    )
    text = separator.join(("Datum", "Uhrzeit", "Beschleunigung [g]")) + "\n" + "\n".join(lines) + "\n"
    found = read_layout(text.encode(), "x.csv")
    assert (found.channels, found.units, found.rate) == (("Beschleunigung",), ("g",), 1000.0)
    assert_allclose(found.values[0], np.round(values, 4), atol=1e-9)


@pytest.mark.parametrize("head", ["time,acc\n", "# Run\ntime,acc\ns,g\n", "acc [g]\n"])
def test_several_recordings_in_one_text_are_refused_with_the_line_of_the_next(head: str) -> None:
    columns = 1 + head.count(",a")
    numbers = "".join(",".join([f"{i / 1000:.3f}", f"{i % 7}"][:columns]) + "\n" for i in range(100))
    with pytest.raises(ReaderError) as caught:
        read_layout((head + numbers + "\n" + head + numbers).encode(), "x.csv")
    line = 100 + 1 + 2 * head.count("\n")
    assert f"head in line {line})" in str(caught.value)
    assert "states no start of its own; write each of its recordings" in str(caught.value)


def test_several_segments_of_labview_without_starts_are_refused_with_their_lines() -> None:
    end = "***End_of_Header***\t\n"
    segment = f"Channels\t1\t\nDelta_X\t0.001\n{end}X_Value\tA\n" + "".join(f"{i / 1000}\t{i % 7}\n" for i in range(50))
    text = f"LabVIEW Measurement\t\nSeparator\tTab\n{end}\n{segment}\n{segment}"
    with pytest.raises(
        ReaderError, match=r"2 recordings .* in line 62\); .* states no start of its own; write each"
    ) as caught:
        read_layout(text.encode(), "x.lvm")
    assert caught.value.status == "wrong_shape"
    assert text.splitlines()[61].startswith("***End")


@pytest.mark.parametrize("separator", ["\t", ";", ","])
def test_an_index_without_a_name_stands_before_the_names(separator: str) -> None:
    table = pd.DataFrame({"Time [s]": np.arange(200) / 1000.0, "acc [g]": np.arange(200) % 7 / 8.0})
    found = read_layout(table.to_csv(sep=separator).encode(), "x.csv")
    assert (found.names, found.columns, found.units, found.rate) == (("acc [g]",), (3,), ("g",), 1000.0)
    moments = pd.Timestamp("2024-05-01 12:00:00") + pd.to_timedelta(np.arange(200), "ms")
    dated = pd.DataFrame({"acc [g]": table["acc [g]"].to_numpy()}, index=moments)
    found = read_layout(dated.to_csv(sep=separator, index_label="").encode(), "x.csv")
    assert (found.names, found.rate, found.start) == (("acc [g]",), 1000.0, NOON)


def test_many_names_above_rows_with_dates_are_kept() -> None:
    names = [f"Beschleunigung Lager {place} [m/s²]" for place in range(12)]
    rows = [f"2024-05-01 12:00:00.{i:03d};" + ";".join(f"{i % 7}.5" for _ in names) for i in range(200)]
    found = read_layout("\n".join([";".join(["Zeit", *names]), *rows, ""]).encode("cp1252"), "x.csv")
    assert (found.names, set(found.units), found.rate) == (tuple(names), {"m/s2"}, 1000.0)
