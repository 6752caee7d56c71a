"""The page of a fleet as HTML, from the summaries of replays; of a large one the worst recordings, with all numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, tzinfo
from typing import Any, Literal

from monitor.report.options import Options
from monitor.report.page import SYMBOLS, render
from monitor.report.verdict import GRADE_NAMES, Grade
from monitor.words.numbers import Clock, count, duration, interval, times_first, volume
from monitor.words.situation import Situation
from monitor.words.statuses import EDV_REFUSALS, TT_REFUSALS, named_words

FleetGrade = Grade | Literal["failed"]
FLEET_GRADES: dict[FleetGrade, str] = {
    "bad": GRADE_NAMES["bad"],
    "watch": GRADE_NAMES["watch"],
    "failed": "failed",
    "open": GRADE_NAMES["open"],
    "good": GRADE_NAMES["good"],
}
"""The worst first: damage outranks a recording that cannot be read."""
RANKS = {grade: rank for rank, grade in enumerate(FLEET_GRADES)}
_NONE = "–"


@dataclass(frozen=True)
class FleetChannel:
    """A channel after the last block of a recording, as text.

    Attributes:
        headline: the state, then the part.
        part: that is named, and whether it is a verdict or a hint.
        since: start of the final stage.
        v_eq, tt: damaged volume and time to threshold; "–" where there is none, with the reason in ``v_eq_why`` and
            ``tt_why``.
    """

    name: str
    grade: FleetGrade
    headline: str = ""
    part: str = _NONE
    since: str = _NONE
    v_eq: str = _NONE
    v_eq_why: str = ""
    tt: str = _NONE
    tt_why: str = ""


@dataclass(frozen=True)
class FleetEntry:
    """A recording of a machine.

    Attributes:
        channels: the worst first; those without a sign of damage only where there is no other.
        more: number of further channels.
        accepted, offered: blocks.
        quality: blocks that were flagged or rejected, by status, as text.
        period: first and last moment, as text.
        last: UTC of the last block, s since 1970, or None.
        reason, log: why it failed.
    """

    machine: str
    recording: str
    url: str
    grade: FleetGrade
    channels: tuple[FleetChannel, ...] = ()
    more: int = 0
    accepted: int = 0
    offered: int = 0
    quality: str = ""
    period: str = _NONE
    last: float | None = None
    reason: str = ""
    log: str = ""

    @property
    def rank(self) -> int:
        """Place of its grade, 0 the worst."""
        return RANKS[self.grade]

    @property
    def headline(self) -> str:
        """What is said of it in one line."""
        return self.reason if self.grade == "failed" else self.channels[0].headline if self.channels else "No channel"


def grade_of_channel(found: Situation) -> Grade:
    """Return the grade of a channel, by the rules of :func:`monitor.report.verdict.judge`."""
    if found.stage == "end_of_life":
        return "bad"
    if found.stage == "final":
        shared = found.level_of is not None and not found.fault
        return "open" if shared and not found.gear else "watch"
    if found.gear:
        return "watch"
    return "good" if found.stage == "healthy" and not found.fault else "open"


def channels_of(summary: Mapping[str, Any], zone: tzinfo) -> list[FleetChannel]:
    """Return the channels of the summary of a replay (the keys of ``replay --json``), the worst first."""
    bearings: Mapping[str, Mapping[str, Any]] = summary.get("bearings") or {}
    heard = {channel: name for name, found in bearings.items() for channel in found.get("channels") or ()}
    channels: Mapping[str, Mapping[str, Any]] = summary.get("channels") or {}
    found = []
    for name, channel in channels.items():
        bearing = heard.get(name, "")
        situation = Situation.of_status(name, channel, bearing).with_bearing(bearings.get(bearing))
        v_eq, v_eq_why = _volume(channel)
        tt, tt_why = _time_left(channel)
        found.append(
            FleetChannel(
                name=name,
                grade=grade_of_channel(situation),
                headline=_sentence(str(channel.get("headline") or "")),
                part=named_words(channel["fault"], channel.get("fault_basis")) if channel.get("fault") else _NONE,
                since=_since(channel, zone),
                v_eq=v_eq,
                v_eq_why=v_eq_why,
                tt=tt,
                tt_why=tt_why,
            )
        )
    return sorted(found, key=lambda channel: RANKS[channel.grade])


def shown_channels(channels: list[FleetChannel]) -> tuple[FleetChannel, ...]:
    """Return the channels that have a line of their own: all with damage, at least the worst."""
    return tuple(channel for place, channel in enumerate(channels) if place == 0 or channel.grade in ("bad", "watch"))


def quality_of(summary: Mapping[str, Any]) -> str:
    """Return the blocks that were rejected or flagged, by status: "2 rejected (nan), 5 flagged (3 gap, 2 clipped)"."""
    texts = []
    for kind in ("rejected", "flagged"):
        numbers: Mapping[str, int] = summary.get(kind) or {}
        if total := sum(numbers.values()):
            ordered = sorted(numbers.items(), key=lambda item: -item[1])
            by_status = ", ".join(name if len(ordered) == 1 else f"{number:,} {name}" for name, number in ordered)
            texts.append(f"{total:,} {kind} ({by_status})")
    if summary.get("pending"):
        texts.append(f"{summary['pending']:,} pending")
    return ", ".join(texts)


def period_of(first: float | None, last: float | None, blocks: int, zone: tzinfo) -> str:
    """Return from when to when the dated blocks of a recording are, or that they have no dates."""
    if first is None or last is None:
        return f"{count(blocks, 'block')} without dates" if blocks else _NONE
    clock = Clock(True, zone)
    begin, end = clock.short(first), clock.short(last)
    if begin == end:
        return begin
    same_day = begin[:10] == end[:10]
    return f"{begin} to {end[11:] if same_day else end}"


def _since(channel: Mapping[str, Any], zone: tzinfo) -> str:
    if channel.get("t_fs_utc"):
        return Clock(True, zone).short(datetime.fromisoformat(channel["t_fs_utc"]).timestamp())
    return _NONE if channel.get("t_fs_block") is None else f"block {channel['t_fs_block']:,}"


def _volume(channel: Mapping[str, Any]) -> tuple[str, str]:
    """Return V_eq with its interval, of a rig that is not calibrated as a multiple of its first value; or why not."""
    value, status = channel.get("v_eq_mm2"), channel.get("edv_status")
    why = "" if status is None else EDV_REFUSALS.get(status, "")
    if value is None:
        return _NONE, why
    if channel.get("calibrated") is False:
        relative = channel.get("v_eq_relative")
        return (_NONE, why) if relative is None else (times_first(relative), why)
    low, high = channel.get("v_eq_lower_mm2"), channel.get("v_eq_upper_mm2")
    ends = "" if low is None or high is None else f" ({interval(low, high, lambda end: f'{end:.3g}')})"
    return f"{volume(1e-6 * value)}{ends}", why


def _time_left(channel: Mapping[str, Any]) -> tuple[str, str]:
    """Return the time to the first threshold with its interval, where it may be relied upon, or why there is none."""
    value, status = channel.get("tt_s"), channel.get("tt_status")
    if status == "already_crossed" and channel.get("calibrated") is not False:
        return "threshold reached", ""
    if status != "ok" or value is None or channel.get("calibrated") is False:
        return _NONE, "" if status is None else TT_REFUSALS.get(status, "")
    low, high = channel.get("tt_lower_s"), channel.get("tt_upper_s")
    ends = "" if low is None else f" ({interval(low, float('inf') if high is None else high, duration)})"
    return f"{duration(value)}{ends}", ""


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


MAX_LISTED = 10_000
"""Recordings and machines with a line of their own; browsers open such a page within seconds."""
MAX_FAILURES = 500
"""Failures that are listed with their logs."""
MAX_STRIP = 120
"""Recordings of a machine that have a bar, the last ones."""
_MAX_LOG = 4000
FLEET_SYMBOLS: dict[FleetGrade, str] = {**SYMBOLS, "failed": "✕"}  # pyright: ignore[reportAssignmentType]


@dataclass
class FleetMachine:
    """A machine and its recordings.

    Attributes:
        counts: recordings by grade.
        strip: grades of its last recordings, in their order.
        worst: entry of the worst recording, of equals the last one.
        listed: entries with a line of their own, the worst first.
    """

    name: str
    counts: Counter[FleetGrade] = field(default_factory=Counter[FleetGrade])
    strip: list[FleetGrade] = field(default_factory=list[FleetGrade])
    worst: FleetEntry | None = None
    listed: list[FleetEntry] = field(default_factory=list[FleetEntry])

    @property
    def grade(self) -> FleetGrade:
        """The grade of its worst recording."""
        return "open" if self.worst is None else self.worst.grade

    @property
    def total(self) -> int:
        """Number of its recordings."""
        return self.counts.total()

    @property
    def by_grade(self) -> list[tuple[FleetGrade, int]]:
        """Grades of its recordings with their numbers, the worst first."""
        return [(grade, self.counts[grade]) for grade in FLEET_GRADES if self.counts[grade]]

    @property
    def strip_words(self) -> str:
        """The strip for those who do not see it."""
        which = "Recordings" if self.total <= MAX_STRIP else f"The last {MAX_STRIP} recordings"
        numbers = Counter(self.strip)
        texts = [f"{numbers[grade]} {name}" for grade, name in FLEET_GRADES.items() if numbers[grade]]
        return f"{which} in order: {', '.join(texts)}"

    def add(self, entry: FleetEntry) -> None:
        """Count a recording."""
        self.counts[entry.grade] += 1
        self.strip.append(entry.grade)
        del self.strip[:-MAX_STRIP]
        if self.worst is None or entry.rank <= self.worst.rank:
            self.worst = entry


@dataclass
class FleetTotals:
    """All machines, and of their recordings those that are listed."""

    machines: dict[str, FleetMachine] = field(default_factory=dict[str, FleetMachine])
    failures: list[FleetEntry] = field(default_factory=list[FleetEntry])
    blocks: int = 0
    _kept: list[tuple[int, int, FleetEntry]] = field(default_factory=list[tuple[int, int, FleetEntry]])
    _number: int = 0

    @classmethod
    def of(cls, entries: Iterable[FleetEntry]) -> FleetTotals:
        """Return the fleet of recordings, which are taken one by one."""
        found = cls()
        for entry in entries:
            found._add(entry)
        for _, _, entry in found._worst():
            found.machines[entry.machine].listed.append(entry)
        return found

    @property
    def total(self) -> int:
        """Number of recordings."""
        return self._number

    @property
    def failed(self) -> int:
        """Number of recordings that failed."""
        return sum(machine.counts["failed"] for machine in self.machines.values())

    @property
    def listed(self) -> int:
        """Number of recordings that are listed."""
        return sum(len(machine.listed) for machine in self.machines.values())

    @property
    def by_grade(self) -> list[tuple[FleetGrade, int]]:
        """Grades of all recordings with their numbers, the worst first."""
        counts = sum((machine.counts for machine in self.machines.values()), Counter[FleetGrade]())
        return [(grade, counts[grade]) for grade in FLEET_GRADES if counts[grade]]

    @property
    def ordered(self) -> list[FleetMachine]:
        """The machines, the worst first; of equals that with the most recordings so bad, then by name."""
        found = sorted(
            self.machines.values(),
            key=lambda machine: (RANKS[machine.grade], -machine.counts[machine.grade], machine.name),
        )
        return found[:MAX_LISTED]

    def _add(self, entry: FleetEntry) -> None:
        self.machines.setdefault(entry.machine, FleetMachine(entry.machine)).add(entry)
        self.blocks += entry.offered
        if entry.grade == "failed" and len(self.failures) < MAX_FAILURES:
            self.failures.append(entry)
        self._kept.append((entry.rank, self._number, entry))
        self._number += 1
        if len(self._kept) >= 2 * MAX_LISTED:
            self._kept = self._worst()

    def _worst(self) -> list[tuple[int, int, FleetEntry]]:
        """Return the worst recordings that were kept, of equals the last ones first."""
        return sorted(self._kept, key=lambda item: (item[0], -item[1]))[:MAX_LISTED]


def fleet_html(entries: Iterable[FleetEntry], *, title: str, zone: tzinfo) -> str:
    """Return the page of a fleet; dates are in ``zone``."""
    options = Options(title=title, zone=zone)
    return render(
        "fleet.html.j2",
        style_sheet="fleet.css",
        title=title,
        fleet=FleetTotals.of(entries),
        fleet_grades=FLEET_GRADES,
        fleet_symbols=FLEET_SYMBOLS,
        max_log=_MAX_LOG,
        options=options,
    )
