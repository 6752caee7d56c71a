"""Lives of bearings that need no bearing model: the levels follow from depth and extent in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from monitor.health.size.library.fit import FitSettings, fit_library
from monitor.health.size.library.model import Library
from reference.once import made_once
from tests.support.effort import effort_count

THRESHOLD = 5e-8
RADIUS = 22.91e-3
INTERVAL = 300.0
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ToyLife:
    """A life as the library takes it; the names are those of a simulated life."""

    number: int
    law: str
    t: Array
    load: Array
    speed: Array
    rms: Array
    harmonics: Array
    v_eq: Array

    def crossing(self, threshold: float) -> float:
        """Time at which V_eq reaches the threshold, s; inf where it never does."""
        above = np.flatnonzero(self.v_eq >= threshold)
        if not len(above):
            return math.inf
        last = int(above[0])
        if last == 0:
            return 0.0
        low, high = self.v_eq[last - 1], self.v_eq[last]
        share = float((threshold - low) / (high - low))
        return float(self.t[last - 1] + share * (self.t[last] - self.t[last - 1]))


def toy_life(
    number: int, *, seed: int = 0, interval: float = INTERVAL, noise: float = 0.05, varying: bool = False
) -> ToyLife:
    """Life ``number``: ln rms = .1 ln dphi + .55 ln h, ln h1 = .42 ln dphi + .72 ln h, and conditions."""
    draw = np.random.default_rng([seed, number])
    law = ("power", "exponential", "jump")[number % 3]
    last = interval * math.exp(draw.uniform(math.log(25.0), math.log(110.0)))
    t = np.arange(0.0, 1.35 * last, interval)
    share = t / last
    begin = 0.05 * math.exp(0.3 * draw.normal())
    if law == "power":
        v = begin + (1.0 - begin) * share ** draw.uniform(1.2, 4.0)
    elif law == "exponential":
        v = begin ** (1.0 - share)
    else:
        stall = draw.uniform(0.3, 0.8)
        v = np.where(
            share < stall,
            begin * (1.0 + share),
            begin * (1.0 + stall) * (1.0 / (begin * (1.0 + stall))) ** ((share - stall) / (1.0 - stall)),
        )
    depth_share, depth = draw.uniform(0.2, 0.7), draw.uniform(4e-6, 20e-6)
    h = depth * v**depth_share
    dphi = THRESHOLD * v / (RADIUS * h)
    load = np.full(len(t), draw.uniform(3000.0, 5000.0))
    speed = np.full(len(t), draw.uniform(20.0, 45.0))
    if varying:
        load, speed = draw.uniform(3000.0, 5000.0, len(t)), draw.uniform(20.0, 45.0, len(t))
    level = 0.3 * np.log(load / 4000.0) + 1.2 * np.log(speed / 40.0)
    ln_dphi, ln_h = np.log(dphi / 0.3), np.log(h / 1e-5)
    rms = np.exp(2.0 + level + 0.1 * ln_dphi + 0.55 * ln_h + noise * draw.normal(size=len(t)) + 0.1 * draw.normal())
    powers = np.array([[0.42, 0.72], [0.19, 0.88], [0.1, 0.8], [0.1, 0.7], [0.0, 0.7], [0.0, 0.6]])
    ln_lines = level[:, None] + ln_dphi[:, None] * powers[:, 0] + ln_h[:, None] * powers[:, 1]
    gains = 0.1 * draw.normal(size=6)
    lines = np.exp(ln_lines + gains + noise * draw.normal(size=ln_lines.shape))
    return ToyLife(number, law, t, load, speed, rms, lines, THRESHOLD * v)


def standing_life(number: int, *, seed: int = 0, blocks: int = 150) -> ToyLife:
    """Life ``number`` up to a block between 15 and 60 at which V_eq stands still: its levels stay, with their noise."""
    whole = toy_life(number, seed=seed)
    draw = np.random.default_rng([seed, number, 1])
    last = min(int(draw.integers(15, 60)), int(np.flatnonzero(whole.v_eq < 0.8 * THRESHOLD)[-1]))
    at = np.minimum(np.arange(blocks), last)

    def held(levels: Array) -> Array:
        noise = np.where(np.arange(blocks) > last, 0.05 * draw.normal(size=(*levels.shape[1:], blocks)), 0.0).T
        return levels[at] * np.exp(noise)

    return replace(
        whole,
        law="standstill",
        t=INTERVAL * np.arange(blocks),
        load=whole.load[at],
        speed=whole.speed[at],
        rms=held(whole.rms),
        harmonics=held(whole.harmonics),
        v_eq=whole.v_eq[at],
    )


def toy_lives(count: int, *, seed: int = 0, interval: float = INTERVAL, varying: bool = False) -> list[ToyLife]:
    """Return lives 0 to ``count - 1``."""
    return [toy_life(number, seed=seed, interval=interval, varying=varying) for number in range(count)]


@cache
def standing_library() -> Library:
    """Return a library of 80 growing and 30 standing lives, of RMS and lines."""

    def fit() -> Library:
        lives = [*toy_lives(80), *(standing_life(number, seed=7) for number in range(30))]
        return fit_library(
            lives,
            thresholds=[THRESHOLD],
            interval=INTERVAL,
            prior="toy lives",
            made_of={},
            settings=FitSettings(columns=60, moments=12),
            features=("rms+harmonics",),
        )

    return made_once("toy-standing", fit)


@cache
def toy_library(count: int = 150, *, interval: float = INTERVAL, varying: bool = False) -> Library:
    """Return a library of so many lives, for two thresholds; it is fitted once a run, as it takes seconds."""

    def fit() -> Library:
        return fit_library(
            toy_lives(count, interval=interval, varying=varying),
            thresholds=[0.6 * THRESHOLD, THRESHOLD],
            interval=interval,
            prior="toy lives",
            made_of={"lives": "in closed form"},
            settings=FitSettings(columns=effort_count(quick=60, full=100), moments=12),
        )

    return made_once(f"toy-{count}-{interval:g}-{varying}", fit)
