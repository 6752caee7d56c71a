"""Small correct files, mutated in what they state: right, refused or silently wrong, by mutation and format.

    python -m benchmarks.loggers.fuzz [N] [--seed N] [--format NAME ...] [--json FILE] [--show N]

N is 10,000 under SPALLWATCH_EFFORT=full, else 300. Each file is read by ``sw.read``. Where two statements contradict
each other, to read it without a warning is silently wrong, whichever is taken; where all agree, to read it is right. A
refusal of a contradiction counts as right only where the file without it is read.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import effort_count, print_table, write_json
from benchmarks.loggers.judge import TOLERANCE, TOLERANCE_S
from benchmarks.loggers.shapes import CHANNEL, FILE, NAME, SIDECAR, SIDECARS, SPELLINGS, START, Shape
from benchmarks.loggers.ways import by_read

RIGHT, REFUSED, MISSED, WRONG = "right", "refused", "missed", "wrong"
FACTS = ("rate", "unit", "start")
_UNITS = ("g", "m/s2")
_RATES = (1000.0, 2048.0, 4096.0, 12800.0, 25600.0)
_APART_S = (3.0, 3600.0, 86400.0, -86400.0 * 365)
_RATIOS = (1.02, 0.5, 2.0, 10.0, 1000.0, 1.1e-3)


@dataclass
class Mutant:
    """A file, what it was made of, and whether its statements contradict each other.

    Attributes:
        shape: the file.
        how: arguments of ``sw.read``: what the format cannot state.
        contradicts: whether they do.
        start: true, s since 1970; None where it is not stated or can be read in two ways.
        words: what was done, for people.
        may_doubt: whether a refusal is right too.
    """

    shape: Shape
    how: dict[str, Any]
    contradicts: bool
    start: float | None
    words: str
    may_doubt: bool = False


class Unfit(Exception):  # noqa: N818 - no error: the mutation does not fit the format
    """A mutation that a format has no words for."""


def base(random: np.random.Generator, form: str) -> Mutant:
    """Return a correct file: each fact stated once, by one of the ways of the format."""
    rate = float(random.choice(_RATES))
    unit = str(random.choice(_UNITS))
    count = int(random.integers(256, 2048))
    samples = random.standard_normal((int(random.integers(1, 3)), count)) * random.uniform(1.0, 9.0)
    shape = Shape(form, samples - samples.mean(axis=1, keepdims=True), rate, [unit] * len(samples))
    how: dict[str, Any] = {}
    values = {"rate": rate, "unit": unit, "start": START}
    start: float | None = None
    for fact, value in values.items():
        places = [(scope, spell) for scope in (FILE, CHANNEL) for spell in SPELLINGS[form][scope].get(fact, [])]
        if not places:
            if fact in ("rate", "unit"):
                how[{"rate": "rate_hz"}.get(fact, fact)] = value
            continue
        scope, spell = places[0 if form == "lvm" else int(random.integers(len(places)))]
        shape.at[scope].update(spell(value))
        start = START if fact == "start" else start
    if form == "wav":
        how["scale"] = 64.0
    return Mutant(shape, how, False, start, "")


def _others(mutant: Mutant, fact: str) -> list[tuple[str, dict[str, Any]]]:
    """Return, for each further way to state a fact, its scope and statement as functions of nothing stated yet."""
    form, at = mutant.shape.format, mutant.shape.at
    found: list[tuple[str, dict[str, Any]]] = []
    for scope, table in ((FILE, SPELLINGS[form][FILE]), (CHANNEL, SPELLINGS[form][CHANNEL]), (SIDECAR, SIDECARS)):
        for spell in table.get(fact, []):
            keys = {key for key, _ in spell({"rate": 1.0, "unit": "g", "start": 0.0}[fact])}
            if not keys & at[scope].keys() and not (scope == SIDECAR and not _stated(mutant, fact)):
                found.append((scope, {"spell": spell}))
    return found


def _stated(mutant: Mutant, fact: str) -> bool:
    form, at = mutant.shape.format, mutant.shape.at
    for scope in (FILE, CHANNEL):
        for spell in SPELLINGS[form][scope].get(fact, []):
            if {key for key, _ in spell({"rate": 1.0, "unit": "g", "start": 0.0}[fact])} & at[scope].keys():
                return True
    return False


def _value(random: np.random.Generator, mutant: Mutant, fact: str, other: bool) -> Any:
    """Return the true value of a fact as it is stated, or another one."""
    shape = mutant.shape
    if fact == "rate":
        ratio = float(random.choice(_RATIOS)) if other else 1.0
        return float(round(shape.rate * ratio)) if shape.format == "wav" and ratio < 1 else shape.rate * ratio
    if fact == "unit":
        return {"g": "m/s2", "m/s2": "g"}[shape.units[0]] if other else shape.units[0]
    return START + (float(random.choice(_APART_S)) if other else 0.0)


def _second(fact: str, scope: str | None, other: bool) -> Callable[[np.random.Generator, Mutant], Mutant]:
    def mutate(random: np.random.Generator, mutant: Mutant) -> Mutant:
        ways = [(place, way["spell"]) for place, way in _others(mutant, fact) if _fits(mutant, fact, place, scope)]
        if not ways or not _stated(mutant, fact):
            raise Unfit
        place, spell = ways[int(random.integers(len(ways)))]
        value = _value(random, mutant, fact, other)
        mutant.shape.at[place].update(spell(value))
        mutant.contradicts = other
        rows = mutant.shape.at[CHANNEL]
        if fact == "start" and place != SIDECAR and ({"DateTime"} & mutant.shape.at[FILE].keys() or "@iso" in rows):
            # A head may be begun before its data, as those of LabVIEW are: these have the nearer statement.
            near = float(rows["wf_start_time"].astype(np.int64)) / 1e6 if "wf_start_time" in rows else rows["@iso"]
            if mutant.shape.format == "tdms" or abs(value - START) < 60.0:
                mutant.contradicts, mutant.may_doubt, mutant.start = False, True, near
        mutant.words = f"{fact} {value!r} once more in {place}: {', '.join(key for key, _ in spell(value))}"
        return mutant

    return mutate


def _fits(mutant: Mutant, fact: str, place: str, scope: str | None) -> bool:
    """Whether a place is the one asked for: "same" or "other" than that of the first statement, or the side-car."""
    if mutant.shape.format == "uff" and fact == "rate" and place == CHANNEL:
        return False  # a step is in s or in ms
    if scope is None or scope == SIDECAR:
        return place == SIDECAR if scope else place != SIDECAR
    form, at = mutant.shape.format, mutant.shape.at
    first = {
        each
        for each in (FILE, CHANNEL)
        for spell in SPELLINGS[form][each].get(fact, [])
        if {key for key, _ in spell({"rate": 1.0, "unit": "g", "start": 0.0}[fact])} & at[each].keys()
    }
    return place != SIDECAR and ((place in first) == (scope == "same"))


def _name(other: bool) -> Callable[[np.random.Generator, Mutant], Mutant]:
    def mutate(random: np.random.Generator, mutant: Mutant) -> Mutant:
        if not _stated(mutant, "start"):
            raise Unfit
        # Names may be in another zone than the files, so they contradict these from a day on.
        start = START + (float(random.choice(_APART_S[2:])) if other else 0.0)
        mutant.shape.name = datetime.fromtimestamp(start, UTC).strftime(
            str(random.choice(["rec_%Y%m%d_%H%M%S", "%Y-%m-%dT%H-%M-%S"]))
        )
        mutant.contradicts = other
        mutant.words = f"{NAME} {mutant.shape.name}"
        return mutant

    return mutate


def _swapped(random: np.random.Generator, mutant: Mutant) -> Mutant:
    """Store and state another unit."""
    unit = str(random.choice(["mg", "m/s^2", "m/s²", "mm/s2", "g"]))
    shape = mutant.shape
    if shape.format == "uff" and unit == "m/s²":
        raise Unfit
    shape.units = [unit] * len(shape.units)
    if "unit" in mutant.how:
        raise Unfit
    for scope in (FILE, CHANNEL):
        for spell in SPELLINGS[shape.format][scope].get("unit", []):
            for key, _ in spell("g"):
                if key in shape.at[scope]:
                    shape.at[scope][key] = unit
    mutant.words = f"stored and stated in {unit}"
    return mutant


def _mixed(random: np.random.Generator, mutant: Mutant) -> Mutant:
    """Store and state the second channel in another unit than the first."""
    shape = mutant.shape
    keys = [key for spell in SPELLINGS[shape.format][CHANNEL].get("unit", []) for key, _ in spell("g")]
    own = [key for key in keys if key in shape.at[CHANNEL]]
    if len(shape.units) < 2 or not own:
        raise Unfit
    shape.units[1] = {"g": "m/s2", "m/s2": "g"}[shape.units[0]]
    shape.one = dict.fromkeys(own, shape.units[1])
    mutant.words = f"channels in {' and '.join(shape.units)}"
    return mutant


def _differ(random: np.random.Generator, mutant: Mutant) -> Mutant:
    """State another rate for the second channel, of as many samples."""
    shape = mutant.shape
    spells = SPELLINGS[shape.format][CHANNEL].get("rate", []) + (
        [] if shape.format != "lvm" else SPELLINGS["lvm"][FILE]["rate"]
    )
    keys = [
        (key, spell) for spell in spells for key, _ in spell(1.0) if not key.startswith("@") or shape.format == "uff"
    ]
    scope = FILE if shape.format == "lvm" else CHANNEL
    own = [(key, spell) for key, spell in keys if key in shape.at[scope]]
    if len(shape.units) < 2 or not own:
        raise Unfit
    key, spell = own[0]
    value = _value(random, mutant, "rate", True)
    shape.one[key] = dict(spell(value))[key]
    mutant.contradicts = True
    mutant.words = f"second channel at {value:g} Hz, the first at {shape.rate:g}"
    return mutant


def _order(random: np.random.Generator, mutant: Mutant) -> Mutant:
    """Write the date with day and month in an order that can, or cannot, be confused."""
    shape = mutant.shape
    if shape.format not in ("csv", "hdf5", "netcdf", "mat"):
        raise Unfit
    confused = bool(random.integers(2))
    start = datetime(2024, 5, 4 if confused else 21, 12, 0, 0, tzinfo=UTC)
    for key in ("Start Time", "Date", "Time", "start_utc", "start_time"):
        for scope in (FILE, CHANNEL):
            shape.at[scope].pop(key, None)
    if {"@iso", "@since"} & shape.at[CHANNEL].keys():
        raise Unfit
    pattern = str(random.choice(["%d/%m/%Y %H:%M:%S", "%m/%d/%Y %H:%M:%S"]))
    shape.at[FILE]["Start Time" if shape.format == "csv" else "start_time"] = start.strftime(pattern)
    mutant.start = None if confused else start.timestamp()
    mutant.may_doubt, mutant.words = True, f"start {start.strftime(pattern)}"
    return mutant


def _plain(random: np.random.Generator, mutant: Mutant) -> Mutant:
    return mutant


MUTATIONS: Mapping[str, Callable[[np.random.Generator, Mutant], Mutant]] = {
    "none": _plain,
    **{f"{fact} twice, agree": _second(fact, None, False) for fact in FACTS},
    **{f"{fact} contradicts, same scope": _second(fact, "same", True) for fact in FACTS},
    **{f"{fact} contradicts, other scope": _second(fact, "other", True) for fact in FACTS},
    **{f"{fact} contradicts, side-car": _second(fact, SIDECAR, True) for fact in FACTS},
    **{f"{fact} in the side-car too": _second(fact, SIDECAR, False) for fact in FACTS},
    "start in the name too": _name(False),
    "start contradicts, name": _name(True),
    "another unit": _swapped,
    "channels in two units": _mixed,
    "channels at two rates": _differ,
    "order of the date": _order,
}
"""By name: what is done to a correct file."""


def verdict(mutant: Mutant, folder: Path) -> tuple[str, str]:
    """Write and read a mutant; return the word for what came, and the details of what is not right."""
    path = mutant.shape.write(folder)
    came = by_read(path, mutant.how)
    if came.refused:
        word = RIGHT if mutant.contradicts or mutant.may_doubt else REFUSED
        crashed = came.refused.split(":", 1)[0].endswith("Error")
        return ("crashed" if crashed else word), came.refused.replace(str(folder), "")
    block = came.blocks[0]
    if mutant.contradicts:
        doubted = bool(block.flags) or (block.time is None and mutant.words.startswith(("start", NAME)))
        return (
            (RIGHT, "")
            if doubted
            else (WRONG, f"read at {came.rate:g} Hz, start {block.time}, RMS {[*block.rms.values()]}")
        )
    expected = np.sqrt(np.mean(mutant.shape.samples**2, axis=1))
    values = np.array([*block.rms.values()])
    if len(values) != len(expected):
        return WRONG, f"{len(values)} channels for {len(expected)}"
    if came.rate is None or abs(came.rate / mutant.shape.rate - 1.0) > TOLERANCE:
        return WRONG, f"rate {came.rate} for {mutant.shape.rate}"
    if np.max(np.abs(values / expected - 1.0)) > TOLERANCE:
        return WRONG, f"RMS {values} for {expected}"
    if block.time is None:
        return (RIGHT, "") if mutant.start is None else (MISSED, "no start")
    if mutant.start is None or abs(block.time - mutant.start) > TOLERANCE_S:
        return (WRONG if not block.flags else RIGHT), f"start {block.time} for {mutant.start}"
    return RIGHT, ""


def run(count: int, seed: int, formats: list[str]) -> tuple[list[dict[str, Any]], list[str]]:
    """Read mutants; return rows of counts by mutation and format, and a line for each that is not right."""
    counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    lines: list[str] = []
    names = list(MUTATIONS)
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as scratch:
        made = index = 0
        while made < count:
            random = np.random.default_rng([seed, index])
            form, name = formats[index % len(formats)], names[index // len(formats) % len(names)]
            index += 1
            try:
                mutant = MUTATIONS[name](random, base(random, form))
            except Unfit:
                if index > 50 * (count + len(names) * len(formats)):
                    break
                continue
            folder = Path(scratch) / "mutant"
            folder.mkdir()
            word, detail = verdict(mutant, folder)
            if mutant.contradicts and word == RIGHT:
                (folder / "plain").mkdir()
                plain, why = verdict(base(np.random.default_rng([seed, index - 1]), form), folder / "plain")
                word, detail = (word, detail) if plain == RIGHT else (plain, f"without the contradiction: {why}")
            shutil.rmtree(folder)
            counts[name, form][word] += 1
            made += 1
            if word != RIGHT:
                at = {
                    key: {each: str(value) for each, value in words.items()}
                    for key, words in mutant.shape.at.items()
                    if words
                }
                lines.append(f"{word} | {form} | {name} | {mutant.words} | stated {at} | {detail}")
    words = (RIGHT, REFUSED, MISSED, WRONG, "crashed")
    order = {name: place for place, name in enumerate(names)}
    rows = [
        {"mutation": name, "format": form, **{word: found[word] for word in words}}
        for (name, form), found in sorted(counts.items(), key=lambda item: (order[item[0][0]], item[0][1]))
    ]
    return rows, lines


def main() -> None:
    """Fuzz, print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=effort_count(quick=300, full=10_000))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--format", nargs="+", choices=SPELLINGS, default=list(SPELLINGS))
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--show", type=int, default=40, help="lines of what is not right")
    options = parser.parse_args()
    rows, lines = run(options.count, options.seed, options.format)
    print_table("by mutation and format", rows)
    for line in lines[: options.show]:
        print(line[:500])
    words = [word for word in rows[0] if word not in ("mutation", "format")]
    totals = {word: sum(int(row[word]) for row in rows) for word in words}
    print_table("totals", [{"inputs": sum(totals.values()), **totals}])
    write_json(options.json, {"seed": {"seed": options.seed}, "totals": totals, "mutations": rows})


if __name__ == "__main__":
    main()
