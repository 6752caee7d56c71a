"""Lives without vibration: growth of damage, and V_eq as a tracker would have followed it. Thousands take a second.

The error of a tracked ln V_eq has a part that stays for the whole life (gain, depth of the defect), one that changes
slowly (the tracker's own memory) and one of each block. Its size differs from life to life: about 0.25 where the lines
of the outer race are used, 0.5 with the RMS alone (docs/evidence/forecasting.md).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.lives.laws import GrowthPath
from models.lives.life import draw_life
from models.lives.population import Population, Range

if TYPE_CHECKING:
    from numpy.typing import NDArray

_BEYOND = 1.35


@dataclass(frozen=True)
class TrackingError:
    """Errors of a tracked ln V_eq.

    Attributes:
        sd: range of the standard deviation of a life, drawn in the logarithm.
        constant, slow: shares of its square that stay for the life, and that change slowly; the rest is of each block.
        memory: blocks after which the slow part has lost all but 1 / e of its correlation.
    """

    sd: Range = (0.05, 0.6)
    constant: float = 0.65
    slow: float = 0.3
    memory: float = 25.0

    def draw(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Return the errors of a life of ``count`` blocks, shape (count,)."""
        sd = math.exp(rng.uniform(math.log(self.sd[0]), math.log(self.sd[1])))
        kept = math.exp(-1.0 / self.memory)
        steps = rng.standard_normal(count) * np.where(np.arange(count) > 0, math.sqrt(1.0 - kept * kept), 1.0)
        slow = np.empty(count)
        last = 0.0
        for k, step in enumerate(steps.tolist()):
            last = kept * last + step
            slow[k] = last
        block = rng.standard_normal(count)
        own = math.sqrt(1.0 - self.constant - self.slow)
        return sd * (math.sqrt(self.constant) * rng.standard_normal() + math.sqrt(self.slow) * slow + own * block)


GROWTH = Population(durations=(25 * 300.0, 400 * 300.0), v_0=(0.0003e-6, 0.01e-6), seed=1812)
"""Lives of 25 to 400 blocks for histories of V_eq alone; nothing of rig, load and speed enters them."""


@dataclass(frozen=True, eq=False)
class GrowthLife:
    """One life without vibration; n blocks, missing ones are absent.

    Attributes:
        t: time of each block since the onset, s, shape (n,).
        v_eq: true V_eq, m2, shape (n,).
        tracked: V_eq with the error of a tracker, m2, shape (n,).
        load, speed, rms, harmonics: not known, 1 throughout; shapes (n,), (n,), (n,), (n, 6).
    """

    number: int
    law: str
    t: NDArray[np.float64]
    v_eq: NDArray[np.float64]
    tracked: NDArray[np.float64]
    path: GrowthPath

    @property
    def load(self) -> NDArray[np.float64]:
        """Not known: 1."""
        return np.ones(self.t.size)

    speed = rms = load

    @property
    def harmonics(self) -> NDArray[np.float64]:
        """Not known: 1."""
        return np.ones((self.t.size, 6))

    def crossing(self, threshold: float) -> float:
        """Return when V_eq first reaches a threshold (m2), s since the onset; infinity if never."""
        return self.path.crossing(threshold)


def grow_life(population: Population, number: int, error: TrackingError | None = None) -> GrowthLife:
    """Return a life of a population without its vibration."""
    plan = draw_life(population, number)
    rng = np.random.default_rng([population.seed, number, 3])
    end = min(_BEYOND * plan.path.crossing(population.until), float(plan.path.t[-1]))
    count = int(end // population.interval) + 1
    errors = (error or TrackingError()).draw(rng, count)
    there = np.flatnonzero(rng.uniform(size=count) >= population.missing)
    t = np.asarray(population.interval * there, dtype=np.float64)
    v_eq = plan.path.at(t)
    return GrowthLife(number, plan.law, t, v_eq, v_eq * np.exp(errors[there]), plan.path)


def grow_lives(
    population: Population, numbers: Sequence[int], error: TrackingError | None = None
) -> Iterator[GrowthLife]:
    """Yield lives of a population without their vibration, in the order of their numbers as given."""
    # One rig for all: drawing rigs that play no part takes longer than the growth.
    plain = replace(population, rig_spread=())
    return (grow_life(plain, number, error) for number in numbers)
