"""Compare two observations column by column, bit for bit or within a relative change."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.regression.observe import TEXTS, Observation

ALLOWED: Mapping[str, str] = {r".*velocity_(rms|floor|status|zone)(/.*)?": "velocity is newer than the baseline"}
"""Columns that may be on one side only: the reason by a regular expression of the name."""


@dataclass(frozen=True)
class Difference:
    """The first difference in a column.

    Attributes:
        name: of the column.
        where: the block (or row) of the first difference, and how many values differ.
    """

    name: str
    where: str
    baseline: str
    present: str


@dataclass
class Comparison:
    """What was compared, and what differs."""

    records: int = 0
    values: int = 0
    events: int = 0
    forecasts: int = 0
    greatest: float = 0.0
    differences: list[Difference] = field(default_factory=list)


def compare(baseline: Observation, present: Observation, relative: float = 0.0, *, texts: bool = False) -> Comparison:
    """Compare what two trees said in one case.

    Args:
        baseline: columns of the baseline.
        present: columns of the present tree.
        relative: change of a number, over the larger of the two, that counts as none; 0: every bit counts.
        texts: whether sentences for people are compared, too.
    """
    result = Comparison()
    for name in dict.fromkeys([*baseline, *present]):
        if not texts and TEXTS & set(name.split("/")):
            continue
        if name not in baseline or name not in present:
            if not any(re.fullmatch(pattern, name) for pattern in ALLOWED):
                side = "baseline" if name in baseline else "present"
                result.differences.append(Difference(name, f"only in {side}", "", ""))
            continue
        _count(result, name, present[name])
        _compare_column(result, name, (baseline, present), relative)
    return result


def _count(result: Comparison, name: str, column: NDArray[Any]) -> None:
    """Count a column; the rows of a table are counted by a column that each of its rows has."""
    result.values += column.size
    if "/store/" in name or name.startswith("store/"):
        result.records += len(column) * name.endswith("/blocks/status")
        result.events += len(column) * name.endswith("/events/sequence")
        result.forecasts += len(column) * name.endswith("/forecasts/sequence")


def _compare_column(result: Comparison, name: str, sides: tuple[Observation, Observation], relative: float) -> None:
    old, new = sides[0][name], sides[1][name]
    if old.shape != new.shape:
        result.differences.append(Difference(name, "shape", str(old.shape), str(new.shape)))
        return
    different = np.atleast_1d(old != new)
    if old.dtype.kind in "fiu" and new.dtype.kind in "fiu":
        old, new = old.astype(np.float64), new.astype(np.float64)
        different &= ~(np.isnan(old) & np.isnan(new))
        with np.errstate(invalid="ignore"):
            change = np.abs(new - old) / np.maximum(np.abs(old), np.abs(new))
        finite = change[different & np.isfinite(change)]
        result.greatest = max(result.greatest, float(finite.max(initial=0.0)))
        different &= ~(change <= relative)
    if different.any():
        place = tuple(int(index[0]) for index in np.nonzero(different))
        where = f"{_row(sides[0], name, place)}; {np.count_nonzero(different)} of {different.size} differ"
        result.differences.append(Difference(name, where, _shown(old[place]), _shown(new[place])))


def _row(side: Observation, name: str, place: tuple[int, ...]) -> str:
    """Name the row of a table: its block, where it has one."""
    table, rest = name.rpartition("/")[0], "".join(f"[{index}]" for index in place[1:])
    numbers = side.get(f"{table}/sequence")
    if numbers is None or place[0] >= len(numbers):
        return f"row {place[0]}{rest}"
    return f"block {numbers[place[0]]:g}{rest}"


def _shown(value: Any) -> str:
    return repr(value.item() if hasattr(value, "item") else value)[:80]
