"""``[detect]``, ``[track]`` and ``[forecast]``: settings of the health stages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

from pydantic import Field, field_validator, model_validator

from monitor.config.fields import Blocks, ConfigSection, Positive
from monitor.health.onset import FEATURES, DetectSettings, LevelsBy
from monitor.health.size.filter.prior import GrowthPrior
from monitor.health.tracker import ForecastMethod, TrackMethod
from streams.types.block import STANDARD_GRAVITY

Method = TypeVar("Method", TrackMethod, ForecastMethod)


def method_or_best(method: Method | None, library: object) -> Method:
    """Return the chosen method; without one, the library, or the method of the thesis if ``library`` is None."""
    return method or ("thesis" if library is None else "library")


class DetectSection(ConfigSection):
    """How the start of the final stage and the end of life are detected."""

    learn_blocks: Annotated[int, Field(ge=10, le=100000)] | None = None
    learn_hours: Positive | None = None
    run_in_blocks: Annotated[int, Field(ge=0)] = DetectSettings.run_in_blocks
    features: tuple[Literal[FEATURES], ...] = FEATURES  # pyright: ignore[reportInvalidTypeForm]  # the one list
    false_alarms_per_1000_blocks: Annotated[float, Field(ge=1e-6, le=100)] = DetectSettings.false_alarms_per_1000_blocks
    persist_blocks: Blocks = DetectSettings.persist_blocks
    close_blocks: Blocks = DetectSettings.close_blocks
    rms_drift: Annotated[float, Field(ge=0, le=2)] = DetectSettings.rms_drift
    h_or_drift: Annotated[float, Field(ge=0, le=2)] = DetectSettings.h_or_drift
    end_of_life_peak_g: Positive = 20.0
    end_of_life_blocks: Blocks = DetectSettings.end_of_life_blocks
    levels_by: LevelsBy = DetectSettings.levels_by
    """Conditions of which levels are taken relative to what is learned; "auto": of those that vary while learning."""

    @field_validator("features")
    @classmethod
    def _with_rms(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if "rms" not in value or len(set(value)) != len(value):
            raise ValueError(f'must hold "rms", and each of {", ".join(FEATURES)} at most once')
        return value

    @model_validator(mode="after")
    def _one_length(self) -> Self:
        if self.learn_blocks is not None and self.learn_hours is not None:
            raise ValueError("give learn_blocks or learn_hours, not both")
        return self

    def to_settings(self) -> DetectSettings:
        """Return the settings in SI."""
        learn_blocks = self.learn_blocks
        if learn_blocks is None and self.learn_hours is None:
            learn_blocks = DetectSettings.learn_blocks
        return DetectSettings(
            learn_blocks=learn_blocks,
            learn_time=None if self.learn_hours is None else self.learn_hours * 3600.0,
            run_in_blocks=self.run_in_blocks,
            false_alarms_per_1000_blocks=self.false_alarms_per_1000_blocks,
            features=self.features,
            persist_blocks=self.persist_blocks,
            close_blocks=self.close_blocks,
            rms_drift=self.rms_drift,
            h_or_drift=self.h_or_drift,
            end_of_life_peak=self.end_of_life_peak_g * STANDARD_GRAVITY,
            end_of_life_blocks=self.end_of_life_blocks,
            levels_by=self.levels_by,
        )


class TrackSection(ConfigSection):
    """How the features of a block become the equivalent damaged volume.

    The default method is the library where the channel has one, else the method of the thesis. ``growth_per_hour`` is
    the filter's prior: the mean growth until V_eq reaches 0.05 mm3/mm, as a share of that.
    """

    method: TrackMethod | None = None
    features: tuple[Literal["rms", "harmonics"], ...] = ("rms", "harmonics")
    smoothing_blocks: Blocks = 6
    growth_per_hour: tuple[Positive, Positive] | None = None

    @field_validator("growth_per_hour")
    @classmethod
    def _ascending(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and value[0] >= value[1]:
            raise ValueError(f"must be [lowest, highest], got {list(value)}")
        return value

    @property
    def growth(self) -> GrowthPrior:
        """The prior of the growth that the filter takes."""
        if self.growth_per_hour is None:
            return GrowthPrior()
        slowest, fastest = self.growth_per_hour
        return GrowthPrior(durations=(3600.0 / fastest, 3600.0 / slowest))

    @field_validator("features")
    @classmethod
    def _with_rms(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if "rms" not in value or len(set(value)) != len(value):
            raise ValueError('must be ["rms"] or ["rms", "harmonics"]')
        return value


class ForecastSection(ConfigSection):
    """How the history up to now becomes a time to threshold.

    The default method is the library where the channel has one, else the method of the thesis. ``library`` is what
    ``library learn`` made, for "learned" and "combined". ``uncalibrated_threshold`` takes thresholds of V_eq
    on the scale of a rig that is not calibrated.
    """

    method: ForecastMethod | None = None
    threshold_mm2: Positive | tuple[Positive, ...] = 0.05
    interval: Annotated[float, Field(ge=0.5, le=0.98)] = 0.8
    window_hours: Positive | None = None
    uncalibrated_threshold: bool = False
    library: Path | None = None

    @model_validator(mode="after")
    def _of_method(self) -> Self:
        learns = self.method in ("learned", "combined")
        if self.library is not None and not learns:
            raise ValueError(
                'library is a file of "library learn" and belongs to method = "learned" or "combined"; a library of '
                "simulated lives is a key of the channel"
            )
        if learns and len(self.thresholds) > 1:
            raise ValueError(
                f'method = "{self.method}" forecasts the end of the recorded runs, so that threshold_mm2 must be one '
                f"number, got {len(self.thresholds)}"
            )
        return self

    @field_validator("threshold_mm2")
    @classmethod
    def _some(cls, value: float | tuple[float, ...]) -> float | tuple[float, ...]:
        if isinstance(value, tuple) and (not value or list(value) != sorted(set(value))):
            raise ValueError("a list of thresholds must be ascending and hold at least one")
        return value

    @property
    def thresholds(self) -> tuple[float, ...]:
        """Thresholds of V_eq in m2, ascending."""
        values = self.threshold_mm2 if isinstance(self.threshold_mm2, tuple) else (self.threshold_mm2,)
        return tuple(value * 1e-6 for value in values)
