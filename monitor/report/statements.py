"""What the channels of a bearing say together, and what to do next, as on the page and in mails."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.name.evidence import BlockEvidence, evidence_of_record
from monitor.health.name.machine import BearingVerdict, MachineState, patience_of, step, weigh
from monitor.report.readings import Finding, named_fault, named_gear
from monitor.report.runs import Channel, Run
from monitor.words.advice import ADVICE, Statement, check_advice, state_of
from monitor.words.situation import Situation
from monitor.words.statuses import BASES, UNDECIDED, fault_words, level_words

_WORDS = ("fault", "fault_candidates", "quality_status", "quality_flags", "stage", "absolute_level", "raised")
_NUMBERS = ("fault_depth", "t_fs_block", "rms", "rms_baseline")
_BLOCKS = 20_000
"""Latest blocks that are weighed: four times what a ballot remembers."""


@dataclass(frozen=True)
class BearingStatement:
    """A bearing on the page, in words: ``basis`` and ``support`` are "–" without a name, ``others`` then "".

    Attributes:
        grade: "watch" for a verdict, "open" for a hint or a level that rises with a neighbour's, "good" for none.
        others: which channels name another part.
        channels: that listen to it.
    """

    name: str
    grade: str
    part: str
    basis: str
    why: str
    support: str
    others: str
    channels: str
    verdict: BearingVerdict


def bearings_of(run: Run) -> dict[str, tuple[str, ...]]:
    """Return the channels of a run by bearing, as its attributes say; {} for records that are older than these."""
    found: dict[str, str] = {}
    for item in run.attributes.get("bearing", "").split("; "):
        channel, _, bearing = item.partition(": ")
        if bearing and channel in run.channels:
            found[channel] = bearing
    return {name: tuple(c for c, bearing in found.items() if bearing == name) for name in dict.fromkeys(found.values())}


def bearing_parts(run: Run) -> tuple[BearingStatement, ...]:
    """Return what is said of each bearing of a run after its last block, in the order of the configuration."""
    bearings = bearings_of(run)
    sources = [_source_state(group, bearings, dated=run.dated) for group in _by_source(run, bearings)]
    patience = patience_of([_interval(group[0]) for group in _by_source(run, bearings)]) if len(sources) > 1 else None
    return tuple(_part(name, verdict) for name, verdict in weigh(sources, bearings, patience).items())


def _by_source(run: Run, bearings: Mapping[str, Sequence[str]]) -> list[list[Channel]]:
    """Return the channels that share their blocks together."""
    groups: list[list[Channel]] = []
    for name in (name for names in bearings.values() for name in names):
        channel = run.channels[name]
        group = next((group for group in groups if _same_blocks(group[0], channel)), None)
        if group is None:
            groups.append([channel])
        else:
            group.append(channel)
    return groups


def _same_blocks(one: Channel, other: Channel) -> bool:
    return np.array_equal(one.sequence, other.sequence) and np.array_equal(one.time, other.time, equal_nan=True)


def _interval(channel: Channel) -> float | None:
    steps = np.diff(channel.time)
    steps = steps[steps > 0.0]
    return float(steps.min()) if steps.size else None


def _source_state(channels: Sequence[Channel], bearings: Mapping[str, Sequence[str]], *, dated: bool) -> MachineState:
    """Take the records of the channels of one source through :func:`monitor.health.name.machine.step`."""
    names = {channel.name for channel in channels}
    own = {bearing: tuple(name for name in found if name in names) for bearing, found in bearings.items()}
    own = {bearing: found for bearing, found in own.items() if found}
    state = MachineState()
    for heard in zip(*(_heard(channel, dated=dated) for channel in channels), strict=True):
        said = {channel.name: one for channel, one in zip(channels, heard, strict=True) if one is not None}
        state, _ = step(state, said, own)
    return state


def _heard(channel: Channel, *, dated: bool) -> Iterator[BlockEvidence | None]:
    """Yield what each block said in the order of their numbers, None where it holds nothing of the channel."""
    # A wrong clock sorts a block to another place in time.
    rows = np.argsort(channel.sequence, kind="stable")[-_BLOCKS:]
    numbers = zip(*(channel.column(name)[rows].tolist() for name in _NUMBERS), strict=True)
    words = zip(*(_words(channel, name)[rows].tolist() for name in _WORDS), strict=True)
    for time, known, said in zip(channel.time[rows].tolist(), numbers, words, strict=True):
        values = {name: word or None for name, word in zip(_WORDS, said, strict=True)}
        if values["quality_status"] is None and values["stage"] is None:
            yield None
            continue
        measured = zip(_NUMBERS, known, strict=True)
        values |= {name: number if math.isfinite(number) else None for name, number in measured}
        yield evidence_of_record({"": values}, time if dated and math.isfinite(time) else None)[""]


def _words(channel: Channel, name: str) -> NDArray[np.object_]:
    return channel.word(name) if name in channel.words else np.full(channel.time.size, "", dtype=object)


def _part(name: str, verdict: BearingVerdict) -> BearingStatement:
    channels = ", ".join(verdict.channels)
    if verdict.fault is None or verdict.basis is None or verdict.support is None:
        grade, part = "good" if verdict.level_of is None else "open", "no part named" + level_words(verdict.level_of)
        return BearingStatement(name, grade, part, "–", "", "–", "", channels, verdict)
    basis, why = BASES[verdict.basis]
    return BearingStatement(
        name,
        "watch" if verdict.basis == "verdict" else "open",
        fault_words(verdict.fault),
        basis,
        why,
        f"{100.0 * verdict.support:.0f} %",
        "; ".join(f"{channel} says {fault_words(other)}" for channel, other in verdict.disagreement.items()),
        channels,
        verdict,
    )


_SAID_NUMBERS = (
    *("t_fs_known_block", "fault_snr", "rms", "tta", "tta_lower", "tta_upper"),
    *("tt", "tt_lower", "tt_upper"),
)
_SAID_WORDS = ("stage", "edv_status", "tt_status", "tta_status", "tta_level_source")
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


def said_of(run: Run, channel: Channel, part: BearingStatement | None) -> Statement | None:
    """Return what is said of a channel, None where no block was judged; ``part`` is its bearing where known."""
    judged = np.flatnonzero(channel.word("stage") != "")
    if not judged.size:
        return None
    row = int(judged[-1])
    values: dict[str, Any] = {name: channel.word(name)[row] or None for name in _SAID_WORDS}
    for name in _SAID_NUMBERS:
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


def part_of(parts: tuple[BearingStatement, ...], channel: str) -> BearingStatement | None:
    """Return the bearing that a channel listens to."""
    return next((part for part in parts if channel in part.verdict.channels), None)
