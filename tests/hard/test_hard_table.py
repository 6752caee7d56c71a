"""Rows of the table of hard cases that test_six_dof.py leaves open: limits, jumps, contact lost, and slip's rules."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Slip
from models.path.defect import ball_path
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.period import blank_trace
from models.solve.six_dof.kernels.step import P_OMEGA, P_PITCH
from models.solve.six_dof.lanes import LaneOptions, simulate_lanes
from reference.periods import period_of, run
from tests.support.effort import effort_count

G = 9.80665
DEG = math.pi / 180.0
ROUGH = Floor("rough")
BEARING = from_catalogue("1205 ETN9")


def test_light_load_scales_as_hertz_says() -> None:
    """Zero clearance, healthy: stiffness follows the third root of the load, the level falls steadily to nothing."""
    loads = (0.01, 1.0, 100.0, 500.0)
    levels = [simulate(Scene(40.0, load), tolerance=1e-7).rms / G for load in loads]
    assert np.all(np.diff(levels) > 0.0)
    assert levels[0] == pytest.approx(8e-9, rel=0.3)
    assert levels[-1] == pytest.approx(4e-4, rel=0.3)


def test_one_newton_with_clearance_gives_a_spread_or_a_figure_that_holds() -> None:
    """Contact is lost and regained; steps, if they matter, matter by no more than the spread that is stated."""
    scene = Scene(40.0, 1.0, clearance=1e-5, defect=Defect(20.0 * DEG, 20e-6, ROUGH))
    found = [simulate(scene, steps_per_period=steps) for steps in (256, 512, 2048)]
    for response in found:
        assert math.isfinite(response.rms)
        assert response.status in ("converged", "not_periodic", "inaccurate", "not_converged")
        assert response.repeats == (response.status == "converged")
    if all(response.status == "converged" for response in found):
        assert found[1].rms == pytest.approx(found[2].rms, rel=3e-3)
    else:
        slack = 4.0 * max(response.spread for response in found)
        assert found[1].rms == pytest.approx(found[2].rms, abs=slack)


def test_all_balls_out_of_contact_is_linear_motion_exactly() -> None:
    """With no ball touching, one period is the matrix exponential of the rig, however long the steps."""
    scene = Scene(40.0, 0.0, clearance=1e-3)
    period = period_of(scene, 64)
    duration = float(period.parameter[P_PITCH] / period.parameter[P_OMEGA])
    state = np.array([[1e-6, 2e-3, -1e-6, 1e-3, 2e-7, 5e-3], [-2e-6, 1e-3, 1e-6, -1e-3, 1e-7, -3e-3]])
    after = run(period, state, blank_trace(period))
    rig = scene.rig_as(Rig)
    # (inner ring, outer ring, resonator): displacements, then velocities.
    stiffness = np.array([[rig.k_i, 0.0, 0.0], [0.0, rig.k_r, -rig.k_r], [0.0, -rig.k_r, rig.k_r]])
    damping = np.array([[rig.c_i, 0.0, 0.0], [0.0, rig.c_r, -rig.c_r], [0.0, -rig.c_r, rig.c_r]])
    masses = np.diag(1.0 / np.array([rig.m_i, rig.m_o, rig.m_r]))
    flow = expm(np.block([[np.zeros((3, 3)), np.eye(3)], [-masses @ stiffness, -masses @ damping]]) * duration)
    share = rig.m_r / (rig.m_o + rig.m_r)
    # Rows: the coordinates of the state, from those of the rig.
    one = np.array([[1.0, 0.0, 0.0], [0.0, 1.0 - share, share], [0.0, 1.0, -1.0]])
    for before, found in zip(state, after, strict=True):
        x = np.concatenate((np.linalg.solve(one, before[0::2]), np.linalg.solve(one, before[1::2])))
        end = flow @ x
        assert found[0::2] == pytest.approx(one @ end[:3], rel=1e-6, abs=1e-13)
        assert found[1::2] == pytest.approx(one @ end[3:], rel=1e-6, abs=1e-9)


def test_the_edge_of_a_defect_is_tangent() -> None:
    """Depth and slope both set in from zero at the edge, so that the edge itself is no event."""
    path = ball_path(BEARING, Defect(20.0 * DEG, 20e-6))
    assert path is not None
    for beyond in (1e-4, 1e-5, 1e-6):
        depth, slope = path(np.array([10.0 * DEG - beyond, -10.0 * DEG + beyond]))
        # d is 62.3 mm/rad^2 times the square of the angle beyond the edge (times the cosine of the contact angle).
        factor = 62.3e-3 * path.cos_alpha
        assert depth == pytest.approx(np.full(2, factor * beyond**2), rel=1e-2)
        assert np.abs(slope) == pytest.approx(np.full(2, 2.0 * factor * beyond), rel=1e-2)


@pytest.mark.parametrize("extent_deg", [17.8, 17.88, 17.9, 25.0, 60.0])
def test_past_the_validity_of_the_edge_formula_the_path_stays_at_its_end(extent_deg: float) -> None:
    """Beyond asin(r_b / r_o) the square root of Eq. 51 would be of a negative number; the path stays where it was."""
    path = ball_path(BEARING, Defect(extent_deg * DEG, math.inf))
    assert path is not None
    angle = np.linspace(-0.5 * extent_deg * DEG, 0.0, 2001)
    depth, slope = path(angle)
    assert np.all(np.isfinite(depth))
    assert np.all(np.isfinite(slope))
    assert np.all(np.diff(depth) >= 0.0)
    end = path.cos_alpha * (math.sqrt(path.r_o**2 - path.r_b**2) - (path.r_o - path.r_b))
    assert depth.max() <= end * (1.0 + 1e-9)


def test_contacts_that_open_and_close_at_speed() -> None:
    """The force sets in like a square root there; accuracy is promised rms over scenes, these are among the worst."""
    for scene in (
        Scene(30.0, 2000.0, defect=Defect(4.236 * DEG, math.inf)),
        Scene(40.0, 4000.0, defect=Defect(50.0 * DEG, 32e-6)),
    ):
        fine = simulate(scene, steps_per_period=16384, tolerance=1e-8).rms
        for accuracy in (1e-3, 2e-4):
            assert simulate(scene, accuracy=accuracy, tolerance=1e-8).rms == pytest.approx(fine, rel=3.0 * accuracy)


def test_edges_one_ball_spacing_apart_are_a_resonance_and_kept() -> None:
    """At 30 degrees a ball enters while the next one leaves: levels change steeply there, but continuously."""
    around = [simulate(Scene(40.0, 4000.0, defect=Defect(x * DEG, 20e-6))).rms for x in (29.99, 30.0, 30.01)]
    assert around[0] == pytest.approx(around[1], rel=3e-2)
    assert around[2] == pytest.approx(around[1], rel=3e-2)


@pytest.mark.parametrize("slip", [1e-3, 0.02])
def test_the_rule_of_slip_is_explicit_and_finite(slip: float) -> None:
    """Slip redrawn per passage needs a standard error, the mean force does not; neither differentiates the slip."""
    scene = Scene(40.0, 1000.0, defect=Defect(2.362 * DEG, 500e-6))
    blocks = effort_count(quick=4, full=20)
    drawn = simulate_lanes([replace(scene, slip=Slip(slip))], LaneOptions(slip_blocks=blocks))
    mean = simulate_lanes([replace(scene, slip=Slip(slip, "mean_force"))])
    none = simulate_lanes([scene])
    assert drawn.rms[0] == pytest.approx(none.rms[0], rel=0.4)
    assert 0.0 < mean.rms[0] < none.rms[0]


@pytest.mark.parametrize("floor", [Floor(), ROUGH])
def test_commensurate_steps_leave_no_bias(floor: Floor) -> None:
    """Equal steps that divide the ball period meet every kink alike; landed ones agree whatever their number."""
    scene = Scene(40.0, 4000.0, defect=Defect(20.0 * DEG, 20e-6, floor))
    levels = [simulate(scene, steps_per_period=n, tolerance=1e-8).rms for n in (512, 523, 600, 1024)]
    assert np.ptp(levels) / levels[-1] < 2e-4
