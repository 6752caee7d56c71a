"""From the rows of a file to channels: which rows they are, in what unit, at which rate."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from streams.readers.reading import ReaderError, Reading
from streams.spec import UNITS, ChannelSpec

TAIL = 0.9
"""A last block of at least this part of the full length is kept."""

RATE_TOLERANCE = 1e-4
"""Rates that differ by no more than this part are the same rate, written or measured differently."""


@dataclass(frozen=True)
class Row:
    """A row of a reading that is a channel: its index, the channel's name and unit."""

    index: int
    channel: str
    unit: str


def choose_rows(reading: Reading, channels: Sequence[ChannelSpec], unit: str | None, where: str) -> tuple[Row, ...]:
    """Find the rows of the configured channels, or take all.

    Args:
        reading: what a reader gave.
        channels: the configured channels; none: every row, by the data set's names.
        unit: of every row by the data set, or None.
        where: name of the file, for messages.

    Returns:
        One row a channel.

    Raises:
        ReaderError: ``wrong_shape`` where a channel matches no row or several; ``wrong_unit`` where the file states
            another unit than the configuration, or neither states one.
    """
    if not channels:
        return tuple(Row(i, name, _own_unit(reading, i, unit, where)) for i, name in enumerate(reading.channels))
    rows = [(_row_of(reading, channel, where), channel) for channel in channels]
    return tuple(Row(i, channel.name, _unit_of(reading, i, channel, unit, where)) for i, channel in rows)


def _stated_unit(reading: Reading, index: int, unit: str | None) -> str | None:
    """Return the unit of a row by the file, row by row or as a whole, else by the data set."""
    return (reading.units[index] if reading.units else None) or reading.unit or unit


def _own_unit(reading: Reading, index: int, unit: str | None, where: str) -> str:
    stated = _stated_unit(reading, index, unit)
    if stated is None:
        raise ReaderError("wrong_unit", f"{where}: no unit is stated; give [[channel]] unit")
    if stated not in UNITS:
        name = reading.names[index]
        raise ReaderError("wrong_unit", f"{where}: {name} is in {stated!r}; expected one of {', '.join(UNITS)}")
    if stated == "V":
        raise ReaderError("wrong_unit", f"{where}: in V; give [[channel]] sensitivity_mv_per_g or a side-car")
    return stated


def _row_of(reading: Reading, channel: ChannelSpec, where: str) -> int:
    both = list(zip(reading.names, reading.channels, strict=True))
    if channel.key is not None:
        wanted = f"key {channel.key!r}"
        found = [i for i, names in enumerate(both) if any(fnmatchcase(name, channel.key) for name in names)]
    elif isinstance(channel.column, int):
        wanted = f"column {channel.column}"
        found = [i for i, column in enumerate(reading.columns) if column == channel.column]
    elif channel.column is not None:
        wanted = f"column {channel.column!r}"
        found = [i for i, names in enumerate(both) if channel.column in names]
    else:
        wanted = "its name"
        found = [i for i, name in enumerate(reading.channels) if channel.name in (name, reading.names[i])]
        if not found and len(reading.names) == 1:
            found = [0]
    if len(found) != 1:
        held = ", ".join(reading.names) if reading.names == reading.channels else _both_names(reading)
        count = "no column" if not found else f"{len(found)} columns"
        raise ReaderError("wrong_shape", f"{where}: channel {channel.name}: {count} by {wanted}; the file has {held}")
    return found[0]


def _both_names(reading: Reading) -> str:
    pairs = zip(reading.channels, reading.names, strict=True)
    return ", ".join(f"{channel} ({name})" for channel, name in pairs)


def _unit_of(reading: Reading, index: int, channel: ChannelSpec, unit: str | None, where: str) -> str:
    stated = _stated_unit(reading, index, unit)
    configured = channel.unit
    if reading.scaled and channel.scale != 1.0:
        raise ReaderError(
            "wrong_unit",
            f"{where}: channel {channel.name}: the side-car scales it already, and so does scale = {channel.scale:g}",
        )
    if stated is None and configured is None:
        raise ReaderError("wrong_unit", f"{where}: channel {channel.name}: no unit is stated; give [[channel]] unit")
    if configured is not None and stated not in (None, "unknown", configured):
        raise ReaderError(
            "wrong_unit", f"{where}: channel {channel.name}: the recording is in {stated}, unit = {configured!r}"
        )
    if configured is None and (stated not in UNITS or stated == "V"):
        raise ReaderError(
            "wrong_unit", f"{where}: channel {channel.name}: the recording is in {stated}; give [[channel]] unit"
        )
    return configured or stated or "unknown"


def agreed_rate(stated: Sequence[float | None], configured: float | None, where: str) -> float:
    """Find the one rate on which file, data set and configuration agree.

    Args:
        stated: what the file and the data set say, the first to be believed first.
        configured: what the configuration says, or None.
        where: name of the file, for messages.

    Returns:
        The rate in Hz.

    Raises:
        ReaderError: ``wrong_rate`` where they differ by more than 1e-4 of it or none is stated.
    """
    rates = [rate for rate in (*stated, configured) if rate is not None]
    if not rates:
        raise ReaderError("wrong_rate", f"{where}: no sampling rate is stated; give [[source]] rate_hz")
    if any(abs(rate - rates[0]) > RATE_TOLERANCE * rates[0] for rate in rates):
        said = " and ".join(f"{rate:g} Hz" for rate in dict.fromkeys(rates))
        raise ReaderError("wrong_rate", f"{where}: the recording and rate_hz do not agree: {said}")
    return rates[0]


def content_hash(data: bytes) -> str:
    """Return the BLAKE2b-128 digest of the bytes of a file, in hexadecimal."""
    return hashlib.blake2b(data, digest_size=16).hexdigest()
