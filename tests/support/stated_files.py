"""Small files by the libraries of their makers, with each statement as the test gives it; no reader is imported."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import netCDF4
import numpy as np
import scipy.io
from nptdms import ChannelObject, RootObject, TdmsWriter
from numpy.typing import NDArray

RATE = 4096.0
START = datetime(2025, 11, 4, 8, 15, tzinfo=UTC)
GRAVITY = 9.80665

Words = Mapping[str, Any]
Rows = NDArray[np.float64]


def noise(rows: int = 1, count: int = 1024, seed: int = 5) -> Rows:
    """Vibration without a mean, of RMS 1, 0.6, 0.36 ...: in whatever unit the file states."""
    values = np.random.default_rng(seed).standard_normal((rows, count))
    values -= values.mean(axis=1, keepdims=True)
    return values / np.sqrt(np.mean(values**2, axis=1, keepdims=True)) * 0.6 ** np.arange(rows)[:, None]


def write_csv(path: Path, rows: Rows, head: Sequence[str] = (), names: Sequence[str] = ("acc",), **how: Any) -> Path:
    """A text: lines above, names, then columns, those of ``before`` (name: texts) first; ``units``: a row of them."""
    before: Mapping[str, Sequence[str]] = how.get("before", {})
    separator = how.get("separator", ",")
    lines = [*head, separator.join([*before, *names])]
    if "units" in how:
        lines.append(separator.join(how["units"]))
    columns = [*before.values(), *([f"{value:.7g}" for value in row] for row in rows)]
    path.write_text("\n".join([*lines, *map(separator.join, zip(*columns, strict=True)), ""]), encoding="utf-8")
    return path


def write_hdf5(path: Path, rows: Rows, file: Words | None = None, channel: Words | None = None, **extra: Any) -> Path:
    """Data sets acc_1 ... with the attributes of ``channel``, and those of ``extra`` as they are given."""
    with h5py.File(path, "w") as made:
        made.attrs.update(file or {})
        for number, row in enumerate(rows, start=1):
            made.create_dataset(f"acc_{number}", data=row).attrs.update(channel or {})
        for name, (values, words) in extra.items():
            made.create_dataset(name, data=values).attrs.update(words)
    return path


def write_netcdf(path: Path, rows: Rows, file: Words | None = None, channel: Words | None = None, **extra: Any) -> Path:
    """Variables acc_1 ... over ``time``, and further ones over it."""
    with netCDF4.Dataset(path, "w") as made:
        made.createDimension("time", rows.shape[1])
        made.setncatts(file or {})
        named = {f"acc_{number}": (row, channel or {}) for number, row in enumerate(rows, start=1)}
        for name, (values, words) in (named | extra).items():
            kept = dict(words)
            item = made.createVariable(
                name, np.asarray(values).dtype, ("time",), fill_value=kept.pop("_FillValue", None)
            )
            item.set_auto_maskandscale(False)
            item[:] = values
            item.setncatts(kept)
    return path


def write_tdms(path: Path, rows: Rows, file: Words | None = None, channel: Words | None = None, **extra: Any) -> Path:
    """Channels acc_1 ... of the group Vibration, and ``extra``: (group, values, properties)."""
    objects = [
        ChannelObject("Vibration", f"acc_{number}", row, properties=dict(channel or {}))
        for number, row in enumerate(rows, start=1)
    ]
    objects += [ChannelObject(group, name, values, properties=words) for name, (group, values, words) in extra.items()]
    with TdmsWriter(path) as writer:
        writer.write_segment([RootObject(dict(file or {})), *objects])
    return path


def write_mat(path: Path, rows: Rows, file: Words | None = None, **extra: Any) -> Path:
    """Vectors acc_1 ... beside scalars and texts."""
    named = {f"acc_{number}": row[:, None] for number, row in enumerate(rows, start=1)}
    scipy.io.savemat(path, {**named, **(file or {}), **extra})
    return path


def write_uff(path: Path, sets: Sequence[tuple[NDArray[np.float64], float, str, str]], start: datetime = START) -> Path:
    """Data sets 58: samples, step of the abscissa, its label, that of the ordinate."""
    lines: list[str] = []
    for number, (row, step, abscissa, ordinate) in enumerate(sets, start=1):
        lines += [
            "    -1", f"{58:6d}", f"acc_{number}", "NONE", f"{start:%d-%b-%y %H:%M:%S}", "NONE", "NONE",
            f"{1:5d}{0:10d}{1:5d}{0:10d} {'NONE':>10s}{number:10d}{3:4d} {'NONE':>10s}{number:10d}{3:4d}",
            f"{4:10d}{len(row):10d}{1:10d}{0.0:13.5e}{step:13.7e}{0.0:13.5e}",
            f"{17:10d}{0:5d}{0:5d}{0:5d} {'Time':20s} {abscissa:20s}",
            f"{12:10d}{0:5d}{0:5d}{0:5d} {'Acceleration':20s} {ordinate:20s}",
            *[f"{0:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"] * 2,
            *("".join(f"{value:20.11e}" for value in row[i : i + 4]) for i in range(0, len(row), 4)), "    -1",
        ]  # fmt: skip
    path.write_text(
        "\n".join([f"{line:80s}" if line.strip() != "-1" else line for line in lines] + [""]), encoding="ascii"
    )
    return path


def write_lvm(path: Path, rows: Rows, unit: str, head: datetime, start: datetime, rate: float = RATE) -> Path:
    """One segment: the date of the file, that of the data, a label of the unit, Delta_X."""
    count = len(rows)
    lines = [
        "LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t.",
        "Multi_Headings\tYes", "X_Columns\tOne", "Time_Pref\tAbsolute", f"Date\t{head:%Y/%m/%d}",
        f"Time\t{head:%H:%M:%S.%f}", "***End_of_Header***", "\t", f"Channels\t{count}",
        "\t".join(["Samples", *[str(rows.shape[1])] * count]), "\t".join(["Date", *[f"{start:%Y/%m/%d}"] * count]),
        "\t".join(["Time", *[f"{start:%H:%M:%S.%f}"] * count]), "\t".join(["Y_Unit_Label", *[unit] * count]),
        "\t".join(["X_Dimension", *["Time"] * count]), "\t".join(["X0", *["0.0000000000000000E+0"] * count]),
        "\t".join(["Delta_X", *[f"{1.0 / rate:.12E}"] * count]), "***End_of_Header***",
        "\t".join(["X_Value", *(f"acc_{i + 1}" for i in range(count)), "Comment"]),
    ]  # fmt: skip
    values = zip(*([f"{value:.7g}" for value in row] for row in rows), strict=True)
    lines += ["\t".join([f"{i / rate:.9f}", *cells]) for i, cells in enumerate(values)]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return path


def seconds(count: int, factor: float = 1.0, rate: float = RATE) -> list[str]:
    """A column of times, in s where ``factor`` is 1."""
    return [f"{factor * i / rate:.9f}" for i in range(count)]


def stamps(count: int, start: datetime = START, rate: float = RATE) -> list[str]:
    """A column of dates with their zone."""
    return [f"{(start + timedelta(seconds=i / rate)).isoformat(timespec='microseconds')}" for i in range(count)]


def iso(moment: datetime) -> str:
    """A date as files state it."""
    return f"{moment:%Y-%m-%dT%H:%M:%S}Z"


Writer = Callable[[Path], Path]
