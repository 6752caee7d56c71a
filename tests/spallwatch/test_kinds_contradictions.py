"""Two statements of a fact contradict each other: no value is taken, in any format and at any scope."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spallwatch as sw
from tests.support.stated_files import (
    GRAVITY,
    RATE,
    START,
    iso,
    noise,
    seconds,
    stamps,
    write_csv,
    write_hdf5,
    write_lvm,
    write_mat,
    write_netcdf,
    write_tdms,
    write_uff,
)

ROWS = noise()
COUNT = ROWS.shape[1]
LATER = START + timedelta(days=2, hours=3)
G = {"unit": "g"}
Make = Callable[[Path], Path]


def csv(head: list[str], name: str = "acc [g]", **how: Any) -> Make:
    return lambda folder: write_csv(folder / "x.csv", ROWS, head, [name], **how)


def hdf5(file: dict[str, Any], channel: dict[str, Any]) -> Make:
    return lambda folder: write_hdf5(folder / "x.h5", ROWS, file, channel)


def netcdf(file: dict[str, Any], channel: dict[str, Any], **extra: Any) -> Make:
    return lambda folder: write_netcdf(folder / "x.nc", ROWS, file, channel, **extra)


def mat(file: dict[str, Any], **extra: Any) -> Make:
    return lambda folder: write_mat(folder / "x.mat", ROWS, file, **extra)


def tdms(file: dict[str, Any], **channel: Any) -> Make:
    return lambda folder: write_tdms(folder / "x.tdms", ROWS, file, {"wf_increment": 1 / RATE, **channel})


def beside(make: Make, **words: Any) -> Make:
    """A file with a side-car that states ``words``."""

    def write(folder: Path) -> Path:
        path = make(folder)
        path.with_name(path.name + ".json").write_text(json.dumps(words), encoding="utf-8")
        return path

    return write


TIME = (np.arange(COUNT) / RATE, {"units": "s"})
SINCE = (np.arange(COUNT) / RATE, {"units": f"seconds since {START:%Y-%m-%d %H:%M:%S}"})
PLAIN: dict[str, Make] = {
    "csv": csv([f"Sample Rate: {RATE:g} Hz", f"Start: {iso(START)}"]),
    "hdf5": hdf5({"fs": RATE, "start_utc": iso(START)}, G),
    "netcdf": netcdf({"sampling_rate": RATE, "start_utc": iso(START)}, {"units": "g"}),
    "mat": mat({"fs": RATE, "unit": "g", "start_utc": iso(START)}),
    "tdms": tdms({}, unit_string="g", wf_start_time=np.datetime64(START.replace(tzinfo=None), "us")),
}
"""By format: all facts once."""

RATES: dict[str, Make] = {
    "csv head": csv([f"Sample Rate: {RATE:g} Hz", "Abtastrate: 5000 Hz"]),
    "csv head and interval": csv([f"Sample Rate: {RATE:g} Hz", "Sample Interval: 0.200000 ms"]),
    "csv head and times": csv(["Sample Rate: 5000 Hz"], before={"time [s]": seconds(COUNT)}),
    "csv head and dates": csv(["Sample Rate: 5000 Hz"], before={"timestamp": stamps(COUNT)}),
    "hdf5 file": hdf5({"fs": RATE, "dt": 2e-4}, G),
    "hdf5 file and data set": hdf5({"fs": RATE}, {**G, "fs": 5000.0}),
    "netcdf file and variable": netcdf({"sampling_rate": RATE}, {"units": "g", "sampling_rate": 5000.0}),
    "netcdf attribute and coordinate": netcdf({}, {"units": "g", "sampling_rate": 5000.0}, time=TIME),
    "mat": mat({"fs": RATE, "dt": 2e-4, **G}),
    "mat and its times": mat({"fs": 5000.0, **G}, t=np.arange(COUNT)[:, None] / RATE),
    "uff": lambda folder: write_uff(folder / "x.uff", [(ROWS[0], 1 / RATE, "s", "g"), (ROWS[0], 2e-4, "s", "g")]),
    **{f"side-car of {form}": beside(make, rate_hz=5000) for form, make in PLAIN.items()},
}
UNITS: dict[str, Make] = {
    "csv head and name": csv([f"fs: {RATE:g}", "Unit: m/s2"]),
    "csv head": csv([f"fs: {RATE:g}", "Unit: m/s2", "Einheit: g"], "acc"),
    "csv row and name": csv([f"fs: {RATE:g}"], units=["m/s2"]),
    "hdf5 data set": hdf5({"fs": RATE}, {"unit": "g", "units": "m/s2"}),
    "hdf5 file and data set": hdf5({"fs": RATE, "unit": "m/s2"}, G),
    "netcdf variable": netcdf({"sampling_rate": RATE}, {"units": "g", "unit": "m/s2"}),
    "mat": mat({"fs": RATE, "unit": "g", "units": "m/s2"}),
    **{f"side-car of {form}": beside(make, unit="m/s2") for form, make in PLAIN.items()},
}
STARTS: dict[str, Make] = {
    "csv head": csv(
        [f"fs: {RATE:g}", f"Start Time: {iso(START)}", f"Date: {LATER:%Y-%m-%d}", f"Time: {LATER:%H:%M:%S}"]
    ),
    "csv head and dates": csv([f"Start Time: {iso(LATER)}"], before={"timestamp": stamps(COUNT)}),
    "hdf5 file": hdf5({"fs": RATE, "start_utc": iso(START), "start_time": iso(LATER)}, G),
    "hdf5 file and data set": hdf5({"fs": RATE, "start_utc": iso(START)}, {**G, "start_utc": iso(LATER)}),
    "netcdf attribute and coordinate": netcdf({"start_utc": iso(LATER)}, {"units": "g"}, time=SINCE),
    "mat": mat({"fs": RATE, **G, "start_utc": iso(START), "start_time": iso(LATER)}),
    **{f"side-car of {form}": beside(make, start_utc=iso(LATER)) for form, make in PLAIN.items()},
}


@pytest.mark.parametrize("form", PLAIN)
def test_what_is_stated_once_is_read(form: str, tmp_path: Path) -> None:
    signal = sw.read(PLAIN[form](tmp_path))
    assert signal.attrs["rate_hz"] == pytest.approx(RATE)
    assert signal.attrs["start_utc"] == START.isoformat()
    assert np.sqrt(np.mean(signal.values**2)) == pytest.approx(GRAVITY, rel=1e-5)


def refused(make: Make, folder: Path, *quoted: str) -> None:
    path = make(folder)
    with pytest.raises(sw.SpallwatchError) as caught:
        sw.read(path)
    said = str(caught.value)
    assert path.name in said
    for each in quoted:
        assert each in said, f"{each} is not quoted in: {said}"


@pytest.mark.parametrize("kind", RATES)
def test_rates_that_contradict_each_other(kind: str, tmp_path: Path) -> None:
    refused(RATES[kind], tmp_path, "4096", "5000")


@pytest.mark.parametrize("kind", UNITS)
def test_units_that_contradict_each_other(kind: str, tmp_path: Path) -> None:
    refused(UNITS[kind], tmp_path, "m/s2")


@pytest.mark.parametrize("kind", STARTS)
def test_starts_that_contradict_each_other(kind: str, tmp_path: Path) -> None:
    refused(STARTS[kind], tmp_path, "2025")


@pytest.mark.parametrize("head", [START - timedelta(hours=1), START - timedelta(seconds=2)])
def test_the_data_of_an_lvm_file_begin_when_their_own_head_says(head: Any, tmp_path: Path) -> None:
    begin = START + timedelta(milliseconds=375)
    signal = sw.read(write_lvm(tmp_path / "x.lvm", ROWS, "g", head, begin), unit="g")
    assert signal.attrs["start_utc"] == begin.isoformat()


@pytest.mark.parametrize("form", PLAIN)
def test_a_statement_twice_in_two_spellings_is_no_contradiction(form: str, tmp_path: Path) -> None:
    make = beside(PLAIN[form], rate_hz=RATE * (1 + 1e-5), unit="g", start_utc=iso(START))
    assert sw.read(make(tmp_path)).attrs["rate_hz"] == pytest.approx(RATE, rel=1e-4)
