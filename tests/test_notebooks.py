"""The notebooks run, and show what is stored in them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.support.docs_commands import same
from tests.support.notebooks import FOLDER, read_notebook, run_cells

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def words(outputs: list[dict]) -> list[str]:
    """Return what a cell shows as words, pictures and sizes of memory aside."""
    texts = [output.get("text") or output["data"]["text/plain"] for output in outputs]
    return re.sub(r"(?<=\d)(?=[%,;s/])|[{}()\[\],:;%]", " ", " ".join(map("".join, texts))).split()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_is_stored(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notebook = read_notebook(path)
    monkeypatch.chdir(tmp_path)
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for cell, found in zip(cells, run_cells(notebook), strict=True):
        assert len(found) == len(cell["outputs"])
        if "print(" not in "".join(cell["source"]):
            continue
        shown, stored = words(found), words(cell["outputs"])
        assert len(shown) == len(stored), f"{shown} instead of {stored}"
        assert [pair for pair in zip(stored, shown, strict=True) if not same(*pair)] == []


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) == 3
