"""Calibration of a library by runs recorded on the rig itself, from the onset to the end.

The lives of a library may all last longer than those of the rig, or differ more. Recorded runs with a known end show by
how much; the moments of one run share one life, so each run counts once. The runs are weighted against a prior of
``PRIOR_RUNS`` runs for the library.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from monitor.health.size.library.model import OFFSET, Array, FeatureFit, Library, levels_of
from monitor.health.size.library.summaries import LevelHistory

PRIOR_RUNS = 4.0
"""Prior weight of the library, in equivalent runs."""
_MAX_MOMENTS = 20
_MIN_POINTS = 5
_NEIGHBOURS = 300
_STRETCH_LIMITS = (0.5, 3.0)
_SD_PER_80_PERCENT = 2.563
"""Standard deviations between the 10 % and the 90 % quantile of a normal distribution."""


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recorded run of n blocks, onset first.

    Attributes:
        t: damage time, s, shape (n,).
        rms: m/s2, shape (n,).
        harmonics: lines of BPFO, m/s2, shape (n, 3) or more; unused with "rms" alone.
        load: N, shape (n,).
        speed: Hz, shape (n,).
        end: when the threshold was reached, or what stands for it, s on the clock of ``t``.
    """

    name: str
    t: Array
    rms: Array
    harmonics: Array
    load: Array
    speed: Array
    end: float


def calibrate(library: Library, runs: Sequence[RecordedRun], *, features: str, threshold: float) -> Library:
    """Shift the library's times to a threshold and scale their spread by recorded runs.

    The logarithms of the remaining times are compared with the library's predictions. The mean difference over the runs
    (each run's own mean counts once) shifts the predictions, and the mean square, in units of the predicted spread,
    scales it; both are drawn towards no change by ``PRIOR_RUNS``. V_eq is not changed.

    Args:
        library: an earlier calibration of this threshold is replaced.
        runs: of one rig.
        features: the set to calibrate, not "v_eq".
        threshold: the one that ``end`` belongs to, m2.

    Raises:
        ValueError: a set of features or threshold outside the library, or no run with moments inside it.
    """
    if features == "v_eq":
        raise ValueError("calibration: features must be those that a sensor gives, got 'v_eq'")
    target, fit = library.target(threshold), library.fit_for(features)
    fresh = _changed(fit, target, 0.0, 1.0)
    found = {run.name: _differences(library, fresh, run, target) for run in runs}
    used = [np.array(rows) for rows in found.values() if rows]
    if not used:
        names = ", ".join(found) or "no runs were given"
        raise ValueError(f"calibration: no moment of any run lies within the library ({names})")
    weight = len(used) / (len(used) + PRIOR_RUNS)
    shift = weight * float(np.mean([rows[:, 0].mean() for rows in used]))
    squares = [float(np.mean(((rows[:, 0] - shift) / rows[:, 1]) ** 2)) for rows in used]
    square = (PRIOR_RUNS + sum(squares)) / (PRIOR_RUNS + len(used))
    stretch = min(max(math.sqrt(square), _STRETCH_LIMITS[0]), _STRETCH_LIMITS[1])
    key = f"{features} {threshold * 1e6:g}"
    summary: dict[str, Any] = {"runs": len(used), "left_out": len(runs) - len(used), "shift": shift, "stretch": stretch}
    base = library.prior.split("; calibrated on ")[0]
    return replace(
        library,
        prior=f"{base}; calibrated on {len(used)} recorded runs",
        fits={**library.fits, features: _changed(fit, target, shift, stretch)},
        calibration={**library.calibration, key: summary},
    )


def _changed(fit: FeatureFit, target: int, shift: float, stretch: float) -> FeatureFit:
    shifts, stretches = fit.shift.copy(), fit.stretch.copy()
    shifts[target], stretches[target] = shift, stretch
    return replace(fit, shift=shifts, stretch=stretches)


def _differences(library: Library, fit: FeatureFit, run: RecordedRun, target: int) -> list[tuple[float, float]]:
    """Return (error, predicted SD) of ln TT at moments of a run inside the library."""
    levels = levels_of(fit.features, run.rms, run.harmonics, run.rms)
    usable = (run.t < run.end) & np.all(np.isfinite(levels), axis=1) & (run.rms > 0.0)
    conditions = zip(run.load.tolist(), run.speed.tolist(), strict=True)
    blocks = np.flatnonzero(usable & np.array([library.covers_conditions(load, speed) for load, speed in conditions]))
    if not len(blocks):
        return []
    wanted = set(np.linspace(0, len(blocks) - 1, _MAX_MOMENTS).astype(int).tolist())
    relative = fit.relative_levels(levels[blocks], run.load[blocks], run.speed[blocks])
    history = LevelHistory.empty(fit.channels)
    found: list[tuple[float, float]] = []
    for number, block in enumerate(blocks.tolist()):
        load, speed = float(run.load[block]), float(run.speed[block])
        bounded, known = fit.bounded(relative[number])
        history = history.add(float(run.t[block]), bounded)
        if number not in wanted or not known or history.count < _MIN_POINTS or not fit.covers_pace(history):
            continue
        x = fit.inputs(history, load, speed)
        predicted = float(fit.regression.predict(x[None])[0, target])
        errors = fit.error[fit.nearest_moments(target, predicted, float(x[0]), _NEIGHBOURS), target]
        low, middle, high = fit.spread(target) * np.quantile(errors, (0.1, 0.5, 0.9))
        truth = math.log((run.end - float(run.t[block])) / fit.interval + OFFSET)
        found.append((truth - predicted - float(middle), max(float(high - low), 1e-3) / _SD_PER_80_PERCENT))
    return found
