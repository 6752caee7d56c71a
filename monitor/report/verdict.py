"""The verdict on a channel, and the answers to the questions about it, each with its evidence."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from monitor.health.schema import HINT, VERDICT
from monitor.records.archive import of_channel
from monitor.report.alarm_time import alarm_time
from monitor.report.calibration import VolumeScale, is_calibrated, unscaled
from monitor.report.finding import Finding as Finding
from monitor.report.gears import gear_findings, named_gear
from monitor.report.life_marks import LATE, Moment, closed_stages, mark_of, open_stage
from monitor.report.part import doubt_of, named_fault
from monitor.report.runs import Channel, Run
from monitor.report.velocity import velocity_findings
from monitor.words.numbers import Clock, acceleration, count, duration, figure, interval, volume
from monitor.words.statuses import (
    BAND_SOURCES,
    EDV_REFUSALS,
    LEVEL_OF,
    TT_REFUSALS,
    damage_mode,
    fault_words,
    named_words,
)

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
LATEST = 20
"""Blocks over which scores above the threshold are counted."""


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
    t_fs: Moment | None
    t_fs_known: Moment | None
    t_eol: Moment | None
    fault: str
    stage: str = ""
    closed: tuple[tuple[Moment, Moment], ...] = ()
    level_of: str | None = None


@dataclass(frozen=True, eq=False)
class ChannelContext:
    """Input of every figure and finding of a channel; ``numbers`` gives each figure of the page its number."""

    run: Run
    channel: Channel
    verdict: ChannelVerdict
    clock: Clock
    numbers: itertools.count[int]


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


def _headline(stage: str, fault: str, marks: dict[str, Moment | None], channel: Channel) -> tuple[Grade, str]:
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
    unused = _unused(channel)
    return "open", f"No verdict: {unused}" if unused else "No verdict"


def _unused(channel: Channel) -> str:
    rejected = int(np.sum(channel.status != "ok"))
    return f"{count(rejected, 'block')} could not be used" if rejected else ""


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


def findings(context: ChannelContext) -> tuple[Finding, ...]:
    """Answer the questions about a channel after its last block."""
    run, channel, verdict = context.run, context.channel, context.verdict
    first = _failing(channel, verdict), _since(verdict, context.clock), _where(channel, verdict)
    return (
        *first,
        _how_large(run, channel),
        *_how_long(run, channel),
        *_to_alarm(run, channel),
        *gear_findings(run, channel),
        *velocity_findings(run, channel),
    )


def _failing(channel: Channel, verdict: ChannelVerdict) -> Finding:
    question = "Is it failing?"
    answer = {
        "end_of_life": "Yes: the end of its life is reached.",
        "final": "Yes: it is in the final stage of its life.",
        "healthy": "No sign of it.",
        "learning": "Not known yet.",
        "": "Cannot be answered.",
    }.get(verdict.stage, verdict.stage)
    if verdict.stage == "":
        unused = _unused(channel)
        return Finding(question, answer, f"No block could be judged{f'; {unused}' if unused else ''}.", known=False)
    if verdict.stage == "learning":
        if verdict.fault:
            answer = f"Not known yet; a pattern of the {fault_words(verdict.fault)} (hint)."
        why = "The baseline is not complete, so that no change can be judged yet."
        return Finding(question, answer, why, known=False)
    if verdict.level_of is not None:
        answer = f"Not known: {LEVEL_OF} {verdict.level_of}."
    if verdict.stage == "healthy" and verdict.fault:
        answer = f"No onset so far; a pattern of the {fault_words(verdict.fault)} (hint)."
    return Finding(question, answer, " ".join(text for text in (_scores(channel), _growth(channel)) if text))


def _scores(channel: Channel) -> str:
    score, threshold = channel.column("detect_score"), channel.column("detect_threshold")
    rows = np.flatnonzero(np.isfinite(score) & np.isfinite(threshold))[-LATEST:]
    if not rows.size:
        return ""
    above = int(np.sum(score[rows] > threshold[rows]))
    return (
        f"The score of RMS and fault lines is above its threshold in {above} of the last {count(rows.size, 'block')} "
        f"(last {figure(float(score[rows[-1]]), 2)}, threshold {figure(float(threshold[rows[-1]]), 2)})."
    )


def _growth(channel: Channel) -> str:
    row, learned = channel.last_row("rms"), channel.baseline("rms")
    if row is None or channel.word("stage")[row] == "learning" or not learned > 0.0:
        return ""
    return f"RMS is {figure(float(channel.column('rms')[row] / learned), 2)} times what was learned."


def _since(verdict: ChannelVerdict, clock: Clock) -> Finding:
    question = "Since when?"
    if verdict.t_fs is None:
        why = "No final stage so far."
        if verdict.closed:
            why = f"No final stage is open; {count(len(verdict.closed), 'earlier one')} closed again."
        return Finding(question, "–", why, known=False)
    sentences = [f"The final stage began at {_at(verdict.t_fs, clock)}."]
    if verdict.t_fs_known is not None:
        sentences.append(f"This was known at {_at(verdict.t_fs_known, clock)}.")
    if verdict.t_eol is not None:
        sentences.append(f"The end of life was reached at {_at(verdict.t_eol, clock)}.")
    short, brief = clock.moment(verdict.t_fs.time), clock.short(verdict.t_fs.time)
    if not math.isfinite(verdict.t_fs.time):
        short = brief = short if verdict.t_fs.block is None else f"block {verdict.t_fs.block:,}"
    return Finding(question, _sentence(short), " ".join(sentences), brief=brief)


def _at(mark: Moment, clock: Clock) -> str:
    block = "" if mark.block is None else f"block {mark.block:,}, "
    return f"{block}{clock.moment(mark.time)}"


def _where(channel: Channel, verdict: ChannelVerdict) -> Finding:
    question = "Where?"
    row, fault = named_fault(channel)
    if row is None:
        return Finding(question, "Cannot be answered.", "No block could be judged.", known=False)
    if not fault:
        why = "No family of fault lines stands clear of the noise and of all others."
        return Finding(question, "No part named.", why, known=False)
    snr, depth = channel.column("fault_snr")[row], channel.column("fault_depth")[row]
    evidence = [f"lines {snr:.1f} times the noise floor"] if math.isfinite(snr) else []
    evidence += [f"modulation depth {depth:.2f}"] if math.isfinite(depth) else []
    best = f"At best {', '.join(evidence)} (block {channel.sequence[row]:,})." if evidence else ""
    texts = (best, _agreement(channel, verdict, fault), doubt_of(channel, row, fault), damage_mode(fault))
    part = named_words(fault, VERDICT if verdict.stage in LATE else HINT)
    return Finding(question, _sentence(part), " ".join(text for text in texts if text), brief=part)


def _agreement(channel: Channel, verdict: ChannelVerdict, fault: str) -> str:
    """Return in how many blocks since the onset was known the same part, another or none was named."""
    late = open_stage(channel)
    if verdict.stage not in LATE or not late.any():
        return ""
    names = channel.word("fault")[late].astype(str)
    same, none = int(np.sum(names == fault)), int(np.sum(names == ""))
    other = names.size - same - none
    rest = [f"none in {none:,}"] if none else []
    rest += [f"another in {other:,}"] if other else []
    return f"Named in {same:,} of {count(names.size, 'block')} since then{''.join(f'; {text}' for text in rest)}."


def _how_large(run: Run, channel: Channel) -> Finding:
    question = "How large?"
    statuses = channel.word("edv_status")
    rows = np.flatnonzero(statuses != "")
    if not rows.size:
        return Finding(question, "Not tracked on this channel.", "", known=False)
    row, known = int(rows[-1]), channel.last_row("v_eq")
    status = str(statuses[row])
    if known is None:
        return Finding(question, "No value.", _sentence(EDV_REFUSALS.get(status, status)), known=False)
    scale = VolumeScale.of(run, channel)
    found, *ends = (float(channel.column(name)[known]) for name in ("v_eq", "v_eq_lower", "v_eq_upper"))
    value = scale.write(found)
    sentences = [_ends(run, interval(ends[0], ends[1], scale.write_briefly))]
    if status == "ambiguous":
        sentences.append("Several sizes of damage explain the vibration, so that the middle says little.")
    if status == "widened":
        sentences.append("The search had to go back, so that it may be lower than before.")
    if known != row:
        why = EDV_REFUSALS.get(status, status)
        sentences.insert(0, f"At block {channel.sequence[known]:,}; since then none: {why}.")
        value = f"Last {value}"
    if scale.absolute:
        sentences.append("Equivalent damaged volume V_eq, in the model of this rig." + unscaled(run, channel))
    else:
        sentences.append("Equivalent damaged volume V_eq, relative because the rig is not calibrated.")
    brief = scale.write_briefly(found)
    brief = brief if known == row else f"({brief})"
    return Finding(question, f"{value}.", " ".join(sentences), brief=brief)


def _ends(run: Run, ends: str) -> str:
    return f"{_capital(interval_name(run))}: {ends}." if ends else "A single number, without an interval."


def _how_long(run: Run, channel: Channel) -> list[Finding]:
    question = "How long left?"
    statuses = channel.words["tt_status"]
    rows = np.flatnonzero(np.any(statuses != "", axis=1))
    if not rows.size:
        return [Finding(question, "Not forecast on this channel.", "", known=False)]
    row = int(rows[-1])
    found = [
        _one_forecast(run, channel, row, place, str(status)) for place, status in enumerate(statuses[row]) if status
    ]
    refusals = {(answer.answer, answer.support.split(": ", 1)[-1]) for answer in found if not answer.known}
    if len(found) > 1 and len(refusals) == 1 and not any(answer.known for answer in found):
        return found[:1]
    return found


def _one_forecast(run: Run, channel: Channel, row: int, place: int, status: str) -> Finding:
    names = ("v_th", "tt", "tt_lower", "tt_upper", "p_threshold")
    threshold, tt, lower, upper, probability = (float(channel.column(name, place)[row]) for name in names)
    of = f" of {volume(threshold)}" if math.isfinite(threshold) else ""
    question = "How long left?"
    learned = of_channel(run.attributes.get("forecast_method"), channel.name) == "learned"
    if learned and status in ("ok", "outside_library") and math.isfinite(tt):
        return _by_recorded_runs(run, tt, interval(lower, upper, duration), outside=status != "ok")
    if status == "already_crossed":
        if math.isfinite(lower) and math.isfinite(upper):
            late = f"{_capital(interval_name(run))}: up to {duration(upper)} from now." if upper > 0.0 else ""
            answer = f"The threshold{of} has more likely than not been reached."
            return Finding(question, answer, late, brief="likely reached")
        first = np.flatnonzero(channel.words["tt_status"][:, place] == status)[0]
        support = f"By block {channel.sequence[first]:,}."
        return Finding(question, f"The threshold{of} was reached.", support, brief="reached")
    if status not in ("ok", "uncalibrated") or not math.isfinite(tt):
        share = float(channel.column("p_no_growth")[row])
        still = f", with a probability of {share:.0%}" if status == "no_growth" and math.isfinite(share) else ""
        why = f"For the threshold{of}: {TT_REFUSALS.get(status, status)}{still}."
        return Finding(question, "No forecast.", why, known=False, brief="no forecast")
    sentences = [_ends(run, interval(lower, upper, duration))]
    if math.isfinite(probability):
        sentences.append(f"Reached within the maintenance window with a probability of {probability:.0%}.")
    v_eq = float(channel.column("v_eq")[row])
    if math.isfinite(v_eq) and math.isfinite(threshold) and v_eq >= threshold:
        sentences.append("V_eq as tracked stands above it already: it comes from another method, and the two disagree.")
    sentences.append("If V_eq goes on growing as it did; it is not the remaining life." + unscaled(run, channel))
    return Finding(question, f"{duration(tt)} to the threshold{of}.", " ".join(sentences), brief=duration(tt))


def _by_recorded_runs(run: Run, tt: float, ends: str, *, outside: bool) -> Finding:
    """Return the time to the end as recorded runs ended, or, beyond them, by the elapsed time alone."""
    rests = "As recorded runs of such machines ended; no threshold of V_eq is asked."
    if outside:
        rests = "This final stage lies beyond the recorded runs: as long again as it has lasted."
    return Finding("How long left?", f"{duration(tt)} to the end.", f"{_ends(run, ends)} {rests}", brief=duration(tt))


def _to_alarm(run: Run, channel: Channel) -> list[Finding]:
    """Return the time to the alarm level; nothing for records of an earlier version."""
    told = alarm_time(channel)
    if told is None:
        return []
    question = "How long to the alarm level?"
    if told.refusal:
        return [Finding(question, "Cannot be said.", _sentence(told.refusal), known=False, brief="")]
    if told.reached:
        return [Finding(question, "It is reached.", f"{_capital(told.level)}.", brief="reached")]
    text = f"RMS reaches {told.level} if it goes on as since the onset, or by a step."
    ends = interval(told.lower, told.upper, duration)
    return [Finding(question, f"{duration(told.time)}.", f"{_ends(run, ends)} {text}", brief=duration(told.time))]


def _sentence(text: str) -> str:
    return f"{_capital(text)}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
