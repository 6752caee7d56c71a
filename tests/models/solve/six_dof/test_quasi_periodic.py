"""Effects that the shaft drives, added as lines of their own, beside a simulation over time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.rig import Rig
from models.machine.scene import Defect, Scene, Waviness
from models.solve.response import Response
from models.solve.simulate import simulate
from models.solve.six_dof.time_domain import simulate_time
from reference.signals import record_of
from reference.weak_scenes import plain_scene, with_effect
from tests.support.effort import effort_count

SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(6.0), 1e-5))
INNER = Waviness(2e-7, 12, "inner", 0.5)
RATE = 51200.0
SCENES = {
    "unbalance": replace(SCENE, unbalance=2e-2),
    "wave": replace(SCENE, waviness=(INNER, Waviness(1e-7, 9, "outer", 0.5))),
    "unbalance, wave, clearance": replace(
        SCENE, unbalance=5e-3, waviness=(replace(INNER, order=3),), clearance=2e-6, defect=None
    ),
}


def over_time(scene: Scene, seconds: float = 2.0) -> Response:
    return simulate_time(scene, seconds, RATE, settle=0.5, step=5e-6)


@pytest.mark.parametrize("name", SCENES)
def test_it_is_the_motion_over_time(name: str) -> None:
    scene = SCENES[name]
    found, truth = simulate(scene, accuracy=1e-3), over_time(scene)
    assert (found.solver, found.record) == ("periodic", None)
    assert found.added is not None
    assert found.status == ("converged" if scene.repeats else "not_periodic")
    assert (found.spread == 0.0) == scene.repeats
    assert abs(found.rms / truth.rms - 1.0) <= found.rms_error + truth.rms_error <= 1.5e-3
    assert abs(found.peak / truth.peak - 1.0) <= found.peak_error + truth.peak_error
    assert np.all(np.abs(found.harmonics - truth.harmonics) <= found.harmonics_error + 1e-3 * found.rms)
    frequency, amplitude = found.added.lines(found.bpfo, 0)
    assert (len(frequency) == 0) == scene.repeats
    for k in np.argsort(-amplitude)[:5]:
        seen = record_of(truth).line(float(frequency[k]))
        assert seen == pytest.approx(amplitude[k], abs=2e-4 * found.rms), frequency[k]
    assert found.why is not None
    assert "added to it, with lines of their own: " in found.why


def test_signal_and_bands_contain_the_lines_that_are_added() -> None:
    scene = SCENES["unbalance"]
    found, truth = simulate(scene, accuracy=1e-3), over_time(scene)
    signal = found.acceleration(RATE, 2.0)
    assert math.sqrt(float(np.mean(signal**2))) == pytest.approx(found.rms, rel=1e-3)
    assert found.rms_in_band(30.0, 50.0) == pytest.approx(record_of(truth).line(40.0) / math.sqrt(2.0), rel=1e-2)
    band = (30.0, 3000.0)
    within = simulate(scene, accuracy=1e-3, band=band)
    assert within.rms == pytest.approx(found.rms_in_band(*band), rel=1e-3)
    assert within.rms == pytest.approx(truth.rms_in_band(*band), rel=1e-3)
    inside = found.acceleration(RATE, 2.0, band=band)
    assert math.sqrt(float(np.mean(inside**2))) == pytest.approx(within.rms, rel=1e-3)
    assert np.max(np.abs(inside)) == pytest.approx(within.peak, rel=0.05)
    other = simulate(scene, accuracy=1e-3, sensor="mr")
    assert other.rms == pytest.approx(found.levels_of("mr")[0], rel=1e-3)
    assert other.acceleration(RATE, 0.1) == pytest.approx(found.acceleration(RATE, 0.1, sensor="mr"), abs=1e-2)


def test_a_phase_shifts_all_lines_in_time() -> None:
    found = simulate(SCENES["wave"], accuracy=1e-2, quantity="waveform")
    assert found.added is not None
    samples = 64
    shifted = found.acceleration(RATE, 0.05, phase=2.0 * math.pi * found.bpfo * samples / RATE)
    assert shifted == pytest.approx(found.acceleration(RATE, 0.05 + samples / RATE)[samples:], abs=1e-6)


@pytest.mark.parametrize("kind", ["unbalance", "inner_waviness"])
def test_no_stated_error_of_random_scenes_is_exceeded(kind: str) -> None:
    added = 0
    for seed in range(600, 600 + effort_count(quick=3, full=20)):
        share = 10.0 ** np.random.default_rng(seed).uniform(-1.0, 0.3)
        scene = with_effect(plain_scene(seed, damaged=False), kind, share)
        found = simulate(scene, accuracy=1e-2)
        if found.added is None:
            continue
        truth, added = over_time(scene), added + 1
        assert abs(found.rms / truth.rms - 1.0) <= found.rms_error + truth.rms_error, seed
        assert abs(found.peak / truth.peak - 1.0) <= found.peak_error + truth.peak_error, seed
    assert added > 0


@pytest.mark.parametrize(
    "scene",
    [
        # Too many angles of the shaft, no contact for a moment, and as strong as the load.
        replace(SCENE, unbalance=0.1, waviness=(replace(INNER, order=17),)),
        replace(SCENE, unbalance=1e-3, load=1.0, clearance=1e-5, defect=Defect(math.radians(20.0), 20e-6)),
        replace(SCENE, unbalance=0.1, load=100.0, rig=Rig(k_i=1.0)),
    ],
)
def test_what_is_not_known_so_well_is_simulated_over_time(scene: Scene) -> None:
    found = simulate(scene, accuracy=1e-2, duration=0.1, rate=25600.0)
    assert (found.solver, found.added) == ("time_domain", None)
