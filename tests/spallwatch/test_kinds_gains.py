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


MM_S = {"4 mV/(mm/s)": 4.0, "4mV/mm/s": 4.0, "4 V/(m/s)": 4.0, "101.6 mV/(in/s)": 4.0, "0.1016 V/ips": 4.0,
        "28.8 V·s/m": 28.8, "4 mV/(mm·s⁻¹)": 4.0}  # fmt: skip


@pytest.mark.parametrize("maker", MAKERS)
@pytest.mark.parametrize("stated", MM_S)
def test_volts_of_a_sensor_of_velocity_are_read(maker: str, stated: str, tmp_path: Path) -> None:
    for unit, size in (("V", 1.0), ("mV", 1e-3)):
        found = sw.read(MAKERS[maker](tmp_path, {"fs": RATE, "Sensitivity": stated}, unit))
        assert (found.name, found.attrs["units"]) == ("velocity", "m s-1")
        assert float((found**2).mean() ** 0.5) == pytest.approx(size / MM_S[stated], rel=1e-5)
        configured = sw.read(next(tmp_path.iterdir()), unit="mm/s")
        assert configured.values == pytest.approx(found.values)


@pytest.mark.parametrize("maker", MAKERS)
def test_a_sensor_of_velocity_gives_no_acceleration(maker: str, tmp_path: Path) -> None:
    words = {"fs": RATE, "Sensitivity": "4 mV/(mm/s)"}
    path = MAKERS[maker](tmp_path, words, "V")
    ways: list[Words] = [{"unit": "g"}, {"unit": "V", "sensitivity_mv_per_g": 100.0}]
    for how in ways:
        with pytest.raises(sw.SpallwatchError, match=r"is of an acceleration.* 4 mV/\(mm/s\), of a velocity"):
            sw.read(path, **how)
    with pytest.raises(sw.SpallwatchError, match=r"250 mm/s a V by the recording, 100 by scale"):
        sw.read(path, unit="mm/s", scale=100.0)
    with pytest.raises(sw.SpallwatchError, match=r"of an acceleration and a velocity are stated|several values"):
        sw.read(MAKERS[maker](tmp_path, {**words, "Sensor sensitivity": "100 mV/g"}, "V"))
    with pytest.raises(sw.SpallwatchError, match=r"4 or 40 mV/\(mm/s\); give .*scale"):
        sw.read(MAKERS[maker](tmp_path, {**words, "Gain": "10"}, "V"))


@pytest.mark.parametrize("maker", MAKERS)
def test_volts_without_a_sensitivity_are_a_velocity_by_their_scale(maker: str, tmp_path: Path) -> None:
    found = sw.read(MAKERS[maker](tmp_path, {"fs": RATE}, "V"), unit="mm/s", scale=250.0)
    assert (found.name, float((found**2).mean() ** 0.5)) == ("velocity", pytest.approx(0.25, rel=1e-5))


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
