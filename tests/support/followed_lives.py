"""Blocks of lives in closed form, and what the library forecaster answers to them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

from monitor.health.size import Damage, DamageInput, Remaining
from monitor.health.size.library.forecaster import LibrarySettings, LibraryState, step
from monitor.health.size.library.model import Library
from reference.lives import block_of
from tests.oracles.toy_lives import THRESHOLD


def blocks_of(life: Any) -> list[DamageInput]:
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
