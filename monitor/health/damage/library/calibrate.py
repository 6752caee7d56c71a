"""A library put right by runs that were recorded on the rig itself, from the onset to the end.

The lives of a library are not those of a rig: they may all last longer, or differ more. Recorded runs whose end is
known say by how much, each as a whole: the moments of one run share one life. Few runs say little, so what they say is
weighed against the library as if that stood for some runs of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from monitor.health.damage.library.model import OFFSET, Array, FeatureFit, Library, levels_of
from monitor.health.damage.library.summaries import History

LIBRARY_RUNS = 4.0
"""The library counts as so many recorded runs."""
_MOMENTS = 20
_LEAST_POINTS = 5
_NEIGHBOURS = 300
_STRETCH = (0.5, 3.0)
_EIGHTY = 2.563
"""Standard deviations between the 10 % and the 90 % quantile of a normal distribution."""


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A run as it was recorded, onset first, n blocks.

    Attributes:
        name: what it is called.
        t: damage time of each block, s, shape (n,).
        rms: m/s2, shape (n,).
        harmonics: lines of BPFO, m/s2, shape (n, 3) or more; not looked at with "rms" alone.
        load: N, shape (n,).
        speed: Hz, shape (n,).
        end: when the threshold was reached, or what is taken for that, on the clock of ``t``, s.
    """

    name: str
    t: Array
    rms: Array
    harmonics: Array
    load: Array
    speed: Array
    end: float


def calibrate(library: Library, runs: Sequence[RecordedRun], *, features: str, threshold: float) -> Library:
    """Return the library with the times to a threshold shifted and their spread stretched as recorded runs have it.

    What is left of each time is compared, in the logarithm, with what the library says of it. The mean of the
    differences over the runs (each run's own mean counts once) moves the predictions, and their mean square, in units
    of the spread that the library gives, stretches it; both are drawn towards no change by ``LIBRARY_RUNS``. V_eq is
    not changed: recorded runs do not tell it.

    Args:
        library: the library; what an earlier calibration did to this threshold is done anew.
        runs: recorded runs of one rig.
        features: the set of features that is put right, not "v_eq".
        threshold: the threshold that ``end`` belongs to, m2.

    Raises:
        ValueError: a set of features or threshold that the library was not fitted for, or no run that it can read
            (all moments outside it); the message says which.
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
    weight = len(used) / (len(used) + LIBRARY_RUNS)
    shift = weight * float(np.mean([rows[:, 0].mean() for rows in used]))
    squares = [float(np.mean(((rows[:, 0] - shift) / rows[:, 1]) ** 2)) for rows in used]
    square = (LIBRARY_RUNS + sum(squares)) / (LIBRARY_RUNS + len(used))
    stretch = min(max(math.sqrt(square), _STRETCH[0]), _STRETCH[1])
    key = f"{features} {threshold * 1e6:g}"
    said: dict[str, Any] = {"runs": len(used), "left_out": len(runs) - len(used), "shift": shift, "stretch": stretch}
    base = library.prior.split("; calibrated on ")[0]
    return replace(
        library,
        prior=f"{base}; calibrated on {len(used)} recorded runs",
        fits={**library.fits, features: _changed(fit, target, shift, stretch)},
        calibration={**library.calibration, key: said},
    )


def _changed(fit: FeatureFit, target: int, shift: float, stretch: float) -> FeatureFit:
    shifts, stretches = fit.shift.copy(), fit.stretch.copy()
    shifts[target], stretches[target] = shift, stretch
    return replace(fit, shift=shifts, stretch=stretches)


def _differences(library: Library, fit: FeatureFit, run: RecordedRun, target: int) -> list[tuple[float, float]]:
    """Return what was true less what is said at moments of a run, and the spread said, logarithms; [] outside."""
    levels = levels_of(fit.features, run.rms, run.harmonics, run.rms)
    usable = (run.t < run.end) & np.all(np.isfinite(levels), axis=1) & (run.rms > 0.0)
    conditions = zip(run.load.tolist(), run.speed.tolist(), strict=True)
    blocks = np.flatnonzero(usable & np.array([library.covers_conditions(load, speed) for load, speed in conditions]))
    if not len(blocks):
        return []
    wanted = set(np.linspace(0, len(blocks) - 1, _MOMENTS).astype(int).tolist())
    relative = fit.relative_levels(levels[blocks], run.load[blocks], run.speed[blocks])
    history = History.empty(fit.channels)
    found: list[tuple[float, float]] = []
    for number, block in enumerate(blocks.tolist()):
        load, speed = float(run.load[block]), float(run.speed[block])
        bounded, known = fit.bounded(relative[number])
        history = history.add(float(run.t[block]), bounded)
        if number not in wanted or not known or history.count < _LEAST_POINTS or not fit.covers_pace(history):
            continue
        x = fit.inputs(history, load, speed)
        said = float(fit.regression.predict(x[None])[0, target])
        errors = fit.error[fit.nearest_moments(target, said, float(x[0]), _NEIGHBOURS), target]
        low, middle, high = np.quantile(errors, (0.1, 0.5, 0.9))
        truth = math.log((run.end - float(run.t[block])) / fit.interval + OFFSET)
        found.append((truth - said - float(middle), max(float(high - low), 1e-3) / _EIGHTY))
    return found
