"""Reading recordings and samples into arrays."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr

import spallwatch as sw
from streams.types.block import STANDARD_GRAVITY

RATE = 2000.0


@pytest.fixture
def samples() -> np.ndarray:
    return np.random.default_rng(5).standard_normal((2, 4000)).astype(np.float32)


@pytest.fixture
def table(tmp_path: Path, samples: np.ndarray) -> Path:
    lines = ["time (s),east (g),west (g)"]
    lines += [f"{i / RATE:.6f},{a:.7g},{b:.7g}" for i, (a, b) in enumerate(samples.T)]
    path = tmp_path / "press.csv"
    path.write_text("\n".join(lines))
    return path


def test_a_file_that_states_rate_and_unit_needs_nothing(table, samples):
    found = sw.read(table)
    assert found.dims == ("channel", "time")
    assert [str(name).split()[0] for name in found.channel.values] == ["east", "west"]
    assert found.attrs["units"] == "m s-2"
    assert found.attrs["rate_hz"] == pytest.approx(RATE)
    np.testing.assert_allclose(found.values, samples * STANDARD_GRAVITY, rtol=1e-5)
    np.testing.assert_allclose(found.time.values, np.arange(4000) / RATE)


def test_channels_are_chosen_by_name(table):
    whole = sw.read(table)
    name = str(whole.channel.values[1])
    chosen = sw.read(table, channels=[name])
    xr.testing.assert_equal(chosen.drop_attrs(), whole.sel(channel=[name]).drop_attrs())


def test_a_file_without_rate_or_unit_is_refused_and_read_with_them(tmp_path, samples):
    path = tmp_path / "bare.npy"
    np.save(path, samples)
    with pytest.raises(sw.SpallwatchError, match=r"rate_hz"):
        sw.read(path, unit="g")
    with pytest.raises(sw.SpallwatchError, match=r"unit"):
        sw.read(path, rate_hz=RATE)
    found = sw.read(path, rate_hz=RATE, unit="m/s2")
    np.testing.assert_array_equal(found.values, samples)


def test_volts_are_scaled_by_the_sensitivity(tmp_path, samples):
    path = tmp_path / "volts.npy"
    np.save(path, samples)
    found = sw.read(path, rate_hz=RATE, unit="V", sensitivity_mv_per_g=100.0)
    np.testing.assert_allclose(found.values, samples * 10.0 * STANDARD_GRAVITY, rtol=1e-6)
    with pytest.raises(sw.SpallwatchError, match="sensitivity_mv_per_g"):
        sw.read(path, rate_hz=RATE, unit="V")


def test_blocks_join_to_the_file(table):
    parts = list(sw.blocks(table, block_s=0.5))
    assert [part.attrs["sequence"] for part in parts] == [1, 2, 3, 4]
    assert [part.attrs["elapsed_s"] for part in parts] == pytest.approx([0.0, 0.5, 1.0, 1.5])
    np.testing.assert_array_equal(np.concatenate([part.values for part in parts], axis=1), sw.read(table).values)


def test_a_block_that_cannot_be_read_is_raised_or_skipped(tmp_path, table):
    table.rename(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("time (s),east (g),west (g)\n0,1,nonsense\n")
    with pytest.raises(sw.SpallwatchError, match=r"b\.csv"):
        list(sw.blocks(tmp_path, block_s="file"))
    assert len(list(sw.blocks(tmp_path, block_s="file", skip_rejected=True))) == 1


def test_several_files_are_not_one(tmp_path, samples):
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, samples + len(name) * (name == "b.npy"))
    with pytest.raises(sw.SpallwatchError, match="several files"):
        sw.read(tmp_path, rate_hz=RATE, unit="g")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"rate_hz": 0.0, "unit": "g"}, "rate_hz"),
        ({"rate_hz": RATE, "unit": "mm"}, "unit"),
        ({"rate_hz": RATE, "unit": "g", "channels": ["one"]}, "2 names"),
    ],
)
def test_wrong_arguments_of_plain_samples_are_named(samples, wrong, message):
    with pytest.raises(sw.SpallwatchError, match=message):
        sw.to_signal(samples, **wrong)


@pytest.mark.parametrize("shape", [(), (2, 3, 4), (1,)])
def test_samples_of_another_shape_are_refused(shape):
    with pytest.raises(sw.SpallwatchError, match="shape"):
        sw.to_signal(np.zeros(shape), rate_hz=RATE, unit="g")


def test_an_unknown_argument_and_a_missing_file_are_named(table, tmp_path):
    with pytest.raises(TypeError, match="speed_rpm"):
        sw.read(table, speed_rpm=1500)  # pyright: ignore[reportCallIssue]
    with pytest.raises(sw.SpallwatchError, match=r"nothing\.csv"):
        sw.read(tmp_path / "nothing.csv")


def test_lost_samples_are_said_to_be_lost(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).standard_normal(4096)
    filled = noise.copy()
    for begin in range(0, 4096, 256):
        filled[begin : begin + 100] = 0.0
    np.save(tmp_path / "a.npy", filled)
    with pytest.warns(
        sw.LostSamplesWarning, match=r"a\.npy: column_1: 1600 of 4096 samples are filled with a constant"
    ):
        sw.read(tmp_path / "a.npy", unit="g", rate_hz=4096.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        item = file.create_dataset("acc", data=np.round(1000.0 * noise).astype(np.int16))
        item[100:300] = -32768
        item.attrs.update({"scale_factor": 1e-3, "_FillValue": np.int16(-32768), "unit": "g", "fs": 4096.0})
    with pytest.warns(sw.LostSamplesWarning, match=r"a\.h5: acc: 200 of 4096 samples are missing or not finite"):
        found = sw.read(tmp_path / "a.h5")
    assert int(np.isnan(found).sum()) == 200


def test_a_name_that_contradicts_the_header_is_warned_of(tmp_path: Path) -> None:
    rows = "\n".join(f"{0.01 * (i % 7)}" for i in range(5000))
    text = f"Start: 2024-05-01T12:00:00Z\nfs: 1000\nacc [g]\n{rows}\n"
    for name, is_doubted in (
        ("x_20240501_120000.csv", False),
        ("x_20240501_140004.csv", False),
        ("x_20240502_120000.csv", True),
        ("x_20230501_120000.csv", True),
    ):
        (tmp_path / name).write_text(text)
        if is_doubted:
            with pytest.warns(
                sw.DoubtedTimeWarning, match=f"{name}: its header states 2024-05-01T12:00:00Z, its name 202"
            ):
                found = sw.read(tmp_path / name)
        else:
            found = sw.read(tmp_path / name)
        assert found.attrs["time_source"] == "header"


def test_what_is_done_to_a_block_leaves_the_next_as_it_is(tmp_path, samples):
    for number in range(3):
        np.save(tmp_path / f"b{number}.npy", samples[:, : 2000 if number == 2 else 4000] * (number + 1))
    blocks = sw.blocks(tmp_path, block_s="file", rate_hz=RATE, unit="g")
    first = next(blocks)
    first.attrs["rate_hz"], first.name = 1.0, "other"
    first.time.attrs["units"] = "h"
    first.coords["side"] = ("channel", ["left", "right"])
    first.coords["time"] = first.time.values * 2.0
    first.values[:] = 0.0
    second, third = blocks
    assert (second.attrs["rate_hz"], second.name, second.time.attrs["units"]) == (RATE, "acceleration", "s")
    assert set(second.coords) == {"channel", "time"}
    np.testing.assert_array_equal(second.time, np.arange(4000) / RATE)
    np.testing.assert_allclose(second.values, 2.0 * samples * STANDARD_GRAVITY, rtol=1e-5)
    np.testing.assert_array_equal(third.time, np.arange(2000) / RATE)
    assert list(sw.to_signal(samples, rate_hz=2.0 * RATE, unit="m/s2", channels=("a", "b")).channel.values) == [
        "a",
        "b",
    ]
    assert sw.to_signal(samples, rate_hz=2.0 * RATE, unit="m/s2").time[1] == 0.5 / RATE
