"""Evidence of one channel for the damaged part of its bearing: of a block, of recent blocks, and since an onset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

from monitor.health.signal.foreign import LOUDER
from monitor.health.signal.quality import Verdict
from monitor.words.parts import FAULTS

UNNAMED_DEPTH = 0.2
"""Depth that a block without a name counts against those that name a part: the least at which one is named."""
_RECENT, _EPISODE = 50, 5000
"""Memory of the means, usable blocks: of recent evidence, and of evidence since an onset."""
_FORGOTTEN = 1e-4
"""Mean depth below which a name is dropped."""
_MIN_LEADING_SHARE = 0.25
"""Share of a channel's evidence, blocks without a name included, from which its name counts as disagreement."""


@dataclass(frozen=True)
class BlockEvidence:
    """Evidence of one block of a channel.

    Attributes:
        usable: the machine ran, the sensor worked, the block was in order.
        paused: the machine was stopped or outside its speeds, or the block came late; the block counts neither way.
        fault: the named part, several joined by "|", or None.
        depth: of its lines, over the mean envelope.
        final: the final stage of the channel has begun and is not over.
        time: UTC s, or None.
        rise: power of the vibration over that of the baseline, in the final stage, (m/s2)^2; None where not known.
        raised: whether lines of the bearing stand above their baseline.
    """

    usable: bool = True
    paused: bool = False
    fault: str | None = None
    depth: float = 0.0
    final: bool = False
    time: float | None = None
    rise: float | None = None
    raised: bool = False


@dataclass(frozen=True)
class MeanEvidence:
    """Running mean of the evidence of usable blocks; one block without a name begins it, so that none decides alone.

    Attributes:
        blocks: that are remembered.
        silent: share of them without a named part.
        named: mean over all of them of the depth of each name, 0 in blocks with another.
    """

    blocks: int = 1
    silent: float = 1.0
    named: Mapping[str, float] = field(default_factory=dict[str, float])

    def after(self, block: BlockEvidence, memory: int) -> MeanEvidence:
        """Return the mean after one more usable block."""
        blocks = min(self.blocks + 1, memory)
        silent = self.silent + ((0.0 if parts_of(block.fault) else 1.0) - self.silent) / blocks
        if not self.named and block.fault is None:
            return MeanEvidence(blocks, silent)
        names = {*self.named, *([block.fault] if block.fault is not None else [])}
        means = {name: self.named.get(name, 0.0) for name in sorted(names)}
        means = {
            name: mean + ((max(block.depth, UNNAMED_DEPTH) if name == block.fault else 0.0) - mean) / blocks
            for name, mean in means.items()
        }
        return MeanEvidence(blocks, silent, {name: mean for name, mean in means.items() if mean > _FORGOTTEN})

    def naming(self, parts: Iterable[str]) -> float:
        """Return the mean depth of the names that hold one of some parts."""
        wanted = set(parts)
        return sum(mean for name, mean in self.named.items() if wanted & parts_of(name))

    @property
    def leading(self) -> str | None:
        """The deepest name where its share of the evidence suffices, or None."""
        named = {name: mean for name, mean in self.named.items() if parts_of(name)}
        best = max(named, key=lambda name: (named[name], name), default=None)
        if best is None or named[best] < _MIN_LEADING_SHARE * (named[best] + UNNAMED_DEPTH * self.silent):
            return None
        return best


@dataclass(frozen=True)
class ChannelEvidence:
    """Evidence of a channel: of recent blocks, and since the onset of the final stage that is open.

    Attributes:
        missed: blocks since the latest usable one.
        time: of that, UTC s, or None.
        below: of the recent blocks since the onset, the share in which the level of each other bearing had risen by
            ``LOUDER`` times as much.
    """

    recent: MeanEvidence = field(default_factory=MeanEvidence)
    since_onset: MeanEvidence | None = None
    missed: int = 0
    time: float | None = None
    below: Mapping[str, float] = field(default_factory=dict[str, float])

    def after(self, block: BlockEvidence | None, louder: frozenset[str] = frozenset()) -> ChannelEvidence:
        """Return the evidence after a block of its source; ``block`` is None where it has nothing of the channel.

        Args:
            louder: the bearings whose level had risen by ``LOUDER`` times as much.
        """
        if block is None or not block.usable:
            return self if block is not None and block.paused else replace(self, missed=self.missed + 1)
        since_onset = (self.since_onset or MeanEvidence()).after(block, _EPISODE) if block.final else None
        time = self.time if block.time is None else block.time
        below: dict[str, float] = {}
        if since_onset is not None:
            share = 1.0 / min(since_onset.blocks, _RECENT)
            for name in sorted({*self.below, *louder}):
                before = self.below.get(name, 0.0)
                below[name] = before + share * ((name in louder) - before)
        below = {name: found for name, found in below.items() if found > _FORGOTTEN}
        return ChannelEvidence(self.recent.after(block, _RECENT), since_onset, 0, time, below)


def evidence_of_record(
    channels: Mapping[str, Mapping[str, Any]], time: float | None = None
) -> dict[str, BlockEvidence]:
    """Return the evidence in the values of a record, by channel; ``time`` is that of its block, UTC s."""
    found: dict[str, BlockEvidence] = {}
    for name, values in channels.items():
        flags = (values.get("quality_flags") or "").split("|")
        verdict = Verdict(values.get("quality_status") or "ok", tuple(flag for flag in flags if flag))
        found[name] = BlockEvidence(
            usable=verdict.for_baseline,
            paused=verdict.accepted and bool({"stopped", "late", "out_of_order", "outside_speed"} & set(flags)),
            fault=values.get("fault_candidates") or values.get("fault"),
            depth=values.get("fault_depth") or 0.0,
            final=values.get("t_fs_block") is not None,
            time=time,
            rise=_rise(values),
            raised=bool(values.get("raised")),
        )
    return found


def _rise(values: Mapping[str, Any]) -> float | None:
    rms, baseline = values.get("rms"), values.get("rms_baseline")
    if rms is None or baseline is None or values.get("absolute_level") != "yes":
        return None
    return rms * rms - baseline * baseline


def louder_bearings(
    evidence: Mapping[str, BlockEvidence], bearings: Mapping[str, Sequence[str]]
) -> dict[str, frozenset[str]]:
    """Return, by channel, the other bearings whose level rose by ``LOUDER`` times as much as its own.

    Only channels whose level rose without the lines of their own bearing are given.
    """
    rises = {
        bearing: [one.rise for name in names if (one := evidence.get(name)) is not None and one.usable and one.rise]
        for bearing, names in bearings.items()
    }
    highest = {bearing: max(found) for bearing, found in rises.items() if found}
    return {
        name: frozenset(
            other for other, highest_rise in highest.items() if other != bearing and highest_rise >= LOUDER * own.rise
        )
        for bearing, names in bearings.items()
        for name in names
        if (own := evidence.get(name)) is not None and not own.raised and own.rise is not None and own.rise > 0.0
    }


@cache
def parts_of(fault: str | None) -> frozenset[str]:
    """Split a name into parts; other words give an empty set."""
    return frozenset(part for part in (fault or "").split("|") if part in FAULTS)
