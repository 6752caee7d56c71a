"""Folders of nothing but a date date what stands below them, whichever of them is opened."""

from __future__ import annotations

import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import spallwatch as sw
from monitor.cli import spallwatch
from spallwatch.recordings import DoubtedTimeWarning
from streams.types.stamps import date_folders, day_in_folders
from tests.support.dated_files import MAKERS, RIGHT

ENDINGS = {"csv": ".csv", "npy": ".npy", "wav": ".wav", "hdf5": ".h5", "tdms": ".tdms"}
DAY = 86400.0
TRUTH = datetime(2026, 3, 1, 8, 15, tzinfo=UTC)


def one_file(folder: Path, form: str, name: str = "081500", clock: datetime | None = None) -> Path:
    folder.mkdir(parents=True)
    MAKERS[form][1](folder, 0, clock)
    for path in folder.iterdir():
        path.rename(path.with_name(path.name.replace("00.", f"{name}.", 1)))
    return folder / f"{name}{ENDINGS[form]}"


def read(path: Path) -> tuple[dict[str, Any], list[str]]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = sw.read(path)
    return dict(found.attrs), [str(each.message) for each in caught if each.category is DoubtedTimeWarning]


@pytest.mark.parametrize("form", MAKERS)
def test_one_file_takes_the_date_above_it(form: str, tmp_path: Path) -> None:
    path = one_file(tmp_path / "2026" / "03" / "01", form)
    attrs, said = read(path)
    assert attrs["start_utc"] == TRUTH.isoformat()
    assert (attrs["time_source"], attrs["time_uncertainty_s"], said) == ("name_local", 1.0, [])


@pytest.mark.parametrize("opened", ["", "2026", "2026/03", "2026/03/01", "2026/03/01/081500.csv"])
def test_the_date_does_not_depend_on_what_is_opened(opened: str, tmp_path: Path) -> None:
    one_file(tmp_path / "data" / "2026" / "03" / "01", "csv")
    (block,) = sw.blocks(tmp_path / "data" / opened, block_s="file")
    assert block.attrs["start_utc"] == TRUTH.isoformat()
    words = ["init", str(tmp_path / "data" / opened), "--bearing", "6205-2RS", "--speed-hz", "24.8", "--yes"]
    out = tmp_path / "machine.toml"
    found = CliRunner().invoke(spallwatch, [*words, "--out", str(out)])
    assert found.exit_code == 0, found.output
    assert "2026" in next(line for line in found.output.splitlines() if "date: " in line)
    checked = CliRunner().invoke(spallwatch, ["check", "--config", str(out)]).output
    assert "2026-03-01T08:15:00Z" in checked
    described = sw.describe(tmp_path / "data" / opened, bearing="6205-2RS", speed_hz=24.8)
    assert any("2026" in str(date) or date.time == TRUTH.timestamp() for date in described.dates)


@pytest.mark.parametrize("form", ["csv", "wav", "tdms"])
def test_a_date_above_that_contradicts_that_of_the_file_is_said(form: str, tmp_path: Path) -> None:
    attrs, said = read(one_file(tmp_path / "2026" / "03" / "01", form, "x", RIGHT[0]))
    assert attrs["start_utc"] == RIGHT[0].isoformat()
    assert "its header states 2024-05-06T07:00:00Z, its folder 2026-03-01T00:00:00Z" in said[0]
    attrs, said = read(one_file(tmp_path / "2024-05-06", form, "x", RIGHT[0]))
    assert (attrs["time_source"], said) == ("header", [])


@pytest.mark.parametrize("form", ["npy", "hdf5", "wav"])
def test_a_day_alone_is_a_time_as_uncertain_as_a_day(form: str, tmp_path: Path) -> None:
    path = one_file(tmp_path / "2026" / "03" / "01", form, "vibration")
    attrs, said = read(path)
    assert attrs["start_utc"] == "2026-03-01T00:00:00+00:00"
    assert (attrs["time_source"], attrs["time_uncertainty_s"], said) == ("folder", DAY, [])
    description = sw.describe(path, bearing="6205-2RS", speed_hz=24.8)
    assert [date.time for date in description.dates] == [datetime(2026, 3, 1, tzinfo=UTC).timestamp()]
    words = ["init", str(path), "--bearing", "6205-2RS", "--speed-hz", "24.8", "--yes"]
    found = CliRunner().invoke(spallwatch, [*words, "--out", str(tmp_path / "m.toml")])
    assert "date: %Y/%m/%d in the names (2026-03-01T00:00:00Z)" in found.output


@pytest.mark.parametrize("above", ["campaign_2026-03-01", "2026/03/01/ch1", "2026/13/01", "03/01", "2026/03", "6/3/1"])
def test_other_folders_state_no_date(above: str, tmp_path: Path) -> None:
    path = one_file(tmp_path / above, "csv")
    attrs, _ = read(path)
    assert "start_utc" not in attrs


def test_which_folders_state_a_date() -> None:
    found = {
        path: date_folders(f"/data/{path}") for path in ("2026/03/01/08/15", "20260301", "01.03.2026", "x/2026-03-01")
    }
    assert found == {
        "2026/03/01/08/15": "2026/03/01/08/15",
        "20260301": "20260301",
        "01.03.2026": "01.03.2026",
        "x/2026-03-01": "2026-03-01",
    }
    day = day_in_folders("01.03.2026/a.csv", "Europe/Rome")
    assert day is not None
    assert (day.fixed, day.resolution) == (datetime(2026, 2, 28, 23, tzinfo=UTC).timestamp(), DAY)


def test_six_digits_that_may_be_a_time_of_day_are_no_date(tmp_path: Path) -> None:
    path = one_file(tmp_path / "data", "csv")
    words = [
        "init",
        str(path),
        "--bearing",
        "6205-2RS",
        "--speed-hz",
        "24.8",
        "--yes",
        "--out",
        str(tmp_path / "m.toml"),
    ]
    found = CliRunner().invoke(spallwatch, words)
    assert "time_name" not in (tmp_path / "m.toml").read_text()
    assert "2000-08-15" not in found.output


@pytest.mark.parametrize("form", ["csv", "wav", "hdf5"])
@pytest.mark.parametrize(
    ("folder", "name", "hour"),
    [
        ("2026-03-01/17", "08_15_00", 8),
        ("2026-03-01/17", "run_08-15-00", 8),
        ("2026-03-01/17", "12", None),
        ("2026-03-01/17", "08h15", None),
        ("2026-03-01/17", "0815_0001", 17),
        ("17", "0815", None),
        ("2026-03-01/17", "3000", 17),
        ("2026/03/01/17", "30", 17),
    ],
)
def test_a_folder_of_digits_is_an_hour_only_with_more(
    form: str, folder: str, name: str, hour: int | None, tmp_path: Path
) -> None:
    one_file(tmp_path / "data" / folder, form, name)
    (block,) = sw.blocks(tmp_path / "data", block_s="file")
    found = block.attrs.get("start_utc")
    assert (None if found is None else datetime.fromisoformat(found).hour) == hour
    words = ["init", str(tmp_path / "data"), "--bearing", "6205-2RS", "--speed-hz", "24.8", "--yes"]
    said = CliRunner().invoke(spallwatch, [*words, "--out", str(tmp_path / "m.toml")]).output
    assert ("its folder 17 taken for the hour" in said) == (hour == 17)
