"""Acoustic transfer vectors in files: ``.npz`` of plain arrays, and CSV for those of other programs.

A CSV has one row for each microphone, point and frequency, in any order, and the columns ``microphone``, ``point``,
``frequency_hz``, ``real_pascal_per_m_per_s`` and ``imag_pascal_per_m_per_s``. Columns of places may follow, which are
the same in all rows of a microphone or point: ``microphone_x_m`` (y, z), ``point_x_m`` (y, z) and ``normal_x`` (y, z).
Other columns and lines that begin with # are ignored, but for ``# sound_speed_m_per_s,343`` and ``# over_plane,z=0``.
"""

from __future__ import annotations

import csv
import io
import math
import os
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from models.gears.sound.transfer_vectors import TransferVectorError, TransferVectors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

_NEEDED = ("microphone", "point", "frequency_hz", "real_pascal_per_m_per_s", "imag_pascal_per_m_per_s")
_PLACES = {
    "microphone_position": ("microphone_x_m", "microphone_y_m", "microphone_z_m"),
    "point_position": ("point_x_m", "point_y_m", "point_z_m"),
    "normal": ("normal_x", "normal_y", "normal_z"),
}
_SPEED = "# sound_speed_m_per_s,"
_PLANE = "# over_plane,z=0"
_VERSION = 1


def read_transfer_vectors(path: Path | str) -> TransferVectors:
    """Read transfer vectors, ``.npz`` or else CSV.

    Raises:
        TransferVectorError: if the file is none; the message names the file, the line and what was expected.
    """
    path = Path(path)
    try:
        return _read_npz(path) if path.suffix.lower() == ".npz" else _read_csv(path)
    except OSError as error:
        raise TransferVectorError(f"{path}: cannot be read ({error.strerror or error})") from error


def write_transfer_vectors(path: Path | str, vectors: TransferVectors) -> None:
    """Write transfer vectors, ``.npz`` or else CSV with all digits, replacing the file at once."""
    path = Path(path)
    if path.suffix.lower() == ".npz":
        places = {name: getattr(vectors, name) for name in _PLACES if getattr(vectors, name) is not None}
        arrays = {
            "version": np.array(_VERSION),
            "frequency": vectors.frequency,
            "h": vectors.h,
            "microphones": np.array(vectors.microphones),
            "points": np.array(vectors.points),
            "sound_speed": np.array(vectors.sound_speed),
            "over_plane": np.array(vectors.over_plane),
        }
        _replace(path, lambda stream: np.savez_compressed(stream, **arrays, **places))
    else:
        lines = "\n".join(_csv_lines(vectors)) + "\n"
        _replace(path, lambda stream: stream.write(lines.encode()))


def _replace(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    handle, beside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            write(stream)
        Path(beside).replace(path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise


def _read_npz(path: Path) -> TransferVectors:
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            content: dict[str, NDArray[np.float64]] = {name: file[name] for name in file.files}
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise TransferVectorError(f"{path}: not an .npz file of plain arrays ({error})") from error
    missing = [name for name in ("frequency", "h", "microphones", "points") if name not in content]
    if missing:
        raise TransferVectorError(f"{path}: expected the arrays frequency, h, microphones, points; missing {missing}")
    if int(content.get("version", np.array(_VERSION))) > _VERSION:
        raise TransferVectorError(f"{path}: version {int(content['version'])}, this program reads {_VERSION}")
    try:
        return TransferVectors(
            np.asarray(content["frequency"], np.float64),
            np.asarray(content["h"], np.complex128),
            tuple(str(name) for name in np.atleast_1d(content["microphones"])),
            tuple(str(name) for name in np.atleast_1d(content["points"])),
            **{name: np.asarray(content[name], np.float64) for name in _PLACES if name in content},
            sound_speed=float(content.get("sound_speed", np.array(343.0))),
            over_plane=bool(content.get("over_plane", np.array(False))),
        )
    except (ValueError, TypeError) as error:
        raise TransferVectorError(f"{path}: {error}") from error
    except TransferVectorError as error:
        raise TransferVectorError(f"{path}: {error}") from error


def _read_csv(path: Path) -> TransferVectors:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise TransferVectorError(f"{path}: expected a CSV file in UTF-8 ({error.reason})") from error
    speeds = [line.removeprefix(_SPEED) for line in lines if line.startswith(_SPEED)]
    speed = _positive(speeds[0], f"{path}: sound_speed_m_per_s") if speeds else 343.0
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    header = [name.strip() for name in next(csv.reader([numbered[0][1]]))] if numbered else []
    missing = [name for name in _NEEDED if name not in header]
    if missing:
        raise TransferVectorError(f"{path}: expected the columns {', '.join(_NEEDED)}; missing {', '.join(missing)}")
    values: dict[tuple[str, str, float], complex] = {}
    places: dict[str, dict[str, tuple[float, ...]]] = {name: {} for name in _PLACES}
    for (number, _), row in zip(numbered[1:], csv.reader(line for _, line in numbered[1:]), strict=True):
        where = f"{path}: line {number}"
        if len(row) != len(header):
            raise TransferVectorError(f"{where}: expected {len(header)} cells, got {len(row)}")
        cells = dict(zip(header, row, strict=True))
        frequency = _positive(cells["frequency_hz"], f"{where}, frequency_hz")
        key = cells["microphone"].strip(), cells["point"].strip(), frequency
        if key in values:
            raise TransferVectorError(f"{where}: microphone {key[0]}, point {key[1]} at {key[2]:g} Hz stands twice")
        values[key] = complex(*(_number(cells[name], f"{where}, {name}") for name in _NEEDED[3:]))
        for name, columns in _PLACES.items():
            if all(column in cells for column in columns):
                place = tuple(_number(cells[column], f"{where}, {column}") for column in columns)
                owner = key[0] if name == "microphone_position" else key[1]
                if places[name].setdefault(owner, place) != place:
                    raise TransferVectorError(
                        f"{where}: {columns[0]} ... of {owner} differ from those of a line before"
                    )
    if not values:
        raise TransferVectorError(f"{path}: expected rows below the header, got none")
    vectors = _assemble(path, values, places)
    return replace(vectors, sound_speed=speed, over_plane=_PLANE in lines)


def _assemble(
    path: Path,
    values: dict[tuple[str, str, float], complex],
    places: dict[str, dict[str, tuple[float, ...]]],
) -> TransferVectors:
    """Return the vectors of all rows, names in the order of their first row."""
    microphones = tuple(dict.fromkeys(key[0] for key in values))
    points = tuple(dict.fromkeys(key[1] for key in values))
    frequency = sorted({key[2] for key in values})
    h = np.empty((len(frequency), len(microphones), len(points)), np.complex128)
    for i, f in enumerate(frequency):
        for j, microphone in enumerate(microphones):
            for k, point in enumerate(points):
                value = values.get((microphone, point, f))
                if value is None:
                    raise TransferVectorError(f"{path}: no row of microphone {microphone}, point {point} at {f:g} Hz")
                h[i, j, k] = value
    owners = {"microphone_position": microphones, "point_position": points, "normal": points}
    known = {name: np.array([places[name][owner] for owner in owners[name]]) for name in _PLACES if places[name]}
    return replace(TransferVectors(np.array(frequency), h, microphones, points), **known)


def _csv_lines(vectors: TransferVectors) -> Iterable[str]:
    yield "# acoustic transfer vectors, exp(+i omega t), normals into the air"
    yield f"{_SPEED}{vectors.sound_speed!r}"
    if vectors.over_plane:
        yield _PLANE
    known = [name for name in _PLACES if getattr(vectors, name) is not None]
    yield ",".join((*_NEEDED, *(column for name in known for column in _PLACES[name])))
    for j, microphone in enumerate(vectors.microphones):
        for k, point in enumerate(vectors.points):
            rows = {name: getattr(vectors, name)[j if name == "microphone_position" else k] for name in known}
            tail = "".join(f",{float(value)!r}" for row in rows.values() for value in row)
            names = ",".join(_cell(name) for name in (microphone, point))
            for f, value in zip(vectors.frequency, vectors.h[:, j, k], strict=True):
                yield f"{names},{float(f)!r},{float(value.real)!r},{float(value.imag)!r}{tail}"


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"#') else text


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TransferVectorError(f"{where}: expected a finite number, got {text!r}")
    return value


def _positive(text: str, where: str) -> float:
    value = _number(text, where)
    if value <= 0.0:
        raise TransferVectorError(f"{where}: expected a positive number, got {text!r}")
    return value
