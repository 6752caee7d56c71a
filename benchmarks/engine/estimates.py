"""How often the stated errors of a response bound the true ones, and what the solvers cost against what they declare.

Run as ``python -m benchmarks.engine.estimates [--quick] [--json FILE]``. Four tables:

1. random scenes of the periodic solver (rigs off the thesis' by up to a factor of five, clearance, rough floors, both
   rows), each against itself at a three-hundredth of the accuracy: shares of scenes whose stated errors of RMS, peak,
   waveform (at the steps) and each of six lines are at least the true ones, and medians and 90 % quantiles of either;
2. random scenes over time (any part, several defects, slip, unbalance): the same for the RMS against ten times the
   duration, and for the waveform against steps of an eighth;
3. processor time of a scene by solver, and what it declares.
4. how often a second opinion is taken of the scenes of 1., how long it takes, and how often its sign of danger misses.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.common import Row, Tables, benchmark
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Part, Scene, Slip
from models.solve.registry import solvers
from models.solve.response import Response
from models.solve.six_dof import periodic, time_domain
from models.solve.six_dof.kernels.period import ball_period, blank_trace, mean_square
from models.solve.six_dof.kernels.settled import R_ERROR, R_OTHER, R_RADIUS, R_RMS, R_SETTLED
from models.words.request import Request
from reference.periods import ask, solve_scene

ACCURACIES = (1e-2, 1e-3, 1e-4)
FINER = 300.0
LONGER = 10.0
RATE = 51200.0
PARTS: tuple[Part, ...] = ("outer", "inner", "ball")


@dataclass(frozen=True)
class Stated:
    """One error of one scene, as stated and as it is, relative."""

    name: str
    stated: float
    true: float


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(10.0 ** rng.uniform(math.log10(low), math.log10(high)))


def periodic_scene(rng: np.random.Generator, number: int) -> Scene:
    """Return a scene with a defect of the outer race, every other one off the thesis' rig."""
    floor = Floor("rough" if number % 4 == 0 else "smooth", seed=number)
    defect = Defect(
        math.radians(log_uniform(rng, 0.5, 63.0)),
        log_uniform(rng, 5e-7, 3e-4),
        floor,
        rng.uniform(-0.4, 0.4),
        1 + number % 2,
    )
    names = {"m_o": 3.0, "m_r": 3.0, "k_c": 5.0, "k_r": 5.0, "beta_c": 3.0}
    off = {n: getattr(Rig(), n) * log_uniform(rng, 1.0 / f, f) for n, f in names.items()} if number % 2 else {}
    return Scene(
        log_uniform(rng, 5.0, 100.0),
        log_uniform(rng, 100.0, 1e4),
        rig=Rig(**off),
        defect=defect,
        clearance=5e-6 * (number % 3 == 2),
    )


def turning_scene(rng: np.random.Generator, number: int) -> Scene:
    """Return a scene that has no ball period."""
    part = PARTS[1 + number % 2]
    floor = Floor("rough" if number % 3 == 0 else "smooth", seed=number)
    defect = Defect(math.radians(log_uniform(rng, 2.0, 30.0)), log_uniform(rng, 2e-6, 3e-4), floor, part=part)
    others = (replace(defect, part="outer", position=0.2), replace(defect, part=PARTS[2 - number % 2]))
    return Scene(
        log_uniform(rng, 15.0, 60.0),
        log_uniform(rng, 500.0, 5e3),
        defect=defect,
        more_defects=others if number % 4 == 3 else (),
        slip=Slip(0.01, seed=number) if number % 4 == 0 and part == "inner" else None,
        unbalance=log_uniform(rng, 1e-5, 1e-3) if number % 5 == 0 else 0.0,
        clearance=5e-6 * (number % 3 == 2),
    )


def periodic_errors(rng: np.random.Generator, number: int) -> Iterator[Stated]:
    """Yield the errors of one scene of the periodic solver, none where it does not repeat."""
    scene, accuracy = periodic_scene(rng, number), ACCURACIES[number % len(ACCURACIES)]
    ours = periodic.solve(scene, Request(accuracy=accuracy))
    truth = periodic.solve(scene, Request(accuracy=accuracy / FINER))
    if ours.spread > 0.0 or truth.spread > 0.0:
        return
    yield Stated("RMS", ours.rms_error, abs(ours.rms / truth.rms - 1.0))
    yield Stated("peak", ours.peak_error, abs(ours.peak / truth.peak - 1.0))
    yield Stated("waveform", ours.waveform_error, _difference(scene, accuracy))
    largest = float(np.max(truth.harmonics))
    for stated, true in zip(ours.harmonics_error, np.abs(ours.harmonics - truth.harmonics), strict=True):
        yield Stated("line", float(stated) / largest, float(true) / largest)


def _difference(scene: Scene, accuracy: float) -> float:
    """Return the RMS of the error of the waveform at the steps over its own RMS."""
    ours, truth = solve_scene(scene, accuracy), solve_scene(scene, accuracy / FINER)
    first, finer = ours.period.first, len(truth.period.nodes.turn) // len(ours.period.nodes.turn)
    at = np.concatenate([finer * np.arange(first[k], first[k + 1] + 1) + k for k in range(len(first) - 1)])
    traces = [blank_trace(found.period) for found in (ours, truth)]
    for found, trace in zip((ours, truth), traces, strict=True):
        ball_period(found.state, np.empty((2, 6)), trace, found.period)
    squares = (traces[0].wave[:, 0] - traces[1].wave[at, 0]) ** 2
    return math.sqrt(max(float(ours.period.weight @ squares), 0.0)) / math.sqrt(mean_square(traces[1], 0))


def turning_errors(rng: np.random.Generator, number: int) -> Iterator[Stated]:
    """Yield the errors of one scene over time."""
    scene = turning_scene(rng, number)
    duration = 40.0 / scene.speed
    ours = time_domain.solve(scene, Request(duration=duration))
    long = time_domain.solve(scene, Request(duration=LONGER * duration))
    true = max(0.0, abs(ours.rms / long.rms - 1.0) - long.rms_error)
    yield Stated("RMS", ours.rms_error, true)
    fine = time_domain.simulate_time(scene, duration, RATE, step=time_domain.DEFAULT_STEP / 8.0)
    signals = [found.acceleration(RATE, duration) for found in (ours, fine)]
    yield Stated("waveform", ours.waveform_error, float(np.linalg.norm(signals[0] - signals[1])) / _norm(signals[1]))


def _norm(signal: np.ndarray) -> float:
    return float(np.linalg.norm(signal))


def bound_rows(
    title: str, errors: Callable[[np.random.Generator, int], Iterator[Stated]], scenes: int, seed: int
) -> list[Row]:
    """Return the shares of scenes whose errors are bounded, by quantity."""
    rng = np.random.default_rng(seed)
    found = [error for number in range(scenes) for error in errors(rng, number)]
    rows: list[Row] = []
    for name in dict.fromkeys(error.name for error in found):
        stated, true = (np.array([getattr(e, side) for e in found if e.name == name]) for side in ("stated", "true"))
        rows.append(
            {
                "solver": title,
                "of": name,
                "errors": len(true),
                "bounded": float(np.mean(stated >= true)),
                "within 3 times": float(np.mean(3.0 * stated >= true)),
                "true, median": float(np.median(true)),
                "true, 90 %": float(np.quantile(true, 0.9)),
                "stated, median": float(np.median(stated)),
                "stated, 90 %": float(np.quantile(stated, 0.9)),
                "stated over true, median": float(np.median(stated / np.maximum(true, 1e-12))),
            }
        )
    return rows


def opinion_rows(scenes: int, rounds: int) -> list[Row]:
    """Return by accuracy how often a second opinion is taken, what it costs, and how often an error is beyond what is
    stated with and without one.
    """
    rows: list[Row] = []
    for accuracy in ACCURACIES:
        rng = np.random.default_rng(7)
        taken, beyond, whole, part = [], [], [], []
        for number in range(scenes):
            scene = periodic_scene(rng, number)
            solved, truth = solve_scene(scene, accuracy), periodic.solve(scene, Request(accuracy=accuracy / FINER))
            found = solved.found
            if truth.spread > 0.0 or not (found[R_SETTLED] > 0.0 and found[R_RADIUS] < 1.0):
                continue
            taken.append(math.isfinite(found[R_OTHER]))
            beyond.append(abs(found[R_RMS] / truth.rms - 1.0) > found[R_ERROR])
            whole.append(_seconds(lambda s=scene, a=accuracy: solve_scene(s, a), rounds))
            if taken[-1]:
                part.append(_seconds(ask(scene, solved, accuracy), rounds) / whole[-1])
        asked, missed = np.array(taken), np.array(beyond)
        rows.append(
            {
                "asked for": accuracy,
                "scenes": len(asked),
                "second opinions": float(np.mean(asked)),
                "of its time, median": float(np.median(part)) if part else 0.0,
                "ms, median": 1e3 * float(np.median(whole)),
                "beyond the stated, with": float(np.mean(missed[asked])) if asked.any() else 0.0,
                "without": float(np.mean(missed[~asked])) if not asked.all() else 0.0,
            }
        )
    return rows


def _seconds(call: Callable[[], object], rounds: int) -> float:
    """Return the median thread time of a call, s."""
    times: list[float] = []
    for _ in range(rounds):
        began = time.thread_time()
        call()
        times.append(time.thread_time() - began)
    return float(np.median(times))


def cost_rows(rounds: int) -> list[Row]:
    """Return processor times by solver and accuracy, s, in the scene that each is made for."""
    spall = Scene(40.0, 4000.0, defect=Defect(math.radians(6.0), 1e-5))
    scenes = {
        "periodic": spall,
        "mean_force": replace(spall, slip=Slip(0.005, "mean_force")),
        "time_domain": replace(spall, defect=Defect(math.radians(6.0), 1e-5, part="inner")),
    }
    rows: list[Row] = []
    for solver in solvers("six_dof"):
        for accuracy in ACCURACIES:
            request = Request(accuracy=accuracy)
            answered: Response = solver.solve(scenes[solver.name], request)
            times: list[float] = []
            for _ in range(rounds):
                began = time.process_time()
                solver.solve(scenes[solver.name], request)
                times.append(time.process_time() - began)
            rows.append(
                {
                    "model": solver.model,
                    "solver": solver.name,
                    "asked for": accuracy,
                    "rms_error": answered.rms_error,
                    "ms": 1e3 * float(np.median(times)),
                    "declared ms": 1e3 * solver.cost(scenes[solver.name], request),
                }
            )
    return rows


@benchmark(__doc__ or "")
def main(quick: bool) -> Tables:
    """Print the tables."""
    scenes: Sequence[int] = (24, 8) if quick else (120, 40)
    bounds = bound_rows("periodic", periodic_errors, scenes[0], 7)
    bounds += bound_rows("time_domain", turning_errors, scenes[1], 8)
    costs = cost_rows(3 if quick else 15)
    return {"bounds": bounds, "costs": costs, "opinions": opinion_rows(scenes[0], 3)}
