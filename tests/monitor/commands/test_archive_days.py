"""``spallwatch archive-days``: days are moved once, whole, and again after an interruption."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
import xarray as xr
from click.testing import CliRunner, Result

from monitor.cli import spallwatch
from monitor.records import published_folder
from monitor.records.publish import publish
from monitor.records.published_folder import MovedDaysError
from monitor.records.store import Store
from tests.support.store_kill import block

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
FIRST_UTC = datetime(2026, 1, 1, tzinfo=UTC).timestamp()


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
            patch.setattr(published_folder, step, _fail)
            with pytest.raises((OSError, MovedDaysError), match="interrupted"):
                call(folder)
        for day in DAYS:
            content = day.encode() * 1000
            places = (folder / "records" / f"machine-{day}.nc", folder / "away" / f"machine-{day}.nc")
            assert any(place.exists() and place.read_bytes() == content for place in places), (step, day)
    call(folder)
    assert names(folder / "away") == ["machine-20260101.nc", "machine-20260102.nc"]
    assert len(published_folder.moved_days(folder / "records", "machine")) == 2


def _fail(*_: object) -> None:
    raise OSError("interrupted")


def test_a_day_with_late_blocks_replaces_its_earlier_copy_and_no_other_file(folder: Path) -> None:
    records, away = folder / "records", folder / "away"
    day = f"machine-{DAYS[0]}.nc"
    with Store.open(folder / "state.db", machine="machine") as store:
        for number in (1, 2):
            store.commit(replace(block(number), time=FIRST_UTC + number), {})
        publish(store, records)
        call(folder)
        assert (away / day).exists()
        # A sender that was cut off sends the rest of the day.
        store.commit(replace(block(3), time=FIRST_UTC + 3), {})
        publish(store, records)
    assert json.loads(call(folder).stdout)["moved"] == [day]
    with xr.open_dataset(away / day) as dataset:
        assert dataset.sequence.values.tolist() == [1, 2, 3]
    (entry,) = (entry for entry in published_folder.moved_days(records, "machine") if entry.file == day)
    assert entry.size == (away / day).stat().st_size
    assert not (records / day).exists()


def test_a_day_that_cannot_be_moved_holds_up_no_other(folder: Path) -> None:
    (folder / "away").mkdir()
    (folder / "away" / f"machine-{DAYS[0]}.nc").write_bytes(b"of another machine")
    with pytest.raises(MovedDaysError, match=f"machine-{DAYS[0]}.nc: differs from .*; nothing was removed"):
        call(folder)
    assert names(folder / "away") == [f"machine-{day}.nc" for day in DAYS[:2]]
    assert (folder / "away" / f"machine-{DAYS[0]}.nc").read_bytes() == b"of another machine"
    assert names(folder / "records") == [
        *(f"machine-{day}.nc" for day in (DAYS[0], DAYS[2])),
        "machine-moved.json",
        "machine-undated.nc",
    ]


def test_a_damaged_register_is_named_and_nothing_is_moved(folder: Path) -> None:
    (folder / "records" / "machine-moved.json").write_text("[]")
    with pytest.raises(MovedDaysError, match=r"machine-moved\.json: is not a register of moved days"):
        call(folder)
    assert len(names(folder / "records")) == 5
