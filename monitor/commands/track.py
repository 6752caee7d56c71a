"""``spallwatch track``: V_eq from an RMS history and a map."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from models.rms_map import load_map
from monitor.commands.common import InputError, emit, output_options
from monitor.commands.tables import read_columns, write_rows
from monitor.health import edv
from monitor.service.setup import map_lookup
from streams.block import STANDARD_GRAVITY


@click.command("track")
@click.argument("input_path", metavar="INPUT", type=click.Path(path_type=Path))
@click.option("--map", "map_path", type=click.Path(path_type=Path), required=True, help="RMS map (netCDF).")
@click.option("--method", type=click.Choice(["thesis"]), default="thesis", show_default=True)
@click.option("--smoothing-blocks", type=click.IntRange(min=1), default=6, show_default=True)
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), help="Write the rows as CSV too.")
@output_options
def command(
    input_path: Path,
    map_path: Path,
    method: str,
    smoothing_blocks: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Track V_eq through INPUT, a CSV file with time_s,rms_g from t_fs on.

    Columns load_newton and speed_hz are used where the map has several loads or speeds.
    """
    columns = read_columns(input_path, required=("time_s", "rms_g"), optional=("load_newton", "speed_hz"))
    rms_map = load_map(map_path)
    lookup = map_lookup(rms_map)
    settings = edv.EdvSettings(smoothing_blocks=smoothing_blocks)
    state = edv.EdvState()
    rows: list[dict[str, Any]] = []
    count = len(columns["time_s"])
    loads = columns.get("load_newton", [_only(rms_map.load, "load", input_path)] * count)
    speeds = columns.get("speed_hz", [_only(rms_map.speed, "speed", input_path)] * count)
    for time, rms, load, speed in zip(columns["time_s"], columns["rms_g"], loads, speeds, strict=True):
        map_slice, gate = lookup(load, speed)
        state, result = edv.step(state, rms * STANDARD_GRAVITY, map_slice=map_slice, settings=settings, gate=gate)
        rows.append(
            {
                "time_s": time,
                "v_eq_mm2": _number(result.v_eq * 1e6),
                "v_eq_lower_mm2": None,
                "v_eq_upper_mm2": None,
                "dphi_deg": _number(math.degrees(result.dphi_d)),
                "h_d_um": _number(result.h_d * 1e6),
                "status": str(result.status),
            }
        )
    if out is not None:
        write_rows(out, rows)
    emit({"method": method, "rows": rows}, _lines(rows), as_json=as_json)


def _only(axis: Any, name: str, path: Path) -> float:
    """Return the one value of an axis of the map; several need a column that says which.

    Raises:
        InputError: naming the column that is missing.
    """
    values = [float(value) for value in axis]
    if len(values) > 1:
        column = {"load": "load_newton", "speed": "speed_hz"}[name]
        raise InputError(f"{path}: column {column} is missing, and the map holds {len(values)} values of {name}")
    return values[0]


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    yield f"{'time':>12}  {'V_eq':>10}  {'extent':>8}  {'depth':>8}  status"
    yield f"{'s':>12}  {'mm3/mm':>10}  {'deg':>8}  {'um':>8}"
    for row in rows:
        cells = [
            "-".rjust(width) if row[key] is None else f"{row[key]:{width}.4g}"
            for key, width in (("v_eq_mm2", 10), ("dphi_deg", 8), ("h_d_um", 8))
        ]
        yield f"{row['time_s']:12.6g}  {'  '.join(cells)}  {row['status']}"
