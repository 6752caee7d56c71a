"""Makers and checks that tests of pipeline share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from monitor.health.channel import check_channel, step
from monitor.health.later_stages import ChannelBlock
from monitor.health.onset import DetectSettings
from monitor.health.output import ChannelOutput
from monitor.health.record import Record
from monitor.health.record_values import record_values
from monitor.health.signal.condition import Quantity
from monitor.health.signal.quality import Verdict, with_flags
from monitor.health.size.level_set import LevelMap
from monitor.health.state import ChannelSettings, ChannelState
from monitor.health.tracker import DamageSettings, PartMap
from reference.signals import HealthyMachine, bearing_lines, impacts

RATE, N, SPEED = 25600.0, 2560, 27.5


BEARING, LINES = bearing_lines("PRONOSTIA", SPEED)


DETECT = DetectSettings(learn_blocks=25, run_in_blocks=5, persist_blocks=4)


FIRST_BAD = 60


BANDS = ((500.0, 6000.0),)


def map_slice() -> LevelMap:
    dphi_d, h_d = np.radians(np.linspace(0.0, 50.0, 26)), np.linspace(0.0, 32e-6, 17)
    rms = 0.2 + 8.0 * (h_d[:, None] / 32e-6) + np.degrees(dphi_d)[None, :] / 25.0
    return LevelMap(dphi_d, h_d, rms, 0.0229)


def base(**changes: object) -> ChannelSettings:
    settings = ChannelSettings("one", BEARING, bands=BANDS, detect=DETECT, average_blocks=4)
    return replace(settings, **changes)


def life(count: int = 80, seed: int = 0, first_bad: int = FIRST_BAD) -> list[NDArray[np.float32]]:
    """A healthy machine whose outer race begins to fail, 0.1 s a block."""
    return list(_life(count, seed, first_bad))


@cache
def _life(count: int, seed: int, first_bad: int) -> list[NDArray[np.float32]]:
    rng = np.random.default_rng(seed)
    machine = HealthyMachine.draw(rng, SPEED, LINES.bpfo)
    blocks = []
    for i, level in enumerate(machine.levels(rng, count)):
        x = machine.block(rng, float(level), RATE, N)
        if i + 1 >= first_bad:
            height = 4.0 + 1.0 * (i + 1 - first_bad)
            x += impacts(rng, "outer", LINES, rate=RATE, duration=N / RATE, height=height, noise=0.0)
        block = x.astype(np.float32)
        block.flags.writeable = False
        blocks.append(block)
    return blocks


def block_of(i: int, x: NDArray[np.float32], verdict: Verdict) -> ChannelBlock:
    speed, load = Quantity(SPEED, "configured"), Quantity(4200.0, "configured")
    return ChannelBlock(x, RATE, i + 1, 10.0 * i, verdict, speed, load)


def checked(i: int, x: NDArray[np.float32], state: ChannelState, settings: ChannelSettings) -> ChannelBlock:
    return block_of(i, x, check_channel(x, state, settings))


def run(
    blocks: list[NDArray[np.float32]],
    settings: ChannelSettings,
    state: ChannelState | None = None,
    flags: Mapping[int, tuple[str, ...]] | None = None,
    first: int = 0,
) -> tuple[ChannelState, list[ChannelOutput]]:
    state, outputs = state or ChannelState(), []
    for i, x in enumerate(blocks, start=first):
        verdict = with_flags(check_channel(x, state, settings), (flags or {}).get(i, ()))
        state, output = step(state, block_of(i, x, verdict), settings)
        outputs.append(output)
    return state, outputs


def record_of(i: int, state: ChannelState, output: ChannelOutput) -> Record:
    return Record("source", i + 1, "block", "", channels={"one": record_values(state.detect, output)})


DAMAGE = DamageSettings(maps={"outer": PartMap(lambda load, speed: (map_slice(), None))})


TRACKED = base(damage=DAMAGE)
