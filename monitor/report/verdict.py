"""The verdict on a channel: what an engineer needs to decide whether to stop the machine."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from monitor.report.runs import Channel, Run
from monitor.words.numbers import Clock, acceleration, count
from monitor.words.statuses import BAND_SOURCES, fault_words

Severity = Literal["good", "watch", "bad", "open"]


@dataclass(frozen=True)
class Moment:
    """A moment of a channel's life: seconds on the run's time axis (NaN: unknown) and block number (None: unknown)."""

    time: float
    block: int | None


@dataclass(frozen=True)
class ChannelVerdict:
    """The verdict on a channel after its last block.

    Attributes:
        channel: name.
        severity: "good", "watch" (damage), "bad" (end of life) or "open" (no verdict).
        headline: one sentence.
        facts: labels and texts, beside those of :mod:`monitor.report.findings`.
        fault: the damaged part, "" for none.
        stage: "" where no block could be judged.
    """

    channel: str
    severity: Severity
    headline: str
    facts: tuple[tuple[str, str], ...]
    t_fs: Moment | None
    t_fs_known: Moment | None
    t_eol: Moment | None
    fault: str
    stage: str = ""


@dataclass(frozen=True, eq=False)
class ChannelContext:
    """Input of every figure and finding of a channel; ``numbers`` gives each figure of the page its number."""

    run: Run
    channel: Channel
    verdict: ChannelVerdict
    clock: Clock
    numbers: itertools.count[int]


def judge(run: Run, channel: Channel, clock: Clock | None = None) -> ChannelVerdict:
    """Return the verdict on a channel after its last block; ``clock`` formats times, by default in UTC."""
    clock = clock or Clock(run.dated)
    stages = channel.word("stage")
    judged = np.flatnonzero(stages != "")
    stage = str(stages[judged[-1]]) if judged.size else ""
    marks = {name: _mark(channel, name) for name in ("t_fs", "t_fs_known", "t_eol")}
    _, fault = named_fault(channel)
    severity, headline = _headline(stage, fault, marks, channel)
    facts = [
        ("Vibration", _vibration(channel)),
        ("Demodulation band", _band(channel)),
        ("Last block", _last_block(channel, clock)),
    ]
    return ChannelVerdict(channel.name, severity, headline, tuple(facts), fault=fault, stage=stage, **marks)


def named_fault(channel: Channel) -> tuple[int | None, str]:
    """Return row and name of the valid verdict on the damaged part; None without a judged block, "" for no part.

    Before the final stage that is the verdict on the last judged block. Afterwards it is the one with the highest
    score, because spreading damage raises the noise floor under its own lines.
    """
    faults = channel.word("fault")
    judged = np.flatnonzero(channel.word("quality_status") != "")
    if not judged.size:
        judged = np.flatnonzero(channel.word("stage") != "")
    if not judged.size:
        return None, ""
    late = np.flatnonzero(np.isin(channel.word("stage"), ("final", "end_of_life")) & (faults != ""))
    if late.size:
        scores = np.nan_to_num(channel.column("fault_score")[late], nan=-np.inf)
        row = int(late[np.argmax(scores)])
        return row, str(faults[row])
    row = int(judged[-1])
    return row, str(faults[row])


def _mark(channel: Channel, name: str) -> Moment | None:
    times, blocks = channel.column(name), channel.column(f"{name}_block")
    rows = np.flatnonzero(np.isfinite(times) | np.isfinite(blocks))
    if not rows.size:
        return None
    time, block = times[rows[-1]], blocks[rows[-1]]
    return Moment(float(time), int(block) if math.isfinite(block) else None)


def _headline(stage: str, fault: str, marks: dict[str, Moment | None], channel: Channel) -> tuple[Severity, str]:
    part = f": damage of the {fault_words(fault)}" if fault else ", but no part named"
    if stage == "end_of_life":
        return "bad", "End of life reached" + (part if marks["t_fs"] or fault else "")
    if stage == "final":
        return "watch", f"In the final stage of its life{part}"
    if fault:
        return "watch", f"Damage of the {fault_words(fault)} is detected"
    if stage == "healthy":
        return "good", "No sign of damage"
    if stage == "learning":
        return "open", "Still learning what healthy sounds like; no part is named"
    rejected = int(np.sum(channel.status != "ok"))
    return "open", f"No verdict: {count(rejected, 'block')} could not be used" if rejected else "No verdict"


def _vibration(channel: Channel) -> str:
    row = channel.last_row("rms")
    if row is None:
        return "No value."
    rms, peak = channel.column("rms")[row], channel.column("peak")[row]
    text = f"RMS {acceleration(rms)}" if channel.has_level else "Level unknown (the sensor's unit is not configured)"
    if channel.has_level and math.isfinite(peak):
        text += f", peak {acceleration(peak)}"
    learned = channel.baseline("rms")
    if math.isfinite(learned) and channel.word("stage")[row] != "learning":
        text += f"; RMS is {rms / learned:.1f} times its median while learning"
    return f"{text}."


def interval_name(run: Run) -> str:
    """Return the name of a run's intervals: "80 % interval", or "interval" if the level is not recorded."""
    levels = [level for level in run.attributes.get("interval_level", "").split("; ") if level not in ("", "none")]
    return " or ".join(f"{100.0 * float(level):g} %" for level in levels) + " interval" if levels else "interval"


def unscaled(run: Run) -> str:
    """Return the caveat on V_eq and TT of a model that was not calibrated, "" for a calibrated one."""
    return "" if run.attributes.get("calibrated") == "yes" else " On the scale of a model that is not calibrated."


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
