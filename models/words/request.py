"""What is asked about a scene, in the terms that all floors share: sensors, quantities, bands, accuracy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from models.words.checks import check_choice

Sensor = Literal["mo", "mr", "a", "b", "c", "ias"]
"""Casing and resonator; the supports A and B of a rotor and its disc C; instantaneous angular speed of the shaft."""
SENSORS: tuple[Sensor, ...] = ("mo", "mr", "a", "b", "c", "ias")
Quantity = Literal["waveform", "rms", "lines", "v_eq"]
"""What an accuracy is asked for: see ``Response.error_of``."""
QUANTITIES: tuple[Quantity, ...] = ("waveform", "rms", "lines", "v_eq")
MEANS: tuple[Quantity, ...] = ("rms", "v_eq")
"""Quantities that are means over the time of a motion."""
USUAL_SECONDS = 1.0
"""Time that is simulated where no duration is named and something else than a mean is asked for, s."""
# Periods that are simulated at least before a motion is said not to settle.
_LEAST_PERIODS = 20


@dataclass(frozen=True)
class Request:
    """What is asked about a scene; see ``models.solve.simulate``. Fields that a solver has no use for are ignored.

    A solver takes steps with which ``quantity`` meets the accuracy; for "v_eq", those of the RMS.

    Raises:
        ValueError: if a field is unusable; the message names it.
    """

    accuracy: float = 1e-3
    tolerance: float | None = None
    steps_per_period: int | None = None
    max_periods: int = 300
    band: tuple[float, float] | None = None
    lines_to: float | None = None
    direction: float = 0.0
    duration: float | None = None
    rate: float = 51200.0
    quantity: Quantity = "rms"
    sensor: Sensor | None = None
    derivatives: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check each field by itself."""
        for name in ("accuracy", "tolerance", "duration", "rate"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value!r}")
        if self.steps_per_period is not None and self.steps_per_period < 8:
            raise ValueError(f"steps_per_period must be at least 8, got {self.steps_per_period!r}")
        if self.max_periods < _LEAST_PERIODS:
            raise ValueError(f"max_periods must be at least {_LEAST_PERIODS}, got {self.max_periods!r}")
        if self.band is not None:
            check_band(self.band)
        if self.lines_to is not None and not (math.isfinite(self.lines_to) and self.lines_to >= 0.0):
            raise ValueError(f"lines_to must be finite and not negative, got {self.lines_to!r} Hz")
        check_choice(self.quantity, "quantity", QUANTITIES)
        if self.sensor is not None:
            check_choice(self.sensor, "sensor", SENSORS)
        if not math.isfinite(self.direction):
            raise ValueError(f"direction must be finite, got {self.direction!r}")

    @property
    def seconds(self) -> float | None:
        """Time to simulate, s; None where nothing but the error of a mean decides it."""
        if self.duration is None and self.quantity not in MEANS:
            return USUAL_SECONDS
        return self.duration

    def highest(self, resolved: float, by: str) -> float:
        """Return the highest frequency that is asked for, Hz, 0 where none is.

        Raises:
            ValueError: if one is above ``resolved`` Hz, which ``by`` explains; the message names it.
        """
        asked = {"lines_to is": self.lines_to, "the band ends at": None if self.band is None else self.band[1]}
        for words, frequency in asked.items():
            if frequency is not None and frequency > resolved:
                raise ValueError(f"{words} {frequency!r} Hz, {by} {resolved:.0f} Hz")
        return max(frequency or 0.0 for frequency in asked.values())


def check_band(band: tuple[float, float]) -> tuple[float, float]:
    """Return a band; raise a ValueError unless 0 <= lo < hi."""
    low, high = band
    if not 0.0 <= low < high:
        raise ValueError(f"a band needs 0 <= lo < hi, got {low!r} to {high!r} Hz")
    return low, high
