"""What is vibration and in which unit: times, counters and other quantities are none, sensors stay apart."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spallwatch as sw
from tests.support.stated_files import (
    GRAVITY,
    RATE,
    START,
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
from tests.support.ways_in import by_init

ROWS = noise(2)
COUNT = ROWS.shape[1]
EPOCH = START.timestamp()
INDEX = [str(i) for i in range(COUNT)]
G = {"unit": "g"}
HEAD = [f"Sample Rate: {RATE:g} Hz"]
NAMES = ("DE [g]", "NDE [g]")
Make = Callable[[Path], Path]


def csv(before: dict[str, Sequence[str]], head: Sequence[str] = (), names: Sequence[str] = NAMES, **how: Any) -> Make:
    return lambda folder: write_csv(folder / "x.csv", ROWS, head, names, before=before, **how)


def epochs(factor: float, digits: int = 3) -> list[str]:
    return [f"{factor * (EPOCH + i / RATE):.{digits}f}" for i in range(COUNT)]


T = np.arange(COUNT) / RATE
NO_VIBRATION: dict[str, Make] = {
    **{
        f"csv {name}": csv({name: seconds(COUNT)})
        for name in ("Time (s)", "Elapsed_time[s]", "Zeit [s]", "Temps (s)", "t")
    },
    **{f"csv {name}": csv({name: seconds(COUNT, 1e3)}) for name in ("Time (ms)", "time_ms", "Zeit in ms", "t [ms]")},
    **{f"csv {name}": csv({name: seconds(COUNT, 1e6)}) for name in ("Time (us)", "t_us", "Time [µs]")},
    "csv epoch_ms": csv({"epoch_ms": epochs(1e3)}),
    "csv time in ms since 1970": csv({"time": epochs(1e3)}),
    "csv unix_time": csv({"unix_time": epochs(1.0, 6)}),
    "csv timestamp": csv({"timestamp": stamps(COUNT)}),
    **{f"csv {name}": csv({name: INDEX}, HEAD) for name in ("Index", "Nr.", "Sample", "No.", "N°")},
    "csv a row of units": csv({"Zeit": seconds(COUNT, 1e3)}, names=("DE", "NDE"), units=("ms", "g", "g")),
    "hdf5 time": lambda folder: write_hdf5(folder / "x.h5", ROWS, {"fs": RATE}, G, time=(T, {"unit": "s"})),
    "hdf5 index": lambda folder: write_hdf5(folder / "x.h5", ROWS, {"fs": RATE}, G, index=(np.arange(COUNT), {})),
    "hdf5 temperature": lambda folder: write_hdf5(
        folder / "x.h5", ROWS, {"fs": RATE}, G, temperature=(np.full(COUNT, 48.0) + T / 100, {"unit": "degC"})
    ),
    "mat t": lambda folder: write_mat(folder / "x.mat", ROWS, {"fs": RATE, **G}, t=T[:, None]),
    "mat temperature": lambda folder: write_mat(
        folder / "x.mat", ROWS, {"fs": RATE, **G}, temperature=48.0 + T[:, None] / 100
    ),
    "netcdf time": lambda folder: write_netcdf(folder / "x.nc", ROWS, None, {"units": "g"}, time=(T, {"units": "s"})),
    "netcdf temperature": lambda folder: write_netcdf(
        folder / "x.nc", ROWS, {"sampling_rate": RATE}, {"units": "g"}, temperature=(48.0 + T / 100, {"units": "degC"})
    ),
    "tdms slow group": lambda folder: write_tdms(
        folder / "x.tdms",
        ROWS,
        None,
        {"wf_increment": 1 / RATE, "unit_string": "g"},
        Speed=("Process", np.full(10, 1488.0), {"wf_increment": 0.1, "unit_string": "rpm"}),
    ),
}
"""Two channels of vibration in g at RATE, and something that is none."""

UNITS: dict[str, tuple[float, Make]] = {
    f"csv {unit} {place}": (si, csv({"Time (s)": seconds(COUNT)}, head, names, **how))
    for unit, si in {"g": GRAVITY, "mg": GRAVITY / 1e3, "m/s2": 1.0, "m/s²": 1.0, "m/s^2": 1.0, "mm/s2": 1e-3}.items()
    for place, head, names, how in (
        ("in brackets", (), (f"DE [{unit}]", f"NDE [{unit}]"), {}),
        ("in parentheses", (), (f"DE ({unit})", f"NDE ({unit})"), {}),
        ("in a row", (), ("DE", "NDE"), {"units": ("s", unit, unit)}),
        ("above", (f"Unit: {unit}",), ("DE", "NDE"), {}),
        ("above, in German", (f"Einheit: {unit}",), ("DE", "NDE"), {}),
    )
}
UNITS |= {
    f"{form} {unit}": (si, make)
    for unit, si in {"g": GRAVITY, "mg": GRAVITY / 1e3, "m/s2": 1.0, "m/s^2": 1.0}.items()
    for form, make in {
        "lvm": lambda folder, unit=unit: write_lvm(folder / "x.lvm", ROWS, unit, START, START),
        "uff": lambda folder, unit=unit: write_uff(folder / "x.uff", [(row, 1 / RATE, "s", unit) for row in ROWS]),
        "uff in ms": lambda folder, unit=unit: write_uff(
            folder / "x.uff", [(row, 1e3 / RATE, "ms", unit) for row in ROWS]
        ),
        "hdf5 units": lambda folder, unit=unit: write_hdf5(folder / "x.h5", ROWS, {"fs": RATE}, {"units": unit}),
        "tdms": lambda folder, unit=unit: write_tdms(
            folder / "x.tdms", ROWS, None, {"wf_increment": 1 / RATE, "unit_string": unit}
        ),
    }.items()
}


def levels(signal: Any) -> list[float]:
    return np.sqrt(np.mean((signal.values - signal.values.mean(axis=1, keepdims=True)) ** 2, axis=1)).tolist()


@pytest.mark.parametrize("kind", NO_VIBRATION)
def test_what_is_no_vibration_is_no_channel(kind: str, tmp_path: Path) -> None:
    signal = sw.read(NO_VIBRATION[kind](tmp_path))
    assert signal.sizes["channel"] == 2
    assert signal.attrs["rate_hz"] == pytest.approx(RATE, rel=1e-4)
    assert levels(signal) == pytest.approx([GRAVITY, 0.6 * GRAVITY], rel=1e-4)


@pytest.mark.parametrize("kind", UNITS)
def test_a_unit_that_is_stated_is_read(kind: str, tmp_path: Path) -> None:
    si, make = UNITS[kind]
    signal = sw.read(make(tmp_path))
    assert levels(signal) == pytest.approx([si, 0.6 * si], rel=1e-4)
    assert signal.attrs["rate_hz"] == pytest.approx(RATE, rel=1e-4)


@pytest.mark.parametrize("unit", ["mm"])
def test_a_column_of_another_quantity_is_no_acceleration(unit: str, tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match=unit):
        sw.read(csv({"Time (s)": seconds(COUNT)}, names=(f"DE [{unit}]", f"NDE [{unit}]"))(tmp_path))


@pytest.mark.parametrize(
    "place", ["{stem}_ch{number}", "ch{number}/{stem}", "{stem}_ch{number}.csv.gz", "sensor{number}/{stem}"]
)
def test_two_sensors_in_files_of_their_own_are_no_single_channel(place: str, tmp_path: Path) -> None:
    for stem in ("20251104_081500", "20251104_082500", "20251104_083500"):
        for number, row in enumerate(noise(2, seed=int(stem[-4:])), start=1):
            path = tmp_path / "data" / (place.format(stem=stem, number=number).removesuffix(".csv.gz") + ".csv")
            path.parent.mkdir(parents=True, exist_ok=True)
            write_csv(path, row[None], HEAD, ["accel [g]"], before={"Index": INDEX})
            if place.endswith(".gz"):
                path.with_name(path.name + ".gz").write_bytes(gzip.compress(path.read_bytes()))
                path.unlink()
    came = by_init(tmp_path, "data")
    if came.configuration is None:
        assert "channel" in came.said
        return
    assert len(came.configuration["channel"]) == 2
    for name in came.rms:
        values = [value for value in came.rms[name] if np.isfinite(value)]
        assert values == pytest.approx([values[0]] * 3, rel=1e-6), f"{name} alternates between sensors"
