"""The engine against the fourth set of random scenes (reference.periodic.fourth) and the oracle's references of it.

Run as ``python -m benchmarks.engine.fourth references [--set NAME] [--workers N] [--seconds S]`` and
``python -m benchmarks.engine.fourth compare [--set NAME] [--before FILE] [--json FILE] [--quick]``.

``references`` simulates each scene from rest, those of ``development`` first, and keeps what it finds in FILE: it goes
on where it ended, and a scene that takes longer than the limit is noted as such, until a longer limit is given.
``compare`` asks the engine at each accuracy of ACCURACIES and prints:

1. statuses: their shares, and thread time of a scene at an operating point already seen;
2. errors: by status and quantity (RMS, peak, each line) the share of stated errors that are at least the true one, the
   answers that are off by more than three times what they state, and stated over true error, the latter taken to be
   no smaller than what the oracle itself may be off by;
3. work: time against error of the RMS of converged answers;
4. wrong: converged answers that are off by more than three times what they state.

The set ``held_out`` is compared once, when the engine no longer changes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, print_table, write_json
from reference.periodic.fourth import SETS, fourth_scene
from reference.periodic.judge import Compared, answer, compared
from reference.periodic.rig import OracleScene
from reference.periodic.settle import Caps, simulate_oracle

FILE = Path(__file__).with_name("fourth.json")
# Scenes from the first on that are asked for at each accuracy.
ACCURACIES = {2e-3: 400, 1e-3: 400, 1e-5: 24, 1e-8: 12}
QUICK = {1e-3: 12}
# A scene that is answered sooner is asked again, and timed then, ms. Smaller accuracies than _FINE are asked where it
# was answered as soon as _CHEAP at those before, ms: others take minutes.
_SOON, _CHEAP, _FINE = 1000.0, 50.0, 1e-4
_KEYS = ("asked for", "status", "quantity")
_BEFORE = ("share", "ms, median", "bounded", "stated over true", "error, median")


def load(path: Path = FILE) -> list[dict[str, Any]]:
    """Return the references that are kept: set, number and key of a scene, and its result."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else []


def save(entries: list[dict[str, Any]], path: Path = FILE) -> None:
    """Keep references, one a line, in the order of their sets and numbers."""
    ordered = sorted(entries, key=lambda entry: (list(SETS).index(entry["set"]), entry["number"]))
    lines = ",\n".join(json.dumps(entry, separators=(",", ":")) for entry in ordered)
    partial = path.with_suffix(".partial")
    partial.write_text(f"[\n{lines}\n]\n", encoding="utf-8")
    partial.replace(path)


def is_open(entry: dict[str, Any] | None, seconds: float) -> bool:
    """Return whether a scene has no reference yet that a limit of so many seconds can give."""
    if entry is None:
        return True
    cut = entry["status"] == "limit" or (entry["status"] == "settled" and entry["error"] is None)
    return cut and entry["limit"] < seconds


def reference(name: str, number: int, seconds: float) -> dict[str, Any]:
    """Return the reference of one scene of a set; ``seconds`` limits each of its two runs."""
    scene = fourth_scene(SETS[name][0], number)
    found = simulate_oracle(scene, caps=Caps(seconds=seconds))
    status = "limit" if found.status == "unresolved" and found.seconds >= seconds else found.status
    entry: dict[str, Any] = {"set": name, "number": number, "key": scene.key(), "status": status, "limit": seconds}
    entry |= {"seconds": round(found.seconds, 1)}
    if status in ("limit", "unresolved"):
        return entry
    entry |= {"repeats": found.repeats, "instants": found.instants, "grazes": found.grazes}
    entry |= {field: _digits(getattr(found, field), 10) for field in ("rms", "peak", "lines")}
    errors = ("error", "peak_error", "line_errors", "standard_error", "spread")
    return entry | {field: _digits(getattr(found, field), 3) for field in errors}


def _digits(value: Any, digits: int) -> Any:
    if isinstance(value, tuple):
        return [_digits(each, digits) for each in value]
    return float(f"{value:.{digits}g}") if value == value else None


def make_references(names: list[str], workers: int, seconds: float, path: Path = FILE) -> None:
    """Make the references that are missing, and say after each how far it is."""
    kept = {(entry["set"], entry["number"]): entry for entry in load(path)}
    todo = [(name, n) for name in names for n in range(SETS[name][1]) if is_open(kept.get((name, n)), seconds)]
    with ProcessPoolExecutor(workers) as pool:
        for future in as_completed([pool.submit(reference, name, n, seconds) for name, n in todo]):
            entry = future.result()
            kept[entry["set"], entry["number"]] = entry
            save(list(kept.values()), path)
            said = f"{entry['set']} {entry['number']}: {entry['status']}, {entry['seconds']} s"
            print(f"{said}; {progress(kept)}", flush=True)


def progress(kept: Mapping[tuple[str, int], dict[str, Any]]) -> str:
    """Return in words how many scenes of each set have a reference."""
    said = []
    for name, (_, count) in SETS.items():
        found = [entry["status"] for entry in kept.values() if entry["set"] == name]
        said.append(f"{name} {len(found)} of {count}, {found.count('limit')} at the limit")
    return "; ".join(said)


@dataclass(frozen=True)
class Answered:
    """What the engine said of one scene at one accuracy, and how its quantities compare."""

    accuracy: float
    number: int
    scene: OracleScene
    truth: dict[str, Any]
    got: dict[str, Any]

    @property
    def quantities(self) -> list[Compared]:
        """What both know."""
        return compared(self.truth, self.got)


def ask(name: str, accuracies: Mapping[float, int]) -> Iterator[Answered]:
    """Yield the engine's answers to the scenes of a set that have a reference.

    Raises:
        ValueError: if a reference belongs to another scene than that of its number.
    """
    for entry in load():
        if entry["set"] != name or entry["status"] not in ("settled", "not_periodic"):
            continue
        scene, key = fourth_scene(SETS[name][0], entry["number"]), entry["key"]
        if scene.key() != key:
            raise ValueError(f"{FILE.name}: {name} {entry['number']} has key {key!r}, expected {scene.key()!r}")
        cheap = True
        for accuracy, count in accuracies.items():
            if entry["number"] >= count or (accuracy < _FINE and not cheap):
                continue
            got = answer(scene, accuracy)
            if got.get("ms", _SOON) < _SOON:
                got["ms"] = answer(scene, accuracy)["ms"]
            cheap = cheap and (accuracy < _FINE or got.get("ms", _SOON) < _CHEAP)
            yield Answered(accuracy, entry["number"], scene, entry, got)


def tables(answers: list[Answered]) -> dict[str, list[Row]]:
    """Return the tables of the module's text."""
    found: dict[str, list[Row]] = {"statuses": [], "errors": [], "work": [], "wrong": []}
    for accuracy in dict.fromkeys(a.accuracy for a in answers):
        asked = [a for a in answers if a.accuracy == accuracy]
        found["work"].extend(_work_row(accuracy, asked))
        for status in sorted({a.got["status"] for a in asked}):
            those = [a for a in asked if a.got["status"] == status]
            found["statuses"].append(_status_row(accuracy, status, those, len(asked)))
            found["errors"].extend(_error_rows(accuracy, status, those))
            if status == "converged":
                found["wrong"].extend(_wrong_rows(those))
    return found


def _status_row(accuracy: float, status: str, those: list[Answered], count: int) -> Row:
    times = [a.got["ms"] for a in those if a.got.get("ms") is not None]
    return {
        "asked for": accuracy,
        "status": status,
        "scenes": len(those),
        "share": len(those) / count,
        "ms, median": float(np.median(times)) if times else None,
        "ms, most": max(times, default=None),
    }


def _error_rows(accuracy: float, status: str, those: list[Answered]) -> Iterator[Row]:
    compared_ones = [c for a in those for c in a.quantities]
    for quantity in sorted({c.quantity for c in compared_ones}):
        some = [c for c in compared_ones if c.quantity == quantity]
        ratios = [c.stated / max(c.true, c.doubt, 1e-300) for c in some]
        yield {
            "asked for": accuracy,
            "status": status,
            "quantity": quantity,
            "compared": len(some),
            "bounded": float(np.mean([c.covered for c in some])),
            "off by more than 3 times": sum(c.wrong for c in some),
            "stated over true": float(np.median(ratios)),
        }


def _work_row(accuracy: float, asked: list[Answered]) -> Iterator[Row]:
    pairs = [(a, c) for a in asked if a.got["status"] == "converged" for c in a.quantities if c.quantity == "rms"]
    if not pairs:
        return
    errors = [c.true / a.truth["rms"] if a.truth["rms"] > 0.0 else 0.0 for a, c in pairs]
    times = [a.got["ms"] for a, _ in pairs]
    yield {
        "asked for": accuracy,
        "scenes": len(asked),
        "converged": len(pairs),
        "ms, median": float(np.median(times)),
        "ms, 90 %": float(np.quantile(times, 0.9)),
        "error, median": float(np.median(errors)),
        "error, 90 %": float(np.quantile(errors, 0.9)),
        "error, most": max(errors),
    }


def _wrong_rows(those: list[Answered]) -> Iterator[Row]:
    for a in those:
        for c in a.quantities:
            if c.wrong:
                yield {
                    "asked for": a.accuracy,
                    "number": a.number,
                    "key": a.truth["key"],
                    "kind": a.scene.kind,
                    "element": a.scene.geometry.element,
                    "reference repeats": str(a.truth["repeats"]),
                    "quantity": c.quantity,
                    "stated, m/s2": c.stated,
                    "true, m/s2": c.true,
                }


def beside(found: dict[str, list[Row]], before: Mapping[str, list[Row]]) -> dict[str, list[Row]]:
    """Return tables with the figures of earlier ones beside theirs, None where a row is new."""
    joined = dict(found)
    for title in ("statuses", "errors", "work"):
        earlier = {tuple(row.get(key) for key in _KEYS): row for row in before.get(title, [])}
        joined[title] = []
        for row in found[title]:
            old = earlier.get(tuple(row.get(key) for key in _KEYS), {})
            joined[title].append({**row, **{f"{name} before": old.get(name) for name in _BEFORE if name in row}})
    return joined


def main() -> None:
    """Make references, or compare."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    commands = parser.add_subparsers(dest="command", required=True)
    make = commands.add_parser("references", help="simulate the scenes that have no reference yet")
    make.add_argument("--set", choices=list(SETS), help="one set; by default all, in their order")
    make.add_argument("--workers", type=int, default=1, metavar="N", help="processes")
    make.add_argument("--seconds", type=float, default=300.0, metavar="S", help="limit of each run of a scene")
    compare = commands.add_parser("compare", help="ask the engine and print the tables")
    compare.add_argument("--set", choices=list(SETS), default="development", help="by default %(default)s")
    compare.add_argument("--before", type=Path, metavar="FILE", help="put the figures of this file beside the new ones")
    compare.add_argument("--json", type=Path, metavar="FILE", help="write the tables to this file")
    compare.add_argument("--quick", action="store_true", help="1e-3 and the first scenes only")
    options = parser.parse_args()
    if options.command == "references":
        make_references([options.set] if options.set else list(SETS), options.workers, options.seconds)
        return
    found = tables(list(ask(options.set, QUICK if options.quick else ACCURACIES)))
    if options.before is not None:
        found = beside(found, json.loads(options.before.read_text(encoding="utf-8")))
    for title, rows in found.items():
        if rows:
            print_table(title, rows)
    write_json(options.json, found)


if __name__ == "__main__":
    main()
