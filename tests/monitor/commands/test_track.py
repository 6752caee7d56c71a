"""``track`` and ``forecast``: what they read, what they write, and that they say what the stages say."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from click.testing import CliRunner

from models.machine.rig import Rig
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.file import save_map
from models.maps.nodes import simulate_point
from models.maps.plan import MapPlan, scene_at
from monitor.commands import forecast as forecast_command
from monitor.commands import track as track_command
from monitor.commands.common import InputError
from monitor.commands.history_files import read_readings
from monitor.health.rest import quadratic as forecast
from monitor.health.size import DamageInput, edv
from monitor.health.size.edv import rms_from_map, rms_from_model, rms_history
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState
from monitor.health.size.library.forecaster import step as ask_library
from monitor.health.size.library.model import Library
from monitor.records.dataset import words
from monitor.records.histories import claims_calibration
from monitor.records.library_file import save_library
from monitor.service.setup import to_slice
from streams.types.block import STANDARD_GRAVITY
from tests.oracles.toy_lives import THRESHOLD, ToyLife, toy_library, toy_life


@pytest.fixture(scope="module")
def rms_map() -> RmsMap:
    extents = tuple(math.radians(3.0 * i) for i in range(11))
    depths = tuple(3e-6 * i for i in range(9))
    plan = MapPlan(load=(3000.0, 4000.0), speed=(40.0,), h_d=depths, dphi_d=extents, rms_band=(0.0, 9500.0))
    return build_map(replace(plan, rig=RIG))


@pytest.fixture(scope="module")
def map_file(rms_map: RmsMap, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.nc"
    save_map(rms_map, path)
    return path


RIG = Rig(calibrated=True)
"""A simulated rig counts as calibrated."""
LEVELS_G = [0.3 + 0.03 * i for i in range(40)]


def history(folder: Path, extra: str = ",4000,40", names: str = ",load_newton,speed_hz") -> Path:
    path = folder / "rms.csv"
    lines = [f"{300 * i},{level}{extra}\n" for i, level in enumerate(LEVELS_G)]
    path.write_text(f"time_s,rms_g{names}\n" + "".join(lines))
    return path


def volumes(folder: Path) -> Path:
    path = folder / "v.csv"
    path.write_text("time_s,v_eq_mm2\n" + "".join(f"{60 * i},{0.001 + 1e-5 * i * i}\n" for i in range(60)))
    return path


def run(command: Any, *arguments: object) -> dict[str, Any]:
    outcome = CliRunner().invoke(command, [str(argument) for argument in (*arguments, "--json")])
    if outcome.exception is not None:
        raise outcome.exception
    return json.loads(outcome.stdout)


def test_track_says_what_the_tracker_says(tmp_path: Path, map_file: Path, rms_map: RmsMap) -> None:
    told = run(track_command.command, history(tmp_path), "--map", map_file, "--smoothing-blocks", 3)
    at, state = to_slice(rms_map, 4000.0, 40.0), edv.EdvState()
    for row, level in zip(told["rows"], LEVELS_G, strict=True):
        state, result = edv.step(
            state, level * STANDARD_GRAVITY, map_slice=at, settings=edv.EdvSettings(smoothing_blocks=3)
        )
        assert row["status"] == str(result.status)
        expected = None if math.isnan(result.v_eq) else pytest.approx(result.v_eq * 1e6, rel=1e-12)
        assert row["v_eq_mm2"] == expected
    assert (told["interval"], told["prior"], told["calibrated"]) == (None, None, True)
    assert told["map_hash"] == rms_map.hash


@pytest.mark.parametrize("suffix", [".csv", ".json", ".nc"])
def test_track_writes_by_the_suffix(tmp_path: Path, map_file: Path, suffix: str) -> None:
    out = tmp_path / f"out{suffix}"
    told = run(track_command.command, history(tmp_path), "--map", map_file, "--out", out)
    expected = [row["v_eq_mm2"] for row in told["rows"]]
    if suffix == ".csv":
        with out.open() as file:
            written = [float(row["v_eq_mm2"]) if row["v_eq_mm2"] else None for row in csv.DictReader(file)]
        assert written == expected
    elif suffix == ".json":
        assert json.loads(out.read_text()) == told
    else:
        with xr.open_dataset(out, engine="netcdf4", decode_cf=False) as dataset:
            assert dataset.v_eq.attrs["units"] == "m2"
            assert dataset.attrs["calibrated"] == "yes"
            assert list(words(dataset.edv_status)) == [row["status"] for row in told["rows"]]
            found = dataset.v_eq.values * 1e6
        assert found == pytest.approx(np.array([np.nan if v is None else v for v in expected]), nan_ok=True)


def test_forecast_writes_one_column_a_threshold(tmp_path: Path) -> None:
    out = tmp_path / "tt.nc"
    thresholds = ("--threshold-mm2", 0.03, "--threshold-mm2", 0.05)
    told = run(forecast_command.command, volumes(tmp_path), "--method", "thesis", *thresholds, "--out", out)
    with xr.open_dataset(out, engine="netcdf4", decode_cf=False) as dataset:
        assert dataset.tt.dims == ("time", "threshold")
        assert dataset.v_th.values.tolist() == pytest.approx([0.03e-6, 0.05e-6])
        assert [word for row in words(dataset.tt_status) for word in row] == [row["status"] for row in told["rows"]]
        tt = dataset.tt.values.ravel()
    assert tt == pytest.approx(
        np.array([np.nan if r["tt_s"] is None else r["tt_s"] for r in told["rows"]]), nan_ok=True
    )


def test_forecast_says_how_much_tt_depends_on_the_threshold(tmp_path: Path) -> None:
    """Oracle: V = 0.001 + 1e-5 (t/60)^2 reaches each threshold at a known time, whatever was known when."""
    asked = [0.03, 0.05, 0.08, 0.1]
    arguments = [part for value in asked for part in ("--threshold-mm2", value)]
    told = run(forecast_command.command, volumes(tmp_path), "--method", "thesis", *arguments)
    reached = [60 * math.sqrt((value - 0.001) / 1e-5) for value in asked]
    assert [one["threshold_mm2"] for one in told["by_threshold"]] == asked
    assert [one["t_threshold_s"] for one in told["by_threshold"]] == pytest.approx(reached, rel=1e-3)
    assert told["by_threshold"][0]["status"] == "already_crossed"
    before = [60 * i for i in range(2, 60) if 60 * i < reached[0]]
    ratios = [(reached[2] - t) / (reached[0] - t) for t in before]
    assert told["by_threshold"][2]["tt_over_first"] == pytest.approx(np.median(ratios), rel=1e-3)
    _, (result,) = forecast.step(forecast.ForecastState(), 0.0, 1e-9, thresholds=[0.03e-6])
    assert told["rows"][0]["status"] == str(result.status)


def test_under_the_condition_tracked_the_other_rms_is_the_smoothed_one(
    tmp_path: Path, map_file: Path, rms_map: RmsMap
) -> None:
    """The inversion is exact: the map gives back the very RMS that the sizes were found from."""
    out = tmp_path / "o.nc"
    run(track_command.command, history(tmp_path), "--map", map_file, "--other-load-newton", 4000, "--out", out)
    with xr.open_dataset(out, engine="netcdf4", decode_cf=False) as dataset:
        found = np.isfinite(dataset.v_eq.values)
        assert found.sum() > 30
        assert dataset.other_rms.values[found] == pytest.approx(dataset.rms_smoothed.values[found], rel=1e-9)
        assert np.isnan(dataset.other_rms.values[~found]).all()


def test_the_other_rms_is_that_of_the_map_and_of_the_model(tmp_path: Path, map_file: Path, rms_map: RmsMap) -> None:
    path = history(tmp_path)
    told = run(track_command.command, path, "--map", map_file, "--other-load-newton", 3000, "--direct")
    row = told["rows"][-1]
    size = math.radians(row["dphi_deg"]), row["h_d_um"] * 1e-6
    at = rms_map.slice_at(3000.0, 40.0)
    assert row["other_rms_g"] * STANDARD_GRAVITY == pytest.approx(float(at.interpolate(*size)))
    scene = scene_at(rms_map.plan, 3000.0, 40.0, size[1], size[0])
    assert row["other_rms_direct_g"] * STANDARD_GRAVITY == pytest.approx(simulate_point(rms_map.plan, scene).rms)


def test_at_the_nodes_map_and_model_agree(rms_map: RmsMap) -> None:
    dphi_d, h_d = np.radians([6.0, 12.0, 24.0, np.nan]), np.array([6e-6, 12e-6, 18e-6, 6e-6])
    by_map = rms_history(dphi_d, h_d, rms_from_map(rms_map, 3000.0, 40.0))
    by_model = rms_history(dphi_d, h_d, rms_from_model(rms_map.plan, 3000.0, 40.0))
    assert by_map[:3] == pytest.approx(by_model[:3], rel=2e-3)
    assert np.isnan([by_map[3], by_model[3]]).all()


def test_each_size_is_asked_for_once() -> None:
    asked: list[tuple[float, float]] = []

    def at(dphi_d: float, h_d: float) -> float:
        asked.append((dphi_d, h_d))
        return dphi_d + h_d

    assert rms_history([1.0, 1.0, 2.0, 1.0], [3.0, 3.0, 3.0, 3.0], at).tolist() == [4.0, 4.0, 5.0, 4.0]
    assert asked == [(1.0, 3.0), (2.0, 3.0)]


@pytest.mark.parametrize(
    ("names", "extra", "options", "message"),
    [
        (",load_newton,speed_hz,harmonic_1_g", ",4000,40,0.1", (), "column harmonic_2_g is missing"),
        (",speed_hz", ",40", (), "column load_newton is missing"),
        (",load_newton,speed_hz", ",4000,40", ("--channel", "x"), "--channel x"),
        (",load_newton,speed_hz", ",4000,40", ("--out", "rows.txt"), r"\.csv, \.json or \.nc"),
        (",load_newton,speed_hz", ",4000,40", ("--direct",), "--direct belongs to"),
        (",load_newton,speed_hz", ",4000,40", ("--other-speed-hz", "80"), "the map covers speed"),
        (
            *(",load_newton,speed_hz", ",4000,40"),
            *(("--method", "thesis", "--library", "x.npz"), "belongs to --method library"),
        ),
        (",load_newton,speed_hz", ",4000,40", ("--method", "library"), "--library FILE is missing"),
    ],
)
def test_what_cannot_be_tracked_is_refused(
    tmp_path: Path, map_file: Path, names: str, extra: str, options: tuple[str, ...], message: str
) -> None:
    path = history(tmp_path, extra, names)
    with pytest.raises(InputError, match=message):
        run(track_command.command, path, "--map", map_file, *options)


def test_a_history_without_rms_is_refused(tmp_path: Path, map_file: Path) -> None:
    path = tmp_path / "history.csv"
    path.write_text("time_s,rms\n0,1\n")
    with pytest.raises(InputError, match=r"history\.csv.*rms_g"):
        run(track_command.command, path, "--map", map_file)


def test_without_a_map_only_the_library_tracks(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--map FILE is missing"):
        run(track_command.command, history(tmp_path))


@pytest.fixture(scope="module")
def library() -> Library:
    return replace(toy_library(40), made_of={"population": {"rig": RIG.as_dict()}})


@pytest.fixture(scope="module")
def library_file(library: Library, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("library") / "toy.npz"
    save_library(library, path)
    return path


def toy_history(folder: Path, *, lines: bool = True) -> tuple[Path, ToyLife]:
    life = toy_life(1000)
    names = ["time_s", "rms_g", "load_newton", "speed_hz"]
    columns = [life.t, life.rms / STANDARD_GRAVITY, life.load, life.speed]
    if lines:
        names += [f"harmonic_{k}_g" for k in range(1, 7)]
        columns += list(life.harmonics.T / STANDARD_GRAVITY)
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*columns, strict=True)]
    path = folder / "toy.csv"
    path.write_text("\n".join([",".join(names), *rows]) + "\n")
    return path, life


@pytest.mark.parametrize("lines", [True, False])
def test_the_library_tracks_what_the_input_has(
    tmp_path: Path, library: Library, library_file: Path, lines: bool
) -> None:
    path, life = toy_history(tmp_path, lines=lines)
    told = run(track_command.command, path, "--library", library_file, "--interval", 0.9)
    asking = LibrarySettings(features="rms+harmonics" if lines else "rms", interval=0.9)
    state = LibraryState()
    for i, row in enumerate(told["rows"]):
        block = DamageInput(life.t[i], life.rms[i], tuple(life.harmonics[i]), life.load[i], life.speed[i])
        state, result, _ = ask_library(state, block, library, asking, thresholds=(THRESHOLD,))
        assert row["status"] == str(result.status)
        if row["status"] == "ok":
            found = [row["v_eq_lower_mm2"], row["v_eq_mm2"], row["v_eq_upper_mm2"]]
            assert found == pytest.approx(
                [1e6 * v for v in (result.v_eq_lower, result.v_eq, result.v_eq_upper)], rel=1e-6
            )
    assert sum(row["status"] == "ok" for row in told["rows"]) > 20
    assert told["interval"] == 0.9
    assert told["prior"] == f"toy lives (library {library.hash[:16]})"


def test_the_filter_tracks_with_an_interval(tmp_path: Path, map_file: Path) -> None:
    told = run(track_command.command, history(tmp_path), "--map", map_file, "--method", "filter")
    row = told["rows"][-1]
    assert row["status"] in ("ok", "ambiguous")
    assert row["v_eq_lower_mm2"] < row["v_eq_mm2"] < row["v_eq_upper_mm2"]
    assert "may stall or jump" in told["prior"]


def test_the_library_forecasts_from_volumes_alone(tmp_path: Path, library: Library, library_file: Path) -> None:
    life = toy_life(1000)
    path = tmp_path / "v.csv"
    rows = [f"{float(t)!r},{float(1e6 * v)!r}\n" for t, v in zip(life.t, life.v_eq, strict=True)]
    path.write_text("time_s,v_eq_mm2\n" + "".join(rows))
    told = run(
        *(forecast_command.command, path, "--method", "library", "--library", library_file),
        *("--threshold-mm2", THRESHOLD * 1e6, "--window-hours", 2.0),
    )
    state, asking = LibraryState(), LibrarySettings(features="v_eq", window=7200.0)
    for row, t, v_eq in zip(told["rows"], life.t, life.v_eq, strict=True):
        block = DamageInput(t, v_eq=v_eq)
        state, _, (result,) = ask_library(state, block, library, asking, thresholds=(THRESHOLD,))
        assert row["status"] == str(result.status)
        if row["status"] == "ok":
            assert row["tt_s"] == pytest.approx(result.tt, rel=1e-6)
            assert row["tt_lower_s"] <= row["tt_s"] <= row["tt_upper_s"]
            assert 0.0 <= row["p_threshold"] <= 1.0
    assert sum(row["status"] == "ok" for row in told["rows"]) > 10


def test_a_threshold_that_the_library_does_not_know_is_refused(tmp_path: Path, library_file: Path) -> None:
    arguments = ("--method", "library", "--library", library_file, "--threshold-mm2", 0.08)
    with pytest.raises(InputError, match=r"--library: threshold_mm2 0\.08 is not in the library"):
        run(forecast_command.command, volumes(tmp_path), *arguments)


def test_a_file_that_is_no_library_is_refused(tmp_path: Path, map_file: Path) -> None:
    with pytest.raises(InputError, match="--library"):
        run(track_command.command, history(tmp_path), "--method", "library", "--library", map_file)


def uncalibrated(rms_map: RmsMap, folder: Path) -> Path:
    """Write the map as it would have been built on an uncalibrated rig."""
    plan = replace(rms_map.plan, rig=Rig())
    attributes = {**rms_map.attributes, "parameters": plan.as_json(), "hash": plan.hash()}
    save_map(replace(rms_map, attributes=attributes), folder / "uncalibrated.nc")
    return folder / "uncalibrated.nc"


def test_track_on_an_uncalibrated_map_is_relative_and_says_so(tmp_path: Path, rms_map: RmsMap, map_file: Path) -> None:
    path, other = history(tmp_path), uncalibrated(rms_map, tmp_path)
    known, told = (run(track_command.command, path, "--map", file) for file in (map_file, other))
    assert (known["calibrated"], told["calibrated"]) == (True, False)
    first = next(row["v_eq_mm2"] for row in known["rows"] if row["v_eq_mm2"])
    assert "ok" in {row["status"] for row in known["rows"]}
    for row, one in zip(known["rows"], told["rows"], strict=True):
        assert one["status"] == ("uncalibrated" if row["status"] == "ok" else row["status"])
        assert one["v_eq_mm2"] == row["v_eq_mm2"]
        relative = None if row["v_eq_mm2"] is None else pytest.approx(row["v_eq_mm2"] / first)
        assert one["v_eq_relative"] == row["v_eq_relative"] == relative
    printed = [
        CliRunner().invoke(track_command.command, [str(path), "--map", str(file)]).stdout for file in (map_file, other)
    ]
    assert printed[0].split()[:2] == ["time", "V_eq"]
    assert "mm3/mm" in printed[0]
    assert "uncalibrated" not in printed[0]
    head, _, table = printed[1].partition("\n")
    assert "masses and springs are those of the default test bench" in head
    assert "x first" in table
    assert "mm3/mm" not in table


def test_a_library_of_an_uncalibrated_rig_issues_no_tt_unless_asked_to(
    tmp_path: Path, library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = toy_history(tmp_path)
    monkeypatch.setattr(forecast_command, "is_records", lambda _: True)
    monkeypatch.setattr("monitor.commands.forecast.read_readings", lambda *_, **given: read_csv(path))
    found = {}
    for name, rig, flags in (("yes", RIG, ()), ("no", Rig(), ()), ("asked", Rig(), ("--uncalibrated-threshold",))):
        file = tmp_path / f"{name}.npz"
        save_library(replace(library, made_of={"population": {"rig": rig.as_dict()}}), file)
        threshold = ("--threshold-mm2", THRESHOLD * 1e6)
        found[name] = run(forecast_command.command, path, "--library", file, *threshold, *flags)["rows"]
    assert sum(row["status"] == "ok" for row in found["yes"]) > 10
    for known, withheld, asked in zip(found["yes"], found["no"], found["asked"], strict=True):
        assert withheld["tt_s"] is None
        assert withheld["status"] in ("uncalibrated", "too_few_points", "cannot_tell")
        assert withheld["status"] in ("uncalibrated", known["status"])
        assert asked["tt_s"] == known["tt_s"]
        assert asked["status"] == ("uncalibrated" if known["status"] == "ok" else known["status"])


def read_csv(path: Path) -> tuple[list[float], list[DamageInput]]:
    return read_readings(path, None, load=None, speed=None)


def test_v_eq_that_is_said_to_be_uncalibrated_gives_no_tt_unless_asked_to(
    tmp_path: Path, rms_map: RmsMap, map_file: Path
) -> None:
    path, found = history(tmp_path), {}
    for name, file in (("yes", map_file), ("no", uncalibrated(rms_map, tmp_path))):
        run(track_command.command, path, "--map", file, "--out", tmp_path / f"{name}.csv")
        found[name] = run(forecast_command.command, tmp_path / f"{name}.csv", "--method", "thesis")["rows"]
    asked = run(forecast_command.command, tmp_path / "no.csv", "--method", "thesis", "--uncalibrated-threshold")["rows"]
    assert "ok" in {row["status"] for row in found["yes"]}
    assert "ok" not in {row["status"] for row in (*found["no"], *asked)}
    for known, withheld, given in zip(found["yes"], found["no"], asked, strict=True):
        assert withheld["tt_s"] is None
        assert given["tt_s"] == known["tt_s"]
        if known["status"] == "ok":
            assert withheld["status"] == given["status"] == "uncalibrated"


@pytest.mark.parametrize(
    ("claims", "calibrated"),
    [("", True), ("yes", True), ("no", False), ("yes; no", False), ("a: no; b: yes", False), ("b: no", True)],
)
def test_records_say_whether_their_v_eqclaims_calibration(claims: str, calibrated: bool) -> None:
    assert claims_calibration(claims, "a") is calibrated
