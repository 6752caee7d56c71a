"""Hard cases of the effects: no load, clearance, wide and deep defects, defects of everything, contact lost."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import kinematics
from models.machine.scene import Defect, Floor, Part, Scene, Waviness
from models.solve.six_dof.time_domain import simulate_time
from reference.signals import record_of, recorded

RATE = 25600.0
SCENE = Scene(40.0, 4000.0)


@pytest.mark.parametrize("part", ["inner", "ball"])
@pytest.mark.parametrize(
    ("extent", "h_d"),
    [(1e-9, 1e-5), (1e-3, 1e-12), (0.3, 1e-9), (0.3, math.inf), (1.2, 1e-2), (3.0, 2e-5)],
)
def test_any_size_of_defect_is_finite(part: Part, extent: float, h_d: float) -> None:
    defect = Defect(extent, h_d, part=part)
    response = simulate_time(replace(SCENE, defect=defect), 0.05, RATE)
    healthy = simulate_time(SCENE, 0.05, RATE)
    assert np.all(np.isfinite(recorded(response)))
    assert response.rms > 0.9 * healthy.rms
    if extent < 1e-6 or h_d < 1e-11:
        assert response.rms == pytest.approx(healthy.rms, rel=1e-3)


@pytest.mark.parametrize("part", ["inner", "ball"])
def test_without_load_and_with_clearance_nothing_touches(part: Part) -> None:
    defect = Defect(0.1, 5e-4, part=part)
    response = simulate_time(Scene(40.0, 0.0, defect=defect, clearance=1e-5), 0.05, RATE)
    assert response.rms < 1e-9
    assert response.status == "converged"


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
def test_light_load_with_clearance_states_its_spread(part: Part) -> None:
    floor = Floor("rough", seed=1)
    defect = Defect(0.3, 2e-5, floor, part=part)
    response = simulate_time(Scene(40.0, 1.0, defect=defect, clearance=1e-5), 1.0, RATE)
    assert response.status in ("not_periodic", "inaccurate", "not_converged")
    assert response.spread > 0.0
    assert 0.0 < response.rms_se < response.rms


def test_a_rough_floor_of_no_deviation_is_smooth() -> None:
    parts: tuple[Part, ...] = ("inner", "ball")
    for part in parts:
        smooth = replace(SCENE, defect=Defect(0.3, 2e-5, part=part))
        levels = [
            simulate_time(replace(SCENE, defect=replace(smooth.defect, floor=Floor("rough", sd=sd))), 0.05, RATE).rms
            for sd in (0.0, 1e-9, 1e-6)
            if smooth.defect is not None
        ]
        assert levels[0] == pytest.approx(simulate_time(smooth, 0.05, RATE).rms, rel=1e-12)
        assert levels[1] == pytest.approx(levels[0], rel=1e-2)
        assert levels[2] != pytest.approx(levels[0], rel=1e-4)


def test_an_unbalance_that_throws_the_shaft_about_stays_finite() -> None:
    """10 kN of turning force against 1 kN of load: all contacts are lost and regained in every turn."""
    speed = 40.0
    scene = Scene(speed, 1000.0, unbalance=1e4 / (2.0 * math.pi * speed) ** 2, clearance=1e-5)
    response = simulate_time(scene, 0.5, RATE)
    assert response.status == "not_periodic"
    assert np.all(np.isfinite(recorded(response)))
    assert record_of(response).line(speed) > 0.1


def test_gravity_alone_loads_the_bearing() -> None:
    response = simulate_time(Scene(40.0, 0.0, gravity=9.80665, defect=Defect(0.1, 5e-4)), 0.1, RATE)
    assert response.status == "converged"
    assert response.rms > 1e-3


def test_waviness_higher_than_the_approach_of_the_contacts() -> None:
    """20 um of waviness against about 10 um of approach under 1 kN: balls lose contact on every wave."""
    response = simulate_time(Scene(40.0, 1000.0, waviness=(Waviness(20e-6, 11, "inner"),)), 0.2, RATE)
    assert np.all(np.isfinite(recorded(response)))
    assert response.rms > 1.0


def test_both_rows_and_either_row() -> None:
    """The second row is the first, half a pitch later; both together are louder than either."""
    defect = Defect(math.radians(4.0), 5e-4)
    first, second, both = (
        simulate_time(replace(SCENE, defect=replace(defect, first_row=r, rows=n)), 0.4, 51200.0)
        for r, n in ((0, 1), (1, 1), (0, 2))
    )
    assert second.rms == pytest.approx(first.rms, rel=2e-3)
    assert both.rms > 1.2 * first.rms


def test_step_in_which_event_and_sample_coincide() -> None:
    """The cage turns by one pitch in a whole number of steps: every event falls on a sample, and nothing changes."""
    scene = replace(SCENE, defect=Defect(math.radians(20.0), 20e-6))
    bpfo = kinematics(scene.bearing, scene.speed).bpfo
    commensurate = simulate_time(scene, 0.2, 256.0 * bpfo)
    assert commensurate.rms == pytest.approx(simulate_time(scene, 0.2, 51200.0).rms, rel=3e-3)
