"""Integers have a level only where something states what they mean; else they are refused, in every format."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import h5py
import netCDF4
import numpy as np
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

from streams.open import open_source
from streams.types.block import STANDARD_GRAVITY, Block, Rejected, to_si
from streams.types.spec import ChannelSpec, SourceSpec
from tests.support.streams_levels import COUNTS, FULL, RATE, Integers, hdf5, npy, sound


def mat73(counts: Integers) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as file:
        file.create_dataset("x", data=counts[:, None]).attrs["MATLAB_class"] = np.bytes_("int16")
    data = bytearray(stream.getvalue())
    data[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    return bytes(data)


def mat(values: NDArray[Any]) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, {"x": values})
    return stream.getvalue()


def tdms(counts: NDArray[Any], **stated: Any) -> bytes:
    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        writer.write_segment([ChannelObject("run", "x", counts, properties={"wf_increment": 1.0 / RATE, **stated})])
    return stream.getvalue()


def netcdf(counts: Integers, kind: Literal["NETCDF4", "NETCDF3_CLASSIC"] = "NETCDF3_CLASSIC", **stated: Any) -> bytes:
    file = netCDF4.Dataset("x.nc", "w", format=kind, memory=1)
    file.createDimension("n", counts.size)
    variable = file.createVariable("x", "i2", ("n",))
    variable.set_auto_maskandscale(False)
    variable.setncatts(stated)
    variable[:] = counts
    return bytes(file.close())


COUNTED: dict[str, Callable[[Integers], bytes]] = {
    "a.npy": npy,
    "a.h5": hdf5,
    "a.mat": mat,
    "a73.mat": mat73,
    "a.tdms": tdms,
    "a.nc": netcdf,
    "a4.nc": lambda counts: netcdf(counts, "NETCDF4"),
}
"""Formats whose integers are counts."""

FRACTIONS: dict[str, Callable[[Integers], bytes]] = {"a.wav": sound("WAV"), "a.flac": sound("FLAC")}
"""Formats that define a full scale."""

INTEGERS = COUNTED | FRACTIONS


def read(path: Path, range_g: float | None = None, unit: str | None = "g", **channel: Any) -> Block | Rejected:
    spec = ChannelSpec("x", column=1, unit=unit, **channel)
    source = SourceSpec("s", str(path), rate=RATE, block_s="file", channels=(spec,), range_g=range_g)
    (item,) = open_source(source)
    return item


def level(item: Block | Rejected, **channel: Any) -> NDArray[np.floating]:
    """Return the samples of a block in g, converted as the monitor does."""
    assert isinstance(item, Block), item.reason
    return to_si(item.samples[0], item.units[0], **channel)[0] / STANDARD_GRAVITY


def put(folder: Path, name: str, data: bytes, **sidecar: Any) -> Path:
    path = folder / name
    path.write_bytes(data)
    if sidecar:
        (folder / f"{name}.json").write_text(json.dumps(sidecar))
    return path


@pytest.mark.parametrize("name", INTEGERS)
@pytest.mark.parametrize(
    ("unit", "channel"), [("g", {}), ("m/s2", {}), ("V", {"sensitivity_mv_per_g": 100.0})], ids=["g", "m/s2", "V"]
)
def test_integers_without_a_scale_are_refused(name: str, unit: str, channel: dict[str, Any], tmp_path: Path) -> None:
    item = read(put(tmp_path, name, INTEGERS[name](COUNTS)), unit=unit, **channel)
    assert isinstance(item, Rejected)
    assert item.status == "wrong_unit"
    assert name in item.reason
    assert f"give [[channel]] scale, the {unit}" in item.reason
    assert ("range_g" in item.reason) == (name in FRACTIONS)


@pytest.mark.parametrize("name", INTEGERS)
def test_a_scale_states_the_level(name: str, tmp_path: Path) -> None:
    path = put(tmp_path, name, INTEGERS[name](COUNTS))
    full = 50.0 if name in FRACTIONS else 50.0 / FULL
    np.testing.assert_allclose(level(read(path, scale=full), scale=full), COUNTS * (50.0 / FULL), rtol=1e-6)
    # A scale of 1 is one, too, where it is given.
    one = level(read(path, scale=1.0))
    np.testing.assert_allclose(one, COUNTS / (FULL if name in FRACTIONS else 1), rtol=1e-6)


@pytest.mark.parametrize("name", INTEGERS)
def test_a_side_car_states_the_level(name: str, tmp_path: Path) -> None:
    full = 50.0 if name in FRACTIONS else 50.0 / FULL
    path = put(tmp_path, name, INTEGERS[name](COUNTS), scale=full)
    np.testing.assert_allclose(level(read(path)), COUNTS * (50.0 / FULL), rtol=1e-6)
    volts = {"unit": "V", "sensitivity_mv_per_g": 100.0}
    path = put(tmp_path, name, INTEGERS[name](COUNTS), scale=full / 10.0, **volts)
    np.testing.assert_allclose(level(read(path, unit=None)), COUNTS * (50.0 / FULL), rtol=1e-6)
    # How many mV a g gives does not say what a count is.
    path = put(tmp_path, name, INTEGERS[name](COUNTS), **volts)
    assert getattr(read(path, unit=None), "status", None) == "wrong_unit"


@pytest.mark.parametrize("name", FRACTIONS)
@pytest.mark.parametrize(
    ("unit", "channel"), [("g", {}), ("m/s2", {}), ("V", {"sensitivity_mv_per_g": 80.0})], ids=["g", "m/s2", "V"]
)
def test_the_range_is_full_scale_where_the_format_has_one(
    name: str, unit: str, channel: dict[str, Any], tmp_path: Path
) -> None:
    path = put(tmp_path, name, FRACTIONS[name](COUNTS))
    item = read(path, 50.0, unit, **channel)
    np.testing.assert_allclose(level(item, **channel), COUNTS * (50.0 / FULL), rtol=1e-6)
    # A scale that is given holds; the range is then that of the sensor only.
    scaled = level(read(path, 50.0, "g", scale=2.0), scale=2.0)
    np.testing.assert_allclose(scaled, COUNTS * (2.0 / FULL), rtol=1e-6)


@pytest.mark.parametrize("name", COUNTED)
def test_the_range_says_nothing_of_counts(name: str, tmp_path: Path) -> None:
    # A converter of 12 bits writes 16-bit numbers, too.
    item = read(put(tmp_path, name, COUNTED[name](COUNTS)), 50.0)
    assert getattr(item, "status", None) == "wrong_unit"


@pytest.mark.parametrize("name", INTEGERS)
def test_integers_of_unknown_unit_are_taken_as_they_are(name: str, tmp_path: Path) -> None:
    item = read(put(tmp_path, name, INTEGERS[name](COUNTS)), 50.0, "unknown")
    assert isinstance(item, Block)
    np.testing.assert_array_equal(item.samples[0], COUNTS / (FULL if name in FRACTIONS else 1))


LINEAR = {
    "NI_Number_Of_Scales": 1,
    "NI_Scaling_Status": "unscaled",
    "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 0.001,
    "NI_Scale[0]_Linear_Y_Intercept": 0.5,
    "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
}


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.tdms", tdms(COUNTS, **LINEAR)),
        ("a.h5", hdf5(COUNTS, scale_factor=0.001, add_offset=0.5)),
        ("a.h5", hdf5(COUNTS, scale=0.001, add_offset=0.5, unit="g")),
        ("a.nc", netcdf(COUNTS, scale_factor=0.001, add_offset=0.5)),
        ("a.nc", netcdf(COUNTS, "NETCDF4", scale_factor=0.001, add_offset=0.5, units="g")),
    ],
)
def test_a_scale_in_the_file_is_used(name: str, data: bytes, tmp_path: Path) -> None:
    np.testing.assert_allclose(level(read(put(tmp_path, name, data))), COUNTS * 0.001 + 0.5, rtol=1e-6)


@pytest.mark.parametrize("scale", [0.0, np.nan, np.inf])
def test_a_scale_in_the_file_that_is_none_is_not_used(scale: float, tmp_path: Path) -> None:
    item = read(put(tmp_path, "a.h5", hdf5(COUNTS, scale=scale)))
    assert getattr(item, "status", None) == "wrong_unit"


def test_a_unit_in_the_file_does_not_say_what_a_count_is(tmp_path: Path) -> None:
    item = read(put(tmp_path, "a.h5", hdf5(COUNTS, unit="g")), unit=None)
    assert getattr(item, "status", None) == "wrong_unit"


def test_floating_numbers_are_values(tmp_path: Path) -> None:
    values = COUNTS.astype(np.float32)
    for name, data in (("a.h5", hdf5(values, scale=0.001)), ("a.tdms", tdms(values)), ("a.npy", npy(values))):
        np.testing.assert_allclose(level(read(put(tmp_path, name, data))), values, rtol=1e-6)


def test_doubles_that_matlab_stores_as_integers_are_doubles(tmp_path: Path) -> None:
    data = bytearray(mat(COUNTS))
    # The class of the array, in its flags: 6 is double, 10 is int16.
    place = data.index(bytes([6, 0, 0, 0, 8, 0, 0, 0, 10])) + 8
    data[place] = 6
    item = read(put(tmp_path, "a.mat", bytes(data)))
    np.testing.assert_array_equal(level(item), level(item) * 1.0)
    assert isinstance(item, Block)
    np.testing.assert_array_equal(item.samples[0], COUNTS)
