"""Makers and checks that tests of pulse readers share."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import h5py
import netCDF4
import numpy as np
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

from tests.streams.format_makers import RATE, START, hdf5_bytes, signal

LENGTH = 1000


TIMES = np.array([0.001, 0.01, 0.0195, 0.030001, 0.039])


ACC = signal(1, LENGTH)


def tdms(times: NDArray[Any], unit: str | None, **properties: object) -> bytes:
    stream = io.BytesIO()
    wave = {"wf_increment": 1.0 / RATE, "wf_start_time": np.datetime64(int(START * 1e6), "us"), "unit_string": "g"}
    own = {**({} if unit is None else {"unit_string": unit}), **properties}
    with TdmsWriter(stream) as writer:
        writer.write_segment([ChannelObject("run", "acc_1", ACC[0], properties=wave)])
        writer.write_segment([ChannelObject("Tacho", "edges", times, properties=own)])
    return stream.getvalue()


def hdf5(times: NDArray[Any], unit: str | None, **attributes: object) -> bytes:
    stream = io.BytesIO(hdf5_bytes(ACC))
    with h5py.File(stream, "a") as file:
        item = file.create_dataset("Tacho/edges", data=times)
        for key, value in {**({} if unit is None else {"unit": unit}), **attributes}.items():
            item.attrs[key] = value
    return stream.getvalue()


def netcdf(times: NDArray[Any], unit: str | None, **attributes: object) -> bytes:
    file = netCDF4.Dataset("x.nc", "w", memory=1)
    file.createDimension("time", LENGTH)
    file.createDimension("pulse", len(times))
    time = file.createVariable("time", "f8", ("time",))
    time.units = "seconds since 2024-05-01 12:00:00"
    time[:] = np.arange(LENGTH) / RATE
    acc = file.createVariable("acc_1", "f4", ("time",))
    acc.units = "g"
    acc[:] = ACC[0]
    edges = file.createVariable("edges", times.dtype, ("pulse",))
    edges[:] = times
    for key, value in {**({} if unit is None else {"units": unit}), **attributes}.items():
        edges.setncattr(key, value)
    return bytes(file.close())


def mat(times: NDArray[Any], unit: str | None, **fields: object) -> bytes:
    stream = io.BytesIO()
    own = {"edges": times, **({} if unit is None else {"unit": unit}), **fields}
    scipy.io.savemat(stream, {"acc_1": ACC[0], "fs": RATE, "t0": "2024-05-01T12:00:00Z", "unit": "g", "Tacho": own})
    return stream.getvalue()


FORMATS: dict[str, tuple[Callable[..., bytes], str]] = {
    "x.tdms": (tdms, "Tacho"),
    "x.h5": (hdf5, "Tacho/edges"),
    "x.nc": (netcdf, "edges"),
    "x.mat": (mat, "Tacho.edges"),
}
