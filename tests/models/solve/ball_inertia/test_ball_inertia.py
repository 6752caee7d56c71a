"""Balls with inertia: closed forms, balance of forces, symmetry, stability of the steps, order, hard cases.

The kernel of the balls with inertia against an oracle that shares no code with it, and its order of convergence.

One ball period of balls with inertia: against the run over time, what does not repeat, stated errors.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from models.machine.bearing import Bearing, from_catalogue, kinematics
from models.machine.hertz import in_series
from models.machine.scene import Defect, Part, Scene
from models.published.marin import INNER, bearing_of, scene_of
from models.solve.ball_inertia import period as ball_period
from models.solve.ball_inertia import solver as ball_inertia
from models.solve.ball_inertia.rig import BallInertiaRig
from models.solve.ball_inertia.solver import at_rest, longest_stable_step, trace
from models.solve.response import Response
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid
from models.solve.simulate import choose, simulate
from models.words.request import Request
from tests.oracles import ball_inertia_oracle
from tests.oracles.ball_inertia_oracle import R_0, Case, Spot
from tests.support.effort import effort_count

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
    ours, other = trace(plain, 0.5, 1.25e-6), Rigid(heavy).trace(0.5, 5e-6)
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
    assert found.status in ("not_periodic", "inaccurate")
    assert not found.repeats
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


BEARING = replace(from_catalogue("6206"), element_diameter=9.5e-3)
CASES = {
    "three balls, gravity aslant": Case(balls=3, load=3000.0, speed=20.0, gap=1e-5, gravity=9.81, down=0.7),
    "inner race": Case(spots=(Spot("inner", 0.9, 0.055, 2e-5),), gap=1e-5, load=3000.0, cage=1.0),
    "both races": Case(spots=(Spot("outer", 0.2, 0.1, 1e-5), Spot("inner", 0.1, 0.1, 5e-6)), damping=(100.0, 400.0)),
    "half sines": Case(spots=(Spot("outer", 0.2, 0.1, 1e-5), Spot("inner", 0.1, 0.1, 5e-6)), half_sine=True),
    "unbalance": Case(unbalance=3e-3, speed=60.0, gap=2e-5, load=100.0, gravity=9.81),
    "seven balls, fast": Case(balls=7, speed=150.0, load=300.0, gap=5e-6),
}
QUICK = ("three balls, gravity aslant", "both races", "unbalance")


def scene_of_case(case: Case) -> Scene:
    """Return the product's scene of a case."""
    defects = tuple(Defect(s.extent, s.depth, position=s.middle, part=cast("Part", s.race)) for s in case.spots)
    rig = BallInertiaRig(
        m_b=0.0035,
        k_ci=ball_inertia_oracle.C_IN,
        k_co=ball_inertia_oracle.C_OUT,
        c_ci=case.damping[0],
        c_co=case.damping[1],
        cage_angle=case.cage,
        defect_shape="half_sine" if case.half_sine else "rectangle",
    )
    return Scene(
        case.speed,
        case.load,
        bearing=replace(BEARING, n_elements=case.balls),
        rig=rig,
        defect=defects[0] if defects else None,
        more_defects=defects[1:],
        clearance=case.gap,
        gravity=case.gravity,
        gravity_angle=case.down,
        unbalance=case.unbalance,
    )


@pytest.mark.parametrize("name", list(CASES) if effort_count(quick=1, full=2) == 2 else QUICK)
def test_accelerations_are_those_of_the_oracle(name: str) -> None:
    case, step = CASES[name], 1e-6
    # Balls of the case with spots have passed an edge of each after 1.7 ms.
    duration = 1e-3 * effort_count(quick=2 if case.spots else 1, full=4)
    scene = scene_of_case(case)
    found = trace(scene, duration, step)
    chosen = np.arange(0, len(found.acceleration), 11)
    state = at_rest(scene)
    state[4 : 4 + case.balls] += R_0
    expected = ball_inertia_oracle.simulate(case, state, step * chosen.astype(np.float64))[:, 0]
    level = float(np.sqrt(np.mean(expected**2)))
    # At the instant of a jump one of both may stand before it: the middle of the errors, and nearly all of them.
    error = np.abs(found.acceleration[chosen] - expected) / level
    assert level > 0.01
    assert np.quantile(error, 0.99) < 2e-4
    assert np.median(error) < 1e-5


BALL_PERIOD_RIG = BallInertiaRig(m_b=0.0035, c_ci=500.0, c_co=500.0, defect_shape="half_sine")
HEALTHY = Scene(30.0, 1500.0, bearing=bearing_of(9), rig=BALL_PERIOD_RIG, clearance=3e-6)
REQUEST = Request(accuracy=2e-3, duration=0.25, rate=25600.0)
SCENES = {
    "healthy": HEALTHY,
    "outer race": replace(HEALTHY, defect=Defect(0.08, 1e-5)),
    "two rows, one damaged": replace(
        HEALTHY, bearing=replace(bearing_of(9), rows=2), defect=Defect(0.08, 1e-5, first_row=1), load=4000.0
    ),
}


def over_time(scene: Scene) -> Response:
    """Return the settled run over time with a quarter of the steps."""
    steps = 4.0 / (0.7 * ball_inertia.longest_stable_step(scene) * kinematics(scene.bearing, scene.speed).bpfo)
    return ball_inertia.solve(scene, replace(REQUEST, steps_per_period=round(steps)))


@pytest.mark.parametrize("name", list(SCENES))
def test_it_is_the_motion_that_a_run_over_time_settles_to(name: str) -> None:
    found, truth = ball_period.solve(SCENES[name], REQUEST), over_time(SCENES[name])
    assert (found.solver, found.status, found.record) == ("periodic", "converged", None)
    assert abs(found.rms / truth.rms - 1.0) <= found.rms_error <= REQUEST.accuracy
    assert found.peak == pytest.approx(truth.peak, rel=0.03)
    largest = float(np.max(truth.harmonics))
    assert np.abs(found.harmonics - truth.harmonics) == pytest.approx(0.0, abs=3e-3 * largest)


def test_auto_takes_it_where_the_motion_repeats() -> None:
    assert choose(HEALTHY, REQUEST)[0].solve is ball_period.solve
    assert choose(replace(HEALTHY, unbalance=1e-4), REQUEST)[0].solve is ball_inertia.solve


def test_a_motion_that_does_not_come_to_repeat_is_followed_over_time() -> None:
    """Without damping nothing settles."""
    scene = replace(HEALTHY, rig=replace(BALL_PERIOD_RIG, c_ci=0.0, c_co=0.0))
    found = ball_period.solve(scene, replace(REQUEST, duration=0.05))
    assert found.solver == "time"
    assert found.status != "converged"


def test_what_turns_with_the_shaft_is_refused() -> None:
    with pytest.raises(ValueError, match=r"unbalance: ball_inertia does not describe this for one ball period"):
        ball_period.solve(replace(HEALTHY, unbalance=1e-4), REQUEST)


def test_steps_that_are_too_coarse_for_the_accuracy_are_said() -> None:
    steps = round(2.5 / (ball_inertia.longest_stable_step(HEALTHY) * kinematics(HEALTHY.bearing, 30.0).bpfo))
    found = ball_period.solve(HEALTHY, replace(REQUEST, accuracy=1e-6, steps_per_period=steps))
    assert found.status == "inaccurate"
    assert found.error > 1e-6


def test_a_band_holds_the_lines_within() -> None:
    whole = ball_period.solve(HEALTHY, REQUEST)
    found = ball_period.solve(HEALTHY, replace(REQUEST, band=(500.0, 4000.0)))
    assert found.rms == pytest.approx(whole.rms_in_band(500.0, 4000.0), rel=2e-3)
    assert found.rms < whole.rms
