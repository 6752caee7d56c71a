"""A source and its channels: what is configured, SI, and what is carried from block to block.

The state is frozen, versioned and writable as JSON. A store keeps its parts under names of their own (``source:S``,
``machine:S``, ``encoder:S``, ``channel:S:C``, ``alarms:S:C``, ``waterfall:S:C``, ``gears:S:C``), each with its version.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import KNOWN, Bearing, KinematicUncertainty
from models.machine.rig import Calibration
from monitor.health.alarms import AlarmSettings, AlarmState
from monitor.health.codec import StoredState
from monitor.health.gears.naming import GearsState
from monitor.health.gears.settings import GearSettings
from monitor.health.name.evidence import BlockEvidence, ChannelEvidence
from monitor.health.name.machine import MachineState
from monitor.health.onset import DetectSettings, DetectState
from monitor.health.record import Record
from monitor.health.rest.trend import TrendState
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.bands import BandVotes
from monitor.health.signal.condition import ConditionSettings
from monitor.health.signal.differentiate import USUAL_LIMIT, acceleration_of
from monitor.health.signal.interference import Interference
from monitor.health.signal.quality import OrderState
from monitor.health.signal.rotation.encoder import EncoderState
from monitor.health.signal.transform import Band
from monitor.health.signal.waterfall import WaterfallSettings, WaterfallState
from monitor.health.size import RemainingSettings
from monitor.health.size.filter.particle_filter import FilterState
from monitor.health.size.library.forecaster import LibraryState
from monitor.health.tracker import DamageSettings, DamageState
from monitor.words.zones import MachineClass
from streams.types.block import VELOCITY

Stored = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class ChannelSettings:
    """One channel.

    Attributes:
        listens_to: name of its bearing; all channels with this name are weighed together.
        unit: of the samples: "g", "m/s2", "V", "unknown", or "mm/s" of a sensor of velocity.
        scale: factor from the stored numbers to ``unit``.
        sensitivity_mv_per_g: of the sensor, for "V".
        signal_range: full scale, m/s2, or None where unknown.
        velocity_limit: Hz up to which the acceleration of a sensor of velocity is known.
        samples: nominal samples of a block, or None where blocks have no nominal length.
        uncertainty: of the fault frequencies, by which the search of the families widens.
        bands: bands to demodulate, Hz, or None: chosen on the learning window.
        rms_band: band of RMS and A*, Hz, or None for the full bandwidth.
        interference: lines of other origin that are removed before the envelope.
        average_blocks: envelope spectra averaged to name the damaged part.
        damage: how V_eq and TT are found, or None where they are not.
        calibration: whether V_eq is that of the machine ("declared" where a person vouches), or None where it is not
            tracked.
        map_hash: of the RMS map, or None.
        machine_class: by which a zone is given to the velocity, or None.
        gears: whose wheels are judged too, or None.
    """

    name: str
    bearing: Bearing
    listens_to: str = "bearing"
    unit: str = "m/s2"
    scale: float = 1.0
    sensitivity_mv_per_g: float | None = None
    signal_range: float | None = None
    velocity_limit: float = USUAL_LIMIT
    samples: int | None = None
    uncertainty: KinematicUncertainty = KNOWN
    bands: tuple[Band, ...] | None = None
    rms_band: Band | None = None
    interference: tuple[Interference, ...] = ()
    average_blocks: int = 1
    condition: ConditionSettings = field(default_factory=ConditionSettings)
    detect: DetectSettings = field(default_factory=DetectSettings)
    damage: DamageSettings | None = None
    calibration: Calibration | None = None
    map_hash: str | None = None
    alarms: AlarmSettings = field(default_factory=AlarmSettings)
    trend: RemainingSettings = field(default_factory=RemainingSettings)
    waterfall: WaterfallSettings = field(default_factory=WaterfallSettings)
    machine_class: MachineClass | None = None
    gears: GearSettings | None = None

    @property
    def absolute(self) -> bool:
        """Whether the unit is known, so that levels in m/s2 have a meaning."""
        return self.unit != "unknown"

    @property
    def measures_velocity(self) -> bool:
        """Whether accelerations are the derivative of a velocity, up to ``velocity_limit``."""
        return self.unit == VELOCITY

    @property
    def si_unit(self) -> str:
        """What ``to_si`` gives of the samples."""
        return {"unknown": "unknown", VELOCITY: "m/s"}.get(self.unit, "m/s2")

    @property
    def band_limit(self) -> float:
        """Frequency beyond which there is no acceleration, Hz."""
        return self.velocity_limit if self.measures_velocity else math.inf

    def acceleration_of(self, samples: NDArray[np.floating], rate: float) -> NDArray[np.floating]:
        """Return samples (sample,) of a sensor of velocity differentiated, those of others as they are."""
        return acceleration_of(samples, rate, self.velocity_limit) if self.measures_velocity else samples


@dataclass(frozen=True)
class SourceSettings:
    """One source: its channels by name, and its sampling rate, Hz, or None where the recording states it."""

    name: str
    channels: Mapping[str, ChannelSettings]
    rate: float | None = None

    @property
    def bearings(self) -> dict[str, tuple[str, ...]]:
        """Channels by the bearing that they listen to."""
        return channels_by_bearing(self.channels.values())

    @property
    def persist_blocks(self) -> int:
        """Blocks in a row that an onset needs, of the channel that needs most."""
        return max((channel.detect.persist_blocks for channel in self.channels.values()), default=1)

    @property
    def thresholds(self) -> tuple[float, ...]:
        """Thresholds of V_eq that the tracked channels are forecast to, m2; () where none is tracked."""
        tracked = (channel.damage for channel in self.channels.values())
        return next((damage.thresholds for damage in tracked if damage is not None), ())


def channels_by_bearing(channels: Iterable[ChannelSettings]) -> dict[str, tuple[str, ...]]:
    """Return the names of channels by the bearing that they listen to."""
    found: dict[str, tuple[str, ...]] = {}
    for channel in channels:
        found[channel.listens_to] = (*found.get(channel.listens_to, ()), channel.name)
    return found


@dataclass(frozen=True)
class Named:
    """The part that a channel's fault was named, and on what evidence.

    Attributes:
        fault: "outer", "inner", "ball", "cage", two of them joined by "|", or "undecided".
        snr: its lines over the floor under them.
        depth: its lines over the mean envelope.
        standing: its score over the threshold of the score.
        sequence: number of the block that gave this evidence.
        candidates: parts between which the stated speed cannot decide.
        speed_unverified: whether the name rests on a nominal speed; None where that was not recorded.
    """

    fault: str
    snr: float
    depth: float
    standing: float
    sequence: int
    candidates: tuple[str, ...] = ()
    speed_unverified: bool | None = None

    @property
    def parts(self) -> str:
        """The parts that may be damaged, joined by "|"."""
        return "|".join(self.candidates) or self.fault


@dataclass(frozen=True)
class ChannelState(StoredState):
    """One channel between two blocks: its stages up to the forecast.

    Attributes:
        bands: the bands that were chosen, Hz, or () before the choice.
        band_source: "learning" or "recording" once chosen, else "provisional".
        votes: the candidate bands of the first blocks, or None.
        spectra: the latest envelope spectra, for the averaged one.
        speed_factors: shaft speed found over the stated one, of the latest blocks that show it.
        running_time: seconds that the machine has run, the time axis of the damage.
        last_time: time of the latest block that was in order, s, or None.
        was_running: whether the machine ran then.
        named: the damaged part, or None.
        trend: levels since the onset.
    """

    VERSIONS = (1, 2, 3)
    LATER = frozenset({"speed_factors", "trend"})

    version: int = VERSIONS[-1]
    detect: DetectState = field(default_factory=DetectState)
    bands: tuple[Band, ...] = ()
    band_source: str = "provisional"
    votes: BandVotes | None = None
    spectra: RecentSpectra = field(default_factory=RecentSpectra)
    speed_factors: tuple[float, ...] = ()
    running_time: float = 0.0
    last_time: float | None = None
    was_running: bool = False
    damage: DamageState = field(default_factory=DamageState)
    named: Named | None = None
    trend: TrendState = field(default_factory=TrendState)

    @classmethod
    def upgraded(cls, stored: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return a state of version 1, which kept only time and RMS of a pending block, as later ones are."""
        if stored["version"] > 1:
            return stored
        damage = {
            "pending": [[time, rms, None, None, None] for time, rms in stored["pending"]],
            "edv": stored["edv"],
            "filter": FilterState().to_dict(),
            "forecast": stored["forecast"],
            "library": LibraryState().to_dict(),
        }
        return {name: value for name, value in stored.items() if name not in ("pending", "edv", "forecast")} | {
            "damage": damage
        }


_Part = TypeVar("_Part", OrderState, ChannelState, AlarmState, WaterfallState, EncoderState, GearsState)


def _part(kind: type[_Part], stored: Mapping[str, Any] | None) -> _Part:
    return kind() if stored is None else kind.from_dict(stored)


def _machine(stored: Mapping[str, Any] | None, channels: Mapping[str, ChannelState]) -> MachineState:
    """Return the stored part; for a store that is older than it, what the channels are named now."""
    if stored is not None:
        return MachineState.from_dict(stored)
    voices = {
        name: ChannelEvidence().after(
            BlockEvidence(fault=state.named.fault, depth=state.named.depth, final=state.detect.t_fs is not None)
        )
        for name, state in channels.items()
        if state.named is not None
    }
    return MachineState(voices)


@dataclass(frozen=True)
class SourceState:
    """One source between two blocks. To roll a block back is to go on with the state before it.

    Attributes:
        order: the place of the latest block in the stream.
        channels: stages up to the forecast, by channel.
        alarms: by channel.
        waterfalls: by channel of which spectra are kept.
        gears: by channel whose wheels are judged.
        machine: what its channels name, by which those of a bearing are weighed together.
        encoder: errors of the marks of its tacho or encoder.
        latest: record of the latest block that was analysed, or None. It is not part of what is stored: the store
            has it as a record.
    """

    source: str
    order: OrderState
    channels: Mapping[str, ChannelState]
    alarms: Mapping[str, AlarmState]
    waterfalls: Mapping[str, WaterfallState]
    machine: MachineState = field(default_factory=MachineState)
    encoder: EncoderState = field(default_factory=EncoderState)
    latest: Record | None = None
    gears: Mapping[str, GearsState] = field(default_factory=dict[str, GearsState])

    @classmethod
    def begin(
        cls,
        settings: SourceSettings,
        stored: Mapping[str, Mapping[str, Any]] | None = None,
        latest: Record | None = None,
    ) -> SourceState:
        """Return the state before the next block.

        Args:
            stored: parts by name as :meth:`to_stored` gave them; a part that is missing begins afresh.
            latest: the record that was committed with them.

        Raises:
            KeyError, TypeError, ValueError: a part was written by another version.
        """
        source, channels = settings.name, settings.channels
        drawn = [name for name, channel in channels.items() if channel.waterfall.rows > 0]
        geared = [name for name, channel in channels.items() if channel.gears is not None]
        parts = stored or {}
        states = {name: _part(ChannelState, parts.get(f"channel:{source}:{name}")) for name in channels}
        return cls(
            source=source,
            order=_part(OrderState, parts.get(f"source:{source}")),
            channels=states,
            alarms={name: _part(AlarmState, parts.get(f"alarms:{source}:{name}")) for name in channels},
            waterfalls={name: _part(WaterfallState, parts.get(f"waterfall:{source}:{name}")) for name in drawn},
            machine=_machine(parts.get(f"machine:{source}"), states),
            encoder=_part(EncoderState, parts.get(f"encoder:{source}")),
            latest=latest,
            gears={name: _part(GearsState, parts.get(f"gears:{source}:{name}")) for name in geared},
        )

    def to_stored(self) -> Stored:
        """Return the parts by name as plain values for JSON, to be committed with the record of the latest block."""
        kinds = {"channel": self.channels, "alarms": self.alarms, "waterfall": self.waterfalls, "gears": self.gears}
        stored = {f"source:{self.source}": self.order.to_dict(), f"machine:{self.source}": self.machine.to_dict()}
        if self.encoder.pattern is not None:
            stored[f"encoder:{self.source}"] = self.encoder.to_dict()
        for kind, states in kinds.items():
            stored |= {f"{kind}:{self.source}:{name}": state.to_dict() for name, state in states.items()}
        return stored

    def with_band(self, channel: str, band: Band) -> SourceState:
        """Return the state with the band of a channel fixed to one that was chosen from the recording as a whole."""
        fixed = replace(self.channels[channel], bands=(band,), band_source="recording")
        return replace(self, channels={**self.channels, channel: fixed})
