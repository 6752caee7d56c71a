"""Makers and checks that tests of retrace share."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from monitor.health.alarms import AlarmAcknowledgement, AlarmSettings, Level, Rule
from monitor.health.record import Record
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.waterfall import WaterfallSettings
from monitor.health.state import ChannelSettings, SourceSettings, SourceState
from reference.steps import Steps
from streams.types.block import Block, Rejected
from tests.support.pipeline import BANDS, RATE, SPEED, TRACKED, life

COUNT = 80


ALARMS = AlarmSettings(
    (
        Rule("level", "rms", alert=Level(factor=1.5), danger=Level(factor=3.0), latch=True),
        Rule("kurtosis", "kurtosis", alert=Level(deviations=4.0)),
    ),
    run_in_blocks=5,
)


def settings_of(**changes: object) -> SourceSettings:
    given = {"average_blocks": 1, "alarms": ALARMS, "condition": ConditionSettings(speed=SPEED, load=4200.0)}
    given |= {"waterfall": WaterfallSettings(rows=4, interval=30.0), **changes}
    one: ChannelSettings = replace(TRACKED, **given)
    # The second one has several bands and is not tracked.
    two = replace(one, name="two", bands=(*BANDS, (1000.0, 9000.0)), damage=None)
    return SourceSettings("source", {"one": one, "two": two}, RATE)


def items() -> list[Block | Rejected]:
    """Blocks of a life, among them a rejected, a missing, a late, a dead, a clipped and a stopped one."""
    found: list[Block | Rejected] = []
    for i, x in enumerate(life(COUNT)):
        samples = np.stack([x, 0.5 * x[::-1]])
        samples[0] = {17: 0.0, 33: 1e-4}.get(i, 1.0) * samples[0]
        samples[1] = np.clip(samples[1], -0.2, 0.2) if i == 70 else samples[1]
        start = 1.7e9 + 10.0 * i + (1e9 if i == 40 else 0.0)
        names = ("one", "two")
        block = Block(
            samples, RATE, names, ("m/s2", "m/s2"), "source", i + 1, f"b{i}", start=start, content_hash=str(i)
        )
        found.append(Rejected("source", i + 1, "b", "unreadable", "words") if i == 21 else block)
    late = found.pop(50)
    return [*found[:54], late, *found[54:]]


@cache
def lived(**changes: object) -> tuple[list[SourceState], list[Record]]:
    """Return the state before each block and after the last one, and the records."""
    steps = Steps(settings_of(**changes))
    states, records = [steps.state], []
    for place, item in enumerate(items()):
        given = [AlarmAcknowledgement("one", "level", "danger", 10**6, 1.8e9)] if place == 75 else []
        records.append(steps.take(item, now=1.7e9 + 1000.0, acknowledgements=given))
        states.append(steps.state)
    return states, records
