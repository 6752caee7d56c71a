"""Balls with inertia: closed forms, balance of forces, symmetry, stability of the steps, order, hard cases."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.machine.bearing import Bearing, kinematics
from models.machine.hertz import in_series
from models.machine.scene import Defect, Scene
from models.published.marin import INNER, bearing_of, scene_of
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ball_inertia.solver import at_rest, longest_stable_step, trace
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import trace as rotor_trace
from models.solve.simulate import simulate

RIG = BallInertiaRig(m_b=0.0035)
NINE = scene_of(9)
OUTER = Defect(0.1, 1e-5)


# Statics and balance.
def test_an_unloaded_ball_is_held_by_its_centrifugal_force_alone() -> None:
    """k_co d^1.5 = m_b r w_c^2 + the part of its weight outwards."""
    scene = replace(NINE, speed=50.0)
    place, cage = at_rest(scene)[4 + 4], 2.0 * math.pi * kinematics(scene.bearing, scene.speed).ftf
    angle = RIG.cage_angle + 2.0 * math.pi * 4 / 9
    outwards = 0.0035 * ((0.023 + place) * cage**2 + 9.81 * math.cos(angle))
    assert RIG.k_co * (place - scene.clearance) ** 1.5 == pytest.approx(outwards, rel=1e-6)


def test_the_ring_is_carried_on_average() -> None:
    """The mean acceleration is zero: the mean force of the balls is load and weight."""
    found = trace(NINE, 0.4, 5e-6)
    kept = found.acceleration[40_000:]
    assert abs(float(np.mean(kept))) * RIG.mass < 1e-4 * NINE.load
    assert float(np.mean(found.ring[40_000:, 0])) == pytest.approx(41.09e-6, rel=1e-3)


def test_a_healthy_bearing_in_balance_is_mirrored() -> None:
    """Balls turned the other way about the load give the mirrored beginning."""
    one, other = (at_rest(replace(NINE, rig=replace(RIG, cage_angle=angle))) for angle in (0.2, -0.2))
    assert one[0] == pytest.approx(other[0], rel=1e-9)
    assert one[1] == pytest.approx(-other[1], rel=1e-6)
    assert one[4:13] == pytest.approx(np.roll(other[4:13][::-1], 1), rel=1e-6)


def test_turning_load_gravity_and_sensor_with_the_balls_changes_nothing() -> None:
    """Gravity across the load is a load aslant."""
    aslant = replace(NINE, load=0.0, gravity=2000.0, gravity_angle=0.5, rig=replace(RIG, cage_angle=0.8))
    straight = replace(aslant, gravity_angle=0.0, rig=replace(RIG, cage_angle=0.3))
    ours, other = trace(aslant, 0.01, 4e-6), trace(straight, 0.01, 4e-6)
    turned = ours.ring @ np.array([math.cos(0.5), math.sin(0.5)])
    assert turned == pytest.approx(other.ring[:, 0], rel=1e-7)


# The rotor of Ceruti with two such bearings, where the balls are light.
def test_light_balls_move_the_ring_as_a_contact_in_series_does() -> None:
    """Contacts in a row: k of both, damping (c_i k_o^2 + c_o k_i^2) / (k_i + k_o)^2, constant as k_i / k_o is.

    The inertia of the balls is what both differ by; the rotor carries twice the load on two bearings.
    """
    k_in, k_out = RIG.k_ci ** (2.0 / 3.0), RIG.k_co ** (2.0 / 3.0)
    damping = (RIG.c_ci * k_out**2 + RIG.c_co * k_in**2) / (k_in + k_out) ** 2
    series = in_series(RIG.k_ci, RIG.k_co, 1.5)
    rotor = RotorRig(
        m=2.0 * RIG.mass, j_p=1e-3, j_t=1.0, length=0.8, a=0.4, k_c=series, c_b=damping, c_n=0.0,
        cage_angle_a=RIG.cage_angle, cage_angle_b=RIG.cage_angle,
    )  # fmt: skip
    plain = Scene(20.0, 3000.0, bearing=bearing_of(9), rig=replace(RIG, m_b=3.5e-4), clearance=1e-5)
    heavy = replace(plain, load=6000.0, rig=rotor)
    ours, other = trace(plain, 0.5, 1.25e-6), rotor_trace(heavy, 0.5, 5e-6)
    one, two = (x - np.mean(x) for x in (ours.ring[160_000::4, 0], other.c.real[40_000:]))
    assert np.sqrt(np.mean((one - two) ** 2)) < 0.02 * np.sqrt(np.mean(two**2))


# Steps.
@pytest.mark.parametrize("balls", [3, 9])
def test_runge_kutta_diverges_at_10_us_and_is_stable_at_6_7(balls: int) -> None:
    scene = scene_of(balls)
    assert 6.7e-6 < longest_stable_step(scene) < 10e-6
    assert trace(scene, 0.2, 6.7e-6).finite
    assert not trace(scene, 0.2, 10e-6).finite


def test_damping_alone_limits_the_step_where_it_is_large() -> None:
    """Runge-Kutta's interval of stability is 2.785 on the real axis; dampers of 3000 N s/m make it 1.6 us."""
    scene = scene_of(9, damping=3000.0)
    rate = 2.0 * 3000.0 / 0.0035
    assert longest_stable_step(scene) == pytest.approx(2.785 / rate, rel=0.1)
    assert trace(scene, 0.02, 0.9 * longest_stable_step(scene)).finite
    stable, garbage = (float(np.std(trace(scene, 0.1, h).acceleration[-2000:])) for h in (1.2e-6, 4e-6))
    assert garbage > 100.0 * stable


def test_steps_are_of_fourth_order_while_contacts_last() -> None:
    """Before a ball enters or leaves the load zone."""
    errors = errors_of(replace(NINE, rig=replace(RIG, cage_angle=0.1)), 1e-3)
    assert np.all(-np.diff(np.log2(errors)) > 3.5)


def test_steps_are_of_second_order_over_the_edges_of_a_defect() -> None:
    """RMS over places of the defect: the error depends on where the force bends to zero within a step."""
    defects = [replace(OUTER, part="inner", position=0.9 + 0.0014 * k) for k in range(12)]
    errors = np.array([errors_of(replace(NINE, load=1000.0, defect=defect), 0.0024) for defect in defects])
    overall = np.sqrt(np.mean(errors**2, axis=0))
    assert overall[0] < 1e-9
    assert math.log2(overall[0] / overall[2]) > 3.0


def errors_of(scene: Scene, duration: float) -> list[float]:
    """Return the largest errors of the ring's place with steps of 4, 2 and 1 us, m."""
    fine = trace(scene, duration, 0.25e-6).ring[::16]
    steps = (4e-6, 2e-6, 1e-6)
    return [float(np.abs(trace(scene, duration, h).ring[:: round(4e-6 / h)] - fine).max()) for h in steps]


# Hard cases.
def hard_cases() -> dict[str, Scene]:
    one: Bearing = bearing_of(3)
    return {
        "no load": replace(NINE, load=0.0, gravity=0.0),
        "weight only, wide": replace(NINE, load=0.0, clearance=2e-4),
        "no damping": replace(NINE, rig=replace(RIG, c_ci=0.0, c_co=0.0)),
        "fast": replace(NINE, speed=500.0),
        "unbalance lifts the ring": replace(NINE, load=10.0, speed=200.0, unbalance=1e-4),
        "a defect all round": replace(NINE, defect=Defect(2.0 * math.pi, 1e-5)),
        "two rows": replace(NINE, bearing=replace(one, rows=2), defect=replace(OUTER, first_row=1)),
        "heavy balls": replace(NINE, rig=replace(RIG, m_b=0.1)),
    }


@pytest.mark.parametrize("name", list(hard_cases()))
def test_hard_cases_stay_finite_and_close(name: str) -> None:
    scene = hard_cases()[name]
    found = trace(scene, 0.1, 0.6 * longest_stable_step(scene))
    assert found.finite
    assert np.abs(found.ring).max() < 5e-4


def test_three_balls_over_a_defect_do_not_repeat_and_say_so() -> None:
    found = simulate(scene_of(3, defect=INNER), duration=0.5, rate=25600.0, accuracy=1e-2)
    assert found.status == "not_periodic"
    assert found.spread > 0.02 * found.rms
    assert found.rms_se > 0.0
    again = simulate(scene_of(3, defect=INNER), duration=0.5, rate=51200.0, accuracy=1e-2)
    assert abs(again.rms - found.rms) < 4.0 * math.hypot(found.rms_se, again.rms_se) + 0.1 * found.rms


@pytest.mark.parametrize(
    ("change", "word"),
    [({"m_rotor": 0.0}, "m_rotor"), ({"m_b": -1.0}, "m_b"), ({"k_ci": 0.0}, "k_ci"), ({"c_co": -1.0}, "c_co"),
     ({"cage_angle": math.inf}, "cage_angle"), ({"defect_shape": "round"}, "defect_shape")],
)  # fmt: skip
def test_senseless_parameters_are_refused_by_name(change: dict[str, Any], word: str) -> None:
    with pytest.raises(ValueError, match=rf"rig\.{word}"):
        BallInertiaRig(**change)


def test_a_bearing_with_a_contact_angle_is_refused() -> None:
    with pytest.raises(ValueError, match="contact angle"):
        replace(NINE, bearing=replace(bearing_of(9), contact_angle=0.3))
    assert BallInertiaRig(**RIG.as_dict()) == RIG
