"""Makers and checks that tests of learned share."""

from __future__ import annotations

import math

import numpy as np

from monitor.health.rest.learned.fit import LearnedRun


def run(life: float, end: float = 1.5, seed: int = 0, blocks: int = 60) -> LearnedRun:
    """Return a run whose level rises to ``end`` faster and faster, with some noise."""
    t = np.linspace(0.0, life, blocks + 1)
    noise = 0.03 * np.random.default_rng(seed).standard_normal(t.size)
    return LearnedRun(f"run {seed}", t, 0.2 + (end - 0.2) * (t / life) ** 2 + noise, 0.0, life)


def family(count: int, spread: float = 0.3) -> list[LearnedRun]:
    rng = np.random.default_rng(count)
    return [run(3600.0 * math.exp(spread * rng.standard_normal()), seed=i) for i in range(count)]
