"""Columns of a text with what its head, its names and its times state of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from streams.files.abscissa import Abscissa, abscissa_of, column_statements, counts, is_even, refuse_spectrum
from streams.files.axes import abscissa_size, ordinate_units
from streams.files.circumstances import circumstances_of, without
from streams.files.formats.head import Head, StatedUnits, names_and_units
from streams.files.formats.stamped import StampedRows
from streams.files.judge import Start, in_zone, judge_rate, judge_start, judge_unit, starts_of
from streams.files.packing import without_codes
from streams.files.statements import DECIMAL_COMMA, Facts, StatedNumber, rate_statements, unit_statements
from streams.types.samples import ReaderError, Samples

Stated = TypeVar("Stated", StatedNumber, Start)


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
    beside = circumstances_of(facts, name)
    own = [circumstances_of(found, name) for found in of_columns]
    found = replace(
        samples,
        channels=names,
        names=titles,
        units=tuple(map(_unit_of, units, of_columns, [facts] * len(names), [name] * len(names))),
        sensitivities=tuple(one.sensitivity or beside.sensitivity for one in own),
        count_scales=tuple(one.count or beside.count for one in own),
        open_gain=next((one.gain for one in (beside, *own) if one.gain), ""),
        open_multiplier=next((one.multiplier for one in (beside, *own) if one.multiplier), ""),
        **rate.fields,
        **start.fields,
        stated_speed=beside.speed,
        stated_load=beside.load,
    )
    found = found.select(channels)
    return replace(found, values=without_codes(found.values))


def _axis(samples: Samples, place: int, title: str, units: StatedUnits, *, is_named: bool) -> Abscissa | None:
    """Return what a column is that is no channel, without names by its even steps; one alone always is a channel."""
    values = samples.values[place]
    if len(samples.names) == 1:
        return None
    if is_named or counts(values):
        return abscissa_of(title, units[0][1] if units else "", values)
    return Abscissa(title, "time") if is_even(values) else None


def _in_column(statements: list[Stated], title: str) -> list[Stated]:
    return [replace(one, place=f"{one.place} of {title}") for one in statements]


def _unit_of(own: StatedUnits, of_column: Facts, facts: Facts, name: str) -> str | None:
    return judge_unit([*own, *unit_statements(of_column)], name, [*unit_statements(facts), *ordinate_units(facts)])


def _rate_of_stamps(stamped: StampedRows, name: str) -> list[StatedNumber]:
    times = np.where(stamped.times < -43200.0, stamped.times + 86400.0, stamped.times)
    return column_statements(Abscissa("", size=1.0), times, name)[0]


def _start_of_stamps(stamped: StampedRows) -> list[Start]:
    return [] if stamped.start is None else [Start("the first row", stamped.start, of_rows=True)]
