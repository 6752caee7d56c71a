"""Published files as the second copy of a store: their group ``ledger``, and none that holds more is replaced.

Of a netCDF-4 file every variable is declared before the first value: between a declaration and a value the library
writes all that it has declared so far, so that the time of ``Dataset.to_netcdf``, which alternates between them, grows
with the square of the number of variables.
"""

from __future__ import annotations

import json
import logging
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import netCDF4
import numpy as np
import xarray as xr
from xarray.backends import NetCDF4DataStore

from monitor.records.durable import link_durably, same_file
from monitor.records.events import EventLog
from monitor.records.store import Store

Encoding = Mapping[str, Mapping[str, Any]]


class _ValuesLast:
    """Writer of xarray that keeps the values of declared variables until :meth:`write`."""

    def __init__(self) -> None:
        self._pending: list[tuple[Any, Any]] = []

    def add(self, source: Any, target: Any, region: Any = None) -> None:
        """Take the values of a variable; xarray calls this for each that it declares."""
        self._pending.append((source, target))

    def write(self) -> None:
        """Write all values."""
        for source, target in self._pending:
            target[...] = source


def write_netcdf(path: Path, groups: Mapping[str, tuple[xr.Dataset, Encoding]]) -> None:
    """Write datasets as groups of one new file, "" being the root; readers see what ``Dataset.to_netcdf`` writes.

    Raises:
        OSError, RuntimeError: the file cannot be written.
    """
    writer = _ValuesLast()
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        for name, (dataset, encoding) in groups.items():
            store = NetCDF4DataStore(file.createGroup(name) if name else file)
            dataset.dump_to_store(store, writer=writer, encoding=encoding)
        writer.write()


def read_variables(path: Path, names: Iterable[str]) -> dict[str, list[Any]]:
    """Return the values of some variables of a file as they are stored.

    It takes half of the time of ``xarray.open_dataset``, which also reads all other variables' attributes.

    Raises:
        OSError, RuntimeError: the file cannot be read.
        KeyError: it has no such variable.
    """
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        return {name: file.variables[name][...].tolist() for name in names}


_LOG = logging.getLogger(__name__)
UNREADABLE = (OSError, RuntimeError, ValueError, KeyError, AttributeError)
"""Raised for a file that is damaged, or none of records."""
_IDENTITY = ("source", "sequence", "content_hash", "status")
_ROWS = """
SELECT source, sequence, blocks.id, (SELECT min(events.id) FROM events WHERE block = blocks.id), runs.attributes,
    layouts.layout, ledger, content, (SELECT issued_utc FROM forecasts WHERE block = blocks.id LIMIT 1),
    (SELECT '[' || coalesce(group_concat(body), '') || ']' FROM (SELECT body FROM forecasts WHERE block = blocks.id
        ORDER BY forecasts.id))
FROM blocks JOIN records ON records.block = blocks.id JOIN runs ON runs.id = run
JOIN layouts ON layouts.id = records.layout LEFT JOIN digests ON digests.block = blocks.id WHERE day IS ?
"""
_NUMBERS = ("block", "first_event", "ledger_digest", "content_digest")
_FILES = "SELECT * FROM files WHERE block IN (SELECT id FROM blocks WHERE day IS ?) ORDER BY block"


class KeptFile(NamedTuple):
    """A published file that was not lost: its name, the name under which it is kept, and the blocks that only it has.

    The number of blocks is None where the file cannot be read.
    """

    file: str
    aside: str
    blocks: int | None

    def notice(self) -> dict[str, Any]:
        """Return the notice for the event log."""
        what = "cannot be read" if self.blocks is None else f"holds {self.blocks} records that the store lacks"
        text = f"{self.file} {what}; it is kept as {self.aside}"
        return {"kind": "records_kept", "channel": None, "severity": "danger", "text": text, **self._asdict()}


def keep_larger(path: Path, dataset: xr.Dataset) -> KeptFile | None:
    """Give a file another name where it holds blocks that its replacement lacks, or cannot be read.

    Raises:
        OSError: the other name cannot be given.
    """
    if not path.exists() or not path.stat().st_size:
        return None
    lost = lost_blocks(path, dataset)
    if lost == 0:
        return None
    number = 1
    while (aside := path.with_name(f"{path.name}.lost-{number}")).exists() and not same_file(path, aside):
        number += 1
    if not aside.exists():
        link_durably(path, aside)
    return KeptFile(path.name, aside.name, lost)


def lost_blocks(before: Path, after: Path | xr.Dataset) -> int | None:
    """Return how many blocks of a file another, or a dataset, lacks; None where one cannot be read."""
    with suppress(*UNREADABLE):
        return len(_identities(before) - _identities(after))
    return None


def _identities(blocks: Path | xr.Dataset) -> set[tuple[Any, ...]]:
    """Return source, number, content and status of each block of a file or dataset."""
    if isinstance(blocks, Path):
        return set(zip(*read_variables(blocks, _IDENTITY).values(), strict=True))
    return set(zip(*(blocks[name].values.tolist() for name in _IDENTITY), strict=True))


def log_kept(store: Store, kept: KeptFile) -> None:
    """Log a file that is kept, also in the event log of a store that is open for writing."""
    _LOG.error("%s", kept.notice()["text"])
    if store.writable:
        with EventLog(store.path) as log:
            log.notice(time.time(), kept.notice())


class _Row(NamedTuple):
    """What the variables of a record lack: digests are 0 where there are none."""

    block: int
    first_event: int
    run: str
    layout: str
    ledger_digest: int
    content_digest: int
    issued_utc: float
    forecasts: str


def ledger_group(store: Store, day: int | None, dataset: xr.Dataset, path: Path) -> xr.Dataset:
    """Build the group ``ledger`` for the rows of a day's dataset.

    Rows of blocks that the store holds no more in full are those of the present file at ``path``.
    """
    found: dict[tuple[str, int], _Row] = {}
    for source, sequence, block, event, run, layout, ledger, content, issued, forecasts in store.rows(_ROWS, day):
        entry, record = (int.from_bytes(digest or b"", "little", signed=True) for digest in (ledger, content))
        issued_utc = math.nan if issued is None else issued
        found[source, sequence] = _Row(block, event or 0, run, layout, entry, record, issued_utc, forecasts)
    keys = list(zip(dataset["source"].values.tolist(), dataset["sequence"].values.tolist(), strict=True))
    files = _files_of(store, day)
    if not found.keys() >= set(keys):
        older, older_files = _older_group(path)
        found, files = older | found, list(dict.fromkeys((*older_files, *files)))
    rows = [found.get(key, _Row(0, 0, "{}", "", 0, 0, math.nan, "[]")) for key in keys]
    return xr.Dataset(
        {
            **{name: ("time", np.array([getattr(row, name) for row in rows], dtype=np.int64)) for name in _NUMBERS},
            "issued_utc": ("time", np.array([row.issued_utc for row in rows], dtype=np.float64)),
            "forecasts": ("time", np.array([row.forecasts for row in rows], dtype=object)),
            **_listed("run", [row.run for row in rows]),
            **_listed("layout", [row.layout for row in rows]),
            **({"files": ("files", np.array(files, dtype=object))} if files else {}),
        }
    )


def _listed(name: str, texts: Sequence[str]) -> dict[str, Any]:
    """Return texts of which many are equal as places in a list."""
    places = {text: place for place, text in enumerate(dict.fromkeys(texts))}
    return {
        name: ("time", np.array([places[text] for text in texts], dtype=np.int64)),
        f"{name}s": (f"{name}s", np.array(list(places), dtype=object)),
    }


def _older_group(path: Path) -> tuple[dict[tuple[str, int], _Row], list[str]]:
    """Return rows by source and number, and input files, of the group of a file; none where it has no such group."""
    with suppress(*UNREADABLE), xr.open_dataset(path, decode_cf=False) as dataset:
        keys = zip(dataset["source"].values.tolist(), dataset["sequence"].values.tolist(), strict=True)
        with xr.open_dataset(path, group="ledger", decode_cf=False) as group:
            columns = {name: group[name].values.tolist() for name in _Row._fields}
            for name in ("run", "layout"):
                texts = group[f"{name}s"].values.tolist()
                columns[name] = [texts[place] for place in columns[name]]
            files = group["files"].values.tolist() if "files" in group.variables else []
        rows = zip(*columns.values(), strict=True)
        return {key: _Row(*values) for key, values in zip(keys, rows, strict=True)}, files
    return {}, []


def _files_of(store: Store, day: int | None) -> list[str]:
    """Return what is known of the input files whose latest block is of the day, as JSON."""
    columns = [row[1] for row in store.rows("PRAGMA table_info(files)")]
    if "block" not in columns:
        return []
    return [json.dumps(dict(zip(columns, row, strict=True))) for row in store.rows(_FILES, day)]
