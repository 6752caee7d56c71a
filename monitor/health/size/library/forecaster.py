"""V_eq and time to threshold from a library of simulated lives, with intervals (``--method library``).

The history of a bearing's levels is summarised (``summaries.py``); a regression fitted on simulated lives predicts V_eq
and the time to threshold (``fit.py``), and its errors on similar moments of lives outside its training folds give the
interval. The result depends on the library's growth laws, depths and rigs, and names it.

The share of similar moments at which V_eq stood still is the probability of no growth. Once it has been one half or
more in ``STANDING_BLOCKS`` blocks in succession, there is no TT; before, TT is that of damage that grows, and its upper
end is open where the probability is larger than the upper tail.

Times are damage time: standstill does not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from monitor.health.codec import StoredState
from monitor.health.size import Damage, DamageInput, EdvStatus, Remaining, RemainingSettings, TtStatus
from monitor.health.size.library.model import (
    LINES,
    NO_GROWTH,
    Array,
    FeatureFit,
    Library,
    levels_of,
    quantiles_of,
)
from monitor.health.size.library.plausible import Watch, step_score
from monitor.health.size.library.summaries import LevelHistory

QUANTILES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Levels of the quantiles in a result."""
STANDING_BLOCKS = 12
"""Blocks in succession at which V_eq probably stands still before this is claimed: a probability is judged at every
block, and over a life one of them is wrong far more often than each. Found on the development lives of
``benchmarks.unseen.seeds``."""


@dataclass(frozen=True)
class LibrarySettings(RemainingSettings):
    """Settings of the library forecaster.

    Attributes:
        features: "rms", "rms+harmonics" or, for a history of V_eq itself, "v_eq".
        min_points: least number of blocks for a TT.
        neighbours: most similar moments of the library's lives, whose errors make the interval.
    """

    features: str = "rms+harmonics"
    min_points: int = 5
    neighbours: int = 300

    def __post_init__(self) -> None:
        """Raise ValueError naming the setting that is out of range."""
        super().__post_init__()
        if self.min_points < 1 or self.neighbours < 10:
            raise ValueError(
                f"min_points must be 1 or more and neighbours 10 or more, got {self.min_points} and {self.neighbours}"
            )


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
class LibraryState(StoredState):
    """State of the forecaster, of bounded size.

    Attributes:
        library: hash of the library, "" before the first block.
        features: the set of features in use.
        history: None before the first block; its times are damage time less the excess of long gaps.
        watch: what was seen of the blocks.
        standing: latest answered blocks in succession at which V_eq probably stands still.
    """

    VERSIONS = (1, 2, 3)
    LATER = frozenset({"watch", "standing"})

    library: str = ""
    features: str = ""
    history: LevelHistory | None = None
    conditions: Conditions = Conditions()
    watch: Watch = field(default_factory=Watch)
    standing: int = 0
    version: int = VERSIONS[-1]

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a state of version 1, which has seen no blocks but those of its history, as later ones are."""
        if "watch" in stored or stored["history"] is None:
            return stored
        history = LevelHistory.from_dict(stored["history"])
        return {**stored, "watch": {"seen": history.t_first + history.elapsed}}


def step(
    state: LibraryState,
    block: DamageInput,
    library: Library | None,
    settings: LibrarySettings | None = None,
    *,
    thresholds: Sequence[float],
    final_stage: bool = True,
) -> tuple[LibraryState, Damage, tuple[Remaining, ...]]:
    """Add one block to the history; return V_eq and one forecast per threshold, in their order.

    A block without usable features, or at a load or speed outside the library, leaves the state unchanged; an
    ``implausible`` step of the level leaves the history unchanged, so that the blocks after it are compared with those
    before it. A gap between blocks counts as at most ``plausible.MAX_GAP`` intervals.

    Args:
        state: ``LibraryState()`` at t_fs.
        block: RMS, lines, load and speed, or ``v_eq`` alone with the features "v_eq".
        library: None where there is none.
        thresholds: one or more V_th of the library, m2.
        final_stage: where False, the state is returned unchanged.

    Raises:
        ValueError: a time that is not finite or goes back, a threshold or set of features that the library was not
            fitted for, or a state of another library or other features.
    """
    settings = settings or LibrarySettings()
    if library is None:
        return state, *_without_values(thresholds, EdvStatus.NO_LIBRARY, TtStatus.NO_LIBRARY)
    for threshold in thresholds:
        library.target(threshold)
    fit = library.fit_for(settings.features)
    if not final_stage:
        return state, *_without_values(thresholds, EdvStatus.NOT_FINAL_STAGE, TtStatus.NOT_FINAL_STAGE)
    if state.history is not None and (state.library, state.features) != (library.hash, settings.features):
        raise ValueError(
            f"the history was read with library {state.library[:16]} and features {state.features!r}, but asked is "
            f"library {library.hash[:16]} and features {settings.features!r}; start anew with LibraryState()"
        )
    if not _usable(block, settings.features):
        return state, *_without_values(thresholds, EdvStatus.BAD_BLOCK, TtStatus.CANNOT_TELL)
    load, speed = (math.nan if value is None else value for value in (block.load, block.speed))
    own_levels = settings.features == "v_eq"
    if not own_levels and not (library.covers_conditions(load, speed) and _is_steady(block, library)):
        return state, *_without_values(thresholds, EdvStatus.OUTSIDE_CONDITIONS, TtStatus.OUTSIDE_LIBRARY)
    relative = fit.relative_levels(_levels(block, settings.features), np.array([load]), np.array([speed]))
    watch = state.watch.see(float(block.time), fit.interval)
    history = state.history or LevelHistory.empty(fit.channels)
    if not _can_follow(fit, history, watch, float(relative[0, 0])):
        state = LibraryState(library.hash, settings.features, history, state.conditions, watch, state.standing)
        return state, *_without_values(thresholds, EdvStatus.IMPLAUSIBLE, TtStatus.CANNOT_TELL)
    bounded, known = fit.bounded(relative[0])
    history = history.add(float(block.time) - watch.closed, bounded)
    changes = state.conditions if own_levels else state.conditions.add(load, speed)
    state = LibraryState(library.hash, settings.features, history, changes, watch.use(), state.standing)
    if not library.covers_changes(*changes.spreads):
        return state, *_without_values(thresholds, EdvStatus.OUTSIDE_CONDITIONS, TtStatus.OUTSIDE_LIBRARY)
    if not known or not fit.covers_pace(history):
        return state, *_without_values(thresholds, EdvStatus.OUTSIDE_LIBRARY, TtStatus.OUTSIDE_LIBRARY)
    x = fit.inputs(history, load, speed)
    if fit.limits is not None and history.count >= settings.min_points and not fit.limits.holds_summary(x):
        return state, *_without_values(thresholds, EdvStatus.IMPLAUSIBLE, TtStatus.CANNOT_TELL)
    predicted = fit.regression.predict(x[None])[0].tolist()
    still = fit.p_no_growth(predicted[-1], settings.neighbours)
    state = replace(state, standing=state.standing + 1 if still >= NO_GROWTH else 0)
    moment = Moment(predicted, float(x[0]), history.count, float(block.time), still, state.standing >= STANDING_BLOCKS)
    return state, *_answer(library, fit, moment, settings, thresholds)


def _is_steady(block: DamageInput, library: Library) -> bool:
    """Return whether the speed varies no more within a block than between those of the lives, which have one each."""
    if block.speed_range is None:
        return True
    low, high = block.speed_range
    return library.covers_changes(0.0, math.log(high / low) / math.sqrt(12.0))


def _can_follow(fit: FeatureFit, history: LevelHistory, watch: Watch, ln_rms: float) -> bool:
    """Return whether a relative level of the RMS can follow a history after what was seen since."""
    if fit.limits is None or watch.seen is None:
        return True
    score = step_score(history.recent[:, 1].tolist(), ln_rms)
    if score is None:
        return True
    since = watch.seen - watch.closed - (history.t_first + history.elapsed)
    return fit.limits.holds_step(score, watch.lag(since, fit.interval))


def _without_values(thresholds: Sequence[float], edv: EdvStatus, tt: TtStatus) -> tuple[Damage, tuple[Remaining, ...]]:
    return Damage(edv), tuple(Remaining(float(threshold), tt) for threshold in thresholds)


@dataclass(frozen=True)
class Moment:
    """What is answered at a block.

    Attributes:
        predicted: by the regression, one number a target.
        ln_elapsed: logarithm of the elapsed time plus six intervals, in intervals.
        blocks: in the history.
        t: time of the block, s.
        p_no_growth: probability that V_eq stands still.
        stands: whether this is claimed.
    """

    predicted: Sequence[float]
    ln_elapsed: float
    blocks: int
    t: float
    p_no_growth: float
    stands: bool


def _answer(
    library: Library, fit: FeatureFit, moment: Moment, settings: LibrarySettings, thresholds: Sequence[float]
) -> tuple[Damage, tuple[Remaining, ...]]:
    """Return the result at a moment inside the library."""
    predicted, still = moment.predicted, moment.p_no_growth
    sample = fit.sample_v_eq(predicted[0], moment.ln_elapsed, predicted[-1], settings.neighbours)
    lower, median, upper = quantiles_of(sample, _interval_levels(settings)).tolist()
    forecasts: list[Remaining] = []
    for threshold in thresholds:
        if moment.blocks < settings.min_points:
            forecasts.append(Remaining(float(threshold), TtStatus.TOO_FEW_POINTS, p_no_growth=still))
            continue
        target = library.target(threshold)
        left = fit.sample_tt(target, predicted[target], moment.ln_elapsed, settings.neighbours)
        below = moment.stands and median < threshold
        forecasts.append(_forecast(left, threshold, moment, settings, below=below))
    return Damage(EdvStatus.OK, median, lower, upper, p_no_growth=still), tuple(forecasts)


def _usable(block: DamageInput, features: str) -> bool:
    """Return whether a block has the features of a set."""
    if features == "v_eq":
        return math.isfinite(block.v_eq) and block.v_eq > 0.0
    lines = LINES[features]
    amplitudes = (block.harmonics or ())[:lines]
    return (
        len(amplitudes) == lines
        and all(
            value is not None and math.isfinite(value) and value > 0.0 for value in (block.rms, block.load, block.speed)
        )
        and all(math.isfinite(value) and value >= 0.0 for value in amplitudes)
    )


def _levels(block: DamageInput, features: str) -> Array:
    harmonics = np.array([block.harmonics or ()], dtype=float)
    return levels_of(features, np.array([block.rms]), harmonics, np.array([block.v_eq]))


def _interval_levels(settings: LibrarySettings) -> tuple[float, float, float]:
    """Return the levels of the lower end, the median and the upper end of the interval."""
    half = 0.5 * settings.interval
    return 0.5 - half, 0.5, 0.5 + half


def _forecast(sample: Array, threshold: float, moment: Moment, settings: LibrarySettings, *, below: bool) -> Remaining:
    """Return the forecast from an ascending sample of the time to a threshold, s, if V_eq grows.

    ``below`` is whether V_eq stands still below the threshold.
    """
    still = moment.p_no_growth
    lower, median, upper, *quantiles = quantiles_of(sample, (*_interval_levels(settings), *QUANTILES)).tolist()
    reached = float(np.mean(np.equal(sample, 0.0)))
    crossed = reached >= 0.5
    if below:
        return Remaining(float(threshold), TtStatus.NO_GROWTH, p_no_growth=still)
    if still > 0.5 * (1.0 - settings.interval) and not crossed:
        upper = math.inf
    within = math.nan if settings.window is None else float(np.mean(sample <= settings.window))
    status = TtStatus.OK if median <= settings.horizon else TtStatus.BEYOND_HORIZON
    if crossed:
        status, median = TtStatus.ALREADY_CROSSED, 0.0
    return Remaining(
        threshold=float(threshold),
        status=status,
        tt=median,
        tt_lower=lower,
        tt_upper=upper,
        t_threshold=math.nan if crossed else moment.t + median,
        p_threshold=reached + (1.0 - still) * (within - reached),
        p_no_growth=still,
        quantiles=tuple(zip(QUANTILES, quantiles, strict=True)),
    )
