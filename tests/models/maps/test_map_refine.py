"""Axes refined until a map is as right between its nodes as was asked."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.scene import Slip
from models.maps.build import _refined, build_refined_map, refine_plan
from models.maps.check import interpolation_errors
from models.maps.plan import MapError, MapPlan

PLAN = MapPlan(
    load=(4000.0,),
    speed=(40.0,),
    h_d=(0.0, 8e-6, 16e-6),
    dphi_d=tuple(np.radians([0.0, 2.0, 4.0]).tolist()),
    rms_band=(0.0, 9500.0),
)


def test_a_refined_map_is_as_right_as_was_asked() -> None:
    tolerance = 0.02
    built = build_refined_map(PLAN, tolerance)
    assert built.attributes["interpolation_tolerance"] == tolerance
    assert built.attributes["interpolation_error"] < tolerance
    other = interpolation_errors(built, 100, seed=99)
    assert np.sqrt(np.mean(other**2)) < 1.5 * tolerance
    assert set(PLAN.dphi_d) < set(built.plan.dphi_d)
    assert set(PLAN.h_d) <= set(built.plan.h_d)
    unrefined = refine_plan(PLAN, 10.0)
    assert unrefined == PLAN


def test_the_number_of_nodes_is_bounded() -> None:
    plan = refine_plan(PLAN, 1e-4, most_nodes=60)
    assert 30 < np.prod(plan.shape) <= 60
    with pytest.raises(MapError, match="more than the 8"):
        refine_plan(PLAN, 1e-2, most_nodes=8)
    with pytest.raises(MapError, match="tolerance"):
        refine_plan(PLAN, 0.0)
    built = build_refined_map(PLAN, 1e-4, most_nodes=60)
    assert built.attributes["interpolation_error"] > built.attributes["interpolation_tolerance"]


def test_slip_is_refined_as_if_balls_did_not_slip() -> None:
    slipping = replace(PLAN, slip=Slip(0.01), floors=3)
    refined = refine_plan(slipping, 0.05)
    assert replace(refined, slip=None, floors=1) == refine_plan(PLAN, 0.05)


def test_a_plan_without_damage_is_left_as_it_is() -> None:
    healthy = replace(PLAN, h_d=(0.0,))
    assert refine_plan(healthy, 1e-3) == healthy
    one = replace(PLAN, h_d=(8e-6,))
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
