"""What stands beside the signals of a file: values computed of them, running numbers, facts of one column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import spallwatch as sw
from spallwatch.recordings import RecordingError
from tests.support.stated_files import GRAVITY, RATE, noise, write_csv, write_hdf5, write_tdms

COUNT = 2048
ROWS = noise(2, COUNT)
HEAD = [f"Sample Rate: {RATE:g} Hz"]
Rows = NDArray[np.float64]


def rms_of(path: Path) -> dict[str, float]:
    found = sw.read(path)
    return {
        str(name): float(np.sqrt(np.mean(row**2))) for name, row in zip(found.channel.values, found.values, strict=True)
    }


def csv_with(folder: Path, title: str, row: Rows) -> Path:
    return write_csv(folder / "x.csv", np.stack([ROWS[0], row]), [*HEAD, "Unit: m/s2"], ("acc", title))


def hdf5_with(folder: Path, title: str, row: Rows) -> Path:
    units = {"unit": "m/s2"}
    return write_hdf5(folder / "x.h5", ROWS[:1], {"fs": RATE}, units, **{title: (row, units)})


def tdms_with(folder: Path, title: str, row: Rows) -> Path:
    words = {"wf_increment": 1.0 / RATE, "unit_string": "m/s2"}
    return write_tdms(folder / "x.tdms", ROWS[:1], None, words, **{title: ("Vibration", row, words)})


FORMATS: dict[str, Callable[[Path, str, Rows], Path]] = {"csv": csv_with, "hdf5": hdf5_with, "tdms": tdms_with}


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("title", ["acc RMS", "Envelope", "acc_filtered", "Absolute acceleration"])
def test_what_is_computed_of_a_signal_is_no_channel_beside_it(form: str, title: str, tmp_path: Path) -> None:
    found = rms_of(FORMATS[form](tmp_path, title, np.abs(ROWS[1])))
    assert list(found.values()) == pytest.approx([1.0], rel=1e-4)


def test_a_filtered_signal_alone_is_one(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "x.csv", ROWS[:1], HEAD, ("acc filtered [m/s2]",))
    assert list(rms_of(path).values()) == pytest.approx([1.0], rel=1e-4)


def running_number(lost: int, first: int = 1) -> Rows:
    number = np.arange(first, first + COUNT, dtype=np.float64)
    number[COUNT // 2 :] += lost
    return number


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("title", ["Index", "sample number"])
def test_a_running_number_that_leaves_some_out_says_that_samples_are_lost(
    form: str, title: str, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError, match=r"goes from 1024 to 1525: 500 samples are lost"):
        rms_of(FORMATS[form](tmp_path, title, running_number(500)))


@pytest.mark.parametrize("form", FORMATS)
def test_a_whole_running_number_says_nothing(form: str, tmp_path: Path) -> None:
    found = rms_of(FORMATS[form](tmp_path, "Index", running_number(0, first=0)))
    assert list(found.values()) == pytest.approx([1.0], rel=1e-4)


@pytest.mark.parametrize(
    ("keys", "titles"),
    [
        (("Sensitivity AI0", "Sensitivity AI1"), ("AI0 DE (V)", "AI1 NDE (V)")),
        (("Sensitivity CH1", "Sensitivity CH2"), ("DE (V)", "NDE (V)")),
        (("Sensitivity CH0", "Sensitivity CH1"), ("DE (V)", "NDE (V)")),
        (("DE sensitivity", "NDE sensitivity"), ("DE (V)", "NDE (V)")),
        (("Empfindlichkeit Kanal 1", "Empfindlichkeit Kanal 2"), ("DE (V)", "NDE (V)")),
    ],
)
def test_a_sensitivity_of_one_column_stands_in_the_head(
    keys: tuple[str, str], titles: tuple[str, str], tmp_path: Path
) -> None:
    volts = ROWS * np.array([[0.100], [0.050]])
    head = [*HEAD, f"{keys[0]}: 100 mV/g", f"{keys[1]}: 50 mV/g"]
    found = rms_of(write_csv(tmp_path / "x.csv", volts, head, titles))
    assert list(found.values()) == pytest.approx([GRAVITY, 0.6 * GRAVITY], rel=1e-4)


def test_sensitivities_of_other_channels_are_of_none_here(tmp_path: Path) -> None:
    head = [*HEAD, "Sensitivity CH1: 100 mV/g", "Sensitivity CH2: 50 mV/g", "Sensitivity CH3: 20 mV/g"]
    path = write_csv(tmp_path / "x.csv", ROWS, head, ("DE (V)", "NDE (V)"))
    with pytest.raises(RecordingError, match="V"):
        rms_of(path)
