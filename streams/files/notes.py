"""Texts beside recordings whose format states little: rate, unit, sensitivity, speed as ``KEY: VALUE``."""

from __future__ import annotations

import os
import re
from collections.abc import Container, Sequence
from dataclasses import replace
from pathlib import Path

from streams.files.circumstances import circumstances_of, judge_number, without
from streams.files.container import read_guarded
from streams.files.formats.head import decoded, head_of
from streams.files.judge import judge_rate, judge_start, judge_unit, starts_of
from streams.files.statements import Facts, StatedNumber, number_in, rate_statements, unit_statements
from streams.files.unlisted import bearing_on, is_stating, unlisted_in
from streams.types.block import STANDARD_GRAVITY
from streams.types.listing import unpacked_name
from streams.types.samples import FRACTIONS, Samples

_MAX_BYTES = 1 << 16
NOTE_ENDINGS = (".txt", ".ini", ".info", ".cal")
"""Endings of texts beside recordings that state what the format cannot."""
_FULL_SCALE = re.compile(r"(?:channel|chan|ch|kanal|canal|canale|input)?([a-h1-8])?(?:fullscale|vollausschlag)")
_FULL_SCALE_UNITS = {
    "g": 1.0,
    "gn": 1.0,
    "mg": 1e-3,
    **dict.fromkeys(("m/s2", "ms-2", "m/s/s"), 1.0 / STANDARD_GRAVITY),
}
_PEAK = re.compile(r"(?:[\s_-]+(?:pk|peak|spitze))\s*$", re.IGNORECASE)
"""What full scale always is; of an RMS the factor to the peak is not known."""
_SILENT_ENDINGS = (".wav", ".flac", ".npy")


def note_of(root: Path, path: str) -> tuple[str, dict[str, object]] | None:
    """Return the path of the text beside a recording whose format states little, and what it states, or None.

    ``PUMP.txt`` beside ``PUMP.wav`` has lines ``KEY: VALUE`` as a head of text; one that states nothing is none.
    ReaderError as for any file.
    """
    top = str(root)
    for name in note_paths(path):
        if os.path.lexists(f"{top}/{name}"):
            raw = read_guarded(root, name, max_bytes=_MAX_BYTES)
            facts = head_of([decoded(line).strip() for line in raw.splitlines()]).facts
            if any(is_stating(key) or _FULL_SCALE.fullmatch(key.partition("#")[0]) for key in facts):
                return name, facts
    return None


def note_paths(path: str) -> list[str]:
    """Return the paths that the text beside a recording may have; none where its format states enough."""
    stem, ending = _stem_of(path)
    return [f"{base}{note}" for base in (stem, path) for note in NOTE_ENDINGS] if ending in _SILENT_ENDINGS else []


def is_note(path: str, recordings: Container[str]) -> bool:
    """Return whether a file is the text beside one of some recordings."""
    stem, ending = _stem_of(path)
    names = (stem, *(f"{stem}{silent}" for silent in _SILENT_ENDINGS))
    return ending in NOTE_ENDINGS and any(name in recordings for name in names)


def _stem_of(path: str) -> tuple[str, str]:
    stem, dot, ending = unpacked_name(path).rpartition(".")
    return (stem, f".{ending.lower()}") if dot else (path, "")


def _full_scales(facts: Facts, count: int, where: str) -> tuple[float | None, ...]:
    """Return the g at full scale of each of some rows: stated for all, or for each under the name of its channel."""
    stated: dict[str, list[StatedNumber]] = {}
    for key, value in facts.items():
        match = _FULL_SCALE.fullmatch(key.partition("#")[0])
        if match is not None:
            text = _PEAK.sub("", value) if isinstance(value, str) else value
            number = number_in(text, key, _FULL_SCALE_UNITS)
            if number is None or number.readings[0] <= 0.0:
                return (None,) * count
            stated.setdefault(match[1] or "", []).append(number)
    found = {channel: judge_number(numbers, "full scale", where) for channel, numbers in stated.items()}
    for names in (("",) * count, tuple(map(str, range(1, count + 1))), tuple("abcdefgh"[:count])):
        if found.keys() == set(names):
            return tuple(found[name] for name in names)
    return (None,) * count


def apply_note(
    samples: Samples, note: tuple[str, dict[str, object]], name: str, zone: str, disregard: Sequence[str]
) -> Samples:
    """Add what the text beside a recording states, which must agree with the recording.

    Raises:
        ReaderError: ``wrong_rate``, ``wrong_unit`` or ``unreadable`` where they contradict each other.
    """
    path, facts = note[0], without(note[1], disregard)
    where, count = f"{name}: {path}", len(samples.units)
    own = [] if samples.rate is None else [StatedNumber("the file", f"{samples.rate:g}", (samples.rate,))]
    rate = judge_rate([*own, *rate_statements(facts, where)], where)
    units = [judge_unit(unit_statements(facts), where, [("the file", unit)] if unit else []) for unit in samples.units]
    beside = circumstances_of(facts, where)
    return replace(
        samples,
        **rate.fields,
        **judge_start(starts_of(facts, zone), where).fields,
        units=tuple(units),
        sensitivities=(beside.sensitivity,) * count,
        count_scales=tuple(
            full if stored == FRACTIONS else beside.count
            for stored, full in zip(samples.stored, _full_scales(facts, count, where), strict=True)
        ),
        open_gain=beside.gain,
        open_multiplier=beside.multiplier,
        stated_speed=beside.speed,
        stated_load=beside.load,
        unlisted=bearing_on([*samples.unlisted, *unlisted_in(facts, list(samples.values), zone)], units),
    )
