"""The angular speed of a block that is kept to be looked at."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.config.load import validate
from monitor.health.signal.spectra import RawSpectra
from monitor.service.setup import source_settings
from reference.steps import Steps
from streams.turns.pulses import Pulses
from streams.types.block import Block
from tests.monitor.health.signal.rotation.wheels import MARKS, wheel

RATE, SECONDS = 8000.0, 2.0
TRAIN = wheel(80, lines=[(4.5, 1e-3, 0.0)], jitter=1e-7)


def kept(pulses: Pulses | None, **operating: Any) -> list[RawSpectra | None]:
    """Return what is kept of the angular speed of two blocks, 100 s and then 2 s apart, by channel."""
    channels = [
        {"name": name, "source": "s", "unit": "m/s2", "bearing": "b", "band_hz": [[2000, 3500]]} for name in ("x", "y")
    ]
    values = {
        "bearing": [{"name": "b", "designation": "6205"}],
        "operating": {"speed_hz": 40.0, **operating},
        "source": [{"name": "s", "url": "nowhere", "rate_hz": RATE, "block_s": SECONDS}],
        "channel": channels,
    }
    loaded = validate(values, Path("machine.toml"))
    steps = Steps(source_settings(loaded, loaded.source[0]))
    samples = np.random.default_rng(0).standard_normal((2, round(RATE * SECONDS))).astype(np.float32)
    first = Block(samples, RATE, ("x", "y"), ("m/s2",) * 2, "s", 1, "n", start=1.7e9, pulses=pulses)
    found: list[RawSpectra | None] = []
    for number, start in ((1, 0.0), (2, 2.0)):
        steps.take(replace(first, sequence=number, start=1.7e9 + start))
        found += [None if change.row.view is None else change.row.view.ias for change in steps.spectra]
    return found


def test_the_first_channel_of_a_kept_block_has_the_angular_speed() -> None:
    pulses = Pulses(TRAIN.times[TRAIN.times < SECONDS], MARKS)
    first, *others = kept(pulses, tacho_ratio=1.5, speed_exact=True)
    assert others == [None, None, None]
    assert first is not None
    lines = np.arange(first.amplitude.size) * first.resolution
    shown = lines > 0.5
    assert lines[shown][np.argmax(first.amplitude[shown])] == pytest.approx(3.0, abs=first.resolution)


def test_marks_that_cannot_show_a_passage_of_the_balls_have_none() -> None:
    """BPFO of the 6205 is 3.58 events a turn: of a bearing that turns three times as fast, 10.8 of the wheel."""
    sixteen = Pulses(TRAIN.times[::16][:-1], 16)
    assert kept(sixteen)[0] is not None
    assert kept(sixteen, tacho_ratio=3.0) == [None] * 4
    assert kept(Pulses(TRAIN.times[::32][:-1], 8)) == [None] * 4


def test_no_pulses_have_none() -> None:
    assert kept(None) == [None] * 4
