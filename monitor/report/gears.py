"""What a report says of the wheels of gears: which is named, and the indicators of each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.report.readings import Finding
from monitor.report.runs import Channel, Run
from monitor.report.tables import Cell, Column, Table
from monitor.words.numbers import count
from monitor.words.statuses import GEAR_KINDS, GEAR_STATUSES, NAMED, gear_words

_QUESTION = "Which gear?"
_INDICATORS = ("fm0", "fm4", "na4", "m6a", "sideband_level")


@dataclass(frozen=True)
class NamedGear:
    """The wheel that is named after the last block: its place, the value of ``fault``, and the kind of its damage."""

    place: int
    fault: str
    kind: str

    @property
    def words(self) -> str:
        """Wheel and kind for people."""
        return gear_words(self.fault, self.kind)


def named_gear(run: Run, channel: Channel) -> NamedGear | None:
    """Return the wheel that is named after the last block, None without."""
    rows = np.flatnonzero((channel.words["gear_fault"] != "").any(axis=1))
    if not rows.size:
        return None
    kinds = channel.words["gear_fault"][rows[-1]].astype(str).tolist()
    place = next((place for place, kind in enumerate(kinds) if kind in GEAR_KINDS), None)
    if place is None:
        return None
    return NamedGear(place, NAMED + wheel_names(run, len(kinds))[place], kinds[place])


def gear_findings(run: Run, channel: Channel) -> tuple[Finding, ...]:
    """Return the wheel that is named after the last block; nothing for records without gears."""
    statuses = channel.words["gear_status"]
    rows = np.flatnonzero((statuses != "").any(axis=1))
    if not rows.size:
        return ()
    last, named = int(rows[-1]), named_gear(run, channel)
    judged = int(np.sum((statuses == "ok").any(axis=1)))
    if named is not None:
        place, words = named.place, named.words
        since = _since(channel, place, last)
        above = channel.column("gear_score", place)[since : last + 1]
        sentences = [
            f"Named since block {channel.sequence[since]:,}; above its threshold in {int(np.sum(above > 1.0)):,} of "
            f"{count(int(np.isfinite(above).sum()), 'judged block')} since.",
            "The kind is a hint.",
        ]
        if "|" in named.fault:
            sentences.append("They turn alike and cannot be told apart.")
        return (Finding(_QUESTION, f"{words[:1].upper()}{words[1:]}.", " ".join(sentences), brief=words),)
    if not judged:
        why = GEAR_STATUSES.get(str(statuses[last][0]), "")
        return (Finding(_QUESTION, "Not judged yet.", f"{why[:1].upper()}{why[1:]}.", known=False),)
    why = f"No wheel stands out of what was learned of it, in {count(judged, 'judged block')}."
    return (Finding(_QUESTION, "No gear named.", why),)


def wheel_names(run: Run, number: int) -> tuple[str, ...]:
    """Return the names of so many wheels by the attributes of a run, their places where these do not say them."""
    names = tuple(str(run.attributes.get("gears", "")).split(", "))
    return names if len(names) == number and all(names) else tuple(f"no. {place + 1}" for place in range(number))


def gears_table(run: Run) -> Table | None:
    """Return by channel and wheel the judged blocks, the highest score and the latest indicators; None without."""
    rows = [row for channel in run.channels.values() for row in _rows(run, channel)]
    if not rows:
        return None
    columns = (
        Column("channel", "channel"),
        Column("wheel", "wheel"),
        Column("judged", "judged blocks", "1"),
        Column("withheld", "not judged"),
        Column("score", "highest score over its threshold", "1"),
        *(Column(name, f"{name.replace('_', ' ').upper() if len(name) < 4 else name.replace('_', ' ')}, last", "1")
          for name in _INDICATORS),
    )  # fmt: skip
    return Table("gears", "Wheels", columns, rows)


def _rows(run: Run, channel: Channel) -> Iterator[tuple[Cell, ...]]:
    statuses = channel.words["gear_status"]
    if not (statuses != "").any():
        return
    for place, name in enumerate(wheel_names(run, statuses.shape[1])):
        own = statuses[:, place].astype(str)
        refused = [
            f"{GEAR_STATUSES.get(status, status)}: {int(np.sum(own == status)):,}"
            for status in dict.fromkeys(own.tolist())
            if status not in ("", "ok")
        ]
        scores = channel.column("gear_score", place)
        highest = float(np.nanmax(scores)) if np.isfinite(scores).any() else None
        latest = [_latest(channel.column(variable, place)) for variable in _INDICATORS]
        yield (channel.name, name, int(np.sum(own == "ok")), "; ".join(refused), highest, *latest)


def _latest(values: NDArray[np.float64]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if finite.size else None


def _since(channel: Channel, place: int, last: int) -> int:
    """Return the row from which a wheel is named without a break up to a row."""
    named = np.isin(channel.words["gear_fault"][: last + 1, place].astype(str), tuple(GEAR_KINDS))
    without = np.flatnonzero(~named)
    return int(without[-1]) + 1 if without.size else 0
