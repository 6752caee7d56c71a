"""Moments of a channel's life: final stages that are open, and those that closed again."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from monitor.report.runs import Channel
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
class Moment:
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


def closed_stages(channel: Channel) -> tuple[tuple[Moment, Moment], ...]:
    """Return where each final stage that closed again began, and the last block that was of it."""
    begun = channel.column("t_fs_block")
    of_one = np.isfinite(begun) & ~open_stage(channel)
    found: list[tuple[Moment, Moment]] = []
    for block in np.unique(begun[of_one]).tolist():
        rows = np.flatnonzero(of_one & (begun == block))
        last = Moment(float(channel.time[rows[-1]]), int(channel.sequence[rows[-1]]))
        found.append((Moment(float(channel.column("t_fs")[rows[-1]]), int(block)), last))
    return tuple(found)


def mark_of(channel: Channel, name: str) -> Moment | None:
    """Return a mark as it stands after the last judged block, None where there is none or its episode has closed."""
    judged = np.flatnonzero(channel.word("stage") != "")
    if not judged.size:
        return None
    time, block = channel.column(name)[judged[-1]], channel.column(f"{name}_block")[judged[-1]]
    if not (math.isfinite(time) or math.isfinite(block)):
        return None
    return Moment(float(time), int(block) if math.isfinite(block) else None)
