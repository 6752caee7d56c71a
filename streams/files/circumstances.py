"""What is stated besides rate, unit and time: speed, load, the sensitivity of a sensor, what one count is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from streams.files.keys import ATTENUATIONS, GAINS, LEVEL_UNITS, LEVELS, LOADS, MULTIPLIERS, SCALES, SPEEDS
from streams.files.statements import (
    Facts,
    StatedNumber,
    level_statements,
    load_statements,
    named,
    number_in,
    plain_key,
    scale_statements,
    speed_statements,
    written_key,
)
from streams.files.unlisted import is_stating
from streams.types.samples import OpenGain, ReaderError, Sensitivity

_OTHERS = frozenset((*SPEEDS, *LOADS, *LEVELS, *SCALES, *GAINS, *MULTIPLIERS, *ATTENUATIONS))
_NEUTRAL = ("", "-", "none", "off", "no", "n/a", "unity", "applied", "1:1", "auto")
REMEDY = "; name what is not to be believed in [[source]] disregard"
"""Behind a refusal of statements that contradict each other."""


def without(facts: Facts, disregard: Sequence[str]) -> Facts:
    """Return facts without those that a configuration does not believe: patterns of keys, or of places."""
    if not disregard:
        return facts
    patterns = [pattern.lower() for pattern in disregard]

    def is_believed(key: str) -> bool:
        word, _, place = key.partition("#")
        names = (word, (place or word).lower(), written_key(key).lower())
        return not any(
            fnmatchcase(name, pattern) or word == plain_key(pattern) for name in names for pattern in patterns
        )

    return {key: value for key, value in facts.items() if not is_stating(key) or is_believed(key)}


def judge_number(statements: Sequence[StatedNumber], what: str, where: str) -> float | None:
    """Return the number on which all statements agree within 1 % and their digits, None where it is open or not stated.

    Raises:
        ReaderError: ``unreadable``, which quotes those that differ.
    """
    if not statements:
        return None
    finest = min(statements, key=lambda one: (len(one.readings), one.resolution))
    value = finest.readings[0]
    tolerance = 0.01 * value + finest.resolution
    if any(min(abs(value - one) for one in other.readings) > tolerance + other.resolution for other in statements):
        listed = ", ".join(f"{one.place} {one.written}" for one in statements)
        raise ReaderError("unreadable", f"{where}: several values of the {what} are stated: {listed}{REMEDY}")
    return value if len(finest.readings) == 1 else None


@dataclass(frozen=True)
class Circumstances:
    """What is stated besides samples: speed of the shaft, Hz; load, N; sensitivity; one count, g.

    ``gain`` is an amplifier that the sensitivity may or may not contain; ``multiplier`` what the numbers may or may not
    have been multiplied by, in words.
    """

    speed: float | None = None
    load: float | None = None
    sensitivity: Sensitivity | None = None
    count: float | None = None
    gain: OpenGain | None = None
    multiplier: str = ""


def circumstances_of(facts: Facts, where: str) -> Circumstances:
    """Judge speed, load and sensitivity among named values; ReaderError as :func:`judge_number`."""
    if not any(named(facts, _OTHERS)):
        return Circumstances()
    gain, multiplier = _factor_words(facts, GAINS), _factor_words(facts, MULTIPLIERS)
    if not gain[1]:
        divider = _factor_words(facts, ATTENUATIONS)
        if divider[0]:
            # What is no number may be the name of a probe.
            gain = 1.0 / divider[0], divider[1]
    return Circumstances(
        judge_number(speed_statements(facts), "speed", where),
        judge_number(load_statements(facts), "load", where),
        _sensitivity(facts, where),
        judge_number(scale_statements(facts), "scale", where),
        OpenGain(gain[1], gain[0]) if gain[1] else None,
        multiplier[1],
    )


def _sensitivity(facts: Facts, where: str) -> Sensitivity | None:
    stated = {unit: level_statements(facts, unit) for unit in LEVEL_UNITS}
    if all(stated.values()):
        listed = ", ".join(f"{one.place} {one.written}" for both in stated.values() for one in both)
        told = f"sensitivities of an acceleration and a velocity are stated: {listed}{REMEDY}"
        raise ReaderError("unreadable", f"{where}: {told}")
    for unit, statements in stated.items():
        level = judge_number(statements, "sensitivity", where)
        if level is not None:
            return Sensitivity(level, unit)
    return None


def _factor_words(facts: Facts, keys: frozenset[str]) -> tuple[float | None, str]:
    """Return a factor that is not 1 with the place and the words that state it, None where it is no number."""
    for key, place, value in named(facts, keys):
        text = re.sub(r"^[x×*]\s*", "", str(value).strip().lower())
        decibels = number_in(text, place, {"db": 1.0, **({"": 1.0} if key.endswith("db") else {})})
        found = number_in(text, place, {"": 1.0, "x": 1.0, "×": 1.0, "v/v": 1.0, ":1": 1.0})
        factor = 10.0 ** (decibels.readings[0] / 20.0) if decibels is not None else found and found.readings[0]
        if (factor is None and text not in _NEUTRAL) or (factor is not None and abs(factor - 1.0) > 1e-9):
            return factor, f"{place} {str(value)!r}"
    return None, ""
