"""For each rule a configuration that it doubts, and the nearest good one."""

from __future__ import annotations

from typing import Any

Changes = dict[str, Any]

VOLTS = {"channel.0.unit": "V", "channel.0.sensitivity_mv_per_g": 100}
OWN = {"n_elements": 9, "element_diameter_mm": 7.94, "pitch_diameter_mm": 39.04}


def own(**changed: float) -> Changes:
    return {"bearing.0": {"name": "test", **OWN, **changed}}


TWO = {
    "channel": [
        {"name": "a", "source": "logger", "unit": "g", "bearing": "test", "column": 1},
        {"name": "b", "source": "logger", "unit": "g", "bearing": "test", "column": 2},
    ]
}
SOURCES = {
    "source": [
        {"name": "logger", "url": "folder:data", "rate_hz": 25600},
        {"name": "other", "url": "folder:data", "rate_hz": 25600},
    ],
    "channel": [
        {"name": "a", "source": "logger", "unit": "g", "bearing": "test"},
        {"name": "b", "source": "other", "unit": "g", "bearing": "test"},
    ],
}
TRACKED = {"channel.0.track": True}
REVOLUTIONS = {"source.0.block_revolutions": 50, "operating.tacho_channel": "t"}
FEW = {**REVOLUTIONS, "source.0.block_revolutions": 2}
SLOW = {"operating.speed_hz": 0.2, "source.0.block_s": 60}
BEARING, BAND = "bearing[test]", "channel[de].band_hz"
SENSITIVITY = "channel[de].sensitivity_mv_per_g"
LEVEL = {"alarms": {"level": [{"feature": "rms", "alert_g": 3.0}]}}

CASES: list[tuple[str, str, str, Changes, Changes]] = [
    ("speed", "problem", "operating.speed_hz", {"operating.speed_hz": 1488}, {"operating.speed_hz": 24.8}),
    ("speed", "problem", "operating.speed_hz", {"operating.speed_hz": 600}, {"operating.speed_hz": 100}),
    ("speed", "warning", "operating.speed_hz", {"operating.speed_hz": 250}, {"operating.speed_hz": 200}),
    ("speed", "warning", "operating.speed_hz", {"operating.speed_hz": 0.01}, SLOW),
    (
        "speed",
        "problem",
        "operating.speed_range_hz",
        {"operating": {"speed": "estimate", "speed_range_hz": [300, 1500]}},
        {"operating": {"speed": "estimate", "speed_range_hz": [5, 25]}},
    ),
    ("speed", "warning", "operating.max_speed_hz", {"operating.max_speed_hz": 3000}, {"operating.max_speed_hz": 50}),
    (
        "speed_limits",
        "problem",
        "operating.min_speed_hz",
        {"operating.min_speed_hz": 40},
        {"operating.min_speed_hz": 20},
    ),
    ("geometry", "problem", f"{BEARING}.pitch_diameter_mm", own(n_elements=16), own(n_elements=12)),
    (
        "geometry",
        "problem",
        f"{BEARING}.pitch_diameter_mm",
        own(element_diameter_mm=0.3126, pitch_diameter_mm=1.537),
        own(),
    ),
    (
        "geometry",
        "warning",
        f"{BEARING}.pitch_diameter_mm",
        own(element_diameter_mm=3.97),
        own(element_diameter_mm=6),
    ),
    ("geometry", "warning", "bearing[test].contact_angle_deg", own(contact_angle_deg=0.26), own(contact_angle_deg=15)),
    (
        "geometry",
        "warning",
        "bearing[test].clearance_um",
        {"bearing.0.clearance_um": 10000},
        {"bearing.0.clearance_um": 10},
    ),
    ("load", "problem", "operating.load_newton", {"operating.load_newton": 4}, {"operating.load_newton": 4000}),
    ("load", "problem", "operating.load_newton", {"operating.load_newton": 4e6}, {"operating.load_newton": 1e4}),
    ("load", "warning", "operating.load_newton", {"operating.load_newton": 2e4}, {"operating.load_newton": 1e4}),
    ("load", "warning", "operating.load_newton", {"operating.load_newton": 20}, {"operating.load_newton": 100}),
    ("rate", "problem", "source[logger].rate_hz", {"source.0.rate_hz": 25.6}, {"source.0.rate_hz": 25600}),
    ("rate", "problem", "source[logger].rate_hz", {"source.0.rate_hz": 205}, {"source.0.rate_hz": 2000}),
    ("rate", "warning", "source[logger].rate_hz", {"source.0.rate_hz": 1000}, {"source.0.rate_hz": 2000}),
    ("band", "problem", BAND, {"channel.0.band_hz": [2, 10]}, {"channel.0.band_hz": [2000, 10000]}),
    (
        "band",
        "problem",
        "channel[de].band_hz",
        {"channel.0.band_hz": [3000, 3100]},
        {"channel.0.band_hz": [3000, 4000]},
    ),
    (
        "band",
        "warning",
        "channel[de].band_hz",
        {"channel.0.band_hz": [3000, 3500]},
        {"channel.0.band_hz": [3000, 4000]},
    ),
    (
        "band",
        "problem",
        "channel[de].rms_band_hz",
        {"channel.0.rms_band_hz": [0, 9.5]},
        {"channel.0.rms_band_hz": [0, 9500]},
    ),
    ("block", "problem", "source[logger].block_s", {"source.0.block_s": 0.05}, {"source.0.block_s": 0.25}),
    ("block", "warning", "source[logger].block_s", {"source.0.block_s": 0.1}, {"source.0.block_s": 0.25}),
    (
        "block",
        "problem",
        "source[logger].block_revolutions",
        REVOLUTIONS | {"source.0.block_revolutions": 2},
        REVOLUTIONS,
    ),
    ("block", "warning", "source[logger].block_s", {"source.0.block_s": 500}, {"source.0.block_s": 50}),
    ("block", "warning", "source[logger].block_s", {"source.0.block_s": 5000}, {"source.0.block_s": 5}),
    ("block", "problem", "source[logger].block_s", {"source.0.block_s": 1e5}, {"source.0.block_s": 60}),
    (
        "tacho_rate",
        "problem",
        "operating.pulses_per_revolution",
        {"operating.tacho_channel": "t", "operating.pulses_per_revolution": 1024},
        {"operating.tacho_channel": "t", "operating.pulses_per_revolution": 60},
    ),
    ("mains", "warning", "bearing[test]", {"operating.speed_hz": 27.9}, {"operating.speed_hz": 29.0}),
    (
        "mains",
        "warning",
        "bearing[test]",
        {"operating.speed_hz": 27.9},
        {"operating.speed_hz": 27.9, "interference": [{"lines_hz": [50]}]},
    ),
    (
        "sensitivity",
        "problem",
        SENSITIVITY,
        {**VOLTS, "channel.0.sensitivity_mv_per_g": 0.1},
        VOLTS,
    ),
    (
        "sensitivity",
        "problem",
        SENSITIVITY,
        {**VOLTS, "channel.0.sensitivity_mv_per_g": 1e5},
        VOLTS,
    ),
    ("duplicate", "problem", "channel[b].column", {**TWO, "channel.1.column": 1}, TWO),
    ("duplicate", "problem", "source[other].url", SOURCES, {**SOURCES, "source.1.url": "folder:more"}),
    (
        "learning",
        "warning",
        "detect.learn_blocks",
        {"source.0.interval_s": 86400, "source.0.start_utc": "2024-01-01T00:00:00Z", "source.0.time_from": "count"},
        {"source.0.interval_s": 3600, "source.0.start_utc": "2024-01-01T00:00:00Z", "source.0.time_from": "count"},
    ),
    ("learning", "warning", "detect.learn_hours", {"detect.learn_hours": 0.01}, {"detect.learn_hours": 1}),
    (
        "end_of_life",
        "problem",
        "detect.end_of_life_peak_g",
        {"source.0.range_g": 16, "detect.end_of_life_peak_g": 20},
        {"source.0.range_g": 50, "detect.end_of_life_peak_g": 20},
    ),
    ("end_of_life", "warning", "detect.end_of_life_peak_g", {"source.0.range_g": 16}, {"source.0.range_g": 50}),
    (
        "end_of_life",
        "warning",
        "detect.end_of_life_peak_g",
        {"detect.end_of_life_peak_g": 500},
        {"detect.end_of_life_peak_g": 50},
    ),
    (
        "alarm_level",
        "problem",
        "alarms.level[rms].alert_g",
        {**LEVEL, "alarms.level.0.alert_g": 60, "source.0.range_g": 50},
        {**LEVEL, "source.0.range_g": 50},
    ),
    (
        "alarm_level",
        "problem",
        "alarms.level[rms].speed_range_hz",
        {**LEVEL, "alarms.level.0.speed_range_hz": [1700, 1900]},
        {**LEVEL, "alarms.level.0.speed_range_hz": [28, 32]},
    ),
    ("settle", "warning", "source[logger].settle_s", {"source.0.settle_s": 2000}, {"source.0.settle_s": 20}),
    ("alarm_level", "warning", "alarms.level[rms].alert_g", {**LEVEL, "alarms.level.0.alert_g": 3000}, LEVEL),
    (
        "threshold",
        "problem",
        "forecast.threshold_mm2",
        {**TRACKED, "forecast.threshold_mm2": 100.0},
        {**TRACKED, "forecast.threshold_mm2": 0.5},
    ),
    (
        "threshold",
        "warning",
        "forecast.threshold_mm2",
        {**TRACKED, "forecast.threshold_mm2": 10.0},
        {**TRACKED, "forecast.threshold_mm2": 0.5},
    ),
]
