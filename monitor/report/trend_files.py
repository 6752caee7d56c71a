"""The trends of a run as files: each block of a channel with its features and words, as CSV and netCDF."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from monitor.health.schema import VARIABLES
from monitor.records.database import replacing
from monitor.report.runs import Channel, ReportError, Run
from monitor.words.features import FEATURES, Feature

_WORDS = (
    *("stage", "fault", "fault_basis", "edv_status", "tt_status", "tta_status"),
    *("domain", "rotation_status", "level_status"),
)
_COUNTS = ("pulses_missing", "pulses_extra")
_FOREIGN = re.compile(r"[^\w.-]+")


def write_trends(runs: Sequence[Run], folder: Path, attributes: Mapping[str, str] | None = None) -> list[Path]:
    """Write ``trends-CHANNEL.csv`` and ``.nc`` of each channel, behind ``runN-`` where there are several runs.

    CSV has units at the ends of names, netCDF SI with ``units``; one row for each block of the channel's source, in
    order of time. Features that no block has are left out. Returns the files.

    Raises:
        ReportError: a file cannot be written.
    """
    written: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, run, channel in _named(runs):
            table = _dataset(run, channel)
            for ending, write in ((".csv", _write_csv), (".nc", _write_netcdf)):
                path = folder / f"{name}{ending}"
                with replacing(path) as temporary:
                    write(table.assign_attrs(attributes or {}), temporary)
                written.append(path)
    except (OSError, RuntimeError) as error:
        raise ReportError(f"{folder}: trends cannot be written: {error}") from error
    return written


def _named(runs: Sequence[Run]) -> Iterator[tuple[str, Run, Channel]]:
    """Yield the name of the file of each channel: with what a file may be called, and once."""
    taken: set[str] = set()
    for place, run in enumerate(runs, start=1):
        prefix = f"run{place}-" if len(runs) > 1 else ""
        for channel in run.channels.values():
            name = plain = f"{prefix}trends-{_FOREIGN.sub('_', channel.name)}"
            number = 2
            while name.casefold() in taken:
                name, number = f"{plain}-{number}", number + 1
            taken.add(name.casefold())
            yield name, run, channel


def _dataset(run: Run, channel: Channel) -> xr.Dataset:
    """Return the rows of a channel, SI."""
    time_attributes = {"units": "seconds since 1970-01-01T00:00:00Z" if run.dated else "s"}
    variables: dict[str, xr.Variable] = {
        "block": xr.Variable("time", channel.sequence, {"long_name": "number of the block in its source"}),
        "status": xr.Variable("time", channel.status.astype(object), {"long_name": "status of the block"}),
    }
    for feature in FEATURES.values():
        for name, values in _columns(feature, channel):
            attributes = {"long_name": feature.long_name, "units": feature.units}
            if feature.acceleration and not channel.has_level:
                attributes["units"] = "unknown"
            variables[name] = xr.Variable("time", values, attributes)
    for name in _COUNTS:
        if np.isfinite(values := channel.column(name)).any():
            variables[name] = xr.Variable("time", values, {"long_name": VARIABLES[name].long_name, "units": "1"})
    for name in _WORDS:
        if (words := channel.words.get(name)) is not None and (words[:, 0] != "").any():
            variables[name] = xr.Variable("time", words[:, 0], {"long_name": VARIABLES[name].long_name})
    found = xr.Dataset(variables, {"time": ("time", channel.time, time_attributes)})
    return found.assign_attrs(title=f"Trends of channel {channel.name}", machine=run.machine, channel=channel.name)


def _columns(feature: Feature, channel: Channel) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the columns of a feature that have values: one, or one for each band or threshold."""
    values = channel.numbers.get(feature.name)
    if values is None:
        return
    for place in range(values.shape[1]):
        if np.isfinite(values[:, place]).any():
            yield feature.name if place == 0 else f"{feature.name}_{place + 1}", values[:, place]


def _write_csv(table: xr.Dataset, path: Path) -> None:
    dated = str(table["time"].attrs["units"]).startswith("seconds since")
    columns: dict[str, object] = {"time_s": table["time"].values}
    if dated:
        moments = pd.to_datetime(table["time"].values, unit="s", utc=True)
        columns["time_utc"] = moments.strftime("%Y-%m-%dT%H:%M:%S.%f").str[:-3] + "Z"
    for name, array in table.data_vars.items():
        key, values = str(name), array.values
        feature = FEATURES.get(re.sub(r"_\d+$", "", key)) if key not in FEATURES else FEATURES[key]
        if feature is not None and array.attrs.get("units") != "unknown":
            key, values = f"{key}{feature.unit.ending}", values / feature.unit.si
        columns[key] = values
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.9g", lineterminator="\n")


def _write_netcdf(table: xr.Dataset, path: Path) -> None:
    table.assign_attrs(Conventions="CF-1.11").to_netcdf(path, engine="netcdf4")
