"""Zones that files state of their times: offsets from UTC, names and abbreviations, and when they leave it open."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from datetime import datetime
from zoneinfo import ZoneInfo, available_timezones

import numpy as np

from streams.files.keys import SUMMER_KEYS, ZONE_KEYS
from streams.files.statements import Facts, named
from streams.types.spellings import ZONE_HOURS
from streams.types.stamps import Stamp, read_stamp

_HOUR, _MAX_HOURS = 3600.0, 14.0
_SIZES = {"h": _HOUR, "m": 60.0, "s": 1.0}
_REGIONS = {
    **dict.fromkeys(("w. europe", "mitteleuropaische", "heure normale d'europe centrale"), "Europe/Berlin"),
    "central europe": "Europe/Budapest",
    "central european": "Europe/Warsaw",
    "romance": "Europe/Paris",
    **dict.fromkeys(("gmt", "british"), "Europe/London"),
    "westeuropaische": "Europe/Lisbon",
    "osteuropaische": "Europe/Helsinki",
    "fle": "Europe/Helsinki",
    "gtb": "Europe/Bucharest",
    "turkey": "Europe/Istanbul",
    "russian": "Europe/Moscow",
    "eastern": "America/New_York",
    "central": "America/Chicago",
    "mountain": "America/Denver",
    "us mountain": "America/Phoenix",
    "pacific": "America/Los_Angeles",
    "alaskan": "America/Anchorage",
    "hawaiian": "Pacific/Honolulu",
    "atlantic": "America/Halifax",
    "newfoundland": "America/St_Johns",
    "e. south america": "America/Sao_Paulo",
    "south africa": "Africa/Johannesburg",
    "israel": "Asia/Jerusalem",
    "china": "Asia/Shanghai",
    "taipei": "Asia/Taipei",
    "tokyo": "Asia/Tokyo",
    "korea": "Asia/Seoul",
    "india": "Asia/Kolkata",
    "singapore": "Asia/Singapore",
    "se asia": "Asia/Bangkok",
    "arabian": "Asia/Dubai",
    "aus eastern": "Australia/Sydney",
    "e. australia": "Australia/Brisbane",
    "w. australia": "Australia/Perth",
    "new zealand": "Pacific/Auckland",
}
"""Zones by the names that Windows gives them, without "standard time"."""
_NOT_SUMMER = ("", "0", "off", "no", "false", "none", "nein", "aus", "non", "disabled", "inactive", "winter", "-")
_NAMED = re.compile(r"(.+?)\s*(standard ?time|daylight ?time|summer ?time|sommerzeit|winterzeit|normalzeit|zeit|time)")
_SEASONS = {"standard": False, "winterzeit": False, "normalzeit": False}
_SEASONS |= {"daylight": True, "summer": True, "sommerzeit": True}
_OFFSET = re.compile(
    r"(?:UTC|GMT|Z)?\s*(?P<sign>[+-]?)\s*(?:(?P<H>\d{1,2}):(?P<M>\d\d)(?::00)?"
    r"|(?P<number>\d{1,5}(?:[.,]\d+)?))\s*(?P<unit>h|hr|hrs|hours?|std|stunden|min|minutes?|s|sec|seconds?)?",
    re.IGNORECASE,
)
_DISPLAYED = re.compile(r"\((?:UTC|GMT)\s*(?P<offset>[+-]\d\d:?\d\d)?\)\s*(?P<words>.+)", re.IGNORECASE)


@dataclass(frozen=True)
class StatedZone:
    """A zone as one place states it.

    Attributes:
        place: as messages call it.
        written: as it stands there.
        name: IANA name, "UTC" for an offset; "" where it is not understood.
        offset: s east of UTC; of a named zone what it must be at the time of a stamp, None where that is not stated.
        summer: whether that time must be one of summer time, None where that is not stated.
    """

    place: str
    written: str
    name: str = ""
    offset: float | None = None
    summer: bool | None = None

    def stamp(self, stamp: Stamp) -> Stamp | None:
        """Return a stamp without a zone, in this one; None where that is open at its time."""
        found = read_stamp(stamp.text, self.name) if self.name else None
        if found is None:
            return None
        if self.name == "UTC":
            return replace(found.later(-(self.offset or 0.0)), local=False)
        for time in found.readings:
            if not self._fits(datetime.fromtimestamp(time, ZoneInfo(self.name))):
                return None
        return replace(found, local=False)

    def _fits(self, moment: datetime) -> bool:
        offset, summer = moment.utcoffset(), bool(moment.dst())
        own = 0.0 if offset is None else offset.total_seconds()
        return self.offset in (None, own) and self.summer in (None, summer)


def in_stated_zone(facts: Facts, stamp: Stamp) -> tuple[Stamp, str]:
    """Return a stamp in the zone that plain keys state, and what leaves it open, as it is written, or "".

    A stamp that names its zone stays as it is.
    """
    zones = [one for key, place, value in named(facts, ZONE_KEYS) if (one := _stated_zone(key, place, value))]
    if not zones or not stamp.local:
        return stamp, ""
    read = [one.stamp(stamp) for one in zones]
    first = read[0]
    # An offset may be that of winter.
    summer = [
        f"{place} {str(value)!r}"
        for _, place, value in named(facts, frozenset(SUMMER_KEYS))
        if str(value).strip().lower() not in _NOT_SUMMER and all(one.offset is not None for one in zones)
    ]
    if first is None or summer or any(one is None or one.readings != first.readings for one in read):
        return stamp, " and ".join([*(f"{one.place} {one.written!r}" for one in zones), *summer])
    return first, ""


def _stated_zone(key: str, place: str, value: object) -> StatedZone | None:
    """Return the zone that a value under a plain key states, None where it states none."""
    text = f"{value:g}" if isinstance(value, float | np.floating) else str(value).strip().strip("\"'")
    text = text.replace("\N{MINUS SIGN}", "-")
    if text.lower() in ("", "-", "local", "local time", "none", "n/a", "unknown", "auto"):
        return None
    offset = offset_in(text, ZONE_KEYS[key])
    if offset is not None:
        return StatedZone(place, text, "UTC", offset)
    if text.upper() in ZONE_HOURS:
        return StatedZone(place, text, "UTC", _HOUR * ZONE_HOURS[text.upper()])
    if text in available_timezones():
        return StatedZone(place, text, text)
    displayed = _DISPLAYED.fullmatch(text)
    if displayed is not None:
        # Windows shows the offset of winter all the year.
        name = _region(displayed["words"])[0] or _city(displayed["words"])
        return StatedZone(place, text, name, offset_in(displayed["offset"] or "+00:00", "h"))
    name, summer = _region(text)
    return StatedZone(place, text, name, summer=summer)


def offset_in(text: str, unit: str) -> float | None:
    """Return an offset in s; ``unit`` is that of its key. None where it is open.

    Zones are quarters of an hour from UTC, up to 14 h, and none less than 1 h: of a number without a unit that leaves
    hours, minutes or seconds. ``-0530`` has a sign.
    """
    match = _OFFSET.fullmatch(text)
    if match is None:
        return None
    digits, named = match["number"] or "", (match["unit"] or unit).lower().replace("std", "h")[:1]
    if match["H"] is not None:
        readings = [_HOUR * int(match["H"]) + 60.0 * int(match["M"])]
    elif re.fullmatch(r"(0\d|1[0-4])[0-5]\d", digits) and not named:
        readings = [_HOUR * int(digits[:2]) + 60.0 * int(digits[2:])] if match["sign"] else []
    else:
        number = float(digits.replace(",", "."))
        readings = [number * size for size in ([_SIZES[named]] if named else _SIZES.values())]
        readings = [one for one in readings if named or not 0.0 < one < _HOUR]
    found = {one for one in readings if one <= _MAX_HOURS * _HOUR and not one % 900.0}
    if len(found) != 1:
        return None
    return -found.pop() if match["sign"] == "-" else found.pop()


def _region(text: str) -> tuple[str, bool | None]:
    """Return the zone that Windows calls so, "" for none, and whether it is named as that of summer time."""
    plain = re.sub(r"\s*\(.*\)$", "", text.lower().replace("ä", "a")).strip()
    match = _NAMED.fullmatch(plain)
    if match is None:
        return _REGIONS.get(plain, ""), None
    return _REGIONS.get(match[1], ""), _SEASONS.get(match[2].removesuffix("time").strip())


def _city(words: str) -> str:
    """Return the zone of the first city of a list that has one, "" for none."""
    cities = {name.rpartition("/")[2].replace("_", " "): name for name in sorted(available_timezones()) if "/" in name}
    return next((cities[city.strip()] for city in words.split(",") if city.strip() in cities), "")
