"""The state of a channel in four sentences: what is wrong, how sure that is, the level and its trend, what to do.

The state comes first, then the part, then the level. Before the onset of the final stage a named part is a hint, and
is never called damage. How sure a name is follows from stated evidence and is a word, never a percentage of its own
making. A time is given only where a forecast with its status supports it.
"""

from __future__ import annotations

import math
import string
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from monitor.words.numbers import count, duration, figure, interval
from monitor.words.situation import Forecast, Situation
from monitor.words.statuses import ALARM_LEVELS, LEVEL_OF, STATES, UNDECIDED, fault_words, gear_words

ADVICE: Mapping[str, str] = {
    "normal": "nothing to do",
    "learning": "let it run as usual: alarms on learned levels begin when the baseline is complete",
    "watch": "look at the trends of {channel} at the next inspection",
    "gear": "inspect {gear} {when}; no part of {bearing} is named",
    "warning": "inspect {bearing} and plan its exchange {when}",
    "danger": "inspect {bearing} as soon as it can be reached, and exchange it {when}",
    "end_of_life": "stop the machine as soon as possible and exchange {bearing}",
    "sensor_fault": "check sensor, cable and mounting of {channel}: its data cannot be judged",
    "no_data": "check the logger and its connection: no data come from {channel}",
}
"""What to do by state, by default; ``[advice]`` replaces them."""
PLACES = ("bearing", "channel", "part", "gear", "when")
"""What may stand in braces in a text of advice."""
SURE_SUPPORT = 0.8
"""Share of the evidence of all channels of a bearing from which its verdict is called sure."""
_AT_BASELINE = (0.8, 1.25)
_NEXT_STOP = "at the next planned stop"
_LATE = ("final", "end_of_life")
_TRENDS = {
    "ok": "rising",
    "beyond_horizon": "hardly rising",
    "no_trend": "no clear rise",
    "too_few_points": "too few blocks yet for a trend",
}


@dataclass(frozen=True)
class Statement:
    """What is said of a channel; texts without a full stop, "" where there is nothing to say.

    Attributes:
        key: of the advice, one of ``ADVICE``.
        headline: the state, then the part.
        sureness: how sure the part is, and by which evidence.
        level: the level over the baseline, its trend, and the times that follow.
        action: what to do next.
    """

    key: str
    headline: str
    sureness: str
    level: str
    action: str

    @property
    def line(self) -> str:
        """All of it in one line."""
        return "; ".join(text for text in (self.headline, self.sureness, self.level, self.action) if text)

    def to_dict(self) -> dict[str, str]:
        """Return the keys of the interface."""
        return {name: getattr(self, name) for name in ("headline", "sureness", "level", "action")}


def state_of(found: Situation, advice: Mapping[str, str] = ADVICE) -> Statement:
    """Return what is said of a channel; ``advice`` has a text for each key of :data:`ADVICE`."""
    key = advice_key(found)
    gear = gear_words(found.gear, found.gear_kind)
    headline = f"{_headline(found)}; damage of {gear}" if gear else _headline(found)
    return Statement(key, headline, _sureness(found), _level(found), _action(advice[key], found))


def status_line(name: str, channel: Mapping[str, Any]) -> str:
    """Return what a channel's part of a status says, in one line; of a status that an older version wrote, too."""
    if channel.get("headline"):
        given = {key: str(channel.get(key) or "") for key in ("headline", "sureness", "level", "action")}
        return Statement("", **given).line
    return state_of(Situation.of_status(name, channel)).line


def advice_key(found: Situation) -> str:
    """Return which advice applies: missing or bad data outrank all but the end of life, as nothing newer is known."""
    gear_alone = bool(found.gear) and _part(found) is None
    if found.stage == "end_of_life":
        return "gear" if gear_alone else "end_of_life"
    if found.state in ("no_data", "bad_data"):
        return "no_data" if found.state == "no_data" else "sensor_fault"
    if gear_alone:
        # The level may be that of the wheel: it says nothing of the bearing.
        return "gear"
    if found.severity == "danger":
        return "danger"
    if found.level_of is not None and _part(found) is None:
        return "watch"
    if found.stage == "final" or _of_others(found):
        return "warning"
    if found.severity == "alert" or found.gear or (_part(found) is not None and found.stage == "healthy"):
        return "watch"
    return "learning" if found.stage in ("learning", "") else "normal"


def check_advice(text: str) -> None:
    """Raise ValueError where a text of advice has other braces than those of :data:`PLACES`."""
    allowed = ", ".join(f"{{{name}}}" for name in PLACES)
    try:
        names = {
            (name, more, conversion) for _, name, more, conversion in string.Formatter().parse(text) if name is not None
        }
    except ValueError as error:
        raise ValueError(f"expected a text with no other braces than {allowed} ({error})") from None
    wrong = sorted(name for name, more, conversion in names if name not in PLACES or more or conversion)
    if wrong:
        raise ValueError(f"expected a text with no other braces than {allowed}, found {{{wrong[0]}}}")


def _part(found: Situation) -> str | None:
    """Return the part by all channels, else by the channel itself, the candidates where it is undecided."""
    if found.bearing_fault is not None and found.bearing_fault != UNDECIDED:
        return found.bearing_fault
    if found.fault == UNDECIDED:
        return "|".join(found.candidates) or UNDECIDED
    return found.fault


def _of_others(found: Situation) -> bool:
    """Return whether other channels of the bearing saw the onset of its damage, and this one did not."""
    return found.stage not in _LATE and found.bearing_basis == "verdict" and found.bearing_fault is not None


def _basis(found: Situation) -> str:
    """Return what the name is; records of older versions have none."""
    return found.bearing_basis or found.basis or ("verdict" if found.stage in _LATE else "hint")


def _undecided(found: Situation) -> bool:
    return found.fault == UNDECIDED and found.bearing_fault in (None, UNDECIDED)


def bearing_name(name: str) -> str:
    """Return a bearing in a sentence: "bearing drive", and no "bearing" twice where its name has it."""
    if name.lower() in ("", "bearing"):
        return "the bearing"
    return name if "bearing" in name.lower() else f"bearing {name}"


def _of_bearing(found: Situation) -> str:
    return f" of {bearing_name(found.bearing)}" if found.bearing else ""


def _part_words(found: Situation) -> str:
    part = _part(found)
    if part is None:
        return ""
    if part == UNDECIDED:
        return f"a part{_of_bearing(found)} that the stated speed does not decide"
    undecided = " (not decided which)" if _undecided(found) else ""
    return f"{fault_words(part)}{_of_bearing(found)}{undecided}"


def _headline(found: Situation) -> str:
    states = _state_words(found)
    if found.level_of is not None and _part(found) is None:
        return f"{states}; no part of its own named: {LEVEL_OF} {found.level_of}"
    part = _part_words(found)
    if not part:
        return f"{states}; no part named" if found.stage in _LATE else states
    if found.stage in _LATE and _basis(found) == "verdict":
        return f"{states}: {part}"
    if _of_others(found):
        return f"{states}; other channels see damage: {part}"
    return f"{states}; a pattern of the {part} (hint)" if _part(found) != UNDECIDED else f"{states}; {part} (hint)"


def _state_words(found: Situation) -> str:
    """Return the state: data first where they fail, then the worst alarm, then the stage of life."""
    text = {
        "end_of_life": "end of life reached",
        "final": "final stage of its life",
        "healthy": "no onset of damage so far" if found.severity else "healthy so far",
        "learning": "still learning what healthy is",
        "": "no block judged yet",
    }.get(found.stage, found.stage)
    if _of_others(found):
        text += " on this channel"
    if found.state in ("no_data", "bad_data"):
        return f"{STATES[found.state][0].lower()}; before: {text}"
    return f"{found.severity}, {text}" if found.severity else text


def _sureness(found: Situation) -> str:
    """Return how sure the name of the part is, and the evidence for it."""
    if _part(found) is None:
        return ""
    evidence = ", ".join(_evidence(found))
    return f"{_sure_word(found)}: {evidence}" if evidence else _sure_word(found)


def _sure_word(found: Situation) -> str:
    if _undecided(found):
        return "not decided"
    if _basis(found) != "verdict":
        return "only a hint"
    agreed = found.support is not None and found.support >= SURE_SUPPORT and not found.disagreement
    return "sure" if agreed and found.unverified is False else "likely"


def _evidence(found: Situation) -> Iterator[str]:
    if _basis(found) == "verdict":
        yield "named since the onset" + (f", {count(found.blocks, 'block')} ago" if found.blocks else "")
    else:
        yield "named without an onset of damage" if found.stage != "learning" else "named before a baseline is learned"
    if math.isfinite(found.snr):
        yield f"lines {figure(found.snr, 2)} times the noise floor"
    if found.support is not None and found.channels > 1:
        yield f"{100.0 * found.support:.0f} % of the evidence of {found.channels} channels"
    for channel, other in found.disagreement.items():
        yield f"{channel} says {fault_words(other)}"
    if found.unverified is not None:
        yield "the shaft speed is only stated" if found.unverified else "the shaft speed is known"


def _level(found: Situation) -> str:
    if found.stage in ("", "learning"):
        return ""
    texts = []
    if math.isfinite(found.level):
        near = _AT_BASELINE[0] <= found.level <= _AT_BASELINE[1]
        texts.append(f"level {figure(found.level, 2)} times the baseline" if not near else "level at the baseline")
    texts += _trend(found.to_alarm) if found.stage in _LATE else ()
    texts += _threshold(found)
    return ", ".join(texts)


def _trend(to_alarm: Forecast) -> Iterator[str]:
    if to_alarm.status == "reached":
        yield f"{ALARM_LEVELS.get(to_alarm.to, 'the alarm level')} is reached"
        return
    trend = _TRENDS.get(to_alarm.status or "")
    if trend is not None:
        yield trend
    if to_alarm.status == "ok" and math.isfinite(to_alarm.time):
        yield f"{ALARM_LEVELS.get(to_alarm.to, 'the alarm level')} in {_time_words(to_alarm)}"


def _threshold(found: Situation) -> Iterator[str]:
    if found.to_threshold.status == "already_crossed" and found.calibrated:
        yield "the threshold of damage is reached"
    elif _supported(found):
        yield f"the threshold of damage in {_time_words(found.to_threshold)}"


def _time_words(forecast: Forecast) -> str:
    ends = interval(forecast.lower, forecast.upper, duration)
    return duration(forecast.time) + (f" ({ends})" if ends else "")


def _supported(found: Situation) -> bool:
    """Return whether the time to the threshold may be relied upon."""
    return found.calibrated and found.to_threshold.status == "ok" and math.isfinite(found.to_threshold.time)


def _action(text: str, found: Situation) -> str:
    part = _part(found)
    places: dict[str, Any] = {
        "bearing": bearing_name(found.bearing),
        "channel": f"channel {found.channel}" if found.channel else "the channel",
        "part": "no part named" if part is None or part == UNDECIDED else fault_words(part),
        "gear": gear_words(found.gear) or "no gear named",
        "when": _when(found),
    }
    return text.format(**places)


def _when(found: Situation) -> str:
    """Return by when: before the earliest time that a forecast supports, else at the next planned stop.

    Of a wheel there is no forecast: without delay where the level is that of a danger or the end of a life.
    """
    if advice_key(found) == "gear":
        return "without delay" if found.severity == "danger" or found.stage == "end_of_life" else _NEXT_STOP
    if found.to_threshold.status == "already_crossed" and found.calibrated:
        return "without delay: the threshold of damage is reached"
    if _supported(found) and math.isfinite(found.to_threshold.lower):
        return _within(found.to_threshold.lower, "the threshold of damage")
    if found.to_alarm.status == "ok" and math.isfinite(found.to_alarm.time):
        earliest = found.to_alarm.lower if math.isfinite(found.to_alarm.lower) else found.to_alarm.time
        return _within(earliest, ALARM_LEVELS.get(found.to_alarm.to, "the alarm level"))
    return _NEXT_STOP


def _within(earliest: float, what: str) -> str:
    if earliest <= 0.0:
        return f"without delay: {what} may be reached already"
    return f"within {duration(earliest)}, the earliest that {what} may be reached"
