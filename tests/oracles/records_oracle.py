"""Health records made up for tests, and the slow and obvious way to put them into arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from monitor.health.record import Record
from monitor.health.schema import DIMENSION_SIZES, FLAGS, REJECTIONS, VARIABLES, Variable

FINITE = st.floats(allow_nan=False, allow_infinity=False)


def values_of(variable: Variable, bands: int = 1, numbers: st.SearchStrategy[float] = FINITE) -> st.SearchStrategy[Any]:
    """Strategy for one value of a variable, None included at every level that allows it."""
    leaf: st.SearchStrategy[Any] = {
        "float": numbers,
        "int": st.integers(1, 10**6),
        "flag": st.sampled_from(variable.values or ("",)),
        "mask": st.sets(st.sampled_from(variable.values or ("",)), min_size=1).map("|".join),
    }[variable.kind]
    value = st.none() | leaf
    for dim in reversed(variable.dims):
        size = DIMENSION_SIZES.get(dim, bands)
        value = st.lists(value, min_size=size, max_size=size).map(tuple)
    return st.none() | value


@st.composite
def records(
    draw: st.DrawFn, sequence: int | None = None, bands: int = 1, numbers: st.SearchStrategy[float] = FINITE
) -> Record:
    """Strategy for records of one source "s" with channels "x" and "y"."""
    status = draw(st.sampled_from(("ok", "ok", *FLAGS, *REJECTIONS)))
    channels = {}
    for channel in draw(st.sampled_from([(), ("x",), ("x", "y"), ("y", "x")])):
        names = draw(st.lists(st.sampled_from(sorted(VARIABLES)), unique=True, max_size=12))
        channels[channel] = {name: draw(values_of(VARIABLES[name], bands, numbers)) for name in names}
    event = st.fixed_dictionaries({"kind": st.text(max_size=8), "value": st.none() | FINITE})
    return Record(
        source="s",
        sequence=sequence if sequence is not None else draw(st.integers(1, 2**40)),
        name=draw(st.text(st.characters(exclude_categories=("Cs",)), max_size=12)),
        content_hash=draw(st.text("0123456789abcdef", max_size=8)),
        status=status,
        flags=tuple(draw(st.lists(st.sampled_from(FLAGS), unique=True, max_size=3))),
        reason=draw(st.text(st.characters(exclude_categories=("Cs",)), max_size=12)),
        time=draw(st.none() | st.floats(0, 4e9)),
        elapsed=draw(st.none() | st.floats(0, 1e9)),
        channels=channels,
        forecasts=tuple(draw(st.lists(event, max_size=2))),
        events=tuple(draw(st.lists(event, max_size=2))),
    )


def number_of(variable: Variable, value: Any) -> float:
    """The number by which a file holds one number or word."""
    if value is None:
        return {"float": math.nan, "int": -1.0, "flag": -1.0, "mask": 0.0}[variable.kind]
    if variable.kind == "flag":
        return float(list(variable.values).index(value))
    if variable.kind == "mask":
        return float(sum(2**bit for bit, name in enumerate(variable.values) if name in value.split("|")))
    return float(value)


def array_of(variable: Variable, rows: Sequence[Record], channels: Sequence[str], bands: int) -> NDArray[np.float64]:
    """All values of a variable over (time, channel, *dims), one number after the other."""
    sizes = [DIMENSION_SIZES.get(dim, bands) for dim in variable.dims]
    array = np.full((len(rows), len(channels), *sizes), number_of(variable, None))
    for row, record in enumerate(rows):
        for place, channel in enumerate(channels):
            value = record.channels.get(channel, {}).get(variable.name)
            if value is None:
                continue
            for index in np.ndindex(*sizes):
                item = value
                for step in index:
                    item = item[step]
                array[(row, place, *index)] = number_of(variable, item)
    return array
