"""Histories of the commands ``track`` and ``forecast``: read from published records, written as netCDF."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from models.words.errors import WrongInputError
from monitor.health.onset import HEALTHY, LEARNING, DetectSettings
from monitor.health.schema import REJECTIONS, SCHEMA_VERSION, VARIABLES
from monitor.records.dataset import NO_VALUE, attributes_of, words
from monitor.records.durable import replacing

Array = NDArray[np.float64]

_UNUSABLE = ("flat", "stopped", "late", "out_of_order", "clipped", "outside_speed", "filled")
"""Flags with which a block of a channel is not tracked."""
_OUT_OF_TIME = ("late", "out_of_order", "clock")
_RUN_IN_BLOCKS = DetectSettings.run_in_blocks
_NEEDED = ("rms", "bpfo_amplitude", "load", "speed", "v_eq", "t_fs", "stage", "quality_status", "quality_flags")


class HistoryError(WrongInputError):
    """A history cannot be read or written; the message names the file and the cause."""


@dataclass(frozen=True, eq=False)
class History:
    """Records of one channel from the latest t_fs on, up to where that final stage closed or to the end; n blocks.

    Attributes:
        time: s, UTC since 1970 or from the first block, shape (n,).
        running: damage time from the first block, s, without standstill, shape (n,).
        rms: m/s2, shape (n,).
        harmonics: first six BPFO lines, m/s2, NaN where not resolved, shape (n, 6).
        load: N, NaN where unknown, shape (n,).
        speed: Hz, NaN where unknown, shape (n,).
        v_eq: as recorded, m2, NaN where absent, shape (n,).
        calibrated: whether no part of the records says that the rig was not calibrated.
        first: time of the first block of the records, s as in ``time``.
        baseline: median RMS of the healthy machine, m/s2, NaN where the records do not reach back so far.
    """

    channel: str
    time: Array
    running: Array
    rms: Array
    harmonics: Array
    load: Array
    speed: Array
    v_eq: Array
    calibrated: bool = True
    first: float = 0.0
    baseline: float = math.nan


class NoFinalStageError(HistoryError):
    """Records without a final stage."""


def read_history(path: Path, channel: str | None = None) -> History:
    """Read the final stage of a channel from a published file, or a folder of them (or one above ``records``).

    The channel is needed where several have a final stage. HistoryError for an unreadable file, no records, no such
    channel; NoFinalStageError for no final stage.
    """
    datasets = [_open(file) for file in _files(path)]
    names = list(dict.fromkeys(str(name) for dataset in datasets for name in dataset.channel.values))
    if channel is not None and channel not in names:
        raise HistoryError(f"{path}: has no channel {channel!r}; it has {', '.join(names)}")
    found = [history for name in names if channel in (None, name) and (history := _history(datasets, name)) is not None]
    if not found:
        who = "no channel has" if channel is None else f"channel {channel!r} does not have"
        raise NoFinalStageError(f"{path}: {who} a final stage in these records; there is nothing to track")
    if len(found) > 1:
        raise HistoryError(
            f"{path}: several channels have a final stage ({', '.join(h.channel for h in found)}); name one: --channel"
        )
    return found[0]


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    found = sorted(path.glob("*.nc")) or sorted((path / "records").glob("*.nc"))
    if not found:
        raise HistoryError(f"{path}: holds no .nc files of records")
    return found


def _open(path: Path) -> xr.Dataset:
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as dataset:
            missing = [name for name in _NEEDED if name not in dataset]
            loaded = dataset if missing else dataset[list(_NEEDED)].load()
    except (OSError, ValueError, RuntimeError) as error:
        raise HistoryError(f"{path}: cannot be read as netCDF: {error}") from None
    if missing or "schema_version" not in loaded.attrs:
        raise HistoryError(
            f"{path}: holds no health records (variable {(missing or ['schema_version'])[0]} is missing)"
        )
    if int(loaded.attrs["schema_version"]) > SCHEMA_VERSION:
        raise HistoryError(
            f"{path}: has schema version {loaded.attrs['schema_version']}; known are versions up to {SCHEMA_VERSION}"
        )
    return loaded


def _history(datasets: Sequence[xr.Dataset], channel: str) -> History | None:
    """Return the final stage of one channel, or None where it has none."""
    parts = [
        part.sel(channel=channel)
        for part in sorted(datasets, key=lambda dataset: float(dataset.time[0]))
        if channel in part.channel.values
    ]
    columns: dict[str, Array] = {
        name: np.concatenate([np.asarray(part[name].values, dtype=np.float64) for part in parts])
        for name in ("rms", "bpfo_amplitude", "load", "speed", "v_eq", "t_fs")
    }
    time = np.concatenate([np.asarray(part.time.values, dtype=np.float64) for part in parts])
    flags = [set(text.split("|")) for part in parts for text in words(part.quality_flags)]
    status = np.concatenate([words(part.quality_status) for part in parts])
    stage = np.concatenate([words(part.stage) for part in parts]).astype(str)
    out_of_time = np.array([bool(item & set(_OUT_OF_TIME)) for item in flags])
    in_clock = (status != "") & ~np.isin(status.astype(str), REJECTIONS) & ~out_of_time
    begun = columns["t_fs"][np.isfinite(columns["t_fs"])]
    if not begun.size:
        return None
    usable = np.array([not item & set(_UNUSABLE) for item in flags]) & np.isfinite(columns["rms"])
    # The latest episode, which may have closed again.
    ended = time[np.isfinite(columns["t_fs"])].max()
    rows = np.flatnonzero(usable & (time >= begun[-1]) & (time <= ended))
    running = damage_time(time, np.array(["stopped" in item for item in flags]), in_clock)
    return History(
        channel=channel,
        time=time[rows],
        running=running[rows] - running[rows[0]] if rows.size else running[rows],
        harmonics=columns["bpfo_amplitude"][rows],
        first=float(time[0]),
        baseline=_baseline(columns["rms"], stage, usable & (time < begun[-1])),
        calibrated=all(claims_calibration(str(part.attrs.get("calibrated", "")), channel) for part in parts),
        **{name: columns[name][rows] for name in ("rms", "load", "speed", "v_eq")},
    )


def _baseline(rms: Array, stage: NDArray[np.str_], usable: NDArray[np.bool_]) -> float:
    """Return the median RMS of the blocks that the detector learned from, of the healthy ones where there are none."""
    learned = np.flatnonzero(usable & (stage == LEARNING))[_RUN_IN_BLOCKS:]
    rows = learned if learned.size else np.flatnonzero(usable & (stage == HEALTHY))
    return float(np.median(rms[rows])) if rows.size else math.nan


def claims_calibration(claims: str, channel: str) -> bool:
    """Return whether the attribute ``calibrated`` ("no", or "NAME: no; NAME: yes") does not say no of a channel."""
    return not {"no", f"{channel}: no"} & set(claims.split("; "))


def damage_time(time: Array, stopped: NDArray[np.bool_], in_clock: NDArray[np.bool_]) -> Array:
    """Return damage time from the first block, s: the time between running blocks, as the health step counts it.

    All of shape (n,): time of each block, s; whether the machine is stopped; whether the time of the block counts
    (accepted, in order).
    """
    gained = np.zeros(time.size)
    places = np.flatnonzero(in_clock)
    runs = ~stopped[places]
    gained[places[1:]] = np.where(runs[1:] & runs[:-1], np.maximum(np.diff(time[places]), 0.0), 0.0)
    return np.cumsum(gained)


def write_history(
    path: Path,
    time: Sequence[float],
    columns: Mapping[str, Sequence[Any]],
    *,
    thresholds: Sequence[float] = (),
    attributes: Mapping[str, Any] | None = None,
) -> None:
    """Write tracked or forecast quantities as netCDF, SI, with the attributes that they have in the records.

    Args:
        path: replaced atomically; HistoryError where it cannot be written.
        time: of each row, s on the axis of the input, shape (n,).
        columns: by the name of a record's variable, values of shape (n,) or (n, thresholds); None is no value, words
            are words of the schema. Other names are RMS under another condition, m/s2.
        thresholds: of V_eq, m2, where columns have that dimension.
        attributes: global attributes.
    """
    data: dict[str, Any] = {}
    if thresholds:
        data["v_th"] = ("threshold", np.asarray(thresholds, dtype=np.float64), attributes_of(VARIABLES["v_th"], "s"))
    for name, values in columns.items():
        variable = VARIABLES.get(name)
        coded = _coded(values, () if variable is None else variable.values)
        described = {"units": "m s-2", "long_name": name.replace("_", " ")}
        dims = ("time", "threshold")[: coded.ndim]
        data[name] = (dims, coded, described if variable is None else attributes_of(variable, "s"))
    axis = {"units": "s", "long_name": "time on the axis of the input"}
    dataset = xr.Dataset(data, coords={"time": ("time", np.asarray(time, dtype=np.float64), axis)})
    dataset.attrs = {"schema_version": SCHEMA_VERSION, **(attributes or {})}
    try:
        with replacing(path, f".{os.getpid()}") as temporary:
            dataset.to_netcdf(temporary, engine="netcdf4", format="NETCDF4")
    except (OSError, RuntimeError) as error:
        raise HistoryError(f"{path}: cannot be written: {error}") from None


def _coded(values: Sequence[Any], known: Sequence[str]) -> NDArray[Any]:
    """Return numbers with NaN for None, or words as their places in the schema."""
    array = np.asarray(values, dtype=object)
    if not known:
        return np.vectorize(lambda value: np.nan if value is None else value, otypes=[np.float64])(array)
    places = {word: place for place, word in enumerate(known)}
    return np.vectorize(lambda word: places.get(word, NO_VALUE), otypes=[np.int8])(array)
