"""A clock that is wrong for some blocks moves neither onset nor V_eq, TT and the time to the alarm after them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from monitor.health.alarms import AlarmSettings, Level, Rule
from monitor.health.record import Record
from monitor.health.retrace import retrace
from monitor.health.signal.condition import ConditionSettings
from monitor.health.size.level_set import LevelMap
from monitor.health.state import SourceSettings, SourceState
from monitor.health.tracker import DamageSettings, PartMap
from reference.signals import HealthyMachine, impacts
from reference.steps import Steps
from streams.types.block import Block
from tests.support.pipeline import LINES, RATE, SPEED, N, base

COUNT, STEP = 95, 600.0
T0 = 1774699200.0
"""2026-03-28T12:00:00Z."""
ALARMS = AlarmSettings((Rule("level", "rms", alert=Level(factor=30.0)),))


def damage() -> DamageSettings:
    dphi_d, h_d = np.radians(np.linspace(0.0, 50.0, 26)), np.linspace(0.0, 32e-6, 17)
    rms = 0.2 + 14.0 * (h_d[:, None] / 32e-6) * (0.2 + 0.8 * np.degrees(dphi_d)[None, :] / 50.0)
    levels = LevelMap(dphi_d, h_d, rms, 0.0229)
    return DamageSettings(maps={"outer": PartMap(lambda load, speed: (levels, None))}, thresholds=(1e-6,))


def life() -> list[NDArray[np.float32]]:
    """A machine whose outer race fails from the 60th block on, ever faster."""
    rng = np.random.default_rng(0)
    machine = HealthyMachine.draw(rng, SPEED, LINES.bpfo)
    found = []
    for k, level in enumerate(machine.levels(rng, COUNT)):
        x = machine.block(rng, float(level), RATE, N)
        if k >= 59:
            height = 10.0 + 0.02 * (k - 59) ** 2
            x += impacts(rng, "outer", LINES, rate=RATE, duration=N / RATE, height=height, noise=0.0)
        found.append(x.astype(np.float32))
    return found


CHANNEL = base(damage=damage(), alarms=ALARMS, condition=ConditionSettings(speed=SPEED, load=4200.0))
SETTINGS = SourceSettings("s", {"one": CHANNEL}, RATE)
SAMPLES = life()


@cache
def lived(stated: Callable[[int], float]) -> tuple[list[SourceState], list[Record]]:
    """Return the states from the first one on and the records of a life whose blocks state these times."""
    steps = Steps(SETTINGS)
    states, records = [steps.state], []
    for k, x in enumerate(SAMPLES):
        block = Block(x[np.newaxis], RATE, ("one",), ("m/s2",), "s", k + 1, f"b{k}", start=stated(k))
        records.append(steps.take(block))
        states.append(steps.state)
    return states, records


def right(k: int) -> float:
    return T0 + STEP * k


@pytest.fixture(scope="module")
def undisturbed() -> tuple[list[SourceState], list[Record]]:
    return lived(right)


FAULTS: dict[str, Callable[[int], float]] = {
    "2006 while healthy": lambda k: right(k) if k not in (30, 31) else 1136073612.0 + STEP * (k - 30),
    "2006 in the final stage": lambda k: right(k) if k not in (70, 71) else 1136073612.0 + STEP * (k - 70),
    "a year ahead": lambda k: right(k) + (3.15e7 if k == 68 else 0.0),
    "1970 from the onset on": lambda k: right(k) if k < 58 else 100.0 + STEP * (k - 58),
    "set back by an hour": lambda k: right(k) - (3600.0 if k >= 66 else 0.0),
    "never set": lambda k: 100.0 + STEP * k,
}


@pytest.mark.parametrize("fault", FAULTS)
def test_onset_and_time_left_are_those_of_a_clock_that_is_right(
    fault: str, undisturbed: tuple[list[SourceState], list[Record]]
) -> None:
    states, records = lived(FAULTS[fault])
    last, other = records[-1].channels["one"], undisturbed[1][-1].channels["one"]
    assert (other["tt_status"], other["tta_status"]) == (("ok",), "ok")
    assert last["t_fs_block"] == other["t_fs_block"]
    assert last["t_fs_known_block"] == other["t_fs_known_block"]
    assert (last["stage"], last["edv_status"], last["tt_status"]) == (
        *(other["stage"], other["edv_status"], other["tt_status"]),
    )
    assert last["v_eq"] == pytest.approx(other["v_eq"])
    # The fits have up to four points less.
    assert last["tt"] == pytest.approx(other["tt"], rel=0.1)
    assert last["tta"] == pytest.approx(other["tta"], rel=0.1)
    assert states[-1].channels["one"].running_time == pytest.approx(
        undisturbed[0][-1].channels["one"].running_time, abs=2 * STEP
    )


def test_no_doubtful_block_has_a_wrong_date_or_is_plain_ok() -> None:
    for fault in FAULTS.values():
        for k, record in enumerate(lived(fault)[1]):
            if fault(k) == right(k):
                continue
            if record.time is not None:
                assert abs(record.time - right(k)) <= 3600.0
            if "clock" not in record.flags:
                # That clock holds since it was set.
                assert record.time == fault(k)


def test_the_points_of_fits_leave_out_what_has_no_certain_distance_in_time() -> None:
    _, records = lived(FAULTS["2006 in the final stage"])
    assert [record.channels["one"]["edv_status"] for record in records[70:72]] == ["bad_block"] * 2
    assert [record.channels["one"]["tta_status"] for record in records[70:72]] == ["bad_block"] * 2
    assert "bad_block" not in [record.channels["one"]["edv_status"] for record in records[72:]]


@pytest.mark.parametrize("fault", FAULTS)
def test_records_alone_lead_to_the_same_time(fault: str) -> None:
    states, records = lived(FAULTS[fault])
    found = retrace(states[40], records[40:], SETTINGS).state
    assert found.channels["one"].running_time == states[-1].channels["one"].running_time
    assert found.order.clock.time == states[-1].order.clock.time
    assert found.channels["one"].detect == states[-1].channels["one"].detect
