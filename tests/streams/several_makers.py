"""Files of several recordings, written as their programs do, without any code of the readers."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import h5py
import nptdms
import numpy as np
import scipy.io
from numpy.typing import NDArray

from tests.streams.format_makers import uff_bytes
from tests.streams.table_makers import Row, workbook

RATE = 1000.0
NOON = datetime(2026, 1, 1, 12, tzinfo=UTC).timestamp()


@dataclass(frozen=True)
class Part:
    """A recording: start in s since 1970 UTC, and samples of shape (channel, sample)."""

    start: float
    values: NDArray[np.floating]
    rate: float = RATE
    unit: str = "g"


def parts_of(lengths: Sequence[int], gaps: Sequence[float], seed: int = 1, channels: int = 1) -> list[Part]:
    """Return recordings of noise; each gap in s lies behind one of them."""
    rng = np.random.default_rng(seed)
    found, start = [], NOON
    for length, gap in zip(lengths, gaps, strict=True):
        found.append(Part(start, np.round(rng.normal(0.0, 1.0, (channels, length)), 6)))
        start += length / RATE + gap
    return found


def _clock(start: float, day: str, clock: str = "%H:%M:%S.%f") -> tuple[str, str]:
    time = datetime.fromtimestamp(round(start, 6), UTC)
    return time.strftime(day), time.strftime(clock)


LVM_HEAD = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    "Multi_Headings\tYes\nX_Columns\tOne\nTime_Pref\tAbsolute\nDate\t2026/01/01\nTime\t03:00:00.0\n"
    "***End_of_Header***\t\n"
)


def lvm_segment(part: Part, names: Sequence[str] = ("acc",), *, dated: bool = True) -> str:
    day, clock = _clock(part.start, "%Y/%m/%d")
    count, width = len(names), part.values.shape[1]
    lines = ["\t", f"Channels\t{count}" + "\t" * count, "\t".join(["Samples", *[str(width)] * count, ""])]
    if dated:
        lines += ["\t".join(["Date", *[day] * count, ""]), "\t".join(["Time", *[clock] * count, ""])]
    lines += ["\t".join(["Y_Unit_Label", *[part.unit] * count, ""]), "\t".join(["X_Dimension", *["Time"] * count, ""])]
    lines += ["\t".join(["X0", *["0.0"] * count, ""]), "\t".join(["Delta_X", *[f"{1 / part.rate:.9f}"] * count, ""])]
    lines += ["***End_of_Header***" + "\t" * (count + 1), "\t".join(["X_Value", *names, "Comment"])]
    rows = (f"{k / part.rate:.6f}\t" + "\t".join(f"{v:.6f}" for v in row) for k, row in enumerate(part.values.T))
    return "\n".join([*lines, *rows]) + "\n"


def lvm(parts: Sequence[Part], names: Sequence[str] = ("acc",)) -> bytes:
    return (LVM_HEAD + "".join(lvm_segment(part, names) for part in parts)).encode()


def csv_section(part: Part, names: Sequence[str] = ("acc",)) -> str:
    """A logger of another make: a head of three lines, semicolons, a blank line behind the numbers."""
    start = "T".join(_clock(part.start, "%Y-%m-%d"))
    head = f"Start: {start}Z\nRate: {part.rate:g} Hz\n" + ";".join(f"{name} [{part.unit}]" for name in names) + "\n"
    return head + "".join(";".join(f"{v:.6f}" for v in row) + "\n" for row in part.values.T) + "\n"


def csv(parts: Sequence[Part], names: Sequence[str] = ("acc",)) -> bytes:
    return "".join(csv_section(part, names) for part in parts).encode()


def stamped_csv(parts: Sequence[Part], names: Sequence[str] = ("acc",)) -> bytes:
    """Rows that begin with date and time of day, below a line of names that each recording begins with."""
    text = ""
    for part in parts:
        text += ",".join(["Time", *(f"{name} [{part.unit}]" for name in names)]) + "\n"
        for place, row in enumerate(part.values.T):
            day, clock = _clock(part.start + place / part.rate, "%Y-%m-%d")
            text += f"{day} {clock}," + ",".join(f"{v:.6f}" for v in row) + "\n"
    return text.encode()


TEXTS = {"lvm": (lvm, "lvm"), "csv": (csv, "csv"), "stamped": (stamped_csv, "csv")}
"""Maker and ending by layout."""


def tdms(parts: Sequence[Part], names: Sequence[str] = ("acc",), *, groups: Sequence[str] = ()) -> bytes:
    """A group for each recording; named by ``groups``, else counted."""
    stream = io.BytesIO()
    with nptdms.TdmsWriter(stream) as writer:
        for number, part in enumerate(parts):
            title = groups[number] if groups else f"Run {number + 1}"
            facts: dict[str, Any] = {"wf_increment": 1.0 / part.rate, "unit_string": part.unit}
            if not groups:
                facts["wf_start_time"] = np.datetime64(round(part.start * 1e6), "us")
            writer.write_segment([
                nptdms.ChannelObject(title, name, values, facts)
                for name, values in zip(names, part.values, strict=True)
            ])  # fmt: skip
    return stream.getvalue()


def hdf5(parts: Sequence[Part], names: Sequence[str] = ("acc",), *, groups: Sequence[str] = ()) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for number, part in enumerate(parts):
            group = file.create_group(groups[number] if groups else f"run{number + 1}")
            group.attrs["sampling_rate"] = part.rate
            if not groups:
                group.attrs["start_time"] = "T".join(_clock(part.start, "%Y-%m-%d")) + "Z"
            for name, values in zip(names, part.values, strict=True):
                group[name] = values
                group[name].attrs["units"] = part.unit
    return stream.getvalue()


def mat(parts: Sequence[Part], names: Sequence[str] = ("acc",)) -> bytes:
    """A structure for each recording; a single one is variables."""
    stream = io.BytesIO()
    values = {
        f"run{number}": {
            "fs": part.rate, "unit": part.unit, "t0": " ".join(_clock(part.start, "%Y-%m-%d")),
            **dict(zip(names, part.values, strict=True)),
        }
        for number, part in enumerate(parts, 1)
    }  # fmt: skip
    scipy.io.savemat(stream, values if len(parts) > 1 else values["run1"])
    return stream.getvalue()


def uff(parts: Sequence[Part], names: Sequence[str] = ("acc",)) -> bytes:
    """The sets of data set 58 one after another, with the nodes of the channels in each recording again."""
    whole = b""
    for part in parts:
        text = uff_bytes(part.values, part.rate, part.unit)
        day, clock = _clock(part.start, "%d-%b-%y")
        text = text.replace(b"01-May-24 12:00:00".ljust(80), f"{day} {clock}".ljust(80).encode())
        for number, name in enumerate(names, 1):
            text = text.replace(f"acc_{number}".ljust(80).encode(), name.ljust(80).encode())
        whole += text
    return whole


def xlsx(parts: Sequence[Part], names: Sequence[str] = ("acc",), *, cells: int | None = None) -> bytes:
    """A sheet for each recording, with a head of its own; in the last row of all ``cells``."""
    sheets: dict[str, list[Row]] = {}
    for number, part in enumerate(parts, 1):
        head: list[Row] = [["Start", "T".join(_clock(part.start, "%Y-%m-%d")) + "Z"], ["Rate", f"{part.rate:g} Hz"]]
        rows: list[Row] = [[float(value) for value in row] for row in part.values.T]
        sheets[f"Run {number}"] = [*head, [f"{name} [{part.unit}]" for name in names], *rows]
    last = sheets[f"Run {len(parts)}"]
    last[-1] = last[-1][:cells]
    return workbook(sheets)


def torn_hdf5(parts: Sequence[Part], names: Sequence[str] = ("acc",), *, place: int = -1) -> bytes:
    """The same, without some chunks of a data set of the part in a ``place``."""
    stream = io.BytesIO(hdf5(parts, names))
    with h5py.File(stream, "a") as file:
        values, path = parts[place].values[-1], f"run{range(1, len(parts) + 1)[place]}/{names[-1]}"
        words = dict(file[path].attrs)
        del file[path]
        made = file.create_dataset(path, values.shape, values.dtype, chunks=(10,))
        made[:20] = values[:20]
        made.attrs.update(words)
    return stream.getvalue()


def torn_xlsx(parts: Sequence[Part], names: Sequence[str] = ("acc",)) -> bytes:
    """The same, with half a row at the end of the last sheet."""
    return xlsx(parts, names, cells=1)


FILES = {
    "tdms": (tdms, "tdms"), "hdf5": (hdf5, "h5"), "mat": (mat, "mat"), "uff": (uff, "uff"), "xlsx": (xlsx, "xlsx"),
}  # fmt: skip
"""Maker and ending of files whose groups, sets or sheets are recordings."""

TORN = {
    "lvm": lambda parts, names: lvm(parts, names)[:-300],
    "lvm, in a head": lambda parts, names: lvm(parts, names).rpartition(b"Delta_X")[0],
    "csv": lambda parts, names: csv(parts, names)[:-14],
    "stamped": lambda parts, names: stamped_csv(parts, names)[:-30],
    "tdms": lambda parts, names: tdms(parts, names)[:-50],
    "hdf5": torn_hdf5,
    "uff": lambda parts, names: uff(parts, names)[:-400],
    "xlsx": torn_xlsx,
}
"""Makers of files whose last recording breaks off."""
