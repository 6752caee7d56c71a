"""A row of pulses is the tacho of the shaft only where its pulses are a whole number a revolution."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.stated_files import RATE, noise, write_csv, write_hdf5, write_tdms
from tests.support.ways_in import by_init

COUNT, SPEED = 8192, 24.8
T = np.arange(COUNT) / RATE
ACC = noise(1, COUNT)
Rows = NDArray[np.float64]


def pulses(per_second: float) -> Rows:
    return (T * per_second % 1.0 < 0.3).astype(np.float64)


def as_csv(folder: Path, row: Rows, title: str) -> Path:
    rows = np.stack([ACC[0], row])
    return write_csv(folder / "x.csv", rows, [f"Sample Rate: {RATE:g} Hz"], ("acc [g]", f"{title} [-]"))


def as_hdf5(folder: Path, row: Rows, title: str) -> Path:
    return write_hdf5(folder / "x.h5", ACC, {"fs": RATE}, {"unit": "g"}, **{title: (row, {})})


def as_tdms(folder: Path, row: Rows, title: str) -> Path:
    return write_tdms(
        folder / "x.tdms", ACC, None, {"wf_increment": 1 / RATE, "unit_string": "g"}, **{title: ("Vibration", row, {})}
    )


WRITERS: dict[str, Callable[[Path, Rows, str], Path]] = {"csv": as_csv, "hdf5": as_hdf5, "tdms": as_tdms}


def operating(folder: Path, write: Callable[[Path, Rows, str], Path], row: Rows, title: str) -> dict[str, object]:
    (folder / "data").mkdir()
    write(folder / "data", row, title)
    came = by_init(folder, "data", "--load-newton", "unknown")
    assert came.configuration is not None, came.said
    return came.configuration["operating"]


@pytest.mark.parametrize("form", WRITERS)
def test_a_switch_that_toggles_is_no_tacho(form: str, tmp_path: Path) -> None:
    found = operating(tmp_path, WRITERS[form], pulses(7.14), "running")
    assert "tacho_channel" not in found
    assert found["speed_hz"] == SPEED


@pytest.mark.parametrize("form", WRITERS)
@pytest.mark.parametrize("teeth", [1, 3])
def test_regular_pulses_of_the_shaft_are(form: str, teeth: int, tmp_path: Path) -> None:
    found = operating(tmp_path, WRITERS[form], pulses(teeth * 24.4), "running")
    assert "running" in str(found["tacho_channel"])
    assert found["pulses_per_revolution"] == teeth


def test_a_tacho_that_contradicts_the_speed_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    as_csv(tmp_path / "data", pulses(7.14), "tacho")
    came = by_init(tmp_path)
    assert came.configuration is None
    assert "--pulses-per-revolution" in came.said
    assert "no whole number of those of a shaft of 24.8 Hz" in came.said


def test_an_unknown_load_is_not_that_of_a_row(tmp_path: Path) -> None:
    assert not [key for key in operating(tmp_path, as_csv, 800.0 + 0.0 * T, "Walzkraft") if key.startswith("load")]
