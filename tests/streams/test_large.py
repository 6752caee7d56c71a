"""Files that are read from disk piece by piece give what the same bytes give in memory."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Literal

import h5py
import netCDF4
import numpy as np
import pytest
import soundfile

from streams import large
from streams.digest import content_hash
from streams.files import open_files, read_regular, unpack
from streams.large import FileBytes
from streams.readers.child import isolated
from streams.readers.complete import declared_size
from streams.readers.hdf5 import read_hdf5
from streams.readers.mat import read_mat
from streams.readers.netcdf import read_netcdf
from streams.readers.npy_wav import read_npy, read_plain_npy, read_wav
from streams.readers.tdms import read_tdms
from streams.readers.text import read_layout
from streams.readers.uff import read_uff
from streams.samples import ReaderError, Samples
from tests.streams.format_makers import (
    csv_bytes,
    hdf5_bytes,
    mat73_bytes,
    mat_bytes,
    netcdf_bytes,
    signal,
    tdms_bytes,
    uff_bytes,
)

Reader = Callable[..., Samples]
LENGTH = 1013


def npy_bytes(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def wav_bytes(samples: np.ndarray, subtype: str, kind: str = "WAV") -> bytes:
    stream = io.BytesIO()
    soundfile.write(stream, samples.T, 25600, subtype=subtype, format=kind)
    return stream.getvalue()


def counts(rows: int = 2) -> np.ndarray:
    return (signal(rows, LENGTH) * 1024).astype(np.int16)


def hdf5_table() -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        item = file.create_dataset("table", data=counts(3).T, chunks=(64, 3), compression="lzf")
        item.attrs["scale"], item.attrs["sampling_rate"] = 0.25, 25600.0
    return stream.getvalue()


def packed_netcdf(kind: Literal["NETCDF4", "NETCDF3_CLASSIC"]) -> bytes:
    file = netCDF4.Dataset("a.nc", "w", format=kind, memory=1024)
    file.createDimension("time", LENGTH)
    stored = {"a": np.arange(LENGTH) % 700 - 5, "b": np.abs(counts(1)[0]) - 1}
    for name, values in stored.items():
        item = file.createVariable(name, "i2", ("time",), fill_value=-1)
        item.set_auto_maskandscale(False)
        item[:] = values
        item.sampling_rate = 25600.0
    file["a"].scale_factor, file["a"].add_offset = 0.5, 3.0
    return bytes(file.close())


def text_bytes(head: str, separator: str, decimal: str, *, times: bool = False) -> bytes:
    columns = np.vstack([np.arange(LENGTH) * 0.0390625, signal(2, LENGTH)]) if times else signal(2, LENGTH)
    lines = [separator.join(f"{number:.9g}".replace(".", decimal) for number in row) for row in columns.T]
    return "\n".join([*([head] if head else []), *lines, ""]).encode()


FILES: dict[str, tuple[Reader, str, Callable[[], bytes]]] = {
    "npy, float32": (read_npy, "a.npy", lambda: npy_bytes(signal(2, LENGTH).astype(np.float32))),
    "npy, columns": (read_npy, "a.npy", lambda: npy_bytes(signal(3, LENGTH).T.copy())),
    "npy, big end first": (read_npy, "a.npy", lambda: npy_bytes(signal(2, LENGTH).astype(">f8"))),
    "npy, int16": (read_npy, "a.npy", lambda: npy_bytes(counts().T.copy())),
    "npy, one row": (read_npy, "a.npy", lambda: npy_bytes(signal(1, LENGTH)[0])),
    "wav, 16 bits": (read_wav, "a.wav", lambda: wav_bytes(signal(2, LENGTH), "PCM_16")),
    "wav, float64": (read_wav, "a.wav", lambda: wav_bytes(signal(3, LENGTH), "DOUBLE")),
    "hdf5": (read_hdf5, "a.h5", lambda: hdf5_bytes(signal(2, LENGTH))),
    "hdf5, packed chunks": (read_hdf5, "a.h5", lambda: hdf5_bytes(counts(), chunks=(100,), compression="gzip")),
    "hdf5, table of counts": (read_hdf5, "a.h5", hdf5_table),
    "netcdf": (read_netcdf, "a.nc", lambda: netcdf_bytes(signal(2, LENGTH))),
    "netcdf, packed with holes": (read_netcdf, "a.nc", lambda: packed_netcdf("NETCDF4")),
    "netcdf, classic with holes": (read_netcdf, "a.nc", lambda: packed_netcdf("NETCDF3_CLASSIC")),
    "mat 7.3": (read_mat, "a.mat", lambda: mat73_bytes({"x": signal(2, LENGTH), "y": signal(1, LENGTH)[0]})),
    "mat 5": (read_mat, "a.mat", lambda: mat_bytes(signal(2, LENGTH))),
    "mat 5, compressed": (read_mat, "a.mat", lambda: mat_bytes(signal(2, LENGTH), compressed=True)),
    "tdms": (read_tdms, "a.tdms", lambda: tdms_bytes(signal(2, LENGTH), segments=5)),
    "tdms, float32": (read_tdms, "a.tdms", lambda: tdms_bytes(signal(3, LENGTH).astype(np.float32))),
    "uff": (read_uff, "a.uff", lambda: uff_bytes(signal(2, LENGTH))),
    "text": (read_layout, "a.csv", lambda: csv_bytes(signal(2, LENGTH))),
    "text, times": (read_layout, "a.csv", lambda: text_bytes("Time [ms];a [g];b [g]", ";", ",", times=True)),
    "text, blanks": (read_layout, "a.txt", lambda: b"\xef\xbb\xbf" + text_bytes("", " ", ".") + b"\r\n \n"),
    "text, tabs and CRLF": (read_layout, "a.txt", lambda: text_bytes("a\tb", "\t", ".").replace(b"\n", b"\r\n")),
    "text, no end of the last line": (read_layout, "a.txt", lambda: text_bytes("a,b", ",", ".")[:-1]),
    "flac": (read_wav, "a.flac", lambda: wav_bytes(signal(2, LENGTH), "PCM_24", "FLAC")),
}


@pytest.fixture
def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(large, "MAX_IN_MEMORY", 1000)
    monkeypatch.setattr(large, "PIECE_BYTES", 999)


def on_disk(path: Path, data: bytes) -> FileBytes:
    path.write_bytes(data)
    return FileBytes.opened(str(path))


def assert_same(found: Samples, wanted: Samples) -> None:
    for field in fields(Samples):
        one, other = getattr(found, field.name), getattr(wanted, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype
            assert one.flags.c_contiguous
            np.testing.assert_array_equal(one, other)
        elif field.name == "pulses" and one is not None:
            np.testing.assert_array_equal(one.times, other.times)
        else:
            assert one == other, field.name


def verdict(reader: Reader, data: object, name: str) -> tuple[str, str]:
    try:
        reader(data, name)
    except ReaderError as error:
        # Behind a bracket are the words of a library.
        return error.status, str(error).partition("(")[0]
    return "read", ""


@pytest.mark.parametrize("kind", FILES)
def test_a_file_on_disk_gives_the_samples_of_its_bytes(
    kind: str, tmp_path: Path, small_limits: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, name, make = FILES[kind]
    data = make()
    found = reader(on_disk(tmp_path / name, data), name)
    assert not found.values.flags.owndata
    monkeypatch.undo()
    assert_same(found, reader(data, name))


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.999])
def test_a_file_that_breaks_off_is_refused_in_the_same_words(
    kind: str, share: float, tmp_path: Path, small_limits: None
) -> None:
    reader, name, make = FILES[kind]
    data = make()
    data = data[: int(share * len(data))]
    assert verdict(reader, on_disk(tmp_path / name, data), name) == verdict(reader, data, name)
    file = FileBytes.opened(str(tmp_path / name))
    assert declared_size(file, name) == declared_size(data, name)
    assert content_hash(file) == content_hash(data)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (1012, b"0.5,x"),
        (700, b"0.5"),
        (701, b"0.5,0.25,0.125"),
        (300, b""),
        (400, b"0.5,"),
        (2, b"a,b"),
        (500, b"0.5,1.5 "),
        (900, b"nan,inf"),
        (1013, b"0.5"),
        (1013, b"0.5 "),
        (1013, b"0.5,x  "),
        (1013, b"0.5,x \n  \r"),
    ],
)
@pytest.mark.parametrize("separator", [b",", b" ", b";"])
@pytest.mark.parametrize("end", [b"\n", b"", b" "])
def test_a_wrong_line_of_a_text_is_named(
    line: int, text: bytes, separator: bytes, end: bytes, tmp_path: Path, small_limits: None
) -> None:
    lines = text_bytes("", ",", ".").split(b"\n")[:-1]
    lines[line - 1] = text
    data = b"\n".join(lines).replace(b",", separator) + end
    assert verdict(read_layout, on_disk(tmp_path / "a", data), "a") == verdict(read_layout, data, "a")


def test_stamped_rows_are_read_as_a_whole(tmp_path: Path, small_limits: None) -> None:
    rows = "".join(f"2024-05-01 12:{i // 60:02d}:{i % 60:02d};{i / 8}\n" for i in range(LENGTH)).encode()
    assert_same(read_layout(on_disk(tmp_path / "a", rows), "a"), read_layout(rows, "a"))


def test_bytes_of_a_file(tmp_path: Path, small_limits: None) -> None:
    data = bytes(range(250)) * 20
    file = on_disk(tmp_path / "a", data)
    assert len(file) == len(data)
    assert file[3:1200] == data[3:1200]
    assert file[-7:] == data[-7:]
    assert file[400] == data[400]
    assert b"".join(file.pieces(5)) == data[5:]
    for part in (b"\x00", b"\xf9\x00\x01", bytes(range(200, 250)), b"\xff"):
        assert [file.find(part, begin) for begin in (0, 998, 4999)] == [data.find(part, b) for b in (0, 998, 4999)]
    assert not file.is_changed
    (tmp_path / "a").write_bytes(data[:900])
    assert file.is_changed
    with pytest.raises(EOFError, match="900 bytes instead of 5000"):
        file[800:1000]


@pytest.mark.parametrize("suffix", [".gz", ".bz2", ".xz"])
def test_a_packed_file_is_unpacked_to_disk(suffix: str, tmp_path: Path, small_limits: None) -> None:
    from streams.files import _OPENERS

    data = b"0.25\n" * 3000
    with _OPENERS[suffix](tmp_path / f"a{suffix}", "wb") as packed:
        packed.write(data)
    file = FileBytes.opened(str(tmp_path / f"a{suffix}"))
    found = unpack(file, f"a{suffix}")
    assert isinstance(found, FileBytes)
    assert found[:] == data
    with pytest.raises(ReaderError, match="become more than 14999 when unpacked"):
        unpack(file, f"a{suffix}", limit=14999)
    assert unpack(file, f"a{suffix}", limit=15000)[:] == data


def test_a_large_file_of_a_folder_comes_from_the_child_as_samples_on_disk(tmp_path: Path) -> None:
    values = np.arange(2 * 4_500_000, dtype=np.float32).reshape(-1, 2)
    np.save(tmp_path / "a.npy", values)
    raw = read_regular(tmp_path, "a.npy")
    assert isinstance(raw, FileBytes)
    found = read_plain_npy(raw, "a.npy")
    assert not found.values.flags.owndata
    np.testing.assert_array_equal(found.values[:, ::1000], values.T[:, ::1000])


def test_a_reader_of_bytes_gets_those_of_a_large_file(tmp_path: Path) -> None:
    from streams.readers.text import first_characters

    assert isolated(first_characters)(on_disk(tmp_path / "a.txt", b"0.5\n" * 200), "a.txt") == "0.5\n" * 50


def test_a_large_member_of_an_archive_is_read_from_disk(tmp_path: Path, small_limits: None) -> None:
    import tarfile

    data = npy_bytes(signal(2, LENGTH))
    (tmp_path / "a.npy").write_bytes(data)
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        archive.add(tmp_path / "a.npy", "a.npy")
    for item in open_files("s", str(tmp_path / "a.tar")):
        raw = item.read()
        assert isinstance(raw, FileBytes)
        assert raw[:] == data
