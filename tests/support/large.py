"""Makers and checks that tests of large share."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import h5py
import netCDF4
import numpy as np
import soundfile

from streams.files.formats.hdf5 import read_hdf5
from streams.files.formats.mat import read_mat
from streams.files.formats.netcdf import read_netcdf
from streams.files.formats.npy_wav import read_npy, read_wav
from streams.files.formats.parquet import read_parquet
from streams.files.formats.tdms import read_tdms
from streams.files.formats.text import read_layout
from streams.files.formats.uff import read_uff
from streams.files.formats.xlsx import read_xlsx
from streams.types.large import FileBytes
from streams.types.samples import Samples
from tests.streams.format_makers import (
    csv_bytes,
    hdf5_bytes,
    mat73_bytes,
    mat_bytes,
    netcdf_bytes,
    signal,
    table_bytes,
    tdms_bytes,
    uff_bytes,
    xlsx_bytes,
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
    "xlsx": (read_xlsx, "a.xlsx", lambda: xlsx_bytes(signal(2, LENGTH))),
    "parquet": (read_parquet, "a.parquet", lambda: table_bytes(signal(2, LENGTH))),
}


def on_disk(path: Path, data: bytes) -> FileBytes:
    path.write_bytes(data)
    return FileBytes.opened(str(path))
