"""Fit of a :class:`LearnedModel` on recorded runs.

Moments are spread evenly over the middle four fifths of each run's final stage: towards its ends ln(TT / elapsed) goes
to plus and minus infinity, and few blocks would decide the scale. Moments of one run share one life, so each run counts
once. A ridge regression without intercept is drawn towards "as long again as it has lasted"; the scale of its errors is
that of runs left out of the fit, with one further run of that prior. The constants were chosen on simulated runs, but
for ``MARGIN_SHARE`` (``benchmarks/learned/runs.py``, docs/evidence/learned.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from monitor.health.rest.learned.history import INPUTS, Array, StageHistory
from monitor.health.rest.learned.model import EndLevels, LearnedModel

RIDGE = (6.0, 3.0, 3.0, 3.0, 3.0)
"""Prior weight of no effect, by input, in runs with a spread of one."""
PRIOR_RUNS = 1.0
"""Prior weight of the scale 1, in runs."""
MOMENTS = 24
MARGIN_SHARE = 0.1
"""Share of a final stage at either end without moments."""
MIN_BLOCKS = 8
MIN_POINTS = 3
_SCALES = np.exp(np.linspace(math.log(0.1), math.log(2.5), 130))
_LOGISTIC = np.log((np.arange(200) + 0.5) / (199.5 - np.arange(200)))
_END_BLOCKS = 5


@dataclass(frozen=True, eq=False)
class LearnedRun:
    """The final stage of a recorded run of n blocks, up to its end.

    Attributes:
        name: for people.
        t: damage time since t_fs, s, shape (n,), from 0 on.
        ln_rms: in any unit, shape (n,).
        ln_baseline: of the healthy machine in that unit, NaN where it is not known.
        life: time from t_fs to the end, s.
        t_fs: on the axis of the run, s.
        end_volume: V_eq at the end, m2, NaN where there is none.
        source: where it came from, as plain values for JSON.
    """

    name: str
    t: Array
    ln_rms: Array
    ln_baseline: float
    life: float
    t_fs: float = math.nan
    end_volume: float = math.nan
    source: Mapping[str, Any] | None = None

    @property
    def end_level(self) -> float:
        """Median of ln(RMS / baseline) over the last blocks."""
        return float(np.median(self.ln_rms[-_END_BLOCKS:])) - self.ln_baseline


@dataclass(frozen=True, eq=False)
class RunMoments:
    """Moments of a run: inputs (m, d), elapsed time and TT (m,), s."""

    inputs: Array
    elapsed: Array
    left: Array

    @property
    def targets(self) -> Array:
        """ln(TT / elapsed), shape (m,)."""
        return np.log(self.left / self.elapsed)


def moments_of(run: LearnedRun, shares: Sequence[float]) -> RunMoments:
    """Return the moments of a run at shares of its life; those with fewer than ``MIN_POINTS`` blocks are left out."""
    last = (np.searchsorted(run.t, np.asarray(shares) * run.life * (1.0 + 1e-12), side="right") - 1).tolist()
    wanted = set(last)
    inputs: dict[int, Array] = {}
    history = StageHistory.begin(0.0)
    for place in range(max(wanted, default=-1) + 1):
        history = history.add(float(run.t[place]), float(run.ln_rms[place]))
        if place in wanted and history.count >= MIN_POINTS and 0.0 < history.elapsed < run.life:
            inputs[place] = history.inputs(run.ln_baseline)
    used = [place for place in last if place in inputs]
    elapsed = run.t[used]
    rows = [inputs[place] for place in used]
    return RunMoments(np.array(rows).reshape(-1, len(INPUTS)), elapsed, run.life - elapsed)


def training_shares() -> Array:
    """Return the shares of a life at which the regression is fitted."""
    return MARGIN_SHARE + (1.0 - 2.0 * MARGIN_SHARE) * (np.arange(MOMENTS) + 0.5) / MOMENTS


def fit_runs(runs: Sequence[LearnedRun]) -> LearnedModel:
    """Fit the regression on runs; without any it is the prior.

    Runs with fewer than ``MIN_BLOCKS`` blocks or without a moment are left out, which the model says.
    """
    found = [(run, moments_of(run, training_shares().tolist())) for run in runs]
    used = [(run, moments) for run, moments in found if len(run.t) >= MIN_BLOCKS and len(moments.elapsed)]
    kept = {id(run) for run, _ in used}
    left_out = tuple(
        {"run": run.name, "reason": f"{len(run.t)} blocks in its final stage, at least {MIN_BLOCKS} needed"}
        for run in runs
        if id(run) not in kept
    )
    return replace(
        fit_moments([moments for _, moments in used]),
        runs=tuple(_described(run) for run, _ in used),
        left_out=left_out,
        end_levels=end_levels([run.end_level for run, _ in used]),
        end_volumes=end_levels([math.log(run.end_volume) for run, _ in used if run.end_volume > 0.0]),
        settings=_settings(),
    )


def fit_moments(runs: Sequence[RunMoments]) -> LearnedModel:
    """Return the regression and its scale for moments of runs, each with at least one."""
    return replace(_regression(runs), scale=_scale(runs))


def end_levels(values: Sequence[float]) -> EndLevels:
    """Return the distribution of levels at the end; those that are not known are left out."""
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return EndLevels()
    sd = float(np.std(known, ddof=1)) if len(known) > 1 else math.nan
    return EndLevels(len(known), float(np.mean(known)), sd)


def _described(run: LearnedRun) -> dict[str, Any]:
    values = {
        "t_fs_s": run.t_fs,
        "life_s": run.life,
        "end_level": math.exp(run.end_level),
        "end_v_eq_mm2": run.end_volume * 1e6,
    }
    known = {name: value if math.isfinite(value) else None for name, value in values.items()}
    return {"run": run.name, "blocks": len(run.t), **known, **(run.source or {})}


def _settings() -> dict[str, Any]:
    return {
        "ridge": list(RIDGE),
        "prior_runs": PRIOR_RUNS,
        "moments": MOMENTS,
        "margin_share": MARGIN_SHARE,
        "min_blocks": MIN_BLOCKS,
        "min_points": MIN_POINTS,
    }


def _regression(runs: Sequence[RunMoments]) -> LearnedModel:
    """Return the regression on moments of runs, its scale 1; with none, the prior."""
    if not runs:
        return LearnedModel()
    centre = _nan_mean(np.array([_nan_mean(run.inputs) for run in runs]))
    coefficients, covariance = _solve(runs, centre)
    rows = np.concatenate([run.inputs for run in runs])
    known = np.isfinite(rows).any(axis=0)
    lowest = np.where(known, np.nanmin(np.where(np.isfinite(rows), rows, np.inf), axis=0), -np.inf)
    highest = np.where(known, np.nanmax(np.where(np.isfinite(rows), rows, -np.inf), axis=0), np.inf)
    return LearnedModel(
        centre, lowest, highest, coefficients, covariance, runs=tuple({"blocks": len(run.elapsed)} for run in runs)
    )


def _solve(runs: Sequence[RunMoments], centre: Array) -> tuple[Array, Array]:
    """Return the coefficients of the ridge regression, each run counted once, and their covariance."""
    precision, right = np.diag(RIDGE), np.zeros(len(RIDGE))
    for run in runs:
        x = run.inputs - centre
        x = np.where(np.isfinite(x), x, 0.0)
        precision += x.T @ x / len(x)
        right += x.T @ run.targets / len(x)
    covariance = np.linalg.inv(precision)
    return covariance @ right, covariance


def _scale(runs: Sequence[RunMoments]) -> float:
    """Return the most likely scale of the errors of runs left out, and of ``PRIOR_RUNS`` runs of the prior."""
    errors, weights = [_LOGISTIC], [np.full(_LOGISTIC.size, PRIOR_RUNS / _LOGISTIC.size)]
    for place in range(len(runs) if len(runs) > 1 else 0):
        others = _regression([run for other, run in enumerate(runs) if other != place])
        held = runs[place]
        found = [others.distribution(x, 1.0) for x in held.inputs]
        errors.append(np.array([(u - one.centre) / one.scale for u, one in zip(held.targets, found, strict=True)]))
        weights.append(np.full(len(held.elapsed), 1.0 / len(held.elapsed)))
    size = np.abs(np.concatenate(errors)) / _SCALES[:, None]
    loss = (size + 2.0 * np.log1p(np.exp(-size)) + np.log(_SCALES)[:, None]) @ np.concatenate(weights)
    return float(_SCALES[np.argmin(loss)])


def _nan_mean(rows: Array) -> Array:
    """Return the mean of each column over its known values, 0 where there are none."""
    known = np.isfinite(rows)
    return np.where(known, rows, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
