"""The bands of a recording that is too short to learn them from: chosen from the recording as a whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.bearing import kinematics
from monitor.health.spectrum.bands import find_band
from monitor.health.spectrum.features import fundamentals
from monitor.health.spectrum.interference import all_combs
from monitor.health.spectrum.transform import Band
from monitor.health.state import SourceSettings
from streams.block import Block


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
        usable = [(block, row) for block, row in rows if np.all(np.isfinite(row))]
        if not usable:
            continue
        block = usable[0][0]
        speed = block.speed if block.speed is not None else channel.condition.speed
        if speed is None:
            continue
        same = [row for _, row in usable if row.size == usable[0][1].size]
        try:
            combs = all_combs(channel.interference, speed)
            found[channel.name] = find_band(same, block.rate, fundamentals(kinematics(channel.bearing, speed)), combs)
        except ValueError as error:
            raise ValueError(f'channel {channel.name!r}: band_hz = "auto": {error}') from None
    return found
