"""Counts are unpacked by all that their file says of them, or refused: scale, offset, sign, byte order, fill."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

import spallwatch as sw
from tests.support.stated_files import GRAVITY, RATE, START, iso, noise, write_hdf5, write_mat, write_netcdf

COUNT = 2048
ROW = noise(1, COUNT)[0]
SCALE, OFFSET = 2.0**-10, -32.0
SIGNED = np.round(ROW / SCALE).astype(np.int16)
UNSIGNED = np.round((ROW - OFFSET) / SCALE).astype(np.uint16)
HEAD = {"fs": RATE, "start_utc": iso(START)}
Make = Callable[[Path], Path]


def hdf5(values: NDArray[Any], **words: Any) -> Make:
    return lambda folder: write_hdf5(folder / "x.h5", values[None], HEAD, {"unit": "g", **words})


def netcdf(values: NDArray[Any], **words: Any) -> Make:
    return lambda folder: write_netcdf(folder / "x.nc", values[None], HEAD, {"units": "g", **words})


def tdms(values: NDArray[Any], **scales: Any) -> Make:
    words: Mapping[str, Any] = {"wf_increment": 1 / RATE, "unit_string": "g", **scales}

    def write(folder: Path) -> Path:
        with TdmsWriter(folder / "x.tdms") as writer:
            writer.write_segment([ChannelObject("Vibration", "acc", values, properties=words)])
        return folder / "x.tdms"

    return write


def scales(*chain: Mapping[str, Any]) -> dict[str, Any]:
    """Properties of a chain of scales, each of the one before, the first of the stored counts."""
    found: dict[str, Any] = {"NI_Number_Of_Scales": np.int32(len(chain)), "NI_Scaling_Status": "unscaled"}
    for number, each in enumerate(chain):
        source = np.uint32(0xFFFFFFFF if number == 0 else number - 1)
        kind = each["Scale_Type"]
        found |= {f"NI_Scale[{number}]_{key}": value for key, value in each.items()}
        found[f"NI_Scale[{number}]_{kind}_Input_Source"] = source
    return found


def linear(slope: float, offset: float = 0.0) -> dict[str, Any]:
    return {"Scale_Type": "Linear", "Linear_Slope": slope, "Linear_Y_Intercept": offset}


def polynomial(*coefficients: float) -> dict[str, Any]:
    words = {f"Polynomial_Coefficients[{power}]": value for power, value in enumerate(coefficients)}
    return {"Scale_Type": "Polynomial", "Polynomial_Coefficients_Size": np.uint32(len(coefficients)), **words}


def side_car(values: NDArray[Any], **words: Any) -> Make:
    def write(folder: Path) -> Path:
        np.save(folder / "x.npy", values)
        (folder / "x.npy.json").write_text(json.dumps({"rate_hz": RATE, "unit": "g", **words}), encoding="utf-8")
        return folder / "x.npy"

    return write


PACKINGS: dict[str, Make] = {
    "hdf5 scale_factor": hdf5(SIGNED, scale_factor=SCALE),
    "hdf5 scale_factor and add_offset": hdf5(UNSIGNED, scale_factor=SCALE, add_offset=OFFSET),
    "hdf5 scale_factor in an array": hdf5(SIGNED, scale_factor=np.array([SCALE])),
    "hdf5 _Unsigned": hdf5(UNSIGNED.view(np.int16), scale_factor=SCALE, add_offset=OFFSET, _Unsigned="true"),
    "hdf5 big-endian": hdf5(SIGNED.astype(">i2"), scale_factor=SCALE),
    "hdf5 scale of floats": hdf5(SIGNED.astype(np.float32), scale_factor=SCALE),
    "netcdf scale_factor": netcdf(SIGNED, scale_factor=SCALE),
    "netcdf _Unsigned": netcdf(UNSIGNED.view(np.int16), scale_factor=SCALE, add_offset=OFFSET, _Unsigned="true"),
    "netcdf unsigned": netcdf(UNSIGNED, scale_factor=SCALE, add_offset=OFFSET),
    "netcdf scale of floats": netcdf(SIGNED.astype(np.float32), scale_factor=SCALE),
    "netcdf fill that does not occur": netcdf(SIGNED, scale_factor=SCALE, _FillValue=np.int16(-32768)),
    "tdms linear": tdms(SIGNED, **scales(linear(SCALE))),
    "tdms linear with offset": tdms(UNSIGNED, **scales(linear(SCALE, OFFSET))),
    "tdms polynomial": tdms(SIGNED, **scales(polynomial(0.0, SCALE))),
    "tdms two scales": tdms(SIGNED, **scales(linear(SCALE / 10), linear(10.0))),
    "npy with a side-car": side_car(SIGNED, scale=SCALE),
}
"""Counts of which their file says all: RMS 1 g."""
UNSAID: dict[str, Make] = {
    "hdf5 counts": hdf5(SIGNED),
    "netcdf counts": netcdf(SIGNED),
    "tdms counts": tdms(SIGNED),
    "npy counts": side_car(SIGNED),
    "mat counts": lambda folder: write_mat(folder / "x.mat", SIGNED[None], {**HEAD, "unit": "g"}),
    "wav": lambda folder: _wav(folder),
}
"""Counts of which something is not said: no level is right."""


def _wav(folder: Path) -> Path:
    soundfile.write(folder / "x.wav", ROW / 8.0, int(RATE), subtype="PCM_24")
    return folder / "x.wav"


@pytest.mark.parametrize("kind", PACKINGS)
def test_counts_are_unpacked_whole(kind: str, tmp_path: Path) -> None:
    signal = sw.read(PACKINGS[kind](tmp_path))
    assert np.std(signal.values) == pytest.approx(GRAVITY, rel=1e-3)
    assert abs(np.mean(signal.values)) < 0.01


@pytest.mark.parametrize("kind", UNSAID)
def test_counts_without_a_level_are_refused(kind: str, tmp_path: Path) -> None:
    path = UNSAID[kind](tmp_path)
    with pytest.raises(sw.SpallwatchError):
        sw.read(path)
