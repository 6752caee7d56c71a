"""Archives of records as datasets: one recording in memory, or all of them lazily."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from models.words.errors import SpallwatchError
from models.work.filesystem import is_below
from models.work.folder_store import FolderStore, open_store
from models.work.redact import redact
from monitor.fleet.arrays import ARCHIVE_VERSION, CHANNEL, PART, RECORDING, ROW, UNDATED
from monitor.fleet.result import RESULT_NAME, RecordingResult
from monitor.health.schema import VARIABLES
from monitor.records.dataset import LEDGER
from spallwatch.records import BESIDE_VARIABLES, RecordsError, joined_files, prepared

if TYPE_CHECKING:
    from zarr.storage import StoreLike

STORE = "records.zarr"
"""The Zarr store in the folder of an archive."""
_LEDGER = (*LEDGER, "time_status")


def open_archive(
    url: str | PathLike[str],
    *,
    machine: str | None = None,
    recording: str | None = None,
    variables: Sequence[str] | None = None,
    channels: Sequence[str] | None = None,
    dated: bool | None = None,
) -> xr.Dataset:
    """Open the records of an archive, of ``spallwatch archive replay``, which are read when they are computed.

    Args:
        url: the output of the archive, a folder or an object storage, or its Zarr store.
        machine: rows of this machine alone.
        recording: this recording of the machine alone, in memory as from ``open_records``.
        variables: names of those that are wanted, by default all; the ledger is always there.
        channels: of one recording, by default all.
        dated: of one recording, which blocks, where some have dates and some have none.

    Returns:
        Of one recording, as ``open_records``. Else dimensions (row, channel, part, harmonic, ...) with dask arrays:
        rows of all recordings one after another, ``time`` as dates (UTC), and along ``recording`` the table of
        recordings, with ``machine``, ``recording_name``, ``first_row``, ``row_size``, ``recording_status``,
        ``recording_reason`` and ``url``; ``recording_index`` is the place of a row in it. Words are integers, with
        ``flag_meanings``.

    Raises:
        RecordsError: there is no archive or it is not complete, or it has no such machine, recording or variable.
    """
    if unknown := sorted(set(variables or ()) - set(VARIABLES)):
        raise RecordsError(f"variables: {unknown[0]!r} is not a variable of records; expected {', '.join(VARIABLES)}")
    if recording is not None and machine is None:
        raise RecordsError(f"recording {recording!r}: name its machine too, since two machines may have one such")
    place = _store_of(fspath(url))
    if place is None:
        if machine is None or recording is None:
            raise RecordsError(f"{fspath(url)}: holds no {STORE}; of an archive of days, name machine and recording")
        with _files_of(fspath(url), machine, recording) as files:
            return joined_files(files, f"{redact(fspath(url))}/{machine}/{recording}", variables, channels, dated)
    if recording is not None and machine is not None:
        raw = _opened(place, lazily=False)
        try:
            return _one(raw, _row_of(raw, place, machine, recording), place, variables, channels, dated)
        except RecordsError:
            raise
        except Exception as error:  # As above: of values that nothing here wrote.
            raise RecordsError(f"{redact(place)}: cannot be read: {type(error).__name__}: {error}") from None
    if channels is not None or dated is not None:
        raise RecordsError("channels and dated are of one recording; name machine and recording")
    lazy = _opened(place, lazily=True)
    if variables is not None:
        lazy = lazy.drop_vars([name for name in map(str, lazy.variables) if name in set(VARIABLES) - set(variables)])
    return lazy if machine is None else _of_machine(lazy, place, machine)


@contextmanager
def _files_of(url: str, machine: str, recording: str) -> Iterator[list[Path]]:
    """Give the files that the result of a recording names, from object storage copies of them.

    Others may be beside them: of an attempt that failed, of a replay that was interrupted.
    """
    store, name = open_store(url), f"{machine}/{recording}"
    try:
        data = store.read(f"{name}/{RESULT_NAME}")
        result = None if data is None else RecordingResult.from_json(data)
    except (ValueError, KeyError, TypeError) as error:
        raise RecordsError(f"{redact(url)}: {name}/{RESULT_NAME} cannot be read: {error}") from None
    if result is None or not result.files:
        reason = result.reason if result is not None else f"there is no {RESULT_NAME}"
        raise RecordsError(f"{redact(url)}: holds no records of {name}{f': {reason}' if reason else ''}")
    if outside := [file.name for file in result.files if not is_below(file.name)]:
        raise RecordsError(f"{redact(url)}: {name}/{RESULT_NAME} names {outside[0]!r}, which leads out of the archive")
    if isinstance(store, FolderStore):
        yield [Path(store.url) / file.name for file in result.files]
        return
    with tempfile.TemporaryDirectory(prefix="spallwatch-") as scratch:
        copies = [Path(scratch) / file.name.rpartition("/")[2] for file in result.files]
        for file, copy in zip(result.files, copies, strict=True):
            if (data := store.read(file.name)) is None:
                raise RecordsError(f"{redact(url)}: {file.name} is missing")
            copy.write_bytes(data)
        yield copies


def _store_of(url: str) -> str | None:
    """Return the place of the Zarr store of an archive, None where there is none.

    RecordsError where it is there without the metadata that are written last.
    """
    for place in (url, f"{url.rstrip('/')}/{STORE}"):
        store = open_store(place)
        if (root := store.read("zarr.json")) is not None:
            _refuse_foreign(place, root)
            return place
        if place != url and next(iter(store.names()), None) is not None:
            raise RecordsError(f"{place}: is not complete; archive replay --resume goes on with it")
    return None


def _refuse_foreign(place: str, root: bytes) -> None:
    try:
        version = json.loads(root)["attributes"]["spallwatch_archive"]
    except (ValueError, KeyError, TypeError):
        raise RecordsError(f"{place}: is a Zarr store, but no archive of spallwatch") from None
    if version > ARCHIVE_VERSION:
        raise RecordsError(f"{place}: has archive version {version}; known are versions up to {ARCHIVE_VERSION}")


def _opened(place: str, *, lazily: bool) -> xr.Dataset:
    try:
        return xr.open_zarr(
            _zarr_store(place),
            consolidated=True,
            zarr_format=3,
            chunks={} if lazily else None,
            decode_cf=lazily,
            decode_timedelta=False,
        )
    except ModuleNotFoundError as error:
        raise RecordsError(
            f'{place}: reading needs the extra cluster: pip install "spallwatch[cluster]" ({error.name} is missing)'
        ) from None
    except SpallwatchError as error:
        raise RecordsError(str(error)) from None
    except Exception as error:  # Of metadata that nothing here wrote, zarr and xarray raise anything.
        raise RecordsError(f"{place}: cannot be read as a Zarr store: {type(error).__name__}: {error}") from None


def _zarr_store(place: str) -> StoreLike:
    from zarr.storage import FsspecStore, LocalStore

    from models.work.filesystem import filesystem
    from monitor.fleet.zarr_reader import WholeStore, chunk_sizes

    files = open_store(place)
    sizes = chunk_sizes(redact(place), files.read("zarr.json") or b"{}")
    if "://" not in place or place.startswith("file://"):
        return WholeStore(LocalStore(files.url, read_only=True), redact(place), sizes)
    system, path = filesystem(place, asynchronous=True)
    return WholeStore(FsspecStore(system, read_only=True, path=path), redact(place), sizes)


def _row_of(raw: xr.Dataset, place: str, machine: str, recording: str) -> int:
    machines, names = (raw[name].values.astype(object) for name in ("machine", "recording_name"))
    found = np.flatnonzero((machines == machine) & (names == recording))
    if not found.size:
        there = sorted(set(names[machines == machine].tolist()))
        if not there:
            raise RecordsError(f"{place}: has no machine {machine!r}; it has {_listed(sorted(set(machines.tolist())))}")
        raise RecordsError(f"{place}: has no recording {recording!r} of {machine}; it has {_listed(there)}")
    return int(found[0])


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")


def _of_machine(lazy: xr.Dataset, place: str, machine: str) -> xr.Dataset:
    """Return the recordings of a machine and their rows; ``recording_index`` and ``first_row`` are of the result."""
    table = np.flatnonzero(lazy["machine"].values.astype(object) == machine)
    if not table.size:
        _row_of(lazy, place, machine, "")
    first, size = (lazy[name].values[table] for name in ("first_row", "row_size"))
    if np.any(first < 0) or np.any(size < 0) or np.any(size > lazy.sizes[ROW] - first):
        raise RecordsError(f"{place}: the rows of {machine} are not among the {lazy.sizes[ROW]} that there are")
    rows = np.concatenate([np.arange(begin, begin + length) for begin, length in zip(first, size, strict=True)])
    contiguous = bool(rows.size) and int(rows[-1]) - int(rows[0]) + 1 == rows.size
    found = lazy.isel({ROW: slice(int(rows[0]), int(rows[-1]) + 1) if contiguous else rows, RECORDING: table})
    index = np.repeat(np.arange(table.size, dtype=np.int32), size)
    return found.assign(
        first_row=(RECORDING, np.cumsum(size) - size, lazy["first_row"].attrs),
        recording_index=(ROW, index, lazy["recording_index"].attrs),
    )


def _one(
    raw: xr.Dataset,
    number: int,
    place: str,
    variables: Sequence[str] | None,
    channels: Sequence[str] | None,
    dated: bool | None,
) -> xr.Dataset:
    """Return one recording as its files hold it."""
    table = raw.isel({RECORDING: number})
    name = f"{place}, {table['machine'].item()}/{table['recording_name'].item()}"
    if not int(table["row_size"]):
        reason = str(table["recording_reason"].item())
        raise RecordsError(f"{name}: holds no records{f': {reason}' if reason else ''}")
    begin, size = int(table["first_row"]), int(table["row_size"])
    rows = raw.isel({ROW: slice(begin, begin + size)})
    has_date = np.isfinite(rows["time"].values)
    if dated is None and has_date.any() and not has_date.all():
        raise RecordsError(f"{name}: some blocks have dates and some have none; choose by dated=True or False")
    wanted = bool(has_date.any()) if dated is None else dated
    chosen = np.flatnonzero(has_date == wanted)
    if not chosen.size:
        raise RecordsError(f"{name}: holds no records {'with' if wanted else 'without'} dates")
    shape: dict[str, dict[str, Any]] = json.loads(str(table["recording_shape"].item()))
    names = [str(text) for text in table["channel_name"].values if str(text)]
    given = {key: dims for key, dims in shape["variables"].items() if variables is None or key in variables}
    given |= dict.fromkeys((*(_LEDGER if variables is None else BESIDE_VARIABLES), "time"), ())
    found = {key: _part_of(rows, key, dims, shape["sizes"], names, chosen, dated=wanted) for key, dims in given.items()}
    used = {dim for variable in found.values() for dim in variable.dims}
    labels = {key: raw[key].variable for key in ("harmonic", "bpfo_harmonic", "coefficient_name")}
    labels["fault_name"] = xr.Variable("fault", raw[PART].values.astype(object), raw[PART].attrs)
    coordinates = {key: label for key, label in labels.items() if used.issuperset(label.dims)}
    attributes = {**json.loads(str(table["made_with"].item())), "machine": str(table["machine"].item())}
    dataset = xr.Dataset(found, {**coordinates, CHANNEL: names}, attributes)
    return prepared(dataset.set_coords("time"), name, channels)


def _part_of(
    rows: xr.Dataset,
    name: str,
    dims: Sequence[str],
    sizes: dict[str, int],
    channels: Sequence[str],
    chosen: Any,
    *,
    dated: bool,
) -> xr.Variable:
    """Return a variable of one recording with the dimensions that it has there."""
    stored = name if dated or f"{name}{UNDATED}" not in rows else f"{name}{UNDATED}"
    array = rows[stored].variable
    kept = {PART if dim == "fault" else dim: len(channels) if dim == CHANNEL else sizes[dim] for dim in dims}
    places = {dim: slice(kept[str(dim)]) if dim in kept else 0 for dim in array.dims if dim != ROW}
    values = array.isel({ROW: chosen, **places})
    found = [{ROW: "time", PART: "fault"}.get(str(dim), str(dim)) for dim in values.dims]
    attributes = {key: value for key, value in array.attrs.items() if key != "coordinates"}
    data = values.values
    return xr.Variable(found, data.astype(object) if data.dtype.kind in "TU" else data, attributes)
