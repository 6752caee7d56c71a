"""Makers and checks that tests of stage share."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np

from monitor.health.gears.naming import MIN_LEARNED
from monitor.health.onset import DetectSettings
from monitor.health.record import Record
from monitor.health.signal.condition import ConditionSettings
from monitor.health.state import SourceSettings, SourceState, Stored
from monitor.health.step import step
from streams.types.block import Block
from tests.monitor.health.gears.signals import RATE, Meshing, pair
from tests.support.pipeline import base

GEARS = pair(19, 29)


DETECT = DetectSettings(learn_blocks=10, run_in_blocks=0, persist_blocks=3, close_blocks=5)


CHANNEL = base(
    gears=GEARS, detect=DETECT, bands=((2000.0, 5000.0),), condition=ConditionSettings(speed=30.0), average_blocks=1
)


SETTINGS = SourceSettings("s", {"one": CHANNEL})


HEALTHY = Meshing(duration=1.2)


FIRST_BAD = MIN_LEARNED + 3


def block(sequence: int, meshing: Meshing) -> Block:
    """Return one block in m/s2."""
    samples = meshing.of(GEARS, sequence)[0].astype(np.float32)[None]
    return Block(samples, RATE, ("one",), ("m/s2",), "s", sequence, f"b{sequence}", elapsed=10.0 * sequence)


@cache
def life() -> tuple[SourceState, tuple[Record, ...]]:
    """Return the state and the records of a machine whose wheel breaks a tooth; stored and read again in the middle."""
    state, records = SourceState.begin(SETTINGS), list[Record]()
    for sequence in range(1, FIRST_BAD + 4):
        broken = replace(HEALTHY, impact=("wheel", 3.0))
        state, output = step(state, block(sequence, broken if sequence >= FIRST_BAD else HEALTHY), SETTINGS)
        records.append(output.record)
        if sequence == FIRST_BAD:
            stored: Stored = json.loads(json.dumps(state.to_stored()))
            state = SourceState.begin(SETTINGS, stored)
    return state, tuple(records)
