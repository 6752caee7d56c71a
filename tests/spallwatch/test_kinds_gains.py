"""An amplifier beside a sensitivity, a factor beside numbers: asked by their two readings, in any format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import spallwatch as sw
from tests.support.stated_files import GRAVITY, RATE, noise, write_csv, write_hdf5, write_mat, write_tdms

ROWS = noise()
Words = dict[str, Any]


def csv(folder: Path, words: Words, unit: str) -> Path:
    return write_csv(folder / "x.csv", ROWS, [f"{key}: {value}" for key, value in words.items()], [f"acc [{unit}]"])


def hdf5(folder: Path, words: Words, unit: str) -> Path:
    return write_hdf5(folder / "x.h5", ROWS, words, {"unit": unit})


def mat(folder: Path, words: Words, unit: str) -> Path:
    return write_mat(folder / "x.mat", ROWS, {key.replace(" ", "_"): value for key, value in words.items()}, unit=unit)


def tdms(folder: Path, words: Words, unit: str) -> Path:
    return write_tdms(folder / "x.tdms", ROWS, {}, {**words, "unit_string": unit, "wf_increment": 1 / RATE})


MAKERS: dict[str, Callable[[Path, Words, str], Path]] = {"csv": csv, "hdf5": hdf5, "mat": mat, "tdms": tdms}
LEVEL = {"fs": RATE, "Sensitivity": "100 mV/g"}


def rms(path: Path, **how: Any) -> float:
    return float((sw.read(path, **how) ** 2).mean() ** 0.5)


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize(
    ("gain", "both"),
    [
        ({"Gain": "10"}, "1000"),
        ({"Gain": 10.0}, "1000"),
        ({"Gain": "20 dB"}, "1000"),
        ({"gain db": "40"}, "10000"),
        ({"Amplification": "x10"}, "1000"),
        ({"Probe": "10x"}, "10"),
        ({"Attenuation": "20 dB"}, "10"),
    ],
)
def test_a_gain_beside_a_sensitivity_is_asked(maker: str, gain: Words, both: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {**LEVEL, **gain}, "V")
    with pytest.raises(sw.SpallwatchError, match=rf"in V; .*100 or {both} mV/g"):
        sw.read(path)
    assert rms(path, disregard=list(gain)) == pytest.approx(GRAVITY * 10.0, rel=1e-6)


@pytest.mark.parametrize("maker", MAKERS)
def test_a_probe_may_have_a_name(maker: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {**LEVEL, "Probe": "PCB 352C33"}, "V")
    assert rms(path) == pytest.approx(GRAVITY * 10.0, rel=1e-6)


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("gain", ["1", "0 dB", "x1", "unity", "off"])
def test_no_gain_changes_nothing(maker: str, gain: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {**LEVEL, "Gain": gain}, "V")
    assert rms(path) == pytest.approx(GRAVITY * 10.0, rel=1e-6)


@pytest.mark.parametrize("maker", MAKERS)
def test_a_gain_beside_numbers_in_g_changes_nothing(maker: str, tmp_path: Path) -> None:
    assert rms(MAKERS[maker](tmp_path, {**LEVEL, "Gain": "10"}, "g")) == pytest.approx(GRAVITY, rel=1e-6)


@pytest.mark.parametrize("maker", MAKERS)
def test_a_factor_beside_numbers_in_g_is_asked(maker: str, tmp_path: Path) -> None:
    path = MAKERS[maker](tmp_path, {"fs": RATE, "Y multiplier": 0.001}, "g")
    with pytest.raises(sw.SpallwatchError, match=r"ymultiplier|Y multiplier|Y_multiplier"):
        sw.read(path)
    assert rms(path, disregard=["Y multiplier"]) == pytest.approx(GRAVITY, rel=1e-6)
    path = MAKERS[maker](tmp_path, {"fs": RATE, "Y multiplier": 1}, "g")
    assert rms(path) == pytest.approx(GRAVITY, rel=1e-6)


def test_a_gain_in_the_head_counts_beside_a_sensitivity_of_a_column(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "x.csv", ROWS, [f"fs: {RATE}", "Sensitivity: 100 mV/g", "Gain: 10"], ["acc [mV]"])
    with pytest.raises(sw.SpallwatchError, match="100 or 1000 mV/g"):
        sw.read(path)
