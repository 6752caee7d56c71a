"""Score forecasts as issued, beside naive ones issued at the same times with the same past.

Each run is scored by itself; means are over runs, never over the blocks of one run. All forecasts from the detection of
the final stage to the end are scored; forecasts after the end are not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.report.score import baselines, metrics
from monitor.report.score.forecasts import Issued

Floats = NDArray[np.float64]

ALPHA, LAMBDA, BETA = 0.2, 0.5, 0.5
"""As in Saxena et al. 2010: within 20 %, half-way, with half of the probability."""
_LEVELS = np.array([0.1, 0.25, 0.5, 0.75, 0.9])
_MEAN_OF = (
    "cra",
    "alpha_lambda",
    "prognostic_horizon_s",
    "convergence_s",
    "crps_s",
    "crps_share",
    "coverage",
    "width_s",
    "answered",
    "onset_delay_s",
    "false_alarms_per_1000_blocks",
)


@dataclass(frozen=True)
class End:
    """End of a run: its damage time ``clock``, s, NaN if unknown.

    Attributes:
        source: "given"; "truth" of a simulated rig; "tracked", where the tracked V_eq reached the threshold, so that a
            forecast is judged by its own input; "none".
    """

    clock: float
    source: str


def end_of(issued: Issued, given: float | None, *, tracked: bool = False) -> End:
    """Return the end of a run; ``given`` is on the time axis of the records, ``tracked`` allows a source "tracked"."""
    if given is not None:
        return End(issued.to_clock(given), "given")
    if math.isfinite(issued.end_true):
        return End(issued.end_true, "truth")
    if tracked:
        reached = np.flatnonzero(issued.v_eq >= issued.threshold)
        if reached.size:
            return End(_crossing(issued, int(reached[0])), "tracked")
    return End(math.nan, "none")


def _crossing(issued: Issued, place: int) -> float:
    """Return the damage time at which V_eq reached the threshold, by linear interpolation."""
    known = np.flatnonzero(np.isfinite(issued.v_eq[:place]))
    if not known.size:
        return float(issued.clock[place])
    before = int(known[-1])
    share = (issued.threshold - issued.v_eq[before]) / (issued.v_eq[place] - issued.v_eq[before])
    return float(issued.clock[before] + share * (issued.clock[place] - issued.clock[before]))


def score_run(
    issued: Issued, end: End, *, lifetimes: Sequence[float] = (), onset: float | None = None
) -> dict[str, Any]:
    """Score one channel of one run; return the keys of ``spallwatch score``, None where a figure is not defined.

    Args:
        issued: its forecasts.
        end: of the run.
        lifetimes: final stages of other bearings, s, for the baselines that need them; without this run's own.
        onset: true onset on the time axis of the records; None for that of a simulated rig.
    """
    before = issued.clock < end.clock
    clock = issued.clock[before]
    quantiles = issued.quantiles[before]
    guess = baselines.constant(clock - issued.onset, lifetimes) if lifetimes and clock.size else None
    scored = {
        "records": issued.records,
        "machine": issued.machine,
        "channel": issued.channel,
        "threshold_mm2": round(issued.threshold * 1e6, 12),
        "method": issued.method or None,
        "interval": issued.interval,
        "issued_in": issued.source,
        "end_source": end.source,
        "end_utc_s" if issued.dated else "end_s": finite_or_none(issued.to_time(end.clock)) if before.size else None,
        "lifetime_s": finite_or_none(end.clock - issued.onset),
        "forecasts": int(before.sum()),
        "missing": "left_out" if guess is None else "constant",
        **_figures(clock, end.clock, issued.levels, quantiles, issued.interval, guess),
        **_damage(issued, before),
        **_onset(issued, issued.damaged if onset is None else onset),
    }
    others = _baselines(issued, before, lifetimes)
    scored["baselines"] = {
        name: _figures(clock, end.clock, levels, rows, issued.interval or float(levels[-1] - levels[0]), guess)
        for name, (levels, rows) in others.items()
    }
    for figures in (scored, *scored["baselines"].values()):
        figures["crps_share"] = _ratio(figures["crps_s"], scored["lifetime_s"])
    if guess is not None:
        scored["crps_over_climatology"] = _ratio(scored["crps_s"], scored["baselines"]["climatology"]["crps_s"])
    return scored


def _figures(
    clock: Floats, end: float, levels: Floats, quantiles: Floats, interval: float | None, guess: Floats | None
) -> dict[str, Any]:
    """Return the figures of one method; ``guess`` replaces missing answers, None leaves them out."""
    answered = np.asarray(np.isfinite(quantiles).all(axis=1))
    if guess is not None:
        quantiles = np.where(answered[:, np.newaxis], quantiles, guess[:, np.newaxis])
    true = end - clock
    middle = _at(levels, quantiles, 0.5)
    verdict = metrics.alpha_lambda(clock, end, levels, quantiles, alpha=ALPHA, lam=LAMBDA, beta=BETA)
    crps = metrics.crps_from_quantiles(levels, quantiles, true)
    figures: dict[str, Any] = {
        "answered": float(answered.mean()) if answered.size else math.nan,
        "cra": metrics.cumulative_relative_accuracy(middle, true),
        "alpha_lambda_mass": verdict.mass if verdict.passed is not None else math.nan,
        "prognostic_horizon_s": metrics.prognostic_horizon(clock, end, levels, quantiles, alpha=ALPHA, beta=BETA),
        "convergence_s": metrics.convergence(clock, np.abs(middle - true), end) if clock.size else math.nan,
        "crps_s": float(np.nanmean(crps)) if np.isfinite(crps).any() else math.nan,
        "coverage": math.nan,
        "width_s": math.nan,
    }
    if interval is not None and levels.size > 1:
        tail = (1.0 - interval) / 2.0
        lower, upper = _at(levels, quantiles, tail), _at(levels, quantiles, 1.0 - tail)
        # The guess has no interval.
        lower, upper = np.where(answered, lower, np.nan), np.where(answered, upper, np.nan)
        figures |= {"coverage": metrics.coverage(lower, upper, true), "width_s": metrics.mean_width(lower, upper)}
    return {name: finite_or_none(value) for name, value in figures.items()} | {"alpha_lambda": verdict.passed}


def _at(levels: Floats, quantiles: Floats, level: float) -> Floats:
    """Return the quantile at a level, by linear interpolation."""
    found = [np.interp(level, levels, row) if np.isfinite(row).all() else math.nan for row in quantiles]
    return np.array(found, dtype=np.float64)


def _baselines(
    issued: Issued, before: NDArray[np.bool_], lifetimes: Sequence[float]
) -> dict[str, tuple[Floats, Floats]]:
    """Return levels and quantiles of the naive forecasts, each with the past of its time.

    Distributions are given at the levels of the method if it has several, so that their CRPS can be compared.
    """
    levels = issued.levels if issued.levels.size > 1 else _LEVELS
    elapsed = np.maximum(issued.clock[before] - issued.onset, 0.0)
    found: dict[str, tuple[Floats, Floats]] = {}
    point = np.array([0.5])
    if lifetimes:
        found["constant"] = point, baselines.constant(elapsed, lifetimes)[:, np.newaxis]
        for name, method in (("climatology", baselines.climatology), ("elapsed_alone", baselines.elapsed_alone)):
            samples = [method(float(t), lifetimes) for t in elapsed]
            found[name] = levels, baselines.quantiles_of(samples, levels)
    found["doubling"] = levels, baselines.doubling(elapsed, levels)
    extrapolations = {"linear": baselines.linear, "exponential": baselines.exponential, "thesis": baselines.thesis}
    for name, extrapolate in extrapolations.items():
        ahead = extrapolate(issued.clock, issued.v_eq, issued.threshold)
        found[name] = point, ahead[before][:, np.newaxis]
    return found


def _damage(issued: Issued, before: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the error of V_eq against the truth of a simulated rig, before the end."""
    found, true = issued.v_eq[before], issued.v_eq_true[before]
    usable = (found > 0) & (true > 0)
    log_ratio = np.log(found[usable] / true[usable])
    return {
        "v_eq_ln_error": float(np.sqrt(np.mean(log_ratio**2))) if usable.any() else None,
        "v_eq_coverage": finite_or_none(metrics.coverage(issued.v_eq_lower[before], issued.v_eq_upper[before], true)),
    }


def _onset(issued: Issued, onset: float) -> dict[str, Any]:
    """Return the delay of detection and the false alarms, None for an unknown onset."""
    if not math.isfinite(onset):
        return {"onset_delay_s": None, "false_alarms": None, "false_alarms_per_1000_blocks": None}
    later = issued.alarms[issued.alarms >= onset]
    healthy = int((issued.judged < onset).sum())
    return {
        "onset_delay_s": finite_or_none(metrics.onset_delay(float(later[0]) if later.size else math.nan, onset)),
        "false_alarms": int((issued.alarms < onset).sum()),
        "false_alarms_per_1000_blocks": finite_or_none(metrics.false_alarms_per_1000(issued.alarms, healthy, onset)),
    }


def mean_of_runs(runs: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Return ``mean``, ``standard_error`` and ``runs`` of each figure of :func:`score_run` over runs.

    Channels of one run (same ``records`` and ``machine``) are averaged first. Figures of baselines are named
    ``baselines.NAME.FIGURE``.
    """
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in runs:
        groups.setdefault((run["records"], run["machine"]), []).append(_flat(run))
    names = dict.fromkeys(name for group in groups.values() for flat in group for name in flat)
    found: dict[str, dict[str, Any]] = {}
    for name in names:
        of_runs = [
            metrics.mean_over_runs([flat.get(name, math.nan) for flat in group]).mean for group in groups.values()
        ]
        mean = metrics.mean_over_runs(of_runs)
        if mean.runs:
            found[name] = {
                "mean": finite_or_none(mean.mean),
                "standard_error": finite_or_none(mean.standard_error),
                "runs": mean.runs,
            }
    return found


def _flat(run: Mapping[str, Any]) -> dict[str, float]:
    figures = {name: run[name] for name in _MEAN_OF}
    for baseline, values in run["baselines"].items():
        figures |= {f"baselines.{baseline}.{name}": values[name] for name in _MEAN_OF if name in values}
    return {name: math.nan if value is None else float(value) for name, value in figures.items()}


def _ratio(one: float | None, other: float | None) -> float | None:
    return one / other if one is not None and other else None


def finite_or_none(value: float) -> float | None:
    """Return a number for JSON, None where it is not finite."""
    return float(value) if math.isfinite(value) else None
