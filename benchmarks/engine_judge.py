"""The engine's answers to the oracle's scenes (benchmarks.engine_oracle): right, wrong, refused or none in time."""

from __future__ import annotations

import json
import math
import resource
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from models.machine.bearing import Bearing
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene
from models.solve.simulate import simulate
from tests.oracles.periodic.rig import OracleScene
from tests.oracles.periodic.scenes import MAX_RESONANCE
from tests.oracles.periodic.settle import Caps, other_levels

# Accuracy that counts as asked where none is named, and how many times it an answer called converged may be off.
DEFAULT_ACCURACY = 1e-3
SLACK = 3.0
# Spread of the RMS from period to period, relative, above which a motion certainly does not repeat.
_UNREST = 1e-3
_STANDARD_ERRORS = 3.0
_STEPS_OF_OTHERS = 1_000_000
_MAX_MEMORY_BYTES = 6 << 30


def engine_scene(scene: OracleScene) -> Scene:
    """Return the same scene in the product's words."""
    g, rough = scene.geometry, scene.rough
    bearing = Bearing(
        designation=g.name,
        n_elements=g.n_elements,
        element_diameter=2.0 * g.element_radius,
        pitch_diameter=2.0 * g.pitch_radius,
        contact_angle=g.contact_angle,
        rows=g.rows,
        element="ball" if g.element == "ball" else "roller",
        outer_race_radius=g.outer_race_radius,
    )
    floor = Floor() if rough is None else Floor("rough", rough.sd, rough.pitch, rough.cutoff, rough.seed)
    defect = Defect(scene.extent, scene.depth, floor, scene.position, scene.rows) if scene.rows else None
    rig = Rig(**asdict(scene.parameters), element="ball" if g.element == "ball" else "roller")
    return Scene(scene.speed, scene.load, bearing, rig, defect, scene.clearance)


def answer(scene: OracleScene, accuracy: float | None) -> dict[str, Any]:
    """Return status, levels, the engine's own error estimate, relative, where it gives one, and its cost, ms."""
    options: dict[str, Any] = {} if accuracy is None else {"accuracy": accuracy}
    begun = time.thread_time()
    try:
        found = simulate(engine_scene(scene), **options)
    except (ValueError, RuntimeError, MemoryError) as error:
        return {"status": "refused", "reason": f"{type(error).__name__}: {error}"[:200]}
    return {
        "status": found.status,
        "rms": found.rms,
        "peak": found.peak,
        "spread": found.spread,
        "lines": [float(a) for a in found.harmonics],
        "estimate": getattr(found, "rms_error", None),
        "ms": 1e3 * (time.thread_time() - begun),
    }


def _serve(pipe: Connection, accuracy: float | None) -> None:
    """Answer scenes until the pipe closes; kernels are compiled or loaded before the first."""
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY_BYTES, _MAX_MEMORY_BYTES))
    simulate(Scene(40.0, 4000.0, defect=Defect(0.3, 2e-5, Floor("rough"))))
    while True:
        try:
            scene = pipe.recv()
        except EOFError:
            return
        pipe.send(answer(scene, accuracy))


def answers(drawn: Sequence[OracleScene], accuracy: float | None, seconds: float) -> Iterator[dict[str, Any]]:
    """Yield the engine's answers from a process of its own, which is replaced where one takes longer than allowed."""
    context = get_context("spawn")

    def start() -> tuple[Any, Any]:
        here, there = context.Pipe()
        process = context.Process(target=_serve, args=(there, accuracy), daemon=True)
        process.start()
        there.close()
        return here, process

    pipe, process = start()
    fresh = True
    for scene in drawn:
        pipe.send(scene)
        try:
            # A new process compiles or loads its kernels first.
            got = pipe.recv() if pipe.poll(seconds + (120.0 if fresh else 0.0)) else None
        except EOFError:
            got = {"status": "crashed"}
        fresh = got is None or got["status"] == "crashed"
        if fresh:
            process.kill()
            process.join()
            pipe, process = start()
        yield got or {"status": "timeout"}
    pipe.close()
    process.join()


def verdict(scene: OracleScene, truth: dict[str, Any] | None, got: dict[str, Any], asked: float) -> dict[str, Any]:
    """Return one row of the comparison.

    ``error``: relative difference of the RMS; ``doubt``: what of it the oracle itself may be off by (its own error,
    and three standard errors of a mean that does not repeat); ``bounded``: whether the engine's estimate, if it gives
    one, covers the error; ``wrong``: called converged, and off by more than SLACK times what was asked; ``unstable``:
    called converged, where simulating on does not repeat; ``motion``: highest resonance in the motion, in ball rates.
    """
    row: dict[str, Any] = {"kind": scene.kind, "bearing": scene.geometry.name, "engine": got["status"]}
    row |= {"oracle": "beyond" if scene.beyond else "missing" if truth is None else truth["status"]}
    # A deep defect under a light load presses the contacts harder, and their resonance higher, than at rest.
    row["motion"] = math.inf if scene.beyond else (truth or {}).get("motion_resonance") or 0.0
    row |= {"ms": got.get("ms"), "estimate": got.get("estimate"), "reason": got.get("reason")}
    if scene.beyond or truth is None or truth["status"] == "unresolved" or got["status"] in _NO_LEVEL:
        return row
    rms = truth["rms"]
    row["error"] = abs(got["rms"] - rms) / rms if rms > 0.0 else abs(got["rms"])
    row["doubt"] = truth["error"] or 0.0
    row["doubt"] += _STANDARD_ERRORS * truth["standard_error"] / rms if rms > 0.0 else 0.0
    row["peak_error"] = abs(got["peak"] / truth["peak"] - 1.0) if truth["peak"] > 0.0 else 0.0
    strongest = max(truth["lines"], default=0.0)
    if strongest > 0.0:
        pairs = zip(got["lines"], truth["lines"], strict=True)
        row["line_error"] = max(abs(a - b) for a, b in pairs) / strongest
    converged = got["status"] == "converged"
    if row["estimate"] is not None:
        row["bounded"] = row["error"] <= row["estimate"] + row["doubt"]
    row["wrong"] = converged and not row["error"] <= SLACK * asked + row["doubt"]
    row["unstable"] = converged and not truth["repeats"] and truth["spread"] > _UNREST * rms
    return row


def forgive_other_motion(row: dict[str, Any], scene: OracleScene, rms: float, asked: float) -> None:
    """Take back ``wrong`` where the oracle, from another start, settles at the engine's level: both motions exist."""
    levels = other_levels(scene, caps=Caps(steps=_STEPS_OF_OTHERS))
    row["others"] = levels
    if any(abs(rms - level) <= SLACK * asked * level for level in levels):
        row["wrong"], row["other_motion"] = False, True


_NO_LEVEL = ("refused", "timeout", "crashed", "not_converged")


def judge(
    drawn: Sequence[OracleScene],
    known: dict[str, dict[str, Any]],
    accuracy: float | None,
    seconds: float,
    store: Path | None = None,
) -> dict[str, Any]:
    """Return the comparison of all drawn scenes that the oracle knows, with a summary, and print it.

    Each row is appended to ``store``, if that is given; a comparison that was ended goes on from there.
    """
    rows = read_rows(store) if store is not None and store.exists() else []
    done = {row["key"] for row in rows}
    chosen = [s for s in drawn if (s.beyond or s.key() in known) and s.key() not in done]
    asked = DEFAULT_ACCURACY if accuracy is None else accuracy
    for scene, got in zip(chosen, answers(chosen, accuracy, seconds), strict=True):
        truth = known[scene.key()]["result"] if scene.key() in known and not scene.beyond else None
        row = {"key": scene.key(), **verdict(scene, truth, got, asked)}
        if row.get("wrong"):
            forgive_other_motion(row, scene, got["rms"], asked)
        rows.append(row)
        if store is not None:
            with store.open("a") as out:
                out.write(json.dumps(row) + "\n")
        print(_line(row), flush=True)
    return summary_of(rows, asked) | {"rows": rows}


def read_rows(store: Path) -> list[dict[str, Any]]:
    """Return the rows of a file; a last line that was cut off is an error of the JSON reader."""
    return [json.loads(line) for line in store.read_text().splitlines()]


def summary_of(rows: Sequence[dict[str, Any]], asked: float) -> dict[str, Any]:
    """Return the counts of a comparison."""
    compared = [row for row in rows if "error" in row]
    estimated = [row for row in compared if "bounded" in row]
    converged = [row for row in compared if row["engine"] == "converged"]
    return {
        "asked": asked,
        "engine": dict(Counter(row["engine"] for row in rows)),
        "beyond_not_refused": sum(row["oracle"] == "beyond" and row["engine"] != "refused" for row in rows),
        "refused_within": sum(row["engine"] == "refused" and row["motion"] <= MAX_RESONANCE for row in rows),
        "compared": len(compared),
        "converged": len(converged),
        "wrong": sum(row["wrong"] for row in converged),
        "at_another_motion": sum(row.get("other_motion", False) for row in rows),
        "unstable_called_converged": sum(row["unstable"] for row in converged),
        "estimates": len(estimated),
        "bounded_share": sum(row["bounded"] for row in estimated) / len(estimated) if estimated else None,
        "largest_error_converged": max((row["error"] for row in converged), default=math.nan),
    }


def _line(row: dict[str, Any]) -> str:
    error = f"{row['error']:.1e} +- {row['doubt']:.0e}" if "error" in row else ""
    flags = " ".join(name for name in ("wrong", "unstable", "other_motion") if row.get(name))
    cost = f"{row['ms']:8.1f} ms" if row["ms"] is not None else f"{'':11}"
    return (
        f"{row['key']} {row['kind']:6} {row['bearing']:10} {row['oracle']:12} {row['engine']:13} {cost} {error} {flags}"
    )
