"""Motions followed along a parameter, against single answers and against simulations over time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.machine.rig import Rig
from models.machine.scene import Defect, Scene
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.orbit import STATE_SCALE
from models.solve.six_dof.kernels.period import blank_trace
from models.solve.six_dof.sweep import Sweep, SweepEvent, sweep
from reference.periods import orbit_of, period_of, run, simulate_plainly

BENCH = Scene(40.0, 4000.0, defect=Defect(math.radians(8.0), 20e-6))
# Hardly damped, with clearance: resonances lean over, and a sweep jumps.
LEANING = Scene(40.0, 200.0, rig=Rig(c_i=200.0, alpha_c=20.0, beta_c=2e-6), clearance=10e-6)
LIGHT = Scene(40.0, 1.0, clearance=10e-6, defect=Defect(math.radians(20.0), 20e-6))


def events_of(found: Sweep, *kinds: str) -> list[SweepEvent]:
    return [event for event in found.events if event.kind in kinds]


@pytest.mark.parametrize(
    ("scene", "parameter", "begin", "end"),
    [
        (BENCH, "speed", 38.0, 40.0),
        (BENCH, "load", 4000.0, 2500.0),
        (BENCH, "dphi_d", 0.0, 0.1),
        (BENCH, "h_d", 1e-6, 5e-6),
        (BENCH, "k_r", 4.2e9, 4.3e9),
        (LEANING, "clearance", 0.0, 1e-6),
    ],
)
def test_points_are_the_answers_of_single_scenes(scene: Scene, parameter: str, begin: float, end: float) -> None:
    found = sweep(scene, parameter, begin, end, points=6)
    assert found.ended == "reached"
    assert (found.values[0], found.values[-1]) == (begin, end)
    assert np.all(np.diff(found.values) * (end - begin) > 0.0)
    assert set(found.status) == {"converged"}
    for i, value in enumerate(found.values.tolist()):
        if parameter in ("dphi_d", "h_d"):
            assert scene.defect is not None
            one = replace(scene, defect=replace(scene.defect, **{parameter: value}))
        else:
            owner: dict[str, Any] = {parameter: value}
            one = replace(scene, rig=replace(scene.rig, **owner)) if parameter == "k_r" else replace(scene, **owner)
        single = simulate(one)
        assert abs(found.rms[i] - single.rms) <= found.rms_error[i] * found.rms[i] + single.rms_error * single.rms
        apart = np.abs(found.harmonics[i] - single.harmonics)
        assert np.all(apart <= 2e-3 * math.sqrt(2.0) * single.rms)
        assert abs(found.multiplier[i]) == pytest.approx(single.multiplier, abs=0.02)


@pytest.fixture(scope="module")
def leaning() -> tuple[Sweep, Sweep]:
    """Return a resonance that leans over, swept up and down."""
    return sweep(LEANING, "speed", 18.55, 18.75), sweep(LEANING, "speed", 18.75, 18.55)


def test_folds_are_the_same_from_both_sides(leaning: tuple[Sweep, Sweep]) -> None:
    up, down = leaning
    assert (up.ended, down.ended) == ("reached", "reached")
    folds, others = events_of(up, "fold"), events_of(down, "fold")[::-1]
    assert [fold.stability for fold in folds] == ["lost", "regained"]
    assert len(others) == 2
    for fold, other in zip(folds, others, strict=True):
        assert abs(fold.value - other.value) <= fold.error + other.error
        assert fold.error < 1e-5
        assert fold.multiplier == pytest.approx(1.0, abs=1e-3)
    # Between both folds three motions exist, of which the one in the middle is unstable.
    inside = (up.values > folds[1].value) & (up.values < folds[0].value)
    # Beside a fold the answer may be the other motion.
    assert {up.status[i] for i in np.flatnonzero(inside)} <= {"converged", "unstable", "inaccurate"}
    assert up.status.count("inaccurate") <= 4
    assert np.all(np.abs(up.multiplier[np.array(up.status) == "unstable"]) > 1.0)
    assert up.values.max() > folds[0].value > up.values[folds[0].after + 2]


def test_a_branch_returns_over_a_fold_that_does_not_hang_on_the_accuracy(leaning: tuple[Sweep, Sweep]) -> None:
    finer = sweep(LEANING, "speed", 18.64, 18.6, points=10, accuracy=1e-5)
    assert (finer.ended, finer.values[-1]) == ("returned", 18.64)
    (same,), fold = events_of(finer, "fold"), events_of(leaning[0], "fold")[1]
    assert abs(same.value - fold.value) <= same.error + fold.error


@pytest.mark.parametrize(("begin", "step", "number"), [(18.66, 0.004, 0), (18.66, -0.004, 1)])
def test_a_simulation_over_time_jumps_at_the_fold(
    leaning: tuple[Sweep, Sweep], begin: float, step: float, number: int
) -> None:
    """The speed is changed in small steps, each from where the last one ended, as on a bench."""
    up = leaning[0]
    fold = events_of(up, "fold")[number]
    inside = [i for i in range(len(up.values)) if up.status[i] == "converged" and abs(up.values[i] - begin) < 0.02]
    low, high = min(up.rms[i] for i in inside), max(up.rms[i] for i in inside)
    assert high > 1.2 * low
    # From the branch that ends at this fold.
    way = 1.0 if step > 0.0 else -1.0
    state, level, speed = np.zeros((2, 6)), 0.0, begin - way * 0.08
    jumped = 0.0
    for n in range(60):
        at = speed + step * n
        moved = simulate_plainly(period_of(replace(LEANING, speed=at)), 250, 240, state)
        if n > 0 and abs(moved.mean / level - 1.0) > 0.4:
            jumped = at
            break
        state, level = moved.state, moved.mean
    assert abs(jumped - 0.5 * step - fold.value) < 2.0 * abs(step)


@pytest.mark.parametrize(("end", "kind"), [(1.1, "period_doubling"), (2.4, "neimark_sacker")])
def test_stability_is_lost_where_a_disturbance_begins_to_grow(end: float, kind: str) -> None:
    found = sweep(LIGHT, "load", 1.4, end, points=10)
    (event,) = events_of(found, "period_doubling", "neimark_sacker", "branch", "fold")
    assert (event.kind, event.stability) == (kind, "lost")
    assert abs(event.multiplier) == pytest.approx(1.0, abs=1e-4)
    sign = math.copysign(1.0, end - 1.4)
    for load, grows in ((event.value * (1.0 - 0.02 * sign), False), (event.value * (1.0 + 0.02 * sign), True)):
        scene = replace(LIGHT, load=load)
        period, state = orbit_of(scene, 400)
        trace, near = blank_trace(period), state * (1.0 + 1e-5)
        sizes = []
        for _ in range(240):
            state, near = run(period, state, trace), run(period, near, trace)
            sizes.append(float(np.linalg.norm((near - state) / STATE_SCALE)))
        assert (max(sizes[200:]) > max(sizes[100:140])) == grows


def test_a_sweep_ends_at_its_points() -> None:
    found = sweep(BENCH, "load", 4000.0, 1000.0, points=20, max_points=4)
    assert (found.ended, len(found.values), found.harmonics.shape) == ("points", 4, (4, 6))


@pytest.mark.parametrize(
    ("scene", "given", "word"),
    [
        (BENCH, ("colour", 1.0, 2.0), "parameter must be one of 'speed', 'load'"),
        (BENCH, ("speed", 40.0, 40.0), "speed must be swept between two numbers"),
        (BENCH, ("speed", -1.0, 40.0), "speed must be positive"),
        (replace(BENCH, defect=None), ("h_d", 1e-6, 2e-6), "that of a defect, the scene has none"),
        (replace(BENCH, unbalance=1e-3), ("speed", 30.0, 40.0), "unbalance"),
        (replace(BENCH, model="rotor"), ("speed", 30.0, 40.0), "this solves six_dof"),
    ],
)
def test_what_cannot_be_followed_is_refused(scene: Scene, given: tuple[str, float, float], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        sweep(scene, *given)
