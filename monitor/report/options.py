"""Options of a report: defaults, and the table ``[report]`` of a TOML file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, tzinfo
from pathlib import Path
from typing import Any

from models.maps.data import RmsMap
from models.maps.file import load_map
from models.maps.plan import MapError
from monitor.report.runs import ReportError
from monitor.words.numbers import time_zone

PICTURES = {
    "trends": ("trends:trends",),
    "final_stage": ("trends:final_stage",),
    "envelope": ("spectrum:envelope",),
    "raw": ("raw_block:raw_block", "rotation:ias_picture"),
    "cyclic": ("cyclic:block_coherence",),
    "waterfall": ("waterfall:waterfall",),
    "kurtogram": ("waterfall:kurtograms",),
    "damage": ("damage:damaged_volume",),
    "path": ("map_path:map_path",),
    "posterior": ("map_path:posterior",),
    "law": ("damage:fitted_law",),
    "forecast": ("damage:forecasts",),
}
"""Pictures of a channel by section of the report: functions below ``monitor.report.figures``, of its context each."""
SECTIONS = (
    *PICTURES,
    *("speed", "quality", "events", "provenance", "guide", "comparison", "score"),
)
"""Sections of a report by their names in a configuration, see docs/how-to/reports.md."""
_KEYS = ("title", "timezone", "include", "leave_out", "maps")


@dataclass(frozen=True)
class Options:
    """Options of a report.

    Attributes:
        title: None for the names of the machines.
        maps: RMS maps by channel, "" for all channels; by default the cached one with the hash in the records.
        notes: sentences at the top.
    """

    title: str | None = None
    zone: tzinfo = UTC
    sections: frozenset[str] = frozenset(SECTIONS)
    maps: Mapping[str, RmsMap] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def map_for(self, channel: str) -> RmsMap | None:
        """Return the given map of a channel, None without one."""
        return self.maps.get(channel, self.maps.get(""))

    def holds(self, section: str) -> bool:
        """Tell whether a section is included."""
        return section in self.sections


def read_options(path: Path | None, base: Options = Options()) -> Options:
    """Read the table ``[report]`` of a TOML file, None for none; missing keys are those of ``base``.

    Raises:
        ReportError: naming the file, the key, what was expected and what came.
    """
    if path is None:
        return base
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get("report", {})
    except (OSError, ValueError) as error:
        raise ReportError(f"{path}: cannot be read as TOML: {error}") from error
    if not isinstance(table, dict):
        raise ReportError(f"{path}: [report] must be a table, got {table!r}")
    for key in table:
        if key not in _KEYS:
            raise ReportError(f"{path}: [report] {key}: not known; expected one of {', '.join(_KEYS)}")
    sections = base.sections
    if "include" in table:
        sections = _sections(path, "include", table["include"])
    if "leave_out" in table:
        sections -= _sections(path, "leave_out", table["leave_out"])
    title = table.get("title", base.title)
    if title is not None and not isinstance(title, str):
        raise ReportError(f"{path}: [report] title: expected a string, got {title!r}")
    named = table.get("maps", {})
    if not isinstance(named, dict) or not all(isinstance(value, str) for value in named.values()):
        raise ReportError(f"{path}: [report] maps: expected a table of channel = file, got {named!r}")
    maps = {**base.maps, **read_maps([f"{channel}={path.parent / file}" for channel, file in named.items()])}
    zone = zone_of(table["timezone"], f"{path}: [report] ") if "timezone" in table else base.zone
    return replace(base, title=title, sections=sections, maps=maps, zone=zone)


def _sections(path: Path, key: str, value: Any) -> frozenset[str]:
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise ReportError(f"{path}: [report] {key}: expected a list of names, got {value!r}")
    for name in value:
        if name not in SECTIONS:
            raise ReportError(f"{path}: [report] {key}: {name!r} is none of {', '.join(SECTIONS)}")
    return frozenset(value)


def zone_of(name: Any, where: str = "--") -> tzinfo:
    """Return a time zone by its name.

    Raises:
        ReportError: there is none of this name; ``where`` is the beginning of the message.
    """
    try:
        return time_zone(str(name))
    except ValueError as error:
        raise ReportError(f"{where}{error}") from None


def read_maps(given: Sequence[str]) -> dict[str, RmsMap]:
    """Read maps given as FILE (for all channels) or CHANNEL=FILE.

    Raises:
        ReportError: a file cannot be read as a map.
    """
    maps: dict[str, RmsMap] = {}
    for item in given:
        channel, equals, file = item.partition("=")
        if not equals:
            channel, file = "", item
        try:
            maps[channel] = load_map(Path(file))
        except (MapError, OSError) as error:
            raise ReportError(f"map {file}: {error}") from error
    return maps
