"""Texts whose rows begin with a date and time of day."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from streams.files.formats import stamped
from streams.files.formats.text import read_layout
from streams.open import open_source
from streams.types.block import Block
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceSpec

BEGIN = datetime(2024, 11, 4, 23, 59, 59)
EIGHT = 1730764799.0
FORMS = {
    "iso": ("%Y-%m-%dT%H:%M:%S.%f", 26, ","),
    "german": ("%d.%m.%Y %H:%M:%S,%f", 23, ";"),
    "apart": ("%d.%m.%Y;%H:%M:%S,%f", 23, ";"),
    "half": ("%m/%d/%Y %I:%M:%S.%f %p", 0, "\t"),
    "named": ("%d-%b-%Y %H:%M:%S", 0, ";"),
}
"""By name: strptime pattern, the width of a stamp (0: all of it), the separator."""


def text_of(form: str, count: int = 400, rate: float = 100.0, header: str = "Datum;a [g];b [mV]") -> str:
    pattern, width, separator = FORMS[form]
    if form == "apart":
        header = header.replace("Datum", "Datum;Zeit")
    rows = []
    for index in range(count):
        stamp = (BEGIN + timedelta(seconds=index / rate)).strftime(pattern)
        point = separator.join([stamp[:width] if width else stamp, f"{index % 7}.5", f"{index % 5}.25"])
        rows.append(point.replace(".5", ",5").replace(".25", ",25") if form in ("german", "apart") else point)
    return "\n".join([header.replace(";", separator), *rows, ""])


@pytest.mark.parametrize("form", ["iso", "german", "apart", "half"])
def test_start_rate_and_columns_across_midnight(form: str) -> None:
    found = read_layout(text_of(form).encode(), "x.csv")
    assert found.rate == 100.0
    assert (found.start, found.stamp) in [(EIGHT, None), (None, "11/04/2024 11:59:59.000000 PM")]
    assert found.channels == ("a", "b")
    assert found.units == ("g", "mV")
    assert found.columns == ((3, 4) if form == "apart" else (2, 3))
    assert_allclose(found.values[:, 8], [1.5, 3.25])


def test_one_value_a_second() -> None:
    found = read_layout(text_of("named", 90, 1.0).encode(), "x.csv")
    assert (found.rate, found.start) == (1.0, EIGHT)


def test_a_time_of_day_alone_gives_the_rate() -> None:
    text = "".join(f"23:59:59.{i:03d},{i % 7}\n" for i in range(900, 1000))
    text += "".join(f"00:00:00.{i:03d},{i % 7}\n" for i in range(100))
    found = read_layout(f"time,a\n{text}".encode(), "x.csv")
    assert (found.rate, found.start, found.names) == (1000.0, None, ("a",))


@pytest.mark.parametrize(
    ("text", "status", "words"),
    [
        ("t,a\n2024-01-01 00:00:00,1\n2024-01-01 00:00:01,2\nend\n", "unreadable", "line 4: expected a date"),
        ("t,a\n2024-01-01 00:00:00,1\n2024-01-01 00:00:01,2\n2024-01-01 00:00:09,2\n", "wrong_rate", "evenly"),
        (
            "t,a\n2024-01-01 00:00:00,1\n2024-01-01 00:00:01,2\n2024-01-01 00:00:02,x\n",
            "unreadable",
            "line 4, column 2: expected a number, found 'x'",
        ),
        ("Start,2024-01-01 00:00:00\n", "empty", "line 1"),
    ],
)
def test_what_cannot_be_such_rows(text: str, status: str, words: str) -> None:
    with pytest.raises(ReaderError, match=words) as caught:
        read_layout(text.encode(), "x.csv")
    assert caught.value.status == status


@given(st.integers(0, 86399999), st.integers(1, 3000), st.sampled_from(["iso", "german", "apart"]))
def test_stamps_of_one_width_are_those_read_one_by_one(begin: int, step: int, form: str) -> None:
    pattern, width, _ = FORMS[form]
    moments = [datetime(2024, 12, 30) + timedelta(milliseconds=begin + step * i) for i in range(60)]
    stamps = [moment.strftime(pattern)[:width].replace(";", " ").encode() for moment in moments]
    even = stamped._even_times(stamps, "Europe/Berlin")
    assert even is not None
    assert_allclose(even[0], stamped._uneven_times(stamps, "x", "Europe/Berlin", 1)[0], atol=1e-6)
    assert_allclose(even[0], 1e-3 * step * np.arange(60), atol=1e-6)


def test_a_source_of_such_files(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text(text_of("german", 1000))
    channel = ChannelSpec("a", column=2, unit="g")
    (block,) = open_source(SourceSpec("s", str(tmp_path / "x.csv"), block_s="file", channels=(channel,)))
    assert isinstance(block, Block)
    assert (block.start, block.samples.shape) == (EIGHT, (1, 1000))
