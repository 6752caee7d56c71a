"""What one channel says of its bearing: of each block, of recent ones, and of those since an onset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

from monitor.health.schema import FAULTS
from monitor.health.signal.foreign import LOUDER
from monitor.health.signal.quality import Verdict

SILENCE = 0.2
"""Depth that a block without a name counts against those that name a part: the least at which one is named."""
_RECENT, _EPISODE = 50, 5000
"""Usable blocks that a ballot remembers: the recent one, and that since an onset."""
_FORGOTTEN = 1e-4
"""Mean depth below which a name has left a ballot."""
_HEARD = 0.25
"""Share of a channel's own evidence, silence included, from which its name counts as disagreement."""


@dataclass(frozen=True)
class Heard:
    """What one block of a channel said.

    Attributes:
        usable: the machine ran, the sensor worked, the block was in order.
        paused: the machine stood still or ran beyond its speeds, or the block came late: nothing could be heard.
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
        below: of the recent blocks since the onset, the share in which the level of each other bearing had risen by
            ``LOUDER`` times as much.
    """

    recent: Ballot = field(default_factory=Ballot)
    since_onset: Ballot | None = None
    missed: int = 0
    time: float | None = None
    below: Mapping[str, float] = field(default_factory=dict[str, float])

    def after(self, heard: Heard | None, louder: frozenset[str] = frozenset()) -> Voice:
        """Return the voice after a block of its source, which holds nothing of the channel where that is None.

        Args:
            louder: the bearings whose level had risen by ``LOUDER`` times as much.
        """
        if heard is None or not heard.usable:
            return self if heard is not None and heard.paused else replace(self, missed=self.missed + 1)
        since_onset = (self.since_onset or Ballot()).after(heard, _EPISODE) if heard.final else None
        time = self.time if heard.time is None else heard.time
        below: dict[str, float] = {}
        if since_onset is not None:
            share = 1.0 / min(since_onset.blocks, _RECENT)
            for name in sorted({*self.below, *louder}):
                before = self.below.get(name, 0.0)
                below[name] = before + share * ((name in louder) - before)
        below = {name: found for name, found in below.items() if found > _FORGOTTEN}
        return Voice(self.recent.after(heard, _RECENT), since_onset, 0, time, below)


def heard_in(channels: Mapping[str, Mapping[str, Any]], time: float | None = None) -> dict[str, Heard]:
    """Return what the values of a record say, by channel; ``time`` is that of its block, UTC s."""
    found: dict[str, Heard] = {}
    for name, values in channels.items():
        flags = (values.get("quality_flags") or "").split("|")
        verdict = Verdict(values.get("quality_status") or "ok", tuple(flag for flag in flags if flag))
        found[name] = Heard(
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


def louder_bearings(heard: Mapping[str, Heard], bearings: Mapping[str, Sequence[str]]) -> dict[str, frozenset[str]]:
    """Return the other bearings whose level has risen by ``LOUDER`` times as much as that of a channel.

    Of channels whose level has risen, and not the lines of their bearing.
    """
    rises = {
        bearing: [one.rise for name in names if (one := heard.get(name)) is not None and one.usable and one.rise]
        for bearing, names in bearings.items()
    }
    highest = {bearing: max(found) for bearing, found in rises.items() if found}
    return {
        name: frozenset(
            other for other, highest_rise in highest.items() if other != bearing and highest_rise >= LOUDER * own.rise
        )
        for bearing, names in bearings.items()
        for name in names
        if (own := heard.get(name)) is not None and not own.raised and own.rise is not None and own.rise > 0.0
    }


@cache
def parts_of(fault: str | None) -> frozenset[str]:
    """Return the parts that a name holds; none of no name or one that is no part."""
    return frozenset(part for part in (fault or "").split("|") if part in FAULTS)
