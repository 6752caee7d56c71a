"""Statuses of channels, blocks, V_eq and TT as text for people, and all words of the page as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from monitor.words.features import FEATURES
from monitor.words.parts import PARTS
from monitor.words.zones import ZONE_MEANINGS

FAULT_NAMES = {part.name: part.words for part in PARTS}

UNDECIDED = "undecided"
"""What is named where the error of the stated speed decides which part it is."""

LINE_NAMES = {part.name: part.line for part in PARTS}

STATES = {
    "failure": ("Failure", "a danger stands, or the end of life was reached"),
    "no_data": ("No data", "no block comes"),
    "bad_data": ("Bad data", "too many blocks are rejected or flagged"),
    "out_of_specification": ("Out of specification", "how large the damage is cannot be said"),
    "maintenance_required": (
        "Maintenance required",
        "an alert stands, the final stage has begun, or a gear is damaged",
    ),
    "check_function": ("Function check", "the baseline is being learned"),
    "normal": ("Normal", "healthy"),
}
"""Status after NAMUR NE 107, with ``no_data`` and ``bad_data``: its name and what it means. Worst first: a danger
outranks missing data, missing and bad data outrank a size that is not known."""

STAGES = {"learning": "learning", "healthy": "healthy", "final": "final stage", "end_of_life": "end of life"}

DAEMON = {
    "stopped": "The daemon was stopped",
    "died": "The daemon has died",
    "never_ran": "The daemon has never run",
    "starting": "The daemon is starting",
    "stalled": "The daemon is stalled",
}

BASES = {
    "verdict": ("verdict", "named since the onset of the final stage"),
    "hint": ("hint", "named without an onset, or without a baseline"),
}
"""What a name of the damaged part is, and why."""

EDV_REFUSALS = {
    "below_map": "the vibration is weaker than that of the smallest damage of the map",
    "above_map": "the vibration is stronger than that of any damage of the map: either the damage is larger than the "
    "map reaches, or the map does not fit this machine",
    "no_map": "there is no RMS map for this channel, or it has a hole at this level",
    "no_library": "there is no library of simulated lives for this machine",
    "not_final_stage": "the bearing is not in the final stage of its life",
    "bad_block": "the quality of the latest block does not allow it",
    "ambiguous": "several sizes of damage explain the vibration equally well",
    "outside_conditions": "load or speed lie outside the map",
    "outside_library": "load or speed lie outside the library",
    "no_absolute_level": "the unit of the sensor is not known, so that the level of vibration means nothing",
    "uncalibrated": "the rig is not calibrated: V_eq can only be compared with its own first value",
    "episode_closed": "the final stage closed again, and its V_eq with it",
    "implausible": "no growth of damage gives this vibration after what was measured before: the sensor or its "
    "gain may have changed, or something else vibrates",
    "not_this_part": "there is no RMS map or library of the part that is named",
    "velocity_sensor": "the sensor measures a velocity: its acceleration is known in a band, not over all frequencies "
    "as that of maps and libraries",
}
TT_REFUSALS = {
    "not_final_stage": "the bearing is not in the final stage of its life",
    "too_few_points": "there are too few values of V_eq yet to see a trend",
    "no_crossing": "the fitted trend never reaches the threshold",
    "concave": "the fitted trend flattens out before the threshold",
    "crossing_in_past": "the fitted trend crosses the threshold in the past, though V_eq has not reached it",
    "beyond_horizon": "the threshold lies beyond the horizon of the forecast",
    "no_library": "there is no library of simulated lives for this machine",
    "outside_library": "load or speed lie outside the library",
    "cannot_tell": "the forecast cannot tell",
    "uncalibrated": "the rig is not calibrated, so that V_eq cannot be compared with the threshold",
    "episode_closed": "the final stage closed again, and its forecasts with it",
    "no_growth": "the damage more likely than not stands still",
}
TTA_REFUSALS = {
    "no_trend": "the level does not grow towards it: the trend, continued three times as long, does not reach it",
    "too_few_points": "there are too few blocks since the onset yet to see a trend",
    "not_final_stage": "the bearing is not in the final stage of its life",
    "learning": "what healthy means is being learned",
    "no_level": "the level of the alarm does not apply at the present speed or load",
    "bad_block": "the quality of the latest block does not allow it, or the machine stands still",
    "episode_closed": "the final stage closed again",
}
ALARM_LEVELS = {"alert": "the alert", "danger": "the danger", "default": "four times the baseline"}
"""What level the time to the alarm level leads to."""
VELOCITY_REFUSALS = {
    "short": "a block shorter than a second holds too few periods of 10 Hz",
    "low_rate": "sampled at less than 2,560 Hz, a block does not reach 1,000 Hz",
    "low_frequency_noise": "most of it would be a continuous part that rises towards low frequencies, where noise or "
    "drift of the sensor cannot be told from vibration",
    "no_absolute_level": "the unit of the sensor is not known",
    "sensor_limit": "the sensor of velocity does not reach 1,000 Hz (sensor_max_hz)",
}
"""Why no velocity is given."""
ROTATION_REFUSALS = {
    "none": "no pulses and no speed over time came with the block",
    "too_few": "too few pulses or turns fell into the block",
    "irregular": "the pulses do not fit a shaft that turns",
    "reversed": "the shaft turned back",
    "stopped": "the shaft stood still in the block",
    "cannot_tell": "the vibration does not show the angle of the shaft well enough",
    "too_wide": "the highest speed in the block is more than six times the least",
}
"""Why the angle of the shaft over a block is not known, by ``rotation_status``."""
DOMAINS = {
    "hertz": "spectra in Hz",
    "order": "spectra in orders of the shaft",
}
"""What the spectra of a block are over."""
NAMED = "gear:"
"""Beginning of the value of ``fault`` that names a wheel."""

GEAR_KINDS = {
    "tooth": "a damaged tooth",
    "eccentric": "an eccentric wheel",
    "uncertain": "of which kind is open",
}
"""What may be wrong with a wheel that is named, a hint."""

GEAR_STATUSES = {
    "ok": "judged",
    "learning": "what healthy means for it is being learned",
    "too_short": "the block holds too few turns of it",
    "no_angle": "the angle of its shaft is not known well enough",
    "above_band": "the sampling rate does not hold its mesh",
    "outside_conditions": "speed or load is beyond what was learned",
    "bad_block": "the quality of the block does not allow it",
}
"""Whether a wheel was judged in a block, or why not, by ``gear_status``."""
BAND_SOURCES = {
    "configured": "as configured",
    "learning": "found on the learning window, then frozen",
    "recording": "found on this recording itself",
    "provisional": "provisional, while the learning window lasts",
}
STATUS_MEANINGS = {
    "ok": "accepted",
    "flat": "all samples are equal",
    "stopped": "the machine stood still",
    "clipped": "the sensor was at its limit",
    "gap": "blocks are missing before it",
    "clock": "its time cannot be right",
    "late": "came after younger blocks",
    "out_of_order": "came out of order",
    "outside_speed": "outside the configured speeds",
    "filled": "lost samples were filled with a constant",
    "empty": "holds no samples",
    "short": "shorter than a block should be",
    "nan": "holds samples that are not finite",
    "out_of_range": "samples beyond the sensor's range",
    "wrong_rate": "sampled at another rate",
    "wrong_shape": "another number of channels or columns",
    "wrong_unit": "another unit than configured",
    "unreadable": "could not be read",
    "incomplete": "was never finished",
    "refused": "a link, a device, a path outside the folder, or beyond a limit",
    "reader_crashed": "the reader of its format gave up",
    "duplicate": "had been taken before",
    "changed": "its place was taken by another content",
    "poisoned": "set aside: the monitor died while it handled it",
}
_CHARTS = {
    "rms": {"title": "Vibration, RMS"},
    "velocity": {"title": "Velocity, RMS from 10 to 1000 Hz"},
    "lines": {"title": "Lines of the damaged parts in the envelope spectrum"},
    "kurtosis": {"title": "Kurtosis", "unit": "3 for a healthy bearing's noise"},
    "peak": {"title": "Peak"},
    "v_eq": {"title": "Damaged volume V_eq", "unit": "mm³ per mm of width"},
    "v_eq_relative": {"title": "Damaged volume V_eq, relative", "unit": "times the first tracked value"},
    "tt": {"title": "Time to threshold"},
    "speed": {"title": "Shaft speed"},
    "load": {"title": "Load"},
    "level_rms": {"title": "RMS over that expected at speed and load", "unit": "1 as learned"},
}
"""Titles of charts in their order, and units where they are not those of the features."""


def suspended_words(rules: Sequence[str]) -> str:
    """Return that the levels of some rules are not applied, and why."""
    levels = ", ".join(map(repr, rules))
    return f"{'levels' if len(rules) > 1 else 'level'} {levels} not applied: the rig is not calibrated"


def fault_words(fault: str) -> str:
    """Return the damaged part for people, "inner race or rolling element" where two cannot be told apart."""
    if fault.startswith(NAMED):
        return gear_words(fault)
    return " or ".join(FAULT_NAMES.get(name, name) for name in fault.split("|"))


def speed_doubt(fault: str | None, candidates: Sequence[str], unverified: bool | None) -> str | None:
    """Return what the shaft speed leaves open about a named part, None where nothing."""
    if fault is None or not unverified:
        return None
    if candidates:
        parts = fault_words("|".join(candidates))
        return f"the signal does not show the shaft, and the stated speed does not decide between {parts}"
    return "the shaft speed is as stated; the signal does not show it"


def named_words(fault: str, basis: str | None) -> str:
    """Return the damaged part for people, and that it is only a hint where it is."""
    return f"{fault_words(fault)} (a hint)" if basis == "hint" else fault_words(fault)


def speed_words(status: str | None, domain: str | None, least: float | None, highest: float | None) -> str | None:
    """Return the speeds in a block and what its spectra are over, or why there is no angle.

    None of a machine without a source of one.

    Args:
        status, domain: ``rotation_status`` and ``domain`` of its record.
        least, highest: speed, Hz.
    """
    if status is None:
        return None
    if status != "ok":
        return f"no angle of the shaft: {ROTATION_REFUSALS.get(status, status)}; {DOMAINS['hertz']}"
    spectra = DOMAINS.get(domain or "hertz", "")
    if least is None or highest is None:
        return spectra
    return f"{range_words(least, highest)} in this block; {spectra}"


def range_words(least: float, highest: float) -> str:
    """Return the speeds, Hz, as "speed from 22.1 to 27.9 Hz", or as one where three figures are the same."""
    low, high = f"{least:.3g}", f"{highest:.3g}"
    return f"speed {low} Hz" if low == high else f"speed from {low} to {high} Hz"


def gear_words(fault: str | None, kind: str | None = None) -> str:
    """Return a named wheel for people, "" for none; several that turn alike cannot be told apart."""
    if fault is None or not fault.startswith(NAMED):
        return ""
    words = "gear " + " or ".join(fault.removeprefix(NAMED).split("|"))
    return f"{words} ({GEAR_KINDS[kind]})" if kind in GEAR_KINDS else words


def gears_line(channel: Mapping[str, Any]) -> str:
    """Return what a channel's status says of its wheels in one line, "" without gears."""
    gears: Mapping[str, Mapping[str, Any]] = channel.get("gears") or {}
    if not gears:
        return ""
    named = gear_words(channel.get("gear_fault"), channel.get("gear_kind"))
    statuses = {name: str(found.get("status")) for name, found in gears.items()}
    refused = [f"{name}: {GEAR_STATUSES.get(status, status)}" for name, status in statuses.items() if status != "ok"]
    return "; ".join([named or "no gear named", *refused])


LEVEL_OF = "its level rises with the damage of"
"""Followed by the name of the bearing whose damage a neighbour without a part of its own hears."""


def level_words(level_of: str | None) -> str:
    """Return whose damage raises the level of a bearing, after its name; "" for that of none."""
    return "" if level_of is None else f"; {LEVEL_OF} {level_of}"


def bearing_words(found: Mapping[str, Any]) -> str:
    """Return what the channels of a bearing say together, by its keys of the interface; without a full stop."""
    if found["fault"] is None:
        return "no part named" + level_words(found.get("level_of"))
    text = f"{fault_words(found['fault'])}, {BASES[found['fault_basis']][0]}, support {100.0 * found['support']:.0f} %"
    others = [f"{channel} says {fault_words(other)}" for channel, other in found["disagreement"].items()]
    return "; ".join((text, *others)) + level_words(found.get("level_of"))


COLUMN_KINDS = {"time": "times", "index": "running numbers", "tacho": "pulses of a tacho", "other": "left out"}
ORIGINS = {"stated": "the files", "answered": "your answer", "assumed": "default", "open": "not known yet"}
"""What a column of a recording is read as, where it is not the word itself, and by what a reading is known."""


def page_words() -> dict[str, Any]:
    """Return all words of the page as plain values."""
    titles = {feature.chart: {"title": feature.label.capitalize()} for feature in FEATURES.values() if feature.chart}
    return {
        "states": STATES,
        "stages": STAGES,
        "parts": FAULT_NAMES,
        "lines": LINE_NAMES,
        "bases": BASES,
        "level_of": LEVEL_OF,
        "daemon": DAEMON,
        "blocks": STATUS_MEANINGS,
        "edv": EDV_REFUSALS | {"widened": "the interval is wider than usual, as the latest levels jumped"},
        "tt": TT_REFUSALS | {"already_crossed": "the threshold has been reached"},
        "tta": TTA_REFUSALS,
        "velocity": VELOCITY_REFUSALS,
        "zones": ZONE_MEANINGS,
        "rotation": ROTATION_REFUSALS,
        "domains": DOMAINS,
        "gears": GEAR_STATUSES,
        "columns": COLUMN_KINDS,
        "origins": ORIGINS,
        "gear_kinds": GEAR_KINDS,
        "alarm_levels": ALARM_LEVELS,
        "relative": _CHARTS["v_eq_relative"]["unit"],
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
