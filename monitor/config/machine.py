"""``[machine]`` and ``[operating]``: identity, folders, shaft speed and load."""

from __future__ import annotations

import zoneinfo
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from monitor.config.fields import Finite, Name, NotNegative, Positive, Scale, Section
from monitor.config.opcua import OpcUaCondition
from monitor.health.condition import ConditionSettings
from monitor.health.waterfall import WaterfallSettings
from monitor.words.zones import machine_class
from streams.spec import ChannelSpec

ColumnName = str | int

_SPEED_RANGE = (5.0, 100.0)
_SPEED_FACTOR = 1.25


class MachineSection(Section):
    """Name of the machine, and where its state and records are kept."""

    name: Name = "machine"
    state_dir: Path = Path("state")
    records_dir: Path = Path("records")
    timezone: str = "UTC"
    iso_class: str | None = None
    """Part of ISO 20816, group and support, such as "20816-3:1:rigid": by its limits the velocity is given a zone."""
    min_free_mb: NotNegative = 200.0
    """Pause ingestion below this free space on the disk of the state, MB."""
    spectra: Annotated[int, Field(ge=0, le=10000)] = WaterfallSettings.rows
    """Target number of envelope spectra kept of each channel; at most twice this; 0: none."""
    spectra_interval_s: Annotated[float, Field(ge=0.01, le=1e7)] = WaterfallSettings.interval
    """Shortest record time between two of them, until the target number is exceeded."""

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, value: str) -> str:
        try:
            zoneinfo.ZoneInfo(value)
        except (zoneinfo.ZoneInfoNotFoundError, ValueError):
            raise ValueError("not a time zone of the tz database, such as UTC or Europe/Rome") from None
        return value

    @field_validator("iso_class")
    @classmethod
    def _known_class(cls, value: str | None) -> str | None:
        return None if value is None else machine_class(value).name

    def to_waterfall(self) -> WaterfallSettings:
        """Return the settings of the kept envelope spectra."""
        return WaterfallSettings(rows=self.spectra, interval=self.spectra_interval_s)


class OperatingSection(Section):
    """Shaft speed and load; what a block states itself takes precedence, then channels, then an estimate.

    ``speed_channel`` and ``load_channel`` are names or numbers of columns in the source; their mean, times the scale,
    is the speed in Hz or the load in N. ``load_newton`` is radial; ``axial_load_newton``, positive towards the bearing
    A, is taken by the models that describe it.
    """

    speed_exact: bool = False
    """Whether ``speed_hz``, or what a block states, is the speed of the shaft (tacho, controlled drive)."""
    speed_tolerance: Annotated[float, Field(gt=0, le=0.1)] = ConditionSettings.speed_tolerance
    """Relative error of a nominal speed where the signal does not show the shaft."""

    speed_hz: Positive | None = None
    load_newton: NotNegative | None = None
    axial_load_newton: Finite = 0.0
    speed: Literal["estimate"] | None = None
    speed_range_hz: tuple[Positive, Positive] | None = None
    speed_channel: ColumnName | None = None
    speed_channel_scale: Scale = 1.0
    load_channel: ColumnName | None = None
    load_channel_scale: Scale = 1.0
    opcua: OpcUaCondition | None = None

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
            around = None if self.speed_hz is None else (self.speed_hz / _SPEED_FACTOR, self.speed_hz * _SPEED_FACTOR)
            limits = self.speed_range_hz or around or _SPEED_RANGE
        return ConditionSettings(
            speed=self.speed_hz,
            load=self.load_newton,
            speed_channel=None if self.speed_channel is None else str(self.speed_channel),
            speed_scale=self.speed_channel_scale,
            load_channel=None if self.load_channel is None else str(self.load_channel),
            load_scale=self.load_channel_scale,
            speed_limits=limits,
            speed_exact=self.speed_exact,
            speed_tolerance=self.speed_tolerance,
            speed_read=self.opcua is not None and self.opcua.speed_node is not None,
        )

    def channel_specs(self) -> tuple[ChannelSpec, ...]:
        """Return the channels of speed and load that the source must give besides those of vibration."""
        chosen = (self.speed_channel, self.load_channel)
        return tuple(ChannelSpec(str(column), column=column, unit="unknown") for column in chosen if column is not None)


class RetentionSection(Section):
    """How long full records stay in the store, and how much space store and published files may take.

    Older records stay in the published files; the store keeps their trends, forecasts and identity.
    """

    full_days: Positive | None = None
    """Days of record time before the newest block whose full records stay in the store; by default all."""
    max_gb: Positive | None = None
    """Limit of store and published files, GB; beyond it, full records older than a day leave the store first."""
    spectra_days: Positive | None = None
    """Of older kept spectra, one a week stays, and those around the start of the final stage."""
    delete_published: bool = False
    """Whether the oldest published days are deleted where that is needed for ``max_gb``."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.delete_published and self.max_gb is None:
            raise ValueError("delete_published = true needs max_gb")
        return self
