"""Histories of a level and the moments at which the time to an alarm level is asked: recorded runs and simulated ones.

A case is a history up to a moment, a level, and how long it took until RMS first stood at or above the level for three
blocks in a row. Where it never does, the time left is that to the end of the record, and the case is ``open``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.onset_windows import WINDOWS, inputs_of
from monitor.health import onset as detect
from monitor.health.alarms import AlarmSettings, Level, Rule
from monitor.health.rest.trend import TimeToAlarm, TrendInput, TrendState, step

Floats = NDArray[np.float64]

SHARES = (0.25, 0.5, 0.75)
UNIFORM = 5
"""Moments drawn uniformly between onset and crossing, beside those at ``SHARES``."""
DRAWN_SEED = 1823
MIN_BLOCKS = 6


@dataclass(frozen=True, eq=False)
class History:
    """Levels since the onset.

    Attributes:
        run: what is left out together.
        time: s since the onset, shape (n,).
        level: ln RMS over the baseline, shape (n,).
        known: index of the block with which the onset became known.
        noise: robust standard deviation of ln RMS of the baseline.
        kind: recorded, or the family of a simulated one.
    """

    run: str
    time: Floats
    level: Floats
    known: int
    noise: float
    kind: str = "recorded"

    def crossing(self, factor: float) -> int | None:
        """Return the block that completes the first three in a row at or above a multiple of the baseline."""
        above = self.level >= math.log(factor)
        held = above[2:] & above[1:-1] & above[:-2]
        found = np.flatnonzero(held)
        return int(found[0]) + 2 if found.size else None

    @cached_property
    def states(self) -> list[TrendState]:
        """States of the stage after each block."""
        state, found = TrendState(), list[TrendState]()
        for i, (time, level) in enumerate(zip(self.time.tolist(), self.level.tolist(), strict=True)):
            # Without a level the stage keeps the history and answers nothing.
            block = TrendInput(i + 1, time, math.exp(level), elevated=True)
            state, _ = step(state, block, AlarmSettings())
            found.append(state)
        return found

    def answer(self, place: int, factor: float) -> TimeToAlarm:
        """Return what the stage says with a block."""
        before = self.states[place - 1]
        rules = AlarmSettings((Rule("level", "rms", alert=Level(factor=factor)),))
        block = TrendInput(
            place + 1,
            float(self.time[place]),
            math.exp(float(self.level[place])),
            baseline=(0.0, self.noise),
            elevated=True,
            final=True,
        )
        return step(before, block, rules)[1]


@dataclass(frozen=True, eq=False)
class Case:
    """One question.

    Attributes:
        place: index of the latest block that is known.
        left: s to the crossing, or to the end of the record where it is ``open``.
        life: s from the onset to the crossing or the end.
        share: "1/4", "1/2", "3/4" or "uniform".
    """

    history: History
    factor: float
    place: int
    left: float
    life: float
    share: str
    open: bool

    @property
    def elapsed(self) -> float:
        """Seconds since the onset."""
        return float(self.history.time[self.place])

    @property
    def time(self) -> Floats:
        """Times that are known."""
        return self.history.time[: self.place + 1]

    @property
    def level(self) -> Floats:
        """Levels that are known."""
        return self.history.level[: self.place + 1]


def recorded(folder: Path) -> list[History]:
    """Return both axes of the eleven recorded runs whose final stage is open at the end, as the detector dates it."""
    found: list[History] = []
    for window in WINDOWS:
        inputs = inputs_of(folder, window)
        state = detect.DetectState()
        for block in inputs:
            state, _ = detect.step(state, block, detect.DetectSettings())
        if state.t_fs is None or state.t_fs_known is None or state.baseline is None:
            continue
        first = state.t_fs.sequence - 1
        time = np.array([block.time or 0.0 for block in inputs[first:]])
        level = np.log([block.rms for block in inputs[first:]]) - state.baseline.ln_rms
        known = state.t_fs_known.sequence - 1 - first
        found.append(History(window.run, time - time[0], level, known, state.baseline.ln_rms_sd))
    return found


def cases_of(histories: Sequence[History], factors: Sequence[float] = (2.0, 3.0, 4.0)) -> list[Case]:
    """Return the questions: at shares of the time from the onset to the crossing, and at moments drawn uniformly."""
    rng = np.random.default_rng(DRAWN_SEED)
    return [case for history in histories for factor in factors for case in _of_one(history, factor, rng)]


def _of_one(history: History, factor: float, rng: np.random.Generator) -> Iterator[Case]:
    crossing = history.crossing(factor)
    end = len(history.time) - 1 if crossing is None else crossing
    life = float(history.time[end])
    names = {"1/4": 0.25, "1/2": 0.5, "3/4": 0.75}
    asked = [*names.items(), *(("uniform", share) for share in rng.uniform(size=UNIFORM).tolist())]
    for name, share in asked:
        place = int(np.searchsorted(history.time, share * life))
        if max(history.known, MIN_BLOCKS - 1) <= place < end:
            yield Case(history, factor, place, life - float(history.time[place]), life, name, crossing is None)


FAMILIES = ("power", "random monotone", "late", "steps", "stalls")


def simulated(family: str, count: int, seed: int) -> list[History]:
    """Return histories of one family: ln RMS in 100 to 600 blocks, with noise that is partly correlated, and spikes.

    ``power``: powers of the time from 0.7 to 4; ``random monotone``: 3 to 13 knots with gamma increments; ``late``:
    slow for 40 to 85 % of the record, then fast; ``steps``: one to four at any time; ``stalls``: growth that stops for
    good below twice the baseline.
    """
    rng = np.random.default_rng(seed)
    found: list[History] = []
    for number in range(count):
        blocks = int(rng.integers(100, 600))
        u = np.linspace(0.0, 1.0, blocks)
        first, end = rng.uniform(0.1, 0.5), rng.uniform(1.2, 2.5)
        if family == "power":
            shape = u ** rng.uniform(0.7, 4.0)
        elif family == "random monotone":
            knots = int(rng.integers(3, 14))
            heights = np.cumsum(np.concatenate(((0.0,), rng.gamma(0.7, size=knots))))
            shape = np.interp(u, np.linspace(0.0, 1.0, knots + 1), heights / heights[-1])
        elif family == "late":
            start = rng.uniform(0.4, 0.85)
            shape = 0.15 * u + 0.85 * np.maximum(u - start, 0.0) ** rng.uniform(1.0, 2.5)
            shape = shape / shape[-1]
        elif family == "steps":
            moments, heights = rng.uniform(size=int(rng.integers(1, 5))), rng.dirichlet(np.ones(4))
            shape = sum((height * (u >= at) for at, height in zip(moments, heights, strict=False)), 0.0 * u)
        else:
            end, shape = rng.uniform(0.4, 0.6), np.minimum(u / rng.uniform(0.1, 0.4), 1.0)
            first = min(first, 0.3)
        noise = rng.uniform(0.02, 0.06)
        level = first + (end - first) * shape + noise * rng.standard_normal(blocks) + _drift(rng, blocks, noise)
        level[rng.uniform(size=blocks) < 0.01] += rng.uniform(0.3, 1.5)
        time = 60.0 * np.arange(blocks, dtype=np.float64)
        found.append(History(f"{family} {number}", time, level, 5, noise * math.sqrt(2.0), family))
    return found


def _drift(rng: np.random.Generator, blocks: int, sd: float) -> Floats:
    """Return an autoregression of the first order with a memory of twenty blocks."""
    kept = math.exp(-1.0 / 20.0)
    pushes = sd * math.sqrt(1.0 - kept**2) * rng.standard_normal(blocks)
    found, value = np.empty(blocks), 0.0
    for i, push in enumerate(pushes.tolist()):
        value = kept * value + push
        found[i] = value
    return found
