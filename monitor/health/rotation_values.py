"""What the record and the kept spectrum of a block say of the shaft's rotation in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from monitor.health.signal.orders import MAX_SPEED_RATIO
from monitor.health.signal.rotation.rotation import PulseCounts, Rotation

COURSE_POINTS = 65
"""Points of the course of the speed that are kept with a spectrum."""


def rotation_values(
    rotation: Rotation | None, status: str | None, pulses: PulseCounts | None, *, warped: bool = True
) -> dict[str, Any]:
    """Return the values of a record by variable; {} of a machine without any source of an angle.

    Args:
        rotation: angle of the shaft over the block, None where it is not known.
        status: why not, or "ok"; one of ``monitor.health.schema.ROTATION_STATUSES``.
        pulses: repairs, where there are pulses.
        warped: whether the spectra of the block are over the angle.
    """
    wide = rotation is not None and rotation.speed_range[1] > MAX_SPEED_RATIO * rotation.speed_range[0]
    if status == "ok" and wide and not warped:
        status = "too_wide"
    values: dict[str, Any] = {} if status is None else {"rotation_status": status}
    if rotation is not None:
        least, highest = rotation.speed_range
        values |= {
            "speed_min": least,
            "speed_max": highest,
            "acceleration": rotation.acceleration,
            "revolutions": rotation.turned,
        }
    if pulses is not None:
        values |= {
            "pulses_missing": pulses.missing,
            "pulses_extra": pulses.extra,
            "encoder_error": pulses.encoder_error,
        }
    return values


def speed_course(rotation: Rotation | None) -> tuple[float, ...] | None:
    """Return the speed at equal steps from the beginning to the end of a block, Hz, or None without an angle."""
    if rotation is None:
        return None
    times = np.linspace(0.0, rotation.duration, COURSE_POINTS)
    return tuple(np.round(rotation.speed_at(times), 6).tolist())
