"""Envelope spectra in the store: a limited number of each channel, spread over its life, and always the newest.

:mod:`monitor.health.signal.waterfall` decides which spectra are kept; here they are written, in the transaction of the
block, and read. Amplitudes are float16 over a scale of each spectrum: the relative error is at most 2**-11 (0.05 %)
down to 2e-9 of the highest.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.kurtogram import Kurtogram
from monitor.health.signal.spectra import BlockView, RawSpectra
from monitor.health.signal.waterfall import Kind, SpectrumChange, SpectrumRow
from monitor.records.database import Readable, SharedConnection

if TYPE_CHECKING:
    from monitor.records.store import Store

_KINDS: dict[Kind, int] = {"newest": 0, "kept": 1, "pinned": 2}
_HALF_RANGE = 32768.0
"""Stored value of the highest amplitude: half of the range of float16, for the digits of the lowest."""
_INT16_MAX = 32767.0
_WEEK_S = 604800.0
_MAX_THINNED = 64
"""Spectra that one step deletes."""
_SPEEDS_DIFFER = 0.02
"""Share by which mean speeds of spectra may differ where they are seen over Hz by default."""
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
        # A later block of the same transaction would replace it.
        if change.kind != "newest" or last[where] is change:
            _put(connection, change)


def _put(connection: sqlite3.Connection, change: SpectrumChange) -> None:
    """Write a spectrum; it replaces the one with the highest block number unless that is kept."""
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
    if row.domain != "hertz":
        header["domain"] = row.domain
    if row.speed_range is not None:
        header |= {"speed_range": row.speed_range, "speed_course": row.speed_course}
    if row.kurtogram is not None:
        header["kurtogram"] = row.kurtogram.to_dict()
    view: bytes | None = None
    if row.view is not None:
        header["view"], view = pack_view(row.view)
    text = json.dumps(header, allow_nan=False, separators=(",", ":"))
    values = (row.sequence, row.time, _KINDS[change.kind], text, packed, row.source, row.channel, view)
    replaced = connection.execute(
        "UPDATE spectra SET sequence = ?1, time = ?2, kind = ?3, header = ?4, amplitude = ?5, view = ?8"
        " WHERE kind = 0 AND rowid ="
        " (SELECT rowid FROM spectra WHERE source = ?6 AND channel = ?7 ORDER BY sequence DESC LIMIT 1)",
        values,
    )
    if not replaced.rowcount:
        connection.execute(
            "INSERT INTO spectra (sequence, time, kind, header, amplitude, source, channel, view)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            values,
        )


def thin_spectra(store: Store, older_s: float) -> int:
    """Delete kept spectra, a few at a time; return how many.

    Of those older than ``older_s`` before the newest kept one of their channel, the first of each week stays. Pinned
    ones stay.
    """
    with store.transaction() as connection:
        return thin_within(connection, older_s)


def thin_within(connection: sqlite3.Connection, older_s: float) -> int:
    """Delete kept spectra as :func:`thin_spectra`, within a transaction."""
    query = (
        "SELECT rowid FROM (SELECT rowid, row_number() OVER (PARTITION BY source, channel, CAST(time / ?1 AS INTEGER)"
        " ORDER BY sequence) AS place FROM spectra AS old WHERE kind = 1 AND time < (SELECT max(time) FROM spectra"
        " AS new WHERE new.source = old.source AND new.channel = old.channel) - ?2) WHERE place > 1 LIMIT ?3"
    )
    rows = connection.execute(query, (_WEEK_S, older_s, _MAX_THINNED)).fetchall()
    connection.executemany("DELETE FROM spectra WHERE rowid = ?", rows)
    return len(rows)


def strip_views(connection: sqlite3.Connection, *, whole: bool) -> int:
    """Delete waveforms, or ``whole`` views, of the oldest kept spectra, a few within a transaction; return how many.

    Those of pinned spectra, and of the newest kept one and the newest of each channel, stay.
    """
    wanted = "" if whole else "AND json_extract(header, '$.view.sizes[2]') > 0"
    query = (
        "SELECT rowid, header, view FROM spectra AS old WHERE kind = 1 AND view NOT NULL AND instr(header, '\"view\":')"
        f" {wanted} AND sequence < (SELECT max(sequence) FROM spectra AS new WHERE new.source = old.source"
        " AND new.channel = old.channel AND kind = 1) ORDER BY time, sequence LIMIT ?"
    )
    rows = connection.execute(query, (_MAX_THINNED,)).fetchall()
    for row, text, blob in rows:
        header, kept = json.loads(text), None
        if whole:
            del header["view"]
        else:
            *before, size = header["view"]["sizes"]
            header["view"]["sizes"] = [*before, 0]
            kept = blob[: sum(before)] + blob[sum(before) + size :]
        text = json.dumps(header, allow_nan=False, separators=(",", ":"))
        connection.execute("UPDATE spectra SET header = ?, view = ? WHERE rowid = ?", (text, kept, row))
    return len(rows)


def pack_amplitude(amplitude: NDArray[np.floating]) -> tuple[bytes, float]:
    """Return amplitudes over a scale as little-endian float16, and the scale."""
    scale = float(amplitude.max(initial=0.0)) / _HALF_RANGE
    if scale < np.finfo(np.float32).tiny:
        return bytes(2 * amplitude.size), 1.0
    return (amplitude * (1.0 / np.float64(scale))).astype("<f2").tobytes(), scale


def read_spectra(
    place: Path | Readable,
    channel: str,
    *,
    source: str | None = None,
    at: int | None = None,
    before: int | None = None,
    newest: int | None = None,
) -> list[SpectrumRow]:
    """Return the kept spectra of a channel in the order of their blocks; [] where there are none.

    Args:
        place: the store, or its file.
        channel, source: of the spectra; None for any source.
        at, before: only the spectrum of the block of this number, only those of blocks before it.
        newest: greatest number of spectra, counted from the newest, or None for all.
    """
    conditions, values = _conditions(channel, source, at, before)
    query = f"SELECT {_ROW} FROM spectra WHERE {conditions} ORDER BY sequence DESC LIMIT ?"
    rows = _read(place, query, (*values, -1 if newest is None else newest))
    return [_row_of(row) for row in reversed(rows)]


def read_block_view(
    place: Path | Readable, channel: str, *, source: str | None = None, at: int | None = None
) -> SpectrumRow | None:
    """Return the spectrum of a block with its view, by default the newest; None without, as of earlier versions.

    Args:
        place: the store, or its file.
        channel, source: of the spectrum; None for any source.
        at: number of the block.
    """
    if isinstance(place, Path):
        with SharedConnection(place) as connection:
            return read_block_view(connection, channel, source=source, at=at)
    if not place.rows("SELECT 1 FROM pragma_table_info('spectra') WHERE name = 'view'"):
        return None
    conditions, values = _conditions(channel, source, at, None)
    query = f"SELECT {_ROW}, view FROM spectra WHERE {conditions} AND view NOT NULL ORDER BY sequence DESC LIMIT 1"
    for *row, blob in place.rows(query, *values):
        header = json.loads(row[4]).get("view")
        # An earlier version of the program may have replaced the row and left the column.
        return None if header is None else replace(_row_of(tuple(row)), view=unpack_view(header, blob))
    return None


def viewed_blocks(place: Readable, channel: str, *, source: str | None = None) -> list[int]:
    """Return the numbers of the blocks with a view, in order."""
    if not place.rows("SELECT 1 FROM pragma_table_info('spectra') WHERE name = 'view'"):
        return []
    conditions, values = _conditions(channel, source, None, None)
    query = f"SELECT sequence FROM spectra WHERE {conditions} AND view NOT NULL AND instr(header, ?) ORDER BY sequence"
    return [sequence for (sequence,) in place.rows(query, *values, '"view":')]


def pack_view(view: BlockView) -> tuple[dict[str, Any], bytes]:
    """Return a view as a header for JSON and bytes: spectra as float16, the waveform as int16, each over a scale."""
    fine, fine_scale = pack_amplitude(view.spectra.amplitude)
    highest, highest_scale = pack_amplitude(view.spectra.highest)
    peak = float(np.abs(view.waveform).max(initial=0.0))
    step = peak / _INT16_MAX if peak > np.finfo(np.float32).tiny else 1.0
    waveform = np.rint(np.asarray(view.waveform, dtype=np.float64) / step).astype("<i2").tobytes()
    header = {
        "rate": view.rate,
        "samples": view.samples,
        "resolution": view.spectra.resolution,
        "width": view.spectra.width,
        "sizes": [len(fine), len(highest), len(waveform)],
        "scales": [fine_scale, highest_scale, step],
    }
    blob = fine + highest + waveform
    if view.ias is not None:
        fine, fine_scale = pack_amplitude(view.ias.amplitude)
        highest, highest_scale = pack_amplitude(view.ias.highest)
        header["ias"] = {
            "resolution": view.ias.resolution,
            "width": view.ias.width,
            "sizes": [len(fine), len(highest)],
            "scales": [fine_scale, highest_scale],
        }
        blob += fine + highest
    return header, blob


def unpack_view(header: Mapping[str, Any], blob: bytes) -> BlockView:
    """Return what :func:`pack_view` packed: amplitudes to 0.05 %, samples to 1.5e-5 of the largest."""
    fine, highest, waveform = _parts(header, blob, ("<f2", "<f2", "<i2"))
    spectra = RawSpectra(header["resolution"], fine, header["width"], highest)
    ias = header.get("ias")
    if ias is not None:
        fine, highest = _parts(ias, blob[sum(header["sizes"]) :], ("<f2", "<f2"))
        ias = RawSpectra(ias["resolution"], fine, ias["width"], highest)
    return BlockView(header["rate"], header["samples"], spectra, waveform, ias)


def _parts(header: Mapping[str, Any], blob: bytes, kinds: Sequence[str]) -> list[NDArray[np.float64]]:
    """Return the arrays that stand one after the other, each times its scale."""
    ends = np.cumsum(header["sizes"])
    parts = (blob[end - size : end] for end, size in zip(ends, header["sizes"], strict=True))
    return [
        np.frombuffer(part, dtype=kind).astype(np.float64) * scale
        for part, kind, scale in zip(parts, kinds, header["scales"], strict=True)
    ]


def read_ias(place: Readable, source: str, *, until: int | None = None) -> SpectrumRow | None:
    """Return the latest kept spectrum of a source with one of the angular speed; None where there is none.

    Args:
        source: of any of its channels.
        until: greatest number of the block.
    """
    if not place.rows("SELECT 1 FROM pragma_table_info('spectra') WHERE name = 'view'"):
        return None
    query = (
        f"SELECT {_ROW}, view FROM spectra WHERE source = ? AND sequence <= ? AND view NOT NULL"
        " AND instr(header, ?) ORDER BY sequence DESC LIMIT 1"
    )
    for *row, blob in place.rows(query, source, 2**62 if until is None else until, '"ias":'):
        return replace(_row_of(tuple(row)), view=unpack_view(json.loads(row[4])["view"], blob))
    return None


def read_kurtogram(
    place: Path | Readable, channel: str, *, source: str | None = None, until: int | None = None
) -> SpectrumRow | None:
    """Return the latest kept spectrum with a kurtogram, up to the block of number ``until``; None where there is none.

    Args:
        place: the store, or its file.
        channel, source: of the spectrum; None for any source.
    """
    conditions, values = _conditions(channel, source, None, None if until is None else until + 1)
    query = f"SELECT {_ROW} FROM spectra WHERE {conditions} AND instr(header, ?) ORDER BY sequence DESC LIMIT 1"
    rows = _read(place, query, (*values, '"kurtogram":'))
    return _row_of(rows[0]) if rows else None


def kept_blocks(place: Path | Readable, channel: str, *, source: str | None = None) -> list[tuple[int, float | None]]:
    """Return number and time of the blocks with a kept spectrum, in order."""
    conditions, values = _conditions(channel, source, None, None)
    query = f"SELECT sequence, time FROM spectra WHERE {conditions} ORDER BY sequence"
    return [(sequence, time) for sequence, time in _read(place, query, values)]


def in_orders(rows: Sequence[SpectrumRow]) -> bool:
    """Return whether spectra of a channel are to be seen over orders: one is, or their mean speeds differ."""
    speeds = [row.speed for row in rows if row.speed > 0.0]
    if len(speeds) < len(rows) or not speeds:
        return False
    return any(row.domain == "order" for row in rows) or max(speeds) - min(speeds) > _SPEEDS_DIFFER * max(speeds)


def binned(
    rows: Sequence[SpectrumRow], bins: int, highest: float | None = None, *, orders: bool = False
) -> tuple[Any, Any]:
    """Return the highest amplitude of each spectrum of a channel in common bins of frequency, or of order.

    Args:
        rows: of one channel.
        bins: greatest number of bins; the coarsest spectrum limits it, too.
        highest: upper end, Hz or order, or None for that of the widest spectrum.
        orders: each spectrum is taken over its frequency over its own speed, so that spectra of several speeds agree.

    Returns:
        Lower edges of the bins, Hz or order, shape (bins,), and amplitudes, shape (row, bins), NaN beyond the end of a
        spectrum.

    Raises:
        ValueError: ``rows`` is empty or ``bins`` below 1.
    """
    if not rows or bins < 1:
        raise ValueError(f"expected at least one spectrum and one bin, got {len(rows)} and {bins}")
    steps = [row.resolution / row.speed if orders else row.resolution for row in rows]
    top = max(step * row.amplitude.size for step, row in zip(steps, rows, strict=True))
    top = top if highest is None else min(top, highest)
    bins = max(1, min(bins, *(int(top / step) for step in steps)))
    width = top / bins
    amplitude = np.full((len(rows), bins), np.nan)
    for out, row, step in zip(amplitude, rows, steps, strict=True):
        place = np.floor_divide(np.arange(row.amplitude.size) * step, width).astype(np.intp)
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
    kurtogram, speeds, course = (header.get(key) for key in ("kurtogram", "speed_range", "speed_course"))
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
        kurtogram=None if kurtogram is None else Kurtogram.from_dict(kurtogram),
        domain=header.get("domain", "hertz"),
        speed_range=None if speeds is None else (speeds[0], speeds[1]),
        speed_course=None if course is None else tuple(course),
    )


def _read(place: Path | Readable, query: str, values: tuple[Any, ...]) -> list[Any]:
    """Return the rows of a query; none where the store is older than the table."""
    if isinstance(place, Path):
        with SharedConnection(place) as connection:
            return _read(connection, query, values)
    if not place.rows("SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = 'spectra'"):
        return []
    return place.rows(query, *values)
