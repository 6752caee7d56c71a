"""Texts of several recordings, written as their programs do, without any code of the readers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

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
