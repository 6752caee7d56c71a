"""Histories as ``track`` and ``forecast`` take and leave them: CSV or records in; CSV, JSON or netCDF out."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from monitor.commands.common import InputError
from monitor.commands.csv_files import read_columns, write_rows, write_whole
from monitor.health.damage.tracker import Reading
from streams.block import STANDARD_GRAVITY

HARMONICS = tuple(f"harmonic_{k}_g" for k in range(1, 7))
SUFFIXES = (".csv", ".json", ".nc")


def is_records(path: Path) -> bool:
    """Say whether an input is records (a netCDF file or a folder) rather than CSV."""
    return path.is_dir() or path.suffix == ".nc"


def check_out(out: Path | None) -> None:
    """Refuse a file to be written whose name says neither CSV, JSON nor netCDF.

    Raises:
        InputError: naming the file and what is allowed.
    """
    if out is not None and out.suffix not in SUFFIXES:
        raise InputError(f"--out {out}: the name must end in {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")


def write_out(out: Path, values: Mapping[str, Any], columns: Mapping[str, Any]) -> None:
    """Write a result by the suffix of the file: the rows as CSV, all of it as JSON, or the columns as netCDF.

    Args:
        out: the file.
        values: what ``--json`` prints, with ``rows``.
        columns: arguments of ``monitor.records.histories.write_history``.

    Raises:
        InputError: the file cannot be written.
    """
    if out.suffix == ".csv":
        write_rows(out, values["rows"])
    elif out.suffix == ".json":
        write_whole(out, json.dumps(values, allow_nan=False))
    else:
        from monitor.records.histories import HistoryError, write_history

        try:
            write_history(out, **columns)
        except HistoryError as error:
            raise InputError(f"--out {error}") from None


def read_readings(
    path: Path, channel: str | None, *, load: float | None, speed: float | None
) -> tuple[list[float], list[Reading]]:
    """Read the history that a tracker takes.

    Args:
        path: CSV with ``time_s,rms_g`` from t_fs on, and ``harmonic_1_g`` to ``harmonic_6_g``, ``load_newton`` and
            ``speed_hz`` where it has them; or records.
        channel: of the records.
        load: N, where the input does not say it; None where it has to.
        speed: Hz, likewise.

    Returns:
        Times on the axis of the input, s, and one reading a time.

    Raises:
        InputError: naming the file and what is missing or wrong.
    """
    if is_records(path):
        return _readings_of_records(path, channel, load=load, speed=speed)
    refuse_channel(path, channel)
    columns = read_columns(path, required=("time_s", "rms_g"), optional=(*HARMONICS, "load_newton", "speed_hz"))
    given = [name for name in HARMONICS if name in columns]
    if given and len(given) < len(HARMONICS):
        missing = next(name for name in HARMONICS if name not in columns)
        raise InputError(f"{path}: column {missing} is missing; give {HARMONICS[0]} to {HARMONICS[-1]}, or none")
    rows = len(columns["time_s"])
    loads = columns.get("load_newton") or [_said(load, "load_newton", path)] * rows
    speeds = columns.get("speed_hz") or [_said(speed, "speed_hz", path)] * rows
    readings = [
        Reading(
            time=columns["time_s"][i],
            rms=columns["rms_g"][i] * STANDARD_GRAVITY,
            harmonics=tuple(columns[name][i] * STANDARD_GRAVITY for name in HARMONICS) if given else None,
            load=loads[i],
            speed=speeds[i],
        )
        for i in range(rows)
    ]
    return columns["time_s"], readings


def refuse_channel(path: Path, channel: str | None) -> None:
    """Refuse ``--channel`` beside a CSV file.

    Raises:
        InputError: it was given.
    """
    if channel is not None:
        raise InputError(f"--channel {channel}: {path} is no file of records, a CSV file has one channel only")


def _said(value: float | None, column: str, path: Path) -> float:
    if value is None:
        raise InputError(f"{path}: column {column} is missing, and no map with a single value says it")
    return value


def _readings_of_records(
    path: Path, channel: str | None, *, load: float | None, speed: float | None
) -> tuple[list[float], list[Reading]]:
    from monitor.records.histories import HistoryError, read_history

    try:
        history = read_history(path, channel)
    except HistoryError as error:
        raise InputError(str(error)) from None
    readings = [
        Reading(
            time=float(history.running[i]),
            rms=float(history.rms[i]),
            harmonics=_resolved(history.harmonics[i].tolist()),
            load=_known(float(history.load[i]), load),
            speed=_known(float(history.speed[i]), speed),
        )
        for i in range(len(history.time))
    ]
    return history.time.tolist(), readings


def _resolved(harmonics: Sequence[float]) -> tuple[float, ...] | None:
    return tuple(harmonics) if np.all(np.isfinite(harmonics)) else None


def _known(value: float, otherwise: float | None) -> float | None:
    return value if math.isfinite(value) else otherwise


def read_volumes(path: Path, channel: str | None) -> tuple[list[float], list[float], list[float]]:
    """Read a history of V_eq.

    Args:
        path: CSV with ``time_s,v_eq_mm2`` from t_fs on, or records.
        channel: of the records.

    Returns:
        Times on the axis of the input, s; damage times, s; V_eq, m2, NaN where the records have none.

    Raises:
        InputError: naming the file and what is missing or wrong.
    """
    if not is_records(path):
        refuse_channel(path, channel)
        columns = read_columns(path, required=("time_s", "v_eq_mm2"))
        return columns["time_s"], columns["time_s"], [value * 1e-6 for value in columns["v_eq_mm2"]]
    from monitor.records.histories import HistoryError, read_history

    try:
        history = read_history(path, channel)
    except HistoryError as error:
        raise InputError(str(error)) from None
    if not np.isfinite(history.v_eq).any():
        raise InputError(f"{path}: channel {history.channel!r} has no V_eq in these records")
    return history.time.tolist(), history.running.tolist(), history.v_eq.tolist()


def number(value: float) -> float | None:
    """Return a finite number, or None in the place of what is none."""
    return float(value) if math.isfinite(value) else None
