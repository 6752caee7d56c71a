"""Units, rates and times that files state, in the spellings of common loggers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from streams.types import large
from streams.types.large import contiguous, forget_pages, is_any
from streams.types.samples import ReaderError
from streams.types.stamps import CLOCK, DATE, Stamp, read_stamp

_UNITS = {
    "g": "g", "gn": "g", "g_n": "g", "g0": "g", "gravity": "g",
    "m/s2": "m/s2", "m/s^2": "m/s2", "m/s**2": "m/s2", "m/s²": "m/s2", "m/(s^2)": "m/s2", "m s-2": "m/s2",
    "ms-2": "m/s2",
    "m.s-2": "m/s2", "m s^-2": "m/s2", "m*s^-2": "m/s2", "m·s⁻²": "m/s2", "m/s/s": "m/s2", "meters/second^2": "m/s2",
    "v": "V", "volt": "V", "volts": "V",
    "unknown": "unknown",
}  # fmt: skip
_RATES = ("ratehz", "rate", "samplerate", "sampleratehz", "samplingrate", "samplingratehz", "samplingfrequency",
          "samplingfrequencyhz", "samplefrequency", "samplefrequencyhz", "fs", "fshz", "abtastrate")  # fmt: skip
_STEPS = ("dt", "deltat", "deltax", "dts", "wfincrement", "sampleinterval", "samplinginterval", "timestep",
          "abtastintervall")  # fmt: skip
_STARTS = ("startutc", "start", "starttime", "wfstarttime", "t0", "acquisitiontime", "timestamp", "datetime",
           "startzeit")  # fmt: skip
_MOMENTS = (
    *("startdatetime", "starttimeutc", "starttimelocal", "starttimestamp", "startdate", "recordingstart"),
    *("recordingtime", "recordingdate", "recorded", "recordedat", "acquisitionstart", "acquisitiondate", "acquired"),
    *("acquisitiondatetime", "measurementstart", "measurementtime", "measurementdate", "measured", "measuredat"),
    *("triggertime", "testdatetime", "testdate", "dateandtime", "datetimeutc", "date", "time", "utc"),
    *("messbeginn", "messstart", "messzeit", "messzeitpunkt", "messdatum", "messungvom", "beginn", "aufnahmezeit"),
    *("aufnahmebeginn", "aufnahmestart", "aufnahmedatum", "aufnahmezeitpunkt", "aufzeichnungsbeginn"),
    *("aufzeichnungsstart", "startzeitpunkt", "startdatum", "zeitpunkt", "zeitstempel", "datumuhrzeit", "datumzeit"),
    *("datumundzeit", "datumunduhrzeit", "datum", "zeit", "uhrzeit"),
)
"""Keys of date and time of day in one; those of ``_STARTS`` may state a day alone."""
_DATES = ("startdate", "date", "recordingdate", "acquisitiondate", "measurementdate", "testdate", "startdatum", "datum",
          "messdatum", "aufnahmedatum")  # fmt: skip
_CLOCKS = ("starttime", "time", "recordingtime", "acquisitiontime", "measurementtime", "testtime", "startzeit",
           "uhrzeit", "messzeit", "aufnahmezeit", "zeit", "messbeginn", "timeofday")  # fmt: skip
_UNIT_KEYS = ("unit", "units", "unitstring", "niunitdescription", "engineeringunits", "einheit")
PULSE_KEYS = ("pulsesperrevolution", "pulsesperrev", "ppr", "impulseproumdrehung")
"""Plain keys of the pulses of a whole turn."""
KEYS = frozenset((*_RATES, *_STEPS, *_STARTS, *_MOMENTS, *_DATES, *_CLOCKS, *_UNIT_KEYS, *PULSE_KEYS))
"""Plain keys that may state rate, unit, start or pulses a revolution."""
_MULTIPLES = {
    "mg": ("g", 1e-3), "µg": ("g", 1e-6), "ug": ("g", 1e-6), "mv": ("V", 1e-3), "µv": ("V", 1e-6), "uv": ("V", 1e-6),
    "mm/s2": ("m/s2", 1e-3), "mm/s^2": ("m/s2", 1e-3), "mm/s²": ("m/s2", 1e-3), "um/s2": ("m/s2", 1e-6),
    "µm/s²": ("m/s2", 1e-6), "cm/s2": ("m/s2", 1e-2), "cm/s^2": ("m/s2", 1e-2), "cm/s²": ("m/s2", 1e-2),
    "gal": ("m/s2", 1e-2), "in/s2": ("m/s2", 0.0254), "in/s^2": ("m/s2", 0.0254), "ft/s2": ("m/s2", 0.3048),
    "ft/s^2": ("m/s2", 0.3048),
}  # fmt: skip
_KILO = {"khz": 1e3, "hz": 1.0, "mhz": 1e6, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "s": 1.0, "s/s": 1.0, "": 1.0}

Facts = Mapping[str, object]
STORED = "stored as"
"""Key among the facts of an array for how its numbers are stored; the blank keeps it apart from plain keys."""


def plain_key(key: str) -> str:
    """Return letters and digits in lower case: ``samplingratehz``."""
    return re.sub(r"[^a-z0-9]", "", key.lower())


def known_unit(text: object) -> str | None:
    """Return a stated unit in our spelling: "g", "m/s2", "V" or "unknown".

    None for an empty text; any other text as it stands, so that a refusal can name it.
    """
    if not isinstance(text, str):
        return None
    bare = text.strip().strip("[]()").strip()
    if not bare or bare.lower() in ("none", "-", "n/a", "1"):
        return None
    return _UNITS.get(bare.lower(), bare[:40])


def multiple_of(unit: str | None) -> tuple[str, float]:
    """Return the unit of ours of which a stated unit is a multiple, and the factor: ("V", 1e-3) for "mV".

    Any other unit is returned as it is, "" for None.
    """
    return _MULTIPLES.get((unit or "").lower(), (unit or "", 1.0))


def rates_by_key(facts: Facts, where: str) -> dict[str, float]:
    """Return the sampling rates in Hz that plain keys state, by key; ReaderError ``wrong_rate`` for another value."""
    rates = {key: _positive(facts[key], key, where) for key in _RATES if key in facts}
    return rates | {key: 1.0 / _positive(facts[key], key, where) for key in _STEPS if key in facts}


def _positive(value: object, key: str, where: str) -> float:
    number = number_of(value)
    if number is None or not (1e-300 < number < 1e300):
        raise ReaderError("wrong_rate", f"{where}: expected a positive number in {key}, found {str(value)[:40]!r}")
    return number


def number_of(value: object) -> float | None:
    """Return a finite number, also from ``25.6 kHz`` or ``25600,0``, or None."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float | np.integer | np.floating):
        number = float(value)
        return number if math.isfinite(number) else None
    if not isinstance(value, str):
        return None
    match = re.fullmatch(r"\s*([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([A-Za-zµ/]*)\s*", value)
    if match is None or match[2].lower() not in _KILO:
        return None
    try:
        number = float(match[1].replace(",", ".")) * _KILO[match[2].lower()]
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def nice_rate(rate: float, tolerance: float) -> float:
    """Return the whole number within a relative tolerance, else the rate."""
    whole = float(round(rate))
    return whole if whole and abs(rate - whole) <= tolerance * rate else rate


def stated_unit(facts: Facts) -> str | None:
    """Find the unit among named values, as :func:`known_unit` gives it."""
    return next((unit for key in _UNIT_KEYS if (unit := known_unit(facts.get(key))) is not None), None)


def stated_time(facts: Facts, zone: str) -> tuple[float | None, str | None]:
    """Return the time of the first sample among named values, s since 1970 UTC, and None.

    A stamp whose order of day and month is open is returned as text, behind None. Date and time of day may be values
    of their own. ``zone`` is the IANA name of the zone of a stamp that names none.
    """
    stamp = stated_stamp(facts, zone)
    if stamp is None:
        return None, None
    return (None, stamp.text) if stamp.open else (stamp.fixed, None)


def written_start(facts: Facts, zone: str) -> str | None:
    """Return the start among named values as it is written, where it names no zone; arguments as above."""
    stamp = stated_stamp(facts, zone)
    return stamp.text if stamp is not None and stamp.local else None


def stated_stamp(facts: Facts, zone: str) -> Stamp | None:
    """Return the stamp of the first sample among named values, or None; arguments as :func:`stated_time`."""
    whole = (key for key in (*_STARTS, *_MOMENTS) if not is_date(facts.get(key)))
    stamp = next((found for key in whole if (found := read_stamp(facts.get(key), zone)) is not None), None)
    stamp = stamp or _joined_stamp(facts, zone)
    if stamp is None:
        # A day alone is the start where the key says so.
        days = (key for key in _STARTS if is_date(facts.get(key)))
        stamp = next((found for key in days if (found := read_stamp(facts.get(key), zone)) is not None), None)
    return stamp


def _joined_stamp(facts: Facts, zone: str) -> Stamp | None:
    """Return the stamp of a date and a time of day under two keys, or None."""
    dates = (str(facts[key]).strip() for key in _DATES if key in facts)
    clocks = (str(facts[key]).strip() for key in _CLOCKS if key in facts)
    date = next((text for text in dates if is_date(text)), None)
    clock = next((text for text in clocks if CLOCK.fullmatch(text)), None)
    return None if date is None or clock is None else read_stamp(f"{date} {clock}", zone)


def is_date(value: object) -> bool:
    """Return whether a value is the text of a date in numbers, without a time of day."""
    return isinstance(value, str) and re.fullmatch(rf"{DATE.pattern}|\d{{8}}", value.strip()) is not None


def seconds_utc(value: object, zone: str) -> float | None:
    """Return the seconds since 1970 UTC of a stamp, also of ISO 8601, or None.

    None also where the order of day and month is open.
    """
    stamp = read_stamp(value, zone)
    return None if stamp is None or stamp.open else stamp.fixed


def rate_of_times(times: NDArray[np.floating], where: str) -> float | None:
    """Return the rate in Hz that a column of times in s states.

    None where there are less than two times, or their rounding leaves it uncertain by more than 5e-5 of it.

    Raises:
        ReaderError: ``nan`` for a time that is no number, ``wrong_rate`` where the times do not increase evenly.
    """
    if len(times) < 2:
        return None
    values = contiguous(times, np.float64)
    if is_any(lambda part: ~np.isfinite(part), values):
        raise ReaderError("nan", f"{where}: a time is not a number")
    span = values[-1] - values[0]
    step = span / (len(values) - 1)
    if not (step > 0.0 and math.isfinite(step)):
        raise ReaderError("wrong_rate", f"{where}: the times do not increase")
    deviation, largest, unit, longest, shortest = _spread_of_times(values, step)
    if longest > max(1.5 * step, 1.01 * unit) or shortest < 0.0:
        raise ReaderError("wrong_rate", f"{where}: the times are not evenly spaced; the longest step is {longest:g} s")
    uncertainty = 2.0 * max(deviation, float(np.spacing(largest))) / span
    return nice_rate(1.0 / step, uncertainty + 1e-12) if uncertainty < 5e-5 else None


def _spread_of_times(times: NDArray[np.float64], step: float) -> tuple[float, float, float, float, float]:
    """Return of times that should have one step: the largest deviation from that and the largest amount, then of the
    steps the least above 0, the largest and the least; all in s, computed piece by piece.
    """
    deviation = largest = 0.0
    unit, longest, shortest = math.inf, -math.inf, math.inf
    count = max(2, large.PIECE_BYTES // times.dtype.itemsize)
    for begin in range(0, len(times) - 1, count - 1):
        part = times[begin : begin + count]
        ideal = times[0] + step * np.arange(begin, begin + len(part))
        deviation = max(deviation, float(np.max(np.abs(part - ideal))))
        largest = max(largest, float(np.max(np.abs(part))))
        steps = np.diff(part)
        # Times written more coarsely than the sampling interval repeat themselves, then jump by one unit.
        unit = min(unit, float(np.min(steps[steps > 0.0], initial=math.inf)))
        longest, shortest = max(longest, float(np.max(steps))), min(shortest, float(np.min(steps)))
        forget_pages(times)
    return deviation, largest, unit, longest, shortest
