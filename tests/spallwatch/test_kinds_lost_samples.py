"""Samples that are lost and filled are no vibration: the block is rejected, or says that it is filled."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import spallwatch as sw
from tests.support.stated_files import (
    GRAVITY,
    RATE,
    START,
    iso,
    noise,
    seconds,
    write_csv,
    write_hdf5,
    write_mat,
    write_netcdf,
    write_tdms,
    write_uff,
)
from tests.support.ways_in import by_hand, channel_table

COUNT = 4096
ROWS = noise(1, COUNT)
LOST = np.zeros(COUNT, bool)
for _begin in (400, 1500, 3000):
    LOST[_begin : _begin + 140] = True
HEAD = {"fs": RATE, "start_utc": iso(START)}
SCALE = 2.0**-12
SAID = {"filled", "gap"}


def zeros() -> NDArray[np.float64]:
    return np.where(LOST, 0.0, ROWS)


def held() -> NDArray[np.float64]:
    return ROWS[:, np.maximum.accumulate(np.where(LOST, 0, np.arange(COUNT)))]


def packets() -> NDArray[np.float64]:
    """A hundred of every 256 samples are zero."""
    return np.where(np.arange(COUNT) % 256 < 100, 0.0, ROWS)


def rare() -> NDArray[np.float64]:
    """One run of zeros of 1 % of the block."""
    return np.where((np.arange(COUNT) >= 2000) & (np.arange(COUNT) < 2041), 0.0, ROWS)


Write = Callable[[Path, NDArray[Any]], Path]
WRITERS: dict[str, tuple[str, Write]] = {
    "csv": (
        'column = "acc"',
        lambda folder, rows: write_csv(
            folder / "x.csv", rows, ["Unit: g", f"Start: {iso(START)}"], before={"time [s]": seconds(COUNT)}
        ),
    ),
    "hdf5": ('key = "acc_1"', lambda folder, rows: write_hdf5(folder / "x.h5", rows, HEAD, {"unit": "g"})),
    "netcdf": (
        'key = "acc_1"',
        lambda folder, rows: write_netcdf(folder / "x.nc", rows, {"sampling_rate": RATE}, {"units": "g"}),
    ),
    "tdms": (
        'key = "Vibration/acc_1"',
        lambda folder, rows: write_tdms(folder / "x.tdms", rows, None, {"wf_increment": 1 / RATE, "unit_string": "g"}),
    ),
    "mat": ('key = "acc_1"', lambda folder, rows: write_mat(folder / "x.mat", rows, {**HEAD, "unit": "g"})),
    "uff": (
        'key = "acc_1"',
        lambda folder, rows: write_uff(folder / "x.uff", [(rows[0], 1 / RATE, "s", "g")]),
    ),
}


def counts() -> NDArray[np.int16]:
    return np.round(ROWS / SCALE).astype(np.int16)


def with_fill(value: float, kind: type[np.generic]) -> NDArray[Any]:
    found = (counts() if issubclass(kind, np.integer) else ROWS).astype(kind)
    found[:, LOST] = value
    return found


PACKED = {"unit": "g", "units": "g", "scale_factor": SCALE}
FILLS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "hdf5 _FillValue": (
        'key = "acc_1"',
        lambda folder: write_hdf5(
            folder / "x.h5", with_fill(-32768, np.int16), HEAD, PACKED | {"_FillValue": np.int16(-32768)}
        ),
    ),
    "hdf5 missing_value": (
        'key = "acc_1"',
        lambda folder: write_hdf5(
            folder / "x.h5", with_fill(32767, np.int16), HEAD, PACKED | {"missing_value": np.int16(32767)}
        ),
    ),
    "hdf5 not a number": (
        'key = "acc_1"',
        lambda folder: write_hdf5(folder / "x.h5", with_fill(np.nan, np.float64), HEAD, {"unit": "g"}),
    ),
    "hdf5 fill of floats": (
        'key = "acc_1"',
        lambda folder: write_hdf5(
            folder / "x.h5", with_fill(-9999.0, np.float32), HEAD, {"unit": "g", "_FillValue": np.float32(-9999.0)}
        ),
    ),
    "netcdf _FillValue": (
        'key = "acc_1"',
        lambda folder: write_netcdf(
            folder / "x.nc", with_fill(-32768, np.int16), HEAD, PACKED | {"_FillValue": np.int16(-32768)}
        ),
    ),
    "netcdf missing_value": (
        'key = "acc_1"',
        lambda folder: write_netcdf(
            folder / "x.nc", with_fill(-32768, np.int16), HEAD, PACKED | {"missing_value": np.int16(-32768)}
        ),
    ),
    "netcdf valid_range": (
        'key = "acc_1"',
        lambda folder: write_netcdf(
            folder / "x.nc",
            with_fill(-32768, np.int16),
            HEAD,
            PACKED | {"valid_range": np.array([-30000, 30000], np.int16)},
        ),
    ),
    "netcdf default fill": (
        'key = "acc_1"',
        lambda folder: write_netcdf(folder / "x.nc", with_fill(-32767, np.int16), HEAD, PACKED),
    ),
    "csv NaN": (
        'column = "acc"',
        lambda folder: WRITERS["csv"][1](folder, with_fill(np.nan, np.float64)),
    ),
    "csv -9999": (
        'column = "acc"',
        lambda folder: WRITERS["csv"][1](folder, with_fill(-9999.0, np.float64)),
    ),
    "mat not a number": (
        'key = "acc_1"',
        lambda folder: WRITERS["mat"][1](folder, with_fill(np.nan, np.float64)),
    ),
    "tdms not a number": (
        'key = "Vibration/acc_1"',
        lambda folder: WRITERS["tdms"][1](folder, with_fill(np.nan, np.float64)),
    ),
}


def judged(folder: Path, place: str, write: Callable[[Path], Path]) -> tuple[float, set[str]]:
    """Return RMS (g) and flags of the block; RMS is NaN where it was rejected."""
    (folder / "data").mkdir()
    write(folder / "data")
    came = by_hand(folder, channel_table(place, "g"))
    return (came.rms["c"][0] / GRAVITY, came.flags[0]) if came.rms else (float("nan"), set())


@pytest.mark.parametrize("form", WRITERS)
def test_samples_that_are_all_there_are_said_to_be(form: str, tmp_path: Path) -> None:
    place, write = WRITERS[form]
    rms, flags = judged(tmp_path, place, lambda folder: write(folder, ROWS))
    assert rms == pytest.approx(1.0, rel=1e-4)
    assert not flags & SAID


FILLED = [(form, fill) for number, form in enumerate(WRITERS) for fill in ((zeros, packets), (held, rare))[number % 2]]
"""Each way in three formats."""


@pytest.mark.parametrize(("form", "fill"), FILLED)
def test_a_constant_in_place_of_samples(form: str, fill: Callable[[], NDArray[np.float64]], tmp_path: Path) -> None:
    place, write = WRITERS[form]
    rms, flags = judged(tmp_path, place, lambda folder: write(folder, fill()))
    assert np.isnan(rms) or flags & SAID, f"RMS {rms} g with the flags {flags}"


@pytest.mark.parametrize("kind", FILLS)
def test_a_value_that_means_no_value(kind: str, tmp_path: Path) -> None:
    rms, flags = judged(tmp_path, *FILLS[kind])
    assert np.isnan(rms) or flags & SAID, f"RMS {rms} g with the flags {flags}"


@pytest.mark.parametrize("code", [9.91e37, -9.9e37, 3.4028235e38, 1e30])
@pytest.mark.parametrize("form", WRITERS)
def test_a_number_that_no_sensor_gives_is_no_sample(form: str, code: float, tmp_path: Path) -> None:
    place, write = WRITERS[form]
    rows = np.array(ROWS)
    rows[:, 77] = code
    rms, flags = judged(tmp_path, place, lambda folder: write(folder, rows))
    assert np.isnan(rms) or flags & SAID, f"RMS {rms} g with the flags {flags}"


def test_sw_read_says_that_a_sample_is_beyond_what_a_sensor_gives(tmp_path: Path) -> None:
    row = np.array(ROWS[0], np.float64)
    np.save(tmp_path / "whole.npy", row)
    row[77] = 9.91e37
    np.save(tmp_path / "code.npy", row)
    sw.read(tmp_path / "whole.npy", rate_hz=RATE, unit="g")
    with pytest.warns(sw.LostSamplesWarning, match=r"code\.npy: .*exceeds what the sensor can give"):
        sw.read(tmp_path / "code.npy", rate_hz=RATE, unit="g")
