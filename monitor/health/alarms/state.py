"""What is configured of alarms, what they are told, what they carry from block to block, and what they give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from monitor.health.codec import StoredState
from monitor.health.onset import HEALTHY

NORMAL, MAINTENANCE, OUT_OF_SPECIFICATION = "normal", "maintenance_required", "out_of_specification"
CHECK, FAILURE, NO_DATA, BAD_DATA = "check_function", "failure", "no_data", "bad_data"
SEVERITIES = ("alert", "danger")
Span = tuple[float, float]


@dataclass(frozen=True)
class Level:
    """Where an alert or a danger begins: exactly one of the three.

    Attributes:
        value: SI.
        factor: times the median of the learning stage.
        deviations: standard deviations above that median, in the logarithm.
    """

    value: float | None = None
    factor: float | None = None
    deviations: float | None = None


@dataclass(frozen=True)
class Rule:
    """One feature and its levels.

    Attributes:
        name: unique in its channel.
        feature: key of the value in a record.
        hysteresis: share of the level by which a value must return.
        on_delay: consecutive usable blocks at or beyond the level that raise it.
        off_delay: consecutive usable blocks back beyond the hysteresis that clear it.
        speed: range of shaft speeds, Hz, or None for all.
        load: range of loads, N, or None for all.
        drift: standard deviation of the healthy drift of the logarithm; part of ``deviations``.
        suspended: whether its levels have no meaning on this machine's scale; it then raises nothing, and a tracked
            V_eq puts the channel out of specification.
    """

    name: str
    feature: str
    side: Literal["above", "below"] = "above"
    alert: Level | None = None
    danger: Level | None = None
    hysteresis: float = 0.1
    on_delay: int = 3
    off_delay: int = 3
    latch: bool = False
    speed: Span | None = None
    load: Span | None = None
    drift: float = 0.1
    suspended: bool = False

    @property
    def is_relative(self) -> bool:
        """Whether its levels follow from the baseline."""
        return all(level is None or level.value is None for level in (self.alert, self.danger))


@dataclass(frozen=True)
class AlarmSettings:
    """Rules of a channel, and its criterion of bad data.

    Attributes:
        run_in_blocks: first usable blocks, left out of the learned levels.
        window: latest blocks among which bad ones are counted.
        bad_share: share of them from which the channel is in ``bad_data``.
    """

    rules: tuple[Rule, ...] = ()
    run_in_blocks: int = 0
    window: int = 20
    bad_share: float = 0.5

    @property
    def suspended(self) -> tuple[str, ...]:
        """Names of the rules that are suspended."""
        return tuple(rule.name for rule in self.rules if rule.suspended)


@dataclass(frozen=True)
class AlarmInput:
    """What the alarms use of one block.

    Attributes:
        usable: its values count: neither rejected nor of a stopped machine.
        bad: it counts as bad data; standstill does not.
        stage: of life, one of ``monitor.health.onset.STAGES``.
        values: of the record, SI; of several (thresholds, bands) the worst counts.
        baselines: median and robust SD of the logarithm, by feature, from the detector.
        closed: the final stage closed with this block.
        at_reference: by feature whose level depends on speed and load, its value as it were at the reference condition
            of the baseline, None where that is not known: levels that follow from the baseline are compared with it.
    """

    sequence: int
    usable: bool
    bad: bool
    stage: str = HEALTHY
    values: Mapping[str, Any] = field(default_factory=dict[str, Any])
    baselines: Mapping[str, Span] = field(default_factory=dict[str, Span])
    closed: bool = False
    at_reference: Mapping[str, float | None] = field(default_factory=dict[str, float | None])


@dataclass(frozen=True)
class AlarmAcknowledgement:
    """Acknowledgement of an alarm: ``sequence`` is the block that raised it, ``utc`` in s since 1970."""

    channel: str
    rule: str
    severity: str
    sequence: int
    utc: float


@dataclass(frozen=True)
class LevelState:
    """State of a level; ``since`` is the block that raised it, ``held`` its latch."""

    active: bool = False
    count: int = 0
    since: int | None = None
    held: bool = False

    @property
    def shown(self) -> bool:
        """Whether the alarm is shown: exceeded, or waiting for an acknowledgement."""
        return self.active or self.held


@dataclass(frozen=True)
class RuleState:
    """State of a rule: logarithms are ``learned`` until the stage ends and gives a ``baseline``."""

    learned: tuple[float, ...] = ()
    baseline: Span | None = None
    alert: LevelState = field(default_factory=LevelState)
    danger: LevelState = field(default_factory=LevelState)


@dataclass(frozen=True)
class AlarmState(StoredState):
    """State of the alarms of a channel; version 1."""

    VERSIONS = (1,)

    version: int = VERSIONS[-1]
    seen: int = 0
    recent_bad: tuple[bool, ...] = ()
    refusing: bool = False
    rules: Mapping[str, RuleState] = field(default_factory=dict[str, RuleState])
    condition: str = CHECK

    def level(self, rule: str, severity: str) -> LevelState:
        """Return the state of a level, a fresh one for a new rule."""
        known = self.rules.get(rule)
        return LevelState() if known is None else getattr(known, severity)


@dataclass(frozen=True)
class Change:
    """A change of an alarm, with value and level compared, SI; "withdrawn" has neither, but the block it is since."""

    kind: Literal["raised", "cleared", "withdrawn"]
    rule: str
    feature: str
    severity: str
    value: float | None
    level: float | None
    since: int | None = None


@dataclass(frozen=True)
class AlarmOutput:
    """Changes by one block, and the status of the channel (NAMUR NE 107, or ``bad_data``)."""

    changes: tuple[Change, ...]
    condition: str
    condition_before: str
