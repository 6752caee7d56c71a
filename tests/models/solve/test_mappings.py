"""Mappings between models: what they refuse, the order in which their error falls, and what ``auto`` makes of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.machine.bearing import from_catalogue
from models.machine.rig import Rig, RigParameters
from models.machine.scene import Defect, Scene, Waviness
from models.solve.angular.rig import AngularRig
from models.solve.ball_inertia.solver import at_rest as rest_of_balls
from models.solve.ball_inertia.solver import trace as ball_trace
from models.solve.mappings.ring import casing_of, gain_of, ring_of, rotor_of
from models.solve.mappings.table import MAPPINGS, Bound
from models.solve.registry import Solver
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.rotor.rig import RotorRig
from models.solve.rotor.solver import Rigid
from models.solve.simulate import choose, select, simulate, stand_ins
from models.words.request import Request
from reference.ring_scenes import BALLS, FREE, ROTOR, SHORT, SOLVERS, scene_of

# Refusals.
DEFECT = Defect(0.05, 1e-5)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (scene_of(replace(ROTOR, a=0.3)), "rig.a: the disc must stand in the middle"),
        (scene_of(replace(ROTOR, k_c_b=1e9)), "rig.k_c_b: both bearings must be alike"),
        (scene_of(replace(ROTOR, cage_angle_b=0.5)), "balls of both bearings must stand alike"),
        (scene_of(ROTOR, second_bearing=from_catalogue("6205")), "second_bearing: both bearings must be alike"),
        (scene_of(ROTOR, defect=DEFECT), "defect: what happens at one support tilts the rotor"),
        (scene_of(ROTOR, bow=1e-5), "bow and couple_unbalance"),
        (scene_of(ROTOR, couple_unbalance=1e-5), "bow and couple_unbalance"),
        (scene_of(ROTOR, load=0.0), "load: without one the ring rests on no ball"),
        (scene_of(replace(BALLS, defect_shape="rectangle"), defect=DEFECT), "rig.defect_shape: a rectangle's edges"),
        (scene_of(Rig()), "rig.beta_c: damping that grows with the load"),
        (scene_of(replace(FREE, k_i=75e6)), "rig.k_i: the spring from shaft to ground must be much softer"),
        (scene_of(FREE, defect=DEFECT), "defect: its path"),
        (scene_of(FREE, waviness=(Waviness(1e-6, 7),)), "waviness: no other model describes it"),
        (scene_of(RingImpactRig(), defect=DEFECT), "only the frequencies of its lines are those of other models"),
        (scene_of(AngularRig()), "rig: angular shows the angular speed of a shaft, which turns evenly"),
    ],
)
def test_an_assumption_that_is_not_shared_is_named(scene: Scene, words: str) -> None:
    with pytest.raises(ValueError, match=words.replace(".", r"\.").replace("(", r"\(")):
        ring_of(scene)


@pytest.mark.parametrize("rig", [RingImpactRig(), Rig(), RotorRig()], ids=lambda rig: rig.model)
def test_where_nothing_is_shared_the_reference_answers(rig: RigParameters) -> None:
    """The impacts on rings stand for no other model, and none for them; nor for the usual rigs of the others."""
    scene = scene_of(rig, defect=DEFECT)
    request = Request(accuracy=0.05, **SHORT)
    chosen = select(scene, request)
    assert (chosen.mapped, chosen.error, chosen.solver.rig) == (None, 0.0, type(rig))
    assert stand_ins(scene, request, chosen.solver)[0] == []
    assert simulate(scene, accuracy=0.05, **SHORT).model_error == 0.0


def test_a_sensor_without_counterpart_or_physics_that_is_lacking_is_not_given_up() -> None:
    scene = scene_of(ROTOR)
    assert select(scene, Request(accuracy=0.05, **SHORT)).solver.model == "six_dof"
    for kept in (
        select(replace(scene, physics=("gyroscopic",)), Request(accuracy=0.05, **SHORT)),
        select(scene, Request(accuracy=0.05, steps_per_period=2000, **SHORT)),
        select(replace(scene, model="rotor"), Request(accuracy=0.05, **SHORT)),
        select(scene, Request(accuracy=1e-3, **SHORT)),
    ):
        assert kept.solver.model == "rotor"
    with pytest.raises(ValueError, match=r"sensor 'mo': this model has a, b, c"):
        simulate(scene, accuracy=0.05, sensor="mo", **SHORT)


# Limits.


def ring_difference(scene: Scene) -> float:
    """Return the relative difference of the ring's path on balls with inertia from that of the rotor."""
    one = ball_trace(scene, 0.05, 2.5e-7).ring[::16, 0]
    two = Rigid(rotor_of(scene, ring_of(scene))).trace(0.05, 4e-6).c.real
    count = min(len(one), len(two))
    one, two = (x[count // 2 : count] - np.mean(x[count // 2 : count]) for x in (one, two))
    return float(np.sqrt(np.mean((one - two) ** 2) / np.mean(two**2)))


def test_the_error_falls_as_the_mass_of_the_balls_to_the_two_thirds() -> None:
    """Centrifugal force presses a ball out by (m_b r w^2 / k_o)^(2/3); added mass falls faster."""
    scenes = [
        scene_of(replace(BALLS, m_b=mass, c_ci=20.0, c_co=20.0), speed=60.0, load=300.0) for mass in (2e-3, 2.5e-4)
    ]
    coarse, fine = (ring_difference(scene) for scene in scenes)
    assert fine < coarse
    assert math.log(coarse / fine) / math.log(8.0) > 0.4
    places = [rest_of_balls(scene)[4:] for scene in scenes]
    unloaded = [float(np.max(place)) for place in places]
    assert unloaded[0] > 0.0


def test_the_acceleration_of_ring_and_casing_share_their_masses() -> None:
    scene = scene_of(BALLS)
    ring = ring_of(scene)
    stand_in = casing_of(scene, ring)
    rig = stand_in.rig_as(Rig)
    outer = rig.m_o + rig.m_r
    assert rig.m_i * outer / (rig.m_i + outer) == pytest.approx(ring.mass)
    assert gain_of(stand_in) == pytest.approx(-(rig.m_i + outer) / rig.m_i)
    assert ring_of(stand_in).mass == pytest.approx(ring.mass)
    assert ring_of(stand_in).damping == pytest.approx(ring.damping)


@pytest.mark.parametrize("angle", [0.0, 1.0])
def test_weight_is_a_load_of_the_ring(angle: float) -> None:
    scene = scene_of(BALLS, gravity=300.0, gravity_angle=angle)
    ring = ring_of(scene)
    assert ring.force == pytest.approx(1500.0 + 300.0 * BALLS.mass * np.exp(1j * angle))
    stand_in = casing_of(scene, ring)
    rig = stand_in.rig_as(Rig)
    weight = stand_in.gravity * (rig.m_o + rig.m_r) * np.exp(1j * stand_in.gravity_angle)
    assert stand_in.load + weight == pytest.approx(ring.force)
    if angle:
        with pytest.raises(ValueError, match="gravity_angle: the rotor's weight acts along the load"):
            rotor_of(scene, ring)
    else:
        assert rotor_of(scene, ring).load == pytest.approx(2.0 * abs(ring.force))


# What auto makes of them.


def test_the_reason_names_what_is_left_out_and_what_it_saves() -> None:
    found = simulate(scene_of(ROTOR), accuracy=1e-2, **SHORT)
    assert (found.model, found.status) == ("six_dof", "converged")
    assert 0.0 < found.model_error < found.error <= 1e-2
    assert found.why is not None
    assert found.why.startswith("six_dof (periodic) stands for rotor (rigid); they differ by a soft spring")
    assert "instead of" in found.why


def test_the_status_counts_the_error_of_the_model() -> None:
    scene = scene_of(ROTOR)
    chosen = select(scene, Request(accuracy=1e-2, **SHORT))
    assert chosen.mapped is not None
    assert chosen.request.accuracy == pytest.approx(1e-2 - chosen.error)


def test_the_impacts_on_rings_do_not_feel_the_depth_of_a_defect() -> None:
    """The proof that no parameters make them one model with balls over a defect, whose level grows with it."""
    deep = replace(DEFECT, h_d=10.0 * DEFECT.h_d)
    rings, balls = (
        [simulate(scene_of(rig, defect=defect), accuracy=1e-2, **SHORT).rms for defect in (DEFECT, deep)]
        for rig in (RingImpactRig(), BALLS)
    )
    assert rings[1] == rings[0]
    assert balls[1] > 2.0 * balls[0]


def test_no_bound_is_known_outside_of_its_scenes() -> None:
    scene = scene_of(BALLS, speed=30.0)
    request = Request(accuracy=0.5, quantity="lines", **SHORT)
    assert select(scene, request).mapped is not None
    far = select(replace(scene, speed=400.0), request)
    assert far.mapped is None
    assert any("its error is known from" in reason for _, reason in far.refused)


def test_a_bound_is_a_product_of_powers() -> None:
    assert Bound(0.5, (2.0, -1.0)).of({"one": 3.0, "two": 4.0}) == pytest.approx(0.5 * 9.0 / 4.0)


def test_the_reference_answers_where_a_stand_in_says_that_it_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(ROTOR)
    chosen = select(scene, Request(accuracy=1e-2, **SHORT))
    assert chosen.instead is not None
    missed = replace(chosen, request=replace(chosen.request, accuracy=0.5, steps_per_period=64), error=9e-3)
    monkeypatch.setattr("models.solve.simulate.select", lambda scene, request: missed)
    found = simulate(scene, accuracy=1e-2, **SHORT)
    assert (found.model, found.model_error) == ("rotor", 0.0)


def test_an_estimate_beyond_the_accuracy_is_said() -> None:
    """The mean over so short a time is not known to it."""
    scene = scene_of(BALLS, unbalance=5e-3)
    found = simulate(scene, accuracy=1e-3, duration=0.2, rate=25600.0)
    assert found.status == "inaccurate"
    assert not found.repeats
    assert found.error > 1e-3
    assert found.why is not None
    assert "its own estimate of the error" in found.why


def test_every_mapping_leads_to_a_solver() -> None:
    for mapping in MAPPINGS:
        solver: Solver = SOLVERS[mapping.model, mapping.solver]
        assert mapping.rig is not solver.rig or solver.whole is not None


def test_an_elastic_shaft_with_ends_is_the_reference_of_a_rigid_one() -> None:
    bent = scene_of(replace(ROTOR, end_mass=0.3))
    assert choose(bent, Request())[0].name == "elastic"
    assert choose(scene_of(ROTOR), Request())[0].name == "rigid"
    soft = select(bent, Request(accuracy=0.05, **SHORT))
    assert soft.solver.name == "elastic"
    assert any("its error" in reason for _, reason in soft.refused)
