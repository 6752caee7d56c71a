"""Texts of analysers: lines of titles and axes above rows of index, time and value, without names of columns."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from streams.files.formats.text import read_layout
from streams.open import open_source
from streams.types.block import Block
from streams.types.samples import ReaderError, Samples
from streams.types.spec import SourceSpec

RATE = 51200.0
NOISE = np.random.default_rng(9).normal(size=2048)


def rows(x: Iterable[float], *, index: bool = True, separator: str = "\t") -> str:
    both = zip(x, NOISE, strict=True)
    return "".join(
        separator.join([*([str(place)] if index else []), f"{at:.9E}", f"{value:.6E}"]) + "\n"
        for place, (at, value) in enumerate(both, start=1)
    )


def times(size: float = 1.0) -> list[float]:
    return [place / RATE / size for place in range(NOISE.size)]


def titled(x_title: str, x_unit: str, y_unit: str, date: str = "17-08-2024", quoted: bool = False) -> str:
    """A head of numbered titles and of the axes, as of analysers with a page for each measurement."""
    stated = {
        "Header Size": "19",
        "Version": "14",
        "Title 1": "Time(Acc DE) - Input",
        "Title 2": "Working : Input : Input : FFT Analyzer",
        "Date": date,
        "Time": "14:02:21:328",
        "X-Axis size": str(NOISE.size),
        "X-Axis title": x_title,
        "X-Axis unit": x_unit,
        "X-Axis offset": "0",
        "Y-Axis title": "Acceleration",
        "Y-Axis unit": y_unit,
        "dB reference": "1.000000E-06",
    }
    return "".join(f'"{key}"\t"{value}"\n' if quoted else f"{key}:\t{value}\n" for key, value in stated.items())


def labelled(x_label: str, y_label: str, separator: str = ",", more: str = "") -> str:
    """A head of which the axes are lines of quantity and unit."""
    lines = [["Signal", "Time Stream CH1"], ["DATE", "2024-08-17", "TIME", "14:02:21"], ["Points", str(NOISE.size)]]
    head = "".join(separator.join(line) + "\n" for line in lines)
    return head + more + f"X-Label{separator}{x_label}\nY-Label{separator}{y_label}\n"


def read(text: str) -> Samples:
    return read_layout(text.encode(), "x.txt")


@pytest.mark.parametrize("quoted", [False, True])
@pytest.mark.parametrize(("unit", "size"), [("s", 1.0), ("ms", 1e-3), ("us", 1e-6)])
def test_titles_and_axes(unit: str, size: float, quoted: bool, tmp_path: Path) -> None:
    text = titled("Time", unit, "m/s²", quoted=quoted) + rows(times(size))
    found = read(text)
    assert (found.channels, found.columns) == (("column_3",), (3,))
    assert (found.units, found.rate) == (("m/s2",), RATE)
    assert_allclose(found.values, [NOISE], rtol=1e-6)
    (tmp_path / "x.txt").write_text(text, encoding="cp1252")
    (block,) = open_source(SourceSpec("s", str(tmp_path / "x.txt"), block_s="file"))
    assert isinstance(block, Block)
    assert (block.start, block.rate, block.units) == (1723903341.328, RATE, ("m/s2",))


def test_a_date_of_two_readings_is_left_open() -> None:
    found = read(titled("Time", "s", "g", date="05-06-2024") + rows(times()))
    assert (found.start, found.stamp) == (None, "05-06-2024 14:02:21:328")


def test_without_a_column_of_times_the_rate_is_asked() -> None:
    found = read(titled("Time", "s", "g") + "".join(f"{value:.6E}\n" for value in NOISE))
    assert (found.units, found.rate, found.rate_readings) == (("g",), None, ())


@pytest.mark.parametrize("unit", ["Hz", "kHz", "RPM"])
def test_a_spectrum_is_no_recording(unit: str) -> None:
    text = titled("Frequency", unit, "m/s²") + rows(0.0125 * place for place in range(NOISE.size))
    with pytest.raises(ReaderError, match=f"xaxisunit states {unit}: a spectrum") as caught:
        read(text)
    assert caught.value.status == "wrong_shape"


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("index", [True, False])
def test_axes_as_lines_of_quantity_and_unit(separator: str, index: bool) -> None:
    head = labelled(f"Time{separator}ms", f"Acceleration{separator}m/s2", separator)
    found = read(head + rows(times(1e-3), index=index, separator=separator))
    assert (len(found.names), found.units, found.rate, found.start) == (1, ("m/s2",), RATE, 1723903341.0)


@pytest.mark.parametrize(
    ("label", "unit"),
    [
        ("Acceleration [g]", "g"),
        ("Acceleration (mm/s²)", "mm/s²"),
        ("Sound pressure [Pa]", "Pa"),
        ("Acceleration", None),
    ],
)
def test_units_in_the_label_of_an_axis(label: str, unit: str | None) -> None:
    assert read(labelled("Time [s]", label) + rows(times(), separator=",")).units == (unit,)


def test_axes_that_contradict_each_other_are_refused() -> None:
    text = labelled("Time [ms]", "Acceleration [g]", more="X-Unit,s\n") + rows(times(), separator=",")
    with pytest.raises(ReaderError, match="several units of time are stated: xunit s, xlabel ms"):
        read(text)
    text = labelled("Time [s]", "Acceleration [g]", more="Unit,m/s2\n") + rows(times(), separator=",")
    with pytest.raises(ReaderError, match="unit m/s2, ylabel g"):
        read(text)


@pytest.mark.parametrize("line", ["Sampling rate,51.2,kHz", "Sampling rate\t51.2\tkHz", '"Abtastrate";"51.2";"kHz"'])
def test_a_unit_in_a_field_of_its_own_counts(line: str) -> None:
    assert read(f"{line}\nUnit;g\n" + "".join(f"{value:.6f}\n" for value in NOISE)).rate == RATE


def test_thousands_and_a_unit_in_a_field_of_its_own_are_asked() -> None:
    found = read("Sampling rate;4,096;kHz\nUnit;g\n" + "".join(f"{value:.6f}\n" for value in NOISE))
    assert (found.rate, found.rate_readings) == (None, (4096.0, 4096000.0))
