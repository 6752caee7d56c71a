"""What is configured of a source and its channels, SI: everything that the stages of one block need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from models.bearing import Bearing
from monitor.health.alarms import AlarmSettings
from monitor.health.condition import ConditionSettings
from monitor.health.damage.tracker import DamageSettings
from monitor.health.detect import DetectSettings
from monitor.health.spectrum.transform import Band
from monitor.health.waterfall import WaterfallSettings


@dataclass(frozen=True)
class ChannelSettings:
    """One channel.

    Attributes:
        name: of the channel.
        bearing: its geometry.
        unit: of the samples: "g", "m/s2", "V" or "unknown".
        scale: factor from the stored numbers to ``unit``.
        sensitivity_mv_per_g: of the sensor, for "V".
        signal_range: full scale, m/s2, or None where unknown.
        samples: nominal samples of a block, or None where blocks have no nominal length.
        bands: bands to demodulate, Hz, or None: chosen on the learning window.
        rms_band: band of RMS and A*, Hz, or None for the full bandwidth.
        average_blocks: envelope spectra averaged to name the damaged part.
        damage: how V_eq and TT are found, or None where they are not.
        map_hash: of the RMS map, or None.
    """

    name: str
    bearing: Bearing
    unit: str = "m/s2"
    scale: float = 1.0
    sensitivity_mv_per_g: float | None = None
    signal_range: float | None = None
    samples: int | None = None
    bands: tuple[Band, ...] | None = None
    rms_band: Band | None = None
    average_blocks: int = 1
    condition: ConditionSettings = field(default_factory=ConditionSettings)
    detect: DetectSettings = field(default_factory=DetectSettings)
    damage: DamageSettings | None = None
    map_hash: str | None = None
    alarms: AlarmSettings = field(default_factory=AlarmSettings)
    waterfall: WaterfallSettings = field(default_factory=WaterfallSettings)

    @property
    def absolute(self) -> bool:
        """Whether the unit is known, so that levels in m/s2 have a meaning."""
        return self.unit != "unknown"


@dataclass(frozen=True)
class SourceSettings:
    """One source: its channels by name, and its sampling rate, Hz, or None where the recording states it."""

    name: str
    channels: Mapping[str, ChannelSettings]
    rate: float | None = None

    @property
    def thresholds(self) -> tuple[float, ...]:
        """Thresholds of V_eq that the tracked channels are forecast to, m2; () where none is tracked."""
        tracked = (channel.damage for channel in self.channels.values())
        return next((damage.thresholds for damage in tracked if damage is not None), ())
