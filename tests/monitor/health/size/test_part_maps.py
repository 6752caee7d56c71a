"""Which map a block is tracked on: that of the part that the envelope names, and ``not_this_part`` without one."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from models.machine.scene import Part
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.plan import MapPlan
from monitor.health import tracker as damage
from monitor.health.channel import check_channel, step
from monitor.health.later_stages import ChannelBlock
from monitor.health.onset import DetectSettings
from monitor.health.output import ChannelOutput
from monitor.health.record import Record
from monitor.health.record_values import record_values
from monitor.health.retrace import retrace
from monitor.health.signal.condition import ConditionSettings, Quantity
from monitor.health.signal.features import FeatureSettings, block_features, fundamentals
from monitor.health.size import DamageInput, EdvStatus
from monitor.health.size.level_set import LevelMap
from monitor.health.state import ChannelSettings, ChannelState, SourceSettings, SourceState
from monitor.health.tracker import DamageGate, DamageSettings, DamageState, PartMap, part_of
from monitor.health.tracker import step as damage_step
from monitor.service.setup import part_map
from reference.signals import HealthyMachine, bearing_lines, impacts
from streams.rig.bench import SimulatedRig, machine_of
from tests.support.effort import effort_count

RATE, N, SPEED = 25600.0, 5120, 27.5
BEARING, LINES = bearing_lines("PRONOSTIA", SPEED)
RADII: dict[Part, float] = {"outer": 0.0229, "inner": 0.0166, "ball": 0.0036}


def map_of(part: Part) -> PartMap:
    """RMS that rises with extent and depth, less steeply for the inner race than for the outer."""
    dphi_d, h_d = np.radians(np.linspace(0.0, 50.0, 26)), np.linspace(0.0, 32e-6, 17)
    slope = {"outer": 8.0, "inner": 6.0, "ball": 4.0}[part]
    rms = 0.2 + slope * (h_d[:, None] / 32e-6) + np.degrees(dphi_d)[None, :] / 25.0
    level_map = LevelMap(dphi_d, h_d, rms, RADII[part])
    return PartMap(lambda load, speed: (level_map, None))


def settings_of(*parts: Part) -> DamageSettings:
    return DamageSettings(maps={part: map_of(part) for part in parts})


@pytest.mark.parametrize(
    ("fault", "parts", "expected"),
    [
        ("inner", ("outer", "inner"), "inner"),
        ("outer", ("outer", "inner"), "outer"),
        ("ball", ("outer", "inner"), None),
        ("cage", ("outer", "inner", "ball"), None),
        ("inner|ball", ("outer", "inner"), "inner"),
        ("inner|ball", ("inner", "ball"), None),
        (None, ("outer", "inner"), "outer"),
        (None, ("inner",), "inner"),
        (None, ("inner", "ball"), None),
        ("inner", (), None),
        (None, (), None),
    ],
)
def test_the_named_part_chooses_the_map(fault: str | None, parts: tuple[Part, ...], expected: Part | None) -> None:
    assert part_of(fault, parts) == expected


def test_v_eq_is_of_the_part_and_a_part_without_map_has_none() -> None:
    settings = settings_of("outer", "inner")
    block = DamageInput(0.0, 3.0)
    for fault, radius in (("outer", RADII["outer"]), ("inner", RADII["inner"])):
        state, damage, _ = damage_step(DamageState(), block, DamageGate(fault=fault), settings)
        assert damage.status == "ok"
        assert damage.v_eq == pytest.approx(radius * damage.dphi_d * damage.h_d)
        assert state.part == fault
    state, damage, _ = damage_step(DamageState(), block, DamageGate(fault="ball"), settings)
    assert damage.status is EdvStatus.NOT_THIS_PART
    assert np.isnan(damage.v_eq)
    assert state.part is None


def test_another_part_begins_anew_and_a_gap_does_not() -> None:
    """The floor that V_eq may not fall below is that of the part before: it does not hold for another."""
    settings = settings_of("outer", "inner")
    state = DamageState()
    for t in range(8):
        state, _, _ = damage_step(state, DamageInput(60.0 * t, 3.0 + 0.2 * t), DamageGate(fault="outer"), settings)
    kept, damage, _ = damage_step(state, DamageInput(480.0, 4.6), DamageGate(fault="ball"), settings)
    assert damage.status is EdvStatus.NOT_THIS_PART
    assert (kept.edv, kept.part) == (state.edv, "outer")
    again, _, _ = damage_step(kept, DamageInput(540.0, 4.6), DamageGate(fault="outer"), settings)
    assert len(again.edv.window) == len(state.edv.window)
    restored = DamageState.from_dict(json.loads(json.dumps(again.to_dict())))
    assert restored.to_dict() == again.to_dict()
    found = [
        damage_step(before, DamageInput(600.0, 2.0), DamageGate(fault="inner"), settings)
        for before in (restored, DamageState())
    ]
    assert found[0][1] == found[1][1]
    assert found[0][0].edv == found[1][0].edv
    assert found[0][0].forecast == found[1][0].forecast
    old = {key: value for key, value in again.to_dict().items() if key != "part"}
    assert DamageState.from_dict(old).part is None


def life(fault: str, count: int = 70, first_bad: int = 50) -> list[NDArray[np.float32]]:
    """A healthy machine one of whose parts begins to fail, 0.2 s a block."""
    rng = np.random.default_rng(1)
    machine = HealthyMachine.draw(rng, SPEED, LINES.bpfo)
    blocks = []
    for i, level in enumerate(machine.levels(rng, count)):
        x = machine.block(rng, float(level), RATE, N)
        if i + 1 >= first_bad:
            height = 10.0 + 1.5 * (i + 1 - first_bad)
            x += impacts(rng, fault, LINES, rate=RATE, duration=N / RATE, height=height, noise=0.0)
        blocks.append(x.astype(np.float32))
    return blocks


def run(fault: str, damage: DamageSettings) -> tuple[ChannelState, list[ChannelOutput], list[Record], ChannelSettings]:
    settings = ChannelSettings(
        "one",
        BEARING,
        bands=((500.0, 6000.0),),
        detect=DetectSettings(learn_blocks=25, run_in_blocks=5, persist_blocks=4),
        average_blocks=4,
        damage=damage,
        condition=ConditionSettings(speed_exact=True),
    )
    state, outputs, records = ChannelState(), [], []
    for i, x in enumerate(life(fault)):
        verdict = check_channel(x, state, settings)
        block = ChannelBlock(
            x, RATE, i + 1, 10.0 * i, verdict, Quantity(SPEED, "configured"), Quantity(4200.0, "configured")
        )
        state, output = step(state, block, settings)
        outputs.append(output)
        values = record_values(state.detect, output)
        records.append(Record("s", i + 1, "block", "", channels={"one": values}, time=10.0 * i))
    return state, outputs, records, settings


def test_an_inner_race_fault_is_tracked_on_the_map_of_the_inner_race() -> None:
    state, outputs, records, settings = run("inner", settings_of("outer", "inner"))
    assert state.detect.t_fs is not None
    assert state.named is not None
    assert state.named.fault == "inner"
    damage = outputs[-1].damage
    assert damage is not None
    assert damage.status in ("ok", "widened")
    assert damage.v_eq == pytest.approx(RADII["inner"] * damage.dphi_d * damage.h_d)
    assert state.damage.part == "inner"
    alone = run("inner", settings_of("inner"))[1][-1].damage
    assert alone == damage
    source = SourceSettings("s", {"one": settings})
    retraced = retrace(SourceState.begin(source), records, source)
    assert retraced.state.channels["one"].damage.to_dict() == state.damage.to_dict()


@pytest.mark.parametrize("fault", ["inner", "ball"])
def test_without_a_map_of_the_named_part_it_is_said(fault: str) -> None:
    state, outputs, _, _ = run(fault, settings_of("outer"))
    assert state.named is not None
    assert state.named.fault == fault
    final = [output.damage for output in outputs if output.damage is not None and output.stage == "final"]
    assert final[-1].status is EdvStatus.NOT_THIS_PART
    assert all(np.isnan(damage.v_eq) for damage in final[-5:])
    before = [output.damage for output in outputs if output.stage == "healthy"]
    assert {damage.status for damage in before if damage is not None} == {"not_final_stage"}


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
    return build_map(plan)


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
