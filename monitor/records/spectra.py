"""Envelope spectra in the store: so many of each channel that a whole life can be drawn, the newest one always there.

Which block's spectrum stays is decided by :mod:`monitor.health.waterfall`; here it is written, in the transaction of
the block, and read. Amplitudes are float16 of amplitude over a scale of their own, which keeps each within 2**-11
(0.05 %) of itself down to 2e-9 of the highest.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.waterfall import Kind, SpectrumChange, SpectrumRow
from monitor.records.database import StoreError

if TYPE_CHECKING:
    from monitor.records.store import Store

_KINDS: dict[Kind, int] = {"newest": 0, "kept": 1, "pinned": 2}
_HALF_RANGE = 32768.0
"""The highest amplitude becomes this: half of what float16 holds, so that the low ones keep their digits."""
_ROW = "source, channel, sequence, time, header, amplitude"


def write_changes(connection: sqlite3.Connection, changes: Iterable[SpectrumChange]) -> None:
    """Write changes within an open transaction, in the order of their blocks; the result is that of one at a time."""
    changes = list(changes)
    last = {(change.row.source, change.row.channel): change for change in changes}
    for change in changes:
        where = (change.row.source, change.row.channel)
        if change.pin_before is not None:
            connection.execute(
                "UPDATE spectra SET kind = 2 WHERE source = ? AND channel = ? AND sequence = (SELECT max(sequence)"
                " FROM spectra WHERE source = ? AND channel = ? AND sequence < ? AND kind > 0)",
                (*where, *where, change.pin_before),
            )
        if change.thin:
            connection.execute(
                "DELETE FROM spectra WHERE rowid IN (SELECT row FROM (SELECT rowid AS row, row_number() OVER"
                " (ORDER BY sequence) AS place FROM spectra WHERE source = ? AND channel = ? AND kind = 1)"
                " WHERE place % 2 = 0)",
                where,
            )
        # One that the next block of the same transaction takes away again need not be written.
        if change.kind != "newest" or last[where] is change:
            _put(connection, change)


def _put(connection: sqlite3.Connection, change: SpectrumChange) -> None:
    """Write a spectrum in the place of the newest, which has the highest number, where that was not to be kept."""
    row = change.row
    packed, scale = pack_amplitude(row.amplitude)
    header = {
        "resolution": row.resolution,
        "band": row.band,
        "speed": row.speed,
        "mean": row.mean,
        "absolute": row.absolute,
        "scale": scale,
        "lines": dict(row.lines),
    }
    text = json.dumps(header, allow_nan=False, separators=(",", ":"))
    values = (row.sequence, row.time, _KINDS[change.kind], text, packed, row.source, row.channel)
    replaced = connection.execute(
        "UPDATE spectra SET sequence = ?1, time = ?2, kind = ?3, header = ?4, amplitude = ?5 WHERE kind = 0 AND rowid ="
        " (SELECT rowid FROM spectra WHERE source = ?6 AND channel = ?7 ORDER BY sequence DESC LIMIT 1)",
        values,
    )
    if not replaced.rowcount:
        connection.execute(
            "INSERT INTO spectra (sequence, time, kind, header, amplitude, source, channel)"
            " VALUES (?, ?, ?, ?, ?, ?, ?)",
            values,
        )


def pack_amplitude(amplitude: NDArray[np.floating]) -> tuple[bytes, float]:
    """Return amplitudes over a scale as little-endian float16, and the scale."""
    scale = float(amplitude.max(initial=0.0)) / _HALF_RANGE
    if scale < np.finfo(np.float32).tiny:
        return bytes(2 * amplitude.size), 1.0
    return (amplitude * (1.0 / np.float64(scale))).astype("<f2").tobytes(), scale


def read_spectra(
    place: Path | Store,
    channel: str,
    *,
    source: str | None = None,
    at: int | None = None,
    before: int | None = None,
    newest: int | None = None,
) -> list[SpectrumRow]:
    """Return the spectra that are kept of a channel, in the order of their blocks; [] where there are none.

    Args:
        place: the store, or its file, which is opened for reading a moment.
        channel: its name.
        source: its source, or None for any.
        at: only that of the block of this number.
        before: only those of the blocks before this number.
        newest: the last so many of them, or None for all.

    Raises:
        StoreError: the store cannot be read.
    """
    conditions, values = _conditions(channel, source, at, before)
    query = f"SELECT {_ROW} FROM spectra WHERE {conditions} ORDER BY sequence DESC LIMIT ?"
    rows = _read(place, query, (*values, -1 if newest is None else newest))
    return [_row_of(row) for row in reversed(rows)]


def kept_blocks(place: Path | Store, channel: str, *, source: str | None = None) -> list[tuple[int, float | None]]:
    """Return number and time of the blocks of which a spectrum is kept, in order, without reading the spectra.

    Raises:
        StoreError: the store cannot be read.
    """
    conditions, values = _conditions(channel, source, None, None)
    query = f"SELECT sequence, time FROM spectra WHERE {conditions} ORDER BY sequence"
    return [(sequence, time) for sequence, time in _read(place, query, values)]


def binned(rows: Sequence[SpectrumRow], bins: int, highest: float | None = None) -> tuple[Any, Any]:
    """Return spectra over common bins of frequency, for a picture: the highest amplitude in each.

    Args:
        rows: of one channel.
        bins: how many, at most.
        highest: upper end, Hz, or None for that of the widest spectrum.

    Returns:
        Lower edges of the bins, Hz, shape (bins,), and amplitudes, shape (row, bins), NaN beyond the end of a spectrum.
        There are no more bins than the coarsest spectrum has below the end, so that none of them is empty in between.

    Raises:
        ValueError: there is nothing to bin.
    """
    if not rows or bins < 1:
        raise ValueError(f"expected at least one spectrum and one bin, got {len(rows)} and {bins}")
    top = max(row.resolution * row.amplitude.size for row in rows)
    top = top if highest is None else min(top, highest)
    bins = max(1, min(bins, *(int(top / row.resolution) for row in rows)))
    width = top / bins
    amplitude = np.full((len(rows), bins), np.nan)
    for out, row in zip(amplitude, rows, strict=True):
        place = np.floor_divide(row.frequency, width).astype(np.intp)
        values = row.amplitude[place < bins]
        places, starts = np.unique(place[place < bins], return_index=True)
        out[places] = np.maximum.reduceat(values, starts)
    return np.arange(bins) * width, amplitude


def _conditions(channel: str, source: str | None, at: int | None, before: int | None) -> tuple[str, tuple[Any, ...]]:
    wanted = {"channel = ?": channel, "source = ?": source, "sequence = ?": at, "sequence < ?": before}
    given = {condition: value for condition, value in wanted.items() if value is not None}
    return " AND ".join(given), tuple(given.values())


def _row_of(row: tuple[Any, ...]) -> SpectrumRow:
    source, channel, sequence, time, text, packed = row
    header = json.loads(text)
    return SpectrumRow(
        source=source,
        channel=channel,
        sequence=sequence,
        time=time,
        resolution=header["resolution"],
        band=(header["band"][0], header["band"][1]),
        speed=header["speed"],
        mean=header["mean"],
        absolute=header["absolute"],
        amplitude=np.frombuffer(packed, dtype="<f2").astype(np.float64) * header["scale"],
        lines=header["lines"],
    )


def _read(place: Path | Store, query: str, values: tuple[Any, ...]) -> list[Any]:
    """Return the rows of a query, none where the store is of a time before there were spectra in it."""
    with _reader(place) as read:
        if not read("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'spectra'"):
            return []
        return read(query, *values)


@contextmanager
def _reader(place: Path | Store) -> Iterator[Any]:
    if not isinstance(place, Path):
        yield place.rows
        return
    try:
        with closing(sqlite3.connect(f"{place.absolute().as_uri()}?mode=ro", uri=True, timeout=5.0)) as connection:
            yield lambda query, *values: connection.execute(query, values).fetchall()
    except sqlite3.Error as error:
        raise StoreError(f"{place}: {error}") from error
