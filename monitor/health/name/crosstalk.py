"""What the sensor of a bearing hears of the damage of its neighbours.

The channels of a source are analysed together. A comb is a neighbour's where it stands at a family of that neighbour's
bearing, on a channel that listens to it, above the baseline of that family, and with at least twice the power
(:mod:`monitor.health.signal.foreign`). The other channels then seek their families beside it, for onset and name
alike. So a comb is never discarded: it counts on the channel that shows it best. Spectra by the angles of different
shafts have no common axis: of those nothing is compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from models.machine.bearing import kinematics
from monitor.health import onset as detect
from monitor.health.channel import Analysed
from monitor.health.signal.features import features_beside
from monitor.health.signal.foreign import ForeignComb
from monitor.health.signal.orders import same_axis
from monitor.words.parts import PARTS


def beside_neighbours(analysed: Mapping[str, Analysed | None]) -> dict[str, Analysed | None]:
    """Return what the samples of each channel say beside the combs of other bearings."""
    said = [one for one in analysed.values() if one is not None]
    several = len({one.channel.listens_to for one in said}) > 1
    sent = [(one, comb) for one in said for comb in _combs(one)] if several else []
    return {name: one if one is None else _beside(one, sent) for name, one in analysed.items()}


def _combs(said: Analysed) -> list[ForeignComb]:
    """Return the combs by which a channel shows its bearing damaged."""
    features = said.features
    raised = detect.raised_lines(said.state.detect, said.detected, said.channel.detect)
    if not raised or features.speed is None:
        return []
    lines = kinematics(said.channel.bearing, features.speed)
    combs: list[ForeignComb] = []
    for spectrum, families, envelope in zip(features.sought, features.families, features.envelopes, strict=True):
        for part in sorted((part for part in PARTS if part.feature in raised), key=lambda part: part.feature):
            family = families[part.name]
            if family.detected:
                spacing = part.sidebands(lines) or lines.speed
                combs.append(ForeignComb(family.fundamental, spacing, spectrum, _level(said, envelope.mean)))
    return combs


def _beside(said: Analysed, sent: Sequence[tuple[Analysed, ForeignComb]]) -> Analysed:
    features = said.features
    foreign = [
        comb for other, comb in sent if other.channel.listens_to != said.channel.listens_to and _comparable(said, other)
    ]
    combs = [
        [comb for comb in foreign if comb.is_louder(spectrum, _level(said, envelope.mean))]
        for spectrum, envelope in zip(features.sought, features.envelopes, strict=True)
    ]
    if not any(combs):
        return said
    absolute = said.channel.absolute
    return replace(
        said, features=features_beside(said.block.samples, features, combs, said.settings, absolute=absolute)
    )


def _comparable(said: Analysed, other: Analysed) -> bool:
    """Return whether the spectra of two channels have one axis: over time, or by the same angle."""
    if said.features.domain != other.features.domain:
        return False
    return said.features.domain == "hertz" or same_axis(said.settings.rotation, other.settings.rotation)


def _level(said: Analysed, mean: float) -> float | None:
    return float(mean) if said.channel.absolute else None
