"""Blocks of lives in closed form, and what the library forecaster answers to them."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from monitor.health.size import Damage, DamageInput, Remaining
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.model import Library
from tests.oracles.toy_lives import THRESHOLD


class Life(Protocol):
    """What of a life goes into its blocks: arrays of a value a block."""

    @property
    def t(self) -> NDArray[np.float64]: ...
    @property
    def rms(self) -> NDArray[np.float64]: ...
    @property
    def harmonics(self) -> NDArray[np.float64]: ...
    @property
    def load(self) -> NDArray[np.float64]: ...
    @property
    def speed(self) -> NDArray[np.float64]: ...
    @property
    def v_eq(self) -> NDArray[np.float64]: ...


def block_of(life: Life, k: int) -> DamageInput:
    """Return what one block of a life says; its true V_eq stands for a tracked one."""
    return DamageInput(
        time=float(life.t[k]),
        rms=float(life.rms[k]),
        harmonics=tuple(life.harmonics[k].tolist()),
        load=float(life.load[k]),
        speed=float(life.speed[k]),
        v_eq=float(life.v_eq[k]),
    )


def blocks_of(life: Life) -> list[DamageInput]:
    return [block_of(life, k) for k in range(len(life.t))]


class Answer(NamedTuple):
    damage: Damage
    forecasts: tuple[Remaining, ...]


def follow(
    blocks: list[DamageInput],
    known: Library,
    settings: LibrarySettings | None = None,
    asked: Collection[int] | None = None,
) -> tuple[LibraryState, list[Answer]]:
    """Return the last state and the answers; only the blocks ``asked`` for have a forecast, by default all."""
    state, results = LibraryState(), []
    for i, block in enumerate(blocks):
        thresholds = [THRESHOLD] if asked is None or i in asked else []
        state, damage, forecasts = step(state, block, known, settings, thresholds=thresholds)
        results.append(Answer(damage, forecasts))
    return state, results
