"""Records of a monitor as one dataset: replayed from a recording, or read from published files."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import numpy as np
import xarray as xr

from models.machine.bearing import Bearing
from models.words.errors import WrongInputError
from monitor.health.schema import SCHEMA_VERSION, VARIABLES
from monitor.records.dataset import INT_FILL, NO_VALUE, words
from streams.types.spec import DEFAULT_BLOCK_SECONDS

if TYPE_CHECKING:
    from monitor.config.load import Config
    from spallwatch.recordings import Reading

BESIDE_VARIABLES = ("source", "name", "status", "reason", "sequence")
"""Entries of the ledger that are read beside the variables that are asked for."""


class NothingAcceptedWarning(UserWarning):
    """A recording gave no block that was accepted; the message says why."""


class RecordsError(WrongInputError):
    """Records that cannot be read; the message names the file, what was expected and what came."""


def replay(
    path: str | PathLike[str] | None = None,
    *,
    config: str | PathLike[str] | Mapping[str, Any] | None = None,
    bearing: Bearing | str | None = None,
    speed_hz: float | None = None,
    load_newton: float | None = None,
    speed_exact: bool = False,
    out: str | PathLike[str] | None = None,
    limit: int | None = None,
    block_s: float | Literal["file"] = DEFAULT_BLOCK_SECONDS,
    **how: Unpack[Reading],
) -> xr.Dataset:
    """Let a monitor see a recording, as fast as it goes, and return its records.

    Args:
        path: of the recording, a folder or ``rig:ferrara?seed=1``; by default the ``url`` of the configuration.
        config: file of a configuration, or its tables; instead of it the machine is given by the further arguments.
        bearing: geometry, or a designation of the catalogue.
        speed_hz: of the shaft, unless the recording states it.
        load_newton: radial load.
        speed_exact: whether the speed is that of a tacho or a controlled drive; otherwise it is sought around it.
        out: folder that keeps the store and the published records; by default nothing is kept.
        limit: greatest number of blocks.
        block_s: length of a block, s; "file": one block a file.
        how: ``spallwatch.recordings.Reading``; without ``channels``, all that seem vibration are monitored.

    Returns:
        As ``open_records``. Channels have the names of the file, in letters that a configuration takes.

    Warns:
        NothingAcceptedWarning: every block was rejected.

    Raises:
        RecordingError, ConfigError: the recording cannot be opened, or an argument or key is not allowed.
    """
    # Not above: who reads records does not wait for what replays.
    from monitor.service.replay import replay as replay_recording
    from spallwatch._arguments import given_configuration

    if config is not None:
        if how or bearing is not None or speed_hz is not None or load_newton is not None or speed_exact:
            raise RecordsError("replay: give either config or the machine by bearing, speed_hz and further arguments")
        found = given_configuration(config if isinstance(config, Mapping) else fspath(config))
    elif path is None or bearing is None:
        raise RecordsError("replay: give config, or path and bearing")
    else:
        operating = {"speed_hz": speed_hz, "load_newton": load_newton, "speed_exact": speed_exact}
        found = _configured(path, bearing, operating, block_s, how)
    with tempfile.TemporaryDirectory(prefix="spallwatch-") as scratch:
        folder = Path(scratch) / "replay" if out is None else Path(out)
        done = replay_recording(found, None if path is None else fspath(path), folder, limit=limit)
        for line in done.summary["warnings"]:
            warnings.warn(line, NothingAcceptedWarning, stacklevel=2)
        return open_records(folder / "records")


def open_records(
    path: str | PathLike[str],
    *,
    variables: Sequence[str] | None = None,
    channels: Sequence[str] | None = None,
    dated: bool | None = None,
) -> xr.Dataset:
    """Read published records, of one file or of all days in a folder, into memory.

    Args:
        path: file, or folder of files, or one with a folder ``records``.
        variables: names of those that are read, by default all; a year of all takes gigabytes, of three some hundred
            megabytes. The name and status of each block are always read.
        channels: by default all.
        dated: which blocks, where some have dates and some have none; by default all.

    Returns:
        Dimensions (time, channel, part, harmonic, ...), SI, with units and sources in the attributes; ``time`` as dates
        (UTC), or in s from the first block where blocks have no dates. Words are strings, "" where there is none;
        parts of a bearing are along ``part``. Sorted by time, blocks that were rejected included.

    Raises:
        RecordsError: there are no records, a file cannot be read, several machines, some blocks with dates and some
            without, or a variable or channel that does not exist.
    """
    return joined_files(_files(Path(path)), fspath(path), variables, channels, dated)


def joined_files(
    files: Sequence[Path],
    place: str,
    variables: Sequence[str] | None,
    channels: Sequence[str] | None,
    dated: bool | None,
) -> xr.Dataset:
    """Return the records of files as :func:`open_records`; ``place`` is for errors."""
    unknown = sorted(set(variables or ()) - set(VARIABLES))
    if unknown:
        raise RecordsError(f"variables: {unknown[0]!r} is not a variable of records; expected {', '.join(VARIABLES)}")
    days = [_read(file, variables) for file in files]
    days = [day for day in days if day.sizes["time"] and (dated is None or _is_dated(day) == dated)]
    if not days:
        kind = {None: "no records", True: "no records with dates", False: "no records without dates"}[dated]
        raise RecordsError(f"{place}: holds {kind}")
    machines = sorted({str(day.attrs.get("machine")) for day in days})
    if len(machines) > 1:
        raise RecordsError(f"{place}: holds records of several machines ({', '.join(machines)}); name the files")
    if len({_is_dated(day) for day in days}) > 1:
        raise RecordsError(f"{place}: some blocks have dates and some have none; choose by dated=True or False")
    return prepared(_joined(sorted(days, key=lambda day: float(day["time"].values[0]))), place, channels)


def prepared(joined: xr.Dataset, place: str, channels: Sequence[str] | None) -> xr.Dataset:
    """Return records as files hold them in the form of :func:`open_records`; ``place`` is for the error."""
    found = readable(joined)
    if channels is not None:
        missing = sorted(set(channels) - set(found.channel.values))
        if missing:
            raise RecordsError(f"{place}: has no channel {missing[0]!r}; it has {', '.join(found.channel.values)}")
        found = found.sel(channel=list(channels))
    return xr.decode_cf(found.sortby("time"), decode_timedelta=False)


def _configured(
    path: str | PathLike[str],
    bearing: Bearing | str,
    operating: Mapping[str, Any],
    block_s: float | Literal["file"],
    how: Reading,
) -> Config:
    """Return the configuration of a machine with one source, whose channels are those of the recording."""
    from spallwatch._arguments import configuration, plain_names
    from spallwatch.recordings import first_channels, folder_survey, in_own_words, source_of

    how = in_own_words(how)
    spec = source_of(path, block_s, how)
    seen = folder_survey(spec)
    spec = spec if seen is None else replace(spec, files=seen.files)
    there = first_channels(spec, None if "channels" in how else ("vibration",), seen)
    titles = list(how.get("channels", there))
    units = [how.get("unit", there.get(title)) for title in titles]
    if missing := [title for title, unit in zip(titles, units, strict=True) if unit is None]:
        expected = 'expected unit="g", "m/s2", "mm/s", "V" or "unknown"'
        raise RecordsError(f"{fspath(path)}: states no unit of {', '.join(missing)}; {expected}")
    given: Mapping[str, Any] = {**how}
    scaling = {key: given.get(key) for key in ("scale", "sensitivity_mv_per_g")}
    keys = ("rate_hz", "start_utc", "format", "range_g", "time_from", "time_name", "interval_s")
    return configuration(
        [
            {"name": name, "column": title, "unit": unit, **scaling}
            for name, title, unit in zip(plain_names(titles), titles, units, strict=True)
        ],
        bearing=bearing,
        operating=operating,
        source={"block_s": block_s, "files": list(spec.files), **{key: given.get(key) for key in keys}},
        machine={"timezone": how.get("timezone")},
    )


def _files(path: Path) -> list[Path]:
    if not path.exists():
        raise RecordsError(f"{path}: no such file or folder")
    if not path.is_dir():
        return [path]
    found = sorted(path.glob("*.nc")) or sorted((path / "records").glob("*.nc"))
    if not found:
        raise RecordsError(f"{path}: holds no .nc files of records")
    return found


def _read(path: Path, variables: Sequence[str] | None) -> xr.Dataset:
    """Read one file without decoding."""
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as dataset:
            if "schema_version" not in dataset.attrs or "time" not in dataset:
                raise RecordsError(f"{path}: is netCDF, but holds no health records")
            if int(dataset.attrs["schema_version"]) > SCHEMA_VERSION:
                raise RecordsError(
                    f"{path}: has schema version {dataset.attrs['schema_version']}; known are versions up to "
                    f"{SCHEMA_VERSION}"
                )
            if variables is None:
                return dataset.load()
            wanted = [name for name in dict.fromkeys((*BESIDE_VARIABLES, *variables)) if name in dataset]
            chosen = dataset[wanted]
            # Having the name of a dimension, it comes along as a coordinate.
            return (chosen if "fault" in variables else chosen.drop_vars("fault", errors="ignore")).load()
    except (OSError, ValueError, RuntimeError) as error:
        raise RecordsError(f"{path}: cannot be read as netCDF: {error}") from None


def _is_dated(day: xr.Dataset) -> bool:
    return day.attrs.get("dated") == "yes"


def _joined(days: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join days along time; what a day does not have is filled with what stands for no value."""
    # By variables, since "fault" is a coordinate to xarray: there is a dimension of that name.
    names = dict.fromkeys(
        str(name) for day in days for name, array in day.variables.items() if "time" in array.dims and name != "time"
    )
    samples = {name: next(day.variables[name] for day in days if name in day.variables) for name in names}
    sizes: dict[str, int] = {}
    for day in days:
        for dim, size in day.sizes.items():
            sizes[str(dim)] = max(sizes.get(str(dim), 0), size)
    channels = list(dict.fromkeys(str(name) for day in days for name in day["channel"].values))
    sizes |= {"time": sum(day.sizes["time"] for day in days), "channel": len(channels)}
    found: dict[str, xr.Variable] = {}
    for name, sample in samples.items():
        # One day may have one band or threshold, another several.
        dims = tuple(map(str, max((day.variables[name].dims for day in days if name in day.variables), key=len)))
        kind = object if sample.dtype.kind in "OU" else sample.dtype
        target = np.full([sizes[dim] for dim in dims], _fill_of(sample), dtype=kind)
        begin = 0
        for day in days:
            if name in day.variables:
                _put(
                    target, begin, day.variables[name], dims, [channels.index(str(at)) for at in day["channel"].values]
                )
            begin += day.sizes["time"]
        found[name] = xr.Variable(dims, target, sample.attrs)
    coords: dict[str, xr.Variable] = {}
    for day in days:
        for name, array in day.variables.items():
            known = coords.get(str(name))
            if "time" not in array.dims and name != "channel" and (known is None or known.size < array.size):
                coords[str(name)] = array
    time = xr.Variable("time", np.concatenate([day["time"].values for day in days]), days[0]["time"].attrs)
    channel = xr.Variable("channel", np.array(channels, dtype=object), days[0]["channel"].attrs)
    last = days[-1].attrs
    shared = {key: last[key] for key in last if all(_same(day.attrs.get(key), last[key]) for day in days)}
    return xr.Dataset(found, {**coords, "time": time, "channel": channel}, shared)


def _put(target: Any, begin: int, array: xr.Variable, dims: tuple[str, ...], places: Sequence[int]) -> None:
    """Write one day of a variable over ``dims`` into its place, its channels into theirs."""
    values = array.values
    for axis, dim in enumerate(dims):
        if dim not in array.dims:
            values = np.expand_dims(values, axis)
    end = begin + values.shape[0]
    if "channel" not in dims:
        target[begin:end] = values
        return
    for k, place in enumerate(places):
        target[(slice(begin, end), place, *(slice(size) for size in values.shape[2:]))] = values[:, k]


def _fill_of(array: xr.Variable) -> Any:
    if array.dtype.kind == "f":
        return np.nan
    if array.dtype.kind in "OU":
        return ""
    if "flag_masks" in array.attrs:
        return 0
    return NO_VALUE if "flag_values" in array.attrs else INT_FILL


def _same(one: Any, other: Any) -> bool:
    return bool(np.array_equal(one, other))


PART = "part"
"""The dimension of the parts of a bearing. In files it is called ``fault``, as is the name of the damaged part."""


def readable(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset of records, read without decoding, with words as strings and parts by name.

    Missing words are "", missing whole numbers NaN.
    """
    given = dataset.reset_coords("fault") if "fault" in dataset.coords else dataset
    decoded: dict[str, xr.Variable] = {}
    for name, array in given.variables.items():
        attributes = {key: value for key, value in array.attrs.items() if not key.startswith("flag_")}
        dims = tuple(PART if dim == "fault" else str(dim) for dim in array.dims)
        values = array.values
        if "flag_meanings" in array.attrs:
            values = words(array)
        elif array.dtype == np.int32 and name not in given.coords:
            values = np.where(values == INT_FILL, np.nan, values)
        decoded[str(name)] = xr.Variable(dims, values, attributes)
    labels = decoded.pop("fault_name", None)
    found = xr.Dataset({name: array for name, array in decoded.items() if name not in given.coords}, attrs=given.attrs)
    found = found.assign_coords({name: array for name, array in decoded.items() if name in given.coords})
    return found if labels is None else found.assign_coords({PART: (PART, labels.values, labels.attrs)})
