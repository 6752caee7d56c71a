"""Speed and load: what a block states, a channel, the signal or a constant, in this order; records say which."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.machine.bearing import Bearing, from_catalogue, kinematics
from monitor.config.load import ConfigError, validate
from monitor.health.record import Record
from monitor.health.signal.condition import ConditionSettings, Quantity, known_sd, load_of, speed_of
from monitor.health.signal.quality import SpeedLimits
from monitor.health.signal.rotation.rotation import Rotation, TachoSettings
from monitor.health.signal.speed import SpeedStatus, estimate_speed
from monitor.service.setup import source_settings, source_spec
from reference.steps import Steps
from streams.open import open_source
from streams.types.block import Block
from streams.types.spec import ChannelSpec, SourceSpec
from tests.support.effort import effort_count

BEARING = from_catalogue("6205")
RATE = 12000.0
NICE = Bearing("NICE", 8, 0.235 * 0.0254, 1.245 * 0.0254, element="roller")


def machine(speed: float, seconds: float = 5.0, seed: int = 0, *, damaged: bool = True) -> np.ndarray:
    """A shaft with four harmonics, noise, and impacts on the outer race that ring at 3 kHz and slip by 0.5 %."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    x = rng.standard_normal(t.size)
    for order, amplitude in ((1, 0.3), (2, 0.2), (3, 0.15), (4, 0.1)):
        x += amplitude * np.sin(2.0 * np.pi * order * speed * t + rng.uniform(0.0, 6.0))
    if damaged:
        phase = kinematics(BEARING, speed).bpfo * 0.995 * t % 1.0
        since = phase / (kinematics(BEARING, speed).bpfo * 0.995)
        x += 8.0 * np.exp(-since * 800.0) * np.sin(2.0 * np.pi * 3000.0 * since)
    return x.astype(np.float32)


@given(speed=st.floats(12.0, 55.0), seed=st.integers(0, 1000), damaged=st.booleans())
@settings(max_examples=effort_count(quick=6, full=300))
def test_a_speed_that_is_called_is_right(speed: float, seed: int, damaged: bool) -> None:
    found = estimate_speed(machine(speed, seed=seed, damaged=damaged), RATE, BEARING, (10.0, 60.0))
    if found.status == SpeedStatus.OK:
        assert abs(found.speed - speed) < 5.0 * found.sd
        assert found.sd < 2e-3 * speed


@pytest.mark.parametrize("speed", [12.0, 17.3, 29.95, 41.0, 50.0])
@pytest.mark.parametrize("damaged", [False, True])
def test_near_the_nominal_speed_it_is_found(speed: float, damaged: bool) -> None:
    found = estimate_speed(machine(speed, damaged=damaged), RATE, BEARING, (speed / 1.3, speed * 1.2))
    assert found.status == SpeedStatus.OK
    assert abs(found.speed - speed) < 5.0 * found.sd


def test_noise_silence_and_short_blocks_have_no_speed() -> None:
    rng = np.random.default_rng(1)
    for samples in (rng.standard_normal(60000), np.zeros(60000), np.full(60000, 3.0)):
        found = estimate_speed(samples, RATE, BEARING, (10.0, 60.0))
        assert found.status == SpeedStatus.CANNOT_TELL
        assert math.isnan(found.speed)
    assert estimate_speed(rng.standard_normal(2560), 25600.0, BEARING, (10.0, 60.0)).status == SpeedStatus.TOO_SHORT
    with pytest.raises(ValueError, match="limits"):
        estimate_speed(np.zeros(1000), RATE, BEARING, (60.0, 10.0))


@pytest.mark.real
@pytest.mark.parametrize(
    ("path", "kind", "key", "bearing", "stated", "least", "most"),
    [
        # Against the speed that the files state, and for MFPT against the nominal one, which the lines of all its
        # files stand half to one percent below; python -m benchmarks.rotation.speed prints all.
        ("cwru/97_Normal_0.mat", "cwru", "X*_DE_time", BEARING, None, -1e-3, 1e-3),
        ("cwru/105_0.mat", "cwru", "X*_DE_time", BEARING, None, -1e-3, 1e-3),
        ("cwru/118_0.mat", "cwru", "X*_DE_time", BEARING, None, -1e-3, 1e-3),
        ("mfpt/InnerRaceFault_vload_4.mat", "mfpt", None, NICE, 25.0, -0.014, -0.005),
        ("mfpt/OuterRaceFault_vload_5.mat", "mfpt", None, NICE, 25.0, -0.014, -0.005),
    ],
)
def test_speed_of_recordings(
    data_dir: Path, path: str, kind: str, key: str | None, bearing: Bearing, stated: float, least: float, most: float
) -> None:
    channel = ChannelSpec("x", key=key, unit="g")
    block = next(iter(open_source(SourceSpec("s", str(data_dir / path), format=kind, channels=(channel,)))))
    if not isinstance(block, Block):
        block = next(
            iter(open_source(SourceSpec("s", str(data_dir / path), format=kind, channels=(channel,), block_s="file")))
        )
    assert isinstance(block, Block)
    found = estimate_speed(block.samples[0], block.rate, bearing, (10.0, 60.0))
    assert found.status == SpeedStatus.OK
    error = found.speed / (block.speed if stated is None else stated) - 1.0
    assert least < error < most


def test_the_order_of_precedence() -> None:
    rows = {"tacho": np.full(10, 1800.0), "cell": np.array([1.0, 3.0])}
    signal = machine(30.0)
    full = ConditionSettings(29.0, 5.0, "tacho", 1 / 60, "cell", 1000.0, None)

    def speed(stated: float | None, with_rows: dict[str, np.ndarray], given: ConditionSettings) -> Quantity:
        return speed_of(stated, with_rows, signal, RATE, BEARING, given)

    assert speed(31.0, rows, full) == Quantity(31.0, "block")
    assert speed(None, rows, full) == Quantity(30.0, "channel", 0.0)
    assert speed(None, {}, full) == Quantity(29.0, "configured")
    assert speed(None, {"tacho": np.array([np.nan])}, full) == Quantity(29.0, "configured")
    assert speed(None, {"tacho": np.zeros(4)}, ConditionSettings(speed_channel="tacho")) == Quantity()
    estimated = speed(None, {}, ConditionSettings(29.0, speed_limits=(20.0, 40.0)))
    assert estimated.source == "estimate"
    assert estimated.value == pytest.approx(30.0, rel=1e-3)
    assert load_of(7.0, rows, full) == Quantity(7.0, "block")
    assert load_of(None, rows, full) == Quantity(2000.0, "channel", 1000.0)
    assert load_of(None, {}, full) == Quantity(5.0, "configured")
    assert load_of(None, {}, ConditionSettings()) == Quantity()


def config(**operating: Any) -> Any:
    values = {
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": operating,
        "source": [{"name": "s", "url": "nowhere", "rate_hz": RATE}],
        "channel": [{"name": "x", "source": "s", "unit": "g", "bearing": "b", "band_hz": [[2000, 4000]]}],
    }
    return validate(values, Path("machine.toml"))


def record(loaded: Any, samples: np.ndarray, channels: tuple[str, ...] = ("x",)) -> Record:
    steps = Steps(source_settings(loaded, loaded.source[0]))
    units = ("g", *["unknown"] * (len(channels) - 1))
    return steps.take(Block(samples, RATE, channels, units, "s", 1, "n", start=1.7e9))


def test_the_record_says_what_was_used_and_where_it_comes_from() -> None:
    values = record(config(speed="estimate", load_newton=100), machine(31.7)[np.newaxis]).channels["x"]
    assert values["speed"] == pytest.approx(31.7, rel=1e-3)
    assert (values["speed_source"], values["load"], values["load_source"]) == ("estimate", 100.0, "configured")
    assert 0.0 < values["speed_sd"] < 0.05
    loaded = config(speed_channel="tacho", speed_channel_scale=0.5)
    rows = np.vstack([machine(30.0), np.full(60000, 60.0, dtype=np.float32)])
    values = record(loaded, rows, ("x", "tacho")).channels["x"]
    assert (values["speed"], values["speed_source"], values["speed_sd"]) == (30.0, "channel", 0.0)
    assert [spec.name for spec in source_spec(loaded, loaded.source[0]).channels] == ["x", "tacho"]
    noise = np.random.default_rng(0).standard_normal((1, 60000)).astype(np.float32)
    unknown = record(config(speed="estimate"), noise)
    assert unknown.status == "incomplete"
    assert "shaft speed is not known" in unknown.reason
    assert record(config(speed="estimate", speed_hz=30.0), noise).channels["x"]["speed_source"] == "configured"


def run_up(begin: float = 10.0, end: float = 40.0, duration: float = 5.0) -> Rotation:
    """A shaft whose speed rises evenly, Hz."""
    time, speed = np.array([0.0, duration]), np.array([begin, end])
    return Rotation(time, np.array([0.0, 0.5 * (begin + end) * duration]), speed, duration, speed_sd=1e-4)


def test_the_speed_of_an_angle_takes_precedence_and_is_known() -> None:
    settings = ConditionSettings(29.0)
    found = speed_of(31.0, {}, None, RATE, BEARING, settings, rotation=run_up())
    assert (found.value, found.source) == (25.0, "tacho")
    assert known_sd(found, settings) == pytest.approx(2.5e-3)


def test_the_keys_of_the_angle_reach_the_settings() -> None:
    operating = config(
        tacho_channel="n", tacho_channel_b=3, pulses_per_revolution=1024, tacho_ratio=0.5, tacho_level=2.5,
        tacho_edge="falling", domain="hertz", phase="estimate", phase_orders=[1, 3], speed_hz=20.0, max_speed_hz=50,
    ).operating  # fmt: skip
    condition = operating.to_condition()
    assert condition.tacho == TachoSettings("n", "3", 1024, 0, 0.5, 2.5, "falling")
    assert (condition.phase, condition.phase_orders, condition.speed_limits) == (True, (1.0, 3.0), (16.0, 25.0))
    assert (condition.domain, condition.limits) == ("hertz", SpeedLimits(most=50.0))
    assert [spec.column for spec in operating.channel_specs()] == ["n", 3]
    assert condition.channels == ("n", "3")
    assert condition.varies


@pytest.mark.parametrize(
    ("operating", "words"),
    [
        ({"speed": "estimate", "speed_channel": "t"}, "not both"),
        ({"speed": "guess"}, "estimate"),
        ({"speed_range_hz": [10, 20]}, "belongs to"),
        ({"speed": "estimate", "speed_range_hz": [20, 10]}, "below"),
        ({"speed_channel": "t", "load_channel": "t"}, "differ"),
        ({"speed_channel": "t", "speed_channel_scale": 0}, "other than 0"),
        ({"speed_over_time": True}, "speed_over_time belongs to speed_channel"),
        ({"phase_orders": [1]}, "phase_orders belongs to"),
        ({"phase": "estimate", "phase_orders": [2, 1]}, "must rise"),
        ({"tacho_channel_b": "t"}, "tacho_channel_b belongs to tacho_channel"),
        ({"tacho_edge": "falling"}, "tacho_edge belongs to tacho_channel"),
        ({"tacho_channel": "t", "tacho_channel_b": "t"}, "tacho_channel and tacho_channel_b must differ"),
        ({"tacho_channel": 2, "load_channel": "2"}, "load_channel and tacho_channel must differ"),
        ({"tacho_channel": "t", "tacho_missing_teeth": 2, "pulses_per_revolution": 5}, "at least 6"),
        ({"pulses_per_revolution": 0}, "greater than or equal to 1"),
        ({"min_speed_hz": 20, "max_speed_hz": 10}, "min_speed_hz must be below"),
    ],
)
def test_wrong_keys_are_named(operating: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config(**operating)
