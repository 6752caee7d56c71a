"""Makers and checks that tests of naming share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from monitor.health.gears.indicators import GearIndicators
from monitor.health.gears.naming import (
    GearNamingSettings,
    GearsInput,
    WheelReading,
)
from tests.monitor.health.gears.signals import pair

PAIR = pair()


RULES = GearNamingSettings(persist_blocks=3, close_blocks=10)


HEALTHY = GearIndicators(4.0, 3.0, 15.0, 0.1, 1.0, 2.0, 0.01, 3.0)


def reading(rng: np.random.Generator, sd: float, **factors: float) -> WheelReading:
    """Return a reading whose values scatter, some of them times a factor."""
    scatter = {name: getattr(HEALTHY, name) * math.exp(sd * rng.normal()) for name in GearIndicators.__annotations__}
    return WheelReading("ok", GearIndicators(**{k: v * factors.get(k, 1.0) for k, v in scatter.items()}), 100)


def blocks(seed: int, sd: float = 0.05, **wheels: Mapping[str, float]) -> Iterator[GearsInput]:
    """Yield blocks without end, values of wheels with a scatter (ln) and times their factors."""
    rng = np.random.default_rng(seed)
    sequence = 0
    while True:
        sequence += 1
        yield GearsInput(
            sequence, {name: reading(rng, sd, **wheels.get(name, {})) for name in ("pinion", "wheel")}, 30.0, 100.0
        )
