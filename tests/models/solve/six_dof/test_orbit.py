"""The search for a motion that repeats, its matrices, and what is made of a motion that does not."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.machine.bearing import Bearing
from models.machine.rig import Rig
from models.machine.scene import Defect, Scene
from models.solve.simulate import simulate
from models.solve.six_dof.kernels.orbit import (
    CALM_PERIODS,
    DEPTH,
    PLAIN_FIRST,
    STATE_SCALE,
    anderson,
    newton_steering,
    settle,
    spectral_radius,
)
from models.solve.six_dof.kernels.period import blank_trace, mean_square
from models.solve.six_dof.kernels.settled import fourier_coefficients, largest
from models.solve.six_dof.orbit import PeriodicMotion, simulate_on
from models.solve.six_dof.periodic import steering
from reference.periods import period_of, run, simulate_plainly
from tests.oracles import orbit_oracle
from tests.support.effort import effort_count

SCALE = np.tile(STATE_SCALE, 2)
SCENE = Scene(40.0, 4000.0, defect=Defect(math.radians(20.0), 20e-6))
# Contact is lost and regained, and no two passages are alike.
RESTLESS = replace(SCENE, load=1.0, clearance=10e-6)


@dataclass
class LinearMap:
    """A period map x -> A x + b in scaled coordinates, whose RMS is the distance from the origin."""

    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]
    blow_up_at: int = -1
    runs: int = 0

    def run(self, state: NDArray[np.float64]) -> tuple[NDArray[np.float64], int, float]:
        self.runs += 1
        after = self.matrix @ (state.ravel() / SCALE) + self.offset
        level = math.sqrt(float(np.mean(after**2)))
        return (after * SCALE).reshape(2, 6), int(self.runs == self.blow_up_at), level


@dataclass(frozen=True)
class Found:
    x: NDArray[np.float64]
    periods: int
    change: float
    settled: bool


def search(period: LinearMap, *, tolerance: float, cap: int, steer: NDArray[np.float64] | None = None) -> Found:
    """Search from rest with the interpreted form of the kernel."""
    state, periods, change, _, settled = orbit_oracle.settle(
        *(period, np.zeros((2, 6)), SCALE),
        *(np.eye(12) if steer is None else steer, PLAIN_FIRST, tolerance, cap),
    )
    return Found(state.ravel() / SCALE, periods, change, settled)


def contraction(radius: float, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.standard_normal((12, 12)))
    return q @ np.diag(radius * rng.uniform(-1.0, 1.0, 12)) @ q.T


@pytest.mark.parametrize("radius", [0.3, 0.7, 0.95, 0.99])
@pytest.mark.parametrize("known", [False, True])
def test_finds_the_fixed_point_of_a_linear_map(radius: float, known: bool) -> None:
    matrix, offset = contraction(radius), np.arange(1.0, 13.0)
    period = LinearMap(matrix, offset)
    found = search(period, tolerance=1e-9, cap=200, steer=newton_steering(matrix) if known else None)
    assert found.settled
    assert found.x == pytest.approx(np.linalg.solve(np.eye(12) - matrix, offset), rel=1e-5, abs=1e-5)
    assert found.periods == period.runs


def test_the_exact_jacobian_needs_hardly_more_than_the_first_periods() -> None:
    matrix = contraction(0.98)
    assert search(LinearMap(matrix, np.ones(12)), tolerance=1e-9, cap=200, steer=newton_steering(matrix)).periods <= 7


def test_a_fixed_point_that_repels_is_found_too() -> None:
    """Why the multipliers must be asked for: the search does not tell attraction from repulsion."""
    matrix = contraction(0.9)
    matrix += 1.5 * np.outer(np.ones(12), np.ones(12)) / 12.0
    assert spectral_radius(matrix) > 1.2
    found = search(LinearMap(matrix, np.ones(12)), tolerance=1e-9, cap=60, steer=newton_steering(matrix))
    assert found.settled
    assert found.x == pytest.approx(np.linalg.solve(np.eye(12) - matrix, np.ones(12)), rel=1e-5)


def test_silence_is_settled_at_once() -> None:
    found = search(LinearMap(contraction(0.5), np.zeros(12)), tolerance=1e-6, cap=50)
    assert (found.settled, found.periods, found.change) == (True, 2, 0.0)


def test_too_few_periods_are_not_settled() -> None:
    found = search(LinearMap(contraction(0.9), np.ones(12)), tolerance=1e-9, cap=2)
    assert (found.settled, found.periods) == (False, 2)


def test_one_blow_up_starts_again() -> None:
    assert search(LinearMap(contraction(0.5), np.ones(12), blow_up_at=4), tolerance=1e-9, cap=100).settled


def test_the_kernel_starts_again_at_rest_where_the_state_is_no_number() -> None:
    period = period_of(SCENE)
    trace, state, steer = blank_trace(period), np.empty((2, 6)), steering(replace(SCENE, defect=None))
    assert steer is not None
    how = (PLAIN_FIRST, CALM_PERIODS, 1e-7, 60, math.inf)
    number, _, rms, settled, _ = settle(np.zeros((2, 6)), state, trace, period, steer, *how)
    again = settle(np.full((2, 6), math.nan), state, trace, period, steer, *how)
    assert settled
    assert again[3]
    # The first period was lost, and one of those that follow each other plainly with it.
    assert again[0] - 1 == pytest.approx(number, abs=2)
    assert again[2] == pytest.approx(rms, rel=1e-5)


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


@given(st.integers(0, 10_000), st.floats(1e-3, 3.0), st.booleans())
def test_spectral_radius_is_that_of_numpy(seed: int, size: float, normal: bool) -> None:
    rng = np.random.default_rng(seed)
    matrix = contraction(size, seed) if normal else size * rng.standard_normal((12, 12)) / math.sqrt(12.0)
    exact = float(np.abs(np.linalg.eigvals(matrix)).max())
    # Gelfand's formula is off by the logarithm of the condition of the eigenvectors over 2**17.
    assert spectral_radius(matrix) == pytest.approx(exact, rel=2e-4)


def test_spectral_radius_of_the_ends() -> None:
    assert spectral_radius(np.zeros((12, 12))) == 0.0
    nilpotent = np.diag(np.ones(11), 1)
    assert spectral_radius(nilpotent) == 0.0
    assert spectral_radius(1e-200 * np.eye(12)) == pytest.approx(1e-200, rel=1e-4)
    assert not math.isfinite(spectral_radius(np.full((12, 12), math.nan)))
    # A pair of complex multipliers, which a plain power iteration does not settle on.
    turn = 0.97 * np.array([[math.cos(1.0), -math.sin(1.0)], [math.sin(1.0), math.cos(1.0)]])
    matrix = np.zeros((12, 12))
    matrix[:2, :2] = turn
    assert spectral_radius(matrix) == pytest.approx(0.97, rel=1e-4)


@given(st.integers(0, 10_000), st.floats(0.0, 5.0))
def test_newton_steering_is_the_inverse_of_numpy(seed: int, size: float) -> None:
    matrix = size * np.random.default_rng(seed).standard_normal((12, 12))
    left = np.eye(12) - matrix
    exact = np.linalg.inv(left)
    assert newton_steering(matrix) == pytest.approx(exact, abs=1e-13 * np.linalg.cond(left) * np.abs(exact).max())


def test_newton_steering_needs_pivots_and_refuses_the_singular() -> None:
    matrix = np.eye(12)
    matrix[[0, 1]] = matrix[[1, 0]]
    matrix = np.eye(12) - matrix
    assert newton_steering(matrix) == pytest.approx(np.linalg.inv(np.eye(12) - matrix))
    assert np.array_equal(newton_steering(np.eye(12)), np.eye(12))


def motion_of(levels: NDArray[np.float64]) -> PeriodicMotion:
    none = np.full(2, math.nan)
    return PeriodicMotion(
        np.zeros((2, 6)), len(levels), math.nan, False, none, none, np.zeros((2, 1), complex), levels, levels
    )


@pytest.mark.parametrize("seed", range(effort_count(quick=5, full=200)))
def test_a_level_that_only_scatters_is_stationary_and_one_that_drifts_is_not(seed: int) -> None:
    noise = 1.0 + 0.1 * np.random.default_rng(seed).standard_normal(200)
    steady, drifting = motion_of(noise), motion_of(noise * np.linspace(1.0, 2.0, 200))
    assert steady.spread == pytest.approx(0.1, rel=0.3)
    # Half the relative standard error of the mean square, from ten parts: it scatters itself by a quarter.
    assert steady.standard_error == pytest.approx(0.1 / math.sqrt(200.0), rel=0.9)
    assert not drifting.stationary
    for step in (30, 60, 100, 140, 170):
        stepping = noise.copy()
        stepping[step:] *= 2.0
        assert not motion_of(stepping).stationary, step
    assert not motion_of(noise[:12]).stationary


def test_few_levels_that_only_scatter_are_taken_for_a_drift() -> None:
    noise = 1.0 + 0.1 * np.random.default_rng(0).standard_normal((1000, 200))
    # Two comparisons of Student's t with four degrees of freedom beyond four errors: 1.6 % each.
    assert np.mean([motion_of(levels).stationary for levels in noise]) > 0.96


@pytest.mark.parametrize("cycle", range(2, 9))
def test_a_cycle_of_a_few_periods_is_stationary(cycle: int) -> None:
    """Its parts are alike to the last digit, and the ends of spans are not."""
    levels = np.tile(1.0 + 0.3 * np.random.default_rng(cycle).standard_normal(cycle), 200)[:210]
    assert motion_of(levels).stationary


def test_simulating_on_comes_to_rest_on_a_motion_that_repeats() -> None:
    period = period_of(SCENE)
    motion = simulate_on(period, np.zeros((2, 6)), 300, 1e-7, 6)
    assert motion.settled
    assert motion.periods < 100
    after = run(period, motion.state, blank_trace(period))
    assert after / STATE_SCALE == pytest.approx(motion.state / STATE_SCALE, abs=1e-3)


def test_simulating_on_gives_the_means_over_the_periods_that_are_kept() -> None:
    period, count, kept = period_of(RESTLESS, 128), 120, 84
    motion = simulate_on(period, np.zeros((2, 6)), count, 0.0, 8)
    state, trace = np.zeros((2, 6)), blank_trace(period)
    levels, power, peak, lines = [], np.zeros(2), np.zeros(2), np.zeros((2, 9))
    for n in range(count):
        state = run(period, state, trace)
        if n >= count - kept:
            levels.append(math.sqrt(mean_square(trace, 0)))
            power += np.array([mean_square(trace, 0), mean_square(trace, 1)]) / kept
            peak = np.maximum(peak, [largest(trace, period.first, np.int64(k)) for k in (0, 1)])
            lines += np.abs(fourier_coefficients(trace, period, 8)) ** 2 / kept
    assert not motion.settled
    assert (motion.periods, len(motion.levels)) == (count, kept)
    assert motion.levels == pytest.approx(np.array(levels), rel=1e-9)
    assert motion.power == pytest.approx(power, rel=1e-9)
    assert motion.peak == pytest.approx(peak, rel=1e-9)
    assert np.abs(motion.coefficients) == pytest.approx(np.sqrt(lines), rel=1e-9)
    assert motion.spread == pytest.approx(np.std(levels))
    assert motion.power[0] == pytest.approx(simulate_plainly(period, count, count - kept).mean ** 2)


def test_simulating_on_stops_where_the_motion_leaves_the_finite_numbers() -> None:
    motion = simulate_on(period_of(SCENE), np.full((2, 6), math.nan), 100, 0.0, 6)
    assert motion.periods == 1
    assert not motion.settled
    assert not motion.stationary
    assert np.all(np.isnan(motion.power))
    assert math.isnan(motion.spread)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"max_periods": 1}, "max_periods"),
        ({"accuracy": 0.0}, "accuracy"),
        ({"accuracy": math.nan}, "accuracy"),
        ({"steps_per_period": 4}, "steps_per_period"),
        ({"direction": math.inf}, "direction"),
    ],
)
def test_impossible_limits_are_refused(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        simulate(SCENE, **change)


ROLLERS_OVER_A_PIT = Scene(
    16.98469,
    11289.8,
    Bearing(
        *("", 10, 2.0 * 0.003224139826723579, 2.0 * 0.012896559306894316, 0.12658009246597612, 1, "roller"),
        outer_race_radius=0.012896559306894316 + 0.003224139826723579,
        inner_race_radius=0.012896559306894316 - 0.003224139826723579,
    ),
    Rig(
        m_i=0.86449,
        m_o=0.176468,
        m_r=5.99823,
        m_b=0.00147,
        k_i=4714314.5,
        k_r=2747628756.3,
        k_c=30647839.644,
        c_i=2490.056,
        c_r=1103.902,
        alpha_c=154.9,
        beta_c=8.65264e-05,
        element="roller",
    ),
    Defect(math.radians(0.97496), 15.9526e-6),
    clearance=1.489657e-6,
)


@pytest.mark.parametrize(
    ("share", "shift", "rms"),
    [
        (1.0, 0.0, 10.289425874777717),
        (0.9, 0.0, 10.217807890915715),
        (1.1, 0.0, 10.354496111758023),
        (1.0, 1e-3, 10.289422685217458),
        (1.0, -1e-3, 10.289417638448873),
    ],
)
def test_a_stiff_mode_is_settled_too(share: float, shift: float, rms: float) -> None:
    """Share of the load, shift of the pit, rad, and RMS of the oracle of periodic motions (relative error 1e-9).

    What an extrapolated state leaves in a stiff mode changed the RMS by 6e-3, on all grids, each of which began there.
    """
    assert ROLLERS_OVER_A_PIT.defect is not None
    defect = replace(ROLLERS_OVER_A_PIT.defect, position=shift)
    scene = replace(ROLLERS_OVER_A_PIT, load=share * ROLLERS_OVER_A_PIT.load, defect=defect)
    for accuracy in (1e-3, 1e-4):
        found = simulate(scene, accuracy=accuracy)
        assert found.status == "converged"
        assert found.rms == pytest.approx(rms, rel=found.rms_error)
