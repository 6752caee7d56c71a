"""Files that are named as those of a data set: its rate, unit and speed hold only where nothing in the file differs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner

import spallwatch as sw
from monitor.cli import spallwatch
from tests.support.stated_files import GRAVITY, noise

COUNT = 20480


def ims(folder: Path, name: str, columns: int = 4, count: int = COUNT, seed: int = 5) -> Path:
    rows = noise(columns, count, seed)
    path = folder / name
    path.write_text("\n".join("\t".join(f"{value:.5f}" for value in line) for line in rows.T) + "\n", encoding="ascii")
    return path


def pronostia(folder: Path, number: int, step: float = 39.0625, *, clock: bool = True, head: str = "") -> Path:
    rows = noise(2, 2560, seed=number)
    times = [f"8,15,{number},{k * step % 1e6:.6g}" for k in range(2560)]
    others = [f"{value:.4f},{-value:.4f},0.25,{value:.4f}" for value in rows[0]]
    path = folder / f"acc_{number:05d}.csv"
    lines = [f"{first},{a:.4f},{b:.4f}" for first, a, b in zip(times if clock else others, *rows, strict=True)]
    path.write_text(head + "\n".join(lines) + "\n", encoding="ascii")
    return path


def cwru(folder: Path, number: int, **stated: Any) -> Path:
    rows = noise(2, 12000)
    path = folder / f"{number}.mat"
    named = {f"X{number}_DE_time": rows[0][:, None], f"X{number}_FE_time": rows[1][:, None], f"X{number}RPM": 1797.0}
    scipy.io.savemat(path, {**named, **stated})
    return path


def test_names_of_ims_with_another_date_are_those_of_any_logger(tmp_path: Path) -> None:
    for minute in (15, 25, 35):
        ims(tmp_path, f"2025.03.11.08.{minute}.00", seed=minute)
    (tmp_path / "Readme.txt").write_text("4 accelerometers, m/s2, 20480 Hz\n", encoding="ascii")
    with pytest.raises(sw.SpallwatchError, match="rate_hz is missing"):
        sw.read(tmp_path / "2025.03.11.08.15.00")
    with pytest.raises(sw.SpallwatchError, match="rate_hz is missing"):
        list(sw.blocks(tmp_path))
    blocks = list(sw.blocks(tmp_path, rate_hz=20480, unit="m/s2", block_s="file"))
    assert [block.attrs["start_utc"] for block in blocks] == [f"2025-03-11T08:{m}:00+00:00" for m in (15, 25, 35)]
    for block in blocks:
        assert np.sqrt(np.mean(block.values**2, axis=-1)) == pytest.approx([1.0, 0.6, 0.36, 0.216], rel=1e-3)


def test_ims_is_known_by_name_date_columns_and_count(tmp_path: Path) -> None:
    read = sw.read(ims(tmp_path, "2004.02.12.10.32.39"))
    assert read.attrs["rate_hz"] == 20000.0
    assert float(np.sqrt((read**2).mean("time"))[0]) == pytest.approx(GRAVITY, rel=1e-3)
    for name, words in (("2004.02.13.10.32.39", {"columns": 3}), ("2004.02.14.10.32.39", {"count": COUNT + 1})):
        with pytest.raises(sw.SpallwatchError, match="wrong_shape"):
            sw.read(ims(tmp_path, name, **words))
    assert sw.read(ims(tmp_path, "2025.03.11.08.15.00"), format="ims").attrs["rate_hz"] == 20000.0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ({"rate_hz": 20480}, r"20480 Hz, ims has 20000 Hz by its name"),
        ({"unit": "m/s2"}, r"the file states m/s2, ims is in g"),
    ],
)
def test_a_side_car_that_contradicts_a_data_set_is_refused(
    words: dict[str, Any], expected: str, tmp_path: Path
) -> None:
    path = ims(tmp_path, "2004.02.12.10.32.39")
    path.with_name(path.name + ".json").write_text(json.dumps(words), encoding="utf-8")
    with pytest.raises(sw.SpallwatchError, match=expected):
        sw.read(path)


def test_the_clock_of_pronostia_is_a_statement(tmp_path: Path) -> None:
    assert sw.read(pronostia(tmp_path, 1)).attrs["rate_hz"] == 25600.0
    with pytest.raises(sw.SpallwatchError, match=r"columns 1 to 4 are those of 12800 Hz, pronostia has 25600 Hz"):
        sw.read(pronostia(tmp_path, 2, step=78.125))
    with pytest.raises(sw.SpallwatchError, match="columns 1 to 4 are no time"):
        sw.read(pronostia(tmp_path, 3, clock=False))


def test_a_head_or_another_number_of_columns_is_no_pronostia(tmp_path: Path) -> None:
    path = tmp_path / "acc_00001.csv"
    lines = [f"{a:.5f},{b:.5f}" for a, b in noise(2, 2560).T]
    path.write_text("Sample Rate: 12800 Hz\nx [g],y [g]\n" + "\n".join(lines) + "\n", encoding="ascii")
    assert sw.read(path).attrs["rate_hz"] == 12800.0


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({"fs": 25600}, r"fs '25600' is 25600 Hz, cwru has 12000 Hz by its name"),
        ({"fs": 25.6}, r"fs '25.6' is 25.6 or 25600 Hz, cwru has 12000 Hz"),
        ({"X130_DE_unit": "m/s^2"}, "the file states m/s2, cwru is in g"),
        ({"unit": "m/s^2"}, "the file states m/s2, cwru is in g"),
        ({"X130RPM": 2950.0}, "X130RPM is 2950, cwru has 1700 to 1810 rpm"),
    ],
)
def test_what_a_file_named_as_of_cwru_states_is_compared(stated: dict[str, Any], expected: str, tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match=expected):
        sw.read(cwru(tmp_path, 130, **stated))
    assert sw.read(cwru(tmp_path, 131)).attrs["rate_hz"] == 12000.0
    assert sw.read(cwru(tmp_path, 132, fs=12.0, unit="g")).attrs["rate_hz"] == 12000.0


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (lambda folder: ims(folder, "2004.02.12.10.32.39"), "taken for ims by names and content (YYYY.MM.DD"),
        (lambda folder: pronostia(folder, 1), "taken for pronostia by names and content (acc_NNNNN.csv); g, 25600 Hz"),
        (lambda folder: cwru(folder, 130), "taken for cwru by names and content (NNN.mat with XNNN_DE_time); g, 12000"),
        (lambda folder: ims(folder, "2025.03.11.08.15.00"), ""),
    ],
)
def test_what_is_believed_by_names_is_said(write: Callable[[Path], Path], said: str, tmp_path: Path) -> None:
    folder = tmp_path / "17"
    folder.mkdir()
    write(folder)
    words = ["init", str(folder), "--bearing", "6205", "--speed-hz", "29", "--yes", "--out", str(tmp_path / "m.toml")]
    found = CliRunner().invoke(spallwatch, [*words, "--rate-hz", "20480", "--unit", "g"] if not said else words)
    assert (said or "of csv") in found.output
    assert ("taken for" in found.output) == bool(said)
