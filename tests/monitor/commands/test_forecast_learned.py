"""``spallwatch forecast`` by recorded runs: features and records in, the end as those runs ended out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from monitor.cli import spallwatch
from monitor.commands.common import InputError
from tests.support.library_learn import features, learned


def forecast(*arguments: object) -> dict[str, Any]:
    run = CliRunner().invoke(spallwatch, ["forecast", "--json", *map(str, arguments)], catch_exceptions=False)
    assert run.exit_code == 0, run.output
    return json.loads(run.stdout)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("learned")
    runs = [features(folder / f"{i}.csv", last=40 + 5 * i, seed=i) for i in range(5)]
    learned(*runs, "--out", folder / "l.npz")
    return folder / "l.npz"


def test_forecasts_of_a_run_that_was_not_learned(library: Path, tmp_path: Path) -> None:
    run = features(tmp_path / "run.csv", last=50, seed=77)
    found = forecast(run, "--method", "learned", "--library", library, "--window-hours", "0.05")
    assert (found["method"], found["runs"], found["forecast_end"]) == ("learned", 5, "recorded runs")
    assert "not to a threshold of V_eq" in found["prior"]
    assert found["t_fs_s"] == 1400.0
    assert found["t_fs_known_s"] > found["t_fs_s"]
    rows = {row["t_issue_s"]: row for row in found["rows"]}
    assert len(rows) == 50
    assert rows[1400.0]["status"] == "too_few_points"
    half = rows[1650.0]
    assert half["status"] == "ok"
    assert half["threshold_mm2"] is None
    assert half["tt_lower_s"] < 240.0 < half["tt_upper_s"]
    assert half["t_threshold_s"] == pytest.approx(1650.0 + half["tt_s"])
    assert rows[1450.0]["p_crossed"] < 0.1 < 0.4 < rows[1890.0]["p_crossed"]
    assert rows[1890.0]["tt_s"] < 0.6 * 490.0 < 490.0
    assert 0.0 < half["p_threshold"] < 1.0
    # The file says what it is, so that the method need not be given.
    assert forecast(run, "--library", library)["method"] == "learned"


def test_without_a_file_it_is_as_long_again_as_it_has_lasted(tmp_path: Path) -> None:
    for content in ("time_s,v_eq_mm2", "elapsed_s,rms_g"):
        path = tmp_path / "history.csv"
        rows = "".join(f"{100 * i},{0.01 + 0.001 * i}\n" for i in range(11))
        path.write_text(f"{content}\n{rows}")
        stated = () if "v_eq" in content else ("--t-fs-s", "0")
        found = forecast(path, "--method", "learned", *stated)
        last = found["rows"][-1]
        assert last["status"] == "ok"
        values = [last[key] for key in ("tt_s", "tt_lower_s", "tt_upper_s")]
        assert values == pytest.approx([1000.0, 1000.0 / 9.0, 9000.0])
        assert found["prior"].startswith("no recorded run")
        assert found["runs"] == 0


def test_a_healthy_machine_has_no_forecast(library: Path, tmp_path: Path) -> None:
    healthy = features(tmp_path / "healthy.csv", last=0)
    found = forecast(healthy, "--library", library)
    assert [row["status"] for row in found["rows"]] == ["not_final_stage"]
    assert found["t_fs_s"] is None
    table = CliRunner().invoke(spallwatch, ["forecast", str(healthy), "--library", str(library)]).stdout
    assert "not_final_stage" in table


def test_a_life_beyond_the_runs_is_said(library: Path, tmp_path: Path) -> None:
    long = features(tmp_path / "long.csv", last=300)
    rows = forecast(long, "--library", library)["rows"]
    assert rows[30]["status"] == "ok"
    assert rows[-1]["status"] == "outside_library"
    assert rows[-1]["tt_s"] == pytest.approx(2990.0, rel=0.05)


def test_what_is_refused(library: Path, tmp_path: Path) -> None:
    run = features(tmp_path / "run.csv")
    volumes = tmp_path / "v.csv"
    volumes.write_text("time_s,v_eq_mm2\n0,0.01\n10,0.02\n")
    other = tmp_path / "other.npz"
    np.savez(other, header=np.array("{}"))
    for arguments, said in (
        ((run, "--method", "learned", "--threshold-mm2", "0.05", "--threshold-mm2", "0.1"), "forecasts one end"),
        ((run, "--method", "learned", "--library", other), "learned library of version 1 expected"),
        ((run, "--method", "combined", "--library", library), "got 0 of the first, 1 of the other"),
        ((run, "--method", "combined", "--library", library, "--library", other), "needs records"),
        ((run, "--method", "learned", "--library", library, "--library", library), "two files were learned"),
        ((volumes, "--method", "learned", "--library", library), "column rms_g is missing"),
        ((volumes, "--method", "thesis", "--axis", "h"), "belong to --method learned"),
        ((volumes, "--library", other, "--library", other), "twice with --method combined only"),
        ((volumes, "--method", "library", "--library", library), "spallwatch library of version"),
    ):
        result = CliRunner().invoke(spallwatch, ["forecast", *map(str, arguments)])
        assert isinstance(result.exception, InputError), (arguments, result.output)
        assert said in str(result.exception)
