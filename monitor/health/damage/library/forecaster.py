"""V_eq and the time to threshold from a library of simulated lives, with intervals (``--method library``).

The history of a bearing's levels up to now is put into a few numbers (``summaries.py``), a regression fitted on
simulated lives says what such lives had by then and had still before them (``library_fit.py``), and the errors that the
same regression made on lives that it had not seen, and that looked alike, give the interval. What is said leans on that
library: on its growth laws, its depths and its rigs. The result names it.

Time here is damage time: hours in which the machine stands still are not to be counted by the caller's clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.damage.library.answer import (
    QUANTILES,
    LibraryResult,
    LibrarySettings,
    LibraryStatus,
    ThresholdResult,
    empty_forecast,
    forecast_of,
    levels_asked,
    nothing,
)
from monitor.health.damage.library.model import LINES, Library, levels_of, quantiles_of
from monitor.health.damage.library.summaries import History

__all__ = [
    "QUANTILES",
    "Conditions",
    "LibraryInput",
    "LibraryResult",
    "LibrarySettings",
    "LibraryState",
    "LibraryStatus",
    "ThresholdResult",
    "step",
]

STATE_VERSION = 1
Array = NDArray[np.float64]


@dataclass(frozen=True)
class LibraryInput:
    """What one block says.

    Attributes:
        t: damage time of the block since anything, s; may repeat, may not go back.
        rms: RMS in the library's band, m/s2; not looked at with the features "v_eq".
        harmonics: amplitudes of the lines of BPFO, m/s2, from the first on, or None.
        load: radial load, N.
        speed: shaft speed, Hz.
        v_eq: V_eq as tracked by something else, m2; looked at with the features "v_eq" only.
    """

    t: float
    rms: float = math.nan
    harmonics: Sequence[float] | None = None
    load: float = math.nan
    speed: float = math.nan
    v_eq: float = math.nan


@dataclass(frozen=True)
class Conditions:
    """How load and speed have changed from block to block (Welford's running sums).

    Attributes:
        count: number of blocks.
        load_mean: mean of ln load.
        load_squares: sum of the squares of what differs from it.
        speed_mean: mean of ln speed.
        speed_squares: sum of the squares of what differs from it.
    """

    count: int = 0
    load_mean: float = 0.0
    load_squares: float = 0.0
    speed_mean: float = 0.0
    speed_squares: float = 0.0

    def add(self, load: float, speed: float) -> Conditions:
        """Return the conditions with those of one more block."""
        count = self.count + 1
        by_load, by_speed = math.log(load) - self.load_mean, math.log(speed) - self.speed_mean
        load_mean, speed_mean = self.load_mean + by_load / count, self.speed_mean + by_speed / count
        return Conditions(
            count=count,
            load_mean=load_mean,
            load_squares=self.load_squares + by_load * (math.log(load) - load_mean),
            speed_mean=speed_mean,
            speed_squares=self.speed_squares + by_speed * (math.log(speed) - speed_mean),
        )

    @property
    def spreads(self) -> tuple[float, float]:
        """Standard deviations of ln load and ln speed."""
        count = max(self.count, 1)
        return math.sqrt(max(self.load_squares, 0.0) / count), math.sqrt(max(self.speed_squares, 0.0) / count)


@dataclass(frozen=True)
class LibraryState:
    """All that is remembered of a bearing; of bounded size however long its history.

    Attributes:
        library: hash of the library that the history was read with, "" before the first block.
        features: its set of features.
        history: the history, or None before the first block.
        conditions: how load and speed have changed.
        version: layout of this state.
    """

    library: str = ""
    features: str = ""
    history: History | None = None
    conditions: Conditions = Conditions()
    version: int = STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as JSON can hold it; every bit is kept."""
        return {
            "library": self.library,
            "features": self.features,
            "history": None if self.history is None else self.history.to_dict(),
            "conditions": asdict(self.conditions),
            "version": self.version,
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> LibraryState:
        """Return the state that :meth:`to_dict` wrote.

        Raises:
            ValueError: the state was written in a layout that this version does not know.
        """
        if stored.get("version") != STATE_VERSION:
            raise ValueError(f"library state: version {STATE_VERSION} expected, got {stored.get('version')!r}")
        history = stored["history"]
        return cls(
            library=stored["library"],
            features=stored["features"],
            history=None if history is None else History.from_dict(history),
            conditions=Conditions(**stored["conditions"]),
        )


def step(
    state: LibraryState,
    block: LibraryInput,
    library: Library | None,
    settings: LibrarySettings | None = None,
    *,
    thresholds: Sequence[float],
    final_stage: bool = True,
) -> tuple[LibraryState, LibraryResult]:
    """Take one block into the history and say what the library makes of it.

    Args:
        state: what is remembered; ``LibraryState()`` at t_fs.
        block: what the block says.
        library: the library, or None where there is none.
        settings: how to ask it.
        thresholds: V_th, one or several of those that the library was fitted for, m2.
        final_stage: whether the bearing is in the final stage; where not, nothing is taken in.

    Returns:
        The next state, and what the block adds. A block without usable figures, or at a load or speed that the library
        does not span, leaves the state as it was.

    Raises:
        ValueError: a time that is not finite or goes back, a threshold or a set of features that the library was not
            fitted for, or a state that was made with another library or other features.
    """
    settings = settings or LibrarySettings()
    if library is None:
        return state, nothing(None, thresholds, settings, LibraryStatus.NO_LIBRARY, LibraryStatus.NO_LIBRARY)
    for threshold in thresholds:
        library.target(threshold)
    fit = library.fit_for(settings.features)
    if not final_stage:
        stage = LibraryStatus.NOT_FINAL_STAGE
        return state, nothing(library, thresholds, settings, stage, stage)
    if state.history is not None and (state.library, state.features) != (library.hash, settings.features):
        raise ValueError(
            f"the history was read with library {state.library[:16]} and features {state.features!r}, but asked is "
            f"library {library.hash[:16]} and features {settings.features!r}; start anew with LibraryState()"
        )
    if not _usable(block, settings.features):
        bad, cannot = LibraryStatus.BAD_BLOCK, LibraryStatus.CANNOT_TELL
        return state, nothing(library, thresholds, settings, bad, cannot)
    outside = LibraryStatus.OUTSIDE_LIBRARY
    own_levels = settings.features == "v_eq"
    if not own_levels and not library.covers_conditions(block.load, block.speed):
        conditions = LibraryStatus.OUTSIDE_CONDITIONS
        return state, nothing(library, thresholds, settings, conditions, outside)
    relative = fit.relative_levels(_levels(block, settings.features), np.array([block.load]), np.array([block.speed]))
    bounded, known = fit.bounded(relative[0])
    history = (state.history or History.empty(fit.channels)).add(float(block.t), bounded)
    changes = state.conditions if own_levels else state.conditions.add(block.load, block.speed)
    state = LibraryState(library.hash, settings.features, history, changes)
    if not library.covers_changes(*changes.spreads):
        return state, nothing(library, thresholds, settings, LibraryStatus.OUTSIDE_CONDITIONS, outside)
    if not known or not fit.covers_pace(history):
        return state, nothing(library, thresholds, settings, outside, outside)
    return state, _answer(library, history, block, settings, thresholds)


def _answer(
    library: Library, history: History, block: LibraryInput, settings: LibrarySettings, thresholds: Sequence[float]
) -> LibraryResult:
    """Return what the library makes of a history that it knows the like of."""
    fit, count = library.fit_for(settings.features), settings.neighbours
    x = fit.inputs(history, block.load, block.speed)
    said = fit.regression.predict(x[None])[0].tolist()
    ln_elapsed = float(x[0])
    sample = fit.sample_v_eq(said[0], ln_elapsed, count)
    lower, median, upper, *quantiles = map(float, quantiles_of(sample, levels_asked(settings)))
    forecasts: list[ThresholdResult] = []
    for threshold in thresholds:
        if history.count < settings.min_points:
            forecasts.append(empty_forecast(threshold, LibraryStatus.TOO_FEW_POINTS))
            continue
        target = library.target(threshold)
        left = fit.sample_tt(target, said[target], ln_elapsed, count)
        forecasts.append(forecast_of(left, block.t, threshold, settings))
    return LibraryResult(
        v_eq=median,
        v_eq_lower=lower,
        v_eq_upper=upper,
        v_eq_quantiles=tuple(quantiles),
        edv_status=LibraryStatus.OK,
        forecasts=tuple(forecasts),
        interval=settings.interval,
        library=library.hash,
        prior=library.prior,
    )


def _usable(block: LibraryInput, features: str) -> bool:
    """Say whether a block has the figures that a set of features looks at."""
    if features == "v_eq":
        return math.isfinite(block.v_eq) and block.v_eq > 0.0
    lines = LINES[features]
    heard = tuple(() if block.harmonics is None else block.harmonics)[:lines]
    positive = (block.rms, block.load, block.speed)
    return (
        len(heard) == lines
        and all(math.isfinite(value) and value > 0.0 for value in positive)
        and all(math.isfinite(value) and value >= 0.0 for value in heard)
    )


def _levels(block: LibraryInput, features: str) -> Array:
    harmonics = np.array([() if block.harmonics is None else block.harmonics], dtype=float)
    return levels_of(features, np.array([block.rms]), harmonics, np.array([block.v_eq]))
