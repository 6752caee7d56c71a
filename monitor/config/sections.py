"""The tables of config.toml. Names carry their units here, at the edge; what they become is SI."""

from __future__ import annotations

import math
import zoneinfo
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from models.bearing import Bearing, catalogue, from_catalogue
from models.scene import Rig
from monitor.config.condition import ConditionKeys
from monitor.config.network import NetworkKeys
from monitor.health.detect import DetectSettings
from monitor.health.waterfall import WaterfallSettings
from streams.block import STANDARD_GRAVITY

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
Band = tuple[NotNegative, Positive]


class Section(BaseModel):
    """A table of the configuration: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)


class MachineSection(Section):
    """Who is monitored, and where its state and records are kept."""

    name: Name = "machine"
    state_dir: Path = Path("state")
    records_dir: Path = Path("records")
    timezone: str = "UTC"
    min_free_mb: NotNegative = 200.0
    """Below so much free room on the disk of the state, the daemon takes nothing more."""
    spectra: Annotated[int, Field(ge=0, le=10000)] = WaterfallSettings.rows
    """Envelope spectra kept of each channel: at least so many of a long life, at most twice as many; 0: none."""
    spectra_interval_s: Annotated[float, Field(ge=0.01, le=1e7)] = WaterfallSettings.interval
    """Shortest record time between two of them, until they become too many."""

    @field_validator("timezone")
    @classmethod
    def _known_zone(cls, value: str) -> str:
        try:
            zoneinfo.ZoneInfo(value)
        except (zoneinfo.ZoneInfoNotFoundError, ValueError):
            raise ValueError("not a time zone of the tz database, such as UTC or Europe/Rome") from None
        return value

    def to_waterfall(self) -> WaterfallSettings:
        """Return how many envelope spectra are kept."""
        return WaterfallSettings(rows=self.spectra, interval=self.spectra_interval_s)


class BearingSection(Section):
    """A bearing, from the catalogue or by its geometry."""

    name: Name
    designation: str | None = None
    n_elements: Annotated[int, Field(ge=3, le=200)] | None = None
    element_diameter_mm: Positive | None = None
    pitch_diameter_mm: Positive | None = None
    contact_angle_deg: Annotated[float, Field(ge=0, lt=90)] | None = None
    rows: Literal[1, 2] | None = None
    outer_race_radius_mm: Positive | None = None
    inner_race_radius_mm: Positive | None = None
    inner_groove_radius_mm: Positive | None = None
    outer_groove_radius_mm: Positive | None = None
    element: Literal["ball", "roller"] | None = None
    rotating_ring: Literal["inner", "outer"] = "inner"
    clearance_um: NotNegative = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.designation is not None:
            if self.designation not in catalogue():
                raise ValueError(
                    f"designation {self.designation!r} is not in the catalogue; known are "
                    f"{', '.join(sorted(catalogue()))}; or give n_elements, element_diameter_mm and pitch_diameter_mm"
                )
            return self
        missing = [
            key for key in ("n_elements", "element_diameter_mm", "pitch_diameter_mm") if getattr(self, key) is None
        ]
        if missing:
            raise ValueError(f"without a designation it needs {', '.join(missing)}")
        if (self.element_diameter_mm or 0.0) >= (self.pitch_diameter_mm or 0.0):
            raise ValueError("element_diameter_mm must be smaller than pitch_diameter_mm")
        return self

    def to_bearing(self) -> Bearing:
        """Return the geometry in SI; what is given here takes precedence over the catalogue."""
        fields: dict[str, Any] = {"rotating_ring": self.rotating_ring}
        for key in ("n_elements", "rows", "element"):
            if getattr(self, key) is not None:
                fields[key] = getattr(self, key)
        for key in (
            "element_diameter",
            "pitch_diameter",
            "outer_race_radius",
            "inner_race_radius",
            "inner_groove_radius",
            "outer_groove_radius",
        ):
            value = getattr(self, f"{key}_mm")
            if value is not None:
                fields[key] = value * 1e-3
        if self.contact_angle_deg is not None:
            fields["contact_angle"] = math.radians(self.contact_angle_deg)
        if self.designation is None:
            return Bearing(designation=self.name, source="configuration", **fields)
        known = from_catalogue(self.designation)
        return Bearing(**{**{name: getattr(known, name) for name in known.__dataclass_fields__}, **fields})


class RigSection(Section):
    """Lumped parameters of the six-degree-of-freedom model (thesis, Table 18)."""

    m_i_kg: Positive = Rig.m_i
    m_o_kg: Positive = Rig.m_o
    m_r_kg: Positive = Rig.m_r
    m_b_kg: Positive = Rig.m_b
    k_i_newton_per_m: Positive = Rig.k_i
    k_r_newton_per_m: Positive = Rig.k_r
    k_c_newton_per_m15: Positive = Rig.k_c
    c_i_newton_s_per_m: NotNegative = Rig.c_i
    c_r_newton_s_per_m: NotNegative = Rig.c_r
    alpha_c_per_s: NotNegative = Rig.alpha_c
    beta_c_s: NotNegative = Rig.beta_c
    calibrated: bool = False

    def to_rig(self) -> Rig:
        """Return the parameters in SI."""
        return Rig(
            m_i=self.m_i_kg,
            m_o=self.m_o_kg,
            m_r=self.m_r_kg,
            m_b=self.m_b_kg,
            k_i=self.k_i_newton_per_m,
            k_r=self.k_r_newton_per_m,
            k_c=self.k_c_newton_per_m15,
            c_i=self.c_i_newton_s_per_m,
            c_r=self.c_r_newton_s_per_m,
            alpha_c=self.alpha_c_per_s,
            beta_c=self.beta_c_s,
            calibrated=self.calibrated,
        )


class OperatingSection(ConditionKeys, Section):
    """Shaft speed and radial load; a speed that a recording states itself takes precedence."""


class SourceSection(NetworkKeys, Section):
    """Where blocks come from."""

    name: Name
    url: str | None = None
    start_utc: datetime | None = None
    settle_s: NotNegative = 2.0
    block_s: Positive | Literal["file"] = 5.0
    format: str = "auto"
    rate_hz: Positive | None = None
    range_g: Positive | None = None

    @field_validator("start_utc")
    @classmethod
    def _in_utc(cls, value: datetime | None) -> datetime | None:
        return value.replace(tzinfo=UTC) if value is not None and value.tzinfo is None else value


class ChannelSection(Section):
    """One sensor: where it is found, on which bearing it sits, in which bands it is listened to."""

    name: Name
    source: Name
    column: int | str | None = None
    key: str | None = None
    unit: Literal["g", "m/s2", "V", "unknown"]
    sensitivity_mv_per_g: Positive | None = None
    scale: float = 1.0
    bearing: Name
    band_hz: tuple[Band, ...] | Literal["auto"] = "auto"
    rms_band_hz: Band | None = None
    average_blocks: Annotated[int, Field(ge=1, le=1000)] = 1
    track: bool = False
    map: Path | None = None
    library: Path | None = None

    @field_validator("scale")
    @classmethod
    def _usable_scale(cls, value: float) -> float:
        if not math.isfinite(value) or value == 0.0:
            raise ValueError("must be a finite number other than 0")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.unit == "V") != (self.sensitivity_mv_per_g is not None):
            raise ValueError('sensitivity_mv_per_g belongs to unit = "V", and "V" needs it')
        if self.column is not None and self.key is not None:
            raise ValueError("give column or key, not both")
        if self.band_hz == ():
            raise ValueError('band_hz is empty; give [[lo, hi]] or "auto"')
        bands = () if self.band_hz == "auto" else self.band_hz
        for key, (low, high) in [("band_hz", band) for band in bands] + (
            [("rms_band_hz", self.rms_band_hz)] if self.rms_band_hz else []
        ):
            if low >= high:
                raise ValueError(f"{key}: the lower edge {low:g} Hz must be below the upper edge {high:g} Hz")
        return self

    def check_rate(self, rate: float) -> None:
        """Refuse bands that a sampling rate cannot hold.

        Raises:
            ValueError: naming the key, the band and the Nyquist frequency.
        """
        bands = () if self.band_hz == "auto" else self.band_hz
        for key, band in [("band_hz", band) for band in bands] + (
            [("rms_band_hz", self.rms_band_hz)] if self.rms_band_hz else []
        ):
            if band[1] > 0.5 * rate:
                raise ValueError(
                    f"channel {self.name!r}: {key} = [{band[0]:g}, {band[1]:g}] Hz reaches above the Nyquist frequency "
                    f"{0.5 * rate:g} Hz of a sampling rate of {rate:g} Hz; allowed is 0 to {0.5 * rate:g} Hz"
                )


class DetectSection(Section):
    """How the start of the final stage and the end of life are detected."""

    learn_blocks: Annotated[int, Field(ge=10, le=100000)] | None = None
    learn_hours: Positive | None = None
    run_in_blocks: Annotated[int, Field(ge=0)] = DetectSettings.run_in_blocks
    false_alarms_per_1000_blocks: Annotated[float, Field(ge=1e-6, le=100)] = DetectSettings.false_alarms_per_1000_blocks
    persist_blocks: Annotated[int, Field(ge=1, le=1000)] = DetectSettings.persist_blocks
    rms_drift: Annotated[float, Field(ge=0, le=2)] = DetectSettings.rms_drift
    h_or_drift: Annotated[float, Field(ge=0, le=2)] = DetectSettings.h_or_drift
    end_of_life_peak_g: Positive = 20.0
    end_of_life_blocks: Annotated[int, Field(ge=1, le=1000)] = DetectSettings.end_of_life_blocks

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
            persist_blocks=self.persist_blocks,
            rms_drift=self.rms_drift,
            h_or_drift=self.h_or_drift,
            end_of_life_peak=self.end_of_life_peak_g * STANDARD_GRAVITY,
            end_of_life_blocks=self.end_of_life_blocks,
        )


class TrackSection(Section):
    """How the features of a block become the equivalent damaged volume.

    Without a method, it is the library where the channel has one, and else the method of the thesis.
    """

    method: Literal["thesis", "filter", "library"] | None = None
    features: tuple[Literal["rms", "harmonics"], ...] = ("rms", "harmonics")
    smoothing_blocks: Annotated[int, Field(ge=1, le=1000)] = 6

    @field_validator("features")
    @classmethod
    def _with_rms(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if "rms" not in value or len(set(value)) != len(value):
            raise ValueError('must be ["rms"] or ["rms", "harmonics"]')
        return value


class ForecastSection(Section):
    """How the history up to now becomes a time to threshold.

    Without a method, it is the library where the channel has one, and else the method of the thesis.
    """

    method: Literal["thesis", "library"] | None = None
    threshold_mm2: Positive | tuple[Positive, ...] = 0.05
    interval: Annotated[float, Field(ge=0.5, le=0.98)] = 0.8
    window_hours: Positive | None = None

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
