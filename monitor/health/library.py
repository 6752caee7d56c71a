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
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.health.library_model import LINES, Library, levels_of, quantiles_of
from monitor.health.summaries import History

STATE_VERSION = 1
QUANTILES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Levels of the quantiles that are given for the archive."""

Array = NDArray[np.float64]


class LibraryStatus(StrEnum):
    """What became of one answer.

    ``ok``. ``already_crossed``: in at least half of the alike lives V_eq had reached the threshold; TT is zero then,
    its upper end need not be, and the probability stands beside it; it is judged anew at each block.
    ``beyond_horizon``: the median is later than the horizon; values are given. Without values: ``not_final_stage``;
    ``no_library``; ``bad_block``: V_eq of a block without usable figures (TT then says ``cannot_tell``);
    ``outside_conditions``: V_eq at a load or speed that the library does not span, or that change more from block to
    block than in its lives; ``outside_library``: levels, elapsed time or the time between blocks are not those of its
    lives (TT says so of load and speed too); ``too_few_points``: TT before ``min_points`` blocks.
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
    """How the library is asked.

    Attributes:
        features: "rms", "rms+harmonics" or, for a history of V_eq itself, "v_eq".
        interval: probability that lies between the lower and the upper end.
        window: time to the next maintenance, s, or None: then no probability of crossing within it is given.
        horizon: longest TT that is given as ``ok``, s.
        min_points: least number of blocks for a TT.
        neighbours: most alike moments of the library's lives, whose errors make the interval.
    """

    features: str = "rms+harmonics"
    interval: float = 0.8
    window: float | None = None
    horizon: float = 365 * 86400.0
    min_points: int = 5
    neighbours: int = 300

    def __post_init__(self) -> None:
        """Refuse what cannot be asked."""
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


@dataclass(frozen=True)
class ThresholdResult:
    """The forecast for one threshold; NaN wherever ``status`` says that there is no value.

    Attributes:
        threshold: V_th, m2.
        tt: median of the time to threshold, s of damage time; zero once crossed.
        tt_lower: lower end of its interval, s.
        tt_upper: upper end, s.
        p_threshold: probability that the threshold is reached within the window; NaN without a window.
        p_crossed: probability that it has been reached.
        t_threshold: when the median says that it is reached, s on the caller's clock; NaN once crossed.
        quantiles: of the time to threshold at ``QUANTILES``, s; () without a value.
        status: how the values came about, or why there are none.
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
    """What one block adds.

    Attributes:
        v_eq: median of V_eq, m2.
        v_eq_lower: lower end of its interval, m2.
        v_eq_upper: upper end, m2.
        v_eq_quantiles: at ``QUANTILES``, m2; () without a value.
        edv_status: how V_eq came about, or why there is none.
        forecasts: one a threshold, in their order.
        interval: probability between the lower and the upper ends.
        library: hash of the library, "" where there is none.
        prior: in words, what the answer leans on.
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
        return state, _nothing(None, thresholds, settings, LibraryStatus.NO_LIBRARY, LibraryStatus.NO_LIBRARY)
    targets = [library.target(threshold) for threshold in thresholds]
    fit = library.fit_for(settings.features)
    if not final_stage:
        stage = LibraryStatus.NOT_FINAL_STAGE
        return state, _nothing(library, thresholds, settings, stage, stage)
    if state.history is not None and (state.library, state.features) != (library.hash, settings.features):
        raise ValueError(
            f"the history was read with library {state.library[:16]} and features {state.features!r}, but asked is "
            f"library {library.hash[:16]} and features {settings.features!r}; start anew with LibraryState()"
        )
    if not _usable(block, settings.features):
        bad, cannot = LibraryStatus.BAD_BLOCK, LibraryStatus.CANNOT_TELL
        return state, _nothing(library, thresholds, settings, bad, cannot)
    outside = LibraryStatus.OUTSIDE_LIBRARY
    own_levels = settings.features == "v_eq"
    if not own_levels and not library.knows_conditions(block.load, block.speed):
        conditions = LibraryStatus.OUTSIDE_CONDITIONS
        return state, _nothing(library, thresholds, settings, conditions, outside)
    relative = fit.relative_levels(_levels(block, settings.features), np.array([block.load]), np.array([block.speed]))
    bounded, known = fit.bounded(relative[0])
    history = (state.history or History.empty(fit.channels)).add(float(block.t), bounded)
    changes = state.conditions if own_levels else state.conditions.add(block.load, block.speed)
    state = LibraryState(library.hash, settings.features, history, changes)
    if not library.knows_changes(*changes.spreads):
        return state, _nothing(library, thresholds, settings, LibraryStatus.OUTSIDE_CONDITIONS, outside)
    if not known or not fit.knows_pace(history):
        return state, _nothing(library, thresholds, settings, outside, outside)
    x = fit.inputs(history, block.load, block.speed)
    said = fit.regression.predict(x[None])[0]
    v_eq = fit.sample_v_eq(float(said[0]), float(x[0]), settings.neighbours)
    lower, median, upper, *quantiles = quantiles_of(v_eq, _levels_asked(settings))
    forecasts = tuple(
        _result(threshold, LibraryStatus.TOO_FEW_POINTS)
        if history.count < settings.min_points
        else _forecast(
            fit.sample_tt(target, float(said[target]), float(x[0]), settings.neighbours), block.t, threshold, settings
        )
        for threshold, target in zip(thresholds, targets, strict=True)
    )
    return state, LibraryResult(
        v_eq=float(median),
        v_eq_lower=float(lower),
        v_eq_upper=float(upper),
        v_eq_quantiles=tuple(map(float, quantiles)),
        edv_status=LibraryStatus.OK,
        forecasts=forecasts,
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


def _levels_asked(settings: LibrarySettings) -> tuple[float, ...]:
    half = 0.5 * settings.interval
    return (0.5 - half, 0.5, 0.5 + half, *QUANTILES)


def _forecast(sample: Array, t: float, threshold: float, settings: LibrarySettings) -> ThresholdResult:
    lower, median, upper, *quantiles = map(float, quantiles_of(sample, _levels_asked(settings)))
    crossed = float(np.mean(sample == 0.0))
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


def _result(threshold: float, status: LibraryStatus) -> ThresholdResult:
    nan = math.nan
    return ThresholdResult(float(threshold), nan, nan, nan, nan, nan, nan, (), status)


def _nothing(
    library: Library | None,
    thresholds: Sequence[float],
    settings: LibrarySettings,
    edv_status: LibraryStatus,
    tt_status: LibraryStatus,
) -> LibraryResult:
    """The answer without values."""
    nan = math.nan
    return LibraryResult(
        v_eq=nan,
        v_eq_lower=nan,
        v_eq_upper=nan,
        v_eq_quantiles=(),
        edv_status=edv_status,
        forecasts=tuple(_result(threshold, tt_status) for threshold in thresholds),
        interval=settings.interval,
        library="" if library is None else library.hash,
        prior="" if library is None else library.prior,
    )
