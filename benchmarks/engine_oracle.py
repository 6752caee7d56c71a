"""The engine held against the independent oracle (tests/oracles/periodic) on random scenes.

    python -m benchmarks.engine_oracle --set development --count 300 --hours 2    simulate scenes with the oracle
    python -m benchmarks.engine_oracle --set development --count 300 --judge      compare the engine with them

The first command appends one JSON line per scene to benchmarks/results/engine_oracle_SET.jsonl as soon as it is done,
found again by the scene's digest: stopped and started again it goes on. The held-out set is meant to be used once.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from benchmarks.engine_judge import judge
from tests.oracles.periodic.rig import OracleScene
from tests.oracles.periodic.scenes import SEEDS, scenes
from tests.oracles.periodic.settle import Caps, simulate_oracle

RESULTS = Path(__file__).parent / "results"
# Steps of a run, about 4 us each; the run at a tenth of the tolerance may take twice as many.
MOST_STEPS = 16_000_000
MOST_PROCESSES = 2


def stored(path: Path) -> dict[str, dict[str, Any]]:
    """Return the stored results by digest of the scene; a last line that was cut off is left out."""
    found: dict[str, dict[str, Any]] = {}
    if not path.exists():
        return found
    for line in path.read_text().splitlines():
        try:
            entry = json.loads(line)
        except json.JSONDecodeError:
            continue
        found[entry["key"]] = entry
    return found


def solve(scene: OracleScene, steps: int) -> dict[str, Any]:
    """Return the entry of one scene."""
    result = simulate_oracle(scene, caps=Caps(steps=steps))
    values = {name: None if value != value else value for name, value in vars(result).items()}
    return {"key": scene.key(), "scene": scene.as_dict(), "result": values}


def run(path: Path, todo: list[OracleScene], hours: float, processes: int, steps: int) -> None:
    """Simulate scenes and append their results, until all are done or the time is over."""
    end = time.monotonic() + 3600.0 * hours
    pending: Iterator[OracleScene] = iter(todo)
    if path.exists() and not path.read_bytes().endswith(b"\n"):
        # Ends a line that was cut off, so that the next one is not lost with it.
        with path.open("a") as out:
            out.write("\n")
    with path.open("a") as out, ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        running = {pool.submit(solve, scene, steps) for scene in islice(pending, processes)}
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                entry = future.result()
                out.write(json.dumps(entry) + "\n")
                out.flush()
                result = entry["result"]
                print(f"{entry['key']} {result['status']:12} {result['seconds']:7.2f} s {result['steps']:9} steps")
                if time.monotonic() < end:
                    running |= {pool.submit(solve, scene, steps) for scene in islice(pending, 1)}


def summary(entries: list[dict[str, Any]]) -> dict[str, float | int]:
    """Return the numbers of scenes by status, their cost and the oracle's own errors."""
    results = [entry["result"] for entry in entries]
    settled = [r for r in results if r["status"] == "settled"]
    errors = sorted(r["error"] for r in settled if r["error"] is not None)
    seconds = sorted(r["seconds"] for r in results)
    return {
        "scenes": len(results),
        "settled": len(settled),
        "not_periodic": sum(r["status"] == "not_periodic" for r in results),
        "unresolved": sum(r["status"] == "unresolved" for r in results),
        "median_s": seconds[len(seconds) // 2] if seconds else math.nan,
        "mean_s": sum(seconds) / max(1, len(seconds)),
        "longest_s": seconds[-1] if seconds else math.nan,
        "median_error": errors[len(errors) // 2] if errors else math.nan,
        "largest_error": errors[-1] if errors else math.nan,
        "errors_above_1e-5": sum(e > 1e-5 for e in errors),
    }


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=sorted(SEEDS), required=True, help="which scenes")
    parser.add_argument("--count", type=int, default=300, help="so many scenes from the first on")
    parser.add_argument("--hours", type=float, default=2.0, help="begin no further scene after this time")
    parser.add_argument("--processes", type=int, choices=range(1, MOST_PROCESSES + 1), default=1)
    parser.add_argument("--steps", type=int, default=MOST_STEPS, help="cap of the steps of one run")
    parser.add_argument("--again", action="store_true", help="run those again that a cap left unresolved")
    parser.add_argument("--judge", action="store_true", help="compare models.solve.simulate with the stored results")
    parser.add_argument("--accuracy", type=float, help="accuracy to ask the engine for; its own default without it")
    parser.add_argument("--seconds", type=float, default=60.0, help="time that the engine may take for one scene")
    parser.add_argument("--rows", type=Path, metavar="FILE", help="append each comparison, and go on from those in it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the summary, or the comparison, to this file")
    args = parser.parse_args()
    path = RESULTS / f"engine_oracle_{args.set}.jsonl"
    drawn = scenes(SEEDS[args.set], args.count)
    known = stored(path)
    if not args.judge:
        again = {key for key, entry in known.items() if args.again and entry["result"]["status"] == "unresolved"}
        todo = [s for s in drawn if not s.beyond and (s.key() not in known or s.key() in again)]
        run(path, todo, args.hours, args.processes, args.steps)
        known = stored(path)
    report: dict[str, Any] = {
        "beyond": sum(s.beyond for s in drawn),
        **summary([known[s.key()] for s in drawn if s.key() in known]),
    }
    print(json.dumps(report, indent=1))
    if args.judge:
        comparison = judge(drawn, known, args.accuracy, args.seconds, args.rows)
        print(json.dumps({name: value for name, value in comparison.items() if name != "rows"}, indent=1))
        report |= comparison
    if args.json:
        args.json.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
