"""Time to the alarm level by the trend of RMS: for any sensor and machine, without a map, a library or a unit."""

from __future__ import annotations

from monitor.health.rest.trend.stage import (
    LEVEL_SOURCES,
    TimeToAlarm,
    TrendInput,
    TrendSettings,
    TrendState,
    TtaStatus,
    rule_of,
    step,
)

__all__ = ["LEVEL_SOURCES", "TimeToAlarm", "TrendInput", "TrendSettings", "TrendState", "TtaStatus", "rule_of", "step"]
