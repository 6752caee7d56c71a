"""The wheels of one channel in one block: angle, averages and indicators, and what is named of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from monitor.health.gears.angle import angle_of_mesh
from monitor.health.gears.average import wheel_average
from monitor.health.gears.indicators import gear_indicators, shared_orders
from monitor.health.gears.naming import (
    GearNamingSettings,
    GearsInput,
    GearsState,
    WheelReading,
    step,
)
from monitor.health.gears.settings import GearSettings
from monitor.health.onset import LEARNING
from monitor.health.output import ChannelOutput
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.state import ChannelSettings

_SPREAD = 3.0
"""Standard deviations of a known speed within which the mesh is sought."""
_LEAST_ERROR = 1e-3
"""Least relative range of that search: a shaft does not keep its mean speed."""


def gears_step(
    states: Mapping[str, GearsState], outputs: Mapping[str, ChannelOutput]
) -> tuple[dict[str, GearsState], dict[str, ChannelOutput]]:
    """Take a block into the states of the wheels, by channel.

    A block that may not enter a baseline leaves them as they are; its wheels have the status "bad_block".

    Args:
        states: of the channels of machines with gears.
        outputs: of the stages before, by channel.

    Returns:
        The states after the block, and all outputs with what is said of the wheels.
    """
    after, found = dict(states), dict(outputs)
    for name, state in states.items():
        output = outputs[name]
        block, settings = output.block, output.settings
        if settings.gears is None or not block.verdict.accepted:
            continue
        usable = block.verdict.for_baseline
        given = GearsInput(
            block.sequence,
            wheel_readings(output, settings.gears) if usable else _bad_block(settings.gears),
            block.speed.value,
            block.load.value,
            learning=output.stage == LEARNING,
        )
        after[name], said = step(state, given, settings.gears, rules_of(settings))
        found[name] = replace(output, gears=said)
    return after, found


def rules_of(settings: ChannelSettings) -> GearNamingSettings:
    """Return rate and persistence as those of the detector."""
    rules = settings.detect
    return GearNamingSettings(rules.false_alarms_per_1000_blocks, rules.persist_blocks, rules.close_blocks)


def _bad_block(gears: GearSettings) -> dict[str, WheelReading]:
    """Return the readings of a block that is not used."""
    return {"|".join(group): WheelReading("bad_block") for group in gears.groups()}


def wheel_readings(output: ChannelOutput, gears: GearSettings) -> dict[str, WheelReading]:
    """Return what a block says of each wheel, those that turn alike joined by "|".

    The angle is that of the block where there is one, else that of the mesh.
    """
    block = output.block
    rotation = block.found.rotation or _angle(output, gears)
    return readings_of(block.samples, block.rate, rotation, gears)


def readings_of(
    samples: NDArray[np.floating], rate: float, rotation: Rotation | None, gears: GearSettings
) -> dict[str, WheelReading]:
    """Return what samples, shape (sample,), say of each wheel by the angle of the bearing's shaft over them."""
    return {"|".join(group): _reading(samples, rate, rotation, (gears, group)) for group in gears.groups()}


def _angle(output: ChannelOutput, gears: GearSettings) -> Rotation | None:
    """Return the angle that the mesh shows near the speed of the block."""
    features, block = output.features, output.block
    if features is None or features.speed is None:
        return None
    shaft = features.shaft
    error = output.settings.condition.speed_tolerance if shaft is None else _SPREAD * shaft.sd / shaft.speed
    return angle_of_mesh(block.samples, block.rate, features.speed, max(error, _LEAST_ERROR), gears)


def _reading(
    samples: NDArray[np.floating],
    rate: float,
    rotation: Rotation | None,
    wanted: tuple[GearSettings, tuple[str, ...]],
) -> WheelReading:
    gears, group = wanted
    wheels = [gears.by_name[name] for name in group]
    turns, teeth = wheels[0].turns, tuple(sorted({wheel.teeth for wheel in wheels}))
    average, status = wheel_average(samples, rate, rotation, turns, teeth)
    if average is None:
        return WheelReading(status)
    others = [wheel.turns for wheel in gears.wheels if wheel.name not in group and not _holds(wheel.turns, turns)]
    shared = shared_orders(turns, average.lines.size, others)
    return WheelReading(status, gear_indicators(average, teeth, shared), average.turns)


def _holds(slower: float, turns: float) -> bool:
    """Tell whether a turn of a slower wheel is a whole number of turns of another: it has all orders of that one."""
    ratio = turns / slower
    return round(ratio) > 1 and abs(ratio / round(ratio) - 1.0) < 1e-6
