"""What to write instead of a key, a value or a line that the configuration does not know."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from streams.files.statements import multiple_of

_CONVERSIONS: dict[str, tuple[str, float]] = {
    "rpm": ("hz", 1 / 60),
    "upm": ("hz", 1 / 60),
    "khz": ("hz", 1e3),
    "kn": ("newton", 1e3),
    "n": ("newton", 1.0),
    "m": ("mm", 1e3),
    "cm": ("mm", 10.0),
    "inch": ("mm", 25.4),
    "in": ("mm", 25.4),
    "mm": ("um", 1e3),
    "rad": ("deg", 57.29577951308232),
    "ms": ("s", 1e-3),
    "min": ("s", 60.0),
    "minutes": ("s", 60.0),
    "seconds": ("s", 1.0),
    "sec": ("s", 1.0),
    "h": ("hours", 1.0),
    "hr": ("hours", 1.0),
    "mb": ("gb", 1e-3),
    "days": ("hours", 24.0),
    "m_s2": ("g", 1 / 9.80665),
    "ms2": ("g", 1 / 9.80665),
}
"""By the unit at the end of a key: that of the configuration, and the factor to it."""
_FACTORS = {
    "mv_per_ms2": 9.80665, "mv_per_m_s2": 9.80665, "mv_per_m_per_s2": 9.80665, "v_per_g": 1e3, "v_per_ms2": 9806.65,
    "v_per_m_s2": 9806.65,
}  # fmt: skip
"""Units of a sensitivity, and the factor to mV per g."""
_USUAL_NAMES: dict[str, dict[str, str]] = {
    "operating": {
        "speed_rpm": "rpm rotational_speed_rpm shaft_speed_rpm",
        "speed_hz": "shaft_speed_hz rotation_hz frequency_hz",
        "load_newton": "load radial_load_newton force_newton",
    },
    "source": {
        "rate_hz": "rate fs fs_hz sampling_rate sampling_rate_hz sample_rate sample_rate_hz sampling_frequency "
        "sampling_frequency_hz",
        "rate_khz": "sampling_rate_khz sample_rate_khz fs_khz",
        "url": "path folder file dir directory",
        "start_utc": "start start_time",
        "block_s": "block block_length block_length_s",
        "format": "type file_format",
        "time_name": "date_format time_format date_pattern",
        "interval_s": "interval",
        "range_g": "range",
    },
    "channel": {
        "sensitivity_mv_per_g": "sensitivity",
        "band_hz": "band bands bands_hz",
        "unit": "units",
        "scale": "factor gain",
        "column": "col",
        "key": "variable",
    },
    "bearing": {
        "designation": "type model number part_number",
        "n_elements": "n_balls balls z rollers n_rollers",
        "element_diameter_mm": "ball_diameter_mm roller_diameter_mm d_mm",
        "element_diameter_m": "ball_diameter_m",
        "element_diameter_inch": "ball_diameter_inch ball_diameter_in",
        "pitch_diameter_mm": "pitch_mm",
        "contact_angle_deg": "contact_angle",
        "clearance_um": "clearance",
        "element_length_mm": "roller_length_mm",
    },
    "gear.wheel": {"teeth": "z n_teeth tooth_count number_of_teeth", "name": "wheel id"},
    "gear.pair": {"wheels": "wheel gears", "module_mm": "module m_n normal_module_mm"},
}
"""Other names of keys, by section and key (or a key that is converted further)."""
_SYNONYMS = {
    section: {name: key for key, names in keys.items() for name in names.split()}
    for section, keys in _USUAL_NAMES.items()
}
TABLES = (
    "bearing",
    "source",
    "channel",
    "interference",
    "gear.wheel",
    "gear.pair",
    "gear.shaft",
    "gear.support",
    "gear.torsion",
    "gear.fault",
)
"""Sections that are arrays of tables."""
_OTHER_UNITS = {"um", "mm", "µm", "mil", "pa", "n", "db"}
_SPOKEN = re.compile(r"\s*([-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?)\s*([A-Za-zµ°/²2]*)\s*")


def header(section: str) -> str:
    """Return the header of a section as it is written."""
    return f"[[{section}]]" if section in TABLES else f"[{section}]"


_CREDENTIALS = re.compile(r"://\S*@")


def shown(value: Any, limit: int = 60) -> str:
    """Return a value as it is written in TOML, shortened; of a URL, without the name and password in it."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, str):
        text = '"' + _CREDENTIALS.sub("://***@", value).replace("\\", "\\\\").replace('"', '\\"') + '"'
    elif isinstance(value, float):
        text = f"{value:.6g}"
    elif isinstance(value, list | tuple):
        text = f"[{', '.join(shown(item) for item in value)}]"
    else:
        text = str(value)
    return text if len(text) <= limit else f"{text[:limit]}..."


def unknown_key(section: str, key: str, value: Any, known: Sequence[str], others: Mapping[str, Sequence[str]]) -> str:
    """Return what to write in the place of an unknown key.

    Args:
        section: where it stands, "" at the top of the file.
        known: the keys of that section.
        others: the keys of all sections, by section.
    """
    low = key.lower().replace("-", "_")
    meant = low if low in known else _SYNONYMS.get(section, {}).get(low, low)
    if section == "source" and low in ("path", "folder", "dir", "directory") and isinstance(value, str):
        return f'write url = "folder:{value}"'
    if meant in known:
        return f"write {meant} = {shown(value)}"
    converted = _converted(meant, value, known)
    if converted is not None:
        return converted
    owners = [name for name, keys in others.items() if name != section and meant in keys]
    if owners:
        return f"it belongs into {' or '.join(map(header, owners))}"
    if meant != low:
        return f"write {meant}"
    near = difflib.get_close_matches(low, known, n=1)
    if near:
        return f"did you mean {near[0]!r}?"
    elsewhere = {key: name for name, keys in others.items() for key in keys}
    near = difflib.get_close_matches(low, elsewhere, n=1, cutoff=0.75)
    return f"did you mean {near[0]!r} of {header(elsewhere[near[0]])}?" if near else ""


def _converted(key: str, value: Any, known: Sequence[str]) -> str | None:
    """Return the line of a key in the unit of the configuration, None where there is none such."""
    for ending, factor in _FACTORS.items():
        if key == f"sensitivity_{ending}" and "sensitivity_mv_per_g" in known:
            return _line("sensitivity_mv_per_g", value, factor)
    for ending, (unit, factor) in _CONVERSIONS.items():
        stem = key.removesuffix(f"_{ending}")
        if stem != key and f"{stem}_{unit}" in known:
            return _line(f"{stem}_{unit}", value, factor)
    return None


def _line(key: str, value: Any, factor: float) -> str:
    numbers = value if isinstance(value, list) else [value]
    if not all(isinstance(number, int | float) and not isinstance(number, bool) for number in numbers):
        return f"write {key}, which is {factor:.6g} times as much"
    converted = [f"{number * factor:.6g}" for number in numbers]
    return f"write {key} = " + (f"[{', '.join(converted)}]" if isinstance(value, list) else converted[0])


def wrong_value(section: str, key: str, value: Any) -> str:
    """Return what to write in the place of a value of another kind, "" where nothing is known."""
    table = f"{section}.{key}".removeprefix(".")
    if isinstance(value, dict) and table in TABLES:
        return f"write [[{table}]] with double brackets"
    if isinstance(value, list) and section == "" and value and isinstance(value[0], dict):
        return f"write [{key}] with single brackets"
    if key == "speed" and isinstance(value, int | float):
        return f"write speed_hz = {value:g}, the turns per second"
    if key == "unit" and isinstance(value, str):
        return _unit_hint(value)
    if isinstance(value, str):
        return _number_hint(key, value)
    return ""


def _unit_hint(unit: str) -> str:
    own, factor = multiple_of(unit.strip())
    if factor != 1.0:
        line = f'write unit = "{own}" and scale = {factor:g}'
        return line + (" with sensitivity_mv_per_g" if own == "V" else "")
    if unit.strip().lower() in _OTHER_UNITS:
        return 'not a unit of acceleration or velocity; "unknown" serves naming and relative trends'
    return ""


def _number_hint(key: str, text: str) -> str:
    """Return the line of a number that was written with a comma or a unit."""
    match = _SPOKEN.fullmatch(text)
    if match is None:
        return ""
    number, unit = float(match[1].replace(",", ".")), match[2].lower()
    stem, _, ending = key.rpartition("_")
    if unit and unit != ending:
        to, factor = _CONVERSIONS.get(unit, ("", 0.0))
        if to != ending or not stem:
            return ""
        number *= factor
    return f"write {key} = {number:.6g}"


def syntax_hint(line: str, message: str) -> str:
    """Return what is wrong with a line that is not valid TOML, "" where nothing is known.

    Args:
        line: the text of the line.
        message: of the parser.
    """
    key, equals, value = (part.strip() for part in line.partition("="))
    if "escape" in message or ("\\" in value and value.startswith('"')):
        return "in double quotes a backslash begins an escape; write the path with / or in single quotes"
    if equals and re.fullmatch(r"[-+]?\d+,\d+(?:\s*#.*)?", value):
        return f"numbers have a decimal point: {key} = {value.replace(',', '.', 1)}"
    if equals and value in ("True", "False", "yes", "no", "on", "off"):
        return f"write {key} = {'true' if value in ('True', 'yes', 'on') else 'false'}"
    if equals and re.match(r"[-+]?\d+(?:\.\d+)?\s*[A-Za-z]", value):
        return "a number has no unit behind it; the key names the unit"
    if equals and re.match(r"[A-Za-z/~.]", value):
        return f'a text stands in quotes: {key} = "{value.split("#")[0].strip()}"'
    if not equals and re.match(r"\s*[\w-]+\s*:", line):
        name, _, rest = line.partition(":")
        return f"write {name.strip()} = {rest.strip()}"
    if "overwrite" in message:
        return "this key is given twice in its section"
    if "twice" in message or "already" in message or "mutable namespace" in message:
        return "this section is given twice; sections of several entries have double brackets, such as [[channel]]"
    return ""


_MAX_LINES = 20
_WHERE = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


def syntax_problems(text: str, message: str) -> list[str]:
    """Return ``LINE: problem`` for each line of a text that is not valid TOML.

    A line is left out once it is known to be wrong, so that the next one can be found.

    Args:
        message: of the parser for the whole text.
    """
    lines = text.splitlines() or [""]
    left, found = list(lines), dict[int, str]()
    headless = False
    while message and len(found) < _MAX_LINES:
        where = _WHERE.search(message)
        line = len(lines) if where is None or where[1] is None else min(int(where[1]), len(lines))
        if line in found:
            break
        written = lines[line - 1].strip()
        # Without a header, its keys stand in the section above, where they may be given twice.
        if not (headless and "overwrite" in message):
            reason = message if where is None else message[: where.start()]
            hint = syntax_hint(written, message)
            found[line] = f"not valid TOML: {reason}, found {written[:80]!r}{f'; {hint}' if hint else ''}"
        headless = headless or written.startswith("[")
        if not left[line - 1]:
            break
        left[line - 1] = ""
        message = _message(left)
    return [f"{line}: {found[line]}" for line in sorted(found)]


def _message(lines: list[str]) -> str:
    """Return what the parser says of lines, "" where they are valid."""
    try:
        tomllib.loads("\n".join(lines) + "\n")
    except tomllib.TOMLDecodeError as error:
        return str(error)
    return ""
