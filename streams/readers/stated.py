"""Units, rates and times that files state, in the spellings of common loggers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from streams.samples import RATE_TOLERANCE, ReaderError

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
_UNIT_KEYS = ("unit", "units", "unitstring", "niunitdescription", "engineeringunits", "einheit")
_STAMPS = ("%d-%b-%y %H:%M:%S", "%d-%b-%Y %H:%M:%S", "%Y/%m/%d %H:%M:%S", "%d.%m.%Y %H:%M:%S")
_KILO = {"khz": 1e3, "hz": 1.0, "mhz": 1e6, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "s": 1.0, "s/s": 1.0, "": 1.0}

Facts = Mapping[str, object]


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


def stated_rate(facts: Facts, where: str) -> float | None:
    """Return the sampling rate in Hz among values under plain keys, or None.

    Raises:
        ReaderError: ``wrong_rate`` where a value is no positive number or two of them differ.
    """
    found: dict[str, float] = {}
    for key in _RATES:
        if key in facts:
            found[key] = _positive(facts[key], key, where)
    for key in _STEPS:
        if key in facts:
            found[key] = 1.0 / _positive(facts[key], key, where)
    rates = list(found.values())
    if any(not math.isclose(rate, rates[0], rel_tol=1e-4) for rate in rates):
        listed = ", ".join(f"{key} {rate:g} Hz" for key, rate in found.items())
        raise ReaderError("wrong_rate", f"{where}: the file states several sampling rates: {listed}")
    return nice_rate(rates[0], 1e-9) if rates else None


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


def stated_start(facts: Facts, zone: str) -> float | None:
    """Return the time of the first sample among named values, s since 1970 UTC, or None.

    ``zone`` is the IANA name of the zone of a stamp that names none.
    """
    return next((start for key in _STARTS if (start := seconds_utc(facts.get(key), zone)) is not None), None)


def seconds_utc(value: object, zone: str) -> float | None:
    """Return the seconds since 1970 UTC of a stamp, also of ISO 8601, or None."""
    if isinstance(value, np.datetime64):
        seconds = float((value - np.datetime64(0, "s")) / np.timedelta64(1, "s"))
        return seconds if math.isfinite(seconds) else None
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        # Smaller numbers are seconds from something else.
        return float(value) if 1e8 < value < 1e11 else None
    stamp = value if isinstance(value, datetime) else _parsed(value)
    if stamp is None:
        return None
    try:
        return (stamp if stamp.tzinfo else stamp.replace(tzinfo=ZoneInfo(zone))).timestamp()
    except (OverflowError, ValueError, OSError):
        return None


def _parsed(value: object) -> datetime | None:
    if not isinstance(value, str):
        return None
    text = value.strip()[:64]
    for pattern in (None, *_STAMPS):
        try:
            return datetime.fromisoformat(text) if pattern is None else datetime.strptime(text, pattern)
        except ValueError:
            continue
    return None


def rate_of_times(times: NDArray[np.floating], where: str) -> float | None:
    """Return the rate in Hz that a column of times in s states.

    None where there are less than two times, or their rounding leaves it uncertain by more than 5e-5 of it.

    Raises:
        ReaderError: ``nan`` for a time that is no number, ``wrong_rate`` where the times do not increase evenly.
    """
    if len(times) < 2:
        return None
    values = np.asarray(times, dtype=np.float64)
    if not np.isfinite(values).all():
        raise ReaderError("nan", f"{where}: a time is not a number")
    span = values[-1] - values[0]
    step = span / (len(values) - 1)
    if not (step > 0.0 and math.isfinite(step)):
        raise ReaderError("wrong_rate", f"{where}: the times do not increase")
    ideal = values[0] + step * np.arange(len(values))
    deviation = float(np.max(np.abs(values - ideal)))
    resolution = float(np.spacing(np.max(np.abs(values))))
    steps = np.diff(values)
    # Times written more coarsely than the sampling interval repeat themselves, then jump by one unit.
    unit = float(np.min(steps[steps > 0.0]))
    if float(np.max(steps)) > max(1.5 * step, 1.01 * unit) or float(np.min(steps)) < 0.0:
        raise ReaderError(
            "wrong_rate", f"{where}: the times are not evenly spaced; the longest step is {steps.max():g} s"
        )
    uncertainty = 2.0 * max(deviation, resolution) / span
    return nice_rate(1.0 / step, uncertainty + 1e-12) if uncertainty < 5e-5 else None


def check_lengths(
    sizes: Sequence[int], names: Sequence[str], rows: str, where: str, max_listed: int | None = None
) -> None:
    """Raise ``wrong_shape`` where rows ("channels", "vectors") differ in length."""
    if len(set(sizes)) > 1:
        listed = ", ".join(f"{name} {size}".strip() for name, size in zip(names, sizes, strict=True))
        raise ReaderError("wrong_shape", f"{where}: {rows} of different lengths: {listed[:max_listed]}")


def common_rate(rates: Iterable[float | None], rows: str, where: str, joint: str = ", ") -> float | None:
    """Return the lowest rate in Hz that rows state, None where none is stated.

    Raises:
        ReaderError: ``wrong_rate`` where they differ by more than 1e-4 of it.
    """
    stated = sorted({rate for rate in rates if rate is not None})
    if stated and stated[-1] - stated[0] > RATE_TOLERANCE * stated[0]:
        listed = joint.join(f"{rate:g}" for rate in stated)
        raise ReaderError("wrong_rate", f"{where}: {rows} of different rates: {listed} Hz")
    return stated[0] if stated else None
