"""Makers and checks that tests of docs share."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


DOCS = ROOT / "docs"


FOR_USERS = ("tutorials", "how-to", "reference", "explanation")


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def sentences(text: str) -> Iterator[str]:
    """Yield what a page says: its sentences, and each row of a table, cells apart by |; without emphasis and links.

    Headings, fenced blocks, heads of tables, sentences that end with a colon and those that begin with ``See [`` say
    nothing of the program.
    """
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    for part in re.split(r"\n\s*\n|^(?=- )", text, flags=re.MULTILINE):
        rows = part.strip().split("\n---|")[1:]
        plain = " ".join(part.strip().removeprefix("- ").split()).replace("**", "")
        for sentence in rows[0].split("\n")[1:] if rows else re.split(r"(?<=[.?!]) (?=[A-Z`\[])", plain):
            if sentence and not sentence.endswith(":") and not sentence.startswith("See ["):
                yield re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", sentence)


def table(text: str, heading: str) -> dict[str, str]:
    """Return the first table below a heading: the other cells of each row by its first cell."""
    rows = text.partition(f"\n{heading}\n")[2].partition("\n---|")[2].partition("\n\n")[0].split("\n")[1:]
    return {first: others for first, _, others in (row.partition(" | ") for row in rows)}


def missing_tests(names: Iterable[str]) -> list[str]:
    """Return those of the tests, ``PATH::NAME``, that there are not."""
    return sorted({name for name in names if name.partition("::")[2] not in _tests_of(name.partition("::")[0])})


@cache
def _tests_of(path: str) -> frozenset[str]:
    file = ROOT / path
    body = ast.parse(read(file)).body if file.is_file() else []
    return frozenset(node.name for node in body if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"))
