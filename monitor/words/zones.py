"""Zones of broadband velocity by class of machine: ISO 20816-3:2022, Tables A.1 and A.2, and what they mean.

The velocities are those of ISO 10816-3:2009, which it replaces. They judge the vibration of a whole machine on its
non-rotating parts, in steady operation: a rolling bearing is far gone before it moves the velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

ZONES = ("A", "B", "C", "D")
ZONE_MEANINGS = {
    "A": "as of a newly commissioned machine",
    "B": "acceptable for unrestricted long-term operation",
    "C": "not suitable for long-term continuous operation",
    "D": "severe enough to cause damage",
}
MIN_SPEED, MAX_SPEED = 10.0, 500.0
"""Shaft speeds that are judged, Hz: below 600 rpm the standard asks for the velocity from 2 Hz, not from 10 Hz; beyond
30,000 rpm it does not apply."""


@dataclass(frozen=True)
class MachineClass:
    """A class of machines.

    Attributes:
        name: as in the configuration: part of ISO 20816, group, support.
        text: for people.
        table: where its limits stand.
        limits: between the zones A, B, C and D, m/s; a velocity on a limit is in the lower zone.
    """

    name: str
    text: str
    table: str
    limits: tuple[float, float, float]

    def zone(self, velocity: float) -> str:
        """Return the zone of a velocity RMS, m/s."""
        return ZONES[sum(velocity > limit for limit in self.limits)]


def _class(group: int, support: str, *limits_mm_s: float) -> MachineClass:
    power = {1: "above 300 kW", 2: "15 to 300 kW"}[group]
    low, middle, high = (1e-3 * limit for limit in limits_mm_s)
    return MachineClass(
        f"20816-3:{group}:{support}",
        f"ISO 20816-3 group {group} ({power}), {support} support",
        f"ISO 20816-3:2022, Table A.{group}",
        (low, middle, high),
    )


MACHINE_CLASSES = {
    found.name: found
    for found in (
        _class(1, "rigid", 2.3, 4.5, 7.1),
        _class(1, "flexible", 3.5, 7.1, 11.0),
        _class(2, "rigid", 1.4, 2.8, 4.5),
        _class(2, "flexible", 2.3, 4.5, 7.1),
    )
}
"""All classes by name. Group 1: above 300 kW and up to 50 MW, or electrical machines with a shaft height from 315 mm;
group 2: 15 to 300 kW, or a shaft height from 160 to 315 mm."""


def machine_class(name: str) -> MachineClass:
    """Return the class of a name.

    Raises:
        ValueError: naming all classes.
    """
    if name not in MACHINE_CLASSES:
        raise ValueError(
            f"unknown class {name!r} (part of ISO 20816, group, support); known are {', '.join(MACHINE_CLASSES)}"
        )
    return MACHINE_CLASSES[name]


def zone_words(zone: str) -> str:
    """Return a zone for people."""
    return f"zone {zone}, {ZONE_MEANINGS[zone]}"
