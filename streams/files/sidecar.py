"""Side-cars: a file beside a recording states what the recording itself does not.

``FILE.json`` beside ``FILE``, else ``spallwatch.json`` or ``spallwatch.toml`` in its folder, which then counts for all
files of the folder. Keys: ``rate_hz``, ``start_utc``, ``unit``, ``scale``, ``sensitivity_mv_per_g``, ``speed_hz``,
``load_newton``, ``channels``, and ``layout`` of a file without a header (:mod:`streams.files.formats.raw`).
"""

from __future__ import annotations

import json
import os
import re
import sys
import tomllib
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from streams.files.container import read_guarded
from streams.files.datasets import DataSet, FileFacts
from streams.files.formats.pulse_text import pulse_column
from streams.files.formats.raw import Layout, layout_of
from streams.files.judge import Start, agreed_rate, joint_rate, judge_start, opened_rate
from streams.files.notes import is_note
from streams.files.parse.child import isolated
from streams.files.statements import quantity_words, seconds_utc
from streams.files.successive import HOW_TO_SPLIT
from streams.types.large import Data, elementwise
from streams.types.listing import unpacked_name
from streams.types.samples import SCALED, VALUES, ReaderError, Samples
from streams.types.spec import FILE_WORDS, UNITS, SourceSpec
from streams.types.stamps import Stamp, read_stamp, utc_text

FOLDER_NAMES = ("spallwatch.json", "spallwatch.toml")
"""Names of side-cars that are for all files of their folder."""


def sidecar_paths(path: str) -> tuple[str, ...]:
    """Return the paths that the side-car of a file may have; the first that is there counts."""
    folder, slash, _ = path.rpartition("/")
    return f"{path}.json", *[folder + slash + name for name in FOLDER_NAMES]


def is_beside(pattern: str | None) -> bool:
    """Return whether a pattern of pulses is that of files beside the recording."""
    return pattern is not None and any(word in pattern for word in FILE_WORDS)


def pulse_file_of(pattern: str | None, path: str) -> str | None:
    """Return the path of the file of pulses that belongs to a file of the recording; None: pulses are no files."""
    if pattern is None or not is_beside(pattern):
        return None
    folder, slash, name = path.rpartition("/")
    stem, dot, _ = unpacked_name(name).rpartition(".")
    return folder + slash + pattern.replace("{stem}", stem if dot else name).replace("{name}", name)


_MAX_SIDECAR_BYTES = 1 << 16


@dataclass(frozen=True)
class SideCar:
    """The content of a side-car in SI units, None where it states nothing.

    ``scale`` is the factor from the stored numbers to the unit; with a sensitivity rows in V are given in g.
    """

    path: str
    rate: float | None = None
    start: float | None = None
    unit: str | None = None
    scale: float | None = None
    sensitivity_mv_per_g: float | None = None
    speed: float | None = None
    load: float | None = None
    channels: tuple[str, ...] | None = None
    layout: Layout | None = None


def is_sidecar(path: str, recordings: Container[str]) -> bool:
    """Return whether a file is a side-car, of its folder or of one of some recordings."""
    return (
        path.rpartition("/")[2] in FOLDER_NAMES
        or (path.endswith(".json") and path.removesuffix(".json") in recordings)
        or is_note(path, recordings)
    )


def find_sidecar(root: Path, path: str, zone: str = "UTC") -> SideCar | None:
    """Return the side-car of the file at ``path`` below the resolved root, or None.

    ``zone`` is the IANA name of the zone of a start that names none.

    Raises:
        ReaderError: ``unreadable`` where it is no valid side-car, naming the key; ``refused`` as for any file.
    """
    for candidate in sidecar_paths(path):
        if not os.path.lexists(f"{root}/{candidate}"):
            continue
        return _parsed(read_guarded(root, candidate, max_bytes=_MAX_SIDECAR_BYTES), candidate, zone)
    return None


def _parsed(raw: bytes, path: str, zone: str) -> SideCar:
    try:
        text = raw.decode("utf-8-sig")
        values: Any = tomllib.loads(text) if path.endswith(".toml") else json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ReaderError("unreadable", f"{path}: not a readable side-car ({str(error)[:200]})") from error
    if not isinstance(values, dict):
        raise ReaderError("unreadable", f"{path}: expected a table of keys, got {type(values).__name__}")
    known = {"rate_hz", "start_utc", "unit", "scale", "sensitivity_mv_per_g", "speed_hz", "load_newton", "channels"}
    known.add("layout")
    unknown = sorted(set(values) - known)
    if unknown:
        raise ReaderError("unreadable", f"{path}: unknown key {unknown[0][:40]!r}; expected {', '.join(sorted(known))}")
    unit = values.get("unit")
    if unit is not None and unit not in UNITS:
        raise ReaderError(
            "wrong_unit",
            f"{path}: unit must be one of {', '.join(UNITS)}, got {str(unit)[:40]!r}{quantity_words(str(unit))}",
        )
    return SideCar(
        path=path,
        rate=_number(values, "rate_hz", path, positive=True),
        start=_start(values, path, zone),
        unit=unit,
        scale=_number(values, "scale", path),
        sensitivity_mv_per_g=_number(values, "sensitivity_mv_per_g", path, positive=True),
        speed=_number(values, "speed_hz", path),
        load=_number(values, "load_newton", path),
        channels=_channels(values, path),
        layout=layout_of(values["layout"], path) if "layout" in values else None,
    )


def _number(values: dict[str, Any], key: str, path: str, positive: bool = False) -> float | None:
    value = values.get(key)
    if value is None:
        return None
    good = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
    if not good or (positive and value <= 0) or (key == "scale" and value == 0):
        wanted = "a positive number" if positive else "a finite number" + (" that is not zero" * (key == "scale"))
        raise ReaderError("unreadable", f"{path}: {key} must be {wanted}, got {str(value)[:40]!r}")
    return float(value)


def _start(values: dict[str, Any], path: str, zone: str) -> float | None:
    value = values.get("start_utc")
    if value is None:
        return None
    start = seconds_utc(value, zone) if isinstance(value, str | int | float | datetime) else None
    if start is None:
        raise ReaderError("unreadable", f"{path}: start_utc must be an ISO 8601 time, got {str(value)[:40]!r}")
    return start


def _channels(values: dict[str, Any], path: str) -> tuple[str, ...] | None:
    value = values.get("channels")
    if value is None:
        return None
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise ReaderError("unreadable", f"{path}: channels must be a list of names, got {str(value)[:60]!r}")
    if len(set(value)) != len(value):
        raise ReaderError("unreadable", f"{path}: channels must differ")
    return tuple(value)


def _scaled(stored: str) -> str:
    return VALUES if stored == VALUES else SCALED


def _rate_with(samples: Samples, sidecar: SideCar, name: str) -> float | None:
    """Return the rate in Hz of a file and its side-car; ReaderError ``wrong_rate`` where they differ."""
    opened = opened_rate(samples)
    if sidecar.rate is not None and opened.readings:
        agreed_rate((), sidecar.rate, name, opened)
    return joint_rate(((sidecar.path, sidecar.rate), ("the file", samples.rate)), name)


def _start_with(samples: Samples, sidecar: SideCar, name: str) -> float | None:
    """Return the time of the first sample by a file and its side-car; ReaderError ``unreadable`` where they differ."""
    if sidecar.start is None or samples.number > 1:
        return samples.start
    stated = [Start(sidecar.path, Stamp(utc_text(sidecar.start), sidecar.start, sidecar.start))]
    if samples.start is not None:
        stated.append(Start("the file", Stamp(utc_text(samples.start), samples.start, samples.start)))
    elif samples.stamp is not None and (stamp := read_stamp(samples.stamp, "UTC")) is not None:
        stated.append(Start("the file", replace(stamp, resolution=60.0)))
    return judge_start(stated, name).value


def apply_sidecar(samples: Samples, sidecar: SideCar, name: str) -> Samples:
    """Add what a side-car states to the samples of its file, scaled or converted to g.

    Raises:
        ReaderError: ``wrong_rate``, ``wrong_unit`` or ``wrong_shape`` where file and side-car contradict.
    """
    where = f"{name}: {sidecar.path}"
    rate = _rate_with(samples, sidecar, name)
    start = _start_with(samples, sidecar, name)
    own = {unit for unit in samples.units if unit is not None}
    if sidecar.unit is not None and own - {"unknown", sidecar.unit}:
        raise ReaderError("wrong_unit", f"{where} states {sidecar.unit}, the file {', '.join(sorted(own))}")
    if sidecar.channels is not None and len(sidecar.channels) != len(samples.names):
        count = len(sidecar.channels)
        raise ReaderError("wrong_shape", f"{where} names {count} channels, the file has {len(samples.names)} rows")
    units = tuple(sidecar.unit or unit for unit in samples.units)
    values, factor = samples.values, sidecar.scale or 1.0
    if sidecar.sensitivity_mv_per_g is not None:
        if set(units) != {"V"}:
            raise ReaderError("wrong_unit", f"{where}: sensitivity_mv_per_g is for rows in V, these are in {units[0]}")
        factor *= 1e3 / sidecar.sensitivity_mv_per_g
        units = ("g",) * len(units)
    if factor != 1.0:
        # What leaves the range of the numbers becomes inf or nan, which the quality stage names.
        with np.errstate(over="ignore", invalid="ignore"):
            values = elementwise(lambda numbers: numbers * factor, values)
    return replace(
        samples,
        values=values,
        channels=sidecar.channels or samples.channels,
        rate=rate,
        start=start,
        stamp=samples.stamp if start is None else None,
        speed=samples.speed if samples.speed is not None else sidecar.speed,
        load=samples.load if samples.load is not None else sidecar.load,
        units=units,
        scaled=samples.scaled or sidecar.scale is not None or sidecar.sensitivity_mv_per_g is not None,
        stored=samples.stored if sidecar.scale is None else tuple(map(_scaled, samples.stored)),
    )


_ENDINGS = tuple(f".{word}{end}" for word in ("pulses", "pulse", "tacho") for end in (".csv", ".txt", ""))
"""Endings of files of pulses that need no configuration to be told."""


def is_pulse_file(pattern: str | None, path: str) -> bool:
    """Return whether a file is one of pulses by its name."""
    if pattern is None or not is_beside(pattern):
        return False
    parts = re.split(r"\{(?:stem|name)\}", pattern)
    return re.fullmatch(".+".join(map(re.escape, parts)), path.rpartition("/")[2]) is not None


def pulse_pattern(paths: Sequence[str]) -> str | None:
    """Return the pattern of files of pulses that stand beside others by their names, None where there are none."""
    names = set(paths)
    stems = {unpacked_name(path).rpartition(".")[0] or path for path in names}
    for ending in _ENDINGS:
        own = {path for path in names if path.endswith(ending)}
        if own and own != names and all(path.removesuffix(ending) in stems for path in own):
            return "{stem}" + ending
    return None


def with_pulse_files(data_set: DataSet, spec: SourceSpec, root: Path) -> DataSet:
    """Return the data set with a reader that adds the pulses of the file beside, and without these files.

    A recording without such a file, or with one of no bytes, has no pulses.
    """

    def facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
        return None if is_pulse_file(spec.pulses, path) else data_set.facts(path, place, zone)

    def read(data: Data, path: str) -> Samples:
        samples = data_set.read(data, path)
        beside = pulse_file_of(spec.pulses, path)
        if beside is None or not os.path.lexists(f"{root}/{beside}"):
            return samples
        if samples.following:
            reason = f"holds {len(samples.recordings)} recordings, and {beside} pulses of one; {HOW_TO_SPLIT}"
            raise ReaderError("wrong_shape", f"{path}: {reason}")
        try:
            raw = read_guarded(root, beside)
            if not raw:
                return samples
            found = isolated(pulse_column, spec.timezone)(raw, beside)
        except ReaderError as error:
            # These words are of the recording: it has neither changed nor broken off.
            status = "unreadable" if error.status in ("changed", "incomplete", "empty") else error.status
            raise ReaderError(status, f"{path}: {error}") from error
        if found.pulses is None:
            return samples
        epoch, pulses = found.pulse_epoch, found.pulses
        if epoch is not None and samples.start is not None:
            pulses, epoch = pulses.shifted(epoch - samples.start), None
        return replace(samples, pulses=pulses, pulse_epoch=epoch)

    return replace(data_set, facts=facts, read=read)
