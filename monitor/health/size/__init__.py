"""V_eq and the time to threshold (TT): what the methods take of a block, what they give, and the statuses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class EdvStatus(StrEnum):
    """Outcome of one block for V_eq. Append only: the integers of published files follow the order.

    Values come with ``ok``, ``widened`` (the search went back, so V_eq may be lower than before) and ``ambiguous`` (the
    volumes are of two kinds, or far apart). Without values: ``below_map`` and ``above_map``: no defect of the map has
    this RMS, or the damage has grown beyond the map; ``no_map``: there is none, or none of the named part, or a hole of
    it covers the level; ``bad_block``: no usable features; ``outside_conditions``: a load or speed outside the map or
    the library, or that changes more between blocks than in the library's lives; ``outside_library``: levels, elapsed
    time or block interval outside its lives. ``uncalibrated`` replaces ``ok`` where the rig is not calibrated: V_eq is
    given, on the scale of the model. ``episode_closed``: with this block the final stage closed again. Without values
    also ``implausible``: no growth of damage gives this block after the ones before it (a gain that changed, noise,
    lines that do not belong to the RMS), ``not_this_part``: there is no map or library of the named part, and
    ``velocity_sensor``: maps and libraries hold the RMS of acceleration over all frequencies, which such a sensor does
    not give.
    """

    OK = "ok"
    WIDENED = "widened"
    BELOW_MAP = "below_map"
    ABOVE_MAP = "above_map"
    NO_MAP = "no_map"
    NO_LIBRARY = "no_library"
    NOT_FINAL_STAGE = "not_final_stage"
    BAD_BLOCK = "bad_block"
    AMBIGUOUS = "ambiguous"
    OUTSIDE_CONDITIONS = "outside_conditions"
    OUTSIDE_LIBRARY = "outside_library"
    NO_ABSOLUTE_LEVEL = "no_absolute_level"
    UNCALIBRATED = "uncalibrated"
    EPISODE_CLOSED = "episode_closed"
    IMPLAUSIBLE = "implausible"
    NOT_THIS_PART = "not_this_part"
    VELOCITY_SENSOR = "velocity_sensor"


class TtStatus(StrEnum):
    """Outcome of one forecast. Append only: the integers of published files follow the order.

    Values come with ``ok`` (also where the curve bends down but reaches the threshold first), ``already_crossed`` (TT
    is zero; by the library, judged anew at each block: at least half of the similar lives had reached the threshold)
    and ``beyond_horizon``. Without values: ``too_few_points``: too few for a fit; ``no_crossing``: the curve is flat or
    falls in a straight line; ``concave``: it turns back below the threshold; ``crossing_in_past``: it reached the
    threshold before now, though V_eq has not; ``cannot_tell``: no usable features; ``outside_library``: load, speed,
    levels, elapsed time or block interval outside the library's lives (learned: elapsed time or level beyond the runs,
    with the values of the elapsed time alone); ``uncalibrated``: the rig is not calibrated, so
    that V_eq is not compared with the threshold. Where that is asked for, it replaces ``ok`` alone, with values;
    ``episode_closed``: with this block the final stage closed again, and what was forecast in it is void;
    ``no_growth``: V_eq stands still with a probability (``p_no_growth``) of at least a half for some blocks, and the
    threshold is not reached while it does.
    """

    OK = "ok"
    NOT_FINAL_STAGE = "not_final_stage"
    TOO_FEW_POINTS = "too_few_points"
    NO_CROSSING = "no_crossing"
    CONCAVE = "concave"
    CROSSING_IN_PAST = "crossing_in_past"
    ALREADY_CROSSED = "already_crossed"
    BEYOND_HORIZON = "beyond_horizon"
    NO_LIBRARY = "no_library"
    OUTSIDE_LIBRARY = "outside_library"
    CANNOT_TELL = "cannot_tell"
    UNCALIBRATED = "uncalibrated"
    EPISODE_CLOSED = "episode_closed"
    NO_GROWTH = "no_growth"


_KEPT = ("time", "rms", "harmonics", "load", "speed", "speed_range", "reference_rms")


@dataclass(frozen=True)
class DamageInput:
    """What the methods use of one block.

    Attributes:
        time: damage time, s; may repeat, may not go back.
        rms: in the band of the map or the library, m/s2.
        harmonics: amplitudes of the BPFO lines from the first on, m/s2, or None where unresolved.
        load: N, or None.
        speed: Hz, or None.
        v_eq: m2; of a history of V_eq itself, which only the library takes.
        speed_range: least and highest speed in the block, Hz; None: one speed as far as is known.
        reference_rms: RMS as it were at the detector's reference condition, m/s2: 0 where that is not known, None where
            RMS does not depend on the condition.
    """

    time: float
    rms: float = math.nan
    harmonics: tuple[float, ...] | None = None
    load: float | None = None
    speed: float | None = None
    v_eq: float = math.nan
    speed_range: tuple[float, float] | None = None
    reference_rms: float | None = None

    def to_list(self) -> list[Any]:
        """Return the block as plain values for JSON; ``v_eq`` is not kept."""
        return [getattr(self, name) for name in _KEPT]

    @classmethod
    def from_list(cls, stored: Sequence[Any]) -> DamageInput:
        """Restore what :meth:`to_list` gave; what an older version did not keep is not known."""
        values = dict(zip(_KEPT, stored, strict=False))
        for name in ("harmonics", "speed_range"):
            if values.get(name) is not None:
                values[name] = tuple(values[name])
        return cls(**values)


@dataclass(frozen=True)
class Damage:
    """V_eq after one block; NaN wherever ``status`` says that there is no value.

    Attributes:
        v_eq: volume per width, m2 (1 mm3/mm is 1e-6 m2); the median where there is an interval.
        v_eq_lower: lower end of its interval, m2.
        dphi_d: extent of the equivalent defect, rad.
        h_d: its depth, m.
        rms_smoothed: trailing mean of the RMS (thesis only), m/s2.
        v_eq_relative: ``v_eq`` over the first value that was tracked for this part.
        p_no_growth: probability that V_eq stands still; NaN where the method does not give it.
        v_eq_filter: V_eq by the filter, where it runs beside the library, m2.
        v_eq_filter_lower: lower end of its interval, m2.
        v_eq_filter_upper: upper end, m2.
    """

    status: EdvStatus
    v_eq: float = math.nan
    v_eq_lower: float = math.nan
    v_eq_upper: float = math.nan
    dphi_d: float = math.nan
    h_d: float = math.nan
    rms_smoothed: float = math.nan
    v_eq_relative: float = math.nan
    p_no_growth: float = math.nan
    v_eq_filter: float = math.nan
    v_eq_filter_lower: float = math.nan
    v_eq_filter_upper: float = math.nan


@dataclass(frozen=True)
class Remaining:
    """One forecast for one threshold; NaN wherever ``status`` says that there is no value.

    What is learned from recorded runs is a forecast of their kind of end, and not of a threshold.

    Attributes:
        threshold: V_th, m2.
        tt: s of damage time, zero once crossed; the median where there is an interval.
        tt_lower: lower end of its interval, s; with ``tt_upper`` under the condition that V_eq grows.
        tt_upper: upper end, s; infinite where V_eq stands still with a larger probability than that of the upper tail.
        t_threshold: when the threshold is reached, s on the blocks' clock; also given with ``crossing_in_past``.
        p_threshold: probability of that within the maintenance window; NaN without a window.
        p_no_growth: probability that V_eq stands still; NaN where the method does not give it.
        p_crossed: probability that a further run ends at or below the present level (learned only).
        coefficients: of the thesis' quadratic: a in m2/s2, b in m2/s, c in m2, time from the first point.
        r_squared: coefficient of determination of its fit.
        quantiles: (probability, TT in s) pairs; () without an interval.
    """

    threshold: float
    status: TtStatus
    tt: float = math.nan
    tt_lower: float = math.nan
    tt_upper: float = math.nan
    t_threshold: float = math.nan
    p_threshold: float = math.nan
    p_no_growth: float = math.nan
    p_crossed: float = math.nan
    coefficients: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    r_squared: float = math.nan
    quantiles: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class RemainingSettings:
    """Settings of a forecast with an interval.

    Attributes:
        interval: probability between the lower and the upper end.
        window: time to the next maintenance, s, or None.
        horizon: longest median that is given as ``ok``, s.
    """

    interval: float = 0.8
    window: float | None = None
    horizon: float = 365 * 86400.0

    def __post_init__(self) -> None:
        """Raise ValueError naming the setting that is out of range."""
        if not 0.0 < self.interval < 1.0:
            raise ValueError(f"interval must lie between 0 and 1, got {self.interval}")
        if self.window is not None and not self.window > 0.0:
            raise ValueError(f"window must be positive, or None, got {self.window}")
        if not self.horizon > 0.0:
            raise ValueError(f"horizon must be positive, got {self.horizon}")
