"""The errors of the marks over the blocks of a source: learned, recorded, restarted."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.load import validate
from monitor.health.record import Record
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.rotation.shaft_angle import find_rotation
from monitor.health.state import SourceSettings
from monitor.service.setup import source_settings
from reference.steps import Steps
from streams.turns.pulses import Pulses
from streams.types.block import Block
from tests.monitor.health.signal.rotation.wheels import eccentric, wheel

MARKS, SPEED, TURNS, BLOCKS = 64, 100.0, 201, 8
RATE, SECONDS = 2000.0, 2.0
ERROR = eccentric(0.2, MARKS)


def settings() -> SourceSettings:
    values = {
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": {"pulses_per_revolution": MARKS},
        "source": [{"name": "s", "url": "nowhere", "rate_hz": RATE, "block_s": SECONDS}],
        "channel": [{"name": "x", "source": "s", "unit": "m/s2", "bearing": "b", "band_hz": [[500, 900]]}],
    }
    loaded = validate(values, Path("machine.toml"))
    return source_settings(loaded, loaded.source[0])


def block(number: int) -> Block:
    """Return a block that begins at another mark than the one before."""
    train = wheel(
        TURNS, marks=MARKS, speed=SPEED, error=ERROR, start=number * 200 * MARKS + 7 * number, jitter=1e-7, seed=number
    )
    times = train.times - train.times[0]
    samples = np.random.default_rng(number).standard_normal((1, round(RATE * SECONDS))).astype(np.float32)
    pulses = Pulses(times[times < SECONDS], MARKS)
    start = 1.7e9 + SECONDS * number
    return Block(samples, RATE, ("x",), ("m/s2",), "s", number, f"n{number}", start=start, pulses=pulses)


def recorded(records: list[Record]) -> list[dict[str, Any]]:
    return [dict(record.channels["x"]) for record in records]


def test_the_errors_are_recorded_once_they_are_learned_and_a_restart_changes_nothing() -> None:
    live = Steps(settings())
    first = recorded([live.take(block(number)) for number in range(1, BLOCKS)])
    restarted, second = Steps(settings()), []
    for number in range(1, BLOCKS):
        second += recorded([restarted.take(block(number))])
        restarted = Steps(settings(), json.loads(json.dumps(restarted.stored())), restarted.state.latest)
    errors = [values["encoder_error"] for values in first]
    assert errors[0] is None
    assert errors[-1] == pytest.approx(2.0 * math.pi * float(np.std(ERROR)), rel=0.01)
    assert json.dumps(first, default=str) == json.dumps(second, default=str)
    assert live.stored() == restarted.stored()
    assert "encoder:s" in live.stored()


def test_the_angle_is_free_of_the_errors_that_are_known() -> None:
    steps = Steps(settings())
    for number in range(1, BLOCKS):
        steps.take(block(number))
    condition = ConditionSettings(tacho=next(iter(settings().channels.values())).condition.tacho)
    plain = find_rotation(block(9), condition)
    mended = find_rotation(block(9), condition, steps.state.encoder)
    assert plain.mark_error is None
    assert mended.mark_error is not None
    assert plain.rotation is not None
    assert mended.rotation is not None
    assert mended.rotation.turns_sd < 0.3 * plain.rotation.turns_sd
    assert mended.rotation.mean_speed == pytest.approx(SPEED, rel=1e-5)


def test_a_source_without_pulses_keeps_nothing_of_a_wheel() -> None:
    steps = Steps(settings())
    without = block(1)
    without = Block(without.samples, RATE, ("x",), ("m/s2",), "s", 1, "n", start=1.7e9, speed=SPEED)
    steps.take(without)
    assert "encoder:s" not in steps.stored()
