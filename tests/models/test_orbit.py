from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from models.dynamics.orbit import STATE_SCALE, find_orbit, period_jacobian
from tests.oracles import orbit_oracle


@dataclass
class LinearMap:
    """A period map x -> A x + b in scaled coordinates, whose RMS is the distance from the origin."""

    matrix: NDArray[np.float64]
    offset: NDArray[np.float64]
    weight: NDArray[np.float64] = field(default_factory=lambda: np.full(12, 1.0 / 12.0))
    noise: float = 0.0
    drift: float = 0.0
    blow_up_at: int = -1
    runs: int = 0

    def new_wave(self) -> NDArray[np.float64]:
        return np.empty((12, 2))

    def run(self, state: NDArray[np.float64], wave: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
        self.runs += 1
        scale = np.tile(STATE_SCALE, 2)
        x = state.ravel() / scale
        after = self.matrix @ x + self.offset * (1.0 + self.drift * self.runs)
        if self.noise:
            after = after + self.noise * np.random.default_rng(self.runs).standard_normal(12)
        wave[:] = after[:, None]
        return (after * scale).reshape(2, 6), int(self.runs == self.blow_up_at)

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


def contraction(radius: float, seed: int = 0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.standard_normal((12, 12)))
    return q @ np.diag(radius * rng.uniform(-1.0, 1.0, 12)) @ q.T


@pytest.mark.parametrize("radius", [0.3, 0.7, 0.95, 0.99])
@pytest.mark.parametrize("known", [False, True])
def test_finds_the_fixed_point_of_a_linear_map(radius: float, known: bool) -> None:
    matrix, offset = contraction(radius), np.arange(1.0, 13.0)
    period = LinearMap(matrix, offset)
    steering = np.linalg.inv(np.eye(12) - matrix).astype(np.float64) if known else None
    orbit = find_orbit(period, tolerance=1e-9, max_periods=200, steering=steering)
    exact = np.linalg.solve(np.eye(12) - matrix, offset)
    assert orbit.status == "converged"
    assert orbit.state.ravel() / np.tile(STATE_SCALE, 2) == pytest.approx(exact, rel=1e-5, abs=1e-5)
    assert orbit.periods == period.runs
    assert orbit.spread == 0.0


def test_the_exact_jacobian_needs_hardly_more_than_the_first_periods() -> None:
    matrix = contraction(0.98)
    exact = np.linalg.inv(np.eye(12) - matrix).astype(np.float64)
    orbit = find_orbit(LinearMap(matrix, np.ones(12)), tolerance=1e-9, max_periods=200, steering=exact)
    assert orbit.periods <= 7


def test_silence_is_converged_at_once() -> None:
    orbit = find_orbit(LinearMap(contraction(0.5), np.zeros(12)), tolerance=1e-6, max_periods=50)
    assert (orbit.status, orbit.periods, orbit.period_change) == ("converged", 2, 0.0)


def test_a_motion_that_does_not_repeat_has_a_spread() -> None:
    orbit = find_orbit(LinearMap(contraction(0.5), np.ones(12), noise=0.1), tolerance=1e-6, max_periods=200)
    assert orbit.status == "not_periodic"
    assert orbit.spread > 0.01
    assert orbit.waves.shape == (40, 12, 2)
    assert orbit.periods == 200


def test_a_motion_that_drifts_is_not_converged() -> None:
    drifting = LinearMap(contraction(0.5), np.ones(12), drift=0.1)
    orbit = find_orbit(drifting, tolerance=1e-9, max_periods=150)
    assert orbit.status == "not_converged"


def test_too_few_periods_are_not_converged() -> None:
    orbit = find_orbit(LinearMap(contraction(0.9), np.ones(12)), tolerance=1e-9, max_periods=2)
    assert (orbit.status, orbit.periods) == ("not_converged", 2)


def test_one_blow_up_starts_again() -> None:
    orbit = find_orbit(LinearMap(contraction(0.5), np.ones(12), blow_up_at=4), tolerance=1e-9, max_periods=100)
    assert orbit.status == "converged"


def test_jacobian_by_differences() -> None:
    matrix = contraction(0.9, seed=3)
    found = period_jacobian(LinearMap(matrix, np.ones(12)))
    assert found == pytest.approx(matrix - np.eye(12), abs=1e-9)


@pytest.mark.parametrize(("tolerance", "periods", "word"), [(0.0, 100, "tolerance"), (1e-6, 1, "max_periods")])
def test_impossible_limits_are_refused(tolerance: float, periods: int, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        find_orbit(LinearMap(np.eye(12), np.ones(12)), tolerance=tolerance, max_periods=periods)
