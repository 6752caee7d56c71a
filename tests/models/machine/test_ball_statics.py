"""Statics of a ball bearing ball by ball: every ball in equilibrium, oracle, closed forms, limits, symmetry."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.machine.ball_statics import COORDINATES, BallStatics, RingState, equilibrium, ring_state
from models.machine.bearing import Bearing, from_catalogue
from models.machine.kernel_ball_statics import COLUMNS, N_I, N_O, SETTLED, U_R, U_Z, settle_balls
from tests.oracles import ball_statics_oracle as oracle
from tests.support.effort import effort_count

BALL, PITCH = 12.7e-3, 80e-3
SEED = 2026
GEOMETRY = oracle.Geometry(10, BALL / 2, PITCH / 2, 0.515 * BALL, 0.515 * BALL, 30e-6)


def statics(balls: int = 10, groove: float = 0.515, clearance: float | None = 30e-6, **others: Any) -> BallStatics:
    bearing = Bearing(
        "T", balls, BALL, PITCH, inner_groove_radius=groove * BALL, outer_groove_radius=groove * BALL, **others
    )
    return BallStatics(bearing, clearance, modulus=200e9)


def along(x: float, z: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([x, 0.0, z, 0.0, 0.0])


@pytest.mark.parametrize(("groove", "clearance"), [(0.51, 35e-6), (0.515, 0.0), (0.505, 30e-6), (0.54, 60e-6)])
def test_every_ball_finds_its_equilibrium(groove: float, clearance: float) -> None:
    """Random displacements within 100 um and 1 mrad, speeds to 20,000 rpm, a fifth of them without centrifugal force.

    The sum of the forces is computed anew from the balls' places.
    """
    count = effort_count(quick=2000, full=100_000)
    bearing, rng = statics(11, groove, clearance), np.random.default_rng(SEED)
    races = bearing.races()
    q = rng.uniform(-1.0, 1.0, (count, 5)) * [1e-4, 1e-4, 1e-4, 1e-3, 1e-3]
    speed = rng.uniform(0.0, 20000.0 / 60.0, count) * (np.arange(count) % 5 > 0)
    c_f = np.array([bearing.centrifugal_force(float(value)) for value in speed])
    angles = rng.uniform(0.0, 2.0 * math.pi, (count, 1)) + bearing.angles()
    balls, load, tangent = np.empty((count, 11, COLUMNS)), np.empty(5), np.empty((5, 5))
    worst = max(settle_balls(q[k], angles[k], float(c_f[k]), races, balls[k], load, tangent)[1] for k in range(count))
    assert worst < 1e-6
    arm = races.inner_radius
    p_z = q[:, 2:3] + arm * (np.sin(angles) * q[:, 3:4] - np.cos(angles) * q[:, 4:5])
    p_r = races.offset + np.cos(angles) * q[:, 0:1] + np.sin(angles) * q[:, 1:2]
    sums = np.zeros((2, count, 11)) + c_f[:, None] * np.array([0.0, 1.0])[:, None, None]
    contacts = (
        (p_z - balls[..., U_Z], p_r - balls[..., U_R], races.inner_gap, races.k_i, N_I),
        (-balls[..., U_Z], -balls[..., U_R], races.outer_gap, races.k_o, N_O),
    )
    free = (c_f[:, None] <= SETTLED) & (balls[..., N_I] == 0.0)
    for z, r, gap, k, column in contacts:
        length = np.hypot(z, r)
        force = k * np.maximum(length - gap, 0.0) ** 1.5
        # The place of a ball that nothing presses is any.
        force[free] = 0.0
        np.testing.assert_allclose(force, balls[..., column], rtol=1e-6, atol=1e-6)
        sums += force * np.stack((z, r)) / length
    assert float(np.hypot(*sums).max()) < 1e-6
    loaded = balls[..., N_I] > 0.0
    assert 0.2 < float(loaded.mean()) < 0.95
    assert bool(loaded[c_f == 0.0].any())


@pytest.mark.parametrize("scale", [1e-9, 1e-7, 1e-5, 1e-4])
def test_balls_settle_far_outside_the_usual(scale: float) -> None:
    """Tilts to some mrad, centrifugal forces of any order. The grooves' centres, 0.38 mm apart, must not coincide."""
    bearing, rng = statics(), np.random.default_rng(SEED)
    for _ in range(200):
        q = rng.normal(size=5) * scale * np.array([1.0, 1.0, 1.0, 10.0, 10.0])
        force = float(10.0 ** rng.uniform(-12.0, 6.0))
        state = ring_state(bearing, q, centrifugal=force)
        assert state.residual < 1e-6
        assert np.all(np.isfinite(state.load))


@pytest.mark.parametrize(
    ("radial", "axial", "force"), [(300.0, 200.0, 23.3), (300.0, 200.0, 258.9), (300.0, 1000.0, 0.0)]
)
def test_the_oracle_carries_the_load_there(radial: float, axial: float, force: float) -> None:
    """The equilibrium is unique, so that it is that of the oracle where the oracle's balls carry the load."""
    bearing = statics()
    stiffness = GEOMETRY.stiffness()
    races = bearing.races()
    assert (races.k_i, races.k_o) == pytest.approx(stiffness, rel=1e-9)
    state = equilibrium(bearing, along(radial, axial), centrifugal=force)
    loads = oracle.carried(GEOMETRY, state.displacement, 0.0, force)
    assert loads[[0, 1, 2]] == pytest.approx([radial, 0.0, axial], abs=1e-5)
    for j, phi in enumerate(state.angles):
        found = oracle.ball(GEOMETRY, stiffness, state.displacement, float(phi), force)
        assert (state.inner_force[j], state.outer_force[j]) == pytest.approx(found[:2], abs=1e-5)
        if found[0] > 1.0:
            assert (state.inner_angle[j], state.outer_angle[j]) == pytest.approx(found[2:], abs=1e-8)


def test_the_oracle_finds_the_same_when_tilted() -> None:
    q = np.array([5e-6, -12e-6, 90e-6, 4e-4, -7e-4])
    state = ring_state(statics(), q, cage_angle=0.1, centrifugal=100.0)
    assert state.load == pytest.approx(oracle.carried(GEOMETRY, q, 0.1, 100.0), abs=1e-4)


def test_without_centrifugal_force_a_ball_is_two_springs_in_series() -> None:
    bearing = statics()
    races, z = bearing.races(), 120e-6
    state = ring_state(bearing, along(0.0, z), centrifugal=0.0)
    between = math.hypot(z, races.offset)
    k = (races.k_i ** (-2.0 / 3.0) + races.k_o ** (-2.0 / 3.0)) ** -1.5
    force = k * (between - races.inner_gap - races.outer_gap) ** 1.5
    assert state.inner_force == pytest.approx(np.full(10, force), rel=1e-9)
    assert state.outer_force == pytest.approx(state.inner_force, rel=1e-9)
    assert state.inner_angle == pytest.approx(np.full(10, math.atan2(z, races.offset)), rel=1e-9)
    assert state.outer_angle == pytest.approx(state.inner_angle, rel=1e-9)
    assert state.load == pytest.approx([0.0, 0.0, 10.0 * force * z / between, 0.0, 0.0], abs=1e-6)


def test_forces_on_each_ball_sum_to_the_centrifugal_force() -> None:
    state = equilibrium(statics(), along(300.0, 200.0), 20000.0 / 60.0)
    radial = state.outer_force * np.cos(state.outer_angle) - state.inner_force * np.cos(state.inner_angle)
    axial = state.outer_force * np.sin(state.outer_angle) - state.inner_force * np.sin(state.inner_angle)
    assert radial == pytest.approx(np.full(10, state.centrifugal), abs=1e-6)
    assert axial == pytest.approx(np.zeros(10), abs=1e-6)
    loaded = state.inner_force > 0.0
    assert np.all(state.inner_angle[loaded] > state.outer_angle[loaded])


def test_the_play_is_the_whole_way_from_contact_to_contact() -> None:
    """Under the first ball, the ring is free within half the diametral clearance to either side (even number)."""
    bearing = statics()
    for side in (-1.0, 1.0):
        assert not ring_state(bearing, along(side * 0.4999 * 30e-6, 0.0)).load.any()
        assert side * ring_state(bearing, along(side * 0.5001 * 30e-6, 0.0)).load[0] > 0.0


def test_a_nominal_contact_angle_is_that_of_the_free_bearing() -> None:
    angle = math.radians(25.0)
    bearing = statics(clearance=None, contact_angle=angle)
    assert bearing.free_angle == pytest.approx(angle)
    light = equilibrium(bearing, along(0.0, 1e-2))
    assert light.inner_angle == pytest.approx(np.full(10, angle), rel=1e-3)
    assert statics(clearance=None).play == 0.0


def test_the_tangent_is_the_derivative_of_the_load() -> None:
    bearing, rng = statics(), np.random.default_rng(SEED)
    for _ in range(20):
        q = rng.uniform(-1.0, 1.0, 5) * [5e-5, 5e-5, 2e-4, 1e-3, 1e-3]
        state = ring_state(bearing, q, centrifugal=100.0)
        numeric = np.empty((5, 5))
        for m, h in enumerate((1e-10, 1e-10, 1e-10, 2e-9, 2e-9)):
            step = np.eye(5)[m] * h
            ends = [ring_state(bearing, q + side * step, centrifugal=100.0).load for side in (1.0, -1.0)]
            numeric[:, m] = (ends[0] - ends[1]) / (2.0 * h)
        scale = np.abs(state.tangent).max(initial=1.0)
        assert state.tangent == pytest.approx(numeric, abs=1e-3 * scale)
        assert state.tangent == pytest.approx(state.tangent.T, abs=1e-9 * scale)
        assert float(np.linalg.eigvalsh(state.tangent)[0]) > -1e-9 * scale


def test_the_load_is_the_slope_of_the_energy() -> None:
    bearing, q = statics(), np.array([2e-6, -3e-6, 1.1e-4, 3e-4, -2e-4])
    state = ring_state(bearing, q, centrifugal=50.0)
    for m, h in enumerate((1e-9, 1e-9, 1e-9, 2e-8, 2e-8)):
        step = np.eye(5)[m] * h
        ends = [ring_state(bearing, q + side * step, centrifugal=50.0).energy for side in (1.0, -1.0)]
        assert (ends[0] - ends[1]) / (2.0 * h) == pytest.approx(state.load[m], rel=1e-4, abs=1e-3)


def test_all_begins_lead_to_the_same_state() -> None:
    bearing, rng = statics(), np.random.default_rng(SEED)
    load = np.array([300.0, 50.0, 200.0, 1.0, -2.0])
    first = equilibrium(bearing, load, 200.0, held={})
    for _ in range(effort_count(quick=10, full=200)):
        begin = rng.uniform(-1.0, 1.0, 5) * [3e-4, 3e-4, 3e-4, 3e-3, 3e-3]
        other = equilibrium(bearing, load, 200.0, held={}, begin=begin)
        assert other.load == pytest.approx(load, abs=1e-6)
        assert other.displacement == pytest.approx(first.displacement, abs=1e-11)


def test_random_loads_find_their_equilibrium() -> None:
    rng = np.random.default_rng(SEED)
    for k in range(effort_count(quick=60, full=3000)):
        bearing = statics(int(rng.integers(5, 16)), float(rng.uniform(0.505, 0.54)), float(rng.uniform(0.0, 1e-4)))
        load = rng.normal(size=5) * 10.0 ** rng.uniform(0.0, 4.0) * np.array([1.0, 1.0, 1.0, 0.005, 0.005])
        held = {} if k % 2 else {"tilt_x": 0.0, "tilt_y": 1e-4}
        # Without a force along the shaft the tilt of loose rings has no resistance.
        state = equilibrium(bearing, load, float(rng.uniform(0.0, 333.0)), cage_angle=float(rng.uniform()), held=held)
        free = [name not in held for name in COORDINATES]
        assert state.load[free] == pytest.approx(load[free], abs=2e-4)
        assert state.residual < 1e-6


def test_mirrored_loads_mirror_the_state() -> None:
    bearing = statics()
    up, down = (equilibrium(bearing, along(300.0, side * 200.0), 100.0) for side in (1.0, -1.0))
    assert down.displacement == pytest.approx(along(up.displacement[0], -up.displacement[2]), abs=1e-13)
    assert down.inner_angle == pytest.approx(-up.inner_angle, abs=1e-9)
    assert up.inner_force[1:] == pytest.approx(up.inner_force[:0:-1], abs=1e-6)
    turned = equilibrium(bearing, np.array([0.0, 300.0, 200.0, 0.0, 0.0]), 100.0, cage_angle=0.5 * math.pi)
    assert turned.inner_force == pytest.approx(up.inner_force, abs=1e-5)


def test_the_cage_follows_the_mean_contact_angle() -> None:
    """Without axial load the angles are zero and the passages those of the catalogue, at any speed."""
    bearing = statics(11)
    for speed in (100.0, 333.0):
        state = equilibrium(bearing, along(300.0, 0.0), speed)
        assert state.bpfo == pytest.approx(5.5 * (1.0 - BALL / PITCH), rel=1e-12)
        assert state.centrifugal == pytest.approx(bearing.centrifugal_force(speed), rel=1e-12)
    loaded = equilibrium(bearing, along(300.0, 500.0), 100.0)
    assert loaded.bpfo > 5.5 * (1.0 - BALL / PITCH)
    assert loaded.centrifugal == pytest.approx(bearing.centrifugal_force(100.0, loaded.mean_angle), rel=1e-9)
    assert ring_state(bearing, np.zeros(5), 100.0).mean_angle == 0.0


def test_rolling_resistance_in_closed_form() -> None:
    """Purely axial, all balls alike: C_r N_i arm of each; with the shaft speeding up, Eqs. 12 and 14."""
    bearing = statics()
    state = equilibrium(bearing, along(0.0, 1000.0), centrifugal=0.0)
    n, beta = float(state.inner_force[0]), float(state.inner_angle[0])
    arms = PITCH / 2 - BALL / 2 * math.cos(beta), PITCH / 2 + BALL / 2 * math.cos(beta)
    inner, outer = state.resistance_torque()
    assert inner == pytest.approx(-10.0 * 0.0015 * n * arms[0])
    assert outer == pytest.approx(10.0 * 0.0015 * n * arms[1])
    ratio = BALL / PITCH * math.cos(beta)
    mass, gamma = bearing.ball_mass, 1e4
    cage, spin = 0.5 * (1.0 - ratio) * gamma, -PITCH / (2.0 * BALL) * (1.0 - ratio**2) * gamma
    moved = BALL / 2 * mass * PITCH / 2 * cage
    turned = 0.4 * mass * (BALL / 2) ** 2 * spin
    faster = state.resistance_torque(gamma)
    assert faster[0] - inner == pytest.approx(-10.0 * (moved + turned) / BALL * arms[0])
    assert faster[1] - outer == pytest.approx(10.0 * (moved - turned) / BALL * arms[1])


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"clearance": -1e-6}, "clearance"),
        ({"modulus": 0.0}, "modulus"),
        ({"poisson": 0.7}, "poisson"),
        ({"bearing": from_catalogue("NU 202 ECP")}, "one row of balls"),
        ({"bearing": replace(statics().bearing, rotating_ring="outer")}, "inner ring that turns"),
        ({"bearing": replace(statics().bearing, outer_groove_radius=6e-3)}, "outer_groove_radius"),
        ({"bearing": replace(statics().bearing, inner_groove_radius=None)}, "inner_groove_radius"),
    ],
)
def test_unusable_parameters_are_refused(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        replace(statics(), **change)


def refused(**change: Any) -> RingState:
    given: dict[str, Any] = {"load": along(300.0, 200.0), "speed": 100.0, **change}
    return equilibrium(statics(), given.pop("load"), **given)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"load": np.zeros(3)}, "load"),
        ({"load": along(math.nan, 0.0)}, "load"),
        ({"speed": -1.0}, "speed"),
        ({"centrifugal": -1.0}, "centrifugal"),
        ({"held": {"w": 0.0}}, "held"),
        ({"begin": along(math.inf, 0.0)}, "displacement"),
    ],
)
def test_unusable_questions_are_refused(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        refused(**change)
