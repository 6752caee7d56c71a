"""One ball period of balls with inertia: against the run over time, what does not repeat, stated errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import kinematics
from models.machine.scene import Defect, Scene
from models.published.marin import bearing_of
from models.solve.ball_inertia import period as ball_period
from models.solve.ball_inertia import solver as ball_inertia
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.registry import choose
from models.solve.response import Response
from models.words.request import Request

RIG = BallInertiaRig(m_b=0.0035, c_ci=500.0, c_co=500.0, defect_shape="half_sine")
HEALTHY = Scene(30.0, 1500.0, bearing=bearing_of(9), rig=RIG, clearance=3e-6)
REQUEST = Request(accuracy=2e-3, duration=0.25, rate=25600.0)
SCENES = {
    "healthy": HEALTHY,
    "outer race": replace(HEALTHY, defect=Defect(0.08, 1e-5)),
    "two rows, one damaged": replace(
        HEALTHY, bearing=replace(bearing_of(9), rows=2), defect=Defect(0.08, 1e-5, first_row=1), load=4000.0
    ),
}


def over_time(scene: Scene) -> Response:
    """Return the settled run over time with a quarter of the steps."""
    steps = 4.0 / (0.7 * ball_inertia.longest_stable_step(scene) * kinematics(scene.bearing, scene.speed).bpfo)
    return ball_inertia.solve(scene, replace(REQUEST, steps_per_period=round(steps)))


@pytest.mark.parametrize("name", list(SCENES))
def test_it_is_the_motion_that_a_run_over_time_settles_to(name: str) -> None:
    found, truth = ball_period.solve(SCENES[name], REQUEST), over_time(SCENES[name])
    assert (found.solver, found.status, found.record) == ("periodic", "converged", None)
    assert abs(found.rms / truth.rms - 1.0) <= found.rms_error <= REQUEST.accuracy
    assert found.peak == pytest.approx(truth.peak, rel=0.03)
    largest = float(np.max(truth.harmonics))
    assert np.abs(found.harmonics - truth.harmonics) == pytest.approx(0.0, abs=3e-3 * largest)


def test_auto_takes_it_where_the_motion_repeats() -> None:
    assert choose(HEALTHY, REQUEST)[0].solve is ball_period.solve
    assert choose(replace(HEALTHY, unbalance=1e-4), REQUEST)[0].solve is ball_inertia.solve


def test_a_motion_that_does_not_come_to_repeat_is_followed_over_time() -> None:
    """Without damping nothing settles."""
    scene = replace(HEALTHY, rig=replace(RIG, c_ci=0.0, c_co=0.0))
    found = ball_period.solve(scene, replace(REQUEST, duration=0.05))
    assert found.solver == "time"
    assert found.status != "converged"


def test_what_turns_with_the_shaft_is_refused() -> None:
    with pytest.raises(ValueError, match=r"unbalance: ball_inertia does not describe this for one ball period"):
        ball_period.solve(replace(HEALTHY, unbalance=1e-4), REQUEST)


def test_steps_that_are_too_coarse_for_the_accuracy_are_said() -> None:
    steps = round(2.5 / (ball_inertia.longest_stable_step(HEALTHY) * kinematics(HEALTHY.bearing, 30.0).bpfo))
    found = ball_period.solve(HEALTHY, replace(REQUEST, accuracy=1e-6, steps_per_period=steps))
    assert found.status == "inaccurate"
    assert found.error > 1e-6


def test_a_band_holds_the_lines_within() -> None:
    whole = ball_period.solve(HEALTHY, REQUEST)
    found = ball_period.solve(HEALTHY, replace(REQUEST, band=(500.0, 4000.0)))
    assert found.rms == pytest.approx(whole.rms_in_band(500.0, 4000.0), rel=2e-3)
    assert found.rms < whole.rms
