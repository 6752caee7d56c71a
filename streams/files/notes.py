"""Texts beside recordings whose format states little: rate, unit, sensitivity, speed as ``KEY: VALUE``."""

from __future__ import annotations

import os
from collections.abc import Container, Sequence
from dataclasses import replace
from pathlib import Path

from streams.files.circumstances import circumstances_of, without
from streams.files.container import read_guarded
from streams.files.formats.head import decoded, head_of
from streams.files.judge import judge_rate, judge_start, judge_unit, starts_of
from streams.files.keys import KEYS
from streams.files.statements import StatedNumber, rate_statements, unit_statements
from streams.types.listing import unpacked_name
from streams.types.samples import FRACTIONS, Samples

_MAX_BYTES = 1 << 16
NOTE_ENDINGS = (".txt", ".ini", ".info", ".cal")
"""Endings of texts beside recordings that state what the format cannot."""
_SILENT_ENDINGS = (".wav", ".flac", ".npy")


def note_of(root: Path, path: str) -> tuple[str, dict[str, object]] | None:
    """Return the path of the text beside a recording whose format states little, and what it states, or None.

    ``PUMP.txt`` beside ``PUMP.wav`` has lines ``KEY: VALUE`` as a head of text; one without a known key is none.
    ReaderError as for any file.
    """
    stem, ending = _stem_of(path)
    if ending not in _SILENT_ENDINGS:
        return None
    for name in [f"{base}{note}" for base in (stem, path) for note in NOTE_ENDINGS]:
        if os.path.lexists(f"{root}/{name}"):
            raw = read_guarded(root, name, max_bytes=_MAX_BYTES)
            facts = head_of([decoded(line).strip() for line in raw.splitlines()]).facts
            if any(key.partition("#")[0] in KEYS for key in facts):
                return name, facts
    return None


def is_note(path: str, recordings: Container[str]) -> bool:
    """Return whether a file is the text beside one of some recordings."""
    stem, ending = _stem_of(path)
    names = (stem, *(f"{stem}{silent}" for silent in _SILENT_ENDINGS))
    return ending in NOTE_ENDINGS and any(name in recordings for name in names)


def _stem_of(path: str) -> tuple[str, str]:
    stem, dot, ending = unpacked_name(path).rpartition(".")
    return (stem, f".{ending.lower()}") if dot else (path, "")


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
        count_scales=tuple(None if stored == FRACTIONS else beside.count for stored in samples.stored),
        open_gain=beside.gain,
        open_multiplier=beside.multiplier,
        stated_speed=beside.speed,
        stated_load=beside.load,
    )
