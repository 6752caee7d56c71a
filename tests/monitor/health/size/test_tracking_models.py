"""V_eq on the map of a model other than that of the casing, of blocks of a rig that the same model simulates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.machine.bearing import kinematics
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan
from models.work.choose import local_runner
from monitor.health import tracker as damage
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.size import DamageInput
from monitor.service.setup import part_map
from streams.rig.bench import SimulatedRig, machine_of
from tests.support.effort import effort_count

BAND = (0.0, 9500.0)
HEALTHY = 1
BLOCKS, EVERY = 60, effort_count(quick=12, full=6)
FACTOR = 1.25
"""Found over true, either way: 0.93 to 1.12 for these seeds, whose rigs have parameters 2 to 5 % off the map's."""


@pytest.fixture(scope="module")
def rms_map() -> RmsMap:
    machine = machine_of("rotor")
    plan = MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(2e-6 * k for k in range(8)),
        dphi_d=tuple(math.radians(2.5 * k) for k in range(13)),
        bearing=machine.bearing,
        rig=machine.nominal,
        model="rotor",
        rms_band=BAND,
    )
    with local_runner(2) as runner:
        return build_map(plan, runner=runner)


def features_of(rig: SimulatedRig, sequence: int) -> DamageInput:
    """Return what the monitor takes of a block."""
    block = rig.block(sequence)
    lines = fundamentals(kinematics(rig.bearing, rig.speed))
    settings = FeatureSettings(rate=block.rate, bands=((7000.0, 9000.0),), fundamentals=lines, rms_band=BAND)
    found = block_features(block.samples[0], block.rate, settings)
    assert found.bpfo_resolved.all()
    return DamageInput(block.elapsed or 0.0, found.rms, tuple(found.bpfo_amplitude.tolist()), rig.load, rig.speed)


def ratios_of(rig: SimulatedRig, rms_map: RmsMap) -> np.ndarray:
    """Return found over true V_eq of some blocks of a life."""
    settings = damage.DamageSettings(
        track_method="filter",
        forecast_method="thesis",
        maps={"outer": part_map(rms_map, ("rms", "harmonics"), 0.8)},
    )
    state, ratios = damage.DamageState(), []
    for sequence in range(rig.life.onset, rig.life.onset + BLOCKS, EVERY):
        state, found, _ = damage.step(state, features_of(rig, sequence), damage.DamageGate(), settings)
        ratios.append(found.v_eq / rig.truth(sequence, ())["v_eq_true"])
    return np.array(ratios)


@pytest.mark.parametrize("seed", [2001, 5][: effort_count(quick=1, full=2)])
def test_v_eq_is_near_the_truth_where_map_and_rig_are_of_one_model(rms_map: RmsMap, seed: int) -> None:
    ratios = ratios_of(SimulatedRig("rig", seed, healthy_blocks=HEALTHY, machine=machine_of("rotor")), rms_map)
    assert np.all((ratios > 1.0 / FACTOR) & (ratios < FACTOR)), ratios


def test_the_map_of_another_model_gives_another_volume(rms_map: RmsMap) -> None:
    """It is as loud as a defect of another size: what vouches for the model is not in the signal."""
    rig = SimulatedRig("rig", 2001, healthy_blocks=HEALTHY, machine=machine_of("six_dof", "6205"))
    ratios = ratios_of(rig, rms_map)
    assert np.all(ratios > 1.2 * FACTOR), ratios
