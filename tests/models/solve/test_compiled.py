"""The compiled set-up, search and rows of the six-degree-of-freedom model against their slow and obvious forms."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue
from models.machine.hertz import element_angles, static_equilibrium
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Waviness
from models.path.defect import BallPath, ball_path
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.orbit import CALM_PERIODS, LEFT, PLAIN_FIRST, STATE_SCALE, settle
from models.solve.six_dof.kernels.path import NUDGE, edge, floor_at, path_kinks, touch_angle
from models.solve.six_dof.kernels.period import Period, ball_period, blank_trace, mean_square
from models.solve.six_dof.kernels.period_setup import arc_distance
from models.solve.six_dof.kernels.step import P_OMEGA, P_U_1, P_U_2
from models.solve.six_dof.periodic import steering
from models.solve.six_dof.rows import simulate_row
from models.solve.six_dof.setup import defect_arrays, operating_point
from reference.periods import period_of, solve_scene
from tests.oracles import orbit_oracle
from tests.support.effort import effort_count

BEARING = from_catalogue("1205 ETN9")
SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))
SCALE = np.tile(STATE_SCALE, 2)

floors = st.one_of(st.just(Floor()), st.builds(Floor, st.just("rough"), st.floats(1e-8, 3e-6), seed=st.integers(0, 5)))
defects = st.builds(
    Defect,
    st.floats(0.001, 2.0 * math.pi),
    st.one_of(st.floats(1e-9, 1e-3), st.just(math.inf)),
    floors,
    st.floats(-3.0, 3.0),
)


def path_of(defect: Defect) -> BallPath:
    path = ball_path(BEARING, defect)
    assert path is not None
    return path


class Interpreted:
    """A ball period for the search in plain Python."""

    def __init__(self, period: Period) -> None:
        self.period, self.trace = period, blank_trace(period)

    def run(self, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], int, float]:
        after = np.empty((2, 6))
        status = ball_period(np.ascontiguousarray(state), after, self.trace, self.period)
        return after, status, math.sqrt(mean_square(self.trace, 0))


@given(defects)
def test_kinks(defect: Defect) -> None:
    (array,), profile = defect_arrays(BEARING, [defect])
    assert np.sort(path_kinks(array, profile)) == pytest.approx(path_of(defect).kinks(), abs=1e-9)


@given(defects, st.floats(-7.0, 7.0))
def test_floor(defect: Defect, angle: float) -> None:
    (array,), profile = defect_arrays(BEARING, [defect])
    depth, slope = path_of(defect)._floor(np.array([angle]))
    assert floor_at(array, profile, angle) == pytest.approx((depth[0], slope[0]), rel=1e-9, abs=1e-12)


@given(st.floats(0.0, 0.3))
def test_edge(delta: float) -> None:
    path = path_of(Defect(1.0, math.inf))
    depth, slope = path(np.array([delta - 0.5]))
    ours = edge(delta, path.r_o, path.r_b, path.reach)
    assert np.array(ours) * path.cos_alpha == pytest.approx((depth[0], slope[0]), rel=1e-9, abs=1e-15)


@given(st.floats(1e-9, 1e-4))
def test_a_ball_touches_the_floor_where_the_edge_path_is_as_deep(h_d: float) -> None:
    path = path_of(Defect(1.0, h_d))
    angle = touch_angle(h_d, path.r_o, path.r_b)
    assert edge(angle, path.r_o, path.r_b, path.reach)[0] == pytest.approx(h_d, rel=1e-6)


SIZES = ((1.0, 2e-5), (20.0, 2e-5), (29.99999, 3e-6), (77.0, math.inf), (360.0, 5e-4))
PLACED = list(itertools.product(SIZES, (Floor(), Floor("rough", seed=3)), (1, 2), (0.0, 0.4, -3.0)))


# Every seventh meets each size, floor, row and position.
@pytest.mark.parametrize(("size", "floor", "rows", "position"), PLACED[:: effort_count(quick=7, full=1)])
def test_tables_are_the_path(size: tuple[float, float], floor: Floor, rows: int, position: float) -> None:
    extent, h_d = size
    defect = Defect(math.radians(extent), h_d, floor, position, rows)
    period = period_of(Scene(40.0, 4000.0, defect=defect), 200)
    nodes, balls = period.nodes, period.balls
    path, omega = path_of(defect), float(period.parameter[P_OMEGA])
    starts = np.arctan2(balls.moved[1], balls.moved[0])
    ends = np.stack((period.time[:-1], period.time[1:]))[:, np.diff(period.time) > 1e-12] * omega
    cage = np.stack((ends[0], 0.5 * (ends[0] + ends[1]), ends[1]), axis=1)
    assert np.arctan2(nodes.turn[..., 1], nodes.turn[..., 0]) == pytest.approx(cage, abs=1e-13)
    cage[period.first[:-1], 0] += NUDGE
    cage[period.first[1:] - 1, 2] -= NUDGE
    depth, slope = path(cage[..., None] + starts)
    assert nodes.depth == pytest.approx(depth, rel=1e-6, abs=1e-14)
    assert nodes.rate == pytest.approx(omega * slope, rel=1e-4, abs=1e-9)
    count = BEARING.n_elements * BEARING.rows
    assert balls.moved.shape[1] + balls.plain.shape[1] == count
    assert math.log2(balls.moved[2].sum() + balls.plain[2].sum() + 1.0) == count


def test_every_ball_is_moved_by_the_waves_of_the_race() -> None:
    """The tables hold the sum of the defect's path and the waves, written out."""
    wave = Waviness(2e-6, 7, phase=0.4)
    scene = replace(SCENE, waviness=(wave, Waviness(0.0, 3)))
    period, plain = period_of(scene, 200), period_of(SCENE, 200)
    omega, balls = float(period.parameter[P_OMEGA]), period.balls
    assert balls.plain.shape[1] == 0
    starts = np.arctan2(balls.moved[1], balls.moved[0])
    cage = np.arctan2(period.nodes.turn[..., 1], period.nodes.turn[..., 0])
    angle = 7.0 * (cage[..., None] + starts) + 0.4
    size = 2e-6 * math.cos(BEARING.contact_angle)
    damaged = plain.balls.moved.shape[1]
    depth, rate = size * np.cos(angle), -7.0 * omega * size * np.sin(angle)
    depth[..., :damaged] += plain.nodes.depth
    rate[..., :damaged] += plain.nodes.rate
    assert period.nodes.depth == pytest.approx(depth, abs=1e-15)
    assert period.nodes.rate == pytest.approx(rate, abs=1e-10)


@given(st.floats(-7.0, 7.0), st.floats(0.01, 1.0), st.floats(-7.0, 7.0))
def test_distance_from_an_arc(start: float, length: float, angle: float) -> None:
    nearest = min(
        abs(math.remainder(point - angle, 2.0 * math.pi)) for point in np.linspace(start, start + length, 401)
    )
    assert arc_distance(start, length, angle) == pytest.approx(nearest, abs=length / 400.0)


@pytest.mark.parametrize("seed", range(effort_count(quick=8, full=60)))
def test_the_compiled_search_is_the_interpreted_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    floor = Floor("rough" if seed % 2 else "smooth", seed=seed)
    defect = Defect(rng.uniform(0.01, 0.9), rng.uniform(1e-6, 32e-6), floor)
    scene = Scene(rng.uniform(15.0, 50.0), rng.uniform(300.0, 5000.0), defect=defect, clearance=5e-6 * (seed % 3))
    period, steer = period_of(scene), steering(replace(scene, defect=None))
    assert steer is not None
    rest, trace, state, plain = np.zeros((2, 6)), blank_trace(period), np.empty((2, 6)), (PLAIN_FIRST, 0)[seed % 2]
    number, change, rms, settled, felt = settle(
        rest, state, trace, period, steer, plain, CALM_PERIODS, 1e-8, 300, math.inf
    )
    slow = orbit_oracle.settle(Interpreted(period), rest, SCALE, steer, plain, 1e-8, 300)
    assert settled
    assert slow[4]
    assert change < LEFT * 1e-8
    assert slow[2] < 1e-8
    # The compiled search ends as soon as it knows that little is left.
    assert number <= slow[1] + 2
    assert state.ravel() / SCALE == pytest.approx(slow[0].ravel() / SCALE, rel=1e-5, abs=1e-4)
    assert rms == pytest.approx(slow[3], rel=1e-5)
    assert rms == pytest.approx(math.sqrt(mean_square(trace, 0)), rel=1e-12)
    for tolerance in (1e-3, 1e-5):
        sooner = settle(rest, state, trace, period, steer, plain, CALM_PERIODS, tolerance, 300, math.inf)
        assert sooner[0] <= number
        assert sooner[1] < LEFT * tolerance
        assert sooner[2] == pytest.approx(rms, rel=max(sooner[1], tolerance))
    # From close by, a period or two show how little is left. (Steps that a contact divides are others there.)
    push = 1e-4 * rng.standard_normal((2, 6)) * STATE_SCALE
    near = settle(state + push, np.empty((2, 6)), trace, period, steer, 0, CALM_PERIODS, 1e-3, 300, felt)
    assert near[0] <= 2
    assert near[2] == pytest.approx(rms, rel=near[1] + 2e-5)


@pytest.mark.parametrize("floor", [Floor(), Floor("rough", seed=2)])
@pytest.mark.parametrize("band", [None, (300.0, 9500.0)])
@pytest.mark.parametrize("steps", [None, 256])
def test_a_row_is_its_scenes(floor: Floor, band: tuple[float, float] | None, steps: int | None) -> None:
    extents = np.radians([0.0, 0.5, 3.0, 20.0, 50.0])
    scene = replace(SCENE, defect=Defect(0.1, 12e-6, floor))
    row = simulate_row(scene, extents, accuracy=2e-3, steps_per_period=steps, band=band)
    assert np.all(row.settled)
    for i, extent in enumerate(extents):
        defect = Defect(float(extent), 12e-6, floor)
        alone = simulate(replace(scene, defect=defect), accuracy=2e-3, steps_per_period=steps, band=band)
        assert row.rms[i] == pytest.approx(alone.rms, rel=1e-9)
        assert row.harmonics[i] == pytest.approx(alone.harmonics, rel=1e-9)
        assert row.rms_error[i] == pytest.approx(alone.rms_error, rel=1e-4)
        assert row.harmonics_error[i] == pytest.approx(alone.harmonics_error, rel=1e-4, abs=1e-9 * alone.rms)
        assert row.multiplier[i] == pytest.approx(alone.multiplier, rel=1e-6)
        assert (row.periods[i], row.change[i]) == (alone.periods, pytest.approx(alone.period_change, rel=1e-3))


def test_what_a_row_cannot_be_made_of_is_refused() -> None:
    extents = np.array([0.1])
    with pytest.raises(ValueError, match="defect"):
        simulate_row(replace(SCENE, defect=None), extents, steps_per_period=256)
    with pytest.raises(ValueError, match="steps_per_period"):
        simulate_row(SCENE, extents, steps_per_period=4)
    with pytest.raises(ValueError, match="dphi_d"):
        simulate_row(SCENE, np.array([-0.1, 0.1]), steps_per_period=256)
    with pytest.raises(ValueError, match="steps resolve up to"):
        simulate_row(SCENE, extents, steps_per_period=64, band=(0.0, 20e3))
    with pytest.raises(ValueError, match="accuracy"):
        simulate_row(SCENE, extents, accuracy=-1e-3)


@pytest.mark.parametrize("accuracy", [5e-3, 1e-3, 2e-4])
def test_the_error_is_the_one_asked_for(accuracy: float) -> None:
    errors, bounded = [], 0
    count = effort_count(quick=12, full=200)
    for seed in range(count):
        rng = np.random.default_rng(seed)
        defect = Defect(math.radians(rng.uniform(0.8, 50.0 if seed % 2 else 15.0)), rng.uniform(1e-6, 32e-6))
        scene = Scene(rng.uniform(15.0, 50.0), rng.uniform(500.0, 5000.0), defect=defect)
        fine = simulate(scene, steps_per_period=8192, tolerance=1e-8)
        found = simulate(scene, accuracy=accuracy)
        assert found.status == "converged"
        assert found.rms_error <= accuracy
        errors.append(abs(found.rms / fine.rms - 1.0))
        bounded += errors[-1] <= found.rms_error + 0.05 * accuracy
    # The estimate bounds the error of 95 in 100, and no error is over three times what was asked (issue 14); over all
    # scenes it is well within it.
    assert bounded >= 0.95 * count - 1
    assert np.max(errors) < 3.0 * accuracy
    assert np.sqrt(np.mean(np.square(errors))) < accuracy


def test_a_stricter_accuracy_takes_more_steps_and_no_other_than_a_positive_one_is_taken() -> None:
    steps = [solve_scene(SCENE, accuracy).steps for accuracy in (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)]
    assert steps == sorted(steps)
    assert steps[-1] > 4 * steps[0]
    for accuracy in (0.0, -1e-3, math.nan, math.inf):
        with pytest.raises(ValueError, match="accuracy"):
            simulate(SCENE, accuracy=accuracy)


@pytest.mark.parametrize("load", [0.0, 0.01, 777.0, 1e5])
def test_the_equilibrium_without_clearance_is_scaled_from_that_of_a_unit(load: float) -> None:
    scene = replace(SCENE, load=load, defect=None)
    parameter = operating_point(scene).parameter
    exact = static_equilibrium(element_angles(scene.bearing), load, scene.rig_as(Rig).k_c)
    assert parameter[[P_U_1, P_U_2]] == pytest.approx(exact, rel=1e-11, abs=1e-18)
