"""The pace of daemons and pages in quick effort: what the product does each second is done ten times a second."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from tests.support.effort import effort_count

_QUICK = effort_count(quick=1, full=0) == 1
_INTERVALS: dict[str, dict[str, float]] = {
    "monitor.service.daemon": {"_MIN_STATUS_S": 0.1, "_POLL_LOG_S": 0.1, "_PAUSE_S": 0.1},
    "monitor.pipeline": {"_RETRY_S": 0.1},
    "monitor.service.ingest": {"_RETRY_S": 0.1},
    "monitor.service.publisher": {"_CHECK_TURNS": 3, "_MIN_PAUSE_FACTOR": 0.5},
    "monitor.service.record_mqtt": {"_PLACE_S": 0.5, "_STATE_S": 0.1},
    "monitor.service.retention": {"_MAX_PAUSE_S": 0.5},
    "models.platform.supervision": {"MIN_PAUSE_S": 0.2},
    "monitor.service.broker": {"_MIN_PAUSE_S": 0.2},
    "monitor.web.machines": {"_COUNT_S": 0.1, "_FRESH_S": 0.05},
    "monitor.web.stream": {"_POLL_S": 0.1},
}
"""Seconds, turns, and a number of durations, by module."""
_LIMITS: dict[str, dict[str, float]] = {"monitor.service.notify.message": {"MAX_S": 300.0}}
"""Seconds after which the product goes on without something that a busy machine only brings later."""


def quicken(assign: Callable[[object, str, Any], None] = setattr) -> None:
    """Shorten the intervals of the product in this process, in quick effort, and lengthen its limits of time."""
    for module, values in (_INTERVALS | _LIMITS).items() if _QUICK else ():
        for name, value in values.items():
            assign(import_module(module), name, value)
