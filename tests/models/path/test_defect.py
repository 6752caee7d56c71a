from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import from_catalogue
from models.machine.scene import Defect, Floor
from models.path.defect import BallPath, ball_path, edge_path, floor_angle, profile_cutoff, race_profile
from tests.oracles import six_dof_oracle as oracle

BEARING = from_catalogue("1205 ETN9")
R_O, R_B = 22.91e-3, 3.56e-3

extents = st.floats(0.001, 2.0)
depths = st.one_of(st.floats(1e-9, 1e-3), st.just(math.inf))
floors = st.one_of(st.just(Floor()), st.builds(Floor, st.just("rough"), st.floats(1e-8, 3e-6), seed=st.integers(0, 5)))


def path_of(dphi_d: float, h_d: float, floor: Floor | None = None, position: float = 0.0) -> BallPath:
    path = ball_path(BEARING, Defect(dphi_d, h_d, floor or Floor(), position))
    assert path is not None
    return path


@given(extents, st.floats(1e-7, 5e-4), st.floats(-1.5, 1.5))
def test_smooth_path_is_that_of_the_oracle(dphi_d: float, h_d: float, angle: float) -> None:
    depth, _ = path_of(dphi_d, h_d)(np.array([angle]))
    assert depth[0] == pytest.approx(oracle.path(oracle.Case(40.0, 1.0, dphi_d, h_d), angle), abs=1e-13)


@given(extents, depths, floors, st.floats(-3.0, 3.0))
def test_slope_is_the_derivative_between_kinks(dphi_d: float, h_d: float, floor: Floor, position: float) -> None:
    path = path_of(dphi_d, h_d, floor, position)
    marks = np.concatenate(([position - 1.2 * dphi_d], path.kinks(), [position + 1.2 * dphi_d]))
    middles = 0.5 * (marks[1:] + marks[:-1])
    step = np.minimum(1e-6, 0.25 * np.diff(marks))
    keep = step > 1e-9
    middles, step = middles[keep], step[keep]
    _, slope = path(middles)
    difference = (path(middles + step)[0] - path(middles - step)[0]) / (2.0 * step)
    assert difference == pytest.approx(slope, rel=1e-3, abs=1e-6)


@given(extents, depths, floors)
def test_path_is_continuous_shallow_and_ends_at_the_edges(dphi_d: float, h_d: float, floor: Floor) -> None:
    path = path_of(dphi_d, h_d, floor)
    angle = np.linspace(-0.6 * dphi_d, 0.6 * dphi_d, 4001)
    depth, slope = path(angle)
    assert np.all(np.isfinite(slope))
    assert np.all(depth >= -1e-20)
    assert np.all(depth[np.abs(angle) >= 0.5 * dphi_d] == 0.0)
    reach = float(edge_path(np.array(0.5 * dphi_d), R_O, R_B)[0])
    assert depth.max() <= path.cos_alpha * reach * (1.0 + 1e-12)
    kinks = path.kinks()
    assert path(kinks - 1e-10)[0] == pytest.approx(path(kinks + 1e-10)[0], abs=2e-12 + 1e-4 * float(np.ptp(depth)))


@given(st.floats(1e-12, 3e-3))
def test_closed_form_of_the_floor(h_d: float) -> None:
    delta = floor_angle(h_d, R_O, R_B)
    if delta is None:
        assert h_d > float(edge_path(np.array(10.0), R_O, R_B)[0]) * (1.0 - 1e-4)
    else:
        assert float(edge_path(np.array(delta), R_O, R_B)[0]) == pytest.approx(h_d, rel=1e-6)


@given(st.floats(0.01, 1.0), st.floats(1e-6, 3e-5), st.integers(0, 20))
def test_kinks_of_a_rough_floor_lie_on_the_crossing(dphi_d: float, h_d: float, seed: int) -> None:
    path = path_of(dphi_d, h_d, Floor("rough", seed=seed))
    for kink in path.kinks():
        if 1e-9 < abs(kink) < path.half_width - 1e-9:
            left, right = path(np.array([kink - 1e-9]))[1][0], path(np.array([kink + 1e-9]))[1][0]
            assert left != right
            on_floor = path._floor(np.array([kink]))[0][0] * path.cos_alpha
            assert path(np.array([kink]))[0][0] == pytest.approx(on_floor, abs=1e-15)


@given(st.floats(0.01, 1.0), st.floats(1e-6, 3e-5), st.integers(0, 20))
def test_the_rough_path_is_smooth_between_its_kinks(dphi_d: float, h_d: float, seed: int) -> None:
    path = path_of(dphi_d, h_d, Floor("rough", seed=seed))
    kinks = path.kinks()
    angle = np.linspace(-0.5 * dphi_d, 0.5 * dphi_d, 20001)
    jump = np.abs(np.diff(path(angle)[1]))
    spacing = angle[1] - angle[0]
    for i in np.flatnonzero(jump > 1e-4 + 0.3 * spacing):
        near = np.min(np.abs(kinks - 0.5 * (angle[i] + angle[i + 1])))
        assert near <= spacing


def test_deeper_than_reach_is_the_localised_defect() -> None:
    angle = np.linspace(-0.03, 0.03, 1001)
    assert path_of(0.04, 5e-4)(angle)[0].tolist() == path_of(0.04, math.inf)(angle)[0].tolist()


@pytest.mark.parametrize("defect", [None, Defect(0.0, 1e-5), Defect(0.3, 0.0), Defect(0.3, 0.0, Floor("rough"))])
def test_no_defect_no_path(defect: Defect | None) -> None:
    assert ball_path(BEARING, defect) is None


@pytest.mark.parametrize(
    ("extent", "h_d", "word"),
    [(-0.1, 1e-5, "dphi_d"), (7.0, 1e-5, "dphi_d"), (0.1, -1e-6, "h_d"), (0.1, math.nan, "h_d")],
)
def test_impossible_defects_are_refused(extent: float, h_d: float, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        Defect(extent, h_d)


def test_profile_has_the_asked_deviation_and_no_mean() -> None:
    profile = race_profile(1e-6, 2e-3, 840.0, 3, R_O)
    angle = np.linspace(0.0, 2.0 * math.pi, 40000, endpoint=False)
    values, _ = profile(angle)
    assert np.std(values) == pytest.approx(1e-6, rel=1e-3)
    assert abs(np.mean(values)) < 1e-9
    assert -values.min() <= profile.lowest
    assert values.max() <= profile.highest


def test_profile_is_periodic_and_smooth() -> None:
    profile = race_profile(1e-6, 2e-3, 840.0, 3, R_O)
    angle = np.linspace(-1.0, 7.0, 333)
    assert profile(angle)[0] == pytest.approx(profile(angle + 2.0 * math.pi)[0], abs=1e-18)
    for part in profile(np.array([-1e-9, 1e-9, 2.0 * math.pi - 1e-9])):
        assert np.ptp(part) < 1e-3 * np.max(np.abs(part)) + 1e-12


def test_profile_does_not_know_its_pitch() -> None:
    """The spectrum, and so the typical slope, belongs to the cut-off: halving the pitch leaves it alone."""
    angle = np.linspace(0.0, 2.0 * math.pi, 20000)
    slopes = [
        np.mean([np.std(race_profile(1e-6, pitch, 840.0, seed, R_O)(angle)[1]) for seed in range(12)])
        for pitch in (2e-3, 1e-3)
    ]
    assert slopes[0] == pytest.approx(slopes[1], rel=0.1)


def test_profile_is_low_passed() -> None:
    profile = race_profile(1e-6, 2e-3, 840.0, 3, R_O)
    n = 8192
    power = np.abs(np.fft.rfft(profile(np.linspace(0.0, 2.0 * math.pi, n, endpoint=False))[0])) ** 2
    wavenumber = np.arange(len(power)) / (2.0 * math.pi * R_O)
    assert power[wavenumber > 2.0 * 840.0].sum() < 1e-3 * power.sum()


def test_a_growing_defect_uncovers_the_same_floor() -> None:
    angle = np.linspace(-0.1, 0.1, 101)
    small, large = (path_of(x, 2e-5, Floor("rough", seed=4))(angle)[0] for x in (0.3, 0.6))
    assert small == pytest.approx(large, abs=1e-18)


@given(st.floats(1e-9, 4e-6), st.integers(0, 5))
def test_roughness_never_rises_above_the_race(h_d: float, seed: int) -> None:
    path = path_of(1.0, h_d, Floor("rough", 1e-6, seed=seed))
    assert path(np.linspace(-0.5, 0.5, 5001))[0].min() >= -1e-18


def test_cutoff_is_that_of_eq_87() -> None:
    assert profile_cutoff(Floor("rough"), R_B) == pytest.approx(1.0 / (math.pi * math.sqrt(4e-5 * R_B)))
    assert profile_cutoff(Floor("rough", cutoff=500.0), R_B) == 500.0


@pytest.mark.parametrize(("sd", "pitch", "cutoff"), [(-1.0, 1e-3, 1.0), (1.0, 0.0, 1.0), (1.0, 1e-3, 0.0)])
def test_impossible_profiles_are_refused(sd: float, pitch: float, cutoff: float) -> None:
    with pytest.raises(ValueError, match="rough floor"):
        race_profile(sd, pitch, cutoff, 0, R_O)


def test_a_pitch_too_coarse_is_refused() -> None:
    with pytest.raises(ValueError, match="too coarse"):
        race_profile(1e-6, 0.1, 840.0, 0, R_O)
