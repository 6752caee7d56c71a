"""A room that exceeds its budget is named, and so is a file that no room holds."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PLAN = "```text\nmodels 200 {modules}\nmodels/gears 900 3\ndocs 10 2\n```\n"


@pytest.fixture
def rooms(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("rooms", ROOT / ".ci" / "rooms.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # A dataclass looks its module up.
    monkeypatch.setitem(sys.modules, "rooms", module)
    spec.loader.exec_module(module)
    return module


def judged(rooms: ModuleType, modules: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **more: str) -> int:
    """Return the exit code for three files of two rooms."""
    plan = tmp_path / "PLAN.md"
    plan.write_text(PLAN.format(modules=modules))
    files = {"models/a.py": "x = 1\n", "models/b.py": "y = 2\n", "models/gears/c.py": "z = 3\n", **more}
    monkeypatch.setattr(rooms, "PLAN", plan)
    monkeypatch.setattr(rooms, "files_of", lambda commit: files)
    monkeypatch.setattr(sys, "argv", ["rooms.py"])
    with pytest.raises(SystemExit) as ended:
        rooms.main()
    return int(ended.value.code or 0)


def test_rooms_within_their_budgets_pass(
    rooms: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged(rooms, 2, tmp_path, monkeypatch) == 0
    assert capsys.readouterr().err == ""


def test_a_room_that_exceeds_is_named(
    rooms: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged(rooms, 1, tmp_path, monkeypatch) == 1
    assert capsys.readouterr().err == "models: 2 lines in 2 modules exceed its budget\n"


def test_words_of_documentation_are_counted(
    rooms: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged(rooms, 2, tmp_path, monkeypatch, **{"docs/page.md": "word " * 11}) == 1
    assert capsys.readouterr().err.startswith("docs: 11 lines")


def test_a_file_without_a_room_is_named(
    rooms: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged(rooms, 2, tmp_path, monkeypatch, **{"streams/d.py": "x = 1\n"}) == 1
    assert "streams/d.py belongs to no room" in capsys.readouterr().err
