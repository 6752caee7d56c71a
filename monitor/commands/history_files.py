"""Input and output files of ``track`` and ``forecast``: CSV or records in; CSV, JSON or netCDF out."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from monitor.commands.common import InputError, output_errors
from monitor.health.size import DamageInput, EdvStatus
from monitor.health.size.library.forecaster import LibrarySettings
from monitor.health.size.library.model import Library
from monitor.records.durable import replacing
from monitor.records.library_file import load_library
from streams.types.block import STANDARD_GRAVITY

HARMONICS = tuple(f"harmonic_{k}_g" for k in range(1, 7))
SUFFIXES = (".csv", ".json", ".nc")

_MAX_CSV_MIB = 64


def is_records(path: Path) -> bool:
    """Return whether an input is records (a netCDF file or a folder) rather than CSV."""
    return path.is_dir() or path.suffix == ".nc"


def read_readings(
    path: Path, channel: str | None, *, load: float | None, speed: float | None
) -> tuple[list[float], list[DamageInput]]:
    """Read the history for a tracker: times on the axis of the input, s, and one reading per time.

    ``path`` is a CSV file with ``time_s,rms_g`` from t_fs on and optionally ``harmonic_1_g`` to ``harmonic_6_g``,
    ``load_newton`` and ``speed_hz``; or records. ``load``, N, and ``speed``, Hz, are for inputs without; None if the
    input must give them.

    Raises:
        InputError: naming the file and what is missing or wrong.
        HistoryError: the records hold no final stage of the channel.
    """
    if is_records(path):
        return _readings_of_records(path, channel, load=load, speed=speed)
    _refuse_channel(path, channel)
    columns = read_columns(path, required=("time_s", "rms_g"), optional=(*HARMONICS, "load_newton", "speed_hz"))
    given = [name for name in HARMONICS if name in columns]
    if given and len(given) < len(HARMONICS):
        missing = next(name for name in HARMONICS if name not in columns)
        raise InputError(f"{path}: column {missing} is missing; give {HARMONICS[0]} to {HARMONICS[-1]}, or none")
    rows = len(columns["time_s"])
    loads = columns.get("load_newton") or [_required(load, "load_newton", path)] * rows
    speeds = columns.get("speed_hz") or [_required(speed, "speed_hz", path)] * rows
    readings = [
        DamageInput(
            time=columns["time_s"][i],
            rms=columns["rms_g"][i] * STANDARD_GRAVITY,
            harmonics=tuple(columns[name][i] * STANDARD_GRAVITY for name in HARMONICS) if given else None,
            load=loads[i],
            speed=speeds[i],
        )
        for i in range(rows)
    ]
    return columns["time_s"], readings


def _refuse_channel(path: Path, channel: str | None) -> None:
    if channel is not None:
        raise InputError(f"--channel {channel}: {path} is a CSV file, which has one channel only")


def _required(value: float | None, column: str, path: Path) -> float:
    if value is None:
        raise InputError(f"{path}: column {column} is missing, and there is no map with a single value of it")
    return value


def _readings_of_records(
    path: Path, channel: str | None, *, load: float | None, speed: float | None
) -> tuple[list[float], list[DamageInput]]:
    from monitor.records.histories import read_history

    history = read_history(path, channel)
    readings = [
        DamageInput(
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


class Volumes(NamedTuple):
    """A history of V_eq.

    Attributes:
        times: on the axis of the input, s.
        running: damage times, s.
        v_eq: m2, NaN where the records have none.
        calibrated: False where the input itself says that V_eq is uncalibrated.
    """

    times: list[float]
    running: list[float]
    v_eq: list[float]
    calibrated: bool


def read_volumes(path: Path, channel: str | None) -> Volumes:
    """Read a history of V_eq: CSV with ``time_s,v_eq_mm2`` (and ``status``) from t_fs on, or records of ``channel``.

    Raises:
        InputError: naming the file and what is missing or wrong.
        HistoryError: the records hold no final stage of the channel.
    """
    if not is_records(path):
        _refuse_channel(path, channel)
        columns = read_columns(path, required=("time_s", "v_eq_mm2"))
        volumes = [value * 1e-6 for value in columns["v_eq_mm2"]]
        return Volumes(columns["time_s"], columns["time_s"], volumes, not _says_uncalibrated(path))
    from monitor.records.histories import read_history

    history = read_history(path, channel)
    if not np.isfinite(history.v_eq).any():
        raise InputError(f"{path}: channel {history.channel!r} has no V_eq in these records")
    return Volumes(history.time.tolist(), history.running.tolist(), history.v_eq.tolist(), history.calibrated)


def _says_uncalibrated(path: Path) -> bool:
    """Return whether a CSV file, such as one of ``track``, has the word in its column ``status``."""
    reader = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8-sig"), newline=""), skipinitialspace=True)
    reader.fieldnames = [name.strip() for name in reader.fieldnames or []]
    return any(row.get("status") == EdvStatus.UNCALIBRATED for row in reader)


def open_csv(path: Path, expected: str) -> tuple[csv.DictReader[str], list[str]]:
    """Return a reader of the rows of a CSV file, and the names in its header without spaces around them.

    Raises:
        InputError: naming the file; it is too large, no text (``expected``: its columns), or cannot be read.
    """
    try:
        if path.stat().st_size > _MAX_CSV_MIB * 2**20:
            raise InputError(f"{path}: larger than {_MAX_CSV_MIB} MiB; is it a history of features?")
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file; expected CSV with columns {expected}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    reader = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
    header = [name.strip() for name in reader.fieldnames or []]
    reader.fieldnames = header
    return reader, header


def read_columns(path: Path, *, required: Sequence[str], optional: Sequence[str] = ()) -> dict[str, list[float]]:
    """Read named columns of finite numbers from a CSV file with a header row.

    Raises:
        InputError: naming the file, the row, the column, what was expected and what was found.
    """
    reader, header = open_csv(path, ", ".join(required))
    missing = [name for name in required if name not in header]
    if missing:
        found = ", ".join(header) or "nothing"
        raise InputError(f"{path}: column {missing[0]} is missing; expected {', '.join(required)}, found {found}")
    columns: dict[str, list[float]] = {name: [] for name in (*required, *(n for n in optional if n in header))}
    for row in reader:
        for name, values in columns.items():
            values.append(csv_number(path, reader.line_num, name, row.get(name)))
    if not columns[required[0]]:
        raise InputError(f"{path}: no rows below the header")
    for number, (before, after) in enumerate(pairwise(columns.get("time_s", [])), 2):
        if after <= before:
            raise InputError(f"{path}: row {number}: time_s goes from {before:g} to {after:g}; it must increase")
    return columns


def csv_number(path: Path, line: int, name: str, text: str | None, *, needed: bool = True) -> float:
    """Return a finite number of a cell; an empty cell is NaN where the column is not needed.

    Raises:
        InputError: naming the line and the column; it holds no number, or one that is needed and not finite.
    """
    if not needed and not (text or "").strip():
        return math.nan
    try:
        value = float(text or "")
    except ValueError:
        raise InputError(f"{path}: line {line}: {name} is {text!r}, expected a number") from None
    if needed and not math.isfinite(value):
        raise InputError(f"{path}: line {line}: {name} is {text!r}, expected a finite number")
    return value


def write_out(out: Path, values: Mapping[str, Any], columns: Mapping[str, Any]) -> None:
    """Write a result in one step: ``rows`` of the values as CSV, all values as JSON, or the columns as netCDF.

    The suffix of the file chooses. ``columns`` are arguments of ``monitor.records.histories.write_history``.

    Raises:
        InputError: the file cannot be written.
    """
    if out.suffix.lower() == ".nc":
        from monitor.records.histories import HistoryError, write_history

        try:
            write_history(out, **columns, attributes=_attributes(values))
        except HistoryError as error:
            raise InputError(f"--out {error}") from None
        return
    text = json.dumps(values, allow_nan=False) if out.suffix.lower() == ".json" else _csv(values["rows"])
    with output_errors("--out", out), replacing(out) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as CSV; None is an empty cell."""
    buffer = io.StringIO(newline="")
    writer = csv.DictWriter(buffer, fieldnames=list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    return buffer.getvalue()


def _attributes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the single values of a result as attributes of a file."""
    words = {True: "yes", False: "no", None: "none"}
    return {
        key: words[value] if value is None or isinstance(value, bool) else value
        for key, value in values.items()
        if key not in ("rows", "by_threshold")
    }


def library_settings(
    method: str, path: Path | None, features: str, interval: float, window: float | None = None
) -> dict[str, Any]:
    """Return the additional settings of ``--method library``; nothing for other methods.

    Raises:
        InputError: the library is missing or unusable, or is given for a method that needs none.
    """
    if method != "library":
        if path is not None:
            raise InputError(f"--library {path}: belongs to --method library")
        return {}
    if path is None:
        raise InputError("--library FILE is missing; make one with: spallwatch library build --out FILE")
    try:
        library = load_library(path)
        library.fit_for(features)
    except ValueError as error:
        raise InputError(f"--library {error}") from None
    settings = LibrarySettings(features=features, interval=interval, window=window)
    return {"library": library, "library_settings": settings}


def prior_of(library: Library | None) -> str | None:
    """Return the prior of a library as text."""
    return None if library is None else f"{library.prior} (library {library.hash[:16]})"
