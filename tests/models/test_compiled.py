"""The compiled set-up, search and rows of the six-degree-of-freedom model against their slow and obvious forms."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.bearing import from_catalogue
from models.dynamics.orbit import SCALE, find_orbit
from models.dynamics.rows import simulate_row
from models.dynamics.six_dof import GRADES, BallPeriod, defect_arrays, prepare, steps_for
from models.hertz import element_angles, static_equilibrium
from models.kernels.orbit import DEPTH, anderson
from models.kernels.path import NUDGE, edge, floor_at, path_kinks, touch_angle
from models.kernels.period_setup import arc_distance
from models.kernels.six_dof import P_U_1, P_U_2
from models.path.defect import BallPath, ball_path
from models.scene import Defect, Floor, Scene
from models.simulate import simulate, steering
from tests.effort import effort_count
from tests.oracles import orbit_oracle

BEARING = from_catalogue("1205 ETN9")
SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))

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


class Interpreted(BallPeriod):
    """A period whose settled motion is searched for in plain Python."""

    def settle(
        self,
        state: NDArray[np.float64],
        wave: NDArray[np.float64],
        scale: NDArray[np.float64],
        steering: NDArray[np.float64],
        tolerance: float,
        cap: int,
    ) -> tuple[NDArray[np.float64], int, float, float, bool]:
        return orbit_oracle.settle(self, state, wave, scale, steering, tolerance, cap)


@given(defects)
def test_kinks(defect: Defect) -> None:
    array, profile = defect_arrays(BEARING, defect)
    assert np.sort(path_kinks(array, profile)) == pytest.approx(path_of(defect).kinks(), abs=1e-9)


@given(defects, st.floats(-7.0, 7.0))
def test_floor(defect: Defect, angle: float) -> None:
    array, profile = defect_arrays(BEARING, defect)
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


@pytest.mark.parametrize("position", [0.0, 0.4, -3.0])
@pytest.mark.parametrize("rows", [1, 2])
@pytest.mark.parametrize("floor", [Floor(), Floor("rough", seed=3)])
@pytest.mark.parametrize(
    ("extent", "h_d"), [(1.0, 2e-5), (20.0, 2e-5), (29.99999, 3e-6), (77.0, math.inf), (360.0, 5e-4)]
)
def test_tables_are_the_path(extent: float, h_d: float, floor: Floor, rows: int, position: float) -> None:
    defect = Defect(math.radians(extent), h_d, floor, position, rows)
    period = prepare(Scene(40.0, 4000.0, defect=defect), 200)
    path, omega = path_of(defect), 2.0 * math.pi / (BEARING.n_elements * period.duration)
    starts = np.arctan2(period.damaged[1], period.damaged[0])
    ends = np.stack((period.time[:-1], period.time[1:]))[:, np.diff(period.time) > 1e-12] * omega
    cage = np.stack((ends[0], 0.5 * (ends[0] + ends[1]), ends[1]), axis=1)
    assert np.arctan2(period.turn[..., 1], period.turn[..., 0]) == pytest.approx(cage, abs=1e-13)
    cage[period.first[:-1], 0] += NUDGE
    cage[period.first[1:] - 1, 2] -= NUDGE
    depth, slope = path(cage[..., None] + starts)
    assert period.depth == pytest.approx(depth, rel=1e-6, abs=1e-14)
    assert period.rate == pytest.approx(omega * slope, rel=1e-4, abs=1e-9)
    count = BEARING.n_elements * BEARING.rows
    assert period.damaged.shape[1] + period.plain.shape[1] == count
    assert math.log2(period.damaged[2].sum() + period.plain[2].sum() + 1.0) == count


@given(st.floats(-7.0, 7.0), st.floats(0.01, 1.0), st.floats(-7.0, 7.0))
def test_distance_from_an_arc(start: float, length: float, angle: float) -> None:
    nearest = min(
        abs(math.remainder(point - angle, 2.0 * math.pi)) for point in np.linspace(start, start + length, 401)
    )
    assert arc_distance(start, length, angle) == pytest.approx(nearest, abs=length / 400.0)


def test_anderson_is_the_least_squares_of_numpy() -> None:
    rng = np.random.default_rng(0)
    for count in range(1, DEPTH + 2):
        xs, fs, ours = rng.standard_normal((count, 12)), rng.standard_normal((count, 12)), np.empty(12)
        anderson(xs, fs, count, ours)
        expected = xs[-1] + fs[-1]
        if count > 1:
            dx, df = np.diff(xs, axis=0).T, np.diff(fs, axis=0).T
            expected = expected - (dx + df) @ np.linalg.lstsq(df, fs[-1], rcond=None)[0]
        assert ours == pytest.approx(expected, abs=1e-11)


def test_anderson_leaves_out_what_depends_on_later_differences() -> None:
    rng = np.random.default_rng(1)
    xs, fs, ours, shorter = rng.standard_normal((4, 12)), rng.standard_normal((4, 12)), np.empty(12), np.empty(12)
    # The oldest difference is a multiple of the next.
    fs[0] = fs[1] - 3.0 * (fs[2] - fs[1])
    anderson(xs, fs, 4, ours)
    anderson(xs[1:].copy(), fs[1:].copy(), 3, shorter)
    assert ours == pytest.approx(shorter, abs=1e-12)


@pytest.mark.parametrize("seed", range(effort_count(quick=8, full=60)))
def test_the_compiled_search_is_the_interpreted_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    floor = Floor("rough" if seed % 2 else "smooth", seed=seed)
    defect = Defect(rng.uniform(0.01, 0.9), rng.uniform(1e-6, 32e-6), floor)
    scene = Scene(rng.uniform(15.0, 50.0), rng.uniform(300.0, 5000.0), defect=defect, clearance=5e-6 * (seed % 3))
    period, steer = prepare(scene, accuracy=1e-3), steering(replace(scene, defect=None))
    plain = Interpreted(**vars(period))
    fast, slow = (find_orbit(p, tolerance=1e-7, max_periods=300, steering=steer) for p in (period, plain))
    assert fast.status == slow.status == "converged"
    assert abs(fast.periods - slow.periods) <= 1
    assert fast.state.ravel() / SCALE == pytest.approx(slow.state.ravel() / SCALE, rel=1e-5, abs=1e-4)
    assert period.weight @ fast.waves[0] ** 2 == pytest.approx(period.weight @ slow.waves[0] ** 2, rel=1e-5)


@pytest.mark.parametrize("floor", [Floor(), Floor("rough", seed=2)])
@pytest.mark.parametrize("band", [None, (300.0, 9500.0)])
def test_a_row_is_its_scenes(floor: Floor, band: tuple[float, float] | None) -> None:
    extents = np.radians([0.0, 0.5, 3.0, 20.0, 50.0])
    scene = replace(SCENE, defect=Defect(0.1, 12e-6, floor))
    steps = steps_for(scene, 1e-3)
    row = simulate_row(scene, extents, steps_per_period=steps, band=band)
    assert np.all(row.settled)
    for i, extent in enumerate(extents):
        defect = Defect(float(extent), 12e-6, floor)
        alone = simulate(replace(scene, defect=defect), steps_per_period=steps, band=band)
        assert row.rms[i] == pytest.approx(alone.rms, rel=1e-9)
        assert row.harmonics[i] == pytest.approx(alone.harmonics, rel=1e-9)
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


@pytest.mark.parametrize("accuracy", sorted(GRADES))
def test_the_error_is_the_one_asked_for(accuracy: float) -> None:
    errors = []
    for seed in range(effort_count(quick=24, full=200)):
        rng = np.random.default_rng(seed)
        defect = Defect(math.radians(rng.uniform(0.8, 50.0 if seed % 2 else 15.0)), rng.uniform(1e-6, 32e-6))
        scene = Scene(rng.uniform(15.0, 50.0), rng.uniform(500.0, 5000.0), defect=defect)
        fine = simulate(scene, steps_per_period=4096, tolerance=1e-7)
        errors.append(simulate(scene, accuracy=accuracy).rms / fine.rms - 1.0)
    assert np.sqrt(np.mean(np.square(errors))) < accuracy


def test_coarser_accuracy_takes_fewer_steps_and_too_fine_a_one_is_refused() -> None:
    steps = [steps_for(SCENE, accuracy) for accuracy in (1.0, 2e-3, 1e-3, 5e-4, 2e-4)]
    assert steps == sorted(steps)
    assert steps[-1] == steps_for(SCENE)
    for accuracy in (1e-5, math.nan):
        with pytest.raises(ValueError, match="accuracy"):
            steps_for(SCENE, accuracy)


@pytest.mark.parametrize("load", [0.0, 0.01, 777.0, 1e5])
def test_the_equilibrium_without_clearance_is_scaled_from_that_of_a_unit(load: float) -> None:
    scene = replace(SCENE, load=load, defect=None)
    parameter = prepare(scene).parameter
    exact = static_equilibrium(element_angles(scene.bearing), load, scene.rig.k_c)
    assert parameter[[P_U_1, P_U_2]] == pytest.approx(exact, rel=1e-11, abs=1e-18)
