"""What a record says of wheels, in the order of the configuration; those that turn alike are one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from monitor.health.gears.indicators import GearIndicators
from monitor.health.gears.naming import NAMED, GearsOutput, GearsState, WheelReading
from monitor.health.gears.settings import GearSettings

INDICATORS = ("fm0", "fm4", "m6a")
_LEARNED = {"gear_residual": "residual", "gear_sidebands": "sideband", "gear_variance": "variance"}
"""Variables of what is learned besides, and the indicators that they hold: a state can be made again of records."""
UNNAMED = "none"
"""``gear_fault`` of a wheel that is not named."""


def gear_values(output: GearsOutput | None) -> dict[str, Any]:
    """Return the values by variable, over ``gear`` where there are several wheels; {} of a machine without gears."""
    if output is None:
        return {}
    names, wheels = list(output.wheels), list(output.wheels.values())
    values: dict[str, Any] = {
        "gear_status": tuple(wheel.status for wheel in wheels),
        "gear_fault": tuple((output.kind or UNNAMED) if name == output.named else UNNAMED for name in names),
        "gear_score": tuple(output.scores.get(name) for name in names),
        "gear_turns": tuple(wheel.turns for wheel in wheels),
        "na4": tuple(output.na4.get(name) for name in names),
        "sideband_level": tuple(wheel.indicators and wheel.indicators.sideband_level for wheel in wheels),
    }
    for name in INDICATORS:
        values[name] = tuple(wheel.indicators and getattr(wheel.indicators, name) for wheel in wheels)
    for name, indicator in _LEARNED.items():
        values[name] = tuple(wheel.indicators and getattr(wheel.indicators, indicator) for wheel in wheels)
    return {name: value[0] if len(value) == 1 else value for name, value in values.items()}


def recorded_readings(gears: GearSettings, values: Mapping[str, Any]) -> dict[str, WheelReading]:
    """Return what a record says of each wheel as far as a state is made of it; {} of one without gears."""
    names = ["|".join(group) for group in gears.groups()]
    statuses = _each(values.get("gear_status"), len(names))
    if not any(statuses):
        return {}
    found: dict[str, WheelReading] = {}
    for place, (name, status) in enumerate(zip(names, statuses, strict=True)):
        fm4, m6a = (_each(values.get(variable), len(names))[place] for variable in ("fm4", "m6a"))
        learned = {of: _each(values.get(variable), len(names))[place] for variable, of in _LEARNED.items()}
        indicators = GearIndicators(None, fm4, m6a, None, unlike=None, **learned)
        found[name] = WheelReading(status, None if learned["variance"] is None else indicators)
    return found


def _each(value: Any, count: int) -> tuple[Any, ...]:
    """Return a value over ``gear`` by wheel; a single wheel has no dimension, and a value may be missing."""
    found = cast("tuple[Any, ...]", value) if isinstance(value, tuple) else (value,)
    return found if len(found) == count else (None,) * count


def primary_fault(fault: str | None, basis: str | None, gear: str | None) -> str | None:
    """Return which of a bearing's and a wheel's damage is said first.

    A verdict on the bearing is: an onset of its level and lines of one of its parts agree. A wheel that is named, which
    rests on a learned baseline and on several blocks, comes before a hint.

    Args:
        fault: the named part of the bearing, or None.
        basis: of that name, "hint" or "verdict".
        gear: the named wheel as a value of ``fault``, or None.
    """
    return gear if gear is not None and basis != "verdict" else fault


def gears_summary(state: GearsState, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of the interface: the named wheel, its kind, since when, and each wheel in the latest record.

    Args:
        state: after the latest block.
        values: of the channel in its record.
    """
    names = list(state.turns)

    def of(variable: str, place: int) -> Any:
        return _each(values.get(variable), len(names))[place]

    wheels: dict[str, Any] = {
        name: {
            "status": of("gear_status", place),
            "score": of("gear_score", place),
            **{variable: of(variable, place) for variable in (*INDICATORS, "na4", "sideband_level")},
            "turns": of("gear_turns", place),
        }
        for place, name in enumerate(names)
    }
    return {
        "gear_fault": None if state.named is None else NAMED + state.named,
        "gear_kind": state.kind,
        "gear_since_block": state.since,
        "gears": wheels,
    }
