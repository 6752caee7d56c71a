"""The verdict on a channel after its last block: grade, headline, and the moments of its life."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from monitor.report.options import Options
from monitor.report.readings import LifeMoment, closed_stages, is_calibrated, mark_of, named_fault, named_gear
from monitor.report.runs import Channel, Run
from monitor.words.features import FEATURES
from monitor.words.numbers import Clock, count
from monitor.words.statuses import (
    BAND_SOURCES,
    LEVEL_OF,
    fault_words,
)

if TYPE_CHECKING:
    from monitor.report.figures.spectrum import SpectrumView

_NO_SIGN = "No sign of damage"
Grade = Literal["bad", "watch", "open", "good"]
GRADE_NAMES: dict[Grade, str] = {
    "bad": "end of life",
    "watch": "damage",
    "open": "no verdict",
    "good": "no sign of damage",
}
"""For tables, the worst first."""
GRADES = tuple(GRADE_NAMES)
_WITHOUT = ("No onset so far", "No baseline yet")


@dataclass(frozen=True)
class ChannelVerdict:
    """The verdict on a channel after its last block.

    Attributes:
        headline: one sentence.
        facts: labels and texts beside the findings.
        fault: the damaged part, "" for none.
        stage: "" where no block could be judged.
        closed: first and last moment of each final stage that closed again.
        level_of: the bearing with whose damage its level rises, where it shows no part of its own.
    """

    channel: str
    grade: Grade
    headline: str
    facts: tuple[tuple[str, str], ...]
    t_fs: LifeMoment | None
    t_fs_known: LifeMoment | None
    t_eol: LifeMoment | None
    fault: str
    stage: str = ""
    closed: tuple[tuple[LifeMoment, LifeMoment], ...] = ()
    level_of: str | None = None


@dataclass(frozen=True, eq=False)
class ChannelContext:
    """Input of every figure and finding of a channel.

    Attributes:
        numbers: gives each figure of the page its number.
        view: an envelope spectrum of the channel that is not in the store, None without.
    """

    run: Run
    channel: Channel
    verdict: ChannelVerdict
    clock: Clock
    numbers: itertools.count[int]
    options: Options = field(default_factory=Options)
    view: SpectrumView | None = None


def judge(run: Run, channel: Channel, clock: Clock | None = None, level_of: str | None = None) -> ChannelVerdict:
    """Return the verdict on a channel after its last block.

    Args:
        clock: formats times, by default in UTC.
        level_of: the bearing with whose damage the level of this one rises, as all channels together say.
    """
    clock = clock or Clock(run.dated)
    stages = channel.word("stage")
    judged = np.flatnonzero(stages != "")
    stage = str(stages[judged[-1]]) if judged.size else ""
    marks = {name: mark_of(channel, name) for name in ("t_fs", "t_fs_known", "t_eol")}
    _, fault = named_fault(channel)
    grade, headline = _headline(stage, fault, marks, channel)
    level_of = level_of if stage == "final" and not fault else None
    if level_of is not None:
        grade, headline = "open", f"No part of its own named; {LEVEL_OF} {level_of}"
    if (gear := named_gear(run, channel)) is not None:
        grade = "watch" if grade in ("good", "open") else grade
        headline = f"{headline}{' of the bearing' if headline == _NO_SIGN else ''}; damage of {gear.words}"
    if channel.last_row("v_eq") is not None and not is_calibrated(run, channel):
        headline += "; V_eq is relative, as the rig is not calibrated"
    facts = [
        ("Vibration", _vibration(channel)),
        ("Demodulation band", _band(channel)),
        ("Last block", _last_block(channel, clock)),
    ]
    closed = closed_stages(channel)
    return ChannelVerdict(
        channel.name, grade, headline, tuple(facts), fault=fault, stage=stage, closed=closed, level_of=level_of, **marks
    )


def _headline(stage: str, fault: str, marks: dict[str, LifeMoment | None], channel: Channel) -> tuple[Grade, str]:
    part = f": damage of the {fault_words(fault)}" if fault else ", but no part named"
    if stage == "end_of_life":
        return "bad", "End of life reached" + (part if marks["t_fs"] or fault else "")
    if stage == "final":
        return "watch", f"In the final stage of its life{part}"
    if fault:
        return "open", f"{_WITHOUT[stage == 'learning']}; a pattern of the {fault_words(fault)} (hint)"
    if stage == "healthy":
        return "good", _NO_SIGN
    if stage == "learning":
        return "open", "Still learning what healthy sounds like; no part is named"
    unused = unused_blocks(channel)
    return "open", f"No verdict: {unused}" if unused else "No verdict"


def unused_blocks(channel: Channel) -> str:
    """Return in words how many blocks of a channel were rejected or flagged, "" for none."""
    rejected = int(np.sum(channel.status != "ok"))
    return f"{count(rejected, 'block')} could not be used" if rejected else ""


def _vibration(channel: Channel) -> str:
    row = channel.last_row("rms")
    if row is None:
        return "No value."
    rms, peak = channel.column("rms")[row], channel.column("peak")[row]
    text = (
        f"RMS {FEATURES['rms'].write(rms)}"
        if channel.has_level
        else "Level unknown (the sensor's unit is not configured)"
    )
    if channel.has_level and math.isfinite(peak):
        text += f", peak {FEATURES['peak'].write(peak)}"
    learned = channel.baseline("rms")
    if math.isfinite(learned) and channel.word("stage")[row] != "learning":
        text += f"; RMS is {rms / learned:.1f} times its median while learning"
    return f"{text}."


def interval_name(run: Run) -> str:
    """Return the name of a run's intervals: "80 % interval", or "interval" if the level is not recorded."""
    levels = [level for level in run.attributes.get("interval_level", "").split("; ") if level not in ("", "none")]
    return " or ".join(f"{100.0 * float(level):g} %" for level in levels) + " interval" if levels else "interval"


def _band(channel: Channel) -> str:
    row = channel.last_row("band_lo")
    if row is None:
        return "None."
    lows, highs = channel.numbers["band_lo"][row], channel.numbers["band_hi"][row]
    bands = ", ".join(
        f"{low:,.0f} to {high:,.0f} Hz" for low, high in zip(lows, highs, strict=False) if math.isfinite(low + high)
    )
    source = str(channel.word("band_source")[row])
    return f"{bands}{f' ({BAND_SOURCES[source]})' if source else ''}."


def _last_block(channel: Channel, clock: Clock) -> str:
    if not channel.sequence.size:
        return "None."
    status = str(channel.status[-1])
    text = f"Number {channel.sequence[-1]:,}, {clock.moment(float(channel.time[-1]))}"
    return f"{text}{'' if status == 'ok' else f'; status {status}'}."
