"""Names of the places where the sensors of the models are, and of what they measure, with its unit."""

from __future__ import annotations

from collections.abc import Mapping

from models.words.request import Sensor
from streams.types.block import STANDARD_GRAVITY

PLACES: Mapping[Sensor, str] = {
    "mo": "casing",
    "mr": "resonator",
    "a": "shaft in bearing A",
    "b": "shaft in bearing B",
    "c": "disc",
    "ias": "shaft",
}


MEASURED: Mapping[Sensor, str] = {sensor: "angular speed" if sensor == "ias" else "acceleration" for sensor in PLACES}


def unit_of_sensor(sensor: Sensor, status: str = "") -> tuple[float, str]:
    """Return the unit in which a sensor is shown: its value in SI, and its text.

    The ``status`` of a simulation may say that its levels have none.
    """
    if status == "uncalibrated":
        return 1.0, status
    return (1.0, "rad/s") if sensor == "ias" else (STANDARD_GRAVITY, "g")


def data_name(quantity: str, unit: str) -> str:
    """Return the name of a column with a quantity: ``acceleration_g``, ``angular_speed_rad_s``."""
    return f"{quantity.replace(' ', '_')}_{unit_in_names(unit)}"


def unit_in_names(unit: str) -> str:
    """Return a unit as it ends the name of a value."""
    return unit.replace("/", "_")
