"""netCDF files: the classic formats through scipy, netCDF-4 as HDF5."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from streams.files.abscissa import rate_of_times
from streams.files.formats.hdf5 import Budget, Found, join_arrays, load, open_hdf5, walk
from streams.files.keys import TIME_UNITS
from streams.files.packing import attribute_facts, netcdf_fill, unpacked
from streams.files.parse.worker import from_disk, readable
from streams.files.pulse_times import matches_pulses, only_one, own_facts, with_pulses
from streams.files.statements import Facts, nearest, plain_unit, seconds_utc
from streams.types.large import Data, FileBytes, stream_of
from streams.types.samples import ReaderError, Samples, rows_of

_TIMES = ("time", "t")

_Variables = tuple[dict[str, tuple[NDArray[Any], Facts]], dict[str, Facts]]
"""Variables with what is stated of each, by itself or around it; and what each states itself."""


@from_disk
def read_netcdf(
    data: Data,
    name: str,
    patterns: Sequence[str] = (),
    zone: str = "UTC",
    pulses: str | None = None,
    wanted: Sequence[str] = (),
    slow: Sequence[str] = (),
    disregard: Sequence[str] = (),
) -> Samples:
    """Read the numeric variables of a netCDF file, a row for each vector.

    Rate, unit and time of the first sample come from the attributes as in :func:`streams.files.formats.hdf5.read_hdf5`,
    and from a coordinate ``time`` in ``seconds since ...``, which must agree. Numbers are unpacked as the attributes
    say, missing ones are NaN; see :mod:`streams.files.packing`.

    Raises:
        ReaderError: as :func:`streams.files.formats.hdf5.read_hdf5`, whose arguments it takes; without patterns it
            reads all variables but coordinates.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    arrays, owned = _classic(data, name) if data[:3] == b"CDF" else _netcdf4(data, name)
    coordinates = {key for key, (_, facts) in arrays.items() if facts.get("class") == "DIMENSION_SCALE"}
    chosen: list[tuple[str, NDArray[np.floating], Facts]] = []
    marks = [key for key in arrays if matches_pulses(pulses, key, key.rpartition("/")[0])]
    time = _time(arrays, owned, name, zone)
    for key, (array, facts) in arrays.items():
        taken = any(fnmatchcase(key, p) for p in patterns) if patterns else key not in coordinates and key not in _TIMES
        if not taken or key in marks or array.dtype.kind not in "fiu" or array.size < 2:
            continue
        where = f"{name}: variable {key}"
        values, facts = unpacked(array, owned[key], facts, where, (netcdf_fill(array.dtype),))
        rows = rows_of(values, where)
        chosen.append((key, rows, {**facts, **time[1]} if rows.shape[1] == time[0] else facts))
    held = ", ".join(f"{key}{list(array.shape)}" for key, (array, _) in list(arrays.items())[:12]) or "no variable"
    none = f"no vector matches {', '.join(patterns) or '*'}; it holds {held}"
    samples = join_arrays(chosen, name, zone, none, wanted, slow, disregard)
    tacho = None if pulses is None else only_one(marks, pulses, name)
    if tacho is None:
        return samples
    times, facts = arrays[tacho]
    own, where = own_facts(owned[tacho], facts), f"{name}: variable {tacho}"
    return with_pulses(samples, unpacked(times, own, own, where, (netcdf_fill(times.dtype),))[0], own, zone, where)


def _netcdf4(data: Data, name: str) -> _Variables:
    arrays: dict[str, tuple[NDArray[Any], Facts]] = {}
    owned: dict[str, Facts] = {}
    budget = Budget(name, len(data))
    with open_hdf5(data, name) as file:
        for item in walk(file, name):
            if _is_variable(item):
                arrays[item.path], owned[item.path] = (load(item, name, budget), item.facts), item.own
                budget.add_rows(1)
    return arrays, owned


def _is_variable(item: Found) -> bool:
    # A dimension without values is stored as a data set that says so in its name.
    named = str(item.own.get("name", "")).startswith("This is a netCDF dimension but not a netCDF variable")
    return not named and item.dataset.dtype.kind in "fiu" and bool(item.dataset.shape)


def _classic(data: Data, name: str) -> _Variables:
    found: dict[str, tuple[NDArray[Any], Facts]] = {}
    owned: dict[str, Facts] = {}
    mapped = isinstance(data, FileBytes)
    with readable(name, "a readable netCDF file"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with (
            stream_of(data) as stream,
            scipy.io.netcdf_file(stream, "r", mmap=mapped, maskandscale=False) as file,
        ):
            shared = attribute_facts(file._attributes.items())
            for key, variable in file.variables.items():
                owned[str(key)] = own = attribute_facts(variable._attributes.items())
                facts = nearest(shared, own, "of the file")
                found[str(key)] = variable.data if mapped else np.array(variable.data), facts
    if not found and len(data) > 32:
        raise ReaderError("unreadable", f"{name}: holds no variable")
    return found, owned


def _time(
    arrays: dict[str, tuple[NDArray[Any], Facts]], owned: dict[str, Facts], name: str, zone: str
) -> tuple[int, Facts]:
    """Return the length of a coordinate of times, and what it states, under ``KEY#PLACE``; 0 without one."""
    key = next((key for key in _TIMES if key in arrays), None)
    times, facts = arrays[key] if key is not None else (np.zeros((0, 0)), {})
    words = str(facts.get("units", "")).strip().split(maxsplit=2)
    size = TIME_UNITS.get(plain_unit(words[0])) if words else None
    if key is None or times.ndim != 1 or times.dtype.kind not in "fiu" or size is None or not len(times):
        return 0, {}
    times, _ = unpacked(times, owned[key], owned[key], f"{name}: variable {key}")
    found: dict[str, object] = {}
    rate = rate_of_times(times if size == 1.0 else times * size, name)
    if rate is not None:
        found[f"rate#the coordinate {key}"] = rate
    epoch = seconds_utc(words[2].replace(" UTC", "+00:00"), zone) if len(words) == 3 and words[1] == "since" else None
    if epoch is not None:
        found[f"start#the coordinate {key}"] = epoch + float(times[0]) * size
    return len(times), found
