"""A store of an earlier commit is opened, migrated, and goes on as if nothing had happened.

The store ends amid a life, in the final stage. All files of the folder are made with the baseline commit by
``python -m benchmarks.regression --keep-store tests/data/store_baseline``; the columns named under ``renewed`` in
expected.json are those after the single comb, which changed them on purpose.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from benchmarks.regression.observe import of_store
from models.machine.rig import Calibration
from models.maps.file import load_map, save_map
from monitor.cli import spallwatch
from monitor.records.store import Store

KEPT = Path(__file__).parents[2] / "tests" / "data" / "store_baseline"
EXACT = ("sequence", "elapsed", "x.t_fs", "x.stage", "x.edv_status", "x.tt_status", "x.quality_flags")
MAP_VERSION = 4
"""Version of the model that the hash of the kept map names."""
ADDED = (
    *("v_eq_relative", "envelope_mean", "speed_unverified", "p_no_growth", "p_crossed", "rms_baseline", "raised"),
    *("v_eq_filter", "v_eq_filter_lower", "v_eq_filter_upper"),
    *("tta", "tta_lower", "tta_upper", "tta_level", "tta_level_source", "tta_status"),
    *("velocity_rms", "velocity_floor", "velocity_status"),
    *("domain", "duration", "time_uncertainty_s", "time_source"),
)
"""Values of a block that the baseline did not have."""
WITHHELD = {
    *("forecasts/status", "forecasts/tt_s"),
    *(f"blocks/x.{name}" for name in ("tt", "tt_status", "tt_coefficients", "r_squared", "edv_status")),
}
"""Columns that differ where the rig is not calibrated."""
TOLERANCE = 1e-5
"""Relative, for values that come from transforms: what another plan or processor may change (single precision)."""


@pytest.fixture(params=["declared", False], ids=["calibrated", "uncalibrated"])
def calibrated(request: pytest.FixtureRequest) -> Calibration:
    """The baseline did not ask whether the rig is calibrated."""
    return request.param


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, calibrated: Calibration) -> Path:
    for file in KEPT.iterdir():
        shutil.copy(file, tmp_path)
    # The values of the kept map stay; a later version of the model would refuse it.
    with monkeypatch.context() as earlier:
        earlier.setattr("models.maps.plan.MODEL_VERSION", MAP_VERSION)
        kept = load_map(tmp_path / "map.nc")
    plan = replace(kept.plan, rig=replace(kept.plan.rig, calibrated=calibrated))
    kept.attributes.update(parameters=plan.as_json(), hash=plan.hash())
    if calibrated:
        with (tmp_path / "m.toml").open("a") as config:
            config.write('[rig]\ncalibrated = "declared"\n')
    save_map(kept, tmp_path / "map.nc")
    (tmp_path / "out").mkdir()
    (tmp_path / "state.db").rename(tmp_path / "out" / "state.db")
    return tmp_path


def test_a_store_of_the_baseline_goes_on_with_the_same_onset_and_the_same_next_records(
    machine: Path, calibrated: Calibration
) -> None:
    expected = json.loads((machine / "expected.json").read_text())
    replay = ("replay", str(machine / "life.npy"), "--config", str(machine / "m.toml"), "--out", str(machine / "out"))
    done = CliRunner().invoke(spallwatch, [*replay, "--resume", "--no-report", "--json", "--quiet"])
    assert done.exit_code == 0, done.stderr
    said = json.loads(done.stdout)
    assert len(said["uncalibrated"]) == (0 if calibrated else 1)
    channel = said["channels"]["x"]
    assert {key: channel[key] for key in expected["onset"]} == expected["onset"]
    found = of_store("store", machine / "out" / "state.db")
    for name, values in expected["columns"].items():
        table = name.rpartition("/")[0]
        following = found[f"store/{table}/sequence"] > expected["blocks"]
        column = found[f"store/{name}"][following]
        if name == "blocks/x.number of values":
            assert np.all(column == np.array(values) + len(ADDED)) or not calibrated
        elif calibrated or name not in WITHHELD:
            assert_same(name, column, values)
    issued = found["store/forecasts/status"][found["store/forecasts/sequence"] > expected["blocks"]]
    assert set(issued.tolist()) == {"ok" if calibrated else "uncalibrated"}
    assert (channel["calibrated"], channel["edv_status"]) == (calibrated, "ok" if calibrated else "uncalibrated")
    assert (channel["tt_s"] is None) == (calibrated is False)
    first = _first_v_eq(machine / "out" / "state.db")
    assert channel["v_eq_relative"] == pytest.approx(channel["v_eq_mm2"] * 1e-6 / first, rel=TOLERANCE)


def _first_v_eq(database: Path) -> float:
    """Return the first V_eq of the store, m2: blocks before t_fs was known have none in their records."""
    with Store.open(database, read_only=True) as store:
        return float(store.load_states()["channel:s:x"]["damage"]["forecast"]["fit"]["v_first"])


def assert_same(name: str, found: NDArray[Any], values: list[Any]) -> None:
    if found.dtype.kind != "f":
        assert found.tolist() == values, name
    else:
        tolerance = 0.0 if name.rpartition("/")[2] in EXACT else TOLERANCE
        np.testing.assert_allclose(found, np.array(values, dtype=float), rtol=tolerance, err_msg=name)
