"""Random scenes: what ``auto`` takes keeps the accuracy asked for, and the errors of the trials are true ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.draws import draw
from benchmarks.scenes.trial import error_of, run, truth_of
from models.solve.response import Response
from models.solve.simulate import simulate
from models.words.request import Request
from reference.ring_scenes import FREE, ROTOR, SHORT, SOLVERS, scene_of


def test_a_ring_is_the_rotor_to_the_last_digits_that_its_spring_leaves() -> None:
    """The soft spring is 1e-6 of the contacts, the casing 300 times the ring: errors of that order."""
    scene = scene_of(ROTOR, clearance=3e-6)
    truth = truth_of(scene, Request(accuracy=1e-3, duration=1.0, rate=25600.0), SOLVERS["rotor", "rigid"])
    for sensor in ("a", "c"):
        found = simulate(scene, accuracy=3e-3, sensor=sensor, **SHORT)
        assert (found.model, found.sensors[0], found.sensors) == ("six_dof", sensor, found.sensors)
        assert found.rms == pytest.approx(truth.levels_of(sensor)[0], rel=2e-3)
        assert found.harmonics[:4] == pytest.approx(truth.harmonics[:4], rel=5e-3)


@pytest.mark.parametrize(("seed", "kind"), [(31, "balls"), (32, "rotor"), (33, "balls, defect"), (34, "shaft")])
def test_the_accuracy_is_never_exceeded(seed: int, kind: str) -> None:
    trial = run(draw(seed, kind), turns=1)
    assert len(trial.answers) > 1
    assert trial.taken.true <= trial.drawn.request.accuracy


def test_the_true_error_of_a_waveform_ignores_the_phase() -> None:
    found: Response = simulate(scene_of(FREE), accuracy=1e-3)
    order = np.arange(found.coefficients.shape[1])
    moved = replace(found, coefficients=found.coefficients * np.exp(0.7j * order))
    assert error_of(moved, found, Request(quantity="waveform"), 1.0) < 1e-2


def test_a_lost_waveform_adds_its_power_to_the_error_of_the_level() -> None:
    """Balls chatter at the longest stable step, which makes the RMS 30 % too high."""
    drawn = draw(62_024, "balls, unbalance")
    found = SOLVERS["ball_inertia", "time"].solve(drawn.scene, drawn.request)
    assert found.rms == pytest.approx(0.1132, rel=drawn.request.accuracy)


def test_waveform_and_lines_of_what_fails_to_repeat_are_not_claimed() -> None:
    drawn = draw(63_128, "shaft")
    found = SOLVERS["rotor", "elastic"].solve(drawn.scene, drawn.request)
    assert (found.status, drawn.request.quantity) == ("inaccurate", "lines")
    assert not found.repeats
    assert found.lines_error >= found.spread / found.rms > drawn.request.accuracy
