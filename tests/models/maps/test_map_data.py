"""Maps as data: read between their nodes, loads and speeds, and where they fall.

Axes refined until a map is as right between its nodes as was asked.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.machine.scene import Slip
from models.maps.build import _refined, build_map, build_refined_map, refine_plan
from models.maps.check import interpolation_errors
from models.maps.data import MapSlice, OutsideMapError, RmsMap
from models.maps.plan import MapError, MapPlan

PLAN = MapPlan(
    load=(3000.0, 5000.0),
    speed=(40.0,),
    h_d=(0.0, 10e-6, 20e-6),
    dphi_d=(0.0, 0.1, 0.2, 0.35),
    rms_band=(0.0, 9500.0),
)


@cache
def built() -> RmsMap:
    return build_map(PLAN)


def test_falls_count_beyond_the_errors_only() -> None:
    rms = np.array([[1.0, 2.0, 1.9], [1.5, 1.0, 1.0]])[None, None]
    small = replace(
        built(),
        rms=rms,
        rms_error=np.full(rms.shape, 0.02),
        rms_se=np.zeros(rms.shape),
    )
    assert small.falling("dphi_d")[0, 0].tolist() == [[False, True, False], [True, False, False]]
    assert small.falling("h_d")[0, 0].tolist() == [[False, True, True], [False, False, False]]
    doubtful = replace(small, rms_se=np.full(rms.shape, 0.03))
    assert doubtful.falling("dphi_d")[0, 0].tolist() == [[False, False, False], [True, False, False]]
    assert not replace(small, rms_error=rms).falling("h_d").any()


def test_interpolation_meets_the_nodes_and_stays_between() -> None:
    at = built().slice_at(3000.0, 40.0)
    x, y = np.meshgrid(at.dphi_d, at.h_d)
    assert at.interpolate(x, y) == pytest.approx(built().rms[0, 0], rel=1e-12)
    assert at.interpolate_harmonics(x, y) == pytest.approx(built().harmonic_amplitude[0, 0], rel=1e-12)
    assert np.isnan(at.interpolate([0.1, 0.4], [30e-6, 10e-6])).all()
    assert at.inside([0.1, 0.4, 0.35], [10e-6, 10e-6, 20e-6]).tolist() == [True, False, True]


@given(st.floats(0.0, 0.35), st.floats(0.0, 20e-6))
def test_bilinear_interpolation_is_the_obvious_one(dphi_d: float, h_d: float) -> None:
    at = built().slice_at(3000.0, 40.0)
    rows = [np.interp(dphi_d, at.dphi_d, row) for row in at.rms]
    assert float(at.interpolate(dphi_d, h_d)) == pytest.approx(np.interp(h_d, at.h_d, rows), rel=1e-9)


def test_conditions_between_and_beside_the_nodes() -> None:
    m = built()
    assert m.slice_at(4000.0, 40.0).rms == pytest.approx(0.5 * (m.rms[0, 0] + m.rms[1, 0]))
    assert m.slice_at(5040.0, 40.2).rms == pytest.approx(m.rms[1, 0])
    spreads = ("rms_std", "harmonic_std", "rms_rig_std", "harmonic_rig_std")
    rng = np.random.default_rng(1)
    marked = replace(m, **{name: rng.uniform(size=getattr(m, name).shape) for name in spreads})
    at = marked.slice_at(3500.0, 40.0)
    for name in spreads:
        low, high = getattr(marked, name)[:, 0]
        assert getattr(at, name) == pytest.approx(0.75 * low + 0.25 * high)
    for load, speed in ((2900.0, 40.0), (5100.0, 40.0), (4000.0, 41.0), (math.nan, 40.0)):
        with pytest.raises(OutsideMapError, match="the map covers"):
            m.slice_at(load, speed)


def test_a_slice_of_one_node_interpolates_nothing() -> None:
    one = MapSlice(
        load=1.0,
        speed=1.0,
        h_d=np.array([1e-6]),
        dphi_d=np.array([0.1]),
        rms=np.ones((1, 1)),
        rms_error=np.zeros((1, 1)),
        harmonic_amplitude=np.ones((1, 1, 6)),
        rms_band=None,
        rms_std=np.zeros((1, 1)),
        harmonic_std=np.zeros((1, 1, 6)),
        rms_rig_std=np.zeros((1, 1)),
        harmonic_rig_std=np.zeros((1, 1, 6)),
    )
    assert float(one.interpolate(0.1, 1e-6)) == 1.0
    assert math.isnan(float(one.interpolate(0.2, 1e-6)))


MAP_REFINE_PLAN = MapPlan(
    load=(4000.0,),
    speed=(40.0,),
    h_d=(0.0, 8e-6, 16e-6),
    dphi_d=tuple(np.radians([0.0, 2.0, 4.0]).tolist()),
    rms_band=(0.0, 9500.0),
)


def test_a_refined_map_is_as_right_as_was_asked() -> None:
    tolerance = 0.02
    built = build_refined_map(MAP_REFINE_PLAN, tolerance)
    assert built.attributes["interpolation_tolerance"] == tolerance
    assert built.attributes["interpolation_error"] < tolerance
    other = interpolation_errors(built, 100, seed=99)
    assert np.sqrt(np.mean(other**2)) < 1.5 * tolerance
    assert set(MAP_REFINE_PLAN.dphi_d) < set(built.plan.dphi_d)
    assert set(MAP_REFINE_PLAN.h_d) <= set(built.plan.h_d)
    unrefined = refine_plan(MAP_REFINE_PLAN, 10.0)
    assert unrefined == MAP_REFINE_PLAN


def test_the_number_of_nodes_is_bounded() -> None:
    plan = refine_plan(MAP_REFINE_PLAN, 1e-4, most_nodes=60)
    assert 30 < np.prod(plan.shape) <= 60
    with pytest.raises(MapError, match="more than the 8"):
        refine_plan(MAP_REFINE_PLAN, 1e-2, most_nodes=8)
    with pytest.raises(MapError, match="tolerance"):
        refine_plan(MAP_REFINE_PLAN, 0.0)
    built = build_refined_map(MAP_REFINE_PLAN, 1e-4, most_nodes=60)
    assert built.attributes["interpolation_error"] > built.attributes["interpolation_tolerance"]


def test_slip_is_refined_as_if_balls_did_not_slip() -> None:
    slipping = replace(MAP_REFINE_PLAN, slip=Slip(0.01), floors=3)
    refined = refine_plan(slipping, 0.05)
    assert replace(refined, slip=None, floors=1) == refine_plan(MAP_REFINE_PLAN, 0.05)


def test_a_plan_without_damage_is_left_as_it_is() -> None:
    healthy = replace(MAP_REFINE_PLAN, h_d=(0.0,))
    assert refine_plan(healthy, 1e-3) == healthy
    one = replace(MAP_REFINE_PLAN, h_d=(8e-6,))
    assert refine_plan(one, 0.02).h_d == (8e-6,)


def test_refining_is_local_and_stops_at_the_target() -> None:
    """A bend at 0.3 of an otherwise straight line: only the intervals around it are halved."""
    seen: list[float] = []

    def bent(places: np.ndarray) -> np.ndarray:
        seen.extend(places.tolist())
        return (1.0 - np.maximum(places - 0.3, 0.0))[None, None]

    axis = _refined(tuple(np.linspace(0.0, 1.0, 5).tolist()), bent, 1e-4, 1000)
    fine = np.linspace(0.0, 1.0, 20001)
    chord = np.interp(fine, axis, bent(np.array(axis))[0, 0])
    assert math.sqrt(np.mean((chord - bent(fine)[0, 0]) ** 2)) < 2e-4
    assert len(axis) < 16
    assert max(np.diff(axis)) == 0.25
    assert min(np.diff(axis)) < 0.02
    tried = seen[: -len(fine) - len(axis)]
    assert len(set(tried)) == len(tried)


def test_what_is_straight_is_not_refined() -> None:
    axis = (0.0, 0.5, 2.0)
    assert _refined(axis, lambda x: x[None, None], 1e-9, 100) == axis
