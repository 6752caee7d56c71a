"""Quantities, durations and moments as text for people, in the units of the workshop."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from zoneinfo import ZoneInfo


def volume(value: float) -> str:
    """Return a damaged volume per unit of width (m2) in mm3/mm."""
    return f"{value * 1e6:.3g} mm³/mm"


def times_first(value: float) -> str:
    """Return V_eq as a multiple of the first value that was tracked."""
    return f"{value:.3g} times the first tracked value"


def floor_of_defect(kind: str, sd: float) -> str:
    """Return a defect's floor; ``sd`` is the standard deviation of a rough one, m."""
    if kind != "rough":
        return kind
    return (
        f"rough, standard deviation {sd * 1e6:.3g} µm after filtering; by R = 10 µm Gabrielli (section 5.2.1) scales "
        "the profile, here it sets the cut-off alone"
    )


def duration(seconds: float) -> str:
    """Return a duration (s) in words, to about two figures: "45 s", "12 min", "2 h 10 min", "3 d 4 h"."""
    if seconds < 0:
        return f"−{duration(-seconds)}"
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"{minutes} min"
    hours, minutes = divmod(minutes, 60)
    if hours < 48:
        return f"{hours} h {minutes} min" if minutes else f"{hours} h"
    days, hours = divmod(round(seconds / 3600), 24)
    return f"{days} d {hours} h" if hours else f"{days} d"


@dataclass(frozen=True)
class Clock:
    """How moments of a run are written: the one place where dates are.

    Attributes:
        dated: whether moments are UTC seconds since 1970 rather than seconds from the first block.
        zone: in which they are written.
    """

    dated: bool
    zone: tzinfo = UTC

    @property
    def label(self) -> str:
        """The name of the time zone."""
        return "UTC" if self.zone is UTC else str(self.zone)

    def moment(self, time: float) -> str:
        """Return a moment with its time zone: "2026-11-20 14:05:00 UTC", "4 h 3 min after the first block"."""
        if not math.isfinite(time):
            return "at an unknown time"
        if not self.dated:
            return f"{duration(time)} after the first block"
        return self._date(time).strftime("%Y-%m-%d %H:%M:%S %Z")

    def short(self, time: float) -> str:
        """Return a moment for a table, whose heading says the time zone; "–" where there is none."""
        if not math.isfinite(time):
            return "–"
        return self._date(time).strftime("%Y-%m-%d %H:%M") if self.dated else duration(time)

    def _date(self, time: float) -> datetime:
        return (datetime.fromtimestamp(0, UTC) + timedelta(seconds=time)).astimezone(self.zone)


def time_zone(name: str) -> tzinfo:
    """Return a time zone by its name, such as Europe/Rome.

    Raises:
        ValueError: there is none of this name.
    """
    if name.upper() == "UTC":
        return UTC
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise ValueError(f"timezone {name!r}: expected UTC or a name such as Europe/Rome") from None


def count(number: float, noun: str) -> str:
    """Return "1 block", "2 blocks"."""
    return f"{number:,.0f} {noun}{'' if number == 1 else 's'}"


def figure(value: float, digits: int = 3) -> str:
    """Return a number with so many significant figures and without an exponent where people need none; "–" for NaN."""
    if not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    if 1e-4 <= abs(value) < 1e7:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
        return f"{value:,.{places}f}".replace("-", "−")
    return f"{value:.{digits - 1}e}".replace("-", "−")


def interval(lower: float, upper: float, words: Callable[[float], str]) -> str:
    """Return "1 h to 3 h", "from 1 h" where the upper end is missing, "" where the lower is."""
    if not math.isfinite(lower):
        return ""
    return f"{words(lower)} to {words(upper)}" if math.isfinite(upper) else f"from {words(lower)}"
