"""Named values whose key is in no table: the fact on which each bears, by the words of the key and by its unit.

Such a value is never believed: where nothing else states a fact it is offered as an answer, where it contradicts a fact
it is doubted (:mod:`streams.files.contradictions`). The tables of :mod:`streams.files.keys` come first.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from streams.files.keys import (
    KEYS,
    LEVEL_UNITS,
    LEVELS,
    LIKE_RATE,
    LIKE_STEP,
    LOAD_UNITS,
    LOADS,
    MAX_OPEN_RATE,
    PER_G,
    SCALE_UNITS,
    SPEED_UNITS,
    SPEEDS,
    UNIT_IN_NAME,
)
from streams.files.statements import (
    Facts,
    is_date,
    is_of_vibration,
    known_unit,
    multiple_of,
    number_in,
    plain_unit,
    written_key,
)
from streams.files.zones import offset_in
from streams.types.block import STANDARD_GRAVITY
from streams.types.samples import Samples, UnlistedStatement
from streams.types.stamps import CLOCK, read_stamp

_MIN_HZ, _MAX_SPEED_HZ = 10.0, 500.0
"""Hz: slower sampling is of no vibration, no shaft turns faster."""
_SAMPLING = r"(?:ab ?tast|sampl|smpl|echantillon|muestre|campion|digiti[sz]|erfass)"
_NOT_SAMPLING = (
    r"temp|filter|cut ?off|corner|grenz|coupure|nyquist|\bmax|\bmin\b|band|reson|eigen|natural|\bline|netz|mains|\bbpf"
    r"|fault|slow|tacho|\brpm|speed|drehz|puls|video|audio|baud|alias|\bfft|spectr|spektr|trigger|over ?sam|up ?sam"
    r"|down ?sam|sub ?sam|master|\bbase|native|orig|before|source|\bgps|\bsd\b|\bbits?\b|count|number|anzahl|error"
    r"|deviat|jitter|drift|accura|toler|resol|\bmode|factor|display|update|report|\blog|poll|publish|nominal|size"
)
_PER_COUNT = {**SCALE_UNITS, **{unit: -size for unit, size in PER_G.items()}}
"""g in one count; negative: counts in one g."""
_G = {"g": 1.0, "gn": 1.0, "mg": 1e-3, **dict.fromkeys(("m/s2", "ms-2", "m/s/s"), 1.0 / STANDARD_GRAVITY)}
_ZONES = {"h": 3600.0, "hours": 3600.0, "min": 60.0, "minutes": 60.0, "mins": 60.0, "s": 1.0, "sec": 1.0}
_QUANTITIES = {"acceleration": r"accel|beschl|acelera", "velocity": r"veloc|geschwind|vitesse"}
_NEUTRAL = (0.0, 1.0)
_OPEN = {"rate": (1.0, 1e3), "step": (1.0, 1e3, 1e6), "speed": (1.0 / 60.0, 1.0)}
"""Factors of the readings of a number without a unit."""


@dataclass(frozen=True)
class _Rule:
    """How the words of a key say that its value bears on a fact.

    Attributes:
        words: an expression for the words, in lower case with blanks between; ``never`` one for words of other facts.
        units: that a value or a key may name, with their size; "" where a bare number is one, too.
        by_unit: units that tell the fact whatever the words are.
    """

    fact: str
    words: str
    never: str
    units: Mapping[str, float]
    by_unit: frozenset[str] = frozenset()


_RULES = (
    _Rule(
        "rate",
        rf"^(?=.*(?:{_SAMPLING}|\bacq|\bscan|\bdaq|\bdata|\bmess))"
        r"(?=.*(?:rat[ea]|fre[qckg]|frq|\bcl(?:oc)?k|takt|taux|tasso|\bk? ?hz))|\bfs\b|\bsps\b|\bodr\b",
        _NOT_SAMPLING,
        {**LIKE_RATE, "": 1.0},
    ),
    _Rule(
        "step",
        rf"^(?=.*{_SAMPLING})(?=.*(?:interval|period|abstand|schritt|\bstep|\bpas|\btime|zeit|spacing|\b[mun]?s\b))"
        r"|\bdt\b|\bdelta t\b|zeitschritt|\btime ?(?:step|incr|inc)",
        _NOT_SAMPLING,
        {**LIKE_STEP, "": 1.0},
    ),
    _Rule(
        "speed",
        r"drehzahl|\brpm\b|umdreh|tours?\b|rotat|rotor|shaft|\bwelle|spind|speed|velocidad|\bgiri|obrot",
        r"\bmax|\bmin\b|limit|alarm|warn|\btrip|rated|nominal|nenn|\bsync|wind|baud|paper|belt|ratio|toler|resol|sensor"
        r"|vibr|schwing|sound|light|sampl|tast|acq|scan|ramp|error|\bstd|puls|\bper\b|\bpro\b|torque|moment|cage|\bbpf"
        r"|fault|factor|unit|einheit|\bset|soll|diameter|durchm|load|last\b|count|anzahl|number|natural|reson|channel",
        {**SPEED_UNITS, "": 1.0},
        frozenset(unit for unit in SPEED_UNITS if unit not in ("hz", "1/s")),
    ),
    _Rule(
        "load",
        r"\bload|last\b|kraft|\bforce|charge|carga|carico|effort|fuerza|forza",
        r"cell|rated|\bmax|\bmin\b|limit|axial|thrust|torque|dynam|\bbasic|capacit|tragz|cpu|sens|empf|range|\bper\b"
        r"|pre ?load|vorsp|alarm|impact|hammer|frict|reib|weight",
        LOAD_UNITS,
    ),
    _Rule(
        "sensitivity",
        r"sensit|empfind|sensib",
        r"noise|cross|trans|quer|temp|mic|force|kraft|thresh|trigger|detect|alarm|coil|tacho|unit|einheit",
        {**LEVEL_UNITS["g"], "": 1.0},
        frozenset(LEVEL_UNITS["g"]),
    ),
    _Rule("scale", r"(?!)", r"temp|thresh|trigger|noise", _PER_COUNT, frozenset(_PER_COUNT)),
    _Rule(
        "factor",
        r"(?:ka?lib|calib|\bcal\b|etalon|korrekt|correct|conver|umrechn|wandl|skal|\bscal|echelle|escala).*?"
        r"(?:fa[kc]t|coef|koef|const|konst|gain|mult|slope|steig|\bwert|\bvalue)",
        r"\bni\b|date|datum|\bdue|temp|time|serial|\blab|cert|uncert|load|force|kraft|speed|rpm|axis|full|voll|tacho|window"
        r"|fenster|\bfft|energy|enbw|offset",
        {"": 1.0, "x": 1.0},
    ),
    _Rule(
        "gain",
        r"\bgain|verst.{1,2}rk|amplif|ganancia|guadagno",
        r"auto|range|\bagc|\bfft|temp|control|loop|\bpid|\bmic|type|model|serial|name|supply|strom|phase|unit",
        {"": 1.0, "x": 1.0, "v/v": 1.0},
    ),
    _Rule(
        "range",
        r"range|bereich|plage|rango|portata|gamme|full ?scale|vollaus|\bspan\b",
        r"freq|temp|time|zeit|speed|load|display|plot|axis|band|ticks?",
        _G,
    ),
    _Rule(
        "fill",
        r"(?:\bfill|missing|invalid|no ?data|fehl|ung.?ltig|\berr|dummy|sentinel|over(?:load|range)).*?"
        r"(?:val|wert|code|marker|number)",
        r"(?!)",
        {"": 1.0},
    ),
    _Rule(
        "unit",
        r"\bunits?\b|einheit|\bunite|unidad|\bunita\b",
        r"temp|speed|rpm|drehz|time|zeit|freq|\bx\b|absc|load|last|force|display|system|length|sensit|sensib|empf|number|\bid\b"
        r"|torque|pressure|druck|angle|test|control|device|range",
        {},
    ),
    _Rule(
        "quantity",
        r"quantity|me(?:ss|ß)gr|grandeur|magnitud|grandezza|measurand|signal ?(?:type|art)|measurement ?type",
        r"temp|speed|load|\bx\b",
        {},
    ),
    _Rule("zone", r"\btz\b|time ?zone|zeit ?zone|\butc\b|\bgmt\b|fuseau|\bhuso|\bfuso", r"(?!)", _ZONES),
    _Rule("end", r"\bend|\bstop|\bende\b|\bfin\b|\bfine\b|finish", r"modif|calib|kalib|valid|warrant|range|\blife", {}),
    _Rule(
        "start",
        r"start|\bbeg[ai]n|debut|inicio|inizio|anfang|record|aufn|aufz|\bmess|measur|acqui|trigger|\bdat|\btime|zeit"
        r"|stamp|epoch|\bfecha|\bhora\b|\bora\b|unix",
        r"\bend|\bstop|\bende\b|\bfin\b|modif|creat|erst|erzeug|export|import|print|save|speich|calib|kalib|\bcal\b|\bdue"
        r"|valid|expir|install|firmw|build|version|\blast\b|letzt|next|writ|download|report|process|upload|access|chang"
        r"|update|mount|birth|service|manuf|licen|boot|sync|zone|server|transfer|receiv|archiv",
        {},
    ),
)
_WITHOUT_UNIT = frozenset(key for table in (SPEEDS, LOADS, LEVELS) for key, unit in table.items() if not unit)
"""Keys of the tables that name no unit: with a bare number they state nothing."""


@lru_cache(maxsize=4096)
def bearings_of(key: str) -> tuple[tuple[str, str], ...]:
    """Return the facts on which a value under a key may bear, each with the unit that the key names, "" for none.

    ``key`` is as it is written: case and separators divide its words.
    """
    words = _words_of(key)
    text = " ".join(words)
    found: list[tuple[str, str]] = []
    for rule in _RULES:
        unit = _unit_in(key, words, rule.units)
        if (re.search(rule.words, text) or unit in rule.by_unit) and not re.search(rule.never, text):
            found.append((rule.fact, unit))
        elif rule.by_unit and not re.search(rule.never, text):
            # The unit of the value may tell it.
            found.append((rule.fact, "?"))
    return tuple(found)


def is_stating(key: str) -> bool:
    """Return whether a plain key may state a fact: it is in a table, or its words or the unit in it bear on one."""
    return key.partition("#")[0] in KEYS or any(unit != "?" for _, unit in bearings_of(written_key(key)))


def _words_of(key: str) -> list[str]:
    """Return the words of a key in lower case without accents: ``abtast frequenz kanal 1``."""
    plain = unicodedata.normalize("NFKD", key.translate({0xDF: "ss", 0x3BC: "u", 0xB5: "u"}))
    plain = re.sub("[\u0300-\u036f]", "", plain)
    plain = re.sub(r"(?<=[A-Za-z0-9])([kM]?Hz)(?![a-z])", r" \1", plain)
    found: list[str] = []
    for word in re.findall(r"[^\W\d_]+|\d+", plain):
        whole = plain_unit(word) in _WHOLE
        parts = [word] if whole else re.split(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", word)
        found += [part.lower() for part in parts if part]
    return found


_WHOLE = frozenset(unit for rule in _RULES for unit in (*rule.units, *_ZONES) if unit.isalpha())


def _unit_in(key: str, words: Sequence[str], units: Mapping[str, float]) -> str:
    """Return the unit that a key names in brackets or with its last words, but for a number behind; "" for none."""
    behind = UNIT_IN_NAME.match(key)
    if behind is not None:
        plain = plain_unit(behind[2])
        return plain if plain in units else ""
    for end in range(len(words), max(1, len(words) - 3), -1):
        for begin in range(max(1, end - 4), end):
            plain = plain_unit(" ".join(words[begin:end]))
            short = {"ms2": "m/s2", "mvg": "mv/g", "vg": "v/g", "glsb": "g/lsb", "mglsb": "mg/lsb"}.get(plain, plain)
            if short and short in units:
                return short
    return ""


def unlisted_in(
    facts: Facts, rows: Sequence[NDArray[np.floating]], zone: str, inside: str = ""
) -> tuple[UnlistedStatement, ...]:
    """Return what values under keys of no table may state, those that state nothing in any reading left out.

    Args:
        facts: under plain keys that remember how they are written.
        rows: the samples of which they are stated, as stored.
        zone: IANA name of the zone of stamps that name none.
        inside: the row of which they are stated, behind a place, "" for all.
    """
    found: list[UnlistedStatement] = []
    for key, value in facts.items():
        plain, _, place = key.partition("#")
        if plain in KEYS and not (plain in _WITHOUT_UNIT and number_in(value, "", {"": 1.0}) is not None):
            continue
        written = written_key(key)
        if " " in plain and written == plain:
            continue
        for fact, unit in bearings_of(written):
            stated = _stated(fact, unit, f"{place or written}{inside}", value, rows, zone)
            if stated is not None:
                found.append(stated)
                break
    return tuple(found)


def bearing_on(found: Sequence[UnlistedStatement], units: Sequence[str | None]) -> tuple[UnlistedStatement, ...]:
    """Return statements once each; a gain matters to rows in V or in none of the ``units`` alone."""
    if not found:
        return ()
    is_raw = any(unit is None or multiple_of(unit)[0] == "V" or not is_of_vibration(unit) for unit in units)
    return tuple(one for one in dict.fromkeys(found) if is_raw or one.fact != "gain")


def _stated(
    fact: str, unit: str, place: str, value: object, rows: Sequence[NDArray[np.floating]], zone: str
) -> UnlistedStatement | None:
    """Return what a value states of a fact; None where it is none of that."""
    written = str(value).strip()[:40]
    rule = next(rule for rule in _RULES if rule.fact == fact)
    if fact in ("start", "end"):
        return _time_of(fact, place, value, written, zone)
    if fact == "zone":
        offset = offset_in(written, unit)
        return None if offset is None else UnlistedStatement(fact, place, written, (offset,))
    if fact == "unit":
        known = known_unit(value)
        is_level = is_of_vibration(known) and multiple_of(known)[0] != "V"
        return UnlistedStatement(fact, place, written, text=known or "") if is_level else None
    if fact == "quantity":
        meant = [name for name, words in _QUANTITIES.items() if re.search(words, written.lower())]
        return UnlistedStatement(fact, place, written, text=meant[0]) if len(meant) == 1 else None
    return _number_of(rule, unit, place, value, written, rows)


def _number_of(
    rule: _Rule, unit: str, place: str, value: object, written: str, rows: Sequence[NDArray[np.floating]]
) -> UnlistedStatement | None:
    """Return what a number states of a fact, in SI or as facts are counted; None where it is none of that."""
    fact = rule.fact
    text = re.sub(r"^\s*(?:\+/?-|±|\+-)\s*", "", value) if fact == "range" and isinstance(value, str) else value
    named = {spelled: size for spelled, size in rule.units.items() if spelled}
    known = {**named, "": named[unit]} if unit not in ("", "?") else {**named}
    if unit == "?":
        known = {spelled: size for spelled, size in named.items() if spelled in rule.by_unit}
    elif "" in rule.units:
        known.setdefault("", 1.0)
    if fact == "gain" and (decibels := number_in(text, place, {"db": 1.0})) is not None:
        gain = 10.0 ** (decibels.readings[0] / 20.0)
        return None if gain in _NEUTRAL else UnlistedStatement(fact, place, written, (gain,))
    number = number_in(text, place, known)
    if number is None:
        return None
    is_bare = number_in(text, place, {"": 1.0}) is not None and unit in ("", "?")
    readings, resolution = number.readings, number.resolution
    if fact == "scale":
        size = next((size for spelled, size in _PER_COUNT.items() if _has_unit(written, spelled, unit)), 1.0)
        readings = tuple(-1.0 / one if size < 0.0 else one for one in readings if one)
    if fact == "step":
        readings, resolution = tuple(1.0 / one for one in readings if one > 0.0), 0.0
    if is_bare and fact in _OPEN and (fact != "rate" or min(readings) <= MAX_OPEN_RATE):
        readings = tuple(one * factor for factor in _OPEN[fact] for one in readings)
    if fact in ("rate", "step"):
        readings = tuple(one for one in readings if _MIN_HZ <= one < 1e9)
    if fact == "speed":
        readings = tuple(one for one in readings if 0.0 < one <= _MAX_SPEED_HZ)
    if fact == "fill":
        count = sum(int(np.count_nonzero(row == readings[0])) for row in rows)
        return UnlistedStatement(fact, place, written, readings, text=str(count)) if count else None
    if not readings or (fact in ("factor", "gain") and readings[0] in _NEUTRAL) or max(readings) <= 0.0:
        return None
    return UnlistedStatement(fact, place, written, readings, resolution)


def _has_unit(written: str, unit: str, of_key: str) -> bool:
    return unit == of_key or plain_unit(re.sub(r"^[-+\d.,eE\s]+", "", written)) == unit


def _time_of(fact: str, place: str, value: object, written: str, zone: str) -> UnlistedStatement | None:
    """Return the readings of a date with a time of day, and "local" where it names no zone; None for anything else."""
    if isinstance(value, str) and (is_date(value) or CLOCK.fullmatch(value.strip())):
        return None
    stamp = read_stamp(value, zone)
    if stamp is None:
        return None
    times = stamp.readings
    if not times or min(times) < 1e8:
        return None
    return UnlistedStatement(fact, place, written, times, stamp.resolution, "local" if stamp.local else "")


def offers_for(samples: Samples, fact: str) -> tuple[UnlistedStatement, ...]:
    """Return what unlisted values state of a fact that nothing else does: "rate" those of a step, too."""
    facts = ("rate", "step") if fact == "rate" else (fact,)
    return tuple(one for one in samples.unlisted if one.fact in facts)
