"""Makers and checks that tests of alarms share."""

from __future__ import annotations

from typing import Any

from monitor.health.alarms import (
    AlarmInput,
    Level,
    Rule,
)

RULE = Rule("rms", "rms", alert=Level(10.0), danger=Level(20.0), hysteresis=0.1, on_delay=2, off_delay=3)


def block(sequence: int, value: Any, *, usable: bool = True, bad: bool = False, **fields: Any) -> AlarmInput:
    given = {name: fields.pop(name) for name in ("stage", "baselines") if name in fields}
    return AlarmInput(sequence, usable, bad, values={"rms": value, **fields}, **given)
