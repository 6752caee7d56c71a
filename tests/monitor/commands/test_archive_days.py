"""``spallwatch archive-days``: days are moved once, whole, and again after an interruption."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from monitor.cli import spallwatch
from monitor.records import moved_days
from monitor.records.moved_days import MovedDaysError

CONFIG = """
[[bearing]]
name = "b"
designation = "6205"
[[source]]
name = "press"
[[channel]]
name = "x"
source = "press"
unit = "g"
bearing = "b"
"""
DAYS = ("20260101", "20260102", "20260103")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    (tmp_path / "records").mkdir()
    for day in DAYS:
        (tmp_path / "records" / f"machine-{day}.nc").write_bytes(day.encode() * 1000)
    (tmp_path / "records" / "machine-undated.nc").write_bytes(b"undated")
    return tmp_path


def call(folder: Path, before: str = "2026-01-03") -> Result:
    options = ["--config", str(folder / "m.toml"), "--before", before, "--to", str(folder / "away"), "--json"]
    return CliRunner().invoke(spallwatch, ["archive-days", *options], catch_exceptions=False)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_days_before_a_date_are_moved_and_listed(folder: Path) -> None:
    done = json.loads(call(folder).stdout)
    assert done == {
        "moved": ["machine-20260101.nc", "machine-20260102.nc"],
        "to": str(folder / "away"),
        "bytes": 16000,
    }
    assert names(folder / "away") == done["moved"]
    assert names(folder / "records") == ["machine-20260103.nc", "machine-moved.json", "machine-undated.nc"]
    assert json.loads(call(folder).stdout)["moved"] == []


def test_an_interruption_at_any_step_leaves_each_day_whole_and_the_call_can_be_repeated(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for step in ("replacing", "sync_file", "_remove", "sync_folder"):
        with monkeypatch.context() as patch:
            patch.setattr(moved_days, step, _fail)
            with pytest.raises((OSError, MovedDaysError), match="interrupted"):
                call(folder)
        for day in DAYS:
            content = day.encode() * 1000
            places = (folder / "records" / f"machine-{day}.nc", folder / "away" / f"machine-{day}.nc")
            assert any(place.exists() and place.read_bytes() == content for place in places), (step, day)
    call(folder)
    assert names(folder / "away") == ["machine-20260101.nc", "machine-20260102.nc"]
    assert len(moved_days.moved_days(folder / "records", "machine")) == 2


def _fail(*_: object) -> None:
    raise OSError("interrupted")


def test_a_damaged_register_is_named_and_nothing_is_moved(folder: Path) -> None:
    (folder / "records" / "machine-moved.json").write_text("[]")
    with pytest.raises(MovedDaysError, match=r"machine-moved\.json: is not a register of moved days"):
        call(folder)
    assert len(names(folder / "records")) == 5
