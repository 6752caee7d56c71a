"""What ``init`` has to know beyond the files: each answer, how it is read from words, and the channels."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from models.machine import bearing as bearings
from monitor.config.fields import plain_name
from monitor.config.plausible.machine import MAX_SPEED_HZ, MAX_USUAL_SPEED_HZ, rpm_words
from streams.files.survey import Survey, SurveyedRow
from streams.types.spec import UNITS
from streams.types.stamps import ORDERS, Order

_NUMBER = r"([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)"
_SPEED = re.compile(rf"\s*{_NUMBER}\s*(hz|1/s|rps|rpm|upm|1/min|u/min|/min)?\s*", re.IGNORECASE)
_LOAD = re.compile(rf"\s*{_NUMBER}\s*(n|kn|newton)?\s*", re.IGNORECASE)
_GEOMETRY = re.compile(r"[;,]\s*|\s+")
_VOLTS = re.compile(
    rf"\s*{_NUMBER}\s*(mv|v)\b[\s,;at@]*(?:{_NUMBER}\s*(mv|v)\s*(?:/|per)\s*(g|\(?m/s\^?[2²]\)?))?\s*", re.IGNORECASE
)
_LEVEL = re.compile(rf"\s*{_NUMBER}\s*(g|mm/s|m/s\^?[2²])\s*", re.IGNORECASE)
_RATE = re.compile(rf"\s*{_NUMBER}\s*(hz|khz|1/s|s/s)?\s*", re.IGNORECASE)
_STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class AnsweredBearing:
    """A designation of the catalogue, or a geometry."""

    designation: str | None
    n_elements: int = 0
    element_diameter_mm: float = 0.0
    pitch_diameter_mm: float = 0.0
    contact_angle_deg: float = 0.0

    def geometry(self) -> bearings.Bearing:
        """Return the geometry in SI."""
        if self.designation is not None:
            return bearings.catalogue_entry(self.designation).bearing
        return bearings.Bearing(
            designation="bearing",
            source="answer",
            n_elements=self.n_elements,
            element_diameter=self.element_diameter_mm * 1e-3,
            pitch_diameter=self.pitch_diameter_mm * 1e-3,
            contact_angle=math.radians(self.contact_angle_deg),
        )


@dataclass(frozen=True)
class OwnAnswer:
    """An answer for one channel: its key among ``READERS``, what the channel is called, fields of ``Answers``."""

    key: str
    channel: str
    fields: Mapping[str, Any]


@dataclass(frozen=True)
class Answers:
    """What was answered; None where it was not asked or needs no answer.

    Attributes:
        bearing: of all channels without an answer of their ``own``, as unit, sensitivity and scale are.
        speed_hz: of the shaft; ``estimate`` where it is to be estimated instead.
        speed_unit: "rpm" or "Hz", of a row of the speed that states none.
        unit: of the vibration where the files state none.
        scale: the unit of one count, or at full scale.
        range_g: g at full scale.
        start_utc: of the first file, or "mtime" where the times of change date the files, or "none".
        time_name: pattern of the dates in names.
        date_order: of day, month and year.
        pulses_per_revolution: of the tacho in the files.
        files: "together" or "sequence": how files are read whose names fall into groups.
        columns: titles of those that are vibration; None: those that seem so.
    """

    bearing: AnsweredBearing | None = None
    own: tuple[OwnAnswer, ...] = ()
    speed_hz: float | None = None
    estimate: bool = False
    speed_unit: str | None = None
    load_newton: float | None = None
    no_load: bool = False
    rate_hz: float | None = None
    unit: str | None = None
    sensitivity_mv_per_g: float | None = None
    scale: float | None = None
    range_g: float | None = None
    start_utc: datetime | str | None = None
    interval_s: float | None = None
    time_name: str | None = None
    date_order: Order | None = None
    pulses_per_revolution: int | None = None
    files: str | None = None
    columns: tuple[str, ...] | None = None

    def answered(self, found: Mapping[str, Any]) -> Answers:
        """Return the answers with further fields; those of single channels are added to those that are there."""
        return replace(self, **{**found, "own": (*self.own, *found.get("own", ()))})

    def of(self, row: SurveyedRow, survey: Survey) -> Answers:
        """Return what was answered of one row of vibration."""
        own = [one for one in self.own if row in _rows_called(survey, one.channel)]
        # A unit of its own has no factor of another one.
        fields: dict[str, Any] = {"scale": None} if any(one.key == "unit" for one in own) else {}
        for one in sorted(own, key=lambda one: one.key == "unit"):
            fields |= one.fields
        return replace(self, **fields)


def _number(text: str) -> float:
    """Return a number with a point or a comma; ValueError where the comma may separate thousands."""
    if re.fullmatch(r"[-+]?[1-9]\d{0,2},\d{3}", text):
        raise ValueError(
            f"{text} can be read as {text.replace(',', '.')} or {text.replace(',', '')}; write one of them"
        )
    return float(text.replace(",", "."))


def read_bearing(text: str) -> dict[str, Any]:
    """Return a bearing: a designation, or number of elements, their diameter, pitch diameter (mm), contact angle (°).

    Raises:
        ValueError: it is neither; the message says what is known.
    """
    return {"bearing": _one_bearing(text)}


def _one_bearing(text: str) -> AnsweredBearing:
    words = [word for word in _GEOMETRY.split(text.strip()) if word]
    blanks = re.split(r"\s*;\s*|\s+", text.strip())
    if len(blanks) in (3, 4) and all(re.fullmatch(r"\d+(?:[.,]\d+)?", word) for word in blanks):
        # Blanks separate, so that a comma is that of a decimal.
        words = [str(_number(word)) for word in blanks]
    if len(words) in (3, 4) and all(re.fullmatch(r"\d+(?:\.\d+)?", word) for word in words):
        count, diameter, pitch, *angle = map(float, words)
        if count != int(count) or not 3 <= count <= 200 or not 0.0 < diameter < pitch:
            raise ValueError(
                "a geometry is the number of elements, their diameter and the larger pitch diameter in mm, such as "
                f"9 7.94 39.04; got {text!r}"
            )
        return AnsweredBearing(None, int(count), diameter, pitch, *angle)
    try:
        bearings.catalogue_entry(text.strip())
    except KeyError as error:
        reason = re.split(r"; (?:known|and)", str(error.args[0]))[0]
        raise ValueError(
            f"{reason}; give a designation such as 6205-2RS, or a geometry: number of elements, their diameter and the "
            "pitch diameter in mm, such as 9 7.94 39.04"
        ) from None
    return AnsweredBearing(text.strip())


def read_speed(text: str) -> dict[str, Any]:
    """Return the speed of ``29.5``, ``29.5 Hz`` or ``1770 rpm``; "estimate" leaves it to the signal."""
    if text.strip().lower() == "estimate":
        return {"estimate": True}
    match = _SPEED.fullmatch(text)
    if match is None:
        raise ValueError(f'expected a speed such as 29.5 Hz or 1770 rpm, or "estimate"; got {text!r}')
    per_minute = (match[2] or "hz").lower() in ("rpm", "upm", "1/min", "u/min", "/min")
    speed = _number(match[1]) / (60.0 if per_minute else 1.0)
    # A number without a unit may be rpm; with one, the bearing judges it.
    most = MAX_USUAL_SPEED_HZ if match[2] is None else MAX_SPEED_HZ
    if not 0.0 < speed <= most:
        raise ValueError(
            f"expected a speed above 0 and up to {most:g} Hz, the turns per second; got {text!r}"
            + (f", did you mean {match[1]} rpm? {rpm_words(speed)}" if speed > most and match[2] is None else "")
        )
    return {"speed_hz": speed}


def read_speed_unit(text: str) -> dict[str, Any]:
    """Return the unit of a speed in the files."""
    word = {"rpm": "rpm", "1/min": "rpm", "u/min": "rpm", "upm": "rpm", "hz": "Hz", "1/s": "Hz"}.get(
        text.strip().lower()
    )
    if word is None:
        raise ValueError(f"expected rpm or Hz; got {text!r}")
    return {"speed_unit": word}


def read_load(text: str) -> dict[str, Any]:
    """Return the load of ``400``, ``400 N`` or ``0.4 kN``; "unknown" is none."""
    if text.strip().lower() in ("unknown", "none", ""):
        return {"no_load": True}
    match = _LOAD.fullmatch(text)
    load = -1.0 if match is None else _number(match[1]) * (1e3 if (match[2] or "n").lower() == "kn" else 1.0)
    if load < 0.0:
        raise ValueError(f"expected a load such as 400 N or 0.4 kN, or unknown; got {text!r}")
    return {"load_newton": load}


def read_rate(text: str) -> dict[str, Any]:
    """Return the rate of ``25600``, ``25600 Hz`` or ``25.6 kHz``."""
    match = _RATE.fullmatch(text)
    rate = 0.0 if match is None else _number(match[1]) * (1e3 if (match[2] or "").lower() == "khz" else 1.0)
    if rate <= 0.0:
        raise ValueError(f"expected a sampling rate such as 25600 Hz or 25.6 kHz; got {text!r}")
    return {"rate_hz": rate}


def read_unit(text: str) -> dict[str, Any]:
    """Return one of the units."""
    from streams.files.statements import multiple_of

    unit, factor = multiple_of(text.strip())
    known = {name.lower(): name for name in UNITS} | {"m/s^2": "m/s2", "m/s²": "m/s2"}
    if unit.lower() not in known:
        raise ValueError(f"expected one of {', '.join(UNITS)}, mV, mg; got {text!r}")
    return {"unit": known[unit.lower()]} | ({} if factor == 1.0 else {"scale": factor})


def read_sensitivity(text: str) -> dict[str, Any]:
    """Return the sensitivity of ``100``, ``100 mV/g`` or ``10.2 mV/(m/s2)`` in mV per g."""
    match = re.fullmatch(rf"\s*{_NUMBER}\s*(?:(mv|v)\s*(?:/|per)\s*(g|\(?m/s\^?[2²]\)?))?\s*", text, re.IGNORECASE)
    if match is None or _number(match[1]) <= 0.0:
        raise ValueError(f"expected a sensitivity such as 100 mV/g or 10.2 mV/(m/s2); got {text!r}")
    return {"sensitivity_mv_per_g": _sensitivity(match[1], match[2], match[3])}


def _sensitivity(number: str, volts: str | None, per: str | None) -> float:
    factor = 1e3 if (volts or "mv").lower() == "v" else 1.0
    return round(_number(number) * factor * (1.0 if (per or "g").lower() == "g" else _STANDARD_GRAVITY), 9)


def read_full_scale(text: str) -> dict[str, Any]:
    """Return what full scale or one count is: ``50 g``, ``100 m/s2``, ``10 V`` or ``10 V at 100 mV/g``."""
    if text.strip().lower() == "unknown":
        return {"unit": "unknown"}
    match = _VOLTS.fullmatch(text)
    if match is not None:
        found: dict[str, Any] = {"unit": "V", "scale": _number(match[1]) * (1e-3 if match[2].lower() == "mv" else 1.0)}
        if match[3] is not None:
            found["sensitivity_mv_per_g"] = _sensitivity(match[3], match[4], match[5])
        return found
    match = _LEVEL.fullmatch(text)
    if match is None or _number(match[1]) <= 0.0:
        raise ValueError(f"expected a level such as 50 g, 500 m/s2 or 10 V at 100 mV/g, or unknown; got {text!r}")
    unit = match[2].lower()
    return {"unit": unit if unit in ("g", "mm/s") else "m/s2", "scale": _number(match[1])}


def read_start(text: str) -> dict[str, Any]:
    """Return the time of the first file, or "mtime" or "none"."""
    word = text.strip().lower()
    if word in ("mtime", "none", ""):
        return {"start_utc": word or "none"}
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ValueError(f"expected a time such as 2026-01-31T08:00:00Z, mtime or none; got {text!r}") from None
    return {"start_utc": (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC)}


def read_order(text: str) -> dict[str, Any]:
    """Return the order of day, month and year."""
    word = text.strip().lower()
    order = next(
        (order for order in ORDERS if word and order.startswith(word.replace(" ", "_").replace("-", "_"))), None
    )
    if order is None:
        raise ValueError(f"expected {' or '.join(ORDERS)}; got {text!r}")
    return {"date_order": order}


def read_pulses(text: str) -> dict[str, Any]:
    """Return the pulses a revolution of ``60``."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*", text)
    if match is None or int(match[1]) < 1:
        raise ValueError(f"expected a whole number of pulses, such as 1 or 60; got {text!r}")
    return {"pulses_per_revolution": int(match[1])}


def read_files(text: str) -> dict[str, Any]:
    """Return how files are read whose names fall into groups."""
    word = text.strip().lower()
    if word not in ("together", "sequence"):
        raise ValueError(f"expected together or sequence; got {text!r}")
    return {"files": word}


def read_interval(text: str) -> dict[str, Any]:
    """Return the time between the starts of files of ``600``, ``600 s``, ``10 min`` or ``1 h``, s."""
    match = re.fullmatch(rf"\s*{_NUMBER}\s*(s|min|h)?\s*", text, re.IGNORECASE)
    seconds = (
        0.0 if match is None else _number(match[1]) * {"min": 60.0, "h": 3600.0}.get((match[2] or "s").lower(), 1.0)
    )
    if seconds <= 0.0:
        raise ValueError(f"expected a time such as 600 s or 10 min; got {text!r}")
    return {"interval_s": seconds}


def read_pattern(text: str) -> dict[str, Any]:
    """Return a strptime pattern of dates in names."""
    from streams.types.stamps import compiled

    compiled(text.strip())
    return {"time_name": text.strip()}


def read_columns(text: str) -> dict[str, Any]:
    """Return the titles of columns, separated by ";"."""
    return {"columns": tuple(name.strip() for name in text.split(";") if name.strip())}


def _read_factor(text: str) -> dict[str, Any]:
    match = re.fullmatch(rf"\s*{_NUMBER}\s*", text)
    if match is None or not _number(match[1]) != 0.0:
        raise ValueError(f"expected a number other than 0; got {text!r}")
    return {"scale": _number(match[1])}


def _read_range(text: str) -> dict[str, Any]:
    match = re.fullmatch(rf"\s*{_NUMBER}\s*g?\s*", text, re.IGNORECASE)
    if match is None or not _number(match[1]) > 0.0:
        raise ValueError(f"expected the g at full scale, such as 50; got {text!r}")
    return {"range_g": _number(match[1])}


READERS: dict[str, Callable[[str], dict[str, Any]]] = {
    "bearing": read_bearing,
    "speed_hz": read_speed,
    "speed_unit": read_speed_unit,
    "load_newton": read_load,
    "rate_hz": read_rate,
    "unit": read_unit,
    "sensitivity_mv_per_g": read_sensitivity,
    "full_scale": read_full_scale,
    "scale": _read_factor,
    "range_g": _read_range,
    "start_utc": read_start,
    "interval_s": read_interval,
    "time_name": read_pattern,
    "date_order": read_order,
    "pulses_per_revolution": read_pulses,
    "files": read_files,
    "columns": read_columns,
}
"""How the words of each answer are read: into fields of ``Answers``, ValueError where they are none."""

OF_CHANNELS = ("bearing", "unit", "sensitivity_mv_per_g", "full_scale", "scale")
"""Answers that each channel may have of its own."""
_BEARING = "bearing"


def read_answer(key: str, words: str | Mapping[str, object]) -> dict[str, Any]:
    """Return the fields of :class:`Answers` that words stand for: ``6206``, or of some channels ``6206; NDE=6205``.

    Args:
        key: one of ``READERS``.
        words: or by the names of channels, those of all others by "".

    Raises:
        ValueError: they are no answer.
    """
    reader = READERS[key]
    if isinstance(words, str) and (key not in OF_CHANNELS or "=" not in words):
        return reader(words)
    if isinstance(words, str):
        parts = (part.rpartition("=") for part in words.split(";") if part.strip())
        words = {name.strip(): text for name, _, text in parts}
    elif key not in OF_CHANNELS:
        raise ValueError(f"expected one answer for all channels; got {dict(words)!r}")
    found: dict[str, Any] = reader(str(words[""])) if "" in words else {}
    own = tuple(OwnAnswer(key, name, reader(str(text))) for name, text in words.items() if name)
    return {**found, "own": own}


def channel_names(rows: Sequence[SurveyedRow]) -> list[str]:
    """Return a name for each row that the configuration takes, all different."""
    names: list[str] = []
    for row in rows:
        title = "sensor" if len(rows) == 1 and row.name == f"column_{row.column}" else row.name
        name = plain_name(title) or f"channel_{row.column}"
        names.append(name if name not in names else f"{name}_{row.column}")
    return names


def bearing_of(survey: Survey, row: SurveyedRow, name: str, answers: Answers) -> tuple[str, AnsweredBearing | None]:
    """Return the bearing of a channel, and the name of its section; None where it was not answered."""
    own = answers.of(row, survey).bearing
    return _BEARING if own is answers.bearing else name, own


def bearing_sections(survey: Survey, answers: Answers) -> dict[str, AnsweredBearing]:
    """Return the bearings of all channels by the names of their sections."""
    rows = survey.vibration
    found = (bearing_of(survey, row, name, answers) for row, name in zip(rows, channel_names(rows), strict=True))
    return {name: bearing for name, bearing in found if bearing is not None}


def has_all_bearings(survey: Survey, answers: Answers) -> bool:
    """Return whether every channel has a bearing."""
    return all(answers.of(row, survey).bearing is not None for row in survey.vibration)


def check_own(survey: Survey, own: Sequence[OwnAnswer]) -> None:
    """Raise ValueError where an answer is that of no channel, or of several."""
    for one in own:
        found = _rows_called(survey, one.channel)
        if len(found) != 1:
            count = "is no channel" if not found else f"are {len(found)} channels"
            known = ", ".join(channel_names(survey.vibration))
            raise ValueError(f"{one.channel!r} {count}; expected one of {known}")


def _rows_called(survey: Survey, word: str) -> list[SurveyedRow]:
    """Return the rows of vibration that are called so: by the name of the channel, else by their title or name."""
    rows = survey.vibration
    for spelled in (channel_names(rows), [row.title for row in rows], [row.name for row in rows]):
        found = [row for row, name in zip(rows, spelled, strict=True) if name.lower() == word.lower()]
        if found:
            return found
    return []
