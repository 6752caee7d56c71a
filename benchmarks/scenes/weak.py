"""Effects from nothing to what matters: what ``simulate`` leaves out or adds, its cost, and whether the bounds hold.

Run as ``python -m benchmarks.scenes.weak [--quick] [--json FILE]``: random scenes (``reference.weak_scenes``), 29 a
kind of effect, asked at each of ACCURACIES. What an effect changes is the difference of two simulations over time with
the same steps; of the mean force of slip, the difference of the RMS from the motion without. What is added is held
against four seconds over time. Times are of a thread, medians of warm calls: ``simulate``, the motion without the
effect, and the solver over time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.common import Row, Tables, benchmark
from models.machine.scene import Scene
from models.solve.registry import weak_effects
from models.solve.response import Response
from models.solve.simulate import choose, simulate
from models.solve.six_dof.time_domain import simulate_time
from models.words.request import Request
from reference.weak_scenes import KINDS, change_over_time, weak_scene

FIRST, OF_KIND, OF_KIND_QUICK = 5_000, 29, 1
ACCURACIES = (5e-2, 1e-3)
_SECONDS, _STEP, _LONG = 0.3, 5e-6, 4.0
_ROUNDS, _SLOW_MS = 5, 20.0
# Of what two simulations over time tell apart, over the RMS: further events divide other steps.
_FLOOR = 3e-5


@dataclass(frozen=True)
class WeakTrial:
    """One scene at one accuracy.

    Attributes:
        bound, level_bound: of what the effect changes of the waveform and of the RMS, relative.
        change, level: what it changes of them.
        left_out, added: whether it is.
        error: true error of the RMS of what is left out and of the steps, relative, or of what is added, and the stated
            one, in which that of what it is held against is.
        ours, settled, over_time: thread time, ms, of ``simulate``, without the effect, and over time.
    """

    kind: str
    accuracy: float
    bound: float
    level_bound: float
    change: float
    level: float
    left_out: bool
    added: bool
    error: float
    stated: float
    ours: float
    settled: float
    over_time: float


def trials(scene: Scene, kind: str) -> list[WeakTrial]:
    """Return what a scene gives at each accuracy."""
    weak = weak_effects("six_dof")
    assert weak is not None
    plain = weak.without(scene)
    fine = simulate(plain, accuracy=1e-6)
    if fine.status != "converged":
        return []
    bound = weak.bounds(scene, fine)[kind]
    if kind == "mean_force_slip":
        averaged = choose(scene, Request())[0].solve(scene, Request())
        # Beyond what its own steps leave.
        change = level = max(abs(averaged.rms - fine.rms) - averaged.rms_error * averaged.rms, 0.0)
    else:
        change, level = change_over_time(scene, plain, seconds=_SECONDS, step=_STEP)
    change, level = change / fine.rms, level / fine.rms
    found: list[WeakTrial] = []
    for accuracy in ACCURACIES:
        request = Request(accuracy=accuracy, duration=1.0)
        over_time = choose(scene, request)[0]
        ours, spent = _timed(lambda accuracy=accuracy: simulate(scene, accuracy=accuracy, duration=1.0))
        _, settled = _timed(lambda accuracy=accuracy: simulate(plain, accuracy=accuracy))
        slow = spent
        if ours.left_out or ours.added:
            _, slow = _timed(lambda over_time=over_time, request=request: over_time.solve(scene, request))
        error, stated = abs(ours.rms / fine.rms - 1.0) + level if ours.left_out else 0.0, ours.error
        if ours.added:
            long = simulate_time(scene, _LONG, 51200.0, step=_STEP)
            error, stated = abs(ours.rms / long.rms - 1.0), ours.error + long.rms_error
        found.append(
            WeakTrial(
                *(kind, accuracy, bound.wave, bound.rms, change, level, bool(ours.left_out), ours.added is not None),
                *(error, stated, spent, settled, slow),
            )
        )
    return found


def _timed(function: Callable[[], Response]) -> tuple[Response, float]:
    """Return a response and the median thread time of warm calls, ms; of slow ones that of a single call."""
    function()
    times: list[float] = []
    while True:
        begin = time.thread_time()
        found = function()
        times.append(1e3 * (time.thread_time() - begin))
        if len(times) == _ROUNDS or times[0] > _SLOW_MS:
            return found, float(np.median(times))


def summary(found: Sequence[WeakTrial]) -> list[Row]:
    """Return a row of each kind and accuracy, and of all."""
    rows: list[Row] = []
    for accuracy in ACCURACIES:
        for kind in ("all", *KINDS):
            some = [one for one in found if one.accuracy == accuracy and kind in ("all", one.kind)]
            below = [one for one in some if one.level <= accuracy / 3.0]
            left, added = [one for one in some if one.left_out], [one for one in some if one.added]
            felt = [one for one in some if one.change > 10.0 * _FLOOR and math.isfinite(one.bound)]
            rows.append(
                {
                    "accuracy": accuracy,
                    "effect": kind,
                    "scenes": len(some),
                    "below a third of the accuracy": len(below),
                    "of these left out": sum(one.left_out for one in below),
                    "bound exceeded": sum(
                        one.change > one.bound + _FLOOR or one.level > one.level_bound + _FLOOR for one in some
                    ),
                    "change over bound, highest": max((one.change / one.bound for one in felt), default=math.nan),
                    "bound over change, median": _median([one.bound / one.change for one in felt]),
                    "left out, error beyond stated": sum(one.error > one.stated + _FLOOR for one in left),
                    "added": len(added),
                    "added, error beyond stated": sum(one.error > one.stated + _FLOOR for one in added),
                    "added, error over stated, highest": max(
                        (one.error / one.stated for one in added), default=math.nan
                    ),
                    "cost over settled, added": _median([one.ours / one.settled for one in added]),
                    "over time over settled, added": _median([one.over_time / one.settled for one in added]),
                    "cost over settled, below": _median([one.ours / one.settled for one in below]),
                    "over time over settled, below": _median([one.over_time / one.settled for one in below]),
                }
            )
    return rows


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan


@benchmark(__doc__)
def main(quick: bool) -> Tables:
    """Try all scenes."""
    found: list[WeakTrial] = []
    for number, kind in enumerate(KINDS):
        for k in range(OF_KIND_QUICK if quick else OF_KIND):
            found += trials(weak_scene(FIRST + 100 * number + k, kind), kind)
    return {"weak effects": summary(found)}
