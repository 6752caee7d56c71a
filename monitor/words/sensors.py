"""Names of the places where the sensors of the models are, and the units of what they measure."""

from __future__ import annotations

from collections.abc import Mapping

from models.response import Sensor
from streams.block import STANDARD_GRAVITY

PLACES: Mapping[Sensor, str] = {
    "mo": "casing",
    "mr": "resonator",
    "a": "shaft in bearing A",
    "b": "shaft in bearing B",
    "c": "disc",
    "ias": "shaft",
}


def unit_of_sensor(sensor: Sensor) -> tuple[float, str]:
    """Return the unit in which a sensor is shown: its value in SI, and its text."""
    return (1.0, "rad/s") if sensor == "ias" else (STANDARD_GRAVITY, "g")
