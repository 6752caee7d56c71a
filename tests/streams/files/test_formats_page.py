"""The table of formats in the documentation is that of the readers, and each of its endings is read by a test."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

import pytest

from streams.files.recognise import _EXTRAS, FORMATS, plain
from streams.types.spec import SourceSpec
from tests.streams.format_makers import MAKERS

PAGE = Path(__file__).resolve().parents[3] / "docs" / "reference" / "formats.md"
ROW = re.compile(r"^\| `(\w+)` \| (\.[^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|", re.MULTILINE)
ROWS = {name: rest for name, *rest in ROW.findall(PAGE.read_text(encoding="utf-8").partition("## Data sets")[0])}


def test_each_format_has_a_row_in_the_order_of_the_readers() -> None:
    assert list(ROWS) == list(FORMATS)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_row_states_what_its_reader_does(kind: str) -> None:
    endings, library, rate, unit, start = ROWS[kind]
    assert tuple(endings.split()) == FORMATS[kind]
    extra = re.search(r"extra `(\w+)`", library)
    assert (None if extra is None else extra[1]) == (_EXTRAS[kind][1] if kind in _EXTRAS else None)
    found = plain(kind, SourceSpec("s", "x"), FORMATS[kind])
    assert (rate != "-", unit != "-") == (found.states_rate, found.states_unit)
    assert (start != "-") == found.states_unit


def test_each_format_has_a_maker_or_tests_of_its_own() -> None:
    made = {PurePosixPath(name).suffix for name in MAKERS}
    without = [kind for kind, endings in FORMATS.items() if not made & set(endings)]
    assert without == ["raw"]
