"""What the library forecaster is asked and answers, and how a sample becomes an answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from monitor.health.damage.library.model import Array, Library, quantiles_of

QUANTILES = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Levels of the quantiles that are given for the archive."""


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


def levels_asked(settings: LibrarySettings) -> tuple[float, ...]:
    """Return the levels of the lower end, the median and the upper end of the interval, then ``QUANTILES``."""
    half = 0.5 * settings.interval
    return (0.5 - half, 0.5, 0.5 + half, *QUANTILES)


def forecast_of(sample: Array, t: float, threshold: float, settings: LibrarySettings) -> ThresholdResult:
    """Return the forecast that an ascending sample of the time to a threshold (s) makes at a time."""
    lower, median, upper, *quantiles = map(float, quantiles_of(sample, levels_asked(settings)))
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


def empty_forecast(threshold: float, status: LibraryStatus) -> ThresholdResult:
    """Return the forecast without values."""
    nan = math.nan
    return ThresholdResult(float(threshold), nan, nan, nan, nan, nan, nan, (), status)


def nothing(
    library: Library | None,
    thresholds: Sequence[float],
    settings: LibrarySettings,
    edv_status: LibraryStatus,
    tt_status: LibraryStatus,
) -> LibraryResult:
    """Return the answer without values."""
    nan = math.nan
    return LibraryResult(
        v_eq=nan,
        v_eq_lower=nan,
        v_eq_upper=nan,
        v_eq_quantiles=(),
        edv_status=edv_status,
        forecasts=tuple(empty_forecast(threshold, tt_status) for threshold in thresholds),
        interval=settings.interval,
        library="" if library is None else library.hash,
        prior="" if library is None else library.prior,
    )
