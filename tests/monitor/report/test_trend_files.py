"""Trends of reports as files."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from monitor.report.report import build_report, write_trends
from monitor.report.runs import ReportError, read_runs
from streams.types.block import STANDARD_GRAVITY
from tests.support.score import DAY, record, stored


def made(folder: Path, *, start: float | None = None, level: str = "yes", machine: str = "m") -> Path:
    folder.mkdir()
    records = [
        record(number, {"rms": 0.1 * number, "h_or": None if number < 4 else 0.5, "absolute_level": level,
                        "v_eq": 1e-9 * number, "stage": "healthy"}, start=start)
        for number in range(1, 6)
    ]  # fmt: skip
    return stored(folder, records, machine)


@pytest.mark.parametrize("start", [None, DAY])
def test_a_report_writes_its_trends_beside_its_tables(tmp_path, start):
    build_report(made(tmp_path / "run", start=start), tmp_path / "r.html", tables=tmp_path / "t")
    with (tmp_path / "t" / "trends-x.csv").open() as file:
        rows = list(csv.DictReader(file))
    with xr.open_dataset(tmp_path / "t" / "trends-x.nc", decode_cf=False) as dataset:
        assert dataset.rms.attrs["units"] == "m s-2"
        np.testing.assert_allclose(dataset.rms.values, 0.1 * np.arange(1, 6))
        assert ("since" in dataset.time.attrs["units"]) is (start is not None)
    assert [row["block"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert [float(row["rms_g"]) for row in rows] == pytest.approx(0.1 * np.arange(1, 6) / STANDARD_GRAVITY)
    assert [row["h_or_g"] for row in rows][:3] == ["", "", ""]
    assert [float(row["v_eq_mm2"]) for row in rows] == pytest.approx(1e-3 * np.arange(1, 6))
    assert {row["stage"] for row in rows} == {"healthy"}
    assert "h_ir_g" not in rows[0]
    assert ("time_utc" in rows[0]) is (start is not None)
    if start is not None:
        assert rows[1]["time_utc"] == np.datetime_as_string(np.datetime64(int(start) + 100, "s")) + ".000Z"


def test_a_level_in_an_unknown_unit_is_not_called_g(tmp_path):
    write_trends(read_runs(made(tmp_path / "run", level="no")), tmp_path / "t")
    header = (tmp_path / "t" / "trends-x.csv").read_text().splitlines()[0].split(",")
    assert "rms" in header
    assert "rms_g" not in header
    with xr.open_dataset(tmp_path / "t" / "trends-x.nc") as dataset:
        assert dataset.rms.attrs["units"] == "unknown"


def test_speeds_repairs_and_the_domain_are_in_the_files(tmp_path):
    (tmp_path / "run").mkdir()
    values = {"domain": "order", "rotation_status": "ok", "speed_min": 22.0, "acceleration": 0.5, "pulses_missing": 2}
    path = stored(tmp_path / "run", [record(1, {"rms": 1.0, "encoder_error": np.pi / 180.0, **values}, start=None)])
    write_trends(read_runs(path), tmp_path / "t")
    with (tmp_path / "t" / "trends-x.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert (row["domain"], row["rotation_status"], row["speed_min_hz"]) == ("order", "ok", "22")
    assert (row["acceleration_hz_per_s"], row["pulses_missing"], row["encoder_error_deg"]) == ("0.5", "2", "1")
    assert "pulses_extra" not in row


def test_several_runs_have_files_of_their_own(tmp_path):
    runs = read_runs([made(tmp_path / "a", machine="a"), made(tmp_path / "b", machine="b")])
    names = {path.name for path in write_trends(runs, tmp_path / "t")}
    assert names == {"run1-trends-x.csv", "run1-trends-x.nc", "run2-trends-x.csv", "run2-trends-x.nc"}


def test_a_folder_that_takes_no_file_is_named(tmp_path):
    (tmp_path / "t").write_text("a file")
    with pytest.raises(ReportError, match="t: trends cannot be written"):
        write_trends(read_runs(made(tmp_path / "run")), tmp_path / "t")
