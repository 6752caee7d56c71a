"""Makers and checks that tests of pulse frames share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from streams.turns.pulses import Pulses
from streams.types.block import Block
from tests.streams.tcp_peers import block


def turning(sequence: int, count: int = 8, per_revolution: int | None = 4) -> Block:
    """A block whose shaft has passed so many marks."""
    times = np.sort(np.random.default_rng(sequence).uniform(0.0, 0.64, count))
    return replace(block(sequence), pulses=Pulses(times, per_revolution))
