"""Records of replays and of published files as datasets."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime

import numpy as np
import pytest
import xarray as xr

import spallwatch as sw

RATE = 4000.0
DAY = 86400.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    np.save(folder / "one.npy", np.random.default_rng(4).standard_normal((2, 12000)).astype(np.float32))
    return folder / "one.npy"


MACHINE = {"bearing": "6205", "speed_hz": 10.0, "rate_hz": RATE, "unit": "g", "block_s": 1.0}


def test_a_replay_of_a_configuration_is_one_of_its_arguments(recording):
    by_arguments = sw.replay(recording, **MACHINE)
    tables = {
        "bearing": [{"name": "bearing", "designation": "6205"}],
        "operating": {"speed_hz": 10.0},
        "source": [{"name": "signal", "url": str(recording), "rate_hz": RATE, "block_s": 1.0}],
        "channel": [
            {"name": name, "source": "signal", "bearing": "bearing", "unit": "g"} for name in ("column_1", "column_2")
        ],
    }
    by_tables = sw.replay(config=tables)
    xr.testing.assert_equal(by_arguments.drop_attrs(), by_tables.drop_attrs())


def test_days_are_joined_and_one_band_beside_several_is_padded(recording, tmp_path):
    first = sw.replay(recording, out=tmp_path / "a", start_utc=datetime(2026, 3, 1, tzinfo=UTC), **MACHINE)
    shutil.copytree(tmp_path / "a" / "records", tmp_path / "all")
    tables = {
        "bearing": [{"name": "bearing", "designation": "6205"}],
        "operating": {"speed_hz": 10.0},
        "source": [
            {
                "name": "signal",
                "url": str(recording),
                "rate_hz": RATE,
                "block_s": 1.0,
                "start_utc": datetime(2026, 3, 2, tzinfo=UTC),
            }
        ],
        "channel": [
            {
                "name": "column_2",
                "source": "signal",
                "bearing": "bearing",
                "unit": "g",
                "band_hz": [[300, 900], [800, 1900]],
            }
        ],
    }
    second = sw.replay(config=tables, out=tmp_path / "b")
    for file in (tmp_path / "b" / "records").glob("*.nc"):
        shutil.copy(file, tmp_path / "all")
    both = sw.open_records(tmp_path / "all")
    assert both.time.dtype.kind == "M"
    assert both.sizes["time"] == 6
    assert np.all(np.diff(both.time.values) > np.timedelta64(0))
    assert both.sizes["band"] == 2
    np.testing.assert_array_equal(both.rms.values[:3], first.rms.values)
    np.testing.assert_array_equal(both.rms.sel(channel="column_2").values[3:], second.rms.values[:, 0])
    assert np.isnan(both.rms.sel(channel="column_1").values[3:]).all()
    assert set(both.stage.sel(channel="column_1").values[3:]) == {""}
    assert np.isnan(both.h_or.isel(band=1).values[:3]).all()
    chosen = sw.open_records(tmp_path / "all", variables=["rms"], channels=["column_2"])
    assert set(chosen.data_vars) == {"rms", "source", "name", "status", "reason", "sequence"}
    assert chosen.rms.attrs["units"] == "m s-2"
    np.testing.assert_array_equal(chosen.rms.values, both.rms.sel(channel=["column_2"]).values)


def test_dated_and_undated_blocks_are_not_mixed(recording, tmp_path):
    sw.replay(recording, out=tmp_path / "a", **MACHINE)
    sw.replay(recording, out=tmp_path / "b", start_utc=datetime(2026, 3, 1, tzinfo=UTC), **MACHINE)
    for file in (tmp_path / "b" / "records").glob("*.nc"):
        shutil.copy(file, tmp_path / "a" / "records")
    with pytest.raises(sw.SpallwatchError, match="dated=True"):
        sw.open_records(tmp_path / "a")
    assert sw.open_records(tmp_path / "a", dated=False).time.dtype.kind == "f"
    assert sw.open_records(tmp_path / "a", dated=True).time.dtype.kind == "M"


def test_rejected_blocks_are_there_with_their_reason(tmp_path):
    samples = np.random.default_rng(4).standard_normal(12000)
    samples[5000] = np.nan
    np.save(tmp_path / "x.npy", samples)
    found = sw.replay(tmp_path / "x.npy", **MACHINE)
    assert list(found.status.values) == ["ok", "nan", "ok"]
    assert "finite" in found.reason.values[1] or "nan" in found.reason.values[1].lower()


def test_wrong_questions_are_named(recording, tmp_path):
    with pytest.raises(sw.SpallwatchError, match="config, or path and bearing"):
        sw.replay(recording)
    with pytest.raises(sw.SpallwatchError, match="either config"):
        sw.replay(recording, config={}, bearing="6205")
    with pytest.raises(sw.SpallwatchError, match="no unit"):
        sw.replay(recording, bearing="6205", speed_hz=10.0, rate_hz=RATE)
    with pytest.raises(sw.SpallwatchError, match="no such file"):
        sw.open_records(tmp_path / "nothing")
    with pytest.raises(sw.SpallwatchError, match=r"no \.nc files"):
        sw.open_records(tmp_path)
    xr.Dataset({"x": ("time", [1.0])}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(sw.SpallwatchError, match="no health records"):
        sw.open_records(tmp_path / "other.nc")
    with pytest.raises(sw.SpallwatchError, match="rsm"):
        sw.open_records(tmp_path, variables=["rsm"])


def test_what_is_no_vibration_is_not_monitored(tmp_path):
    rng = np.random.default_rng(3)
    rows = "\n".join(f"{a:.4f};{20 + 0.001 * b:.4f}" for a, b in rng.standard_normal((8000, 2)))
    (tmp_path / "x.csv").write_text(f"Accel X [g];Temperature [°C]\n{rows}\n")
    found = sw.replay(tmp_path / "x.csv", bearing="6205", speed_hz=10.0, rate_hz=RATE, block_s=1.0)
    assert list(found.channel.values) == ["Accel_X"]
    signal = sw.read(tmp_path / "x.csv", rate_hz=RATE, channels=["Accel X [g]"])
    assert list(sw.features(signal, bearing="6205", speed_hz=10.0).channel.values) == ["Accel X [g]"]
