"""Keys of ``[operating]``: constants, channels, or the speed estimated from the signal."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import BaseModel, Field, field_validator, model_validator

from monitor.health.condition import ConditionSettings
from streams.spec import ChannelSpec

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
_WIDEST = (5.0, 100.0)
_AROUND = 1.25


class ConditionKeys(BaseModel):
    """Shaft speed and radial load; what a block states itself takes precedence, then channels, then an estimate.

    ``speed_channel`` and ``load_channel`` are names or numbers of columns in the source; their mean, times the scale,
    is the speed in Hz or the load in N.
    """

    speed_hz: Positive | None = None
    load_newton: Annotated[float, Field(ge=0, allow_inf_nan=False)] | None = None
    speed: Literal["estimate"] | None = None
    speed_range_hz: tuple[Positive, Positive] | None = None
    speed_channel: str | int | None = None
    speed_channel_scale: float = 1.0
    load_channel: str | int | None = None
    load_channel_scale: float = 1.0

    @field_validator("speed_channel_scale", "load_channel_scale")
    @classmethod
    def _usable(cls, value: float) -> float:
        if not math.isfinite(value) or value == 0.0:
            raise ValueError("must be a finite number other than 0")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.speed is not None and self.speed_channel is not None:
            raise ValueError('give speed_channel or speed = "estimate", not both')
        if self.speed_range_hz is not None and self.speed_range_hz[0] >= self.speed_range_hz[1]:
            raise ValueError("speed_range_hz: the lower end must be below the upper end")
        if self.speed_range_hz is not None and self.speed is None:
            raise ValueError('speed_range_hz belongs to speed = "estimate"')
        if self.speed_channel is not None and self.speed_channel == self.load_channel:
            raise ValueError("speed_channel and load_channel must differ")
        return self

    def to_condition(self) -> ConditionSettings:
        """Return the settings; a speed is sought within a quarter around ``speed_hz``, or from 5 to 100 Hz."""
        limits = None
        if self.speed is not None:
            around = None if self.speed_hz is None else (self.speed_hz / _AROUND, self.speed_hz * _AROUND)
            limits = self.speed_range_hz or around or _WIDEST
        return ConditionSettings(
            speed=self.speed_hz,
            load=self.load_newton,
            speed_channel=None if self.speed_channel is None else str(self.speed_channel),
            speed_scale=self.speed_channel_scale,
            load_channel=None if self.load_channel is None else str(self.load_channel),
            load_scale=self.load_channel_scale,
            speed_limits=limits,
        )

    def channel_specs(self) -> tuple[ChannelSpec, ...]:
        """Return the channels that the source must give besides those of vibration."""
        chosen = (self.speed_channel, self.load_channel)
        return tuple(ChannelSpec(str(column), column=column, unit="unknown") for column in chosen if column is not None)
