"""The angle of a block from its channels and pulses, and what the record of the block says of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.load import validate
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.rotation.rotation import TachoSettings
from monitor.health.signal.rotation.shaft_angle import FoundRotation, find_rotation, with_phase
from monitor.service.setup import source_settings
from reference.steps import Steps
from streams.turns.pulses import Pulses
from streams.types.block import Block
from tests.monitor.health.signal.rotation.shafts import even, hunting, marks, run_up
from tests.support.ridge import BEARING, shaken, turning
from tests.support.ridge import RATE as RIDGE_RATE

RATE, SECONDS = 8000.0, 4.0
TIME = np.arange(round(RATE * SECONDS)) / RATE
SHAFT = run_up(10.0, 30.0, SECONDS)


def block(pulses: Pulses | None = None, **rows: np.ndarray) -> Block:
    noise = np.random.default_rng(0).standard_normal(TIME.size)
    samples = np.stack([noise, *rows.values()]).astype(np.float32)
    units = ("m/s2", *["unknown"] * len(rows))
    return Block(samples, RATE, ("x", *rows), units, "s", 1, "n", start=1.7e9, pulses=pulses)


def tacho(**values: Any) -> ConditionSettings:
    return ConditionSettings(tacho=TachoSettings("t", **values))


def track(turns: np.ndarray, per_revolution: int, ahead: float = 0.0) -> np.ndarray:
    """A track of an encoder: high for the first half of each pitch."""
    return ((turns * per_revolution + ahead) % 1.0 < 0.5) * 1.0


def right(found: FoundRotation, atol: float = 5e-3) -> bool:
    assert found.rotation is not None
    away = found.rotation.turns_at(TIME) - SHAFT(TIME)
    return found.status == "ok" and bool(np.ptp(away) < atol)


def test_pulses_of_a_channel() -> None:
    found = find_rotation(block(t=track(SHAFT(TIME), 1)), tacho())
    assert right(found)
    assert found.pulses is not None
    assert (found.pulses.missing, found.pulses.extra) == (0, 0)
    assert right(find_rotation(block(t=track(SHAFT(TIME), 20)), tacho(per_revolution=20, edge="falling")))
    counted = np.floor(SHAFT(TIME) * 20.0)
    assert right(find_rotation(block(t=counted), tacho(per_revolution=20)))


def test_pulses_that_come_with_the_block() -> None:
    times = marks(SHAFT, SECONDS, 7).times
    condition = ConditionSettings(tacho=TachoSettings(per_revolution=7))
    assert right(find_rotation(block(Pulses(times)), condition))
    assert right(find_rotation(block(Pulses(times, 7)), ConditionSettings()))
    assert find_rotation(block(Pulses(np.zeros(0))), condition).status == "too_few"


def test_the_wheel_that_a_source_states_takes_precedence() -> None:
    stated = replace(block(t=track(SHAFT(TIME), 20)), pulses_per_revolution=20)
    assert right(find_rotation(stated, tacho(per_revolution=60, missing_teeth=2)))


def test_a_quadrature_encoder_that_turns_back_is_refused() -> None:
    condition = tacho(channel_b="b", per_revolution=20)
    turns = SHAFT(TIME)
    assert right(find_rotation(block(t=track(turns, 20), b=track(turns, 20, 0.25)), condition))
    back = 3.0 * np.sin(2.0 * np.pi * TIME / SECONDS)
    refused = find_rotation(block(t=track(back, 20), b=track(back, 20, 0.25)), condition)
    assert (refused.rotation, refused.status) == (None, "reversed")


def test_a_speed_over_time_and_where_it_takes_the_place_of_pulses() -> None:
    speed = 60.0 * (10.0 + 20.0 * TIME / SECONDS)
    condition = replace(tacho(), speed_channel="n", speed_scale=1.0 / 60.0, speed_over_time=True)
    found = find_rotation(block(n=speed), replace(condition, tacho=TachoSettings()))
    assert right(found)
    assert found.rotation is not None
    assert found.rotation.source == "profile"
    silent = find_rotation(block(n=speed, t=0.0 * TIME), condition)
    assert right(silent)
    both = find_rotation(block(n=speed, t=track(SHAFT(TIME), 1)), condition)
    assert both.rotation is not None
    assert both.rotation.source == "tacho"


def test_why_there_is_no_angle() -> None:
    nothing = find_rotation(block(), ConditionSettings())
    assert (nothing.rotation, nothing.status, nothing.pulses) == (None, None, None)
    assert find_rotation(block(), tacho()).status == "none"
    assert find_rotation(block(t=0.0 * TIME), tacho()).status == "too_few"
    assert find_rotation(block(t=np.full(TIME.size, np.nan)), tacho()).status == "too_few"
    noise = np.random.default_rng(1).standard_normal(TIME.size)
    assert find_rotation(block(t=noise), tacho()).status == "irregular"
    standing = track(SHAFT(np.minimum(TIME, 2.0)), 1)
    assert find_rotation(block(t=standing), tacho()).status == "stopped"
    condition = ConditionSettings(speed_channel="n", speed_over_time=True)
    assert find_rotation(block(n=np.zeros(TIME.size)), condition).status == "stopped"


def test_the_angle_in_the_vibration_is_the_last_source() -> None:
    shaft = turning(np.linspace(15.0, 30.0, 201))
    samples = shaken(shaft, seed=3)
    condition = ConditionSettings(phase=True, speed_limits=(12.0, 35.0))
    nothing, refused = FoundRotation(), FoundRotation(None, "irregular")
    found = with_phase(nothing, samples, RIDGE_RATE, BEARING, condition)
    assert found.status == "ok"
    assert found.rotation is not None
    assert found.rotation.source == "phase"
    assert with_phase(refused, samples, RIDGE_RATE, BEARING, condition).status == "ok"
    assert with_phase(found, samples, RIDGE_RATE, BEARING, condition) is found
    assert with_phase(nothing, samples, RIDGE_RATE, BEARING, replace(condition, phase=False)) is nothing
    noise = np.random.default_rng(0).standard_normal(samples.size)
    assert with_phase(nothing, noise, RIDGE_RATE, BEARING, condition).status == "cannot_tell"
    assert with_phase(refused, noise, RIDGE_RATE, BEARING, condition) is refused


def record_of(taken: Block, **operating: Any) -> dict[str, Any]:
    values = {
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": operating,
        "source": [{"name": "s", "url": "nowhere", "rate_hz": RATE, "block_s": SECONDS}],
        "channel": [{"name": "x", "source": "s", "unit": "m/s2", "bearing": "b", "band_hz": [[2000, 3500]]}],
    }
    loaded = validate(values, Path("machine.toml"))
    record = Steps(source_settings(loaded, loaded.source[0])).take(taken)
    assert record.reason in ("", "x: outside_speed")
    return {"flags": record.flags, **record.channels["x"]}


@pytest.mark.parametrize("domain", ["auto", "hertz"])
def test_the_record_has_the_speed_of_the_angle(domain: str) -> None:
    values = record_of(block(t=track(SHAFT(TIME), 1)), tacho_channel="t", domain=domain, max_speed_hz=35)
    assert values["speed"] == pytest.approx(20.0, rel=1e-4)
    assert (values["speed_source"], values["rotation_status"]) == ("tacho", "ok")
    assert 0.0 < values["speed_sd"] < 1e-2
    assert values["domain"] == ("order" if domain == "auto" else "hertz")
    assert (values["speed_min"], values["speed_max"]) == pytest.approx((10.0, 30.0), rel=5e-3)
    assert values["acceleration"] == pytest.approx(5.0, rel=2e-2)
    assert (values["pulses_missing"], values["pulses_extra"]) == (0, 0)
    assert values["flags"] == ()


@pytest.mark.parametrize("limit", [{"min_speed_hz": 12}, {"max_speed_hz": 28}, {"max_acceleration_hz_per_s": 4}])
def test_a_block_beyond_the_limits_is_flagged(limit: dict[str, float]) -> None:
    taken = block(Pulses(marks(SHAFT, SECONDS, 1).times))
    assert record_of(taken, **limit)["flags"] == ("outside_speed",)


def test_without_an_angle_the_next_source_of_the_speed_holds() -> None:
    noise = np.random.default_rng(1).standard_normal(TIME.size)
    values = record_of(block(t=noise), tacho_channel="t", speed_hz=20.0)
    assert (values["speed"], values["speed_source"]) == (20.0, "configured")
    assert (values["rotation_status"], values["domain"]) == ("irregular", "hertz")


def test_hunting_pulses_of_a_loose_source_need_no_configured_speed() -> None:
    shaft = hunting(20.0, 0.1, 0.4)
    values = record_of(block(Pulses(marks(shaft, SECONDS, 1).times)))
    assert values["speed_source"] == "tacho"
    assert record_of(block(Pulses(marks(even(20.0), SECONDS, 1).times)))["speed"] == pytest.approx(20.0, rel=1e-6)
