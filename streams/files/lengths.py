"""Which rows of a file are taken where they differ in length: those that are wanted, else those that can be told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from streams.files.columns import kinds_of
from streams.files.judge import StatedRow, judge_rate
from streams.files.keys import FACTORS
from streams.files.statements import rate_statements, unit_statements
from streams.types.samples import ReaderError, Samples

_MANY_TIMES = 8
"""Rows so many times as long as all others are those of the signals."""


def of_one_length(
    rows: Sequence[StatedRow],
    wanted: Sequence[str],
    slow: Sequence[str],
    where: str,
    kind: str,
    *,
    called: Callable[[StatedRow], str] = lambda row: row.name,
    max_listed: int | None = None,
) -> tuple[list[StatedRow], tuple[str, ...]]:
    """Return the rows of one length that are taken, and the names of those that are left out.

    Args:
        rows: of a file, at least one.
        wanted: patterns of names of the rows that are configured, none: not known.
        slow: those of them that are process values, such as a speed: of another length they are interpolated over the
            time of the others.
        where, kind, called, max_listed: as in :func:`streams.files.judge.judged`.

    Raises:
        ReaderError: ``wrong_shape`` where wanted rows differ in length; where nothing is wanted and the rows that could
            be vibration do, none being many times as long; and where a slow row lasts another time.
    """
    sizes = {row.values.size for row in rows}
    if len(sizes) == 1:
        return list(rows), ()
    process = [row for row in rows if _matches(row, slow)]
    chosen = [row for row in rows if _matches(row, wanted) and not _matches(row, slow)]
    if not chosen:
        chosen = _could_be_vibration(rows)
    if len({row.values.size for row in chosen}) > 1:
        listed = ", ".join(f"{called(row)} {row.values.size}".strip() for row in chosen)
        hint = "" if wanted else "; choose channels of one length"
        raise ReaderError("wrong_shape", f"{where}: {kind} of different lengths: {listed[:max_listed]}{hint}")
    first = chosen[0]
    kept = [
        _interpolated(row, first, where) if row in process else row
        for row in rows
        if row in process or row.values.size == first.values.size
    ]
    names = {row.name for row in kept}
    return kept, tuple(row.name for row in rows if row.name not in names)


def with_beside(samples: Samples, beside: tuple[str, ...]) -> Samples:
    """Return samples with the names of rows that are left out."""
    return replace(samples, beside=beside) if beside else samples


def _matches(row: StatedRow, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for name in (row.name, row.short) for pattern in patterns)


def _could_be_vibration(rows: Sequence[StatedRow]) -> list[StatedRow]:
    """Return the rows that may be signals: those of vibration, of several lengths the far longest."""
    units = [next((unit for _, unit in unit_statements(row.facts)), "") for row in rows]
    kinds = kinds_of([row.name for row in rows], units, [row.values for row in rows])
    found = [row for row, kind in zip(rows, kinds, strict=True) if kind.kind == "vibration"] or list(rows)
    longest, *others = sorted({row.values.size for row in found}, reverse=True)
    if all(_MANY_TIMES * size <= longest for size in others):
        return [row for row in found if row.values.size == longest]
    return found


def _interpolated(row: StatedRow, signal: StatedRow, where: str) -> StatedRow:
    """Return a row of process values at the times of the samples of a signal."""
    count, length = row.values.size, signal.values.size
    if count == length:
        return row
    rate, fast = (_slowest_rate(each, where) for each in (row, signal))
    if rate is not None and fast is not None and abs(count / rate - length / fast) > 1.0 / min(rate, fast):
        raise ReaderError(
            "wrong_shape",
            f"{where}: {row.name} lasts {count / rate:g} s, {signal.name} {length / fast:g} s; expected the same time",
        )
    places = (np.arange(length) + 0.5) * (count / length) - 0.5
    values = np.interp(places, np.arange(count), row.values).astype(signal.values.dtype)
    return replace(row, values=values, facts={k: v for k, v in row.facts.items() if k.partition("#")[0] not in FACTORS})


def _slowest_rate(row: StatedRow, where: str) -> float | None:
    """Return the stated rate in Hz: of a process value in Hz where it might be in kHz."""
    place = f"{where}: {row.name}"
    found = judge_rate(rate_statements(row.facts, place), place)
    return min(found.readings, default=None) if found.value is None else found.value
