"""What the records of a channel say: the named part, the moments of its life, and the scale of its V_eq."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.records.archive import of_channel
from monitor.report.runs import Channel, Run
from monitor.words.numbers import times_first, volume
from monitor.words.statuses import UNDECIDED, speed_doubt


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
