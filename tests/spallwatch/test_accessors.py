"""Records as a table, and the accessors of signals and records."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import spallwatch as sw
from monitor.words.features import FEATURES
from spallwatch.accessors import AccessorError

ROOT = Path(__file__).parents[2]
RATE = 12_000.0


def signal(seconds: float = 0.5, seed: int = 0) -> np.ndarray:
    time = np.arange(int(seconds * RATE)) / RATE
    rng = np.random.default_rng(seed)
    # A carrier of 3 kHz whose amplitude has a line at 100 Hz.
    return (1.0 + 0.5 * np.cos(2 * np.pi * 100.0 * time)) * np.cos(2 * np.pi * 3000.0 * time) + 0.01 * rng.normal(
        size=time.size
    )


@pytest.fixture(scope="module")
def dated(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Records of three blocks of two channels, of which the last one is rejected."""
    folder = tmp_path_factory.mktemp("records")
    (folder / "in").mkdir()
    for number in range(3):
        rows = np.stack([signal(seed=number), 2.0 * signal(seed=10 + number)], axis=1)
        lines = [f"{a:.6f},{b if number < 2 else float('nan'):.6f}" for a, b in rows]
        head = f"# fs={RATE:g}\n# unit=g\nde,nde\n"
        (folder / f"in/2024050{number + 1}_120000.csv").write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return sw.replay(folder / "in", bearing="6205", speed_hz=25.0, block_s="file")


def test_a_table_has_a_row_for_each_block_and_channel(dated: xr.Dataset) -> None:
    table = dated.table()
    assert isinstance(table.index, pd.DatetimeIndex)
    assert str(table.index.tz) == "UTC"
    assert list(table.index[::2].strftime("%Y-%m-%dT%H:%M")) == [f"2024-05-0{day}T12:00" for day in (1, 2, 3)]
    assert list(table["channel"]) == ["de", "nde"] * 3
    for channel in ("de", "nde"):
        rows = table[table["channel"] == channel]
        for name in ("rms", "kurtosis", "peak"):
            np.testing.assert_array_equal(rows[name], dated[name].sel(channel=channel))
        assert list(rows["stage"]) == list(dated["stage"].sel(channel=channel).values)
    assert list(table["status"][::2]) == list(dated["status"].values)


def test_columns_are_typed_and_have_units(dated: xr.Dataset) -> None:
    table = dated.table()
    units = table.attrs["units"]
    assert units["rms"] == "m s-2"
    assert units["speed"] == "Hz"
    assert set(units) == set(table.columns) & set(FEATURES)
    assert all(units[name] == (FEATURES[name].units or "1") for name in units)
    # Words repeat themselves; a feature without a value has no column.
    assert all(isinstance(table[name].dtype, pd.CategoricalDtype) for name in ("channel", "status", "stage"))
    assert "tt" not in table
    assert not {"content_hash", "name"} & set(table.columns)
    chosen = dated.table(["rms", "tt", "stage"])
    assert list(chosen.columns) == ["channel", "rms", "tt", "stage"]
    assert chosen["tt"].isna().all()


def test_a_table_is_made_by_its_words(dated: xr.Dataset) -> None:
    with pytest.raises(AccessorError, match=r"no .rmss. in these records; they have .*rms"):
        dated.table(["rmss"])
    with pytest.raises(AccessorError, match="along time and channel"):
        xr.Dataset({"rms": ("x", [1.0])}).table()


def test_undated_records_count_from_the_first_block(tmp_path: Path) -> None:
    text = "".join(f"{value:.6f}\n" for value in signal(2.0))
    (tmp_path / "a.csv").write_text(f"# fs={RATE:g}\n# unit=g\nacc\n{text}", encoding="utf-8")
    table = sw.replay(tmp_path / "a.csv", bearing="6205", speed_hz=25.0, block_s=1.0).table()
    assert list(table.index.total_seconds()) == [0.0, 1.0]


def test_a_signal_tells_its_envelope_and_the_lines_of_a_bearing() -> None:
    given = sw.to_signal(signal(), rate_hz=RATE, unit="g")
    envelope = given.bearing.envelope_spectrum((2500.0, 3500.0))
    xr.testing.assert_identical(envelope, sw.envelope_spectrum(given, (2500.0, 3500.0)))
    assert float(envelope.isel(channel=0)[1:].idxmax("frequency")) == pytest.approx(100.0, abs=2.0)
    lines = given.bearing.fault_lines("6205", speed_hz=25.0, harmonics=3)
    own = sw.fault_frequencies("6205", 25.0)
    np.testing.assert_allclose(lines.sel(part="outer"), own.bpfo * np.arange(1, 4))
    np.testing.assert_allclose(lines.sel(part="inner"), own.bpfi * np.arange(1, 4))
    np.testing.assert_allclose(lines.sel(part="ball"), 2.0 * own.bsf * np.arange(1, 4))
    np.testing.assert_allclose(lines.sel(part="cage"), own.ftf * np.arange(1, 4))
    assert lines.attrs["units"] == "Hz"
    with pytest.raises(AccessorError, match="states no speed"):
        given.bearing.fault_lines("6205")
    with pytest.raises(AccessorError, match="1 or more"):
        given.bearing.fault_lines("6205", speed_hz=25.0, harmonics=0)
    stated = given.assign_attrs(speed_hz=50.0)
    np.testing.assert_allclose(stated.bearing.fault_lines("6205", harmonics=3), 2.0 * lines)


def test_records_tell_their_lines_at_the_speed_of_each_block(dated: xr.Dataset) -> None:
    lines = dated.bearing.envelope_lines("6205")
    found = lines.isel(time=0).sel(channel="de", part="outer")
    speed = float(dated["speed"].isel(time=0).sel(channel="de"))
    np.testing.assert_allclose(found.frequency, sw.fault_frequencies("6205", speed).bpfo * np.arange(1, 6))
    np.testing.assert_array_equal(
        found.envelope_snr, dated["envelope_snr"].isel(time=0).sel(channel="de", part="outer")
    )
    with pytest.raises(AccessorError, match="no speed"):
        xr.Dataset().bearing.fault_lines("6205")


@pytest.mark.process
@pytest.mark.parametrize("order", ["import spallwatch, xarray", "import xarray, spallwatch"])
def test_accessors_are_there_in_any_order_of_imports(order: str) -> None:
    code = f"{order}\nprint(xarray.Dataset.table.__module__, xarray.DataArray.bearing.__module__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.stdout.split() == ["spallwatch.accessors"] * 2, done.stderr


@pytest.mark.process
def test_importing_alone_imports_no_array() -> None:
    code = "import sys, spallwatch\nprint({'xarray', 'numpy', 'pandas'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == "set()"
