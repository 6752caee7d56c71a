"""Publish the store as netCDF files, one a UTC day and machine, each replaced atomically.

Readers see the old or the new file; a reader with the old file open does not block the writer. All files can be made
again from the store, and the store from them: the group ``ledger`` of each file has what the variables for people lack.
A file that holds blocks that its replacement lacks is kept as ``NAME.nc.lost-N``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from models.words.errors import SpallwatchError
from monitor.health.schema import SCHEMA_VERSION, VARIABLES
from monitor.records.condense import condensed_up_to, has_condensed
from monitor.records.dataset import INT_FILL, from_dataset, to_dataset
from monitor.records.durable import make_folder, replacing
from monitor.records.filing import SECONDS_PER_DAY, published_files
from monitor.records.published_folder import (
    MovedDaysError,
    Snapshot,
    delete_day,
    is_published,
    moved_days,
    moving_days,
    snapshot_path,
    take_snapshot,
    write_snapshot,
)
from monitor.records.queries import condensed_of_day
from monitor.records.second_copy import KeptFile, keep_larger, ledger_group, log_kept, write_netcdf
from monitor.records.store import Published, Store

_SUMMARY = (
    "What each block of acceleration said about the health of a rolling bearing: indicators, fault lines of the "
    "envelope spectrum, stage of life, equivalent damaged volume and time to threshold."
)
_OWN = ("history", "date_created", "source", "product_version")
"""Attributes of the file itself, which those of an older one do not join."""
_KEYWORDS = "rolling bearing, vibration, envelope spectrum, condition monitoring, prognostics"
MAX_ID = (1 << 63) - 1


class PublishError(SpallwatchError):
    """A file of records cannot be written; the message names file and cause. The old file is intact."""


def publish(
    store: Store,
    records_dir: Path,
    *,
    rebuild: bool = False,
    note: Callable[[Published], None] | None = None,
    note_kept: Callable[[KeptFile], None] | None = None,
) -> list[Path]:
    """Write the files of the days that changed since they were last written, or whose file is lost or damaged.

    The snapshot is written after them, also where it alone has changed: a stream was reset, an alarm acknowledged.

    Args:
        store: open for reading or writing.
        records_dir: folder of the files, made where it is missing.
        rebuild: write all days again.
        note: called with each written file; by default a store that is open for writing notes it.
        note_kept: called with each file that is kept because it holds more; by default it is a notice likewise.

    Returns:
        The files written, by day, the undated one first.

    Raises:
        PublishError, StoreError: a file cannot be written, the store cannot be read.
    """
    written: list[Path] = []
    snapshot = take_snapshot(store)
    for day, last_block in days(store, snapshot.last_block):
        path = Path(records_dir) / file_name(store.machine, day)
        # One state of the store: blocks are condensed meanwhile.
        with _snapshot(store), moving_days(store.path):
            if not rebuild and _is_fresh(store, path, day, last_block):
                continue
            older = _older(store, path, day)
            dataset = day_dataset(store, day, older, last_block)
            if (kept := _keep(path, dataset)) is not None:
                (note_kept or partial(log_kept, store))(kept)
            size = _write(dataset, ledger_group(store, day, dataset, older), path)
        done = Published(path.name, day, last_block, size)
        if note is not None:
            note(done)
        elif store.writable:
            store.note_published(done)
        written.append(path)
    if written or not is_published(snapshot, records_dir):
        _write_snapshot(store, snapshot, records_dir)
    return written


def _older(store: Store, path: Path, day: int | None) -> Path:
    """Return the file with the condensed records of a day: the present one or, where it can be reached, the moved."""
    if not path.exists() and condensed_of_day(store, day):
        # Without a register, the new file says how many records are elsewhere.
        with suppress(MovedDaysError):
            for entry in moved_days(path.parent, store.machine):
                if entry.file == path.name and entry.to is not None and (moved := Path(entry.to) / path.name).exists():
                    return moved
    return path


def _write_snapshot(store: Store, snapshot: Snapshot, records_dir: Path) -> None:
    """Write the snapshot that was taken before the files."""
    paths = [records_dir / file_name(store.machine, day) for day, _ in days(store)]
    try:
        make_folder(records_dir)
        sizes = {path.name: path.stat().st_size for path in paths if path.exists()}
        write_snapshot(replace(snapshot, files=sizes), records_dir)
    except OSError as error:
        path = snapshot_path(records_dir, store.machine)
        raise PublishError(f"{path}: cannot be written: {error}") from error


def file_name(machine: str, day: int | None) -> str:
    """Return MACHINE-YYYYMMDD.nc for a UTC day (days since 1970), or MACHINE-undated.nc.

    PublishError where the machine's name cannot be part of a file name.
    """
    if not machine or "/" in machine or "\0" in machine:
        raise PublishError(f"machine name {machine!r} cannot be part of a file name")
    label = "undated" if day is None else _midnight(day).strftime("%Y%m%d")
    return f"{machine}-{label}.nc"


def day_dataset(store: Store, day: int | None, path: Path | None = None, last_block: int = MAX_ID) -> xr.Dataset:
    """Build the dataset of a UTC day (days since 1970) or of the undated records, up to a block of the ledger.

    Records that are condensed in the store are taken from the older file at ``path``; where it is missing, the
    attribute ``records_elsewhere`` counts them.
    """
    rows = list(store.stored_on(day, last_block))
    attributes = _globals(store, day)
    elsewhere = condensed_of_day(store, day)
    if elsewhere and path is not None and path.exists():
        older = _read(path)
        known = {(row.source, row.sequence) for row in rows}
        restored = [row for row in from_dataset(older) if (row.source, row.sequence) not in known]
        rows += restored
        elsewhere = max(0, elsewhere - len(restored))
        made_with = [key for key in attributes if key in older.attrs and key not in _OWN]
        attributes |= {key: _united(older.attrs[key], attributes[key]) for key in made_with}
    if day is not None and rows:
        attributes |= _coverage([row.filing.time for row in rows])
    if elsewhere:
        attributes["records_elsewhere"] = elsewhere
    return to_dataset(rows, dated=day is not None, attributes=attributes)


def _read(path: Path) -> xr.Dataset:
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as dataset:
            return dataset.load()
    except (OSError, RuntimeError, ValueError) as error:
        raise PublishError(f"{path}: holds records that the store has no more, and cannot be read: {error}") from error


def days(store: Store, last_block: int = MAX_ID) -> list[tuple[int | None, int]]:
    """Return each day with the number of its last block up to one of the ledger, the undated axis (None) first."""
    found: list[tuple[int | None, int]] = []
    undated = store.rows("SELECT max(id) FROM blocks WHERE day IS NULL AND id <= ?", last_block)[0][0]
    if undated is not None:
        found.append((None, undated))
    day = store.rows("SELECT min(day) FROM blocks")[0][0]
    while day is not None:
        last, following = store.rows(
            "SELECT (SELECT max(id) FROM blocks WHERE day = ? AND id <= ?),"
            " (SELECT min(day) FROM blocks WHERE day > ?)",
            *(day, last_block, day),
        )[0]
        found += [] if last is None else [(day, last)]
        day = following
    return found


@contextmanager
def _snapshot(store: Store) -> Iterator[None]:
    """Let all reading inside see one state of the store, whatever its writer does meanwhile."""
    store.rows("BEGIN")
    try:
        yield
    finally:
        store.rows("ROLLBACK")


def published_bytes(records_dir: Path, machine: str) -> int:
    """Return the size of all published files of a machine."""
    sizes = []
    for path in published_files(records_dir, machine):
        with suppress(OSError):
            sizes.append(path.stat().st_size)
    return sum(sizes)


def missing_files(store: Store, records_dir: Path) -> list[str]:
    """Return the files that are not in the folder although the store has their records no more, but for moved days."""
    on_purpose = {moved.file for moved in moved_days(records_dir, store.machine)}
    names = [name for name, _, _ in _condensed_files(store)]
    return [name for name in names if name not in on_purpose and not (records_dir / name).exists()]


def delete_oldest(store: Store, records_dir: Path, size: int, utc: float) -> list[str]:
    """Delete the oldest published days, at least ``size`` bytes, but none of which the store has full records."""
    deleted: list[str] = []
    with store.connection() as connection:
        end = condensed_up_to(connection)
    for name, day, last_block in _condensed_files(store):
        path = records_dir / name
        if size <= 0:
            break
        if day is not None and last_block <= end and path.exists():
            size -= delete_day(path, store.machine, store.path, utc).size
            deleted.append(name)
    return deleted


def _condensed_files(store: Store) -> list[tuple[str, int | None, int]]:
    """Return file, day and last block of the published days with condensed blocks, the oldest first."""
    query = (
        "SELECT file, published.day, last_block FROM published JOIN condensed_days AS old ON published.day IS old.day"
    )
    with store.connection() as connection:
        return store.rows(f"{query} ORDER BY published.day") if has_condensed(connection) else []


def _is_fresh(store: Store, path: Path, day: int | None, last_block: int) -> bool:
    """Return whether a file has its size as written and the day's last block, or is not there on purpose."""
    row = store.rows("SELECT last_block, size FROM published WHERE file = ?", path.name)
    if not row or row[0][0] < last_block:
        return False
    condensed = condensed_of_day(store, day) > 0
    try:
        return path.stat().st_size == row[0][1] and (condensed or row[0][0] == last_block)
    except OSError:
        # What is left in the store is less than the file had.
        return condensed or path.name in {moved.file for moved in moved_days(path.parent, store.machine)}


def _keep(path: Path, dataset: xr.Dataset) -> KeptFile | None:
    try:
        return keep_larger(path, dataset)
    except OSError as error:
        raise PublishError(f"{path}: cannot be kept under another name: {error}") from error


def _write(dataset: xr.Dataset, ledger: xr.Dataset, path: Path) -> int:
    """Replace a file; return its size in bytes."""
    try:
        make_folder(path.parent)
        with replacing(path) as temporary:
            fills = {str(name): {"_FillValue": None} for name in ledger.variables}
            write_netcdf(temporary, {"": (dataset, encoding_of(dataset)), "ledger": (ledger, fills)})
            size = temporary.stat().st_size
    except (OSError, RuntimeError) as error:
        raise PublishError(f"{path}: cannot be written: {error}") from error
    return size


def encoding_of(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return the fill value of each variable; flags have none."""
    kinds = {"elapsed": "float", **{name: variable.kind for name, variable in VARIABLES.items()}}
    fills = {"float": np.nan, "int": INT_FILL}
    return {name: {"_FillValue": fills.get(kinds.get(name, ""))} for name in map(str, dataset.variables)}


def _globals(store: Store, day: int | None) -> dict[str, Any]:
    """Return the global attributes of a day: CF, ACDD, and those of its runs."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    runs = store.rows(
        "SELECT attributes FROM runs WHERE id IN (SELECT DISTINCT run FROM blocks WHERE day IS ?) ORDER BY id", day
    )
    made_with = _merged(json.loads(row[0]) for row in runs)
    when = "without a date" if day is None else f"on {_midnight(day):%Y-%m-%d} UTC"
    result: dict[str, Any] = {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": f"Bearing health records of {store.machine} {when}",
        "summary": _SUMMARY,
        "keywords": _KEYWORDS,
        "id": file_name(store.machine, day).removesuffix(".nc"),
        "machine": store.machine,
        "source": f"spallwatch {made_with.get('software_version', 'unknown')}, from recorded acceleration",
        "history": f"{now} published from the store by spallwatch",
        "processing_level": "health indicators of blocks of acceleration",
        "date_created": now,
        "product_version": str(SCHEMA_VERSION),
    }
    return {**result, **made_with}


def _coverage(times: Sequence[float]) -> dict[str, str]:
    first, last = min(times), max(times)
    return {
        "time_coverage_start": _iso(first),
        "time_coverage_end": _iso(last),
        "time_coverage_duration": f"PT{last - first:.3f}S",
    }


def _merged(runs: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Merge the attributes of several runs; where they differ, list all values in order."""
    found: dict[str, list[Any]] = {}
    for run in runs:
        for key, value in run.items():
            values = found.setdefault(key, [])
            if value not in values:
                values.append(value)
    return {key: values[0] if len(values) == 1 else "; ".join(map(str, values)) for key, values in found.items()}


def _united(older: Any, newer: Any) -> Any:
    """Join an attribute of a file with that of the records which are added to it."""
    if older == newer:
        return newer
    return "; ".join(dict.fromkeys(part for value in (older, newer) for part in str(value).split("; ")))


def _midnight(day: int) -> datetime:
    return datetime.fromtimestamp(day * SECONDS_PER_DAY, UTC)


def _iso(time: float) -> str:
    moment = datetime.fromtimestamp(0, UTC) + timedelta(seconds=time)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
