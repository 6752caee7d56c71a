"""The table of faults.

    python -m benchmarks.faults [--sample N] [--only WORD] [--tree FOLDER] [--as before|after] [--missing]
        [--json FILE]

Each case is a call of one kind that fails once or for a while, in a daemon with its children, at its start or stop, or
in a command beside it. ``--tree`` runs the program of another working tree. Under ``--as`` the verdicts stand in the
JSON file beside those of the other name, fault by fault. The exit code is 1 where an outcome is wrong.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.common import Row, print_table, write_json
from benchmarks.faults.cases import Case, all_cases
from benchmarks.faults.judge import DEAD, WRONGS, Verdict, judge
from benchmarks.faults.life import ROOT, START_S, Life

_CASES_A_LIFE = 40
_SEED = 20261127
LABELS = ("before", "after")


def chosen(sample: int | None, only: str | None) -> list[Case]:
    """Return the cases to run, in their order."""
    cases = [case for case in all_cases() if only is None or only in case.name]
    if sample is None or sample >= len(cases):
        return cases
    return [cases[place] for place in sorted(random.Random(_SEED).sample(range(len(cases)), sample))]


def run(cases: list[Case], tree: Path) -> Iterator[Verdict]:
    """Run cases in lives one after the other, and yield each verdict as it comes."""
    waiting = list(reversed(cases))
    while waiting:
        with Life(tree) as life:
            life.wait_well(START_S)
            for _ in range(min(_CASES_A_LIFE, len(waiting))):
                verdict = judge(life, waiting.pop())
                yield verdict
                if DEAD in verdict.problems:
                    break


def summary(rows: Sequence[Row]) -> Row:
    """Return the counts of the cases of a run that fired."""
    times = [row["goes_on_s"] or 0.0 for row in rows if str(row["case"]).startswith("steady")]
    counts = {name: sum(bool(row[name]) for row in rows) for name in (*WRONGS, "wrong")}
    ended = sum(row["exit"] is not None for row in rows if str(row["case"]).startswith(("steady", "start")))
    return {"fired": len(rows), **counts, "ended": ended, "longest_s": max(times, default=0.0)}


def keep(path: Path, label: str, tree: Path, row: Row) -> None:
    """Put a row, with the commit of the tree, in the place of that of the same case in a run of the file."""
    kept = json.loads(path.read_text()) if path.is_file() else {}
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=tree, capture_output=True, text=True, check=True
    ).stdout.strip()
    runs = {name: kept[name] for name in LABELS if name in kept}
    others = [each for each in runs.get(label, {"rows": []})["rows"] if each["case"] != row["case"]]
    rows = sorted([*others, {**row, "commit": commit}], key=lambda each: each["case"])
    runs[label] = {**summary(rows), "rows": rows}
    write_json(path, runs)


def main() -> None:
    """Run the cases, print the table, and write it where asked, after each case."""
    parser = argparse.ArgumentParser(description="Let the N-th call of each kind fail.")
    parser.add_argument("--sample", type=int, metavar="N", help="so many of the cases, always the same ones")
    parser.add_argument("--only", metavar="WORD", help="those whose name holds this word")
    parser.add_argument("--tree", type=Path, default=ROOT, help="working tree whose program is run")
    parser.add_argument("--as", dest="label", choices=LABELS, default="after", help="name of the run")
    parser.add_argument("--missing", action="store_true", help="only those of which the JSON file has no row")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    options = parser.parse_args()
    tree, rows, cases = options.tree.resolve(), list[Row](), chosen(options.sample, options.only)
    if options.missing and options.json.is_file():
        done = {row["case"] for row in json.loads(options.json.read_text()).get(options.label, {"rows": []})["rows"]}
        cases = [case for case in cases if case.name not in done]
    for verdict in run(cases, tree):
        row = verdict.row()
        print(*(f"{row[key]}" for key in ("case", "fired", "goes_on_s", "exit", "told", "wrong")), flush=True)
        if verdict.fired:
            rows.append(row)
            if options.json is not None:
                keep(options.json, options.label, tree, row)
    if rows:
        print_table("faults", [{key: row[key] for key in row if key != "text"} for row in rows])
        print_table("summary", [summary(rows)])
    sys.exit(any(row["wrong"] for row in rows))


if __name__ == "__main__":
    main()
