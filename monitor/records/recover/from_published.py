"""Records that only the published files still hold, proven by their digests.

A published file has all values of a record, but not their layout in the store. The digest of the ledger entry
identifies the block of a row, and the digest of the content proves the record made of it. Files are read in a process
of its own, so that the daemon does not load netCDF.
"""

from __future__ import annotations

import base64
import json
import logging
import math
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import VARIABLES
from monitor.records.filing import SECONDS_PER_DAY, ledger_digest
from monitor.records.packing import channels_of, entries_of

_LOG = logging.getLogger(__name__)
_TIMEOUT_S = 600.0
_START = """
import json, sys
sys.path[:] = json.loads(sys.argv.pop())
from monitor.records.recover.from_published import main
main()
"""
_TEXTS = ("source", "content_hash", "name", "status", "flags", "reason", "events")
_TIME_STATUSES = ("given", "carried", "unknown")


class Piece(NamedTuple):
    """A row of a published file that is a lost block.

    Attributes:
        ledger: digest of its ledger entry.
        entry: the ledger entry, see :func:`monitor.records.filing.ledger_digest`.
        rows: number of each layout that its values fit, and the packed row.
        events: JSON.
    """

    ledger: bytes
    entry: tuple[Any, ...]
    rows: tuple[tuple[int, bytes], ...]
    events: tuple[str, ...]


Restore = Callable[[Sequence[bytes], Sequence[tuple[int, str]]], Iterator[Piece]]
"""Yields pieces for digests of ledger entries and numbered layouts."""


def from_published(records_dir: Path, machine: str) -> Restore:
    """Return a search in the published files of a machine; unreadable files are skipped."""

    def restore(wanted: Sequence[bytes], layouts: Sequence[tuple[int, str]]) -> Iterator[Piece]:
        files = sorted(str(path) for path in records_dir.glob(f"{machine}-*.nc"))
        if not wanted or not files:
            return
        request = {"files": files, "wanted": [digest.hex() for digest in wanted], "layouts": list(layouts)}
        command = [sys.executable, "-c", _START, json.dumps(sys.path)]
        try:
            answer = subprocess.run(
                command, input=json.dumps(request), capture_output=True, text=True, check=True, timeout=_TIMEOUT_S
            )
        except (OSError, subprocess.SubprocessError) as error:
            _LOG.error("nothing is taken from the published files: %s", error)
            return
        for line in answer.stdout.splitlines():
            found = json.loads(line)
            rows = tuple((number, base64.b64decode(text)) for number, text in found["rows"])
            yield Piece(bytes.fromhex(found["ledger"]), tuple(found["entry"]), rows, tuple(found["events"]))

    return restore


def main() -> None:
    """Answer the request on standard input with one JSON object a line for each row found."""
    request = json.load(sys.stdin)
    wanted = set(request["wanted"])
    layouts = [(number, text) for number, text in request["layouts"]]
    for file in request["files"]:
        for answer in _matching(Path(file), wanted, layouts):
            sys.stdout.write(json.dumps(answer) + "\n")


def _matching(path: Path, wanted: set[str], layouts: Sequence[tuple[int, str]]) -> Iterator[dict[str, Any]]:
    import xarray as xr

    try:
        with xr.open_dataset(path, decode_times=False, mask_and_scale=False) as dataset:
            dated = dataset.attrs["dated"] == "yes"
            ledger = {name: dataset[name].values for name in (*_TEXTS, "sequence", "time", "time_status", "elapsed")}
            columns = {name: dataset[name].values for name in VARIABLES if name in dataset.variables}
            channels = [str(channel) for channel in dataset["channel"].values]
    except (OSError, RuntimeError, ValueError, KeyError):
        return
    for place in range(len(ledger["time"])):
        found = _entry(ledger, place, wanted, dated=dated)
        if found is None:
            continue
        digest, entry = found
        values = {name: column[place] for name, column in columns.items()}
        rows = ((number, _packed(text, channels, values)) for number, text in layouts)
        yield {
            "ledger": digest,
            "entry": entry,
            "rows": [(number, base64.b64encode(row).decode()) for number, row in rows if row is not None],
            "events": [json.dumps(event) for event in json.loads(str(ledger["events"][place]))],
        }


def _entry(
    ledger: Mapping[str, NDArray[Any]], place: int, wanted: set[str], *, dated: bool
) -> tuple[str, list[Any]] | None:
    """Return digest and ledger entry of a wanted row; a rejected block may have had no time."""
    source, content_hash, name, status, flags, reason = (str(ledger[key][place]) for key in _TEXTS[:-1])
    axis = float(ledger["time"][place])
    elapsed = float(ledger["elapsed"][place])
    day = int(axis // SECONDS_PER_DAY) if dated else None
    filing = (day, axis, _TIME_STATUSES[int(ledger["time_status"][place])])
    for time in (axis, None):
        entry = [source, int(ledger["sequence"][place]), content_hash, name, status, flags, reason, time]
        entry += [None if math.isnan(elapsed) else elapsed, *filing]
        digest = ledger_digest(entry).hex()
        if digest in wanted:
            return digest, entry
    return None


def _packed(layout: str, channels: Sequence[str], values: Mapping[str, NDArray[Any]]) -> bytes | None:
    """Return the packed values of a row, or None where they do not fit the layout."""
    if not set(channels_of(layout)) <= set(channels):
        return None
    parts: list[NDArray[np.float64]] = []
    for entry in entries_of(layout):
        if entry.shape is None:
            continue
        variable = VARIABLES[entry.variable]
        column = values.get(entry.variable)
        if column is None:
            return None
        value = np.asarray(column[channels.index(entry.channel)], dtype=np.float64)
        if variable.kind != "float":
            # Absent is 0 in a mask, and -1 otherwise.
            value = np.where(value == (0.0 if variable.kind == "mask" else -1.0), np.nan, value)
        while value.ndim < len(entry.shape):
            value = value[np.newaxis]
        while value.ndim > len(entry.shape):
            value = value[0]
        if any(size > there for size, there in zip(entry.shape, value.shape, strict=True)):
            return None
        parts.append(value[tuple(slice(size) for size in entry.shape)].reshape(-1))
    row = np.concatenate(parts) if parts else np.empty(0)
    row[np.isnan(row)] = np.nan
    return row.astype("<f8").tobytes()
