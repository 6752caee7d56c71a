"""Tests of a machine as its model would give them, small enough to be searched in seconds."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from models.identify.evaluate import Evaluator
from models.identify.limits import AdmissibleLimits
from models.identify.space import Space
from models.identify.trials import Condition, Trial, Trials, gather
from models.machine.bearing import from_catalogue
from models.machine.rig import Rig

BEARING = from_catalogue("1205 ETN9")
BAND = (0.0, 9500.0)
CONDITIONS = tuple(Condition(2000.0, 40.0, math.radians(extent), 5e-4) for extent in (2.362, 4.236, 6.366))
TRUTH = replace(Rig(), m_r=2.8)


def space_of(
    *free: str, rig: Rig = TRUTH, limits: AdmissibleLimits | None = None, loads: tuple[float, ...] = (2000.0,)
) -> Space:
    """Return a space around a rig."""
    return Space(rig, BEARING, loads, free=free, limits=limits or AdmissibleLimits())


@cache
def simulated_trials(noise: float, rig: Rig = TRUTH, seed: int = 3, repetitions: int = 1) -> Trials:
    """Return tests of a rig with relative noise."""
    space = space_of("m_r", rig=rig)
    level = Evaluator(space, CONDITIONS, BAND).levels([space.known])[0]
    rng = np.random.default_rng(seed)
    trials: list[Trial] = []
    for _ in range(repetitions):
        noisy = level.features * np.exp(noise * rng.standard_normal(level.features.shape))
        trials += [Trial(c, rms, a) for c, (rms, a) in zip(CONDITIONS, noisy.tolist(), strict=True)]
    return gather(trials)
