"""One verdict a bearing, by the evidence of all channels that listen to it.

The evidence of a channel is the depth of the lines of each named part, on the mean of its recent usable blocks, and the
share of blocks in which no part was named. Evidence for a part is the sum of its depths over the channels, a name of
two parts counting for both. A channel with an open final stage has a second mean, of all blocks since the onset was
known. What these name is a verdict and outweighs hints: names of a machine without an onset or without a baseline. How
well a name is supported is always a matter of the recent blocks: lines that spread under their own noise lower it, and
the verdict stays.

A name also stays until another has half as much evidence again, so that it does not change from block to block. All
follows from the values of records: a restart, a replay and a report over the same records say the same. A
persistent name that is replaced is an event.

A level that rose may come from a neighbour. Where a bearing has an onset and no part is named in it, while a verdict
names a part of another whose level has risen by twice the power and more, in most blocks, the onset is said to be
``level_of`` that one. It stays an onset: lines tell whose damage they show, a level does not.

The name of a verdict becomes persistent after as many usable blocks in a row as an onset needs (``persist_blocks``). A
name that shares a part with it ("inner|ball" for "inner") does not change it; another name replaces it after as many
blocks in a row. Hints do not count. The persistent name ends with the final stage.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from monitor.health.codec import StoredState
from monitor.health.name.evidence import (
    UNNAMED_DEPTH,
    BlockEvidence,
    ChannelEvidence,
    MeanEvidence,
    louder_bearings,
    parts_of,
)
from monitor.health.onset import DetectSettings
from monitor.health.schema import HINT, VERDICT
from monitor.words.parts import FAULTS


@dataclass(frozen=True)
class PersistentName:
    """The persistent name of a bearing's verdict.

    Attributes:
        fault: None until a name has persisted.
        rival: the latest name that shares no part with it, while it is named.
        blocks: usable blocks in a row that named the rival.
    """

    fault: str | None = None
    rival: str | None = None
    blocks: int = 0

    def after(self, fault: str | None, persist_blocks: int) -> PersistentName:
        """Return the persistent name after one more usable block of an open final stage.

        Args:
            fault: name of the verdict, None where there is none.
            persist_blocks: usable blocks in a row after which a name is held.
        """
        if fault is None or parts_of(fault) & parts_of(self.fault):
            return PersistentName(self.fault)
        blocks = self.blocks + 1 if fault == self.rival else 1
        return PersistentName(fault) if blocks >= persist_blocks else PersistentName(self.fault, fault, blocks)


_ENTER = {HINT: 0.5, VERDICT: 0.1}
_HOLD = {HINT: 0.25, VERDICT: 0.0}
"""Least share of the recent evidence, blocks without a name included, to begin to name a part, and to go on."""
_LEAD = 1.5
"""How much more evidence than the present name another needs."""
_APART = 0.1
"""Share of the evidence for a part that leaves out another, from which the two are told apart."""
_STALE, _PATIENCE_S = 50, 30 * 86400.0
"""Unusable blocks in a row after which a channel is left out; beside another source so many blocks of the slowest one,
and at least so many seconds."""


@dataclass(frozen=True)
class MachineState(StoredState):
    """Evidence of the channels of one source; the names of its bearings, of the latest block and persistent."""

    VERSIONS = (1, 2, 3)
    LATER = frozenset({"held"})

    voices: Mapping[str, ChannelEvidence] = field(default_factory=dict[str, ChannelEvidence])
    named: Mapping[str, str] = field(default_factory=dict[str, str])
    held: Mapping[str, PersistentName] = field(default_factory=dict[str, PersistentName])
    version: int = VERSIONS[-1]


@dataclass(frozen=True)
class BearingVerdict:
    """The damaged part of a bearing, by the evidence of all its channels.

    Attributes:
        fault: the damaged part, several joined by "|" that cannot be told apart, or None.
        basis: "hint" or "verdict", None without a name.
        support: 0 to 1: depth of the lines with this name over that of all named lines and of blocks without a name,
            as many as in the channel with fewest. None without a name.
        disagreement: by channel, the name of those that name another part.
        channels: that listen to it.
        level_of: the bearing with whose damage the level has risen, where an onset shows no part of its own.
        replaced: the part of the verdict that held before and gave way with this block.
    """

    fault: str | None = None
    basis: str | None = None
    support: float | None = None
    disagreement: Mapping[str, str] = field(default_factory=dict[str, str])
    channels: tuple[str, ...] = ()
    level_of: str | None = None
    replaced: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the interface."""
        return {
            "fault": self.fault,
            "fault_basis": self.basis,
            "support": None if self.support is None else round(self.support, 4),
            "disagreement": dict(self.disagreement),
            "channels": list(self.channels),
            "level_of": self.level_of,
        }


def step(
    state: MachineState,
    evidence: Mapping[str, BlockEvidence],
    bearings: Mapping[str, Sequence[str]],
    persist_blocks: int = DetectSettings.persist_blocks,
) -> tuple[MachineState, dict[str, BearingVerdict]]:
    """Take one block of a source.

    Args:
        evidence: of the block by channel; a missing channel gave nothing usable.
        bearings: channels of the source by the bearing that they listen to.
        persist_blocks: usable blocks in a row after which the name of a verdict is held.
    """
    channels = [name for names in bearings.values() for name in names]
    louder = louder_bearings(evidence, bearings)
    voices = {
        name: state.voices.get(name, ChannelEvidence()).after(evidence.get(name), louder.get(name, frozenset()))
        for name in channels
    }
    said = weigh([replace(state, voices=voices)], bearings)
    named = {bearing: found.fault for bearing, found in said.items() if found.fault is not None}
    held: dict[str, PersistentName] = {}
    for bearing, found in said.items():
        final = [evidence.get(name) for name in bearings[bearing] if voices[name].since_onset is not None]
        if not final:
            continue
        held[bearing] = before = state.held.get(bearing, PersistentName())
        if any(one is not None and one.usable for one in final):
            held[bearing] = before.after(found.fault if found.basis == VERDICT else None, persist_blocks)
        if before.fault not in (None, held[bearing].fault):
            said[bearing] = replace(found, replaced=before.fault)
    return replace(state, voices=voices, named=named, held=held), said


def weigh(
    states: Sequence[MachineState], bearings: Mapping[str, Sequence[str]], patience: float | None = None
) -> dict[str, BearingVerdict]:
    """Return the verdict on each bearing of a machine.

    Args:
        states: of its sources, in any order.
        bearings: all channels by the bearing that they listen to.
        patience: s without a usable block after which a channel is left out beside one with a later block, or None.
    """
    voices = {name: voice for state in states for name, voice in state.voices.items()}
    found = {
        bearing: _weigh_one(
            {name: voices.get(name, ChannelEvidence()) for name in sorted(names)},
            frozenset(part for state in states for part in parts_of(state.named.get(bearing))),
            patience,
        )
        for bearing, names in bearings.items()
    }
    damaged = [bearing for bearing, verdict in found.items() if verdict.basis == VERDICT]
    for bearing, verdict in found.items():
        if verdict.basis != VERDICT and damaged:
            since_onset = [
                voices[name] for name in verdict.channels if voices.get(name, ChannelEvidence()).since_onset is not None
            ]
            found[bearing] = replace(verdict, level_of=_level_of(since_onset, damaged))
    return found


def _level_of(voices: Sequence[ChannelEvidence], damaged: Sequence[str]) -> str | None:
    """Return the damaged bearing with which the level of channels with an onset has risen in most of their blocks."""
    least = {name: min((voice.below.get(name, 0.0) for voice in voices), default=0.0) for name in damaged}
    best = max(damaged, key=lambda name: (least[name], name))
    return best if least[best] > 0.5 else None


def patience_of(intervals: Iterable[float | None]) -> float:
    """Return the patience for several sources by the usual intervals of their blocks, s."""
    return max(_PATIENCE_S, _STALE * max((interval or 0.0 for interval in intervals), default=0.0))


def _weigh_one(voices: Mapping[str, ChannelEvidence], before: frozenset[str], patience: float | None) -> BearingVerdict:
    """Combine the evidence of the channels of one bearing; ``before`` are the parts named until now."""
    if not any(voice.recent.named or (voice.since_onset and voice.since_onset.named) for voice in voices.values()):
        return BearingVerdict(channels=tuple(voices))
    live = {name: voice for name, voice in voices.items() if _is_weighed(voice, voices.values(), patience)} or voices
    recent = {name: voice.recent for name, voice in live.items()}
    total = sum(one.naming(FAULTS) for one in recent.values())
    unnamed = UNNAMED_DEPTH * min(one.silent for one in recent.values())
    since_onset = [voice.since_onset for voice in live.values() if voice.since_onset is not None]
    for basis, observed in ((VERDICT, since_onset), (HINT, list(recent.values()))):
        name = _chosen(observed, before)
        parts = parts_of(name)
        if name is None or total < (_HOLD if parts & before else _ENTER)[basis] * (total + unnamed):
            continue
        return BearingVerdict(
            fault=name,
            basis=basis,
            support=sum(one.naming(parts) for one in recent.values()) / (total + unnamed),
            disagreement=_others(live, parts),
            channels=tuple(voices),
        )
    return BearingVerdict(channels=tuple(voices))


def _others(voices: Mapping[str, ChannelEvidence], parts: frozenset[str]) -> dict[str, str]:
    """Return by channel the name of those that name none of some parts: since their onset, or recently."""
    found = {
        name: (voice.since_onset and voice.since_onset.leading) or voice.recent.leading
        for name, voice in voices.items()
    }
    return {name: other for name, other in found.items() if other is not None and not parts & parts_of(other)}


def _is_weighed(voice: ChannelEvidence, all_voices: Iterable[ChannelEvidence], patience: float | None) -> bool:
    if voice.missed >= _STALE:
        return False
    if patience is None or voice.time is None:
        return True
    newest = max(other.time for other in all_voices if other.time is not None)
    return newest - voice.time <= patience


def _chosen(observed: Sequence[MeanEvidence], before: frozenset[str]) -> str | None:
    """Return the part with most evidence, with those that the same blocks name and no others tell apart."""
    evidence = {part: sum(one.naming([part]) for one in observed) for part in FAULTS}
    best = max(FAULTS, key=lambda part: evidence[part] * (_LEAD if part in before else 1.0))
    if evidence[best] == 0.0:
        return None
    together = [best]
    for part in FAULTS:
        if part == best:
            continue
        apart = sum(
            mean
            for one in observed
            for name, mean in one.named.items()
            if best in parts_of(name) and part not in parts_of(name)
        )
        limit = _APART
        if best in before:
            limit *= _LEAD if part in before else 1.0 / _LEAD
        if apart < limit * evidence[best]:
            together.append(part)
    return "|".join(part for part in FAULTS if part in together)
