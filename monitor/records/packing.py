"""Values of a record as one row of float64, and the layout that says which place holds what.

Blocks of one source nearly all have the same layout, so that a day of records is read as a matrix instead of one value
after the other. Words are their integers (place in ``Variable.values``, or bits), and NaN, which no record holds,
means None.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor.health.record import mask_names
from monitor.health.schema import VARIABLES, Variable


class Entry(NamedTuple):
    """The first place of one value in a row; the shape is None where one of several numbers is absent as a whole."""

    channel: str
    variable: str
    shape: tuple[int, ...] | None
    start: int


_ChannelLayout = tuple[str, tuple[tuple[str, tuple[int, ...] | None], ...]]
"""A channel, and of each of its variables the name and the shape."""


def pack(channels: Mapping[str, Mapping[str, Any]]) -> tuple[str, bytes]:
    """Return the layout, as JSON, and the row, as little-endian float64, of a record's checked values."""
    layout: list[_ChannelLayout] = []
    row: list[float] = []
    for channel, values in channels.items():
        entries: list[tuple[str, tuple[int, ...] | None]] = []
        for name, value in values.items():
            variable = VARIABLES[name]
            if value is None and variable.dims:
                entries.append((name, None))
                continue
            shape: list[int] = []
            items: Any = (value,)
            if isinstance(value, tuple):
                items = value
                shape.append(len(items))
                while items and isinstance(items[0], tuple):
                    shape.append(len(items[0]))
                    items = tuple(chain.from_iterable(items))
            entries.append((name, tuple(shape)))
            if variable.kind in ("float", "int"):
                row.extend([math.nan if item is None else item for item in items])
            else:
                row.extend(_number(variable, item) for item in items)
        layout.append((channel, tuple(entries)))
    return _layout_text(tuple(layout)), np.array(row, dtype="<f8").tobytes()


@lru_cache(maxsize=256)
def _layout_text(layout: tuple[_ChannelLayout, ...]) -> str:
    return json.dumps(layout, separators=(",", ":"))


def unpack(layout: str, row: bytes) -> dict[str, dict[str, Any]]:
    """Return the values of a record, the inverse of :func:`pack`."""
    numbers = numbers_of(row)
    channels: dict[str, dict[str, Any]] = {channel: {} for channel in channels_of(layout)}
    for entry in entries_of(layout):
        value: Any = None
        if entry.shape is not None:
            part = numbers[entry.start : entry.start + math.prod(entry.shape)].reshape(entry.shape)
            value = _plain(VARIABLES[entry.variable], part.tolist())
        channels[entry.channel][entry.variable] = value
    return channels


@lru_cache(maxsize=256)
def entries_of(layout: str) -> tuple[Entry, ...]:
    """Return the entries of a layout in order."""
    entries: list[Entry] = []
    start = 0
    for channel, variables in json.loads(layout):
        for name, shape in variables:
            entries.append(Entry(channel, name, None if shape is None else tuple(shape), start))
            start += 0 if shape is None else math.prod(shape)
    return tuple(entries)


@lru_cache(maxsize=256)
def places_of(layout: str, names: tuple[str, ...]) -> dict[str, NDArray[np.intp]]:
    """Return by channel the places of the first number of each variable in the row, shape (name,), -1 for none.

    The result is cached: do not change it.
    """
    order = {name: place for place, name in enumerate(names)}
    places = {channel: np.full(len(names), -1, dtype=np.intp) for channel in channels_of(layout)}
    for entry in entries_of(layout):
        if entry.variable in order and entry.shape is not None and math.prod(entry.shape):
            places[entry.channel][order[entry.variable]] = entry.start
    return places


def columns_of(numbers: NDArray[np.float64], places: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the numbers of rows, shape (row, number), at places, shape (name,), NaN where the place is -1."""
    columns = np.full((numbers.shape[0], places.size), np.nan)
    there = places >= 0
    columns[:, there] = numbers[:, places[there]]
    return columns


@lru_cache(maxsize=256)
def channels_of(layout: str) -> tuple[str, ...]:
    """Return the channels of a layout in order, also those without any value."""
    return tuple(channel for channel, _ in json.loads(layout))


def numbers_of(row: bytes) -> NDArray[np.float64]:
    """Return the numbers of a row."""
    return np.frombuffer(row, dtype="<f8")


def _number(variable: Variable, words: str | None) -> float:
    """Return the number that stands for the words of a flag or a mask."""
    if words is None:
        return math.nan
    if variable.kind == "flag":
        return variable.values.index(words)
    return sum(1 << variable.values.index(name) for name in words.split("|"))


def _plain(variable: Variable, value: Any) -> Any:
    """Return the value that was packed as a number, or as nested lists of them."""
    if isinstance(value, list):
        return tuple(_plain(variable, item) for item in value)
    if math.isnan(value):
        return None
    if variable.kind == "float":
        return value
    if variable.kind == "int":
        return int(value)
    if variable.kind == "flag":
        return variable.values[int(value)]
    return "|".join(mask_names(variable, int(value)))
