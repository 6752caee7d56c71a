"""Writer of LVM, the text of LabVIEW."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from benchmarks.loggers.names import paths_of
from benchmarks.loggers.plan import Plan, Samples, TrueChannel, with_lost
from benchmarks.loggers.text import Written, cells_of


def write_lvm(plan: Plan, folder: Path) -> Written:
    """Write LVM files: one X column for all channels, for each, or none; one segment or several."""
    draw = plan.draw
    decimal = draw.one("decimal", [".", ","], [3, 2])
    separator = draw.one("separator", ["Tab", "Comma"]) if decimal == "." else "Tab"
    columns = draw.one("x_columns", ["One", "Multi", "No"], [3, 1, 2])
    unit = draw.one("unit", ["g", "m/s2", "m/s^2", "mV"], [4, 2, 2, 1])
    apart = float(draw.chosen.get("interval_s", 0.0)) > 40.0
    segments = draw.yes("two_segments", 0.3) and apart
    names = draw.one("labels", [("Acc_DE", "Acc_NDE", "Acc_M"), ("Untitled", "Untitled 1", "Untitled 2")])
    channels = [TrueChannel(name, unit=unit) for name in names[: len(plan.signals[0])]]
    unknowable: list[str] = []
    answers: dict[str, str] = {}
    if unit == "mV":
        unknowable.append("level")
        answers.update({"--unit": "mV", "--sensitivity-mv-per-g": "100"})
        for each in channels:
            each.sensitivity_mv_per_g = 100.0
    for number, each in enumerate(channels, start=1):
        each.column = {"One": 1 + number, "Multi": 2 * number, "No": number}[columns]
    paths: list[list[str]] = []
    text = _Lvm(
        "\t" if separator == "Tab" else ",", decimal, columns, unit, channels, draw.one("head_shift_s", [0, 3600, 2])
    )
    for index, path in enumerate(paths_of(plan, "lvm")):
        last = index == len(plan.signals) - 1
        values, lost = with_lost(plan.signals[index], plan.lost if last else "")
        if last and plan.lost == "fill":
            values[:, lost] = np.nan
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(_lvm(plan, text, index, values, 2 if segments else 1), encoding="utf-8", newline="")
        paths.append([path])
    draw.fix("segments", segments)
    return Written(channels, paths, False, unknowable, [], answers)


@dataclass(frozen=True)
class _Lvm:
    separator: str
    decimal: str
    x_columns: str
    unit: str
    channels: list[TrueChannel]
    head_shift: float


def _lvm(plan: Plan, form: _Lvm, index: int, values: Samples, segments: int) -> str:
    tab, begin = form.separator, plan.wall(index)
    made = begin - timedelta(seconds=form.head_shift)
    name = "Tab" if tab == "\t" else "Comma"
    rows = [
        f"LabVIEW Measurement{tab}", f"Writer_Version{tab}2", f"Reader_Version{tab}2", f"Separator{tab}{name}",
        f"Decimal_Separator{tab}{form.decimal}", f"Multi_Headings{tab}Yes", f"X_Columns{tab}{form.x_columns}",
        f"Time_Pref{tab}Absolute", f"Operator{tab}lab", f"Date{tab}{made:%Y/%m/%d}",
        f"Time{tab}{made:%H:%M:%S}{form.decimal}0000000", "***End_of_Header***", tab,
    ]  # fmt: skip
    for number, part in enumerate(np.array_split(values, segments, axis=1)):
        start = begin + timedelta(seconds=30.0 * number)
        rows += _segment(plan, form, start, part)
    return "\r\n".join(rows) + "\r\n"


def _segment(plan: Plan, form: _Lvm, start: datetime, part: Samples) -> list[str]:
    tab, count = form.separator, len(part)
    step = f"{1.0 / plan.rate:.12E}".replace(".", form.decimal)

    def line(key: str, value: str) -> str:
        return tab.join([key, *([value] * count)])

    rows = [
        f"Channels{tab}{count}", line("Samples", str(part.shape[1])), line("Date", f"{start:%Y/%m/%d}"),
        line("Time", f"{start:%H:%M:%S}{form.decimal}0000000"), line("Y_Unit_Label", form.unit),
        line("X_Dimension", "Time"), line("X0", f"0{form.decimal}0000000000000000E+0"), line("Delta_X", step),
        "***End_of_Header***",
    ]  # fmt: skip
    cells = [cells_of(each.stored(row), form.decimal, None) for each, row in zip(form.channels, part, strict=True)]
    x = [f"{i / plan.rate:.7f}".replace(".", form.decimal) for i in range(part.shape[1])]
    names = [each.name for each in form.channels]
    if form.x_columns == "One":
        columns, heads = [x, *cells], ["X_Value", *names]
    elif form.x_columns == "Multi":
        columns = [column for each in cells for column in (x, each)]
        heads = [head for name in names for head in ("X_Value", name)]
    else:
        columns, heads = [[""] * len(x), *cells], ["X_Value", *names]
    rows.append(tab.join([*heads, "Comment"]))
    return rows + [tab.join(cells) for cells in zip(*columns, strict=True)]
