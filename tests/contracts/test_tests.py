"""Test modules can be moved alone: nothing imports one, what they share stands in ``tests.support`` and beside them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]


def _imports(folder: str) -> Iterator[tuple[str, str]]:
    """Yield file and name of each module that the files of a folder import, with the names taken from it."""
    for path in sorted((_ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                yield from ((str(path), alias.name) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module is not None:
                yield from ((str(path), f"{node.module}.{alias.name}") for alias in node.names)


def test_no_module_of_tests_is_imported() -> None:
    imported = [*_imports("tests"), *_imports("benchmarks")]
    assert len(imported) > 1000
    assert [pair for pair in imported if any(part.startswith("test_") for part in pair[1].split(".")[:-1])] == []


def test_tests_and_benchmarks_can_be_moved_alone() -> None:
    """Tests of a benchmark stand beside it; what tests and benchmarks share stands in ``reference``."""
    folders = {"tests", "benchmarks", "reference"}
    allowed = {("tests", "reference"), ("benchmarks", "reference")}
    for folder in folders:
        others = {other for other in folders - {folder} if (folder, other) not in allowed}
        assert [pair for pair in _imports(folder) if pair[1].split(".")[0] in others] == []
