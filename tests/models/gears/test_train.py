"""Trains of gears: kinematics, linear motion, integration with loss of contact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.gears.train.bearings import RollingSupport, with_bearings
from models.gears.train.linear import matrices, mean_state, mesh_mass, natural_frequencies, with_rayleigh
from models.gears.train.motion import simulate_train
from models.gears.train.parts import Body, Support, Torsion, alike
from models.machine.bearing import from_catalogue
from models.machine.hertz import mean_bearing_stiffness
from tests.support.gear_train import RADIUS, chain, pair


def test_speeds_orders_and_torques_follow_from_the_teeth() -> None:
    train = chain()
    assert train.speeds() == pytest.approx({"motor": 25.0, "in": 25.0, "middle": 10.0, "out": 10.0 / 3.0})
    assert train.mesh_frequencies() == pytest.approx({"w20-w50": 500.0, "w25-w75": 250.0})
    assert train.mesh_orders("middle") == pytest.approx({"w20-w50": 50.0, "w25-w75": 25.0})
    assert train.hunting_tooth_frequencies() == pytest.approx({"w20-w50": 5.0, "w25-w75": 10.0 / 3.0})
    assert train.drive_torque() == pytest.approx(300.0 / 7.5)
    force = mean_state(train).mesh_force
    assert force == pytest.approx([40.0 / 0.03, 100.0 / 0.04])


def test_the_drive_also_accelerates_the_inertias() -> None:
    train = replace(chain(), acceleration=2.0)
    inertia = 0.05 + 2e-3 + 2e-2 / 2.5**2 + 9e-2 / 7.5**2
    assert train.drive_torque() == pytest.approx(40.0 + 4.0 * math.pi * inertia)
    assert sum(train.torques()[name] * ratio for name, ratio in train.ratios().items()) == pytest.approx(0.0, abs=1e-12)


def test_what_does_not_fit_together_is_named() -> None:
    train = pair()
    with pytest.raises(ValueError, match="no body 'x'"):
        replace(train, drive="x")
    with pytest.raises(ValueError, match="base radii"):
        replace(train, wheels=(train.wheels[0], replace(train.wheels[1], base_radius=0.08)))
    with pytest.raises(ValueError, match="body third is not joined to the drive"):
        replace(train, bodies=(*train.bodies, Body("third", inertia=1.0, translates=False)))
    with pytest.raises(ValueError, match="body first: is the drive"):
        replace(train, bodies=(replace(train.bodies[0], torque=1.0), train.bodies[1]))
    with pytest.raises(ValueError, match="supports hold it in no or one direction"):
        Body("loose", 1.0, 1.0)
    with pytest.raises(ValueError, match="whole pitches"):
        replace(train, meshes=(replace(train.meshes[0], driver_start=0.01),))
    with pytest.raises(ValueError, match="would turn"):
        replace(train, torsions=(Torsion("first", "second", 1.0),))


def test_mean_state_refuses_torques_that_press_the_other_flanks() -> None:
    with pytest.raises(ValueError, match="swap driver and driven"):
        mean_state(pair(load=-100.0))


def test_natural_frequencies_of_a_pair_on_rigid_supports_are_those_of_one_mass() -> None:
    train = pair()
    held = tuple(replace(body, translates=False, supports=()) for body in train.bodies)
    train = replace(train, bodies=held)
    modes = natural_frequencies(train)
    expected = math.sqrt(5e8 / mesh_mass(train, train.meshes[0])) / (2.0 * math.pi)
    assert modes.frequencies == pytest.approx([0.0, expected], abs=1e-9 * expected)
    assert modes.damping_ratios[1] == pytest.approx(0.05)


def test_rayleigh_dampers_are_those_of_each_element() -> None:
    train = with_rayleigh(chain(), 1.0, {"in": 1e-4, "w20-w50": 5e-4}, default=2e-4)
    assert train.bodies[1].supports[0].damping == alike(3.0 + 1e-4 * 3e8)
    mesh = train.meshes[0]
    assert mesh.damping == pytest.approx(mesh_mass(train, mesh) + 5e-4 * 4e8)
    assert train.torsions[0].damping == pytest.approx(0.05 * 2e-3 / 0.052 + 2e-4 * 1e4)
    with pytest.raises(ValueError, match="'x' is none of"):
        with_rayleigh(chain(), 1.0, {"x": 1.0})


def test_without_excitation_the_train_stays_where_it_rests() -> None:
    train = pair(share=0.0)
    motion = simulate_train(train, duration=0.01, settle=0.0)
    rest = mean_state(train)
    np.testing.assert_allclose(motion.displacement[-1], rest.displacement, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(motion.mesh_force[-1], rest.mesh_force, rtol=1e-9)
    np.testing.assert_allclose(motion.bearing_forces()["b"][-1], rest.support_force["b"], rtol=1e-9)


def test_torques_and_energies_balance_where_flanks_part() -> None:
    motion = simulate_train(pair(90.0), duration=0.1, rate=20000.0, settle=0.1)
    assert motion.finite
    assert motion.out_of_contact[0] > 0.3
    assert motion.touches[0] > 300
    assert motion.energy_residual() < 1e-5
    # 100 N m on the base radius of 41 teeth.
    assert motion.mesh_force.mean() == pytest.approx(100.0 / (RADIUS * 41 / 37), rel=0.02)
    parted = motion.mesh_displacement[:, 0] < 0.0
    assert (motion.mesh_force[parted, 0] == 0.0).all()


def test_speed_and_axial_force_follow_from_the_motion() -> None:
    train = pair(60.0)
    mesh = replace(train.meshes[0], base_helix=0.2)
    steady = replace(train.bodies[0], rotates=False)
    motion = simulate_train(
        replace(train, bodies=(steady, train.bodies[1]), meshes=(mesh,)), duration=0.01, rate=2e5, settle=0.0
    )
    np.testing.assert_allclose(motion.axial_force, math.tan(0.2) * motion.mesh_force)
    assert (motion.speed("first") == 0.0).all()
    turned = 2.0 * math.pi * np.concatenate([[0.0], np.cumsum(motion.speed("second")[:-1])]) / motion.rate
    angle = motion.of("second.angle")
    np.testing.assert_allclose(turned, angle - angle[0], rtol=0.0, atol=0.1 * np.ptp(angle))
    with pytest.raises(ValueError, match="no body 'third'"):
        motion.speed("third")


def test_shares_of_time_count_what_is_returned() -> None:
    """Flanks that an error has parted for good are apart for the whole time, whatever is dropped before."""
    train = pair(60.0, load=0.0, share=0.0)
    mesh = train.meshes[0]
    error = np.full(37 * mesh.stiffness.samples, 1e-6)
    parted = replace(train, meshes=(replace(mesh, stiffness=replace(mesh.stiffness, driver_error=error)),))
    for settle in (0.0, 0.01):
        motion = simulate_train(parted, duration=1e-3, rate=1e4, settle=settle)
        assert motion.out_of_contact[0] == pytest.approx(1.0)


def test_a_run_goes_on_where_another_ended() -> None:
    train = pair(90.0)
    whole = simulate_train(train, duration=0.02, rate=10000.0, settle=0.0)
    first = simulate_train(train, duration=0.01, rate=10000.0, settle=0.0)
    second = simulate_train(train, duration=0.0101, rate=10000.0, start=first.end)
    np.testing.assert_allclose(second.displacement[:100], whole.displacement[99:199], rtol=1e-6, atol=1e-13)


def test_motion_is_that_of_the_linear_matrices_while_flanks_touch() -> None:
    """A load that is given to the train at rest at another load: modal sum against the kernel."""
    train = pair(share=0.0, backlash=0.0)
    parts, modes = matrices(train), natural_frequencies(train)
    loaded = replace(train, bodies=(train.bodies[0], replace(train.bodies[1], torque=-150.0)))
    step = mean_state(train).displacement - mean_state(loaded).displacement
    start = simulate_train(train, duration=1e-4, settle=0.0).end
    motion = simulate_train(loaded, duration=2e-3, rate=50000.0, step=5e-6, start=start)
    k, c = parts.with_meshes(np.array([5e8]), np.array([train.meshes[0].damping]))
    system = np.block(
        [
            [np.zeros_like(k), np.eye(len(k))],
            [-k / parts.mass[:, None], -c / parts.mass[:, None]],
        ]
    )
    values, vectors = np.linalg.eig(system)
    time = np.arange(len(motion.displacement)) / motion.rate
    weights = np.linalg.solve(vectors, np.concatenate([step, np.zeros(len(k))]))
    expected = ((vectors * weights) @ np.exp(np.outer(values, time))).real.T[:, : len(k)]
    found = motion.displacement - mean_state(loaded).displacement
    # The rotation as a whole, which nothing resists, is left out of both.
    turned = modes.shapes[:, modes.frequencies > 0.0]
    kept = turned @ (turned.T * parts.mass)
    np.testing.assert_allclose(found @ kept.T, expected @ kept.T, rtol=0.0, atol=3e-8 * np.abs(expected).max())


def test_a_support_has_the_stiffness_of_its_bearing_at_the_mean_force() -> None:
    train, bearing = pair(), from_catalogue("6206")
    found = with_bearings(train, [RollingSupport("a", bearing, 8e9, 5e-6)])
    force = mean_state(train).support_force["a"]
    load, angle = float(np.hypot(*force)), math.atan2(force[1], force[0])
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    expected = turn @ mean_bearing_stiffness(bearing, load, 8e9, clearance=5e-6) @ turn.T
    stiffness = np.array(found.body("first").supports[0].stiffness)
    np.testing.assert_allclose(stiffness, expected, rtol=0.01, atol=0.005 * expected[0, 0])
    assert found.body("second") == train.body("second")
    assert mean_state(found).mesh_force == pytest.approx(mean_state(train).mesh_force)


def test_two_bearings_and_a_spring_share_the_force_of_their_body() -> None:
    train, bearing = pair(), from_catalogue("6206")
    body = train.bodies[0]
    held = replace(body, supports=(*body.supports, Support("c", alike(1.0)), Support("d", alike(1e6))))
    both = [RollingSupport(name, bearing, 8e9) for name in ("a", "c")]
    stiffness = [
        support.stiffness
        for support in with_bearings(replace(train, bodies=(held, train.bodies[1])), both).body("first").supports
    ]
    assert stiffness[0] == stiffness[1]
    assert stiffness[2] == alike(1e6)
    # Half the force on one bearing: less than the stiffness with all of it, more than half.
    alone = with_bearings(train, both[:1]).body("first").supports[0].stiffness
    assert 0.5 < stiffness[0][1][1] / alone[1][1] < 1.0


def test_a_bearing_without_load_is_refused() -> None:
    bearing = RollingSupport("a", from_catalogue("6206"), 8e9)
    with pytest.raises(ValueError, match="no mean force loads"):
        with_bearings(pair(load=0.0), [bearing])
    with pytest.raises(ValueError, match="no support 'x'"):
        with_bearings(pair(), [replace(bearing, support="x")])
    idle = pair(load=0.0)
    pulled = replace(idle, bodies=(replace(idle.bodies[0], force=(0.0, -60.0)), idle.bodies[1]))
    weighted = with_bearings(pulled, [bearing])
    assert weighted.body("first").supports[0].stiffness[1][1] > 1e6
