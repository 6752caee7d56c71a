"""The first screen: is it failing, since when, where, how large, how long left; each with its evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from monitor.report.runs import Channel, Run
from monitor.report.verdict import ChannelContext, ChannelVerdict, Moment, interval_name, named_fault, unscaled
from monitor.words.numbers import Clock, count, duration, figure, interval, volume
from monitor.words.statuses import EDV_REFUSALS, TT_REFUSALS, fault_words

_LATEST = 20


@dataclass(frozen=True)
class Finding:
    """A question and its answer from the records.

    Attributes:
        answer: one sentence at most.
        support: evidence and its uncertainty, or the reason of a refusal.
        known: False for a refusal.
        brief: for a table, "" for none.
    """

    question: str
    answer: str
    support: str
    known: bool = True
    brief: str = ""


def findings(context: ChannelContext) -> tuple[Finding, ...]:
    """Answer the five questions about a channel after its last block."""
    run, channel, verdict = context.run, context.channel, context.verdict
    return (
        _failing(channel, verdict),
        _since(verdict, context.clock),
        _where(channel, verdict),
        _how_large(run, channel),
        *_how_long(run, channel),
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
        rejected = int(np.sum(channel.status != "ok"))
        why = f"No block could be judged; {count(rejected, 'block')} could not be used." if rejected else ""
        return Finding(question, answer, why or "No block could be judged.", known=False)
    if verdict.stage == "learning":
        if verdict.fault:
            answer = f"Not known yet, but damage of the {fault_words(verdict.fault)} is detected."
        why = "The baseline is not complete, so that no change can be judged yet."
        return Finding(question, answer, why, known=False)
    if verdict.stage == "healthy" and verdict.fault:
        answer = f"Its level says no, but damage of the {fault_words(verdict.fault)} is detected."
    return Finding(question, answer, " ".join(text for text in (_scores(channel), _growth(channel)) if text))


def _scores(channel: Channel) -> str:
    score, threshold = channel.column("detect_score"), channel.column("detect_threshold")
    rows = np.flatnonzero(np.isfinite(score) & np.isfinite(threshold))[-_LATEST:]
    if not rows.size:
        return ""
    above = int(np.sum(score[rows] > threshold[rows]))
    return (
        f"The score of RMS and H_or is above its threshold in {above} of the last {count(rows.size, 'block')} "
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
        return Finding(question, "–", "No final stage so far.", known=False)
    sentences = [f"The final stage began at {_at(verdict.t_fs, clock)}."]
    if verdict.t_fs_known is not None:
        sentences.append(f"This was known at {_at(verdict.t_fs_known, clock)}.")
    if verdict.t_eol is not None:
        sentences.append(f"The end of life was reached at {_at(verdict.t_eol, clock)}.")
    short = clock.moment(verdict.t_fs.time)
    if not math.isfinite(verdict.t_fs.time) and verdict.t_fs.block is not None:
        short = f"block {verdict.t_fs.block:,}"
    brief = clock.short(verdict.t_fs.time) if math.isfinite(verdict.t_fs.time) else short
    return Finding(question, f"{_capital(short)}.", " ".join(sentences), brief=brief)


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
    evidence = []
    if math.isfinite(snr):
        evidence.append(f"lines {snr:.1f} times the noise floor")
    if math.isfinite(depth):
        evidence.append(f"modulation depth {depth:.2f}")
    best = f"At best {', '.join(evidence)} (block {channel.sequence[row]:,})." if evidence else ""
    apart = "The resolution does not tell them apart." if "|" in fault else ""
    support = " ".join(text for text in (best, _agreement(channel, verdict, fault), apart) if text)
    return Finding(question, f"{fault_words(fault).capitalize()}.", support, brief=fault_words(fault))


def _agreement(channel: Channel, verdict: ChannelVerdict, fault: str) -> str:
    """Return in how many blocks since the onset was known the same part, another or none was named."""
    late = np.isin(channel.word("stage"), ("final", "end_of_life"))
    if verdict.stage not in ("final", "end_of_life") or not late.any():
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
    value = volume(channel.column("v_eq")[known])
    lower, upper = channel.column("v_eq_lower")[known], channel.column("v_eq_upper")[known]
    ends = interval(float(lower), float(upper), volume)
    sentences = [f"{_capital(interval_name(run))}: {ends}."] if ends else ["A single number, without an interval."]
    if status == "ambiguous":
        sentences.append("Several sizes of damage explain the vibration, so that the middle says little.")
    if status == "widened":
        sentences.append("The search had to go back, so that it may be lower than before.")
    if known != row:
        why = EDV_REFUSALS.get(status, status)
        sentences.insert(0, f"At block {channel.sequence[known]:,}; since then none: {why}.")
        value = f"Last {value}"
    sentences.append("Equivalent damaged volume V_eq, in the model of this rig." + unscaled(run))
    return Finding(
        question,
        f"{value}.",
        " ".join(sentences),
        brief=value if known == row else f"({volume(channel.column('v_eq')[known])})",
    )


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
    if status == "already_crossed":
        if math.isfinite(lower) and math.isfinite(upper):
            late = f"{_capital(interval_name(run))}: up to {duration(upper)} from now." if upper > 0.0 else ""
            return Finding(
                question, f"The threshold{of} has more likely than not been reached.", late, brief="likely reached"
            )
        first = np.flatnonzero(channel.words["tt_status"][:, place] == status)[0]
        return Finding(
            question, f"The threshold{of} was reached.", f"By block {channel.sequence[first]:,}.", brief="reached"
        )
    if status != "ok" or not math.isfinite(tt):
        why = f"For the threshold{of}: {TT_REFUSALS.get(status, status)}."
        return Finding(question, "No forecast.", why, known=False, brief="no forecast")
    ends = interval(lower, upper, duration)
    sentences = [f"{_capital(interval_name(run))}: {ends}."] if ends else ["A single number, without an interval."]
    if math.isfinite(probability):
        sentences.append(f"Reached within the maintenance window with a probability of {probability:.0%}.")
    v_eq = float(channel.column("v_eq")[row])
    if math.isfinite(v_eq) and math.isfinite(threshold) and v_eq >= threshold:
        sentences.append("V_eq as tracked stands above it already: it comes from another method, and the two disagree.")
    sentences.append("If V_eq goes on growing as it did; it is not the remaining life." + unscaled(run))
    return Finding(question, f"{duration(tt)} to the threshold{of}.", " ".join(sentences), brief=duration(tt))


def _sentence(text: str) -> str:
    return f"{_capital(text)}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
