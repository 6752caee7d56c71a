"""Laws of growth and the paths drawn by them: where they begin and end, that they never fall, and crossings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.lives.laws import LAWS, PATH_STEP, GrowthPath, draw_law, grow

THRESHOLD = 0.05e-6
GROWING = tuple(law for law in LAWS if law != "standstill")


@given(st.sampled_from(GROWING), st.integers(0, 10**6), st.floats(2.0, 100.0))
def test_a_law_rises_from_nought_to_one_and_on(law: str, seed: int, ratio: float) -> None:
    curve = draw_law(law, np.random.default_rng(seed), ratio)
    w = curve(np.linspace(0.0, 2.0, 801))
    assert w[0] == pytest.approx(0.0, abs=1e-12)
    assert w[400] == pytest.approx(1.0, rel=1e-9)
    assert np.all(np.diff(w) >= 0.0)
    assert w[800] > 1.0


@given(st.integers(0, 10**6))
def test_a_standstill_grows_to_a_level_below_the_threshold_and_then_no_more(seed: int) -> None:
    w = draw_law("standstill", np.random.default_rng(seed), 20.0)(np.linspace(0.0, 2.0, 801))
    assert w[0] == 0.0
    assert 0.0 < w[400] <= 0.9
    assert np.all(w[400:] == w[400])


def test_an_unknown_law_is_named() -> None:
    with pytest.raises(ValueError, match="cubic"):
        draw_law("cubic", np.random.default_rng(0), 20.0)


def path_of(law: str, seed: int, roughness: float, until: float = THRESHOLD) -> GrowthPath:
    rng = np.random.default_rng(seed)
    curve = draw_law(law, rng, 20.0)
    return grow(curve, rng, duration=18000.0, v_0=0.0025e-6, threshold=THRESHOLD, until=until, roughness=roughness)


@given(st.sampled_from(LAWS), st.integers(0, 10**6), st.floats(0.05, 1.5))
def test_a_path_never_falls_and_its_crossing_is_the_first(law: str, seed: int, roughness: float) -> None:
    path = path_of(law, seed, roughness)
    assert np.all(np.diff(path.v_eq) >= 0.0)
    assert path.v_eq[0] == 0.0025e-6
    for threshold in (0.01e-6, 0.03e-6, THRESHOLD):
        t = path.crossing(threshold)
        first = next((i for i, v in enumerate(path.v_eq.tolist()) if v >= threshold), None)
        if first is None:
            assert t == math.inf
        else:
            assert path.t[first] - PATH_STEP <= t <= path.t[first]
            assert float(path.at(np.array(t))) == pytest.approx(threshold, rel=1e-9)


@pytest.mark.parametrize("law", GROWING)
def test_a_smooth_path_is_the_law_and_a_rough_one_is_so_on_average(law: str) -> None:
    smooth = path_of(law, 5, 0.0)
    assert smooth.crossing(THRESHOLD) == pytest.approx(18000.0, rel=1e-3)
    rng = np.random.default_rng(5)
    curve = draw_law(law, rng, 20.0)
    rough = np.array(
        [
            grow(curve, rng, duration=18000.0, v_0=0.0025e-6, threshold=THRESHOLD, until=THRESHOLD, roughness=0.5).v_eq
            for _ in range(200)
        ]
    )
    half = len(smooth.t) // 4
    assert rough[:, half].mean() == pytest.approx(smooth.v_eq[half], rel=0.03)


def test_a_path_tells_of_thresholds_behind_and_beyond_it() -> None:
    path = path_of("quadratic", 1, 0.5)
    assert path.crossing(0.001e-6) == 0.0
    assert path.crossing(1.0) == math.inf
