"""What is said of a channel after its last judged block, and what to do next, as on the page and in mails."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np

from monitor.report.bearings import BearingPart
from monitor.report.finding import Finding
from monitor.report.gears import named_gear
from monitor.report.life_marks import named_fault
from monitor.report.runs import Channel, Run
from monitor.words.advice import ADVICE, Statement, check_advice, state_of
from monitor.words.situation import Situation
from monitor.words.statuses import UNDECIDED

_NUMBERS = (
    *("t_fs_known_block", "fault_snr", "rms", "tta", "tta_lower", "tta_upper"),
    *("tt", "tt_lower", "tt_upper"),
)
_WORDS = ("stage", "edv_status", "tt_status", "tta_status", "tta_level_source")
_OF_NAME = ("fault", "fault_basis", "speed_unverified")


def advice_of(run: Run) -> dict[str, str]:
    """Return the texts of the configuration that made the records, else those of the program."""
    try:
        given = {
            key: str(text) for key, text in json.loads(run.attributes.get("advice", "{}")).items() if key in ADVICE
        }
        for text in given.values():
            check_advice(text)
    except (ValueError, AttributeError):
        # Records of several configurations have several, joined.
        given = {}
    return dict(ADVICE) | given


def said_of(run: Run, channel: Channel, part: BearingPart | None) -> Statement | None:
    """Return what is said of a channel, None where no block was judged; ``part`` is its bearing where known."""
    judged = np.flatnonzero(channel.word("stage") != "")
    if not judged.size:
        return None
    row = int(judged[-1])
    values: dict[str, Any] = {name: channel.word(name)[row] or None for name in _WORDS}
    for name in _NUMBERS:
        number = float(channel.column(name)[row])
        values[name] = number if math.isfinite(number) else None
    values["rms_baseline"] = channel.baseline("rms")
    named, fault = named_fault(channel)
    if named is not None and fault:
        values |= {name: channel.word(name)[named] or None for name in _OF_NAME}
        undecided = values["fault"] == UNDECIDED
        values |= {"fault_snr": float(channel.column("fault_snr")[named])}
        values |= {"fault_candidates": fault.split("|")} if undecided else {"fault": fault}
    found = Situation.of_record(channel.name, values, int(channel.sequence[row]), "" if part is None else part.name)
    if part is not None:
        found = found.with_bearing(part.verdict.to_dict())
    gear = named_gear(run, channel)
    if gear is not None:
        found = replace(found, gear=gear.fault, gear_kind=gear.kind)
    return state_of(replace(found, state="normal"), advice_of(run))


def what_to_do(said: Statement | None) -> Finding:
    """Return the answer to what to do next, with how sure the part is and how the level stands."""
    question = "What to do?"
    if said is None:
        return Finding(question, "Cannot be answered.", "No block could be judged.", known=False)
    support = ". ".join(text[:1].upper() + text[1:] for text in (said.headline, said.sureness, said.level) if text)
    return Finding(question, f"{said.action[:1].upper()}{said.action[1:]}.", f"{support}.", known=said.key != "normal")


def part_of(parts: tuple[BearingPart, ...], channel: str) -> BearingPart | None:
    """Return the bearing that a channel listens to."""
    return next((part for part in parts if channel in part.verdict.channels), None)
