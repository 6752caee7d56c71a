"""The columns of the records that people see: names with units, and the variable of the record behind each."""

from __future__ import annotations

from typing import NamedTuple

from streams.block import STANDARD_GRAVITY

_ACCELERATIONS = ("rms", "rms_smoothed", "peak", "a_star", "h_or", "h_ir", "h_ball", "h_cage")
_NUMBERS = ("kurtosis", "crest_factor", "detect_score", "fault_snr", "p_threshold")
_VOLUMES = ("v_eq", "v_eq_lower", "v_eq_upper")
_TIMES = ("tt", "tt_lower", "tt_upper")


class Column(NamedTuple):
    """One column.

    Attributes:
        name: as in JSON, its unit at the end.
        feature: variable of the record; of several bands or thresholds the first.
        unit: what one of the unit is in SI.
        acceleration: whether it is in the sensor's own unit where that is not known.
    """

    name: str
    feature: str
    unit: float = 1.0
    acceleration: bool = False

    def of_si(self, *, absolute: bool) -> float:
        """Return what a value in SI is multiplied by.

        Args:
            absolute: whether the accelerations of the channel are in m/s2.
        """
        return 1.0 if self.acceleration and not absolute else 1.0 / self.unit


COLUMNS: tuple[Column, ...] = (
    *(Column(f"{name}_g", name, STANDARD_GRAVITY, acceleration=True) for name in _ACCELERATIONS),
    *(Column(name, name) for name in _NUMBERS),
    *(Column(f"{name}_mm2", name, 1e-6) for name in _VOLUMES),
    *(Column(f"{name}_s", name) for name in _TIMES),
    Column("speed_hz", "speed"),
    Column("load_newton", "load"),
)
"""What the trends of a channel show."""
BY_FEATURE: dict[str, Column] = {
    **{column.feature: column for column in COLUMNS},
    "peak_half_range": Column("peak_half_range_g", "peak_half_range", STANDARD_GRAVITY, acceleration=True),
    **{name: Column(name, name) for name in ("shape_factor", "impulse_factor", "clearance_factor")},
}
"""All that a level may stand on, by the variable of the record."""
FEATURES: tuple[str, ...] = tuple(column.feature for column in COLUMNS)
