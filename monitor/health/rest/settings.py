"""The check that the settings of all forecasts share."""

from __future__ import annotations


def check_forecast(interval: float, horizon: float, window: float | None = None) -> None:
    """Raise a ValueError naming the setting of a forecast that is out of range.

    Args:
        interval: probability between the lower and the upper end.
        horizon: longest time that is given as ``ok``, s.
        window: s of the history that is used, None for all.
    """
    if not 0.0 < interval < 1.0:
        raise ValueError(f"interval must lie between 0 and 1, got {interval}")
    if window is not None and not window > 0.0:
        raise ValueError(f"window must be positive, or None, got {window}")
    if not horizon > 0.0:
        raise ValueError(f"horizon must be positive, got {horizon}")
