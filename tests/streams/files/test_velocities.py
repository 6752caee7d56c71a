"""Sensors of velocity in files: the unit is stated where the format states units, contradictions are refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

import spallwatch as sw
from streams.link.wire import Frame, decode_frame, encode_frame
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.samples import Samples
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import RATE, csv_bytes, hdf5_bytes, netcdf_bytes, signal, tdms_bytes

MM = 1e-3
SPELLED = {"mm/s": MM, "m/s": 1.0, "in/s": 25.4 * MM, "ips": 25.4 * MM, "µm/s": 1e-3 * MM, "cm/s": 10.0 * MM}


def wav(folder: Path, unit: str) -> Path:
    """A WAV of floating numbers, its unit in a text beside it."""
    soundfile.write(folder / "x.wav", signal(1)[0], int(RATE), subtype="DOUBLE")
    (folder / "x.txt").write_text(f"Unit: {unit}\n", encoding="utf-8")
    return folder / "x.wav"


def in_file(name: str, make_bytes: Callable[..., bytes]) -> Callable[[Path, str], Path]:
    def write(folder: Path, unit: str) -> Path:
        (folder / name).write_bytes(make_bytes(signal(1), unit=unit))
        return folder / name

    return write


MAKERS: dict[str, Callable[[Path, str], Path]] = {
    "csv": in_file("x.csv", csv_bytes),
    "tdms": in_file("x.tdms", tdms_bytes),
    "hdf5": in_file("x.h5", hdf5_bytes),
    "wav": wav,
}


def one(path: Path, *channels: ChannelSpec) -> Block | Rejected:
    (item,) = open_source(SourceSpec("s", str(path), block_s="file", channels=channels))
    return item


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("unit", SPELLED)
def test_a_velocity_that_a_file_states_is_read_as_one(kind: str, unit: str, tmp_path: Path) -> None:
    found = sw.read(MAKERS[kind](tmp_path, unit))
    assert (found.name, found.attrs["units"], found.attrs["sensor_max_hz"]) == ("velocity", "m s-1", 2000.0)
    assert found.values[0] == pytest.approx(signal(1)[0] * SPELLED[unit], rel=1e-6)


@pytest.mark.parametrize("kind", MAKERS)
def test_its_block_is_in_one_unit_and_the_configuration_may_state_it_too(kind: str, tmp_path: Path) -> None:
    path = MAKERS[kind](tmp_path, "m/s")
    for block in (one(path), one(path, ChannelSpec("c", unit="mm/s"))):
        assert isinstance(block, Block)
        assert block.units == ("mm/s",)
        assert block.samples[0] == pytest.approx(signal(1)[0] * 1e3, rel=1e-6)


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize(("stated", "configured"), [("mm/s", "g"), ("m/s2", "mm/s"), ("g", "mm/s"), ("ips", "m/s2")])
def test_a_contradiction_is_refused_with_both_places(kind: str, stated: str, configured: str, tmp_path: Path) -> None:
    path = MAKERS[kind](tmp_path, stated)
    item = one(path, ChannelSpec("c", unit=configured))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_unit"
    ours = "mm/s" if stated == "ips" else stated
    assert f"the recording is in {ours}, unit = '{configured}'; write unit = \"{ours}\"" in item.reason


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("unit", ["mm", "µm", "mil"])
def test_a_displacement_is_refused_and_named(kind: str, unit: str, tmp_path: Path) -> None:
    item = one(MAKERS[kind](tmp_path, unit))
    assert isinstance(item, Rejected)
    assert unit in item.reason


def test_a_file_that_states_two_quantities_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("Sample rate: 1000 Hz\nUnit: mm/s\nUnits: g\nv\n" + "0.1\n0.3\n" * 500)
    with pytest.raises(sw.SpallwatchError, match=r"mm/s.*\bg\b"):
        sw.read(tmp_path / "x.csv")


def test_integers_of_a_velocity_need_their_own_level(tmp_path: Path) -> None:
    """The g at full scale says nothing of it."""
    soundfile.write(tmp_path / "x.wav", signal(1)[0] / 8.0, int(RATE), subtype="PCM_16")
    (tmp_path / "x.txt").write_text("Unit: mm/s\n")
    (item,) = open_source(SourceSpec("s", str(tmp_path / "x.wav"), block_s="file", range_g=50.0,
                                     channels=(ChannelSpec("c", unit="mm/s"),)))  # fmt: skip
    assert isinstance(item, Rejected)
    assert "give [[channel]] scale, the mm/s at full scale" in item.reason
    assert "range_g" not in item.reason
    scaled = one(tmp_path / "x.wav", ChannelSpec("c", unit="mm/s", scale=8.0))
    assert isinstance(scaled, Block)
    assert 8.0 * scaled.samples[0] == pytest.approx(signal(1)[0], abs=1e-3)


def test_a_velocity_beside_accelerations_is_no_sensor_of_its_own_unless_it_is_configured(tmp_path: Path) -> None:
    rows = signal(2)
    text = "".join(f"{a:.5f},{b:.5f}\n" for a, b in rows.T)
    (tmp_path / "x.csv").write_text(f"Sample rate: 25600 Hz\nacc [g],vel [mm/s]\n{text}")
    found = sw.read(tmp_path / "x.csv")
    assert (found.attrs["units"], found.attrs["left_out"]) == ("m s-2", ["vel [mm/s]"])
    block = one(tmp_path / "x.csv", ChannelSpec("v", column="vel"), ChannelSpec("a", column="acc"))
    assert isinstance(block, Block)
    assert block.units == ("mm/s", "g")
    with pytest.raises(sw.SpallwatchError, match=r"several quantities \(acc: g, vel: mm/s\)"):
        sw.read(tmp_path / "x.csv", channels=["acc", "vel"])


def test_an_analysis_file_in_si_says_by_its_type_what_it_holds(tmp_path: Path) -> None:
    (tmp_path / "x.nc").write_bytes(netcdf_bytes(signal(1), unit="m s-1"))
    assert sw.read(tmp_path / "x.nc").attrs["units"] == "m s-1"


def test_a_live_frame_states_it_and_another_quantity_is_not_taken_for_it() -> None:
    sent = Samples(np.ones((2, 10)), rate=RATE, channels=("a", "b"), units=("mm/s", "g"))
    frame = decode_frame(encode_frame(Frame(samples=sent, sequence=3)))
    assert frame.samples.units == ("mm/s", "g")
    samples = Samples(np.ones((1, 4)), units=("mm/s",), rate=100.0)
    assert replace(samples, names=("v",)).select([0]).units == ("mm/s",)
