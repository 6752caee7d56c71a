"""From the unit that a channel states to m/s2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from streams.block import STANDARD_GRAVITY


def to_si(
    samples: NDArray[np.floating],
    unit: str,
    scale: float = 1.0,
    sensitivity_mv_per_g: float | None = None,
) -> tuple[NDArray[np.floating], str]:
    """Convert samples to m/s2 where their unit is known.

    Args:
        samples: any shape, float32 or float64; kept unchanged, and so is the precision.
        unit: "g", "m/s2", "V" or "unknown".
        scale: factor from the stored numbers to ``unit``.
        sensitivity_mv_per_g: sensitivity of the sensor, for "V".

    Returns:
        The samples and "m/s2"; for "unknown" the scaled samples and "unknown".

    Raises:
        ValueError: the unit is none of the four, or "V" comes without a sensitivity.
    """
    factor = float(scale)
    target = "m/s2"
    if unit == "g":
        factor *= STANDARD_GRAVITY
    elif unit == "V":
        if not sensitivity_mv_per_g or sensitivity_mv_per_g < 0.0:
            raise ValueError(f"unit V needs a positive sensitivity_mv_per_g, got {sensitivity_mv_per_g}")
        factor *= 1e3 * STANDARD_GRAVITY / sensitivity_mv_per_g
    elif unit == "unknown":
        target = "unknown"
    elif unit != "m/s2":
        raise ValueError(f"unit must be g, m/s2, V or unknown, got {unit!r}")
    # A float32 sample near the top of its range becomes inf here, which the quality stage names.
    with np.errstate(over="ignore", invalid="ignore"):
        return (samples if factor == 1.0 else samples * factor), target
