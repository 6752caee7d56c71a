"""Columns of a text with what its head, its names and its times state of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from streams.files.abscissa import Abscissa, abscissa_of, column_statements, counts, is_even, refuse_spectrum
from streams.files.axes import abscissa_size, ordinate_units
from streams.files.circumstances import circumstances_of, without
from streams.files.formats.head import Head, StatedUnits, names_and_units
from streams.files.formats.stamped import StampedRows
from streams.files.judge import Start, in_zone, judge_rate, judge_start, judge_unit, starts_of
from streams.files.keys import KEYS, LEVELS, UNIT_KEYS
from streams.files.packing import without_codes
from streams.files.statements import (
    DECIMAL_COMMA,
    Facts,
    StatedNumber,
    add_fact,
    plain_key,
    rate_statements,
    unit_statements,
)
from streams.files.unlisted import bearing_on, unlisted_in
from streams.types.samples import ReaderError, Samples

_MAX_LOOKED = 4096
Stated = TypeVar("Stated", StatedNumber, Start)
_OF_COLUMNS = (*LEVELS, *UNIT_KEYS, "scale", "scalefactor")
"""Plain keys that a head may state of one column, with its name or number."""
_NUMBER = re.compile(r"(?:ch|chan|channel|kanal|canal|canale|voie|sensor|input|ai)?0*(\d{1,3})")


def described(
    samples: Samples, head: Head, name: str, zone: str, disregard: Sequence[str], stamped: StampedRows | None = None
) -> Samples:
    """Return the columns that may be channels, with what is stated of them.

    Args:
        samples: of all columns but those of ``stamped``.
        head: what stands above them; its names are as many as the columns.
        name: of the file in messages.
        zone: IANA name of the zone of stamps that name none.
        disregard: patterns of the keys that are not believed.
        stamped: the stamps with which the rows began.

    Raises:
        ReaderError: ``wrong_rate``, ``wrong_unit`` or ``unreadable`` where statements contradict each other.
    """
    titles, names, units = names_and_units(samples, head)
    facts = {**without(head.facts, disregard), **({DECIMAL_COMMA: True} if head.decimal == "," else {})}
    of_columns = [without(found, disregard) for found in head.of_columns] or [{}] * len(names)
    rates = rate_statements(facts, name)
    starts = starts_of(facts, zone)
    channels: list[int] = []
    size = abscissa_size(facts, name)
    for place, title in enumerate(names):
        column = _axis(samples, place, title, units[place], is_named=head.names is not None)
        refuse_spectrum(column, name)
        if column is None:
            channels.append(place)
            rates += _in_column(rate_statements(of_columns[place], name), title)
            starts += _in_column(starts_of(of_columns[place], zone), title)
        if column is None or column.kind == "index":
            continue
        size = size or head.size_of_times
        if column.size is None and size is not None:
            column = replace(column, size=size)
        of_times, begins = column_statements(column, samples.values[place], name)
        rates += of_times
        starts += begins
    if not channels:
        raise ReaderError("wrong_shape", f"{name}: holds only times and running numbers: {', '.join(titles)}")
    if stamped is not None:
        rates += _rate_of_stamps(stamped, name)
        starts += in_zone(facts, _start_of_stamps(stamped))
    rate, start = judge_rate(rates, name), judge_start(starts, name)
    of_columns = _with_named_after(of_columns, facts, names, channels)
    beside = circumstances_of(facts, name)
    own = [circumstances_of(found, name) for found in of_columns]
    found_units = tuple(map(_unit_of, units, of_columns, [facts] * len(names), [name] * len(names)))
    rows, own_units = [samples.values[place] for place in channels], [found_units[place] for place in channels]
    found = replace(
        samples,
        channels=names,
        names=titles,
        units=found_units,
        sensitivities=tuple(one.sensitivity or beside.sensitivity for one in own),
        count_scales=tuple(
            (one.count or beside.count) if unit is not None or _is_whole(row) else None
            for one, unit, row in zip(own, found_units, samples.values, strict=True)
        ),
        open_gain=next((one.gain for one in (beside, *own) if one.gain), None),
        open_multiplier=next((one.multiplier for one in (beside, *own) if one.multiplier), ""),
        **rate.fields,
        **start.fields,
        stated_speed=beside.speed,
        stated_load=beside.load,
        unlisted=bearing_on([one for each in (facts, *of_columns) for one in unlisted_in(each, rows, zone)], own_units),
    )
    found = found.select(channels)
    return replace(found, values=without_codes(found.values))


def _with_named_after(
    of_columns: Sequence[Facts], facts: Facts, names: Sequence[str], channels: Sequence[int]
) -> list[Facts]:
    """Add to each column what the head states of it: ``Sensitivity AI0`` beside ``AI0 DE (V)``.

    Where no name has the word behind the key, numbers such as ``ch1`` count the ``channels``, if there is one of each.
    """
    found = [dict(own) for own in of_columns]
    words = [{plain_key(name), *map(plain_key, re.split(r"[^\w]+|_", name))} for name in names]
    numbered: dict[str, dict[int, tuple[str, object]]] = {}
    for key, value in facts.items():
        whole = key.partition("#")[0]
        known = max((word for word in _OF_COLUMNS if word in whole), key=len, default="")
        rest = whole.replace(known, "", 1)
        if not known or whole in KEYS or not (whole.startswith(known) or whole.endswith(known)):
            continue
        places = [place for place in channels if rest in words[place]]
        number = _NUMBER.fullmatch(rest)
        if len(places) == 1:
            add_fact(found[places[0]], known, value, key)
        elif number is not None:
            numbered.setdefault(known, {})[int(number[1])] = key, value
    for known, of_number in numbered.items():
        if len(of_number) == len(channels) and max(of_number) - min(of_number) == len(channels) - 1:
            for place, number in zip(channels, sorted(of_number), strict=True):
                add_fact(found[place], known, of_number[number][1], of_number[number][0])
    return list(found)


def _axis(samples: Samples, place: int, title: str, units: StatedUnits, *, is_named: bool) -> Abscissa | None:
    """Return what a column is that is no channel, without names by its even steps; one alone always is a channel."""
    values = samples.values[place]
    if len(samples.names) == 1:
        return None
    if is_named or counts(values):
        return abscissa_of(title, units[0][1] if units else "", values)
    return Abscissa(title, "time") if is_even(values) else None


def _is_whole(row: NDArray[np.floating]) -> bool:
    """Return whether numbers without a unit may be counts: their first ones are whole."""
    begin = np.asarray(row[:_MAX_LOOKED])
    return bool(np.all(begin == np.floor(begin)))


def _in_column(statements: list[Stated], title: str) -> list[Stated]:
    return [replace(one, place=f"{one.place} of {title}") for one in statements]


def _unit_of(own: StatedUnits, of_column: Facts, facts: Facts, name: str) -> str | None:
    return judge_unit([*own, *unit_statements(of_column)], name, [*unit_statements(facts), *ordinate_units(facts)])


def _rate_of_stamps(stamped: StampedRows, name: str) -> list[StatedNumber]:
    times = np.where(stamped.times < -43200.0, stamped.times + 86400.0, stamped.times)
    return column_statements(Abscissa("", size=1.0), times, name)[0]


def _start_of_stamps(stamped: StampedRows) -> list[Start]:
    return [] if stamped.start is None else [Start("the first row", stamped.start, of_rows=True)]
