"""The table of what is doubtful in configurations and recordings, shared by the commands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from monitor.config.load import Config
from monitor.config.plausible.doubt import Doubt, Severity
from monitor.config.positions import Place


@dataclass(frozen=True)
class DoubtRule:
    """One row of the table.

    Attributes:
        about: the keys that it is about, or what of a recording.
        problem, warning: what is one; "" where nothing is.
        refused: whether ``run`` and ``replay`` refuse its problems: every result would be wrong.
    """

    about: str
    problem: str = ""
    warning: str = ""
    refused: bool = False


RULES: dict[str, DoubtRule] = {
    "speed": DoubtRule(
        "speeds, also of files", "beyond the bearing: rpm", "more than usual; below 0.02 Hz", refused=True
    ),
    "speed_limits": DoubtRule("`min_speed_hz`, `max_speed_hz`, `speed_range_hz`", "without `speed_hz`"),
    "geometry": DoubtRule(
        "`[[bearing]]`",
        "elements overlap; pitch below 2 mm: inches",
        "elements far apart; angle in rad; clearance above 5 %",
        refused=True,
    ),
    "load": DoubtRule("loads, also of files", "above 5 C, below C/2000 (dynamic rating C): kN", "above C, below C/500"),
    "rate": DoubtRule(
        "`rate_hz`, also of files",
        "below 200 Hz; half of it below the first lines: kHz",
        "half of it below five harmonics",
        refused=True,
    ),
    "band": DoubtRule(
        "`band_hz`, `rms_band_hz`",
        "below 100 Hz: kHz; narrower than the first lines; above half the rate; none below the limit of a velocity",
        "narrower than five harmonics; below 500 Hz, above 50 kHz; of a velocity above 2 kHz without `sensor_max_hz`",
        refused=True,
    ),
    "block": DoubtRule(
        "`block_s`, length of files",
        "under 8 periods of a line; over 1 GiB",
        "under two or over 1000 turns of the cage: ms",
    ),
    "settle": DoubtRule("`settle_s`", "", "over 10 minutes: ms"),
    "tacho_rate": DoubtRule("`pulses_per_revolution`", "under 2.5 samples a pulse"),
    "mains": DoubtRule("fault lines", "", "on multiples of 50, 60 Hz"),
    "sensitivity": DoubtRule("`sensitivity_mv_per_g`", "outside 1 to 10000: V/g", refused=True),
    "duplicate": DoubtRule("`column`, `key`, `url`", "read twice for one bearing"),
    "learning": DoubtRule("`learn_hours`, `learn_blocks`", "", "over 90 days, under 10 blocks"),
    "end_of_life": DoubtRule("`end_of_life_peak_g`", "given beyond `range_g`", "outside 1 to 150 g; reached by files"),
    "alarm_level": DoubtRule(
        "`[[alarms.level]]`", "beyond `range_g`; speed or load outside its range", "above 500 g or 500 mm/s"
    ),
    "level_unlearned": DoubtRule("`alert_sd`, `alert_factor`", "added after learning"),
    "threshold": DoubtRule("`threshold_mm2`", "beyond the map; above (element diameter)²", "above a tenth of that"),
    "damage": DoubtRule("`track`", "map, library or unit missing; of a velocity", "rig not calibrated"),
    "rig": DoubtRule("`[rig]`", "", "unproven claims"),
    "place": DoubtRule("`url`", "path does not exist", "empty, partly closed, or a recording"),
    "access": DoubtRule(
        "`tcp://`, `mqtt://`", "no key, unusable files", "`peers` without key, weak key, bare password"
    ),
    "extra": DoubtRule("`[publish]`, `[notify]`, `opcua`", "packages missing"),
    "unit_unknown": DoubtRule("`unit`", "", "unknown: no end of life"),
    "no_speed": DoubtRule("`speed_hz`", "stated nowhere", "left to recordings"),
    "interference": DoubtRule("`[[interference]]`", "", "removes a fault line"),
    "refused": DoubtRule("the file", "`run` refuses it"),
    "file": DoubtRule("first, last file", "would be rejected"),
    "unlisted": DoubtRule("first, last file", "", "an unknown key contradicts"),
    "dating": DoubtRule("dates", "contradictory", "none"),
    "clock": DoubtRule("dates", "", "flagged `clock`"),
    "clocks": DoubtRule("dates", "", "two sources hours apart or never together"),
    "tacho": DoubtRule("pulses", "give no angle"),
    "file_speed": DoubtRule("speed of files", "60 times `speed_hz`, or a 60th", "a quarter off"),
    "constant": DoubtRule("samples", "all equal"),
    "numbers": DoubtRule("samples", "no numbers"),
    "flagged": DoubtRule("samples", "", "flagged: `flat`, `filled`"),
    "clipping": DoubtRule("samples", "", "clipped"),
    "bias": DoubtRule("mean", "7 to 14 V, over 10 g: bias"),
    "gravity": DoubtRule("mean", "gravity in the other unit"),
    "high_level": DoubtRule("level", "above 100 g RMS, 1000 g peak or `range_g`; 500 mm/s", "above 30 g RMS"),
    "low_level": DoubtRule("level", "below 0.1 mg RMS", "below 3 mg, 0.001 mm/s; in one of two"),
    "alternating": DoubtRule("files", "alternate between two sensors"),
    "same_signal": DoubtRule("two channels", "one signal, or a multiple"),
}
"""The rules by name, in the order in which they are documented."""


def rules_table() -> str:
    """Return the table of docs/reference/configuration.md, in Markdown; rules about the same share a row."""
    rows: dict[str, tuple[list[str], list[str]]] = {}
    for rule in RULES.values():
        problems, warnings = rows.setdefault(rule.about, ([], []))
        problems += [rule.problem + (" **!**" if rule.refused else "")] if rule.problem else []
        warnings += [rule.warning] if rule.warning else []
    lines = [f"|{about}|{'; '.join(problems)}|{'; '.join(warnings)}|" for about, (problems, warnings) in rows.items()]
    return "\n".join(["|what|problem|warning|", "|---|---|---|", *lines])


@dataclass(frozen=True)
class SourceFacts:
    """What the files of a source state where the configuration does not; None where neither does.

    Attributes:
        rate: Hz.
        duration: of a block, s.
        speed: of the shaft, Hz.
        span: starts of the first and the last file, s since 1970 UTC.
        lag: of the last changes of both against their ends, s, where these agree.
    """

    rate: float | None = None
    duration: float | None = None
    speed: float | None = None
    span: tuple[float, float] | None = None
    lag: float | None = None


NOTHING_STATED = SourceFacts()


@dataclass(frozen=True)
class JudgedConfig:
    """A configuration that is judged, and what is known of its sources by name."""

    config: Config
    facts: Mapping[str, SourceFacts] = field(default_factory=dict[str, SourceFacts])

    def doubt(self, rule: str, severity: Severity, place: Place, expected: str, came: str) -> Doubt:
        """Return what is doubtful at a place of the configuration."""
        return Doubt(rule, severity, expected, came, place, key_words(self.config, place))

    def facts_of(self, source: str) -> SourceFacts:
        """Return rate, length of a block and speed of a source: as configured, else as its files state them."""
        section = next(section for section in self.config.source if section.name == source)
        found = self.facts.get(source, NOTHING_STATED)
        return SourceFacts(
            rate=section.rate_hz or found.rate,
            duration=found.duration if section.block_s == "file" else section.block_s,
            speed=found.speed or self.config.operating.speed_hz,
        )


def key_words(config: Config, place: Place) -> str:
    """Return a place in words, entries by their names: ``channel[drive].band_hz``."""
    words, value = "", config
    for part in place:
        if isinstance(part, int):
            value = value[part] if isinstance(value, tuple) and part < len(value) else None
            words += f"[{_name(value) or part + 1}]"
        else:
            value = getattr(value, part, None)
            words += f".{part}"
    return words.removeprefix(".")


def _name(entry: Any) -> str:
    return getattr(entry, "rule_name", "") or getattr(entry, "name", "") or ""


def place_of(config: Config, section: str, name: str, *keys: str) -> Place:
    """Return the place of a key of ``[[source]]``, ``[[channel]]`` or ``[[bearing]]`` by the name of its entry."""
    entries = getattr(config, section)
    return (section, next(at for at, entry in enumerate(entries) if entry.name == name), *keys)


def refusals(doubts: Iterable[Doubt]) -> list[Doubt]:
    """Return the doubts for which ``run`` and ``replay`` refuse a configuration: every result would be wrong."""
    return [doubt for doubt in doubts if doubt.severity == "problem" and RULES[doubt.rule].refused]
