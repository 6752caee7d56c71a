"""V_eq and time to threshold from a library of simulated lives, with intervals (``--method library``).

The history of a bearing's levels is summarised (``summaries.py``); a regression fitted on simulated lives predicts V_eq
and the time to threshold (``fit.py``), and its errors on similar moments of lives outside its training folds give the
interval. The result depends on the library's growth laws, depths and rigs, and names it.

Times are damage time: standstill does not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from monitor.health.damage.library.model import LINES, Array, Library, levels_of, quantiles_of
from monitor.health.damage.library.summaries import LevelHistory

STATE_VERSION = 1
QUANTILES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Levels of the quantiles in a result."""


class LibraryStatus(StrEnum):
    """Outcome of one block.

    Values come with ``ok``, ``already_crossed`` (V_eq had reached the threshold in at least half of the similar lives;
    TT is zero, its upper end need not be; judged anew at each block) and ``beyond_horizon`` (the median is later than
    the horizon). Without values: ``not_final_stage``; ``no_library``; ``bad_block``: V_eq of a block without usable
    features (TT: ``cannot_tell``); ``outside_conditions``: V_eq at a load or speed outside the library, or that changes
    more between blocks than in its lives (TT: ``outside_library``); ``outside_library``: levels, elapsed time or block
    interval outside its lives; ``too_few_points``: TT before ``min_points`` blocks.
    """

    OK = "ok"
    ALREADY_CROSSED = "already_crossed"
    BEYOND_HORIZON = "beyond_horizon"
    NOT_FINAL_STAGE = "not_final_stage"
    NO_LIBRARY = "no_library"
    BAD_BLOCK = "bad_block"
    CANNOT_TELL = "cannot_tell"
    OUTSIDE_CONDITIONS = "outside_conditions"
    OUTSIDE_LIBRARY = "outside_library"
    TOO_FEW_POINTS = "too_few_points"


@dataclass(frozen=True)
class LibrarySettings:
    """Settings of the library forecaster.

    Attributes:
        features: "rms", "rms+harmonics" or, for a history of V_eq itself, "v_eq".
        interval: probability between the lower and the upper end.
        window: time to the next maintenance, s, or None.
        horizon: longest TT that is given as ``ok``, s.
        min_points: least number of blocks for a TT.
        neighbours: most similar moments of the library's lives, whose errors make the interval.
    """

    features: str = "rms+harmonics"
    interval: float = 0.8
    window: float | None = None
    horizon: float = 365 * 86400.0
    min_points: int = 5
    neighbours: int = 300

    def __post_init__(self) -> None:
        """Raise ValueError naming the setting that is out of range."""
        if not 0.0 < self.interval < 1.0:
            raise ValueError(f"interval must lie between 0 and 1, got {self.interval}")
        if self.window is not None and not self.window > 0.0:
            raise ValueError(f"window must be positive, or None, got {self.window}")
        if not self.horizon > 0.0:
            raise ValueError(f"horizon must be positive, got {self.horizon}")
        if self.min_points < 1 or self.neighbours < 10:
            raise ValueError(
                f"min_points must be 1 or more and neighbours 10 or more, got {self.min_points} and {self.neighbours}"
            )


@dataclass(frozen=True)
class LibraryInput:
    """Features of one block.

    Attributes:
        t: damage time, s; may repeat, may not go back.
        rms: in the library's band, m/s2; unused with the features "v_eq".
        harmonics: amplitudes of the BPFO lines from the first on, m/s2, or None.
        load: N.
        speed: Hz.
        v_eq: m2; used with the features "v_eq" only.
    """

    t: float
    rms: float = math.nan
    harmonics: Sequence[float] | None = None
    load: float = math.nan
    speed: float = math.nan
    v_eq: float = math.nan


@dataclass(frozen=True)
class Conditions:
    """Means and squared deviations of ln load and ln speed over blocks (Welford)."""

    count: int = 0
    load_mean: float = 0.0
    load_squares: float = 0.0
    speed_mean: float = 0.0
    speed_squares: float = 0.0

    def add(self, load: float, speed: float) -> Conditions:
        """Return the conditions with one more block."""
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
    """State of the forecaster, of bounded size.

    Attributes:
        library: hash of the library, "" before the first block.
        features: the set of features in use.
        history: None before the first block.
    """

    library: str = ""
    features: str = ""
    history: LevelHistory | None = None
    conditions: Conditions = Conditions()
    version: int = STATE_VERSION

    def to_dict(self) -> dict[str, Any]:
        """Return the state as plain values for JSON, bit for bit."""
        return {
            "library": self.library,
            "features": self.features,
            "history": None if self.history is None else self.history.to_dict(),
            "conditions": asdict(self.conditions),
            "version": self.version,
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> LibraryState:
        """Restore a state written by :meth:`to_dict`.

        Raises:
            ValueError: the state has another version.
        """
        if stored.get("version") != STATE_VERSION:
            raise ValueError(f"library state: version {STATE_VERSION} expected, got {stored.get('version')!r}")
        history = stored["history"]
        return cls(
            library=stored["library"],
            features=stored["features"],
            history=None if history is None else LevelHistory.from_dict(history),
            conditions=Conditions(**stored["conditions"]),
        )


@dataclass(frozen=True)
class ThresholdResult:
    """The forecast for one threshold; NaN wherever ``status`` says that there is no value.

    Attributes:
        tt: median, s of damage time; zero once crossed.
        tt_lower: lower end of the interval, s.
        p_threshold: probability of the crossing within the window; NaN without a window.
        p_crossed: probability that it has happened.
        t_threshold: median time of the crossing, s; NaN once crossed.
        quantiles: of TT at ``QUANTILES``, s; () without a value.
    """

    threshold: float
    tt: float
    tt_lower: float
    tt_upper: float
    p_threshold: float
    p_crossed: float
    t_threshold: float
    quantiles: tuple[float, ...]
    status: LibraryStatus


@dataclass(frozen=True)
class LibraryResult:
    """V_eq and forecasts after one block.

    Attributes:
        v_eq: median of V_eq, m2.
        v_eq_lower: lower end of its interval, m2.
        v_eq_quantiles: at ``QUANTILES``, m2; () without a value.
        forecasts: one per threshold, in their order.
        library: hash, "" where there is none.
        prior: the library's assumptions, as text.
    """

    v_eq: float
    v_eq_lower: float
    v_eq_upper: float
    v_eq_quantiles: tuple[float, ...]
    edv_status: LibraryStatus
    forecasts: tuple[ThresholdResult, ...]
    interval: float
    library: str
    prior: str


def step(
    state: LibraryState,
    block: LibraryInput,
    library: Library | None,
    settings: LibrarySettings | None = None,
    *,
    thresholds: Sequence[float],
    final_stage: bool = True,
) -> tuple[LibraryState, LibraryResult]:
    """Add one block to the history and forecast from it.

    Args:
        state: ``LibraryState()`` at t_fs.
        library: None where there is none.
        thresholds: one or more V_th of the library, m2.
        final_stage: where False, the state is returned unchanged.

    Returns:
        The next state and the result. A block without usable features, or at a load or speed outside the library,
            leaves the state unchanged.
        does not span, leaves the state as it was.

    Raises:
        ValueError: a time that is not finite or goes back, a threshold or set of features that the library was not
            fitted for, or a state of another library or other features.
    """
    settings = settings or LibrarySettings()
    if library is None:
        return state, _no_result(None, thresholds, settings, LibraryStatus.NO_LIBRARY, LibraryStatus.NO_LIBRARY)
    for threshold in thresholds:
        library.target(threshold)
    fit = library.fit_for(settings.features)
    if not final_stage:
        stage = LibraryStatus.NOT_FINAL_STAGE
        return state, _no_result(library, thresholds, settings, stage, stage)
    if state.history is not None and (state.library, state.features) != (library.hash, settings.features):
        raise ValueError(
            f"the history was read with library {state.library[:16]} and features {state.features!r}, but asked is "
            f"library {library.hash[:16]} and features {settings.features!r}; start anew with LibraryState()"
        )
    if not _usable(block, settings.features):
        bad, cannot = LibraryStatus.BAD_BLOCK, LibraryStatus.CANNOT_TELL
        return state, _no_result(library, thresholds, settings, bad, cannot)
    outside = LibraryStatus.OUTSIDE_LIBRARY
    own_levels = settings.features == "v_eq"
    if not own_levels and not library.covers_conditions(block.load, block.speed):
        conditions = LibraryStatus.OUTSIDE_CONDITIONS
        return state, _no_result(library, thresholds, settings, conditions, outside)
    relative = fit.relative_levels(_levels(block, settings.features), np.array([block.load]), np.array([block.speed]))
    bounded, known = fit.bounded(relative[0])
    history = (state.history or LevelHistory.empty(fit.channels)).add(float(block.t), bounded)
    changes = state.conditions if own_levels else state.conditions.add(block.load, block.speed)
    state = LibraryState(library.hash, settings.features, history, changes)
    if not library.covers_changes(*changes.spreads):
        return state, _no_result(library, thresholds, settings, LibraryStatus.OUTSIDE_CONDITIONS, outside)
    if not known or not fit.covers_pace(history):
        return state, _no_result(library, thresholds, settings, outside, outside)
    return state, _answer(library, history, block, settings, thresholds)


def _answer(
    library: Library, history: LevelHistory, block: LibraryInput, settings: LibrarySettings, thresholds: Sequence[float]
) -> LibraryResult:
    """Return the result for a history inside the library."""
    fit, count = library.fit_for(settings.features), settings.neighbours
    x = fit.inputs(history, block.load, block.speed)
    predicted = fit.regression.predict(x[None])[0].tolist()
    ln_elapsed = float(x[0])
    sample = fit.sample_v_eq(predicted[0], ln_elapsed, count)
    lower, median, upper, *quantiles = quantiles_of(sample, _result_levels(settings)).tolist()
    forecasts: list[ThresholdResult] = []
    for threshold in thresholds:
        if history.count < settings.min_points:
            forecasts.append(_empty_forecast(threshold, LibraryStatus.TOO_FEW_POINTS))
            continue
        target = library.target(threshold)
        left = fit.sample_tt(target, predicted[target], ln_elapsed, count)
        forecasts.append(_forecast(left, block.t, threshold, settings))
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
    """Return whether a block has the features of a set."""
    if features == "v_eq":
        return math.isfinite(block.v_eq) and block.v_eq > 0.0
    lines = LINES[features]
    amplitudes = tuple(() if block.harmonics is None else block.harmonics)[:lines]
    positive = (block.rms, block.load, block.speed)
    return (
        len(amplitudes) == lines
        and all(math.isfinite(value) and value > 0.0 for value in positive)
        and all(math.isfinite(value) and value >= 0.0 for value in amplitudes)
    )


def _levels(block: LibraryInput, features: str) -> Array:
    harmonics = np.array([() if block.harmonics is None else block.harmonics], dtype=float)
    return levels_of(features, np.array([block.rms]), harmonics, np.array([block.v_eq]))


def _result_levels(settings: LibrarySettings) -> tuple[float, ...]:
    """Return the levels of the lower end, the median and the upper end of the interval, then ``QUANTILES``."""
    half = 0.5 * settings.interval
    return (0.5 - half, 0.5, 0.5 + half, *QUANTILES)


def _forecast(sample: Array, t: float, threshold: float, settings: LibrarySettings) -> ThresholdResult:
    """Return the forecast from an ascending sample of the time to a threshold, s."""
    lower, median, upper, *quantiles = quantiles_of(sample, _result_levels(settings)).tolist()
    crossed = float(np.mean(np.equal(sample, 0.0)))
    within = math.nan if settings.window is None else float(np.mean(sample <= settings.window))
    status = LibraryStatus.OK if median <= settings.horizon else LibraryStatus.BEYOND_HORIZON
    if crossed >= 0.5:
        status, median = LibraryStatus.ALREADY_CROSSED, 0.0
    return ThresholdResult(
        threshold=float(threshold),
        tt=median,
        tt_lower=lower,
        tt_upper=upper,
        p_threshold=within,
        p_crossed=crossed,
        t_threshold=math.nan if status is LibraryStatus.ALREADY_CROSSED else t + median,
        quantiles=tuple(quantiles),
        status=status,
    )


def _empty_forecast(threshold: float, status: LibraryStatus) -> ThresholdResult:
    """Return the forecast without values."""
    nan = math.nan
    return ThresholdResult(float(threshold), nan, nan, nan, nan, nan, nan, (), status)


def _no_result(
    library: Library | None,
    thresholds: Sequence[float],
    settings: LibrarySettings,
    edv_status: LibraryStatus,
    tt_status: LibraryStatus,
) -> LibraryResult:
    """Return the result without values."""
    nan = math.nan
    return LibraryResult(
        v_eq=nan,
        v_eq_lower=nan,
        v_eq_upper=nan,
        v_eq_quantiles=(),
        edv_status=edv_status,
        forecasts=tuple(_empty_forecast(threshold, tt_status) for threshold in thresholds),
        interval=settings.interval,
        library="" if library is None else library.hash,
        prior="" if library is None else library.prior,
    )
