"""``[alarms]``: levels with their units, and when data count as bad; ``[advice]``: what to do about them."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from monitor.config.fields import Band, ConfigSection, Count, Name, Positive
from monitor.health.alarms import AlarmSettings, Level, Rule
from monitor.words.advice import ADVICE, check_advice
from monitor.words.features import LEVELS

_ENDINGS = ("", "_g", "_mm_s", "_mm2", "_hours", "_factor", "_sd")


class AlarmLevel(ConfigSection):
    """Alert and danger of one quantity: given (``alert_g``, ``alert_mm2``, ``alert_hours``, ``alert``) or learned.

    ``alert_factor`` is a multiple of the median of the learning stage, ``alert_sd`` a number of standard deviations
    above it.
    """

    name: Name | None = None
    feature: Literal[tuple(LEVELS)]  # pyright: ignore[reportInvalidTypeForm]  # the table is the one list
    channels: tuple[Name, ...] = ()
    alert: Positive | None = None
    alert_g: Positive | None = None
    alert_mm_s: Positive | None = None
    alert_mm2: Positive | None = None
    alert_hours: Positive | None = None
    alert_factor: Positive | None = None
    alert_sd: Positive | None = None
    danger: Positive | None = None
    danger_g: Positive | None = None
    danger_mm_s: Positive | None = None
    danger_mm2: Positive | None = None
    danger_hours: Positive | None = None
    danger_factor: Positive | None = None
    danger_sd: Positive | None = None
    hysteresis: Annotated[float, Field(ge=0, lt=1)] = Rule.hysteresis
    on_delay_blocks: Count = Rule.on_delay
    off_delay_blocks: Count = Rule.off_delay
    latch: bool = Rule.latch
    speed_range_hz: Band | None = None
    load_range_newton: Band | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        feature = LEVELS[self.feature]
        unit, _ = feature.level
        learned = ("_factor", "_sd") if feature.learned else ()
        found = {severity: self._given(severity) for severity in ("alert", "danger")}
        for severity, endings in found.items():
            for ending in endings:
                if ending not in (unit, *learned):
                    allowed = ", ".join(f"{severity}{item}" for item in (unit, *learned))
                    raise ValueError(f"{severity}{ending} does not fit feature {self.feature!r}; allowed is {allowed}")
            if len(endings) > 1:
                raise ValueError(f"give one of {', '.join(severity + item for item in endings)}")
        if not any(found.values()):
            raise ValueError(f"feature {self.feature!r} has neither alert{unit} nor danger{unit}")
        if found["alert"] and found["alert"] == found["danger"]:
            ending = found["alert"][0]
            alert, danger = getattr(self, f"alert{ending}"), getattr(self, f"danger{ending}")
            in_order = danger < alert if feature.bad == "below" else danger > alert
            if not in_order:
                raise ValueError(f"danger{ending} = {danger:g} must be {feature.bad} alert{ending} = {alert:g}")
        for key in ("speed_range_hz", "load_range_newton"):
            span = getattr(self, key)
            if span is not None and span[0] >= span[1]:
                raise ValueError(f"{key}: the lower end must be below the upper end")
        return self

    def _given(self, severity: str) -> list[str]:
        return [ending for ending in _ENDINGS if getattr(self, f"{severity}{ending}") is not None]

    def _level(self, severity: str) -> Level | None:
        given = self._given(severity)
        if not given:
            return None
        value = getattr(self, f"{severity}{given[0]}")
        if given[0] == "_factor":
            return Level(factor=value)
        if given[0] == "_sd":
            return Level(deviations=value)
        return Level(value=value * LEVELS[self.feature].level[1])

    @property
    def rule_name(self) -> str:
        """Name of the rule: as configured, else that of the feature."""
        return self.name or self.feature

    def to_rule(self) -> Rule:
        """Return the rule in SI."""
        return Rule(
            name=self.rule_name,
            feature=self.feature,
            side=LEVELS[self.feature].bad or "above",
            alert=self._level("alert"),
            danger=self._level("danger"),
            hysteresis=self.hysteresis,
            on_delay=self.on_delay_blocks,
            off_delay=self.off_delay_blocks,
            latch=self.latch,
            speed=self.speed_range_hz,
            load=self.load_range_newton,
        )


class AlarmsSection(ConfigSection):
    """Levels, and when the data of a channel count as bad."""

    level: tuple[AlarmLevel, ...] = ()
    bad_data_window_blocks: Annotated[int, Field(ge=1, le=10000)] = AlarmSettings.window
    bad_data_share: Annotated[float, Field(gt=0, le=1)] = AlarmSettings.bad_share

    def check_channels(self, channels: tuple[str, ...]) -> None:
        """Refuse levels of unknown channels, and two levels of one name on one channel.

        Raises:
            ValueError: naming the level.
        """
        for level in self.level:
            unknown = [name for name in level.channels if name not in channels]
            if unknown:
                raise ValueError(
                    f"[[alarms.level]] {level.rule_name}: channel {unknown[0]!r} is not one of {', '.join(channels)}"
                )
        for channel in channels:
            names = [level.rule_name for level in self.level if not level.channels or channel in level.channels]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(
                    f"[[alarms.level]] {twice[0]!r} is given twice for channel {channel!r}: give it a name"
                )

    def to_settings(
        self, channel: str, run_in_blocks: int, *, absolute_volume: bool = True, of_threshold: bool = True
    ) -> AlarmSettings:
        """Return the settings of one channel.

        Without an ``absolute_volume`` (the rig is not calibrated), rules that compare V_eq with one are suspended;
        those of TT only where it is ``of_threshold``, and not of the end of recorded runs.
        """
        rules = tuple(level.to_rule() for level in self.level if not level.channels or channel in level.channels)
        if not absolute_volume:
            volumes = {name for name, feature in LEVELS.items() if feature.needs_calibration}
            if not of_threshold:
                volumes = {name for name in volumes if LEVELS[name].units == "m2"}
            rules = tuple(replace(rule, suspended=rule.feature in volumes) for rule in rules)
        return AlarmSettings(rules, run_in_blocks, self.bad_data_window_blocks, self.bad_data_share)


def _checked(text: str) -> str:
    check_advice(text)
    if not text.isprintable():
        raise ValueError("expected one line of text")
    return text


Advice = Annotated[str, Field(max_length=500), AfterValidator(_checked)]


class AdviceSection(ConfigSection):
    """One line of text for each state, with the places of ``monitor.words.advice.PLACES`` in braces."""

    normal: Advice = ADVICE["normal"]
    learning: Advice = ADVICE["learning"]
    watch: Advice = ADVICE["watch"]
    gear: Advice = ADVICE["gear"]
    warning: Advice = ADVICE["warning"]
    danger: Advice = ADVICE["danger"]
    end_of_life: Advice = ADVICE["end_of_life"]
    sensor_fault: Advice = ADVICE["sensor_fault"]
    no_data: Advice = ADVICE["no_data"]

    @property
    def texts(self) -> dict[str, str]:
        """The text of each state."""
        return {name: getattr(self, name) for name in ADVICE}
