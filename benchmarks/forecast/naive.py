"""The naive forecasts of ``monitor.report.score.baselines`` on the cases of ``benchmarks.forecast.methods``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from benchmarks.forecast.cases import LEVELS, Answers, Cases, Floats, cases_of, no_volume, only_time
from benchmarks.forecast.population import THRESHOLD
from models.lives.life import LifeHistory
from monitor.report.score import baselines


def constant(cases: Cases, library: Sequence[LifeHistory]) -> Answers:
    """Return the constant guess, which stands in for missing answers.

    The median life of the library less the time gone, and the median V_eq of its lives over all moments: which of them
    it is, nobody is told.
    """
    v_eq = np.full(cases.t.shape, np.median(cases_of(library).v_eq))
    _, lower, upper = no_volume(cases.t.shape)
    return Answers(v_eq, lower, upper, baselines.constant(cases.t, lifetimes(library))[..., None])


def lifetimes(library: Sequence[LifeHistory]) -> Floats:
    """Return how long lives took from the onset to the threshold, s."""
    times = np.array([life.crossing(THRESHOLD) for life in library])
    return times[np.isfinite(times)]


def of_elapsed_time(cases: Cases, library: Sequence[LifeHistory]) -> Mapping[str, Answers]:
    """Return the forecasts that know of nothing but the time gone and other lives."""
    others = lifetimes(library)
    methods: dict[str, Callable[[float], baselines.Sample]] = {
        "climatology": lambda elapsed: baselines.climatology(elapsed, others),
        "elapsed time alone": lambda elapsed: baselines.elapsed_alone(elapsed, others),
    }
    moments = cases.t.ravel().tolist()
    return {
        name: only_time(np.array([method(t).quantiles(LEVELS) for t in moments]).reshape(*cases.t.shape, -1))
        for name, method in methods.items()
    }


def of_true_volume(cases: Cases) -> Answers:
    """Return the forecast of the thesis on the true V_eq: what its quadratic alone costs."""
    tt = np.empty(cases.t.shape)
    for r, life in enumerate(cases.runs):
        known = int(cases.blocks[r, -1])
        tt[r] = baselines.thesis(life.t[:known], life.v_eq[:known], THRESHOLD)[cases.blocks[r] - 1]
    return only_time(tt)


def of_tracked_volume(cases: Cases, histories: Sequence[Floats]) -> Mapping[str, Answers]:
    """Return extrapolations of the V_eq that was tracked up to each moment.

    Args:
        cases: the cases.
        histories: tracked V_eq of each run, at least as many blocks as the last moment knows, m2.
    """
    found = {name: np.empty(cases.t.shape) for name in ("linear", "exponential")}
    for r, (life, v_eq) in enumerate(zip(cases.runs, histories, strict=True)):
        t = life.t[: v_eq.size]
        last = cases.blocks[r] - 1
        found["linear"][r] = baselines.linear(t, v_eq, THRESHOLD)[last]
        found["exponential"][r] = baselines.exponential(t, v_eq, THRESHOLD)[last]
    return {name: only_time(tt) for name, tt in found.items()}
