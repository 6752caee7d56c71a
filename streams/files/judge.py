"""The one judge of what files state: facts about their samples, or a refusal that quotes what contradicts itself.

A format gives rows with what is stated of each under plain keys (:mod:`streams.files.statements`). All statements of a
quantity are compared, whatever their scope: those that agree within their resolution are a fact, of which the finest
one gives the value; those that do not are a refusal with both places. Nothing is a fact because it came first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from streams.files.circumstances import REMEDY, Circumstances, circumstances_of, without
from streams.files.keys import UNIT_IN_NAME
from streams.files.packing import without_codes
from streams.files.statements import (
    STORED,
    Facts,
    StatedNumber,
    is_of_vibration,
    known_unit,
    nice_rate,
    rate_statements,
    time_statements,
    unit_statements,
)
from streams.files.unlisted import bearing_on, unlisted_in
from streams.files.zones import in_stated_zone
from streams.types.samples import RATE_TOLERANCE, VALUES, ReaderError, Samples, UnlistedStatement, stack_rows
from streams.types.stamps import Stamp

START_TOLERANCE = 0.01
"""s by which the starts of the rows of one file may differ: less than any later stage resolves."""
_QUARTER, _LONGEST_OFFSET = 900.0, 14 * 3600.0
_HEAD_BEFORE_ROWS = 2.0
_COARSE = 1e-3
"""Relative resolution from which a rate is known too coarsely where it is no whole number of Hz."""


@dataclass(frozen=True, eq=False)
class StatedRow:
    """A row of samples as a format gives it.

    ``name`` is its full name in the file, ``short`` the one it has where no other row is called so; ``facts`` is what
    is stated of it, ``rate`` what its format states of its rate.
    """

    values: NDArray[np.floating]
    name: str
    short: str
    facts: Facts
    rate: StatedNumber | None = None


@dataclass(frozen=True)
class Start:
    """What one place states of the time of the first sample.

    ``of_rows`` says that each sample has its time: the head of such a file was written some time before. ``zone`` is
    what leaves its zone open, as it is written, "" for nothing.
    """

    place: str
    stamp: Stamp
    of_rows: bool = False
    zone: str = ""


@dataclass(frozen=True)
class JudgedStart:
    """The time of the first sample, s since 1970 UTC; ``opened`` as it is written where day and month are open.

    ``written`` is how it is written where that names no zone.
    """

    value: float | None = None
    opened: str | None = None
    written: str | None = None

    @property
    def fields(self) -> dict[str, Any]:
        """What it is among the fields of samples."""
        return {"start": self.value, "stamp": self.opened, "written": self.written}


@dataclass(frozen=True)
class JudgedRate:
    """The rate in Hz; or its ``readings``, each within ``resolution``; ``written``: where it stands, and how."""

    value: float | None = None
    readings: tuple[float, ...] = ()
    resolution: float = 0.0
    written: str = ""

    @property
    def fields(self) -> dict[str, Any]:
        """What it is among the fields of samples; see :func:`opened_rate`."""
        return {
            "rate": self.value,
            "rate_readings": self.readings,
            "rate_resolution": self.resolution,
            "rate_written": self.written,
        }

    @property
    def meant(self) -> str:
        """The readings in words."""
        spread = f" +- {self.resolution:.2g}" if len(self.readings) == 1 and self.resolution else ""
        return " or ".join(f"{rate:.6g}" for rate in self.readings) + f"{spread} Hz"

    def fits(self, rate: float) -> bool:
        """Return whether a rate in Hz is one of the readings."""
        return any(abs(rate - one) <= RATE_TOLERANCE * one + self.resolution for one in self.readings)


def judge_rate(statements: Sequence[StatedNumber], where: str) -> JudgedRate:
    """Return the rate on which all statements agree.

    They agree where a reading of each lies within 1e-4 of one of the finest, and within what their digits resolve.

    Raises:
        ReaderError: ``wrong_rate``, which quotes those that differ.
    """
    if not statements:
        return JudgedRate()
    ordered = sorted(statements, key=_coarseness)
    finest = ordered[0]
    kept = [
        reading
        for reading in finest.readings
        if all(any(_is_near(reading, value, finest, other) for value in other.readings) for other in ordered[1:])
    ]
    if not kept:
        listed = ", ".join(
            f"{one.place} {' or '.join(f'{r:g}' for r in sorted(one.readings))} Hz" for one in statements
        )
        raise ReaderError("wrong_rate", f"{where}: the file states several sampling rates: {listed}{REMEDY}")
    if len(kept) > 1:
        return JudgedRate(None, tuple(kept), finest.resolution, f"{finest.place} {finest.written!r}")
    rate, uncertainty = kept[0], finest.resolution / kept[0]
    nice = nice_rate(rate, max(1e-9, min(uncertainty, RATE_TOLERANCE)))
    written = [
        one for one in ordered if one.is_exact and len(one.readings) == 1 and _is_near(one.readings[0], rate, finest)
    ]
    if not finest.is_exact and written:
        # What was measured too coarsely to count alone confirms what is written.
        finest, rate, uncertainty = written[0], written[0].readings[0], finest.resolution / rate
        nice = rate
    if not finest.is_exact or (uncertainty > _COARSE and nice_rate(rate, 1e-9) != round(rate)):
        return JudgedRate(None, (rate,), finest.resolution, f"{finest.place} {finest.written!r}")
    return JudgedRate(nice, written=f"{finest.place} {finest.written!r}")


def _coarseness(one: StatedNumber) -> tuple[bool, int, float]:
    return not one.is_exact, len(one.readings), one.resolution / max(one.readings)


def _is_near(one: float, other: float, *statements: StatedNumber) -> bool:
    tolerance = RATE_TOLERANCE * one + 1.01 * sum(statement.resolution for statement in statements)
    return abs(one - other) <= tolerance


def stated_rate(facts: Facts, where: str) -> float | None:
    """Return the sampling rate in Hz among values under plain keys, None where none is stated or it is open.

    Raises:
        ReaderError: ``wrong_rate`` where a value is no positive number or two of them differ.
    """
    return judge_rate(rate_statements(facts, where), where).value


def joint_rate(stated: Sequence[tuple[str, float | None]], where: str) -> float | None:
    """Return the rate in Hz on which several places agree, given with their names; None where none states one.

    Raises:
        ReaderError: as :func:`judge_rate`.
    """
    known = [StatedNumber(place, f"{rate:g} Hz", (rate,)) for place, rate in stated if rate is not None]
    return judge_rate(known, where).value


def agreed_rate(
    stated: Sequence[float | None], configured: float | None, where: str, opened: JudgedRate | None = None
) -> float:
    """Return the rate in Hz on which the ``stated`` and ``configured`` ones agree.

    ``opened`` is what a file states that can be read in several ways.

    Raises:
        ReaderError: ``wrong_rate`` where they differ by more than 1e-4 of it or none is stated.
    """
    rates = [rate for rate in (*stated, configured) if rate is not None]
    if not rates and opened is not None and opened.readings:
        raise ReaderError("wrong_rate", f"{where}: {opened.written} may mean {opened.meant}; give [[source]] rate_hz")
    if not rates:
        raise ReaderError("wrong_rate", f"{where}: no sampling rate is stated; give [[source]] rate_hz")
    if len(rates) > 1 and any(abs(rate - rates[0]) > RATE_TOLERANCE * rates[0] for rate in rates):
        said = " and ".join(f"{rate:g} Hz" for rate in dict.fromkeys(rates))
        own = [rate for rate in stated if rate is not None]
        hint = f"; write rate_hz = {own[0]:.10g}" if own and all(rate == own[0] for rate in own) else ""
        raise ReaderError("wrong_rate", f"{where}: the recording and rate_hz do not agree: {said}{hint}")
    if opened is not None and opened.readings and not opened.fits(rates[0]):
        raise ReaderError("wrong_rate", f"{where}: {opened.written} means {opened.meant}, rate_hz is {rates[0]:g}")
    return rates[0]


def starts_of(facts: Facts, zone: str) -> list[Start]:
    """Return what plain keys state of the time of the first sample."""
    return in_zone(facts, [Start(place, stamp) for place, stamp in time_statements(facts, zone)])


def in_zone(facts: Facts, starts: Sequence[Start]) -> list[Start]:
    """Return starts in the zone that plain keys state."""
    found = [in_stated_zone(facts, one.stamp) for one in starts]
    return [replace(one, stamp=stamp, zone=doubt) for one, (stamp, doubt) in zip(starts, found, strict=True)]


def stated_start(facts: Facts, zone: str, where: str) -> float | None:
    """Return the time of the first sample among named values, s since 1970 UTC; None: open or not stated.

    Raises:
        ReaderError: as :func:`judge_start`.
    """
    return judge_start(starts_of(facts, zone), where).value


def judge_start(starts: Sequence[Start], where: str) -> JudgedStart:
    """Return the time of the first sample on which all statements agree.

    They agree where a reading of each lies within what both resolve of one of the finest, the head of a file within 2 s
    of times of its rows.

    Raises:
        ReaderError: ``unreadable``, which quotes those that differ, or the zone that is open.
    """
    if not starts:
        return JudgedStart()
    for one in starts:
        if one.zone:
            told = f"the zone of {one.place} {one.stamp.text} is open, by {one.zone}"
            raise ReaderError("unreadable", f"{where}: {told}; write [[source]] timezone, and that key in disregard")
    ordered = sorted(starts, key=lambda one: (one.stamp.open, not one.of_rows, one.stamp.local, one.stamp.resolution))
    finest = ordered[0]
    kept = [
        reading
        for reading in finest.stamp.readings
        if all(any(_is_same(reading, time, finest, one) for time in one.stamp.readings) for one in ordered[1:])
    ]
    if not kept:
        listed = ", ".join(f"{one.place} {one.stamp.text}" for one in starts)
        zone = _zone_hint(starts)
        raise ReaderError("unreadable", f"{where}: the file states several times of its start: {listed}{zone}{REMEDY}")
    text = finest.stamp.text
    if finest.stamp.open and not len(kept) == 1 < len(finest.stamp.readings):
        return JudgedStart(opened=text, written=text if finest.stamp.local else None)
    return JudgedStart(kept[0], written=text if finest.stamp.local else None)


def _zone_hint(starts: Sequence[Start]) -> str:
    """Return what to write where stamps without a zone are quarters of an hour apart from those with one."""
    own = [time for one in starts if one.stamp.local for time in one.stamp.readings]
    other = [time for one in starts if not one.stamp.local for time in one.stamp.readings]
    apart = abs(own[0] - other[0]) if own and other else 0.0
    whole = _QUARTER * round(apart / _QUARTER)
    if not 0.0 < whole <= _LONGEST_OFFSET or abs(apart - whole) > _HEAD_BEFORE_ROWS + 1.0:
        return ""
    return f"; the one without a zone is {whole / 3600.0:g} h off: write its zone as timezone"


def _is_same(one: float, other: float, finest: Start, start: Start) -> bool:
    apart = abs(one - other)
    tolerance = START_TOLERANCE + max(finest.stamp.resolution, start.stamp.resolution)
    if finest.of_rows != start.of_rows:
        tolerance += _HEAD_BEFORE_ROWS
    return apart <= tolerance


def judge_unit(stated: Sequence[tuple[str, str]], where: str, outer: Sequence[tuple[str, str]] = ()) -> str | None:
    """Return the unit of a row, each statement with its place, or None; ``outer`` is stated of several rows.

    Raises:
        ReaderError: ``wrong_unit`` where two units of vibration differ, which quotes both places.
    """
    both = [*stated, *outer]
    of_vibration = [(place, unit) for place, unit in both if is_of_vibration(unit)]
    if stated and not is_of_vibration(stated[0][1]):
        # A temperature beside vibration has a unit of its own.
        return stated[0][1]
    if len({unit for _, unit in of_vibration}) > 1:
        listed = ", ".join(f"{place} {unit}" for place, unit in of_vibration)
        raise ReaderError("wrong_unit", f"{where}: several units are stated: {listed}{REMEDY}")
    return both[0][1] if both else None


def judged(
    rows: Sequence[StatedRow],
    where: str,
    kind: str,
    zone: str,
    *,
    called: Callable[[StatedRow], str] = lambda row: row.name,
    dated: Callable[[Facts, str], list[Start]] = starts_of,
    max_listed: int | None = None,
    disregard: Sequence[str] = (),
) -> Samples:
    """Return the samples of rows of one length, with rate, units, time of the first sample and names settled.

    Args:
        rows: at least one.
        where: name of the file in messages.
        kind: of the rows in messages ("channels").
        zone: IANA name of the zone of stamps that name none.
        called: gives the name of a row in messages.
        dated: gives what is stated of a row of the time of the first sample, as :func:`starts_of` does.
        max_listed: characters of a list of rows in messages.
        disregard: patterns of the keys that are not believed.

    Raises:
        ReaderError: ``wrong_shape`` for different lengths, ``wrong_rate``, ``wrong_unit`` or ``unreadable`` where
            statements contradict each other.
    """
    sizes = [row.values.size for row in rows]
    if len(set(sizes)) > 1:
        listed = ", ".join(f"{called(row)} {row.values.size}".strip() for row in rows)
        raise ReaderError("wrong_shape", f"{where}: {kind} of different lengths: {listed[:max_listed]}")
    rates: list[StatedNumber] = []
    starts: list[Start] = []
    units: list[str | None] = []
    beside: list[Circumstances] = []
    unlisted: list[UnlistedStatement] = []
    known: dict[int, int] = {}
    for place, row in enumerate(rows):
        first = known.setdefault(id(row.facts), place)
        if first != place and row.rate == rows[first].rate and not UNIT_IN_NAME.match(row.short):
            units.append(units[first])
            beside.append(beside[first])
            continue
        name, facts = called(row), without(row.facts, disregard)
        at, inside = f"{where}: {name}" if name else where, f" of {name}" if name and len(rows) > 1 else ""
        own = [*rate_statements(facts, at), *([] if row.rate is None else [row.rate])]
        # Within the row first: its own contradiction names it.
        judge_rate(own, at)
        rates += [replace(one, place=one.place + inside) for one in own] if inside else own
        starts += [replace(one, place=one.place + inside) for one in dated(facts, zone)]
        units.append(_unit_of(facts, row.short, at))
        beside.append(circumstances_of(facts, at))
        unlisted += unlisted_in(facts, [row.values], zone)
    rate = judge_rate(rates, where)
    start = judge_start(starts, where)
    names, short = tuple(row.name for row in rows), tuple(row.short for row in rows)
    return Samples(
        without_codes(stack_rows([row.values for row in rows])),
        names=names,
        channels=short if len(set(short)) == len(short) else names,
        **rate.fields,
        **start.fields,
        units=tuple(units),
        stored=tuple(str(row.facts.get(STORED, VALUES)) for row in rows),
        sensitivities=tuple(one.sensitivity for one in beside),
        count_scales=tuple(one.count for one in beside),
        open_gain=next((one.gain for one in beside if one.gain), None),
        open_multiplier=next((one.multiplier for one in beside if one.multiplier), ""),
        stated_speed=_common([one.speed for one in beside]),
        stated_load=_common([one.load for one in beside]),
        unlisted=bearing_on(unlisted, units) if unlisted else (),
    )


def _unit_of(facts: Facts, name: str, where: str) -> str | None:
    """Return the unit that named values and the name state; values of ``KEY#PLACE`` are stated of several rows."""
    own = unit_statements({key: value for key, value in facts.items() if "#" not in key})
    outer = unit_statements({key: value for key, value in facts.items() if "#" in key})
    behind = UNIT_IN_NAME.match(name)
    in_name = None if behind is None else known_unit(behind[2])
    if in_name is not None and is_of_vibration(in_name):
        own.append((f"the name {name!r}", in_name))
    return judge_unit(own, where, outer)


def _common(values: Sequence[float | None]) -> float | None:
    """Return the one value that is stated, None where there is none or several."""
    found = {value for value in values if value is not None}
    return found.pop() if len(found) == 1 else None


def opened_rate(samples: Samples) -> JudgedRate:
    """Return what samples say of a rate that can be read in several ways."""
    return JudgedRate(samples.rate, samples.rate_readings, samples.rate_resolution, samples.rate_written)
