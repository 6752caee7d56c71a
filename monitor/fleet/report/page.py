"""The page of a fleet as HTML; of a large one the worst recordings, with the numbers of all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import tzinfo

from monitor.fleet.report.entries import FLEET_GRADES, RANKS, FleetEntry, FleetGrade
from monitor.report.options import Options
from monitor.report.page import SYMBOLS, render

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
