"""What the records of a channel say: part and wheel that are named, moments of its life, and the scale of its V_eq."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.records.archive import of_channel
from monitor.report.runs import Channel, Run
from monitor.report.tables import Cell, Column, Table
from monitor.words.numbers import count, times_first, volume
from monitor.words.statuses import GEAR_KINDS, GEAR_STATUSES, NAMED, UNDECIDED, gear_words, speed_doubt


def named_fault(channel: Channel) -> tuple[int | None, str]:
    """Return row and name of the valid verdict on the damaged part; None without a judged block, "" for no part.

    Outside the final stage that is the verdict on the last judged block. In it, it is the one with the highest
    score, because spreading damage raises the noise floor under its own lines; a part that the speed decides comes
    first. An undecided one is named by its candidates.
    """
    faults = channel.word("fault")
    judged = np.flatnonzero(channel.word("quality_status") != "")
    if not judged.size:
        judged = np.flatnonzero(channel.word("stage") != "")
    if not judged.size:
        return None, ""
    row = int(judged[-1])
    late = np.flatnonzero(open_stage(channel) & (faults != ""))
    if late.size:
        decided = late[faults[late] != UNDECIDED]
        late = decided if decided.size else late
        scores = np.nan_to_num(channel.column("fault_score")[late], nan=-np.inf)
        row = int(late[np.argmax(scores)])
    undecided = faults[row] == UNDECIDED
    return row, str(channel.word("fault_candidates")[row] if undecided else faults[row])


def doubt_of(channel: Channel, row: int, fault: str) -> str:
    """Return what resolution and shaft speed leave open about the part that a block names, "" where nothing."""
    decided = channel.word("fault")[row] != UNDECIDED
    resolution = "The resolution does not tell them apart." if decided and "|" in fault else ""
    unverified = channel.word("speed_unverified")[row] == "yes"
    speed = speed_doubt(fault, () if decided else fault.split("|"), unverified) or ""
    return f"{resolution} {speed[:1].upper()}{speed[1:]}{'.' if speed else ''}".strip()


LATE = ("final", "end_of_life")
"""Stages of a final stage that is open."""


@dataclass(frozen=True)
class LifeMoment:
    """A moment of a channel's life: seconds on the run's time axis (NaN: unknown) and block number (None: unknown)."""

    time: float
    block: int | None


def open_stage(channel: Channel) -> NDArray[np.bool_]:
    """Return which blocks are of the final stage that is open after the last one, shape (block,)."""
    stages = channel.word("stage")
    before = np.flatnonzero((stages != "") & ~np.isin(stages, LATE))
    rows = np.isin(stages, LATE)
    rows[: before[-1] if before.size else 0] = False
    return rows


def closed_stages(channel: Channel) -> tuple[tuple[LifeMoment, LifeMoment], ...]:
    """Return where each final stage that closed again began, and the last block that was of it."""
    begun = channel.column("t_fs_block")
    of_one = np.isfinite(begun) & ~open_stage(channel)
    found: list[tuple[LifeMoment, LifeMoment]] = []
    for block in np.unique(begun[of_one]).tolist():
        rows = np.flatnonzero(of_one & (begun == block))
        last = LifeMoment(float(channel.time[rows[-1]]), int(channel.sequence[rows[-1]]))
        found.append((LifeMoment(float(channel.column("t_fs")[rows[-1]]), int(block)), last))
    return tuple(found)


def mark_of(channel: Channel, name: str) -> LifeMoment | None:
    """Return a mark as it stands after the last judged block, None where there is none or its episode has closed."""
    judged = np.flatnonzero(channel.word("stage") != "")
    if not judged.size:
        return None
    time, block = channel.column(name)[judged[-1]], channel.column(f"{name}_block")[judged[-1]]
    if not (math.isfinite(time) or math.isfinite(block)):
        return None
    return LifeMoment(float(time), int(block) if math.isfinite(block) else None)


_MM2 = 1e6


@dataclass(frozen=True, eq=False)
class VolumeScale:
    """The scale on which V_eq of a channel is shown.

    Attributes:
        factor: from m2 to the scale.
        unit: behind its values.
        absolute: False where V_eq is shown as a multiple of its first value.
    """

    factor: float
    unit: str
    absolute: bool

    @classmethod
    def of(cls, run: Run, channel: Channel) -> VolumeScale:
        """Return mm2 for a calibrated rig, else multiples of the first tracked value, if there is any."""
        v_eq, relative = channel.column("v_eq"), channel.column("v_eq_relative")
        known = np.flatnonzero(v_eq > 0.0)
        if is_calibrated(run, channel) or not known.size:
            return cls(_MM2, "mm³/mm", absolute=True)
        last, first = int(known[-1]), float(v_eq[known[0]])
        # Records of an earlier version have no relative values.
        if relative[last] > 0.0:
            first = float(v_eq[last] / relative[last])
        return cls(1.0 / first, "times the first tracked value", absolute=False)

    def write(self, value: float) -> str:
        """Return a V_eq (m2) with its unit."""
        return volume(value) if self.absolute else times_first(value * self.factor)

    def write_briefly(self, value: float) -> str:
        """Return a V_eq (m2) for a table."""
        return volume(value) if self.absolute else f"× {value * self.factor:.3g}"

    def scaled(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return values (m2) on the scale."""
        return self.factor * values


def is_calibrated(run: Run, channel: Channel) -> bool:
    """Return whether V_eq of a channel is that of its machine; "declared" counts."""
    return of_channel(run.attributes.get("calibrated"), channel.name) in ("yes", "declared")


def unscaled(run: Run, channel: Channel) -> str:
    """Return the caveat on V_eq and TT of a model that was not calibrated, "" for a calibrated one."""
    return "" if is_calibrated(run, channel) else " On the scale of a model that is not calibrated."


@dataclass(frozen=True)
class Finding:
    """A question and its answer from the records, one sentence at most.

    Attributes:
        support: evidence and its uncertainty, or the reason of a refusal.
        known: False for a refusal.
        brief: for a table, "" for none.
    """

    question: str
    answer: str
    support: str
    known: bool = True
    brief: str = ""


_GEAR_QUESTION = "Which gear?"
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
        return (Finding(_GEAR_QUESTION, f"{words[:1].upper()}{words[1:]}.", " ".join(sentences), brief=words),)
    if not judged:
        why = GEAR_STATUSES.get(str(statuses[last][0]), "")
        return (Finding(_GEAR_QUESTION, "Not judged yet.", f"{why[:1].upper()}{why[1:]}.", known=False),)
    why = f"No wheel stands out of what was learned of it, in {count(judged, 'judged block')}."
    return (Finding(_GEAR_QUESTION, "No gear named.", why),)


def wheel_names(run: Run, number: int) -> tuple[str, ...]:
    """Return the names of so many wheels by the attributes of a run, their places where these do not say them."""
    names = tuple(str(run.attributes.get("gears", "")).split(", "))
    return names if len(names) == number and all(names) else tuple(f"no. {place + 1}" for place in range(number))


def gears_table(run: Run) -> Table | None:
    """Return by channel and wheel the judged blocks, the highest score and the latest indicators; None without."""
    rows = [row for channel in run.channels.values() for row in _gear_rows(run, channel)]
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


def _gear_rows(run: Run, channel: Channel) -> Iterator[tuple[Cell, ...]]:
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
