"""Rolling bearings of a train, element by element: against the rotor on two bearings, and the energies."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.gears.pair.rig import GearPairRig
from models.gears.train.bearings import RollingElements, with_bearings
from models.gears.train.linear import mean_state
from models.gears.train.motion import simulate_train
from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Part, Scene
from models.solve.simulate import simulate
from tests.support.gear_rolling import BEARING, rotor_and_body
from tests.support.gear_train import pair


@pytest.mark.parametrize("part", ["outer", "inner", "ball"])
def test_a_body_on_two_bearings_is_the_rotor(part: Part) -> None:
    """The rotor's kernel is another one: a symmetric rotor moves as one mass on both of its bearings."""
    rotor, body = rotor_and_body(part, 5e-6, 0.02)
    moved = np.abs(rotor - rotor[0]).max()
    assert moved > 1e-6
    np.testing.assert_allclose(body, rotor, rtol=0.0, atol=1e-4 * moved)


def test_mesh_and_bearing_are_felt_at_the_bearing() -> None:
    train = pair(30.0)
    plain = RollingElements("a", BEARING, 8e9, damping=300.0)
    train = with_bearings(train, [plain])
    force = mean_state(train).support_force["a"]
    damaged = replace(plain, defects=(Defect(0.1, 10e-6, position=math.atan2(force[1], force[0])),))
    healthy, found = (
        simulate_train(train, duration=0.2, rate=25600.0, settle=0.05, rolling=[one]) for one in (plain, damaged)
    )
    load = 100.0 / train.wheels[1].base_radius
    for motion in (healthy, found):
        assert np.hypot(*motion.bearing_forces()["a"].mean(axis=0)) == pytest.approx(load, rel=0.01)
    passages, mesh = kinematics(BEARING, 30.0).bpfo, 30.0 * 37
    window = np.hanning(5120)

    def line(motion: np.ndarray, frequency: float) -> float:
        turned = np.exp(-2j * math.pi * frequency * np.arange(5120) / 25600.0)
        return float(np.abs(np.sum(motion[:5120] * window * turned)) / window.sum())

    before, after = (motion.of("first.y", "acceleration") for motion in (healthy, found))
    assert line(after, 3.0 * passages) > 3.0 * line(before, 3.0 * passages)
    assert line(after, mesh) > 0.5 * line(before, mesh) > 0.0


def test_what_rolling_bearings_need_is_named() -> None:
    train, one = pair(), RollingElements("a", BEARING, 8e9)
    with pytest.raises(ValueError, match="different ones of a, b, got x"):
        simulate_train(train, duration=0.01, rolling=[replace(one, support="x")])
    with pytest.raises(ValueError, match="constant speed"):
        simulate_train(replace(train, acceleration=1.0), duration=0.01, rolling=[one])
    with pytest.raises(ValueError, match="a row that the bearing does not have"):
        replace(one, defects=(Defect(0.1, 1e-5, rows=2),))


def test_gears_that_are_not_smooth_keep_the_motion_from_repeating() -> None:
    scene = Scene(40.0, 1000.0, bearing=BEARING, rig=GearPairRig(), model="gear_pair")
    smooth, rough = (
        simulate(replace(scene, rig=rig), duration=0.1, rate=25600.0, accuracy=5e-3)
        for rig in (GearPairRig(), GearPairRig(mesh_variation=0.2))
    )
    assert (smooth.status, rough.repeats) == ("converged", False)
    assert rough.status in ("not_periodic", "inaccurate")
    assert smooth.record is not None
    assert rough.record is not None
    mesh = 40.0 * GearPairRig.teeth
    assert rough.record.line(mesh, "b") > 20.0 * smooth.record.line(mesh, "b")


def test_parameters_of_a_gear_pair_are_named_where_they_are_wrong() -> None:
    with pytest.raises(ValueError, match=r"rig\.mesh_variation must be less than 1"):
        GearPairRig(mesh_variation=1.0)
    with pytest.raises(ValueError, match=r"rig\.teeth_b must be a whole number"):
        GearPairRig(teeth_b=0)
    with pytest.raises(ValueError, match="NU 202 ECP has rollers"):
        Scene(40.0, 1000.0, bearing=from_catalogue("NU 202 ECP"), rig=GearPairRig())
