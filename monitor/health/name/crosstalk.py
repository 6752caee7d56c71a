"""What the sensor of a bearing hears of the damage of its neighbours.

The channels of a source are analysed together. A comb is a neighbour's where it stands at a family of that neighbour's
bearing, on a channel that listens to it, above the baseline of that family, and with at least twice the power
(:mod:`monitor.health.signal.foreign`). The other channels then seek their families beside it, for onset and name
alike. So a comb is never discarded: it counts on the channel that shows it best. Spectra by the angles of different
shafts have no common axis: of those nothing is compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from models.machine.bearing import kinematics
from monitor.health import onset as detect
from monitor.health.channel import Analysed, detect_input, is_for_detector
from monitor.health.later_stages import ChannelBlock
from monitor.health.signal.features import features_beside
from monitor.health.signal.foreign import ForeignComb
from monitor.health.signal.orders import same_axis
from monitor.health.state import ChannelSettings, ChannelState
from monitor.words.parts import PARTS


@dataclass(frozen=True, eq=False)
class ChannelView:
    """A channel before a block, and its block."""

    state: ChannelState
    block: ChannelBlock
    settings: ChannelSettings


def beside_neighbours(
    views: Mapping[str, ChannelView], analysed: Mapping[str, Analysed | None]
) -> dict[str, Analysed | None]:
    """Return what the samples of each channel say beside the combs of other bearings."""
    found = dict(analysed)
    if len({view.settings.listens_to for view in views.values()}) < 2:
        return found
    sent = {name: _combs(views[name], said) for name, said in analysed.items() if said is not None}
    for name, said in analysed.items():
        if said is None:
            continue
        own = views[name].settings
        foreign = [
            comb
            for other, combs in sent.items()
            if views[other].settings.listens_to != own.listens_to and _comparable(said, analysed[other])
            for comb in combs
        ]
        if foreign:
            found[name] = _beside(views[name], said, foreign)
    return found


def _combs(view: ChannelView, said: Analysed) -> list[ForeignComb]:
    """Return the combs by which a channel shows its bearing damaged."""
    usable = is_for_detector(view.state, view.block.verdict, view.settings, said.band_source)
    features = said.features
    given = detect_input(features, view.block, absolute=view.settings.absolute, usable=usable)
    raised = detect.raised_lines(view.state.detect, given, view.settings.detect)
    if not raised or features.speed is None:
        return []
    lines = kinematics(view.settings.bearing, features.speed)
    combs: list[ForeignComb] = []
    for spectrum, families, envelope in zip(features.sought, features.families, features.envelopes, strict=True):
        for part in sorted((part for part in PARTS if part.feature in raised), key=lambda part: part.feature):
            family = families[part.name]
            if family.detected:
                spacing = part.sidebands(lines) or lines.speed
                combs.append(ForeignComb(family.fundamental, spacing, spectrum, _level(view, envelope.mean)))
    return combs


def _beside(view: ChannelView, said: Analysed, foreign: list[ForeignComb]) -> Analysed:
    features = said.features
    combs = [
        [comb for comb in foreign if comb.is_louder(spectrum, _level(view, envelope.mean))]
        for spectrum, envelope in zip(features.sought, features.envelopes, strict=True)
    ]
    if not any(combs):
        return said
    return replace(
        said,
        features=features_beside(view.block.samples, features, combs, said.settings, absolute=view.settings.absolute),
    )


def _comparable(said: Analysed, other: Analysed | None) -> bool:
    """Return whether the spectra of two channels have one axis: over time, or by the same angle."""
    if other is None or said.features.domain != other.features.domain:
        return False
    return said.features.domain == "hertz" or same_axis(said.settings.rotation, other.settings.rotation)


def _level(view: ChannelView, mean: float) -> float | None:
    return float(mean) if view.settings.absolute else None
