"""The words and features that the page shows, as data."""

from __future__ import annotations

from typing import Any

from monitor.words.features import FEATURES
from monitor.words.statuses import (
    DAEMON,
    EDV_REFUSALS,
    FAULT_NAMES,
    LINE_NAMES,
    STAGES,
    STATES,
    STATUS_MEANINGS,
    TT_REFUSALS,
)

_CHARTS = {
    "rms": {"title": "Vibration, RMS"},
    "lines": {"title": "Lines of the damaged parts in the envelope spectrum"},
    "kurtosis": {"title": "Kurtosis", "unit": "3 for a healthy bearing's noise"},
    "peak": {"title": "Peak"},
    "v_eq": {"title": "Damaged volume V_eq", "unit": "mm³ per mm of width"},
    "tt": {"title": "Time to threshold"},
    "speed": {"title": "Shaft speed"},
    "load": {"title": "Load"},
}
"""Titles of charts in their order, and units where they are not those of the features."""


def page_words() -> dict[str, Any]:
    """Return all words of the page as plain values."""
    titles = {feature.chart: {"title": feature.label.capitalize()} for feature in FEATURES.values() if feature.chart}
    return {
        "states": STATES,
        "stages": STAGES,
        "parts": FAULT_NAMES,
        "lines": LINE_NAMES,
        "daemon": DAEMON,
        "blocks": STATUS_MEANINGS,
        "edv": EDV_REFUSALS | {"widened": "the interval is wider than usual, as the latest levels jumped"},
        "tt": TT_REFUSALS | {"already_crossed": "the threshold has been reached"},
        "charts": _CHARTS | {name: chart for name, chart in titles.items() if name not in _CHARTS},
        "features": {
            name: {
                "column": feature.column,
                "label": feature.label,
                "unit": feature.unit.text,
                "acceleration": feature.acceleration,
                "chart": feature.chart,
                "axis": feature.axis,
            }
            for name, feature in FEATURES.items()
        },
    }
