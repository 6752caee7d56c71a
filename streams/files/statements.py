"""Units, rates and times that files state, in the spellings of common loggers.

What is stated stands in mappings of plain keys (:func:`plain_key`). Where a key is stated twice, in another spelling or
at another level of a file, the others stand under ``KEY#PLACE`` (:func:`add_fact`, :func:`nearest`): nothing is left
out before :mod:`streams.files.judge` has compared it.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from streams.files.keys import (
    CLOCKS,
    COUNT,
    DATES,
    DECIMATIONS,
    DISPLACEMENTS,
    FACTORS,
    GROUPING_BLANKS,
    GROUPS,
    LEVEL_UNITS,
    LEVELS,
    LIKE_RATE,
    LIKE_STEP,
    LOAD_UNITS,
    LOADS,
    MAX_OPEN_RATE,
    MOMENTS,
    MONTH_NAMED,
    NUMBER,
    PER_G,
    PLAIN_RATES,
    SCALE_UNITS,
    SCALES,
    SPEED_UNITS,
    SPEEDS,
    STARTS,
    TIME_KEYS,
    UNIT_KEYS,
    UNITS,
)
from streams.types.block import VELOCITY
from streams.types.samples import ReaderError
from streams.types.spellings import in_signs
from streams.types.stamps import CLOCK, DATE, Stamp, read_stamp

Facts = Mapping[str, object]
_CLOCKS, _DATES, _DECIMATIONS, _STARTS, _UNIT_KEYS = map(frozenset, (CLOCKS, DATES, DECIMATIONS, STARTS, UNIT_KEYS))
_MOMENTS = frozenset((*STARTS, *MOMENTS))
_LEAST_HZ = 50.0
"""Least rate of vibration of bearings."""
STORED = "stored as"
DECIMAL_COMMA = "decimal comma"
"""Keys among facts for how numbers are stored, and that they are written with commas; the blank keeps them apart from
plain keys."""


_SPELLINGS = tuple(
    (re.compile(pattern), plain)
    for pattern, plain in (
        (r"\s+per\s+", "/"),
        (r"milli[- ]?(?=[a-z])", "m"),
        (r"mi[ck]ro[- ]?(?=[a-z])(?!ns?(?![a-z]))", "u"),
        (r"nano[- ]?(?=[a-z])", "n"),
        (r"se[ck](?:ond[eio]?|unden?)?s?(?![a-z])", "s"),
        (r"met(?:er|re)s?(?![a-z])", "m"),
        (r"(?<![a-z])inch(?:es)?(?![a-z])", "in"),
        (r"volts?(?![a-z])", "v"),
        (r"newton(?![a-z])", "n"),
        (r"(?<![a-z])g['’´]s(?![a-z])", "g"),
        (r"[\s.·⋅*^()\[\]]", ""),
    )
)


@lru_cache(maxsize=1024)
def plain_unit(text: str) -> str:
    """Return a unit in lower case without powers, dots, brackets and blanks: ``ms-2`` for ``m·s⁻²``."""
    plain = unicodedata.normalize("NFKC", text).replace("\N{MINUS SIGN}", "-").lower()
    plain = plain.replace("\N{GREEK SMALL LETTER MU}", "u")
    for pattern, spelling in _SPELLINGS:
        plain = pattern.sub(spelling, plain)
    return plain


_LETTERS = str.maketrans({"Δ": "delta", "µ": "u", "μ": "u", "ł": "l", "Ł": "l", "ø": "o", "ı": "i"})


class PlainKey(str):
    """A plain key that remembers how it is ``written``: with the case and the separators that divide its words."""

    written: str

    def __new__(cls, plain: str, written: str) -> PlainKey:
        """Keep both."""
        self = super().__new__(cls, plain)
        self.written = written
        return self


@lru_cache(maxsize=4096)
def plain_key(key: str) -> str:
    """Return letters and digits in lower case, without accents: ``samplingratehz``; those of Japanese as they are.

    The key is a :class:`PlainKey`.
    """
    plain = key
    if not key.isascii():
        plain = unicodedata.normalize("NFKD", key.translate(_LETTERS))
        plain = unicodedata.normalize("NFC", re.sub("[\u0300-\u036f]", "", plain))
    return PlainKey(re.sub("[^a-z0-9\u3041-\u30ff\u4e00-\u9fff]", "", plain.lower()), key)


def written_key(key: str) -> str:
    """Return a plain key as it is written, where it remembers that."""
    return key.written if isinstance(key, PlainKey) else key


def add_fact(facts: dict[str, object], key: str, value: object, place: str = "") -> None:
    """Add what a plain key states; beside another value of it, as ``KEY#PLACE``."""
    if key not in facts:
        facts[key] = value
    elif facts[key] != value:
        number = sum(known.partition("#")[0] == key for known in facts) + 1
        facts[PlainKey(f"{key}#{place or f'{key} ({number})'}", written_key(key))] = value


def nearest(outer: Facts, own: Facts, place: str) -> dict[str, object]:
    """Return facts of which the ``own`` ones are found first; others of the same key stand under ``KEY#PLACE``."""
    found = dict(own)
    for key, value in outer.items():
        if key in found and not isinstance(value, np.ndarray):
            add_fact(found, key, value, place)
        else:
            found.setdefault(key, value)
    return found


def named(facts: Facts, keys: frozenset[str] | Mapping[str, Any]) -> Iterator[tuple[str, str, object]]:
    """Yield the facts with one of some plain keys: the key, the place that messages name, and the value."""
    for key, value in facts.items():
        word, _, place = key.partition("#")
        if word in keys:
            yield word, place or word, value


def known_unit(text: object) -> str | None:
    """Return a stated unit in our spelling: "g", "m/s2", "V", "mm/s" or "unknown".

    None for an empty text; any other text as it stands, so that a refusal can name it.
    """
    if not isinstance(text, str):
        return None
    bare = re.sub(r"^[\[(]\s*([^()\[\]]*)[\])]$", r"\1", text.strip()).strip()
    if not bare or bare.lower() in ("none", "-", "n/a", "1"):
        return None
    own, factor = UNITS.get(plain_unit(bare), ("", 0.0))
    return own if factor == 1.0 else bare[:40].replace("\N{GREEK SMALL LETTER MU}", "µ")


def multiple_of(unit: str | None) -> tuple[str, float]:
    """Return the unit of ours of which a stated unit is a multiple, and the factor: ("V", 1e-3) for "mV".

    Any other unit is returned as it is, "" for None.
    """
    return UNITS.get(plain_unit(unit or ""), (unit or "", 1.0))


def is_of_vibration(unit: str | None) -> bool:
    """Return whether a unit is one of acceleration, velocity or voltage, which two statements of a row must share."""
    return multiple_of(unit)[0] in ("g", "m/s2", "V", VELOCITY)


def quantity_words(unit: str | None) -> str:
    """Return why a unit of displacement is refused, and what to do, behind a comma; "" for any other unit."""
    if plain_unit(unit or "") not in DISPLACEMENTS:
        return ""
    return ", a displacement; an acceleration or a velocity is needed: export that of the sensor"


@dataclass(frozen=True)
class StatedNumber:
    """What one place states of a quantity.

    Attributes:
        place: as messages call it: a key, "the header", the name of a side-car.
        written: as it stands there.
        readings: the values that this may mean, in SI; more than one where the way of writing leaves it open.
        resolution: half of what its last digit stands for, in SI; 0 where it was not written in decimals.
        is_exact: whether it may count alone; what was measured too coarsely is only compared.
    """

    place: str
    written: str
    readings: tuple[float, ...]
    resolution: float = 0.0
    is_exact: bool = True


def number_in(value: object, place: str, units: Mapping[str, float], *, comma: bool = False) -> StatedNumber | None:
    """Return the number that a value states with one of some ``units``, given with their factors; None for any other.

    ``4,096`` may mean 4.096 or 4096: both are readings. So has ``4.096`` where the numbers around have a decimal
    ``comma``.
    """
    if isinstance(value, bool):
        return None
    if isinstance(value, int | float | np.integer | np.floating):
        number = float(value)
        fits = math.isfinite(number) and "" in units
        return StatedNumber(place, f"{number:.10g}", (number * units[""],)) if fits else None
    match = NUMBER.fullmatch(GROUPING_BLANKS.sub("", value)) if isinstance(value, str) else None
    factor = None if match is None else units.get(plain_unit(match[2]))
    if match is None or factor is None:
        return None
    digits = match[1]
    try:
        readings = tuple(float(text) * factor for text in _decimals(digits, comma=comma))
    except ValueError:
        return None
    shift = 10.0 ** int(digits.lower().partition("e")[2] or 0)
    fraction = re.split("[.,]", digits.lower().partition("e")[0])
    last = 10.0 ** -len(fraction[1]) if len(fraction) == 2 else 1.0
    if not all(map(math.isfinite, readings)):
        return None
    return StatedNumber(place, str(value).strip()[:40], readings, 0.5 * last * shift * factor)


def _decimals(digits: str, *, comma: bool) -> tuple[str, ...]:
    """Return the readings of a number with points or commas, with a decimal point; ValueError for none."""
    points, commas = digits.count("."), digits.count(",")
    if points and commas:
        # The last sign is the decimal one, and stands once.
        decimal = max(".,", key=digits.rfind)
        if digits.count(decimal) > 1:
            raise ValueError(digits)
        return (digits.replace("," if decimal == "." else ".", "").replace(",", "."),)
    if points > 1 or commas > 1:
        if not re.fullmatch(r"[-+]?\d{1,3}(?:[.,]\d{3})+", digits):
            raise ValueError(digits)
        return (re.sub("[.,]", "", digits),)
    if (commas or (comma and points)) and GROUPS.fullmatch(digits) and not digits.lstrip("+-").startswith("0"):
        return digits.replace(",", "."), re.sub("[.,]", "", digits)
    return (digits.replace(",", "."),)


def number_of(value: object) -> float | None:
    """Return a finite number, also from ``25.6 kHz`` or ``25600,0``, or None where it is none or has two readings."""
    found = number_in(value, "", {**LIKE_RATE, **LIKE_STEP})
    return found.readings[0] if found is not None and len(found.readings) == 1 else None


def rate_statements(facts: Facts, where: str) -> list[StatedNumber]:
    """Return what plain keys state of the sampling rate, in Hz; ReaderError ``wrong_rate`` where that is no rate."""
    found: list[StatedNumber] = []
    for key, place, value in named(facts, FACTORS):
        kind, factor = FACTORS[key]
        comma = DECIMAL_COMMA in facts
        own, other = (LIKE_RATE, LIKE_STEP) if kind == "rate" else (LIKE_STEP, LIKE_RATE)
        # A unit beside the number is nearer than one in its key.
        direct = number_in(value, place, {**own, "": factor}, comma=comma)
        stated = direct or number_in(value, place, {unit: scale for unit, scale in other.items() if unit})
        is_plain = direct is not None and number_in(value, place, {"": 1.0}, comma=comma) is not None
        if direct is not None and not is_plain and direct.readings[0] < _LEAST_HZ and kind == "rate":
            # ``12.800 Hz`` is no rate of vibration where the point is decimal.
            stated = direct = number_in(value, place, {**own, "": factor}, comma=True)
        if stated is None or not all(1e-300 < number < 1e300 for number in stated.readings):
            shown = str(value)[:40]
            raise ReaderError("wrong_rate", f"{where}: expected a positive number in {place}, found {shown!r}")
        stated = stated if (kind == "rate") == (stated is direct) else _inverse(stated)
        found.append(_opened(stated, kind) if is_plain and key in PLAIN_RATES else stated)
    return [_undivided(stated, facts) for stated in found]


def _undivided(stated: StatedNumber, facts: Facts) -> StatedNumber:
    """Return a rate with those that it is by a stated decimation: before it, and behind."""
    for _, place, value in named(facts, _DECIMATIONS):
        divider = number_in(value, place, {"": 1.0, "x": 1.0})
        if divider is not None and divider.readings[0] > 1.0:
            readings = (*stated.readings, *(rate / divider.readings[0] for rate in stated.readings))
            written = f"{stated.written} beside {place} {divider.written}"
            stated = replace(stated, readings=readings, written=written)
    return stated


def _opened(stated: StatedNumber, kind: str) -> StatedNumber:
    """Return a rate that is written without a unit with all its readings: in kHz, or by a step in ms or us, too."""
    least = min(stated.readings)
    if least > MAX_OPEN_RATE and (kind == "step" or least > 300.0 or least == round(least)):
        return stated
    factors = (1.0, 1e3) if kind == "rate" else (1.0, 1e3, 1e6)
    return replace(stated, readings=tuple(rate * factor for factor in factors for rate in stated.readings))


def _inverse(stated: StatedNumber) -> StatedNumber:
    """Return one over what is stated."""
    readings = tuple(1.0 / number for number in stated.readings)
    least = min(stated.readings)
    resolution = stated.resolution / (least * (least + stated.resolution))
    return StatedNumber(stated.place, stated.written, readings, resolution)


def nice_rate(rate: float, tolerance: float) -> float:
    """Return the whole number within a relative tolerance, else the rate."""
    whole = float(round(rate))
    return whole if whole and abs(rate - whole) <= tolerance * rate else rate


def unit_statements(facts: Facts) -> list[tuple[str, str]]:
    """Return the units among named values, as :func:`known_unit` gives them, each with its place."""
    found = ((place, _unit_in(value)) for _, place, value in named(facts, _UNIT_KEYS))
    return [(place, unit) for place, unit in found if unit is not None]


def _unit_in(value: object) -> str | None:
    """Return the unit that a value states alone or behind the name of a quantity, as ``Acceleration (m/s²)``."""
    unit = known_unit(value)
    if unit is None or is_of_vibration(unit) or not isinstance(value, str):
        return unit
    behind = re.search(r"(?:[\[(]([^\])]+)[\])]|(?:\s|,)(?:in\s+)?(\S+))\s*$", value)
    inner = None if behind is None else known_unit(behind[1] or behind[2])
    return inner if is_of_vibration(inner) else unit


def speed_statements(facts: Facts) -> list[StatedNumber]:
    """Return what plain keys state of the speed of the shaft, in Hz; what states no unit is left out."""
    return _positive(facts, SPEEDS, SPEED_UNITS)


def load_statements(facts: Facts) -> list[StatedNumber]:
    """Return what plain keys state of the radial load, in N; what states no unit is left out."""
    return _positive(facts, LOADS, LOAD_UNITS)


def level_statements(facts: Facts, unit: str) -> list[StatedNumber]:
    """Return what plain keys state of the sensitivity of a sensor, in mV per "g" or "mm/s"; with another unit: none."""
    return _positive(facts, LEVELS, LEVEL_UNITS[unit])


def scale_statements(facts: Facts) -> list[StatedNumber]:
    """Return what plain keys state of one count, in g; what states no unit of a count is left out."""
    inverse = _positive(facts, SCALES, PER_G)
    return [*_positive(facts, SCALES, SCALE_UNITS), *map(_inverse, inverse)]


def is_of_counts(unit: str | None) -> bool:
    """Return whether a unit is that of a converter: counts, or none stated."""
    return unit is None or unit.lower() in (*COUNT, "raw", "adc", "adc counts", "raw counts")


def _positive(facts: Facts, keys: Mapping[str, str], units: Mapping[str, float]) -> list[StatedNumber]:
    """Return the positive numbers under some keys, given with the unit that each names, "" for none."""
    found = (
        number_in(value, place, {**units, "": units[keys[key]]} if keys[key] in units else units)
        for key, place, value in named(facts, keys)
    )
    return [stated for stated in found if stated is not None and min(stated.readings) > 0.0]


def time_statements(facts: Facts, zone: str) -> list[tuple[str, Stamp]]:
    """Return what plain keys state of the time of the first sample, each with its place.

    Date and time of day may be values of their own. A day alone counts where nothing else is stated and the key says
    that it is the start. ``zone`` is the IANA name of the zone of a stamp that names none.
    """
    if not any(named(facts, TIME_KEYS)):
        return []
    found = [
        (place, stamp)
        for _, place, value in named(facts, _MOMENTS)
        if not is_date(value) and (stamp := read_stamp(value, zone)) is not None
    ]
    found += _joined_stamps(facts, zone)
    return found or [
        (place, stamp)
        for _, place, value in named(facts, _STARTS)
        if is_date(value) and (stamp := read_stamp(value, zone)) is not None
    ]


def _joined_stamps(facts: Facts, zone: str) -> list[tuple[str, Stamp]]:
    """Return the stamps of dates and times of day under keys of their own."""
    dates = [(place, str(value).strip()) for _, place, value in named(facts, _DATES) if is_date(value)]
    clocks = [(place, str(value).strip()) for _, place, value in named(facts, _CLOCKS)]
    clocks = [(place, text) for place, text in clocks if CLOCK.fullmatch(text)]
    both = [
        (f"{place} and {other}", read_stamp(f"{date} {clock}", zone))
        for place, date in {text: (place, text) for place, text in dates[::-1]}.values()
        for other, clock in clocks
    ]
    return [(place, stamp) for place, stamp in both if stamp is not None]


def is_date(value: object) -> bool:
    """Return whether a value is the text of a date, without a time of day."""
    if not isinstance(value, str):
        return False
    return re.fullmatch(rf"{DATE.pattern}|\d{{8}}|{MONTH_NAMED}", in_signs(value).strip()) is not None


def seconds_utc(value: object, zone: str) -> float | None:
    """Return the seconds since 1970 UTC of a stamp, also of ISO 8601, or None.

    None also where the order of day and month is open.
    """
    stamp = read_stamp(value, zone)
    return None if stamp is None or stamp.open else stamp.fixed
