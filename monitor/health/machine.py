"""One verdict a bearing: what the channels that listen to it name, weighed together.

Each channel has a ballot: how deep, on the mean of its recent usable blocks, the lines of each named part stood, and in
which share of the blocks no part was named. Evidence for a part is the sum of its depths over the channels, a name of
two parts counting for both. A channel with an open final stage has a second ballot, of all blocks since the onset was
known. What these name is a verdict and outweighs hints: names of a machine without an onset or without a baseline. How
well a name is supported is always a matter of the recent blocks: lines that spread under their own noise lower it, and
the verdict stays.

A name also stays until another has half as much evidence again, so that it does not change from block to block. All
follows from the values of records: a restart, a replay and a report over the same records say the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

from monitor.health.quality import Verdict
from monitor.health.schema import FAULTS, HINT, VERDICT

MACHINE_STATE_VERSION = 1
SILENCE = 0.2
"""Depth that a block without a name counts against those that name a part: the least at which one is named."""
_RECENT, _EPISODE = 50, 5000
"""Usable blocks that a ballot remembers: the recent one, and that since an onset."""
_ENTER = {HINT: 0.5, VERDICT: 0.1}
_HOLD = {HINT: 0.25, VERDICT: 0.0}
"""Share of the recent evidence, silence included, that names a part at all: to begin to name one, and to go on."""
_FORGOTTEN = 1e-4
"""Mean depth below which a name has left a ballot."""
_LEAD = 1.5
"""How much more evidence than the present name another needs."""
_APART = 0.1
"""Share of the evidence for a part that leaves out another, from which the two are told apart."""
_STALE, _PATIENCE_S = 50, 30 * 86400.0
"""Unusable blocks in a row after which a channel has no voice beside others; so many of the slowest source, and so many
seconds, beside one of another source."""
_HEARD = 0.25
"""Share of a channel's own evidence, silence included, from which its name counts as disagreement."""


@dataclass(frozen=True)
class Heard:
    """What one block of a channel said.

    Attributes:
        usable: the machine ran, the sensor worked, the block was in order.
        paused: the machine stood still or the block came late, so that nothing could be heard.
        fault: the named part, several joined by "|", or None.
        depth: of its lines, over the mean envelope.
        final: the final stage of the channel has begun and is not over.
        time: UTC s, or None.
    """

    usable: bool = True
    paused: bool = False
    fault: str | None = None
    depth: float = 0.0
    final: bool = False
    time: float | None = None


@dataclass(frozen=True)
class Ballot:
    """What a channel named in recent usable blocks. A new one holds one silent block, so that one block is not all.

    Attributes:
        blocks: that are remembered.
        silent: share of them without a named part.
        named: mean over all of them of the depth of each name, 0 in blocks with another.
    """

    blocks: int = 1
    silent: float = 1.0
    named: Mapping[str, float] = field(default_factory=dict[str, float])

    def after(self, heard: Heard, memory: int) -> Ballot:
        """Return the ballot after one more usable block."""
        blocks = min(self.blocks + 1, memory)
        silent = self.silent + ((0.0 if parts_of(heard.fault) else 1.0) - self.silent) / blocks
        if not self.named and heard.fault is None:
            return Ballot(blocks, silent)
        names = {*self.named, *([heard.fault] if heard.fault is not None else [])}
        means = {name: self.named.get(name, 0.0) for name in sorted(names)}
        means = {
            name: mean + ((max(heard.depth, SILENCE) if name == heard.fault else 0.0) - mean) / blocks
            for name, mean in means.items()
        }
        return Ballot(blocks, silent, {name: mean for name, mean in means.items() if mean > _FORGOTTEN})

    def naming(self, parts: Iterable[str]) -> float:
        """Return the mean depth of the names that hold one of some parts."""
        wanted = set(parts)
        return sum(mean for name, mean in self.named.items() if wanted & parts_of(name))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"blocks": self.blocks, "silent": self.silent, "named": dict(self.named)}

    @property
    def leading(self) -> str | None:
        """The deepest name where it stands out of the silence, or None."""
        named = {name: mean for name, mean in self.named.items() if parts_of(name)}
        best = max(named, key=lambda name: (named[name], name), default=None)
        if best is None or named[best] < _HEARD * (named[best] + SILENCE * self.silent):
            return None
        return best


@dataclass(frozen=True)
class Voice:
    """What a channel named, of recent blocks and since the onset of the final stage that is open.

    Attributes:
        missed: blocks since the latest usable one.
        time: of that, UTC s, or None.
    """

    recent: Ballot = field(default_factory=Ballot)
    since_onset: Ballot | None = None
    missed: int = 0
    time: float | None = None

    def after(self, heard: Heard | None) -> Voice:
        """Return the voice after a block of its source, which holds nothing of the channel where that is None."""
        if heard is None or not heard.usable:
            return self if heard is not None and heard.paused else replace(self, missed=self.missed + 1)
        since_onset = (self.since_onset or Ballot()).after(heard, _EPISODE) if heard.final else None
        time = self.time if heard.time is None else heard.time
        return Voice(self.recent.after(heard, _RECENT), since_onset, 0, time)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        since_onset = None if self.since_onset is None else self.since_onset.to_dict()
        return {
            "recent": self.recent.to_dict(),
            "since_onset": since_onset,
            "missed": self.missed,
            "time": self.time,
        }


@dataclass(frozen=True)
class MachineState:
    """What the channels of one source said, and what is said of its bearings; version 1."""

    voices: Mapping[str, Voice] = field(default_factory=dict[str, Voice])
    named: Mapping[str, str] = field(default_factory=dict[str, str])
    version: int = MACHINE_STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON."""
        return {
            "voices": {name: voice.to_dict() for name, voice in self.voices.items()},
            "named": dict(self.named),
            "version": self.version,
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> MachineState:
        """Return the state that :meth:`to_dict` gave; raise ValueError for another version."""
        if stored.get("version") != MACHINE_STATE_VERSION:
            raise ValueError(f"machine state: version {MACHINE_STATE_VERSION} expected, got {stored.get('version')!r}")
        voices = {
            name: Voice(
                Ballot(**voice["recent"]),
                None if voice["since_onset"] is None else Ballot(**voice["since_onset"]),
                voice["missed"],
                voice["time"],
            )
            for name, voice in stored["voices"].items()
        }
        return cls(voices, stored["named"])


@dataclass(frozen=True)
class BearingVerdict:
    """What the channels of a bearing say together.

    Attributes:
        fault: the damaged part, several joined by "|" that cannot be told apart, or None.
        basis: "hint" or "verdict", None without a name.
        support: 0 to 1: depth of the lines that are named so over that of all named lines and of silence, which
            counts as often as the least silent channel was silent. None without a name.
        disagreement: by channel, the name of those that name another part.
        channels: that listen to it.
    """

    fault: str | None = None
    basis: str | None = None
    support: float | None = None
    disagreement: Mapping[str, str] = field(default_factory=dict[str, str])
    channels: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of the interface."""
        return {
            "fault": self.fault,
            "fault_basis": self.basis,
            "support": None if self.support is None else round(self.support, 4),
            "disagreement": dict(self.disagreement),
            "channels": list(self.channels),
        }


def step(
    state: MachineState, heard: Mapping[str, Heard], bearings: Mapping[str, Sequence[str]]
) -> tuple[MachineState, dict[str, BearingVerdict]]:
    """Take one block of a source; ``bearings`` are its channels by the bearing that they listen to.

    A channel that is not in ``heard`` gave nothing usable.
    """
    channels = [name for names in bearings.values() for name in names]
    voices = {name: state.voices.get(name, Voice()).after(heard.get(name)) for name in channels}
    said = weigh([replace(state, voices=voices)], bearings)
    named = {bearing: found.fault for bearing, found in said.items() if found.fault is not None}
    return replace(state, voices=voices, named=named), said


def heard_in(channels: Mapping[str, Mapping[str, Any]], time: float | None = None) -> dict[str, Heard]:
    """Return what the values of a record say, by channel; ``time`` is that of its block, UTC s."""
    found: dict[str, Heard] = {}
    for name, values in channels.items():
        flags = (values.get("quality_flags") or "").split("|")
        verdict = Verdict(values.get("quality_status") or "ok", tuple(flag for flag in flags if flag))
        found[name] = Heard(
            usable=verdict.for_baseline,
            paused=verdict.accepted and bool({"stopped", "late", "out_of_order"} & set(flags)),
            fault=values.get("fault_candidates") or values.get("fault"),
            depth=values.get("fault_depth") or 0.0,
            final=values.get("t_fs_block") is not None,
            time=time,
        )
    return found


def weigh(
    states: Sequence[MachineState], bearings: Mapping[str, Sequence[str]], patience: float | None = None
) -> dict[str, BearingVerdict]:
    """Return what is said of each bearing of a machine.

    Args:
        states: of its sources, in any order.
        bearings: all channels by the bearing that they listen to.
        patience: s without a usable block after which a channel has no voice beside one with a later block, or None.
    """
    voices = {name: voice for state in states for name, voice in state.voices.items()}
    return {
        bearing: _weigh_one(
            {name: voices.get(name, Voice()) for name in sorted(names)},
            frozenset(part for state in states for part in parts_of(state.named.get(bearing))),
            patience,
        )
        for bearing, names in bearings.items()
    }


def patience_of(intervals: Iterable[float | None]) -> float:
    """Return the patience for several sources by the usual intervals of their blocks, s."""
    return max(_PATIENCE_S, _STALE * max((interval or 0.0 for interval in intervals), default=0.0))


@cache
def parts_of(fault: str | None) -> frozenset[str]:
    """Return the parts that a name holds; none of no name or one that is no part."""
    return frozenset(part for part in (fault or "").split("|") if part in FAULTS)


def _weigh_one(voices: Mapping[str, Voice], before: frozenset[str], patience: float | None) -> BearingVerdict:
    """Weigh the voices of one bearing; ``before`` are the parts that were named until now."""
    if not any(voice.recent.named or (voice.since_onset and voice.since_onset.named) for voice in voices.values()):
        return BearingVerdict(channels=tuple(voices))
    live = {name: voice for name, voice in voices.items() if _has_voice(voice, voices.values(), patience)} or voices
    recent = {name: voice.recent for name, voice in live.items()}
    total = sum(ballot.naming(FAULTS) for ballot in recent.values())
    silence = SILENCE * min(ballot.silent for ballot in recent.values())
    since_onset = [voice.since_onset for voice in live.values() if voice.since_onset is not None]
    for basis, ballots in ((VERDICT, since_onset), (HINT, list(recent.values()))):
        name = _chosen(ballots, before)
        parts = parts_of(name)
        if name is None or total < (_HOLD if parts & before else _ENTER)[basis] * (total + silence):
            continue
        return BearingVerdict(
            fault=name,
            basis=basis,
            support=sum(ballot.naming(parts) for ballot in recent.values()) / (total + silence),
            disagreement=_others(live, parts),
            channels=tuple(voices),
        )
    return BearingVerdict(channels=tuple(voices))


def _others(voices: Mapping[str, Voice], parts: frozenset[str]) -> dict[str, str]:
    """Return by channel the name of those that name none of some parts: since their onset, or recently."""
    found = {
        name: (voice.since_onset and voice.since_onset.leading) or voice.recent.leading
        for name, voice in voices.items()
    }
    return {name: other for name, other in found.items() if other is not None and not parts & parts_of(other)}


def _has_voice(voice: Voice, all_voices: Iterable[Voice], patience: float | None) -> bool:
    if voice.missed >= _STALE:
        return False
    if patience is None or voice.time is None:
        return True
    newest = max(other.time for other in all_voices if other.time is not None)
    return newest - voice.time <= patience


def _chosen(ballots: Sequence[Ballot], before: frozenset[str]) -> str | None:
    """Return the part with most evidence, with those that the same blocks name and no others tell apart."""
    evidence = {part: sum(ballot.naming([part]) for ballot in ballots) for part in FAULTS}
    best = max(FAULTS, key=lambda part: evidence[part] * (_LEAD if part in before else 1.0))
    if evidence[best] == 0.0:
        return None
    together = [best]
    for part in FAULTS:
        if part == best:
            continue
        apart = sum(
            mean
            for ballot in ballots
            for name, mean in ballot.named.items()
            if best in parts_of(name) and part not in parts_of(name)
        )
        limit = _APART
        if best in before:
            limit *= _LEAD if part in before else 1.0 / _LEAD
        if apart < limit * evidence[best]:
            together.append(part)
    return "|".join(part for part in FAULTS if part in together)
