"""What a replay says of the times of its blocks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from monitor.health.record import Record
from streams.dates.drift import drift_words
from streams.dates.observed import ClockState
from streams.types.stamps import utc_text

MAX_DOUBTFUL = 100
"""Blocks with a doubtful time that are listed; all are counted."""


@dataclass
class BlockTimes:
    """Sources and uncertainties of the times of blocks, and the blocks whose clock is doubted.

    Attributes:
        sources: number of blocks by what dates them.
        largest, least: uncertainty of a time, s, None where none is known.
        doubtful: the first ``MAX_DOUBTFUL`` of ``doubted`` blocks, as JSON has them.
    """

    sources: Counter[str] = field(default_factory=Counter[str])
    largest: float | None = None
    least: float | None = None
    doubted: int = 0
    doubtful: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    def add(self, record: Record) -> None:
        """Count a record."""
        values = next(iter(record.channels.values()), None)
        if values is None:
            return
        source, uncertainty = values.get("time_source"), values.get("time_uncertainty_s")
        if source is not None:
            self.sources[source] += 1
        if uncertainty is not None:
            self.largest = max(uncertainty, self.largest or 0.0)
            self.least = min(uncertainty, uncertainty if self.least is None else self.least)
        if "clock" not in record.flags:
            return
        self.doubted += 1
        if len(self.doubtful) < MAX_DOUBTFUL:
            self.doubtful.append(
                {
                    "block": record.sequence,
                    "name": record.name,
                    "time_utc": _utc(record.time),
                    "time_uncertainty_s": uncertainty,
                    "time_source": source,
                    "stated_utc": _utc(values.get("time_stated")),
                    "reason": record.reason,
                }
            )

    @property
    def values(self) -> dict[str, Any]:
        """The keys of ``--json``."""
        return {
            "time_uncertainty_s": self.largest,
            "time_source": dict(self.sources),
            "doubtful_times": self.doubtful,
        }

    def sentences(self, clock: ClockState, zone: str) -> Iterator[str]:
        """Yield what is said to people; ``zone`` is that of local times."""
        if any(source.endswith("_local") for source in self.sources):
            yield f"they name no zone: local time of {zone} as configured ([machine] timezone)"
        if clock.drift is not None and self.least is not None and abs(clock.drift[0]) > 2.0 * self.least:
            yield f"the clock is {drift_words(clock.drift)}"
        if self.doubtful:
            first = self.doubtful[0]
            blocks = "1 block has" if self.doubted == 1 else f"{self.doubted} blocks have"
            yield f"{blocks} a doubtful time, first block {first['block']} ({first['name']}): {first['reason']}"


def _utc(seconds: float | None) -> str | None:
    return None if seconds is None else utc_text(seconds)
