"""The bands of a recording that is too short to learn them from: chosen from the recording as a whole."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import kinematics
from monitor.health.signal.bands import BandVotes, find_band
from monitor.health.signal.features import fundamentals
from monitor.health.signal.interference import all_combs
from monitor.health.signal.rotation.shaft_angle import find_rotation
from monitor.health.signal.transform import Band
from monitor.health.state import ChannelSettings, SourceSettings
from streams.types.block import Block

_MOST_VOTES = 5
_Row = tuple[Block, NDArray[np.floating]]


def recording_bands(blocks: Sequence[Block], settings: SourceSettings) -> dict[str, Band]:
    """Return the band of each channel without configured ones, chosen from all finite blocks of a recording.

    A channel that no block has, or whose speed is not known, is left out.

    Raises:
        ValueError: no band fits a channel, which the message names.
    """
    found: dict[str, Band] = {}
    for channel in settings.channels.values():
        if channel.bands is not None:
            continue
        rows = [
            (block, block.samples[block.channels.index(channel.name)])
            for block in blocks
            if channel.name in block.channels
        ]
        usable = [(block, channel.acceleration_of(row, block.rate)) for block, row in rows if np.all(np.isfinite(row))]
        if not usable:
            continue
        try:
            band = _by_angle(usable, channel) or _by_time(usable, channel)
        except ValueError as error:
            raise ValueError(f'channel {channel.name!r}: band_hz = "auto": {error}') from None
        if band is not None:
            found[channel.name] = band
    return found


def _by_time(usable: Sequence[_Row], channel: ChannelSettings) -> Band | None:
    """Return the band of all blocks of one length at once, None where no speed is known."""
    block, first = usable[0]
    speed = block.speed if block.speed is not None else channel.condition.speed
    if speed is None:
        return None
    same = [row for _, row in usable if row.size == first.size]
    combs = all_combs(channel.interference, speed)
    lines = fundamentals(kinematics(channel.bearing, speed))
    return find_band(same, block.rate, lines, combs, limit=channel.band_limit)


def _by_angle(usable: Sequence[_Row], channel: ChannelSettings) -> Band | None:
    """Return the band for which most of a few blocks vote, each by its own angle; None where none has an angle."""
    votes = BandVotes()
    if channel.condition.domain == "hertz":
        return None
    for block, row in usable[:: math.ceil(len(usable) / _MOST_VOTES)]:
        rotation = find_rotation(block, channel.condition).rotation
        if rotation is not None:
            lines = fundamentals(kinematics(channel.bearing, rotation.mean_speed))
            combs = all_combs(channel.interference, rotation.mean_speed)
            votes = votes.add(row, block.rate, lines, combs, rotation, channel.band_limit)
    return votes.best() if votes.total else None
