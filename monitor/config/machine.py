"""``[machine]``, ``[operating]`` and the nodes of a PLC: identity, folders, shaft speed and load."""

from __future__ import annotations

import zoneinfo
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, field_validator, model_validator

from monitor.config.fields import ConfigSection, Count, Finite, Name, NotNegative, Positive, Scale
from monitor.config.outputs import check_address, is_loopback
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.quality import SpeedLimits
from monitor.health.signal.rotation.rotation import TachoSettings
from monitor.health.signal.waterfall import WaterfallSettings
from monitor.words.zones import machine_class
from streams.turns.pulses import BlockRevolutions
from streams.types.spec import ChannelSpec

ColumnName = str | int

_SPEED_RANGE = (5.0, 100.0)
_SPEED_FACTOR = 1.25
_MIN_TEETH = 4
"""Fewest teeth that a wheel with a gap must have: below, most of its intervals do not show the pitch."""


class MachineSection(ConfigSection):
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


class OperatingSection(ConfigSection):
    """Shaft speed and load; what a block states itself takes precedence, then channels, then an estimate.

    The angle of the shaft, from pulses, ``speed_over_time`` or ``phase``, takes precedence over all of them.
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
    speed_over_time: bool = False
    """Whether ``speed_channel`` is taken as a signal over time, and not by its mean."""
    tacho_channel: ColumnName | None = None
    tacho_channel_b: ColumnName | None = None
    pulses_per_revolution: Count = TachoSettings.per_revolution
    """Marks of a whole turn, missing teeth included."""
    tacho_missing_teeth: Annotated[int, Field(ge=0, le=1000)] = TachoSettings.missing_teeth
    tacho_ratio: Positive = TachoSettings.ratio
    """Turns of the shaft of the bearing per turn of the shaft with the marks."""
    tacho_level: Finite | None = None
    tacho_edge: Literal["rising", "falling"] = TachoSettings.edge
    phase: Literal["estimate"] | None = None
    phase_orders: tuple[Positive, ...] = ()
    domain: Literal["auto", "hertz"] = ConditionSettings.domain
    min_speed_hz: Positive | None = None
    max_speed_hz: Positive | None = None
    max_acceleration_hz_per_s: Positive | None = None
    opcua: OpcUaCondition | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for problem in (*self._speed_problems(), *self._tacho_problems(), *self._limit_problems()):
            raise ValueError(problem)
        return self

    def _speed_problems(self) -> Iterator[str]:
        """Yield what contradicts itself in the keys of the speed, the channels and the estimates."""
        if self.speed is not None and self.speed_channel is not None:
            yield 'give speed_channel or speed = "estimate", not both'
        if self.speed_range_hz is not None and self.speed_range_hz[0] >= self.speed_range_hz[1]:
            yield "speed_range_hz: the lower end must be below the upper end"
        if self.speed_range_hz is not None and self.speed is None and self.phase is None:
            yield 'speed_range_hz belongs to speed = "estimate" or phase = "estimate"'
        if self.speed_over_time and self.speed_channel is None:
            yield "speed_over_time belongs to speed_channel"
        if self.phase_orders and self.phase is None:
            yield 'phase_orders belongs to phase = "estimate"'
        if list(self.phase_orders) != sorted(set(self.phase_orders)):
            yield "phase_orders must rise"
        for key, column in self._columns.items():
            same = [other for other, chosen in self._columns.items() if str(chosen) == str(column)]
            if same[0] != key:
                yield f"{same[0]} and {key} must differ"

    def _tacho_problems(self) -> Iterator[str]:
        """Yield what contradicts itself in the keys of the tacho."""
        for key in ("tacho_channel_b", "tacho_level", "tacho_edge"):
            if self.tacho_channel is None and key in self.model_fields_set:
                yield f"{key} belongs to tacho_channel"
        if self.tacho_missing_teeth and self.pulses_per_revolution < self.tacho_missing_teeth + _MIN_TEETH:
            yield (
                f"pulses_per_revolution counts the missing teeth as well: with tacho_missing_teeth = "
                f"{self.tacho_missing_teeth} it must be at least {self.tacho_missing_teeth + _MIN_TEETH}"
            )
        if self.tacho_missing_teeth and self.tacho_channel_b is not None:
            yield "tacho_missing_teeth: a quadrature encoder (tacho_channel_b) lacks no teeth"

    def _limit_problems(self) -> Iterator[str]:
        """Yield what contradicts itself in the limits of the speed."""
        least, highest = self.min_speed_hz, self.max_speed_hz
        if least is not None and highest is not None and least >= highest:
            yield "min_speed_hz must be below max_speed_hz"

    @property
    def _columns(self) -> dict[str, ColumnName]:
        """The columns of speed, load and pulses by their keys."""
        keys = ("speed_channel", "load_channel", "tacho_channel", "tacho_channel_b")
        return {key: column for key in keys if (column := getattr(self, key)) is not None}

    def to_condition(self, *, pulses: bool = False) -> ConditionSettings:
        """Return the settings; a speed is sought within a quarter around ``speed_hz``, or from 5 to 100 Hz.

        ``pulses``: the source gives the times of the pulses of a tacho.
        """
        limits = None
        if self.speed is not None or self.phase is not None:
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
            tacho=TachoSettings(
                channel=None if self.tacho_channel is None else str(self.tacho_channel),
                channel_b=None if self.tacho_channel_b is None else str(self.tacho_channel_b),
                per_revolution=self.pulses_per_revolution,
                missing_teeth=self.tacho_missing_teeth,
                ratio=self.tacho_ratio,
                level=self.tacho_level,
                edge=self.tacho_edge,
                of_source=pulses,
            ),
            speed_over_time=self.speed_over_time,
            phase=self.phase is not None,
            phase_orders=self.phase_orders,
            domain=self.domain,
            limits=SpeedLimits(self.min_speed_hz, self.max_speed_hz, self.max_acceleration_hz_per_s),
        )

    def to_block_revolutions(self, revolutions: float) -> BlockRevolutions:
        """Return how blocks of so many turns are cut."""
        return BlockRevolutions(
            revolutions=revolutions,
            per_revolution=self.pulses_per_revolution,
            missing_teeth=self.tacho_missing_teeth,
            ratio=self.tacho_ratio,
            channel=None if self.tacho_channel is None else str(self.tacho_channel),
            level=self.tacho_level,
            falling=self.tacho_edge == "falling",
        )

    def channel_specs(self) -> tuple[ChannelSpec, ...]:
        """Return the channels of speed, load and pulses that the source must give besides those of vibration."""
        return tuple(
            ChannelSpec(str(column), column=column, unit="unknown", any_unit=True) for column in self._columns.values()
        )


class RetentionSection(ConfigSection):
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


NodeId = Annotated[str, Field(pattern=r"^(ns=\d{1,5};)?[isgb]=.+$")]


class OpcUaCondition(ConfigSection):
    """An OPC UA server whose nodes give speed and load; they are read at intervals, each value times its scale."""

    url: Annotated[str, Field(pattern=r"^opc\.tcp://[^\s/]+(/\S*)?$")]
    speed_node: NodeId | None = None
    """Such as "ns=2;s=Drive.Speed"."""
    speed_scale: Scale = 1.0
    """Hz per unit of the node; 0.016666667 for rpm."""
    load_node: NodeId | None = None
    load_scale: Scale = 1.0
    """N per unit of the node."""
    interval_s: Annotated[float, Field(ge=0.05, le=60.0)] = 1.0
    max_age_s: Positive = 10.0
    """Greatest age of a reading at the middle of a block; an older one is unknown."""
    username_file: Path | None = None
    password_file: Path | None = None
    cert_file: Path | None = None
    """Certificate of this client, PEM or DER; with it, the connection is signed and encrypted."""
    key_file: Path | None = None
    server_cert_file: Path | None = None

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_address(self.url)
        if self.speed_node is None and self.load_node is None:
            raise ValueError("expected speed_node, load_node or both")
        if (self.username_file is None) != (self.password_file is None):
            raise ValueError("username_file and password_file come together")
        if len({key is None for key in (self.cert_file, self.key_file, self.server_cert_file)}) > 1:
            raise ValueError("cert_file, key_file and server_cert_file come together")
        if self.password_file is not None and self.cert_file is None and not is_loopback(self.host):
            raise ValueError("password_file needs cert_file, key_file and server_cert_file: else nothing is encrypted")
        return self

    @property
    def ways(self) -> set[str]:
        """Names of the keys that say how is read, and not what."""
        return {"interval_s", "username_file", "password_file", "cert_file", "key_file", "server_cert_file"}

    @property
    def host(self) -> str:
        """Name or address of the server."""
        return urlsplit(self.url).hostname or ""
