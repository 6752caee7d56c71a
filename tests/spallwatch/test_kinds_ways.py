"""Whichever way a recording comes in, rate, unit, level, start and channels are the same."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

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
from tests.support.ways_in import by_hand, by_init, channel_table

COUNT = 8192
"""2 s, so that a block has revolutions enough."""

Make = Callable[[Path, int, datetime], Path]


def _rows(index: int) -> np.ndarray:
    return noise(2, COUNT, seed=index + 1)


def _since(begin: datetime) -> tuple[np.ndarray, dict[str, str]]:
    return np.arange(COUNT) / RATE, {"units": f"seconds since {begin:%Y-%m-%d %H:%M:%S}"}


FORMS: dict[str, tuple[float, tuple[str, str, str], Make]] = {
    "csv of a German logger": (
        1.0,
        ('column = "Schwingung 1"', 'column = "Schwingung 2"', "m/s2"),
        lambda folder, index, begin: write_csv(
            folder / f"{index}.csv",
            _rows(index),
            [f"Abtastrate: {RATE:g} Hz", f"Beginn: {iso(begin)}", "Einheit: m/s²"],
            ("Schwingung 1", "Schwingung 2"),
            before={"Nr.": [str(i) for i in range(COUNT)]},
            separator=";",
        ),
    ),
    "csv of dates": (
        0.3 * GRAVITY,
        ("column = 2", "column = 3", "g"),
        lambda folder, index, begin: write_csv(
            folder / f"{index}.csv",
            300 * _rows(index),
            (),
            ("x [mg]", "y [mg]"),
            before={"timestamp": stamps(COUNT, begin)},
        ),
    ),
    "csv in us": (
        GRAVITY,
        ("column = 2", "column = 3", "g"),
        lambda folder, index, begin: write_csv(
            folder / f"log_{begin:%Y%m%d_%H%M%S}.csv",
            _rows(index),
            (),
            ("x (g)", "y (g)"),
            before={"Time (us)": seconds(COUNT, 1e6)},
        ),
    ),
    "hdf5": (
        GRAVITY,
        ('key = "acc_1"', 'key = "acc_2"', "g"),
        lambda folder, index, begin: write_hdf5(
            folder / f"{index}.h5", _rows(index), {"dt": 1 / RATE, "start_utc": iso(begin)}, {"units": "g"}
        ),
    ),
    "netcdf": (
        1.0,
        ('key = "acc_1"', 'key = "acc_2"', "m/s2"),
        lambda folder, index, begin: write_netcdf(
            folder / f"{index}.nc", _rows(index), None, {"units": "m s-2"}, time=_since(begin)
        ),
    ),
    "tdms beside a slow group": (
        GRAVITY,
        ('key = "Vibration/acc_1"', 'key = "Vibration/acc_2"', "g"),
        lambda folder, index, begin: write_tdms(
            folder / f"{index}.tdms",
            _rows(index),
            None,
            {
                "wf_increment": 1 / RATE,
                "unit_string": "g",
                "wf_start_time": np.datetime64(begin.replace(tzinfo=None), "us"),
            },
            Speed=("Process", np.full(20, 1488.0), {"wf_increment": 0.1, "unit_string": "rpm"}),
        ),
    ),
    "mat": (
        GRAVITY,
        ('key = "acc_1"', 'key = "acc_2"', "g"),
        lambda folder, index, begin: write_mat(
            folder / f"{index}.mat", _rows(index), {"fs": RATE, "unit": "g", "start_utc": iso(begin)}
        ),
    ),
    "lvm": (
        GRAVITY,
        ('column = "acc_1"', 'column = "acc_2"', "g"),
        lambda folder, index, begin: write_lvm(
            folder / f"{index}.lvm", _rows(index), "g", begin - timedelta(hours=1), begin
        ),
    ),
    "uff in ms": (
        1.0,
        ('key = "acc_1"', 'key = "acc_2"', "m/s2"),
        lambda folder, index, begin: write_uff(
            folder / f"{index}.uff", [(row, 1e3 / RATE, "ms", "m/s^2") for row in _rows(index)], begin
        ),
    ),
}
"""By name: level of the first channel in m/s2; channels and unit of a configuration by hand; a maker of a file."""


@pytest.mark.parametrize("form", FORMS)
def test_all_ways_agree(form: str, tmp_path: Path) -> None:
    si, (first, second, unit), make = FORMS[form]
    begins = [START + index * timedelta(minutes=10) for index in range(3)]
    (tmp_path / "data").mkdir()
    paths = [make(tmp_path / "data", index, begin) for index, begin in enumerate(begins)]
    levels = [si, 0.6 * si]

    signal = sw.read(paths[0])
    assert signal.attrs["rate_hz"] == pytest.approx(RATE, rel=1e-5)
    assert np.std(signal.values, axis=1) == pytest.approx(levels, rel=1e-4)
    if "us" not in form:
        assert signal.attrs["start_utc"] == START.isoformat()

    asked = by_init(tmp_path)
    assert asked.configuration is not None, asked.said
    written = by_hand(tmp_path, channel_table(first, unit, "a") + channel_table(second, unit, "b"))
    rate = asked.configuration["source"][0]["rate_hz"]
    assert rate == pytest.approx(RATE, rel=1e-5)
    for came in (asked, written):
        assert came.times == [each.timestamp() for each in begins], came.said
        assert not any(came.flags)
        assert [values[0] for values in came.rms.values()] == pytest.approx(levels, rel=1e-4)
    assert list(asked.rms.values()) == [pytest.approx(values, rel=1e-9) for values in written.rms.values()]
    records = sw.replay(tmp_path / "data", bearing="6205-2RS", speed_hz=24.8, block_s="file")
    assert records["rms"].values[0] == pytest.approx(levels, rel=1e-4)
    assert [
        float(each) / 1e9 for each in records["time"].values.astype("datetime64[ns]").astype(np.int64)
    ] == came.times
