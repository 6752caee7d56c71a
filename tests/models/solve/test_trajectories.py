"""Trajectories: what a linear rotor would do, the free way in the bearings, and steps that are fine enough."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import from_catalogue
from models.machine.scene import Scene
from models.published.marin import scene_of
from models.solve.engine.motion import MOST_TURNS, Trajectories, settled
from models.solve.registry import trajectories
from models.solve.rotor.rig import RotorRig
from models.solve.simulate import simulate
from models.words.request import Request

SHORT = Request(duration=0.5)
ROTOR = Scene(1000.0 / 60.0, 100.0, bearing=from_catalogue("6305"), rig=RotorRig(), clearance=11e-6, model="rotor")
ELASTIC = replace(ROTOR, clearance=0.0, unbalance=5e-4, physics=("elastic_shaft",))


def moved(scene: Scene, request: Request = SHORT) -> Trajectories:
    response = simulate(scene, duration=0.3)
    found = trajectories(scene, request, response)
    assert found is not None
    return found


def test_the_disc_of_an_unbalanced_elastic_rotor_turns_as_on_its_springs() -> None:
    """m eps Omega^2 / (2 k - m Omega^2); the bearings, seven times as stiff as the shaft, add a few percent."""
    found, rig = moved(ELASTIC), RotorRig()
    drive = rig.m * (2.0 * math.pi * ELASTIC.speed) ** 2
    expected = 1e-4 * drive / (sum(rig.shaft_stiffness) - drive)
    along, across = found.travel()[found.points.index("c")]
    assert 0.5 * along == pytest.approx(expected, rel=0.1)
    assert 0.5 * across == pytest.approx(expected, rel=0.1)
    assert 0.5 * along > expected
    # The disc sags by the load on both springs beneath the ends.
    a, _, c = found.place.mean(axis=2)
    assert c[0] - a[0] == pytest.approx(100.0 / sum(rig.shaft_stiffness), rel=5e-3)


def test_the_ends_of_a_rotor_lie_beyond_the_clearance_by_what_the_load_presses() -> None:
    found = moved(ROTOR)
    assert found.points == ("a", "b", "c")
    assert found.clearance[:2] == (11e-6, 11e-6)
    assert math.isnan(found.clearance[2])
    away = np.hypot(found.place[:2, 0], found.place[:2, 1])
    assert np.all(away > 11e-6 - 1e-6)
    assert np.all(away < 11e-6 + 6e-6)
    assert found.error < 0.02


def test_a_ring_on_balls_with_inertia_moves_too() -> None:
    found = moved(scene_of(9))
    assert found.points == ("a",)
    assert found.place[0, 0].mean() == pytest.approx(41.09e-6, rel=1e-3)


def test_a_casing_has_no_trajectory() -> None:
    scene = Scene(40.0, 1000.0)
    assert trajectories(scene, SHORT, simulate(scene)) is None


def test_turns_are_limited() -> None:
    def line(duration: float, step: float) -> np.ndarray:
        return np.ones((1, 2, round(duration / step)))

    request, free = Request(duration=50.0), (math.nan,)
    found = settled(line, ROTOR, request, step=1e-4, settle=0.1, points=("c",), clearance=free)
    assert found is not None
    assert found.place.shape[2] * found.step * ROTOR.speed == pytest.approx(MOST_TURNS, rel=1e-3)
    assert found.error == 0.0


def test_a_motion_that_diverges_has_no_trajectory() -> None:
    def diverged(duration: float, step: float) -> None:
        assert duration > step

    found = settled(diverged, ROTOR, SHORT, step=1e-4, settle=0.1, points=("c",), clearance=(math.nan,))
    assert found is None
