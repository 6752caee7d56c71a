"""The page of published figures has the tables as computed."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.published.figures import renewed, tables_of_the_page

PAGE = Path(__file__).resolve().parents[2] / "docs" / "evidence" / "published-figures.md"


def test_the_page_holds_the_tables_as_computed() -> None:
    """Renew it with ``python -m benchmarks.published.figures --document docs/evidence/published-figures.md``."""
    text = PAGE.read_text(encoding="utf-8")
    for marks, table in tables_of_the_page().items():
        assert renewed(text, table, marks) == text
    with pytest.raises(ValueError, match="lacks the lines"):
        renewed("nothing", "")
