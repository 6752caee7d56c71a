"""Numerical hard cases of the six-degree-of-freedom model: what a correct program must do with each."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.machine.scene import Defect, Floor, Scene
from models.solve.simulate import simulate
from reference.periods import period_of

G = 9.80665
DEG = math.pi / 180.0
ROUGH = Floor("rough")
HEALTHY = 0.003043


def rms_g(dphi_deg: float, h_d: float, floor: Floor | None = None, *, load: float = 4000.0) -> float:
    defect = Defect(dphi_deg * DEG, h_d, floor or Floor())
    response = simulate(Scene(40.0, load, defect=defect))
    assert response.status == "converged"
    return response.rms / G


@pytest.mark.parametrize("defect", [None, Defect(20.0 * DEG, 20e-6), Defect(20.0 * DEG, 20e-6, ROUGH, rows=2)])
@pytest.mark.parametrize("clearance", [0.0, 1e-5])
def test_no_load_is_no_vibration(defect: Defect | None, clearance: float) -> None:
    response = simulate(Scene(40.0, 0.0, defect=defect, clearance=clearance))
    assert response.status == "converged"
    assert (response.rms, response.peak, response.period_change) == (0.0, 0.0, 0.0)
    assert np.all(response.harmonics == 0.0)
    assert np.all(response.acceleration(25600.0, 0.01) == 0.0)


@pytest.mark.parametrize("load", [0.01, 1.0, 30.0, 500.0])
def test_light_load_without_clearance(load: float) -> None:
    coarse = simulate(Scene(40.0, load), tolerance=1e-7)
    fine = simulate(Scene(40.0, load), steps_per_period=4096, tolerance=1e-7)
    assert coarse.status == fine.status == "converged"
    assert coarse.rms == pytest.approx(fine.rms, rel=1e-3)
    assert 0.0 < coarse.rms / G < 5e-4


@pytest.mark.parametrize("load", [10.0, 30.0, 100.0])
def test_light_load_with_clearance_and_rough_floor(load: float) -> None:
    """Contact is lost and regained: either it repeats, or the answer says that it does not and by how much."""
    scene = Scene(40.0, load, clearance=1e-5, defect=Defect(20.0 * DEG, 20e-6, ROUGH))
    response, fine = simulate(scene), simulate(scene, steps_per_period=2048)
    assert response.status in (("converged",) if response.repeats else ("not_periodic", "inaccurate"))
    slack = 3e-3 * fine.rms if response.repeats else 4.0 * (response.spread + fine.spread)
    assert response.rms == pytest.approx(fine.rms, abs=slack)


def test_a_motion_that_does_not_repeat_is_said_to() -> None:
    """A light load with clearance over a rough floor: the rings bounce, and no two passages are alike."""
    scene = Scene(24.3, 38.6, clearance=11.8e-6, defect=Defect(34.0 * DEG, 18.6e-6, ROUGH))
    coarse, fine = simulate(scene), simulate(scene, steps_per_period=1024)
    for response in (coarse, fine):
        assert not response.repeats
        # The level is not known to a thousandth.
        assert response.status == "inaccurate"
        assert 0.03 < response.spread / response.rms < 0.5
    # The mean over the window is as far apart as the spread allows, not a figure to trust to the last digit.
    assert coarse.rms == pytest.approx(fine.rms, abs=coarse.spread)


def test_depth_zero_is_healthy_whatever_the_floor() -> None:
    for floor in (Floor(), ROUGH):
        assert rms_g(20.0, 0.0, floor) == pytest.approx(HEALTHY, rel=1e-3)
        assert rms_g(50.0, 0.0, floor) == pytest.approx(HEALTHY, rel=1e-3)


def test_depth_grows_from_nothing_continuously() -> None:
    assert rms_g(20.0, 1e-12) == pytest.approx(0.00305, rel=5e-3)
    assert rms_g(20.0, 1e-9) == pytest.approx(0.00319, rel=1e-2)
    assert rms_g(20.0, 1e-7) == pytest.approx(0.030, rel=3e-2)


def test_a_rough_row_at_depth_zero_is_no_maximum() -> None:
    levels = [rms_g(50.0, h, ROUGH) for h in (0.0, 1e-9, 1e-7, 1e-6, 4e-6, 16e-6)]
    assert levels[0] == min(levels)
    assert levels[1] == pytest.approx(levels[0], rel=0.3)
    assert np.all(np.diff(levels) > 0.0)


@pytest.mark.parametrize("dphi_deg", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("floor", [Floor(), ROUGH])
def test_an_extent_of_nothing_is_healthy(dphi_deg: float, floor: Floor) -> None:
    assert rms_g(dphi_deg, 20e-6, floor) == pytest.approx(rms_g(0.0, 0.0), rel=1e-5)


@pytest.mark.parametrize("dphi_deg", [1.0, 2.0, 2.6, 4.0, 6.0])
def test_deeper_than_reach_is_localised(dphi_deg: float) -> None:
    localised = rms_g(dphi_deg, math.inf)
    assert rms_g(dphi_deg, 5e-4) == pytest.approx(localised, rel=1e-12)
    assert rms_g(dphi_deg, 5e-4, ROUGH) == pytest.approx(localised, rel=1e-12)


@pytest.mark.parametrize("dphi_deg", [17.0, 17.88, 20.0, 29.999, 30.0, 50.0, 120.0, 360.0])
@pytest.mark.parametrize("h_d", [5e-4, math.inf])
def test_wide_defects_beyond_the_edge_formula(dphi_deg: float, h_d: float) -> None:
    response = simulate(Scene(40.0, 4000.0, defect=Defect(dphi_deg * DEG, h_d)))
    assert math.isfinite(response.rms)
    assert response.status in ("converged", "not_periodic")


def test_two_balls_of_a_row_in_the_defect() -> None:
    around = [rms_g(x, 20e-6) for x in (29.9, 30.0, 30.1, 50.0)]
    assert np.all(np.isfinite(around))
    assert around[0] == pytest.approx(around[2], rel=0.1)


def test_all_balls_out_of_contact() -> None:
    """Both rows over one bottomless defect that spans the loaded zone: the rings meet only beyond its edges."""
    scene = Scene(40.0, 500.0, defect=Defect(100.0 * DEG, 2e-4, rows=2))
    response = simulate(scene)
    assert math.isfinite(response.rms)
    assert response.rms > 0.0


def test_one_step_grid_gives_the_same_rms_as_another() -> None:
    """Without landing on kinks, commensurate grids are up to 2.5 % apart."""
    defect = Defect(4.236 * DEG, math.inf)
    levels = [simulate(Scene(30.0, 2000.0, defect=defect), steps_per_period=n).rms for n in (700, 800, 901, 1024)]
    assert np.ptp(levels) / levels[0] < 2e-3


def test_the_rough_race_is_the_same_at_every_speed() -> None:
    scenes = [Scene(f, 4000.0, defect=Defect(40.0 * DEG, 10e-6, ROUGH)) for f in (15.0, 50.0)]
    slow, fast = (period_of(scene, 512).nodes for scene in scenes)
    assert np.array_equal(slow.depth, fast.depth)
    assert slow.rate / 15.0 == pytest.approx(fast.rate / 50.0, rel=1e-12)


def test_peak_is_well_conditioned_enough() -> None:
    scene = Scene(40.0, 4000.0, defect=Defect(20.0 * DEG, 20e-6))
    assert simulate(scene).peak == pytest.approx(simulate(scene, steps_per_period=8192).peak, rel=0.05)
