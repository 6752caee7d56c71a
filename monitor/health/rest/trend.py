"""One block through the time to the alarm level (TTA): which level it is, the levels since the onset, the answer.

The level is that of the channel's first alarm rule on RMS: its alert while that is not reached, then its danger.
Without such a rule it is four times the learned baseline. A level is reached as the alarm is raised: by ``on_delay``
blocks in a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from monitor.health.alarms import SEVERITIES, AlarmSettings, Level, LevelState, Rule, applies, limit_of, move_level
from monitor.health.codec import StoredState
from monitor.health.rest.growth import LevelCrossing, crossing, segments
from monitor.health.rest.learned.history import StageHistory
from monitor.health.size import RemainingSettings

DEFAULT_FACTOR = 4.0
DEFAULT_RULE = Rule(name="default", feature="rms", alert=Level(factor=DEFAULT_FACTOR))
"""Where no rule on RMS is configured."""
DEFAULT = "default"
LEVEL_SOURCES = (*SEVERITIES, DEFAULT)
MIN_BLOCKS = 6
"""Blocks since the onset below which no trend is told."""
TREND_AHEAD = 3.0
"""Elapsed times for which a trend is continued: one that does not reach the level by then is none."""
MIN_NOISE = 0.03
"""Least standard deviation of ln RMS from block to block."""


class TtaStatus(StrEnum):
    """Outcome of one block. Append only: the integers of published files follow the order.

    Values come with ``ok``, ``reached`` (zero) and ``beyond_horizon``. Without: ``no_trend``: the levels do not grow,
    or reach the level within three times the time since the onset with a probability below a half; ``too_few_points``:
    fewer than six blocks since the onset, or no time has passed; ``not_final_stage``; ``learning``: no baseline yet;
    ``no_level``: the rule does not apply at this speed or load, or its level was not learned there; ``bad_block``: the
    block gives no level (its quality, or a stopped machine); ``episode_closed``: with this block the final stage closed
    again.
    """

    OK = "ok"
    REACHED = "reached"
    NO_TREND = "no_trend"
    TOO_FEW_POINTS = "too_few_points"
    NOT_FINAL_STAGE = "not_final_stage"
    LEARNING = "learning"
    BEYOND_HORIZON = "beyond_horizon"
    NO_LEVEL = "no_level"
    BAD_BLOCK = "bad_block"
    EPISODE_CLOSED = "episode_closed"


@dataclass(frozen=True)
class TrendInput:
    """What the stage uses of one block.

    Attributes:
        sequence: number of the block.
        time: that the machine ran, s; may repeat, may not go back.
        rms: in the unit of the channel; as it were at the reference condition of the baseline where it depends on that.
        usable: the block gives a level: its quality allows it, and the machine runs.
        baseline: median and robust standard deviation of ln RMS of the healthy machine, or None while learning.
        elevated: the level stands above the baseline, so that the final stage may have begun.
        final: the final stage is known to have begun.
        closed: it closed with this block.
        speed: Hz, or None.
        load: N, or None.
        outside: the block is at a condition at which the level cannot be compared with the baseline.
    """

    sequence: int
    time: float
    rms: float
    usable: bool = True
    baseline: tuple[float, float] | None = None
    elevated: bool = False
    final: bool = False
    closed: bool = False
    speed: float | None = None
    load: float | None = None
    outside: bool = False


@dataclass(frozen=True)
class TimeToAlarm:
    """Time to the alarm level after one block; NaN wherever ``status`` says that there is no value.

    Attributes:
        tta: median, s of time that the machine runs; zero once reached.
        tta_lower: lower end of the interval, s.
        tta_upper: upper end, s; infinite beyond a hundred times the time since the onset.
        level: RMS in the unit of the channel; NaN where none is known.
        source: "alert", "danger" or "default", None where no level is known.
        p_no_growth: probability that the level does not grow.
    """

    status: TtaStatus
    tta: float = math.nan
    tta_lower: float = math.nan
    tta_upper: float = math.nan
    level: float = math.nan
    source: str | None = None
    p_no_growth: float = math.nan


@dataclass(frozen=True)
class TrendState(StoredState):
    """State of the stage, of bounded size.

    Attributes:
        history: ln RMS since the onset, or since the level stands above the baseline; None before.
        alert: whether the first level of the rule is reached, and the blocks that count towards it.
        danger: the same of the second.
    """

    VERSIONS = (1,)

    history: StageHistory | None = None
    alert: LevelState = field(default_factory=LevelState)
    danger: LevelState = field(default_factory=LevelState)
    version: int = VERSIONS[-1]


@dataclass(frozen=True)
class _Target:
    """The level to be reached next; ``reached`` where there is none beyond it."""

    level: float
    source: str
    reached: bool


def step(
    state: TrendState, block: TrendInput, alarms: AlarmSettings, settings: RemainingSettings | None = None
) -> tuple[TrendState, TimeToAlarm]:
    """Take one block into the state; return the time to the alarm level.

    Args:
        alarms: rules of the channel.

    Raises:
        ValueError: a time that is not finite or goes back.
    """
    settings = settings or RemainingSettings()
    latest = -math.inf if state.history is None else state.history.latest
    if not math.isfinite(block.time) or block.time < latest:
        raise ValueError(f"time must be finite and may not go back, got {block.time:g} after {latest:g}")
    rule = rule_of(alarms)
    if block.closed:
        return TrendState(alert=state.alert, danger=state.danger), TimeToAlarm(TtaStatus.EPISODE_CLOSED)
    if block.usable and block.outside:
        return state, TimeToAlarm(TtaStatus.NO_LEVEL)
    if not (block.usable and math.isfinite(block.rms) and block.rms > 0.0):
        return state, TimeToAlarm(TtaStatus.BAD_BLOCK)
    if not applies(rule, {"speed": block.speed, "load": block.load}):
        return state, TimeToAlarm(TtaStatus.NO_LEVEL)
    state = _count(_remember(state, block), rule, block)
    target = _target(state, rule, block.baseline)
    if target is None:
        return state, TimeToAlarm(TtaStatus.LEARNING)
    return state, _answer(state, block, target, settings)


def rule_of(alarms: AlarmSettings) -> Rule:
    """Return the first rule on RMS, or the default one."""
    found = (rule for rule in alarms.rules if rule.feature == "rms" and rule.side == "above" and not rule.suspended)
    return next(found, DEFAULT_RULE)


def _remember(state: TrendState, block: TrendInput) -> TrendState:
    """Add a block to the levels since the onset; the onset is where the level began to stand above the baseline."""
    if not (block.final or block.elevated):
        return state if state.history is None else TrendState(alert=state.alert, danger=state.danger)
    history = state.history or StageHistory.begin(block.time)
    return TrendState(history.add(block.time, math.log(block.rms)), state.alert, state.danger)


def _count(state: TrendState, rule: Rule, block: TrendInput) -> TrendState:
    """Count the block towards the levels of the rule."""
    counted: dict[str, LevelState] = {}
    for severity in SEVERITIES:
        limit = limit_of(rule, getattr(rule, severity), block.baseline)
        if limit is not None:
            counted[severity] = move_level(getattr(state, severity), rule, block.rms, limit, block.sequence)
    return TrendState(state.history, counted.get("alert", state.alert), counted.get("danger", state.danger))


def _target(state: TrendState, rule: Rule, baseline: tuple[float, float] | None) -> _Target | None:
    """Return the first level that is not reached, else the last one; None while none is known."""
    target: _Target | None = None
    for severity in SEVERITIES:
        limit = limit_of(rule, getattr(rule, severity), baseline)
        if limit is None:
            continue
        reached = getattr(state, severity).active
        target = _Target(limit, DEFAULT if rule is DEFAULT_RULE else severity, reached)
        if not reached:
            break
    return target


def _answer(state: TrendState, block: TrendInput, target: _Target, settings: RemainingSettings) -> TimeToAlarm:
    """Return the answer for a block that is in the state."""
    history, baseline = state.history, block.baseline

    def without(status: TtaStatus) -> TimeToAlarm:
        return TimeToAlarm(status, level=target.level, source=target.source)

    if target.reached:
        return replace(without(TtaStatus.REACHED), tta=0.0, tta_lower=0.0, tta_upper=0.0)
    if baseline is None:
        return without(TtaStatus.LEARNING)
    if not block.final or history is None:
        return without(TtaStatus.NOT_FINAL_STAGE)
    if history.count < MIN_BLOCKS or history.elapsed <= 0.0:
        return without(TtaStatus.TOO_FEW_POINTS)
    found = crossing_of(history, baseline, target.level)
    if found.p_no_growth >= 0.5 or found.probability_of_trend(TREND_AHEAD) < 0.5:
        return replace(without(TtaStatus.NO_TREND), p_no_growth=found.p_no_growth)
    half = 0.5 * settings.interval
    lower, median, upper = (history.elapsed * found.quantile(level) for level in (0.5 - half, 0.5, 0.5 + half))
    return TimeToAlarm(
        TtaStatus.OK if median <= settings.horizon else TtaStatus.BEYOND_HORIZON,
        median,
        lower,
        upper,
        target.level,
        target.source,
        found.p_no_growth,
    )


def crossing_of(history: StageHistory, baseline: tuple[float, float], level: float) -> LevelCrossing:
    """Return when a level is reached, RMS in the unit of the history; its elapsed time must be positive."""
    ln_baseline, noise = baseline
    times, levels, blocks = points_of(history)
    shares = np.minimum(times / history.elapsed, 1.0)
    now = history.level - ln_baseline
    distance = math.log(level) - history.level
    return crossing(*segments(shares, levels - ln_baseline, blocks), now, distance, max(noise, MIN_NOISE))


def points_of(history: StageHistory) -> NDArray[np.float64]:
    """Return times since the onset, levels and blocks of the bins of a history, shape (3, n)."""
    time, total, filling = history.filling
    rows = [(at, level, history.bin_blocks) for at, level in history.bins]
    if filling:
        rows.append((time / filling, total / filling, filling))
    return np.array(rows, dtype=np.float64).T
