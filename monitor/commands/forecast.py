"""``spallwatch forecast``: time to threshold from a V_eq history."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from monitor.commands.common import InputError, emit, output_options
from monitor.commands.tables import read_columns, write_rows
from monitor.health import forecast


@click.command("forecast")
@click.argument("input_path", metavar="INPUT", type=click.Path(path_type=Path))
@click.option(
    "--threshold-mm2",
    type=click.FloatRange(min=0, min_open=True),
    multiple=True,
    default=(0.05,),
    show_default=True,
    help="Threshold of V_eq, mm3 per mm of width; may be given several times.",
)
@click.option("--method", type=click.Choice(["thesis"]), default="thesis", show_default=True)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write the rows as CSV too.")
@output_options
def command(
    input_path: Path, threshold_mm2: tuple[float, ...], method: str, out: Path | None, as_json: bool, quiet: bool
) -> None:
    """Forecast through INPUT, a CSV file with time_s,v_eq_mm2 from t_fs on: one row a point and threshold.

    Each forecast uses the points up to its own time only, as it would have been issued then.
    """
    columns = read_columns(input_path, required=("time_s", "v_eq_mm2"))
    state = forecast.ForecastState()
    rows: list[dict[str, Any]] = []
    thresholds = [value * 1e-6 for value in threshold_mm2]
    for number, (time, v_eq) in enumerate(zip(columns["time_s"], columns["v_eq_mm2"], strict=True), 1):
        try:
            state, results = forecast.step(state, time, v_eq * 1e-6, thresholds=thresholds)
        except ValueError as error:
            raise InputError(f"{input_path}: row {number}: {error}") from None
        for asked, result in zip(threshold_mm2, results, strict=True):
            rows.append(
                {
                    "t_issue_s": time,
                    "threshold_mm2": asked,
                    "tt_s": _number(result.tt),
                    "tt_lower_s": None,
                    "tt_upper_s": None,
                    "t_threshold_s": _number(result.t_threshold),
                    "r_squared": _number(result.r_squared),
                    "status": str(result.status),
                }
            )
    if out is not None:
        write_rows(out, rows)
    emit({"method": method, "rows": rows}, _lines(rows), as_json=as_json)


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield f"{'issued':>12}  {'threshold':>10}  {'TT':>12}  {'reached at':>12}  {'R2':>7}  status"
    yield f"{'s':>12}  {'mm3/mm':>10}  {'s':>12}  {'s':>12}"
    for row in rows:
        cells = [
            "-".rjust(width) if row[key] is None else f"{row[key]:{width}.{digits}g}"
            for key, width, digits in (("tt_s", 12, 6), ("t_threshold_s", 12, 6), ("r_squared", 7, 3))
        ]
        yield f"{row['t_issue_s']:12.6g}  {row['threshold_mm2']:10.3g}  {'  '.join(cells)}  {row['status']}"
