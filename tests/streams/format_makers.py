"""The same samples in every format, as a logger would write them."""

from __future__ import annotations

import io
from collections.abc import Callable
from datetime import datetime
from typing import Any, Literal

import h5py
import netCDF4
import numpy as np
import scipy.io
import soundfile
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

from tests.streams.table_makers import Row, parquet_bytes, workbook

RATE = 25600.0
START = 1714564800.0
"""2024-05-01T12:00:00 UTC."""

Samples = NDArray[np.floating]


def signal(rows: int = 2, length: int = 1000, seed: int = 0) -> Samples:
    """Noise that every format can hold: multiples of 1/1024 below 1 in magnitude."""
    return np.round(np.random.default_rng(seed).uniform(-0.9, 0.9, (rows, length)) * 1024) / 1024


def tdms_bytes(samples: Samples, rate: float = RATE, unit: str = "g", segments: int = 2) -> bytes:
    """A TDMS file of group ``run`` and channels ``acc_1`` ... in several segments."""
    stream = io.BytesIO()
    properties = {
        "wf_increment": 1.0 / rate,
        "wf_start_time": np.datetime64(int(START * 1e6), "us"),
        "unit_string": unit,
    }
    with TdmsWriter(stream) as writer:
        for part in np.array_split(samples, segments, axis=1):
            writer.write_segment(
                [ChannelObject("run", f"acc_{i}", row, properties=properties) for i, row in enumerate(part, start=1)]
            )
    return stream.getvalue()


def hdf5_bytes(samples: Samples, rate: float = RATE, unit: str = "g", **how: Any) -> bytes:
    """An HDF5 file with a group ``run`` that states rate and time and data sets ``acc_1`` ... that state the unit."""
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        run = file.create_group("run")
        run.attrs["sampling_rate"] = rate
        run.attrs["start_utc"] = "2024-05-01T12:00:00+00:00"
        for i, row in enumerate(samples, start=1):
            run.create_dataset(f"acc_{i}", data=row, **how).attrs["unit"] = unit
    return stream.getvalue()


def mat73_bytes(values: dict[str, Samples], texts: dict[str, str] | None = None) -> bytes:
    """A MAT file of version 7.3: an HDF5 file behind 512 bytes of MATLAB's, arrays transposed."""
    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as file:
        for key, value in values.items():
            item = file.create_dataset(key.replace(".", "/"), data=np.atleast_2d(value).T)
            item.attrs["MATLAB_class"] = np.bytes_("double")
        for key, text in (texts or {}).items():
            item = file.create_dataset(key, data=np.frombuffer(text.encode("utf-16-le"), "<u2")[:, None])
            item.attrs["MATLAB_class"] = np.bytes_("char")
        for group in {key.partition(".")[0] for key in values if "." in key}:
            file[group].attrs["MATLAB_class"] = np.bytes_("struct")
    data = bytearray(stream.getvalue())
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM"
    data[: len(head)] = head
    return bytes(data)


def mat_bytes(samples: Samples, compressed: bool = False) -> bytes:
    """A MAT file of version 5 with variables ``acc_1`` ..."""
    stream = io.BytesIO()
    rows = {f"acc_{i}": row for i, row in enumerate(samples, start=1)}
    scipy.io.savemat(stream, rows, do_compression=compressed)
    return stream.getvalue()


def uff_bytes(
    samples: Samples, rate: float = RATE, unit: str = "g", binary: bool = False, double: bool = True
) -> bytes:
    """A universal file of time responses, written by the description of data set 58."""
    parts = []
    for node, row in enumerate(samples, start=1):
        width = 8 if double else 4
        head = f"{'':4}-1\n{58:6d}"
        head += f"b{1:6d}{2:6d}{11:12d}{row.size * width:12d}{0:6d}{0:6d}{0:12d}{0:12d}\n" if binary else f"{'':74}\n"
        for line in (f"acc_{node}", "NONE", "01-May-24 12:00:00", "NONE", "NONE"):
            head += f"{line:<80}\n"
        head += f"{1:5d}{0:10d}{0:5d}{0:10d} {'NONE':10}{node:10d}{3:4d} {'NONE':10}{0:10d}{0:4d}\n"
        head += f"{4 if double else 2:10d}{row.size:10d}{1:10d}{0.0:13.5e}{1 / rate:13.5e}{0.0:13.5e}\n"
        for kind, label, shown in (
            (17, "Time", "s"),
            (12, "Acceleration", unit),
            (0, "NONE", "NONE"),
            (0, "NONE", "NONE"),
        ):
            head += f"{kind:10d}{0:5d}{0:5d}{0:5d} {label:<20} {shown:<20}\n"
        if binary:
            body = row.astype("<f8" if double else "<f4").tobytes()
        else:
            each, form = (4, "{:20.12e}") if double else (6, "{:13.5e}")
            lines = ["".join(form.format(value) for value in row[i : i + each]) for i in range(0, row.size, each)]
            body = "\n".join(lines).encode()
        parts.append(head.encode() + body + f"\n{'':4}-1\n".encode())
    return b"".join(parts)


def netcdf_bytes(
    samples: Samples, rate: float = RATE, unit: str = "g", kind: Literal["NETCDF4", "NETCDF3_CLASSIC"] = "NETCDF4"
) -> bytes:
    """A netCDF file whose coordinate ``time`` says rate and start."""
    file = netCDF4.Dataset("x.nc", "w", format=kind, memory=1)
    file.createDimension("time", samples.shape[1])
    time = file.createVariable("time", "f8", ("time",))
    time.units = "seconds since 2024-05-01 12:00:00"
    time[:] = np.arange(samples.shape[1]) / rate
    for i, row in enumerate(samples, start=1):
        variable = file.createVariable(f"acc_{i}", "f4", ("time",))
        variable.units = unit
        variable[:] = row
    return bytes(file.close())


def csv_bytes(samples: Samples, rate: float = RATE, unit: str = "g") -> bytes:
    """A text file with metadata, names, units and a column of times."""
    names = [f"acc_{i}" for i in range(1, len(samples) + 1)]
    lines = ["Start: 2024-05-01 12:00:00", ",".join(["time", *names]), ",".join(["s", *([unit] * len(names))])]
    for i, values in enumerate(samples.T):
        lines.append(",".join([f"{i / rate:.9f}", *(f"{value:.10f}" for value in values)]))
    return ("\n".join(lines) + "\n").encode()


def npy_bytes(samples: Samples) -> bytes:
    """A .npy file."""
    stream = io.BytesIO()
    np.save(stream, samples)
    return stream.getvalue()


def sound_bytes(samples: Samples, kind: str = "WAV", rate: float = RATE) -> bytes:
    """A WAV or FLAC file of 24 bits."""
    stream = io.BytesIO()
    soundfile.write(stream, samples.T, int(rate), format=kind, subtype="PCM_24")
    return stream.getvalue()


def xlsx_bytes(samples: Samples, rate: float = RATE, unit: str = "g") -> bytes:
    """A workbook with a sheet of remarks, and one with names, units and a column of times."""
    names = [f"acc_{i}" for i in range(1, len(samples) + 1)]
    rows: list[Row] = [["Start", datetime(2024, 5, 1, 12)], ["time", *names], ["s", *([unit] * len(names))]]
    rows += [[i / rate, *map(float, values)] for i, values in enumerate(samples.T)]
    return workbook({"Remarks": [["Pump 3"], ["Operator", "N. N."]], "Data": rows})


def table_bytes(samples: Samples, rate: float = RATE, unit: str = "g") -> bytes:
    """A Parquet table whose metadata say rate, time and unit."""
    columns = {f"acc_{i}": row for i, row in enumerate(samples, start=1)}
    stated = {"sampling_rate": f"{rate:g} Hz", "start": "2024-05-01 12:00:00", "writer": "a logger"}
    return parquet_bytes(columns, stated, {name: {"unit": unit} for name in columns}, rows_a_group=300)


MAKERS: dict[str, Callable[[Samples], bytes]] = {
    "x.tdms": tdms_bytes,
    "x.h5": hdf5_bytes,
    "x.mat": mat_bytes,
    "x73.mat": lambda samples: mat73_bytes({f"acc_{i}": row for i, row in enumerate(samples, start=1)}),
    "x.uff": uff_bytes,
    "xb.uff": lambda samples: uff_bytes(samples, binary=True),
    "x.nc": netcdf_bytes,
    "x3.nc": lambda samples: netcdf_bytes(samples, kind="NETCDF3_CLASSIC"),
    "x.csv": csv_bytes,
    "x.npy": npy_bytes,
    "x.wav": sound_bytes,
    "x.flac": lambda samples: sound_bytes(samples, "FLAC"),
    "x.xlsx": xlsx_bytes,
    "x.parquet": table_bytes,
}
"""A file of each format by its name."""

STATES_RATE = {"x.tdms", "x.h5", "x.uff", "xb.uff", "x.nc", "x3.nc", "x.csv", "x.wav", "x.flac", "x.xlsx"}
STATES_RATE |= {"x.parquet"}
STATES_UNIT = STATES_RATE - {"x.wav", "x.flac"}
STATES_START = STATES_UNIT
