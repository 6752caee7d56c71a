"""Every format gives the same samples back, with the rate, unit and time that its files state."""

from __future__ import annotations

import gc
import io
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
from numpy.testing import assert_allclose, assert_array_equal

from streams.files.formats.hdf5 import read_hdf5
from streams.files.formats.mat import load_mat, mat_variables, read_mat, scalar, text
from streams.files.formats.netcdf import read_netcdf
from streams.files.formats.tdms import read_tdms
from streams.files.formats.uff import read_uff
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.format_makers import (
    MAKERS,
    RATE,
    START,
    STATES_RATE,
    STATES_START,
    STATES_UNIT,
    hdf5_bytes,
    mat73_bytes,
    netcdf_bytes,
    signal,
    tdms_bytes,
    uff_bytes,
)


def status(read: object, data: bytes, *arguments: object) -> str:
    assert callable(read)
    try:
        read(data, "x", *arguments)
    except ReaderError as error:
        return error.status
    return "read"


@pytest.mark.parametrize("name", MAKERS)
def test_same_samples_in_every_format(name: str, tmp_path: Path) -> None:
    samples = signal()
    (tmp_path / name).write_bytes(MAKERS[name](samples))
    rate = None if name in STATES_RATE else RATE
    unit = None if name in STATES_UNIT else "g"
    channels = tuple(
        ChannelSpec(f"acc_{i}", column=i if name.endswith((".npy", ".wav", ".flac")) else None, unit=unit, scale=1.0)
        for i in (1, 2)
    )
    spec = SourceSpec("s", str(tmp_path / name), block_s="file", rate=rate, channels=channels)
    (block,) = open_source(spec)
    assert isinstance(block, Block)
    assert block.rate == RATE
    assert block.units == ("g", "g")
    assert block.start == (START if name in STATES_START else None)
    assert_allclose(block.samples, samples, atol=1e-9, rtol=0)


@pytest.mark.parametrize("name", sorted(STATES_UNIT))
def test_files_that_state_all_need_no_configuration(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(MAKERS[name](signal()))
    (block,) = open_source(SourceSpec("s", str(tmp_path / name), block_s="file"))
    assert isinstance(block, Block)
    assert block.samples.shape == (2, 1000)


@pytest.mark.parametrize("name", sorted(STATES_UNIT))
def test_contradictions_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(MAKERS[name](signal()))
    url = str(tmp_path / name)
    (first,) = open_source(SourceSpec("s", url, block_s="file", rate=20000.0))
    assert isinstance(first, Rejected)
    assert first.status == "wrong_rate"
    channel = ChannelSpec("acc_1", unit="m/s2")
    (second,) = open_source(SourceSpec("s", url, block_s="file", channels=(channel,)))
    assert isinstance(second, Rejected)
    assert second.status == "wrong_unit"


@pytest.mark.parametrize("unit", ["Pa", "mm"])
def test_a_unit_that_is_no_acceleration_or_velocity_is_refused(unit: str, tmp_path: Path) -> None:
    (tmp_path / "x.tdms").write_bytes(tdms_bytes(signal(), unit=unit))
    (item,) = open_source(SourceSpec("s", str(tmp_path / "x.tdms"), block_s="file"))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_unit"
    assert unit in item.reason
    assert ("a displacement; an acceleration or a velocity is needed" in item.reason) == (unit == "mm")


def test_channels_are_chosen_by_pattern() -> None:
    samples = signal(3)
    assert_array_equal(read_tdms(tdms_bytes(samples), "x", ["run/acc_2"]).values, samples[1:2])
    assert read_tdms(tdms_bytes(samples), "x", ["acc_[13]"]).names == ("run/acc_1", "run/acc_3")
    assert_array_equal(read_hdf5(hdf5_bytes(samples), "x", ["run/*_2"]).values, samples[1:2])
    assert_array_equal(read_uff(uff_bytes(samples), "x", ["2:+Z"]).values, samples[1:2])
    assert_allclose(read_netcdf(netcdf_bytes(samples), "x", ["acc_3"]).values, samples[2:3])
    for read, data in (
        (read_tdms, tdms_bytes(samples)),
        (read_hdf5, hdf5_bytes(samples)),
        (read_uff, uff_bytes(samples)),
    ):
        assert status(read, data, ["none"]) == "wrong_shape"


@pytest.mark.parametrize("cut", [0.1, 0.5, 0.9, 0.999])
def test_truncated_tdms_is_incomplete(cut: float) -> None:
    data = tdms_bytes(signal())
    assert status(read_tdms, data[: int(cut * len(data))]) == "incomplete"


def test_every_truncation_of_a_tdms_file_is_seen() -> None:
    data = tdms_bytes(signal(1, 40))
    assert {status(read_tdms, data[:end]) for end in range(1, len(data))} <= {"incomplete", "empty", "read"}
    # Only the end of the first segment is a whole file.
    assert sum(status(read_tdms, data[:end]) == "read" for end in range(1, len(data))) == 1


@pytest.mark.parametrize("binary", [False, True])
def test_truncated_uff_is_incomplete(binary: bool) -> None:
    data = uff_bytes(signal(1), binary=binary)
    assert status(read_uff, data[: len(data) // 2]) == "incomplete"


@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("binary", [False, True])
def test_uff_in_single_and_double_precision(binary: bool, double: bool) -> None:
    samples = signal()
    reading = read_uff(uff_bytes(samples, binary=binary, double=double), "x")
    assert reading.channels == ("1:+Z", "2:+Z")
    assert_allclose(reading.values, samples, atol=1e-5, rtol=0)


def test_hdf5_links_and_foreign_storage_are_refused(tmp_path: Path) -> None:
    secret = tmp_path / "secret.txt"
    secret.write_bytes(b"secret" * 100)
    answers = {}
    for kind in ("external_storage", "external_link", "soft_link", "virtual"):
        path = tmp_path / f"{kind}.h5"
        with h5py.File(path, "w") as file:
            if kind == "external_storage":
                file.create_dataset("a", (50,), "f8", external=[(str(secret), 0, 400)])
            elif kind == "external_link":
                file["a"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
            elif kind == "soft_link":
                file["b"] = np.arange(50.0)
                file["a"] = h5py.SoftLink("/b")
            else:
                layout = h5py.VirtualLayout((50,), "f8")
                layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (50,))
                file.create_virtual_dataset("a", layout)
        answers[kind] = status(read_hdf5, path.read_bytes(), ["a"])
    assert answers == dict.fromkeys(answers, "refused")


def test_hdf5_that_lies_about_its_size() -> None:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        file.create_dataset("huge", (100_000_000_000,), "f8", chunks=(1000,))
        file.create_dataset("holes", (10_000,), "f8", chunks=(1000,))[:1000] = 1.0
        file.create_dataset("never", (10_000,), "f8")
        file["text"] = "a text"
        file["objects"] = np.array([b"a", b"bc"], dtype=h5py.special_dtype(vlen=bytes))
    data = stream.getvalue()
    assert len(data) < 30_000
    assert status(read_hdf5, data, ["huge"]) == "refused"
    assert status(read_hdf5, data, ["holes"]) == "incomplete"
    assert status(read_hdf5, data, ["never"]) == "incomplete"
    assert status(read_hdf5, data, ["text"]) == "wrong_shape"
    assert status(read_hdf5, data, ["objects"]) == "wrong_shape"


def test_hdf5_that_bites_its_own_tail_ends() -> None:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        group = file.create_group("g")
        group["again"] = file["/"]
        group["acc"] = np.arange(10.0)
        group["acc"].attrs["fs"] = 1000
    assert read_hdf5(stream.getvalue(), "x", ["g/acc"]).rate == 1000.0


def test_truncated_hdf5_is_incomplete() -> None:
    data = hdf5_bytes(signal())
    assert status(read_hdf5, data[: len(data) // 2]) == "incomplete"


def test_matlab_7_3() -> None:
    samples = signal()
    data = mat73_bytes({"a": samples[0], "s.gs": samples[1], "s.sr": np.array([48828.0])}, {"who": "bearing"})
    assert mat_variables(data, "x") == {"a": ((1, 1000), "double"), "s": ((1, 1), "struct"), "who": ((1, 7), "char")}
    assert_array_equal(read_mat(data, "x", ["s.gs"]).values, samples[1:])
    values = load_mat(data, "x", ["s.sr", "who"])
    assert scalar(values, "s.sr") == 48828.0
    assert text(values, "who") == "bearing"


def test_netcdf_scale_and_fill_values(tmp_path: Path) -> None:
    import netCDF4

    with netCDF4.Dataset(tmp_path / "x.nc", "w") as file:
        file.createDimension("n", 4)
        variable = file.createVariable("acc", "i2", ("n",), fill_value=-999)
        variable.setncatts({"scale_factor": 0.5, "add_offset": 1.0, "units": "m s-2"})
        variable.set_auto_maskandscale(False)
        variable[:] = [0, 2, -999, 4]
        file.setncattr("sampling_frequency", 100.0)
    reading = read_netcdf((tmp_path / "x.nc").read_bytes(), "x")
    assert_array_equal(reading.values[0], [1.0, 2.0, np.nan, 3.0])
    assert reading.units == ("m/s2",)
    assert reading.rate == 100.0


@pytest.mark.parametrize(
    ("kind", "module", "extra"), [("tdms", "nptdms", "tdms"), ("hdf5", "h5py", "hdf5"), ("uff", "pyuff", "uff")]
)
def test_a_missing_library_is_named(
    kind: str, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = {"tdms": read_tdms, "hdf5": read_hdf5, "uff": read_uff}[kind]
    data = {"tdms": tdms_bytes, "hdf5": hdf5_bytes, "uff": uff_bytes}[kind](signal())
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ReaderError, match=rf'pip install "spallwatch\[{extra}\]"'):
        read(data, "x")
    monkeypatch.setattr(
        "streams.files.recognise.importlib.util.find_spec", lambda name: None if name == module else object()
    )
    (tmp_path / "x.bin").write_bytes(data)
    with pytest.raises(SourceError, match=rf'pip install "spallwatch\[{extra}\]"'):
        open_source(SourceSpec("s", str(tmp_path / "x.bin"), format=kind))


# The writer of pyuff leaves its files to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning", "ignore::ResourceWarning")
@pytest.mark.parametrize("binary", [0, 1])
def test_uff_as_another_program_writes_it(binary: int, tmp_path: Path) -> None:
    samples = signal()
    path = str(tmp_path / "x.uff")
    for node, row in enumerate(samples, start=1):
        function = pyuff.prepare_58(
            binary=binary,
            func_type=1,
            id1=f"acc {node}",
            id3="01-May-24 12:00:00",
            rsp_ent_name="bench",
            ref_ent_name="bench",
            rsp_node=node,
            rsp_dir=-1,
            ref_node=0,
            ref_dir=0,
            data=row,
            x=np.arange(row.size) / RATE,
            abscissa_spacing=1,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=12,
            orddenom_spec_data_type=0,
            ordinate_axis_units_lab="m/s^2",
        )
        pyuff.UFF(path).write_sets(function, "add")
    reading = read_uff(Path(path).read_bytes(), "x.uff")
    assert (reading.names, reading.channels) == (("acc 1", "acc 2"), ("1:-X", "2:-X"))
    assert (reading.rate, reading.units, reading.start) == (RATE, ("m/s2", "m/s2"), START)
    assert_allclose(reading.values, samples, atol=1e-12, rtol=0)
    gc.collect()
