"""The verdict on a channel in plain words: what an engineer needs to decide whether to stop the machine."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from monitor.report.reading import Channel, Run
from monitor.report.wording import (
    BAND_SOURCES,
    EDV_REFUSALS,
    TT_REFUSALS,
    acceleration,
    count,
    duration,
    fault_words,
    moment,
    volume,
)

Severity = Literal["good", "watch", "bad", "open"]


@dataclass(frozen=True)
class Moment:
    """A moment of a channel's life.

    Attributes:
        time: seconds on the run's axis, NaN where unknown.
        block: number of the block, or None where unknown.
    """

    time: float
    block: int | None


@dataclass(frozen=True)
class Verdict:
    """What to say of one channel.

    Attributes:
        channel: its name.
        severity: "good", "watch" (something is wrong), "bad" (end of life) or "open" (nothing can be said yet).
        headline: one sentence.
        facts: pairs of what and how it stands.
        t_fs, t_fs_known, t_eol: moments, or None.
        fault: the part named, "" where none is.
    """

    channel: str
    severity: Severity
    headline: str
    facts: tuple[tuple[str, str], ...]
    t_fs: Moment | None
    t_fs_known: Moment | None
    t_eol: Moment | None
    fault: str


def judge(run: Run, channel: Channel) -> Verdict:
    """Return the verdict on a channel after its last block."""
    stages = channel.word("stage")
    judged = np.flatnonzero(stages != "")
    stage = str(stages[judged[-1]]) if judged.size else ""
    marks = {name: _mark(channel, name) for name in ("t_fs", "t_fs_known", "t_eol")}
    row, fault = named_fault(channel)
    severity, headline = _headline(stage, fault, marks, channel)
    facts = [
        ("Stage", _stage(stage, marks, run)),
        ("Damaged part", _part(channel, row, fault)),
        ("Vibration", _vibration(channel)),
        ("Damaged volume V_eq", _volume(channel, run)),
        ("Time to threshold", _forecast(channel, run)),
        ("Demodulation band", _band(channel)),
        ("Last block", _last_block(channel, run)),
    ]
    return Verdict(channel.name, severity, headline, tuple(facts), fault=fault, **marks)


def named_fault(channel: Channel) -> tuple[int | None, str]:
    """Return the row and the name of the damaged part that stands: the latest, in the final stage the strongest.

    Before the final stage a name is the verdict on the present block alone. Once the final stage is known, the name
    with the strongest evidence since then is kept: as damage spreads, the lines may drown in their own noise.
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


def last_value(channel: Channel, name: str) -> int | None:
    """Return the row of the last finite value of a variable, or None."""
    rows = np.flatnonzero(np.isfinite(channel.column(name)))
    return int(rows[-1]) if rows.size else None


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
        return "watch", f"Damage of the {fault_words(fault)} is heard"
    if stage == "healthy":
        return "good", "No sign of damage"
    if stage == "learning":
        return "open", "Still learning what healthy sounds like; no part is named"
    rejected = int(np.sum(channel.status != "ok"))
    return "open", f"No verdict: {count(rejected, 'block')} could not be used" if rejected else "No verdict"


def _at(mark: Moment, run: Run) -> str:
    block = "" if mark.block is None else f"block {mark.block:,}, "
    return f"{block}{moment(mark.time, dated=run.dated)}"


def _stage(stage: str, marks: dict[str, Moment | None], run: Run) -> str:
    sentences = []
    if marks["t_fs"] is not None:
        sentences.append(f"The final stage began at {_at(marks['t_fs'], run)}.")
    if marks["t_fs_known"] is not None:
        sentences.append(f"This was known at {_at(marks['t_fs_known'], run)}.")
    if marks["t_eol"] is not None:
        sentences.append(f"The end of life was reached at {_at(marks['t_eol'], run)}.")
    if sentences:
        return " ".join(sentences)
    return {
        "learning": "Learning: the baseline is not complete, so that no change can be judged yet.",
        "healthy": "Healthy: RMS and H_or stay within what was learned.",
        "": "No block could be judged.",
    }.get(stage, stage)


def _part(channel: Channel, row: int | None, fault: str) -> str:
    if row is None:
        return "No block could be judged."
    if not fault:
        return "No part named: no family of fault lines stands clear of the noise and of all others."
    snr, depth = channel.column("fault_snr")[row], channel.column("fault_depth")[row]
    evidence = []
    if math.isfinite(snr):
        evidence.append(f"lines {snr:.1f} times the noise floor")
    if math.isfinite(depth):
        evidence.append(f"modulation depth {depth:.2f}")
    joined = f" ({', '.join(evidence)}; block {channel.sequence[row]:,})" if evidence else ""
    apart = " The resolution does not tell them apart." if "|" in fault else ""
    return f"{fault_words(fault).capitalize()}{joined}.{apart}"


def _vibration(channel: Channel) -> str:
    row = last_value(channel, "rms")
    if row is None:
        return "No value."
    rms, peak = channel.column("rms")[row], channel.column("peak")[row]
    text = f"RMS {acceleration(rms)}" if channel.has_level else "Level unknown (the sensor's unit is not configured)"
    if channel.has_level and math.isfinite(peak):
        text += f", peak {acceleration(peak)}"
    learned = channel.column("rms")[(channel.word("stage") == "learning") & np.isfinite(channel.column("rms"))]
    if learned.size > 1 and channel.word("stage")[row] != "learning":
        text += f"; RMS is {rms / np.median(learned):.1f} times its median while learning"
    return f"{text}."


def _volume(channel: Channel, run: Run) -> str:
    statuses = channel.word("edv_status")
    rows = np.flatnonzero(statuses != "")
    if not rows.size:
        return "Not tracked on this channel."
    row, known = int(rows[-1]), last_value(channel, "v_eq")
    status = str(statuses[row])
    if known is None:
        return f"No value: {EDV_REFUSALS.get(status, status)}."
    value = volume(channel.column("v_eq")[known])
    lower, upper = channel.column("v_eq_lower")[known], channel.column("v_eq_upper")[known]
    if math.isfinite(lower) and math.isfinite(upper):
        value += f" ({interval_name(run)}: {volume(lower)} to {volume(upper)})"
    if status == "ambiguous":
        value += "; several sizes of damage explain the vibration, so that the middle says little"
    if status == "widened":
        value += "; the search had to go back, so that it may be lower than before"
    if known != row:
        value = (
            f"Last {value} at block {channel.sequence[known]:,}; since then none: {EDV_REFUSALS.get(status, status)}"
        )
    scale = "" if run.attributes.get("calibrated") == "yes" else " On the scale of a model that is not calibrated."
    return f"{value}.{scale}"


def _forecast(channel: Channel, run: Run) -> str:
    statuses = channel.words["tt_status"]
    rows = np.flatnonzero(np.any(statuses != "", axis=1))
    if not rows.size:
        return "Not forecast on this channel."
    row = int(rows[-1])
    sentences = []
    for place, status in enumerate(statuses[row]):
        thresholds = channel.numbers["v_th"][row]
        threshold = thresholds[place] if place < thresholds.size else math.nan
        of = f" of {volume(threshold)}" if math.isfinite(threshold) else ""
        if status:
            sentences.append(_one_forecast(channel, run, row, place, str(status), of))
    return " ".join(sentences)


def _one_forecast(channel: Channel, run: Run, row: int, place: int, status: str, of: str) -> str:
    def number(name: str) -> float:
        values = channel.numbers[name][row]
        return float(values[place]) if place < values.size else math.nan

    tt, lower, upper, probability = (number(name) for name in ("tt", "tt_lower", "tt_upper", "p_threshold"))
    ends = math.isfinite(lower) and math.isfinite(upper)
    if status == "already_crossed":
        first = np.flatnonzero(channel.words["tt_status"][:, place] == status)[0]
        if not ends:
            return f"The threshold{of} was reached by block {channel.sequence[first]:,}."
        late = f" ({interval_name(run)}: up to {duration(upper)} from now)" if upper > 0.0 else ""
        return f"The threshold{of} has more likely than not been reached{late}."
    if status != "ok" or not math.isfinite(tt):
        return f"No forecast for the threshold{of}: {TT_REFUSALS.get(status, status)}."
    text = f"{duration(tt)} to the threshold{of}"
    if ends:
        text += f" ({interval_name(run)}: {duration(lower)} to {duration(upper)})"
    if math.isfinite(probability):
        text += f", reached within the maintenance window with a probability of {probability:.0%}"
    return f"{text}."


def interval_name(run: Run) -> str:
    """Return what the intervals of a run are called: "80 % interval", without a level where records do not say it."""
    levels = [level for level in run.attributes.get("interval_level", "").split("; ") if level not in ("", "none")]
    return " or ".join(f"{100.0 * float(level):g} %" for level in levels) + " interval" if levels else "interval"


def _band(channel: Channel) -> str:
    row = last_value(channel, "band_lo")
    if row is None:
        return "None."
    lows, highs = channel.numbers["band_lo"][row], channel.numbers["band_hi"][row]
    bands = ", ".join(
        f"{low:,.0f} to {high:,.0f} Hz" for low, high in zip(lows, highs, strict=False) if math.isfinite(low + high)
    )
    source = str(channel.word("band_source")[row])
    return f"{bands}{f' ({BAND_SOURCES[source]})' if source else ''}."


def _last_block(channel: Channel, run: Run) -> str:
    if not channel.sequence.size:
        return "None."
    status = str(channel.status[-1])
    text = f"Number {channel.sequence[-1]:,}, {moment(float(channel.time[-1]), dated=run.dated)}"
    return f"{text}{'' if status == 'ok' else f'; status {status}'}."
