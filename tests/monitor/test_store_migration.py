"""A store of an earlier commit is opened, migrated, and goes on as if nothing had happened.

The store ends amid a life, in the final stage. All files of the folder are made with the baseline commit by
``python -m benchmarks.regression --keep-store tests/data/store_baseline``; the columns named under ``renewed`` in
expected.json are those after the single comb, which changed them on purpose.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.regression.observe import of_store
from models.maps.file import load_map, save_map
from tests.faults.daemons import call

KEPT = Path(__file__).parents[1] / "data" / "store_baseline"
EXACT = ("sequence", "elapsed", "x.t_fs", "x.stage", "x.edv_status", "x.tt_status", "x.quality_flags")
MAP_VERSION = 4
"""Version of the model that the hash of the kept map names."""
TOLERANCE = 1e-5
"""Relative, for values that come from transforms: what another plan or processor may change (single precision)."""


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for file in KEPT.iterdir():
        shutil.copy(file, tmp_path)
    # The values of the kept map stay; a later version of the model would refuse it.
    with monkeypatch.context() as earlier:
        earlier.setattr("models.maps.plan.MODEL_VERSION", MAP_VERSION)
        kept = load_map(tmp_path / "map.nc")
    kept.attributes["hash"] = kept.plan.hash()
    save_map(kept, tmp_path / "map.nc")
    (tmp_path / "out").mkdir()
    (tmp_path / "state.db").rename(tmp_path / "out" / "state.db")
    return tmp_path


def test_a_store_of_the_baseline_goes_on_with_the_same_onset_and_the_same_next_records(machine: Path) -> None:
    expected = json.loads((machine / "expected.json").read_text())
    replay = ("replay", str(machine / "life.npy"), "--config", str(machine / "m.toml"), "--out", str(machine / "out"))
    done = call(*replay, "--resume", "--no-report", "--json", "--quiet")
    assert done.returncode == 0, done.stderr
    channel = json.loads(done.stdout)["channels"]["x"]
    assert {key: channel[key] for key in expected["onset"]} == expected["onset"]
    found = of_store("store", machine / "out" / "state.db")
    for name, values in expected["columns"].items():
        table = name.rpartition("/")[0]
        following = found[f"store/{table}/sequence"] > expected["blocks"]
        assert_same(name, found[f"store/{name}"][following], values)


def assert_same(name: str, found: NDArray[Any], values: list[Any]) -> None:
    if found.dtype.kind != "f":
        assert found.tolist() == values, name
    else:
        tolerance = 0.0 if name.rpartition("/")[2] in EXACT else TOLERANCE
        np.testing.assert_allclose(found, np.array(values, dtype=float), rtol=tolerance, err_msg=name)
