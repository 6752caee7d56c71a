"""The one judge of what files state: facts about their samples, or a refusal that quotes what contradicts itself.

A format gives rows with what is stated of each under plain keys (:mod:`streams.files.statements`), and
:class:`StatedValue` where other parts of a file state the same quantity.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from streams.files.statements import (
    STORED,
    Facts,
    known_unit,
    nice_rate,
    rates_by_key,
    stated_time,
    stated_unit,
    written_start,
)
from streams.types.samples import RATE_TOLERANCE, VALUES, ReaderError, Samples, stack_rows


@dataclass(frozen=True)
class StatedValue:
    """What one place of a file states of a quantity.

    Attributes:
        place: as messages call it: a plain key, "the header", the name of a side-car.
        value: rate in Hz; None where that place states none.
        holds: whether this value is the one to go by where several agree; else the first is.
    """

    place: str
    value: float | None
    holds: bool = False


@dataclass(frozen=True, eq=False)
class StatedRow:
    """A row of samples as a format gives it.

    ``name`` is its full name in the file, ``short`` the one it has where no other row is called so; ``facts`` is what
    is stated of it.
    """

    values: NDArray[np.floating]
    name: str
    short: str
    facts: Facts


def rate_of(statements: Sequence[StatedValue], where: str) -> float | None:
    """Return the rate in Hz that the places of a file state, None where none does.

    Raises:
        ReaderError: ``wrong_rate`` where they differ by more than 1e-4 of the one that holds.
    """
    known = [(statement.place, statement.value) for statement in statements if statement.value is not None]
    if not known:
        return None
    held = next((s.value for s in statements if s.holds and s.value is not None), known[0][1])
    if any(abs(value - held) > RATE_TOLERANCE * held for _, value in known):
        (first, value), *others = known
        said = "".join(f", {place} {other:g} Hz" for place, other in others)
        raise ReaderError("wrong_rate", f"{where}: {first} states {value:g} Hz{said}")
    return held


def stated_rate(facts: Facts, where: str) -> float | None:
    """Return the sampling rate in Hz among values under plain keys, or None.

    Raises:
        ReaderError: ``wrong_rate`` where a value is no positive number or two of them differ.
    """
    found = rates_by_key(facts, where)
    rates = list(found.values())
    if any(not math.isclose(rate, rates[0], rel_tol=RATE_TOLERANCE) for rate in rates):
        listed = ", ".join(f"{key} {rate:g} Hz" for key, rate in found.items())
        raise ReaderError("wrong_rate", f"{where}: the file states several sampling rates: {listed}")
    return nice_rate(rates[0], 1e-9) if rates else None


def common_rate(rates: Iterable[float | None], rows: str, where: str, joint: str = ", ") -> float | None:
    """Return the lowest rate in Hz that ``rows`` ("channels", "vectors") state, None where none is stated.

    Raises:
        ReaderError: ``wrong_rate`` where they differ by more than 1e-4 of it.
    """
    stated = sorted({rate for rate in rates if rate is not None})
    if stated and stated[-1] - stated[0] > RATE_TOLERANCE * stated[0]:
        listed = joint.join(f"{rate:g}" for rate in stated)
        raise ReaderError("wrong_rate", f"{where}: {rows} of different rates: {listed} Hz")
    return stated[0] if stated else None


def agreed_rate(stated: Sequence[float | None], configured: float | None, where: str) -> float:
    """Return the rate in Hz on which the ``stated`` and ``configured`` ones agree.

    Raises:
        ReaderError: ``wrong_rate`` where they differ by more than 1e-4 of it or none is stated.
    """
    rates = [rate for rate in (*stated, configured) if rate is not None]
    if not rates:
        raise ReaderError("wrong_rate", f"{where}: no sampling rate is stated; give [[source]] rate_hz")
    if any(abs(rate - rates[0]) > RATE_TOLERANCE * rates[0] for rate in rates):
        said = " and ".join(f"{rate:g} Hz" for rate in dict.fromkeys(rates))
        own = [rate for rate in stated if rate is not None]
        hint = f"; write rate_hz = {own[0]:.10g}" if own and all(rate == own[0] for rate in own) else ""
        raise ReaderError("wrong_rate", f"{where}: the recording and rate_hz do not agree: {said}{hint}")
    return rates[0]


def judged(
    rows: Sequence[StatedRow],
    where: str,
    kind: str,
    zone: str,
    *,
    called: Callable[[StatedRow], str] = lambda row: row.name,
    dated: Callable[[Facts, str], tuple[float | None, str | None]] = stated_time,
    of_rates: str | None = None,
    max_listed: int | None = None,
) -> Samples:
    """Return the samples of rows of one length, with rate, units, time of the first sample and names settled.

    Args:
        rows: at least one.
        where: name of the file in messages.
        kind: of the rows in messages ("channels"), ``of_rates`` where their rates differ.
        zone: IANA name of the zone of stamps that name none.
        called: gives the name of a row in messages.
        dated: gives the time of the first sample that is stated of a row, as :func:`stated_time` does.
        max_listed: characters of a list of rows in messages.

    Raises:
        ReaderError: ``wrong_shape`` for different lengths, ``wrong_rate`` for different rates.
    """
    sizes = [row.values.size for row in rows]
    if len(set(sizes)) > 1:
        listed = ", ".join(f"{called(row)} {row.values.size}".strip() for row in rows)
        raise ReaderError("wrong_shape", f"{where}: {kind} of different lengths: {listed[:max_listed]}")
    rates = (stated_rate(row.facts, f"{where}: {called(row)}") for row in rows)
    times = [dated(row.facts, zone) for row in rows]
    names, short = tuple(row.name for row in rows), tuple(row.short for row in rows)
    return Samples(
        stack_rows([row.values for row in rows]),
        names=names,
        channels=short if len(set(short)) == len(short) else names,
        rate=common_rate(rates, of_rates or kind, where),
        start=next((start for start, _ in times if start is not None), None),
        stamp=next((stamp for _, stamp in times if stamp is not None), None),
        written=next((text for row in rows if (text := written_start(row.facts, zone)) is not None), None),
        units=tuple(known_unit(stated_unit(row.facts)) for row in rows),
        stored=tuple(str(row.facts.get(STORED, VALUES)) for row in rows),
    )
