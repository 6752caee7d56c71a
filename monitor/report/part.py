"""Which part a channel's records name, and what is left open about it."""

from __future__ import annotations

import numpy as np

from monitor.report.life_marks import open_stage
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
