"""The answers to the questions about a channel, each with its evidence and uncertainty, or the reason of a refusal."""

from __future__ import annotations

import math

import numpy as np

from monitor.health.schema import HINT, VERDICT
from monitor.records.archive import of_channel
from monitor.report.readings import (
    LATE,
    Finding,
    LifeMoment,
    VolumeScale,
    doubt_of,
    gear_findings,
    named_fault,
    open_stage,
    unscaled,
)
from monitor.report.runs import Channel, Run
from monitor.report.verdict import ChannelContext, ChannelVerdict, interval_name, unused_blocks
from monitor.words.features import FEATURES
from monitor.words.numbers import Clock, count, duration, figure, interval, volume
from monitor.words.statuses import (
    ALARM_LEVELS,
    EDV_REFUSALS,
    LEVEL_OF,
    TT_REFUSALS,
    TTA_REFUSALS,
    UNDECIDED,
    VELOCITY_REFUSALS,
    fault_words,
    named_words,
)
from monitor.words.zones import MACHINE_CLASSES, MachineClass, zone_words


def _to_alarm(run: Run, channel: Channel) -> list[Finding]:
    """Return the time to the alarm level; nothing for records of an earlier version."""
    statuses = channel.word("tta_status")
    rows = np.flatnonzero(statuses != "")
    if not rows.size:
        return []
    question = "How long to the alarm level?"
    row = int(rows[-1])
    status = str(statuses[row])
    time, lower, upper, level = (
        float(channel.column(name)[row]) for name in ("tta", "tta_lower", "tta_upper", "tta_level")
    )
    words = ALARM_LEVELS.get(str(channel.word("tta_level_source")[row]), "the alarm level")
    baseline = channel.baseline("rms")
    if math.isfinite(level) and channel.has_level:
        words += f", {FEATURES['rms'].write(level)}"
    elif math.isfinite(level) and baseline > 0.0:
        words += f", {figure(level / baseline, 2)} times the baseline"
    if status == "reached":
        return [Finding(question, "It is reached.", f"{_capital(words)}.", brief="reached")]
    if not math.isfinite(time):
        return [Finding(question, "Cannot be said.", _sentence(TTA_REFUSALS.get(status, status)), known=False)]
    text = f"RMS reaches {words} if it goes on as since the onset, or by a step."
    support = f"{_ends(run, interval(lower, upper, duration))} {text}"
    return [Finding(question, f"{duration(time)}.", support, brief=duration(time))]


_QUESTION = "How much does the machine vibrate?"
_NOT_BEARINGS = "It judges the vibration of the machine, not its bearings."


def velocity_findings(run: Run, channel: Channel) -> tuple[Finding, ...]:
    """Return the velocity and its zone; nothing for records without, or where no class asks for what is missing."""
    statuses = channel.word("velocity_status")
    rows = np.flatnonzero(statuses != "")
    judged = class_of(run)
    if not rows.size:
        return ()
    row = channel.last_row("velocity_rms")
    if row is None:
        status = str(statuses[rows[-1]])
        why = VELOCITY_REFUSALS.get(status, status)
        return (Finding(_QUESTION, "No velocity.", f"{why[:1].upper()}{why[1:]}.", known=False),) if judged else ()
    velocity, floor = (1e3 * float(channel.column(name)[row]) for name in ("velocity_rms", "velocity_floor"))
    zone = str(channel.word("velocity_zone")[row])
    sentences = [f"RMS of the velocity from 10 to 1000 Hz at block {channel.sequence[row]:,}."]
    if zone and judged is not None:
        limits = ", ".join(f"{1e3 * limit:g}" for limit in judged.limits)
        sentences.append(f"{judged.text}: limits {limits} mm/s ({judged.table}). {_NOT_BEARINGS}")
    elif judged is not None:
        sentences.append("No zone: none is given at this speed, or for a block with such flags.")
    if math.isfinite(floor) and floor > 0.5 * velocity:
        sentences.append(f"{figure(floor, 2)} mm/s of it are continuous, as noise of the sensor is.")
    answer = f"{figure(velocity)} mm/s{f': {zone_words(zone)}' if zone else ''}."
    return (Finding(_QUESTION, answer, " ".join(sentences), brief=f"{figure(velocity, 2)} mm/s {zone}".strip()),)


def class_of(run: Run) -> MachineClass | None:
    """Return the class of the machine, None where none or several are stated."""
    return MACHINE_CLASSES.get(str(run.attributes.get("iso_class", "")))


LATEST = 20
"""Blocks over which scores above the threshold are counted."""


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
        unused = unused_blocks(channel)
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


def _at(mark: LifeMoment, clock: Clock) -> str:
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
    texts = (best, _agreement(channel, verdict, fault), doubt_of(channel, row, fault), _damage_mode(fault))
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


def _sentence(text: str) -> str:
    return f"{_capital(text)}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _damage_mode(fault: str) -> str:
    """Return what vibration says of the mode of damage after ISO 15243, "" where no part is named."""
    if fault == UNDECIDED or not fault:
        return ""
    if fault == "cage":
        return "Lines of the cage: a looser, worn or broken cage, or an uneven load; only inspection tells."
    return (
        "Impacts in its rhythm: localised damage of a surface. Rolling contact fatigue (ISO 15243, 5.1) is the usual "
        "mode; corrosion, electrical erosion and indentations (5.3 to 5.5) sound alike: only inspection tells."
    )
