"""Wheels of gears as text for people: what is named of them, and why one was not judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

NAMED = "gear:"
"""Beginning of the value of ``fault`` that names a wheel."""

GEAR_KINDS = {
    "tooth": "a damaged tooth",
    "eccentric": "an eccentric wheel",
    "uncertain": "of which kind is open",
}
"""What may be wrong with a wheel that is named, a hint."""

GEAR_STATUSES = {
    "ok": "judged",
    "learning": "what healthy means for it is being learned",
    "too_short": "the block holds too few turns of it",
    "no_angle": "the angle of its shaft is not known well enough",
    "above_band": "the sampling rate does not hold its mesh",
    "outside_conditions": "speed or load is beyond what was learned",
    "bad_block": "the quality of the block does not allow it",
}
"""Whether a wheel was judged in a block, or why not, by ``gear_status``."""


def gear_words(fault: str | None, kind: str | None = None) -> str:
    """Return a named wheel for people, "" for none; several that turn alike cannot be told apart."""
    if fault is None or not fault.startswith(NAMED):
        return ""
    words = "gear " + " or ".join(fault.removeprefix(NAMED).split("|"))
    return f"{words} ({GEAR_KINDS[kind]})" if kind in GEAR_KINDS else words


def gears_line(channel: Mapping[str, Any]) -> str:
    """Return what a channel's status says of its wheels in one line, "" without gears."""
    gears: Mapping[str, Mapping[str, Any]] = channel.get("gears") or {}
    if not gears:
        return ""
    named = gear_words(channel.get("gear_fault"), channel.get("gear_kind"))
    statuses = {name: str(found.get("status")) for name, found in gears.items()}
    refused = [f"{name}: {GEAR_STATUSES.get(status, status)}" for name, status in statuses.items() if status != "ok"]
    return "; ".join([named or "no gear named", *refused])


def figures_of(found: Mapping[str, Any], names: Sequence[str] = ("fm0", "fm4", "na4", "m6a")) -> str:
    """Return the indicators of a wheel by their names, "" where it has none."""
    values = {name: found.get(name) for name in names}
    return ", ".join(f"{name.upper()} {value:.3g}" for name, value in values.items() if value is not None)
