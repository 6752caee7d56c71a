"""Stored numbers become values as the conventions of their format say; missing samples are NaN."""

from __future__ import annotations

import io
import struct
from tempfile import NamedTemporaryFile
from typing import Any, Literal

import h5py
import netCDF4
import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from nptdms import TdmsFile
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from streams.files.formats.hdf5 import read_hdf5
from streams.files.formats.mat import read_mat
from streams.files.formats.netcdf import read_netcdf
from streams.files.formats.tdms import read_tdms
from streams.files.packing import unpacked
from streams.files.statements import STORED
from streams.types.samples import COUNTS, DIGITAL, SCALED, VALUES, ReaderError, Samples
from tests.support.streams_levels import hdf5

Format = Literal["NETCDF3_CLASSIC", "NETCDF4"]


def netcdf(stored: NDArray[Any], kind: Format, fill: Any = None, **stated: Any) -> bytes:
    file = netCDF4.Dataset("x.nc", "w", format=kind, memory=1)
    file.createDimension("n", stored.size)
    variable = file.createVariable("x", stored.dtype, ("n",), fill_value=fill)
    variable.set_auto_maskandscale(False)
    variable.setncatts(stated)
    variable[:] = stored
    return bytes(file.close())


def by_library(data: bytes) -> NDArray[np.float64]:
    # Small classic files cannot be opened in memory.
    with NamedTemporaryFile(suffix=".nc") as held:
        held.write(data)
        held.flush()
        return of_path(held.name)


def of_path(path: str) -> NDArray[np.float64]:
    with netCDF4.Dataset(path) as file:
        return np.ma.filled(np.ma.asarray(file["x"][:]).astype(np.float64), np.nan)


@st.composite
def packed_variables(draw: st.DrawFn) -> tuple[NDArray[Any], Format, dict[str, Any]]:
    formats: tuple[Format, ...] = ("NETCDF3_CLASSIC", "NETCDF4")
    kind = draw(st.sampled_from(formats))
    types = ["i1", "i2", "i4", "f4", "f8"] + ["u1", "u2", "u4", "i8", "u8"] * (kind == "NETCDF4")
    dtype = np.dtype(draw(st.sampled_from(types)))
    if dtype.kind == "f":
        numbers = st.floats(-1000.0, 1000.0, width=32)
    else:
        low, high = int(np.iinfo(dtype).min), int(np.iinfo(dtype).max)
        numbers = st.integers(low, high) | st.integers(max(low, -3), min(high, 3))
    one = numbers.map(dtype.type)
    stored = np.array(draw(st.lists(one, min_size=2, max_size=40)), dtype)
    chosen = st.sampled_from(list(stored)) | one
    stated: dict[str, Any] = {}
    # Without one, the library masks the default of bytes, which by the User Guide have none.
    if dtype.itemsize == 1 or draw(st.booleans()):
        stated["fill"] = draw(chosen)
    if draw(st.booleans()):
        stated["missing_value"] = np.array(draw(st.lists(chosen, min_size=1, max_size=3)), dtype)
    if draw(st.booleans()):
        stated["valid_range"] = np.sort(np.array([draw(chosen), draw(chosen)], dtype))
    else:
        stated |= {key: draw(chosen) for key in ("valid_min", "valid_max") if draw(st.booleans())}
    if draw(st.booleans()):
        stated["scale_factor"] = draw(st.floats(1e-6, 1e3))
    if draw(st.booleans()):
        stated["add_offset"] = draw(st.floats(-1e3, 1e3))
    if dtype.kind == "i" and draw(st.booleans()):
        stated["_Unsigned"] = draw(st.sampled_from(["true", "True"]))
    return stored, kind, stated


@given(packed_variables())
@settings(deadline=None)
def test_netcdf_is_unpacked_as_its_library_does(made: tuple[NDArray[Any], Format, dict[str, Any]]) -> None:
    stored, kind, stated = made
    data = netcdf(stored, kind, **stated)
    found = read_netcdf(data, "x.nc")
    # Fewer than 9 digits may be left of numbers of 8 bytes, of which float64 holds 16.
    np.testing.assert_array_equal(found.values[0], by_library(data).astype(found.values.dtype))


@given(packed_variables())
@settings(deadline=None)
def test_hdf5_is_unpacked_as_xarray_does(made: tuple[NDArray[Any], Format, dict[str, Any]]) -> None:
    stored, _, stated = made
    # xarray does not apply limits, nor a list of missing values, and compares integers of 8 bytes as floats.
    stored = stored.astype("i4") if stored.dtype.itemsize == 8 and stored.dtype.kind != "f" else stored
    stated = {
        key: value.astype("i4") if key == "fill" and stored.dtype == "i4" else value for key, value in stated.items()
    }
    kept = {key: stated[key] for key in ("scale_factor", "add_offset", "_Unsigned") if key in stated}
    attributes = {**kept, "_FillValue": stated.get("fill", stored[0])}
    if "_Unsigned" in kept:
        attributes["_Unsigned"] = "true"
    found = read_hdf5(hdf5(stored, **attributes), "x.h5").values[0]
    raw = xarray.Dataset({"x": ("n", stored, attributes)})
    decoded = xarray.decode_cf(raw)["x"].to_numpy()
    np.testing.assert_allclose(found, decoded, rtol=1e-6 if stored.dtype.itemsize < 8 else 1e-5, atol=1e-3)


def stated_of(array: NDArray[Any], **own: Any) -> tuple[NDArray[Any], object]:
    lists = ("validrange", "validmin", "validmax", "fillvalue")
    facts = {key: np.asarray(value).reshape(-1) if key in lists else value for key, value in own.items()}
    values, found = unpacked(array, facts, facts, "x")
    return values, found[STORED]


@pytest.mark.parametrize(
    ("array", "stored"),
    [
        (np.arange(5.0), VALUES),
        (np.arange(5.0, dtype=np.float32), VALUES),
        (np.arange(5, dtype=np.int16), COUNTS),
        (np.arange(5) > 2, DIGITAL),
    ],
)
def test_an_array_of_which_nothing_is_stated_is_the_same_one(array: NDArray[Any], stored: str) -> None:
    values, found = stated_of(array, unit="g")
    assert values is array
    assert found == stored
    if stored != DIGITAL:
        # Nor is it touched where none of its numbers is meant.
        assert stated_of(array, fillvalue=-7, validmax=99)[0] is array


def test_integers_of_nothing_but_a_fill_value_are_still_counts() -> None:
    values, stored = stated_of(np.array([1, -9, 3], np.int16), fillvalue=-9)
    assert_array_equal(values, [1.0, np.nan, 3.0])
    assert values.dtype == np.float32
    assert stored == COUNTS


def test_numbers_of_8_bytes_are_compared_exactly() -> None:
    stored = np.array([2**63 - 1, 2**63 - 2, -(2**63)], np.int64)
    values, _ = stated_of(stored, fillvalue=np.int64(2**63 - 1))
    assert_array_equal(np.isnan(values), [True, False, False])


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        ({"scalefactor": 0.001, "scale": 0.002}, "scalefactor 0.001, scale 0.002"),
        ({"slope": 0.001, "scale": 0.002}, "scale 0.002, slope 0.001"),
        ({"scale": 0.001, "addoffset": 1.0, "offset": 2.0}, "addoffset 1, offset 2"),
        ({"scalefactor": 0.001, "fillvalue": -0.005}, "_FillValue -0.005 is no number of the stored type int16"),
        ({"scalefactor": 0.001, "validrange": [-6.0, 6.0]}, "valid_range -6.0 to 6.0 leaves other samples"),
        ({"validrange": [-6, 6], "validmin": -5}, "valid_range and valid_min contradict each other: -6 and -5"),
        ({"validrange": [-6, 0, 6]}, "valid_range is of 2 numbers, found 3"),
        ({"unsigned": "maybe"}, "_Unsigned is true or false, found 'maybe'"),
    ],
)
def test_contradictions_are_refused_with_both_readings(stated: dict[str, Any], words: str) -> None:
    with pytest.raises(ReaderError, match=f"^x: .*{words}"):
        stated_of(np.array([-8, -5, 5, 8], np.int16), **stated)


def test_unsigned_numbers_that_are_said_to_be_signed_are_refused() -> None:
    with pytest.raises(ReaderError, match="unsigned type uint8, _Unsigned says false"):
        stated_of(np.arange(4, dtype=np.uint8), unsigned="false")


@pytest.mark.parametrize("spelling", [("scale_factor", "add_offset"), ("scale", "offset"), ("Slope", "Intercept")])
def test_spellings_of_scale_and_offset(spelling: tuple[str, str]) -> None:
    stored = np.array([-8, -5, 5, 8], np.int16)
    found = read_hdf5(hdf5(stored, **dict(zip(spelling, (0.5, 1.0), strict=True))), "x.h5")
    assert_array_equal(found.values[0], stored * 0.5 + 1.0)
    assert found.stored == (SCALED,)
    # Two spellings of one value are one statement; beside floating numbers only that of the conventions is one.
    both = hdf5(stored, **{"scale_factor": 0.5, spelling[0]: 0.5})
    assert_array_equal(read_hdf5(both, "x.h5").values[0], stored * 0.5)
    floating = read_hdf5(hdf5(stored.astype(np.float32), **{spelling[0]: 0.5}), "x.h5").values[0]
    assert_array_equal(floating, stored * (0.5 if spelling[0] == "scale_factor" else 1.0))


def test_limits_that_cannot_be_stored_numbers_are_of_the_values() -> None:
    values, _ = stated_of(np.array([-8, -5, 5, 8], np.int16), scalefactor=0.5, validrange=[-2.5, 3.5])
    assert_array_equal(values, [np.nan, -2.5, 2.5, np.nan])


def with_property(stored: NDArray[Any], fill: Any) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file.create_dataset("x", data=stored, fillvalue=fill)
    return stream.getvalue()


def test_the_fill_value_of_an_hdf5_data_set_is_missing_where_it_was_defined() -> None:
    stored = np.array([-32768, 0, 5, 8], np.int16)
    assert_array_equal(read_hdf5(with_property(stored, -32768), "x").values[0], [np.nan, 0.0, 5.0, 8.0])
    # Libraries define 0 for all arrays, and by default it is not defined.
    assert_array_equal(read_hdf5(with_property(stored, 0), "x").values[0], stored)
    assert_array_equal(read_hdf5(hdf5(stored), "x").values[0], stored)


def mat73(kind: str, stored: NDArray[Any], **stated: Any) -> Samples:
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as file:
        item = file.create_dataset("x", data=stored[:, None])
        item.attrs.update({"MATLAB_class": np.bytes_(kind), **stated})
    data = bytearray(stream.getvalue())
    data[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"
    return read_mat(bytes(data), "x.mat", zone="UTC")


def test_arrays_of_matlab_7_3() -> None:
    stored = np.array([0, 1, 1, 7], np.uint8)
    assert_array_equal(mat73("uint8", stored, scale_factor=0.5, _FillValue=7).values[0], [0.0, 0.5, 0.5, np.nan])
    assert mat73("uint8", stored).stored == (COUNTS,)
    assert mat73("logical", stored[:3], MATLAB_int_decode=1).stored == (DIGITAL,)


def daqmx(counts: NDArray[np.int16], **scales: Any) -> bytes:
    """Return a TDMS file with one channel of raw samples of DAQmx."""
    text = lambda value: struct.pack("<I", len(value)) + value.encode()  # noqa: E731
    scaler = struct.pack("<IIIII", 3, 0, 0, 0, 0)
    index = struct.pack("<IIIQI", 0x1269, 0xFFFFFFFF, 1, counts.size, 1) + scaler + struct.pack("<II", 1, 2)
    properties = b""
    for key, value in {"wf_increment": 0.001, **scales}.items():
        kind = 0x20 if isinstance(value, str) else 3 if isinstance(value, int) else 10
        packed = text(value) if kind == 0x20 else struct.pack("<i" if kind == 3 else "<d", value)
        properties += text(key) + struct.pack("<I", kind) + packed
    meta = struct.pack("<I", 1) + text("/'run'/'x'") + index
    meta += struct.pack("<I", 1 + len(scales)) + properties
    raw = counts.astype("<i2").tobytes()
    # Metadata, raw data, raw data of DAQmx, new list of objects.
    lead = struct.pack("<4sIIQQ", b"TDSm", 2 | 8 | 128 | 4, 4713, len(meta) + len(raw), len(meta))
    return lead + meta + raw


LINEAR = {
    "NI_Number_Of_Scales": 2,
    "NI_Scaling_Status": "unscaled",
    "NI_Scale[1]_Scale_Type": "Linear",
    "NI_Scale[1]_Linear_Slope": 0.5,
    "NI_Scale[1]_Linear_Y_Intercept": 1.0,
    "NI_Scale[1]_Linear_Input_Source": 0,
}


def test_raw_samples_of_daqmx_are_scaled_or_counts() -> None:
    counts = np.array([-8, -5, 5, 8, 9], np.int16)
    data = daqmx(counts, **LINEAR)
    assert_array_equal(TdmsFile.read(io.BytesIO(data))["run"]["x"][:], counts * 0.5 + 1.0)
    found = read_tdms(data, "x.tdms")
    assert_array_equal(found.values[0], counts * 0.5 + 1.0)
    assert found.stored == (VALUES,)
    assert found.rate == 1000.0
    bare = read_tdms(daqmx(counts), "x.tdms")
    assert_array_equal(bare.values[0], counts)
    assert bare.stored == (COUNTS,)


def test_a_scale_that_the_library_leaves_out_is_refused() -> None:
    scales = {**LINEAR, "NI_Scale[1]_Scale_Type": "Microphone"}
    with pytest.raises(ReaderError, match="still to be scaled, and not all its scales are known: Microphone"):
        read_tdms(daqmx(np.arange(5, dtype=np.int16), **scales), "x.tdms")
