"""What a record says of wheels, in the order of the configuration; those that turn alike are one."""

from __future__ import annotations

from typing import Any

from monitor.health.gears.naming import GearsOutput

INDICATORS = ("fm0", "fm4", "m6a")
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
    return {name: value[0] if len(value) == 1 else value for name, value in values.items()}
