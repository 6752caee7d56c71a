"""Would the constants of the rule be the same without the set on which they are judged? Leave one data set out.

Run as ``python -m benchmarks.naming_fitted [--quick] [--json FILE]``. Each set of recordings, and the training seeds of
``benchmarks/seeded_faults.py``, is left out in turn: of all values in ``GRID`` those are taken that score best on the
other sets, and judged on the one left out. A score is (right - 5 wrong - 5 healthy named) over the verdicts of the set,
summed over the sets; ties go to more joined names, then to the values that ship. The recordings are taken at speeds
stated 0, 2 and 4 % wrong either way. Tables: by set, with the chosen values and with those that ship; and what each
value alone does to all sets.

The values are module constants; those of the first group act before naming, so that each needs its own pass.
"""

from __future__ import annotations

import argparse
import importlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Row, print_table, write_json
from benchmarks.naming_seeded import block_of, settings_of
from benchmarks.seeded_faults import TRAINING, kept
from monitor.health import channel as channel_module
from streams.block import Block
from tests.conftest import recordings_folder
from tests.support.recordings import CASES, OTHER_ENDS, judge, watch
from tests.support.steps import Steps

_NAMING, _SHAFT, _FEATURES = (f"monitor.health.{name}" for name in ("naming", "spectrum.shaft", "spectrum.features"))
Key = tuple[tuple[str, ...], str]
GRID: dict[str, dict[Key, tuple[float, ...]]] = {
    "before naming": {
        ((_SHAFT,), "MIN_SCORE"): (2.5, 3.0, 3.5),
        ((_SHAFT,), "MIN_MARGIN"): (0.3, 0.5, 0.8),
    },
    "naming": {
        ((_NAMING,), "MIN_DEPTH"): (0.2, 0.25, 0.3),
        ((_NAMING,), "_CLEARANCE"): (6.0, 9.1, 12.0),
        ((_NAMING,), "MUCH_DEEPER"): (1.5, 2.0),
        ((_NAMING,), "HALF_AS_DEEP"): (0.35, 0.5),
    },
}
"""Values that are tried, by the modules that hold a constant and its name."""
SPEED_ERRORS = (-0.04, -0.02, 0.0, 0.02, 0.04)
VERDICTS = ("right", "joined", "silent", "wrong", "healthy named", "quiet", "disputed")
_WRONG = -5.0

Constants = Mapping[Key, float]
Judge = Callable[[str | None], str]


@contextmanager
def constants(values: Constants) -> Iterator[None]:
    """Run with other values of module constants."""
    places = [(importlib.import_module(module), key) for key in values for module in key[0]]
    before = [getattr(module, key[1]) for module, key in places]
    try:
        for module, key in places:
            setattr(module, key[1], values[key])
        yield
    finally:
        for (module, key), value in zip(places, before, strict=True):
            setattr(module, key[1], value)


def choices(group: str) -> list[dict[Key, float]]:
    """Return all values of a group of constants, those that ship first."""
    grid = GRID[group]
    found = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    return sorted(found, key=lambda values: values != shipped(group))


def shipped(group: str) -> dict[Key, float]:
    """Return the values of a group of constants as they ship."""
    return {key: getattr(importlib.import_module(key[0][0]), key[1]) for key in GRID[group]}


class Calls:
    """Holds the calls of the naming while a block goes through the program."""

    def __init__(self) -> None:
        """Take the place of the function that the channel calls."""
        self.calls: list[tuple[tuple[Any, ...], dict[str, Any]]] = []
        self.function: Callable[..., Any] = channel_module.name_fault

    def __enter__(self) -> Calls:
        """Begin."""
        channel_module.name_fault = self._called
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        channel_module.name_fault = self.function

    def _called(self, *given: Any, **named: Any) -> Any:
        self.calls.append((given, named))
        return self.function(*given, **named)

    def faults(self, number: int) -> str | None:
        """Return the name that a call gives now."""
        given, named = self.calls[number]
        return self.function(*given, **named).fault


@dataclass
class Verdicts:
    """The verdicts of a set by the constants before naming, and of naming.

    Attributes:
        codes: a list for each record, (before, naming), places in ``VERDICTS``.
    """

    codes: list[NDArray[np.int8]] = field(default_factory=list[NDArray[np.int8]])

    def counts(self, before: int, naming: int) -> Counter[str]:
        """Return how often each verdict was given."""
        return Counter(VERDICTS[int(code[before, naming])] for code in self.codes)

    def score(self) -> NDArray[np.float64]:
        """Return the score of all constants, (before, naming)."""
        worth = {"right": 1.0, "joined": 1e-3, "wrong": _WRONG, "healthy named": _WRONG}
        table = np.array([worth.get(verdict, 0.0) for verdict in VERDICTS])
        return table[np.stack(self.codes)].mean(axis=0)


def take(blocks: Callable[[], Iterator[list[Judge]]], into: Verdicts) -> None:
    """Take a record with all constants; ``blocks`` runs it and yields the judges of the names of each block."""
    before, naming = choices("before naming"), choices("naming")
    rows: list[list[list[int]]] = []
    for values in before:
        with constants(values), Calls() as calls:
            judges = [one for block in blocks() for one in block]
        if len(judges) != len(calls.calls):
            raise AssertionError(f"{len(judges)} channels were named, {len(calls.calls)} calls were seen")
        for number, judge_name in enumerate(judges):
            found: list[int] = []
            for tried in naming:
                with constants(tried):
                    found.append(VERDICTS.index(judge_name(calls.faults(number))))
            if len(rows) <= number:
                rows.append([])
            rows[number].append(found)
    into.codes += [np.array(row, dtype=np.int8) for row in rows]


def recorded(*, quick: bool) -> dict[str, Verdicts]:
    """Return the verdicts of each set of recordings."""
    folder = recordings_folder()
    sets: dict[str, Verdicts] = {}
    for case in (*CASES, *OTHER_ENDS):
        for error in (0.0,) if quick else SPEED_ERRORS:

            def blocks(case: Any = case, error: float = error) -> Iterator[list[Judge]]:
                for block, steps, _ in watch(case.config, folder / case.file, speed_error=error):
                    if not isinstance(block, Block):
                        raise AssertionError(f"{case.file}: {block}")
                    yield [case.judge for output in steps.outputs.values() if output.naming is not None]

            take(blocks, sets.setdefault(case.file.split("/")[0], Verdicts()))
    return sets


def seeded(seeds: Sequence[int], folder: Path | None) -> Verdicts:
    """Return the verdicts of seeded faults; ``folder`` keeps the records between runs."""
    found = Verdicts()
    for seed in seeds:
        record = kept(seed, folder)
        part = record.plan.part

        def blocks(record: Any = record, part: str | None = part) -> Iterator[list[Judge]]:
            steps = Steps(settings_of(record.plan.bearing, record.plan.band))
            steps.take(block_of(record))
            yield [lambda fault: judge(part, fault)]

        take(blocks, found)
    return found


def best(sets: Sequence[Verdicts]) -> tuple[int, int]:
    """Return the places of the constants that score best on some sets; of equal ones the first, which ship."""
    total = np.sum([one.score() for one in sets], axis=0)
    before, naming = np.unravel_index(int(np.argmax(np.round(total, 9))), total.shape)
    return int(before), int(naming)


def described(values: Constants) -> str:
    """Return the values that differ from those that ship."""
    ships = shipped("before naming") | shipped("naming")
    changed = [f"{key[1].strip('_').lower()} {value:g}" for key, value in values.items() if value != ships[key]]
    return ", ".join(changed)


def left_out_rows(sets: Mapping[str, Verdicts]) -> list[Row]:
    """Return what each set says of constants that were chosen without it, and of those that ship."""
    rows: list[Row] = []
    for name, verdicts in sets.items():
        place = best([other for key, other in sets.items() if key != name])
        values = choices("before naming")[place[0]] | choices("naming")[place[1]]
        for kind, (before, naming) in (("chosen without it", place), ("as shipped", (0, 0))):
            counts = verdicts.counts(before, naming)
            rows.append(
                {
                    "left out": name,
                    "constants": kind,
                    **{verdict: counts[verdict] for verdict in VERDICTS},
                    "other than shipped": described(values) if kind != "as shipped" else "",
                }
            )
    total = Counter[str]()
    for row in rows:
        if row["constants"] != "as shipped":
            total.update({verdict: int(row[verdict] or 0) for verdict in VERDICTS})
    rows.append(
        {
            "left out": "all",
            "constants": "chosen without it",
            **{v: total[v] for v in VERDICTS},
            "other than shipped": "",
        }
    )
    return rows


def single_rows(sets: Mapping[str, Verdicts]) -> list[Row]:
    """Return what a change of one constant does to all sets."""
    rows: list[Row] = []
    for group in GRID:
        ships = shipped(group)
        for place, values in enumerate(choices(group)):
            changed = [key for key in values if values[key] != ships[key]]
            if len(changed) > 1 or (not changed and group != "naming"):
                continue
            where = (place, 0) if group == "before naming" else (0, place)
            counts: Counter[str] = Counter()
            for verdicts in sets.values():
                counts += verdicts.counts(*where)
            rows.append({"change": described(values) or "as shipped", **{v: counts[v] for v in VERDICTS}})
    return rows


def main() -> None:
    """Run, print, write."""
    parser = argparse.ArgumentParser(description="Leave one data set out.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="the stated speed and 20 seeds only")
    parser.add_argument("--records", type=Path, metavar="DIR", help="keep seeded records there between runs")
    options = parser.parse_args()
    for group in GRID:
        outside = [key for key, value in shipped(group).items() if value not in GRID[group][key]]
        if outside:
            raise SystemExit(f"GRID lacks the shipped value of {outside}")
    sets = recorded(quick=options.quick)
    sets["seeded"] = seeded(TRAINING[:20] if options.quick else TRAINING, options.records)
    rows, single = left_out_rows(sets), single_rows(sets)
    print_table("Leave one set out", rows)
    print_table("One constant changed, all sets", single)
    write_json(options.json, {"left_out": rows, "single": single})


if __name__ == "__main__":
    main()
