"""Layouts of texts that people have: read as they state it, or refused where two readings are left."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

import spallwatch as sw
from tests.support.stated_files import GRAVITY, RATE, START, noise, seconds

ROWS = noise(2)
COUNT = ROWS.shape[1]
T = np.arange(COUNT) / RATE
NAMES = "Time (s),DE [g],NDE [g]"


def cells(row: np.ndarray, form: str = "{:.7g}", decimal: str = ".") -> list[str]:
    return [form.format(value).replace(".", decimal) for value in row]


PLAIN = [cells(row) for row in ROWS]
COMMAS = [cells(row, decimal=",") for row in ROWS]


def lines(columns: Sequence[Sequence[str]], separator: str = ",", end: str = "") -> list[str]:
    return [separator.join(row) + end for row in zip(*columns, strict=True)]


def stamps(pattern: str, rate: float = RATE) -> list[str]:
    return [(START + timedelta(microseconds=round(1e6 * i / rate))).strftime(pattern) for i in range(COUNT)]


def read(folder: Path, text: Sequence[str], newline: str = "\n", encoding: str = "utf-8") -> tuple[list[float], float]:
    """Levels in m/s2, and the rate."""
    place = folder / "x.csv"
    place.write_bytes(newline.join([*text, ""]).encode(encoding))
    signal = sw.read(place)
    values = signal.values - signal.values.mean(axis=1, keepdims=True)
    return np.sqrt(np.mean(values**2, axis=1)).tolist(), float(signal.attrs["rate_hz"])


UNITS = {
    **dict.fromkeys(("G", "gn", "g's", "G's"), GRAVITY),
    **dict.fromkeys(("mg", "milli-g"), GRAVITY / 1e3),
    **dict.fromkeys(("m/s^2", "m/s**2", "m·s⁻²", "m s⁻²", "m.s^-2", "ms⁻²", "m/s/s", "m/sec2", "M/S2"), 1.0),
    **dict.fromkeys(("in/s2", "in/s²", "in/sec^2", "inch/s2"), 0.0254),
    "ft/s²": 0.3048,
    "cm/s2": 1e-2,
    "km/s2": 1e3,
    "µg": GRAVITY / 1e6,
    "Gal": 1e-2,
}
PLACES = {
    "brackets": lambda unit: [f"Time [s],DE [{unit}],NDE [{unit}]"],
    "a row": lambda unit: ["Time,DE,NDE", f"s,{unit},{unit}"],
    "a head": lambda unit: [f"Unit: {unit}", "Time (s),DE,NDE"],
    "a suffix": lambda unit: [f"Time/s;DE in {unit};NDE in {unit}".replace(";", ",")],
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_is_read_in_each_spelling(unit: str, place: str, tmp_path: Path) -> None:
    found, rate = read(tmp_path, [*PLACES[place](unit), *lines([seconds(COUNT), *PLAIN])])
    assert found == pytest.approx([UNITS[unit], 0.6 * UNITS[unit]], rel=1e-4)
    assert rate == pytest.approx(RATE)


@pytest.mark.parametrize("unit", ["g_pk", "g RMS", "gE", "kg", "EU", "x 0.001 g", "1e-3 g", "dB", "µm"])
@pytest.mark.parametrize("place", ["brackets", "a row"])
def test_a_unit_of_another_quantity_or_scale_is_not_guessed(unit: str, place: str, tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match=r"unit is missing|no unit is stated|is in|no vibration"):
        read(tmp_path, [*PLACES[place](unit), *lines([seconds(COUNT), *PLAIN])])


LEVELS = {
    **dict.fromkeys(("100 mV/g", "100mV/G", "100,0 mV/g", "100 mV per g", "0.1 V/g"), 100.0),
    **dict.fromkeys(("10.2 mV/(m/s²)", "10.2 mV/(m·s⁻²)", "10.2 mV/m/s2", "10.2 mV/(m/s**2)"), 10.2 * GRAVITY),
    "102 µV/(m/s²)": 0.102 * GRAVITY,
}


@pytest.mark.parametrize("stated", LEVELS)
@pytest.mark.parametrize("key", ["Sensitivity", "Empfindlichkeit", "感度"])
def test_a_sensitivity_is_read_in_each_spelling(stated: str, key: str, tmp_path: Path) -> None:
    found, _ = read(tmp_path, [f"{key}: {stated}", "Time (s),DE (mV)", *lines([seconds(COUNT), PLAIN[0]])])
    assert found == pytest.approx([GRAVITY / LEVELS[stated]], rel=1e-3)


@pytest.mark.parametrize("stated", ["100", "100 mV/EU", "98.1 pC/g", "1,020 mV/(m/s²)"])
def test_a_sensitivity_that_is_open_is_asked(stated: str, tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match="in V; give"):
        read(tmp_path, [f"Sensitivity: {stated}", "Time (s),DE (mV)", *lines([seconds(COUNT), PLAIN[0]])])


@pytest.mark.parametrize(
    "stated",
    [
        "fs=4.096k", "fs = 4096", "# fs 4096", "Sample rate: 4.096 kS/s", "Sampling rate: 4096 Samples/Second",
        "Messrate 4096 Hz", "Abtastfrequenz:;4096;Hz", "Scan rate: 4096 scans/sec", "Rate [Sa/s]: 4096",
        "Sampling interval [µs]: 244.140625", "dt=244.140625 µs", "ΔT: 244.140625 µs", "Delta X: 2.44140625E-4",
        "Sampling period: 244.140625 microseconds", "Frequenza campionamento [Hz]: 4096", "サンプリング周波数(Hz),4096",
        "// Sample rate: 4096 Hz", "; Sample rate: 4096 Hz", "' Sample rate: 4096 Hz", "! Sample rate: 4096 Hz",
    ],
)  # fmt: skip
def test_a_rate_is_read_in_each_spelling(stated: str, tmp_path: Path) -> None:
    assert read(tmp_path, [stated, "DE [g],NDE [g]", *lines(PLAIN)])[1] == pytest.approx(RATE)


@pytest.mark.parametrize("stated", ["Sample rate: 4,096 Hz", "Abtastrate: 4.096 Hz", "fs = 12.800"])
def test_a_rate_of_two_readings_is_asked(stated: str, tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match="may mean"):
        read(tmp_path, [stated, "DE [g],NDE [g]", *lines(PLAIN)])


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("Laufzeit [s]", 1.0), ("Messzeit (ms)", 1e3), ("時間(s)", 1.0), ("時刻", 1.0), ("Tid (s)", 1.0), ("ms", 1e3),
        ("Seconds", 1.0), ("usec", 1e6), ("X-Axis (s)", 1.0), ("Time - Plot 0", 1.0), ("TimeStamp [ms]", 1e3),
        ("Record time (s)", 1.0), ("Time[min]", 1 / 60), ("sampleTime_us", 1e6), ("t/s", 1.0), ("T [s]", 1.0),
    ],
)  # fmt: skip
def test_times_are_told_by_name_unit_and_shape(name: str, factor: float, tmp_path: Path) -> None:
    found, rate = read(tmp_path, [f"{name},DE [g],NDE [g]", *lines([seconds(COUNT, factor), *PLAIN])])
    assert len(found) == 2
    assert rate == pytest.approx(RATE, rel=1e-4)


@pytest.mark.parametrize("name", ["Frequency (Hz)", "f [Hz]", "CPM", "Order", "Frequenz"])
def test_a_spectrum_is_no_signal_even_where_a_rate_is_stated(name: str, tmp_path: Path) -> None:
    column = [f"{2.0 * i:.1f}" for i in range(COUNT)]
    with pytest.raises(sw.SpallwatchError, match="a spectrum"):
        read(tmp_path, [f"Sample rate: {RATE:g} Hz", f"{name},DE [g],NDE [g]", *lines([column, *PLAIN])])


DAYS = [45965.0 + (8.25 * 3600 + t) / 86400.0 for t in T]
DATED = {
    "date, time, ms": ("Date,Time,ms", [stamps("%d.%m.%Y"), stamps("%H:%M:%S"), cells(1e3 * (T % 1.0), "{:.4f}")]),
    "date, time, us": ("Date,Time,us", [stamps("%Y-%m-%d"), stamps("%H:%M:%S"), cells(1e6 * (T % 1.0), "{:.0f}")]),
    "am and pm": ("Date/Time", [stamps("%m/%d/%Y %I:%M:%S.%f %p")]),
    "a colon before ms": ("Time", [stamps("%Y-%m-%d %H:%M:%S:%f")]),
    "a year of two digits": ("Time", [stamps("%d-%b-%y %H:%M:%S.%f")]),
    "days of Excel": ("Time", [cells(np.array(DAYS), "{:.12f}")]),
    "days of MATLAB": ("Time", [cells(np.array(DAYS) + 693960.0, "{:.14f}")]),
    "ms since 1970": ("Time (ms)", [cells(1e3 * (START.timestamp() + T), "{:.4f}")]),
}


@pytest.mark.parametrize("kind", DATED)
def test_rows_are_dated_as_they_state_it(kind: str, tmp_path: Path) -> None:
    names, columns = DATED[kind]
    if kind == "am and pm":
        columns = [[text.replace("11/04", "11/24") for text in columns[0]]]
    place = tmp_path / "x.csv"
    place.write_text("\n".join([f"{names},DE [g],NDE [g]", *lines([*columns, *PLAIN]), ""]))
    signal = sw.read(place)
    day = {"am and pm": "2025-11-24T08:15"}
    assert signal.attrs["rate_hz"] == pytest.approx(RATE, rel=2e-4)
    assert signal.attrs["start_utc"].startswith(day.get(kind, "2025-11-04T08:15" if "days" not in kind else "20"))


def test_an_epoch_of_1970_is_one_of_a_clock_that_was_never_set(tmp_path: Path) -> None:
    place = tmp_path / "x.csv"
    times = cells(612000.0 + 1e3 * T, "{:.4f}")
    place.write_text("\n".join(["epoch_ms,DE [g],NDE [g]", *lines([times, *PLAIN]), ""]))
    with pytest.warns(UserWarning, match="1970-01-01T00:10:12Z: the clock was never set"):
        sw.read(place)


def test_seconds_since_1904_give_no_date_of_the_future(tmp_path: Path) -> None:
    place = tmp_path / "x.csv"
    times = cells(START.timestamp() + 2082844800.0 + T, "{:.9f}")
    place.write_text("\n".join([NAMES, *lines([times, *PLAIN]), ""]))
    assert "start_utc" not in sw.read(place).attrs


def grouped(value: float, thousands: str, decimal: str) -> str:
    return f"{1e4 * value:,.3f}".replace(",", "_").replace(".", decimal).replace("_", thousands)


def in_mg(thousands: str, decimal: str, quote: str = "") -> list[list[str]]:
    return [[f"{quote}{grouped(value, thousands, decimal)}{quote}" for value in row] for row in ROWS]


SECONDS = [text.replace(".", ",") for text in seconds(COUNT)]
MG = "Time (s);DE [mg];NDE [mg]"
DIALECTS: dict[str, tuple[float, list[str]]] = {
    "separators at the ends": (GRAVITY, [f"{NAMES},", *lines([seconds(COUNT), *PLAIN], ",", ",")]),
    "separators at the ends of numbers": (GRAVITY, [NAMES, *lines([seconds(COUNT), *PLAIN], ",", ",")]),
    "quotes": (GRAVITY, [NAMES, *(f'"{line}"'.replace(",", '","') for line in lines([seconds(COUNT), *PLAIN]))]),
    "quoted decimal commas": (
        GRAVITY,
        [NAMES, *(",".join(f'"{cell}"' for cell in row) for row in zip(
            SECONDS, *COMMAS, strict=True))],
    ),
    "1.234,5": (10 * GRAVITY, [MG, *lines([SECONDS, *in_mg(".", ",")], ";")]),
    "1 234,5": (10 * GRAVITY, [MG, *lines([SECONDS, *in_mg(" ", ",")], ";")]),
    "1'234.5": (10 * GRAVITY, [MG, *lines([seconds(COUNT), *in_mg("'", ".")], ";")]),
    '"1,234.5"': (10 * GRAVITY, [MG.replace(";", ","), *lines([seconds(COUNT), *in_mg(",", ".", '"')])]),
    "names in a comment": (1.0, ["% fs = 4096", "% DE (m/s^2)   NDE (m/s^2)", *lines(PLAIN, " ")]),
    "units of counts": (
        3.9e-3 * GRAVITY,
        ["Sample rate: 4096 Hz", "Scale = 3.9 mg/LSB", "ID,A,B,Temp", "-,counts,counts,°C",
         *lines([[str(i) for i in range(COUNT)], *PLAIN, ["48.1", "48.2"] * (COUNT // 2)])],
    ),
    "an envelope beside": (GRAVITY, ["Time (s),DE [g],NDE [g],DE [gE]", *lines([seconds(COUNT), *PLAIN, PLAIN[0]])]),
    "channels by numbers": (
        1.0,
        ["begintime: 04.11.2025 08:15:00.000000", "Time;[0:0];[0:1]", "s;m/s²;m/s²",
         *lines([SECONDS, *COMMAS], ";")],
    ),
}  # fmt: skip


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("kind", DIALECTS)
def test_numbers_are_read_in_each_way_of_writing(kind: str, newline: str, encoding: str, tmp_path: Path) -> None:
    si, text = DIALECTS[kind]
    found, rate = read(tmp_path, text, newline, encoding)
    assert found == pytest.approx([si, 0.6 * si], rel=1e-3)
    assert rate == pytest.approx(RATE, rel=1e-4)


def test_a_separator_behind_some_lines_is_a_number_that_is_missing(tmp_path: Path) -> None:
    text = [NAMES, *lines([seconds(COUNT), *PLAIN])]
    text[1:5] = [line.rpartition(",")[0] + "," for line in text[1:5]]
    with pytest.raises(sw.SpallwatchError, match="expected a number, found ''"):
        read(tmp_path, text)
