"""Events as sentences for people, with values in the units of the workshop."""

from __future__ import annotations

import json
import zoneinfo
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from monitor.words.features import FEATURES, Feature
from monitor.words.statuses import STATES, fault_words, gear_words

SEVERITIES = ("danger", "alert")
"""From the worst."""
_RANKS = (
    *("end_of_life", "danger", "final_stage", "records_kept", "store_salvaged", "file_poisoned", "stays_down"),
    *("alert", "no_data", "condition"),
)
_GOOD = (
    *("alarm_cleared", "alarm_released", "alarm_withdrawn", "condition", "data_again", "stream_reset"),
    *("baseline_relearned", "final_stage_closed"),
)
_SHOWN_APART = ("kind", "channel", "source", "block")


def event_text(body: Mapping[str, Any], *, absolute: bool = True) -> str:
    """Return one sentence, without a full stop, for an event or a notice of the log; never with a line break.

    Args:
        body: as the log has it; keys that it should have may be missing.
        absolute: whether accelerations are in m/s2.
    """
    kind = str(body.get("kind") or "event")
    if kind.startswith("alarm_"):
        text = _alarm(kind, body, absolute)
    elif kind == "condition":
        states = [str(body.get(key)) for key in ("from", "to")]
        before, after = (STATES[state][0].lower() if state in STATES else state for state in states)
        text = f"status {after} (before: {before})"
    elif kind == "final_stage":
        text = "the final stage of its life has begun"
        if "t_fs_block" in body and body["t_fs_block"] != body.get("block"):
            text += f", with block {body['t_fs_block']}"
    elif kind == "final_stage_closed":
        text = f"the final stage that began with block {body.get('t_fs_block')} is over: the machine is back at its "
        text += f"baseline since block {body.get('quiet_since_block')}, and what was said of its damage is withdrawn"
    elif kind == "baseline_relearned":
        before, after = (
            None if body.get(key) is None else FEATURES["rms"].write(float(body[key]), absolute=absolute)
            for key in ("rms_before_si", "rms_after_si")
        )
        text = f"the baseline was learned anew, as the machine stayed well below it: RMS {after}, before {before}"
    elif kind == "fault_changed":
        before, after = (fault_words(str(body.get(key))) for key in ("from", "to"))
        text = _gears(body) or f"the verdict on {body.get('bearing')} names the {after} now, before the {before}"
    elif kind == "end_of_life":
        text = "the end of its life is reached"
    else:
        said = body.get("text") or body.get("reason") or body.get("problem")
        text = kind.replace("_", " ") + (f": {said}" if said else _others(body))
    return " ".join(text.split())


def _gears(body: Mapping[str, Any]) -> str:
    """Return what is said of a wheel that is named or no longer named, "" of a bearing."""
    before, after = (gear_words(body.get(key), body.get("gear_kind")) for key in ("from", "to"))
    if after:
        return f"damage of {after} is named now"
    return f"no damage of {before} is named any more" if before else ""


def _alarm(kind: str, body: Mapping[str, Any], absolute: bool) -> str:
    feature, severity = str(body.get("feature", "")), str(body.get("severity") or "alarm")
    known = FEATURES.get(feature, Feature(feature, label=feature.replace("_", " ") or "value"))
    rule = f" (rule {body['rule']})" if body.get("rule") not in (None, feature) else ""
    if kind not in ("alarm_raised", "alarm_cleared"):
        text = f"{severity} of {known.label} {kind.removeprefix('alarm_').replace('_', ' ')}{rule}"
        return text + (", as the final stage is over" if kind == "alarm_withdrawn" else "")
    value, level = (
        None if body.get(key) is None else known.write(float(body[key]), absolute=absolute)
        for key in ("value_si", "level_si")
    )
    if kind == "alarm_raised":
        side = known.bad or "above"
        return f"{severity}: {known.label} is {value}, {side} the level of {level}{rule}"
    return f"{severity} over: {known.label} is {value} again, the level is {level}{rule}"


def _others(body: Mapping[str, Any]) -> str:
    rest = {key: value for key, value in body.items() if key not in _SHOWN_APART and value not in (None, "")}
    listed = ", ".join(
        f"{key} {value}" if isinstance(value, str | int | float) else f"{key} {json.dumps(value)}"
        for key, value in rest.items()
    )
    return f": {listed[:300]}" if listed else ""


def badness(body: Mapping[str, Any]) -> int:
    """Return how bad an event is, 0 for good news; to tell the worst first."""
    kind = str(body.get("kind", ""))
    if kind == "fault_changed" and body.get("to") is None:
        return 0
    word = str(body.get("severity", "")) if kind == "alarm_raised" else kind
    if kind == "condition" and body.get("to") not in ("bad_data", "out_of_specification", "failure"):
        return 0
    return len(_RANKS) - _RANKS.index(word) if word in _RANKS else int(kind not in _GOOD)


def local_moment(time: float | None, zone: str = "UTC") -> str | None:
    """Return a moment (UTC seconds since 1970) in a time zone, and in UTC where that is another; None where none."""
    if time is None:
        return None
    try:
        utc = datetime.fromtimestamp(0, UTC) + timedelta(seconds=time)
        local = utc.astimezone(zoneinfo.ZoneInfo(zone))
    except (OverflowError, ValueError, zoneinfo.ZoneInfoNotFoundError):
        return None
    if local.utcoffset() == timedelta(0):
        return f"{utc:%Y-%m-%d %H:%M:%S} UTC"
    other = f"{utc:%H:%M:%S}" if utc.date() == local.date() else f"{utc:%Y-%m-%d %H:%M:%S}"
    return f"{local:%Y-%m-%d %H:%M:%S %Z} ({other} UTC)"


def utc_text(time: float | None) -> str | None:
    """Return a moment (UTC seconds since 1970) as programs read it; None where there is none, or no date has it."""
    if time is None:
        return None
    try:
        return datetime.fromtimestamp(time, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    except (OverflowError, OSError, ValueError):
        return None
