"""From a validated configuration to what the stages, the sources and the maps need, in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from pathlib import Path

from models.rms_map import MapError, OutsideMapError, RmsMap, load_map
from models.scene import Rig
from monitor.config import ChannelSection, Config, ConfigError, SourceSection
from monitor.health.condition import ConditionSettings
from monitor.health.edv import EdvSettings, EdvStatus, MapSlice
from monitor.health.pipeline import ChannelSettings, MapAt
from streams.block import STANDARD_GRAVITY
from streams.source import ChannelSpec, Source, SourceError, SourceSpec, open_source

_GEOMETRY = ("n_elements", "rows", "element_diameter", "pitch_diameter", "contact_angle", "outer_race_radius")
_PARAMETERS = tuple(item.name for item in fields(Rig) if item.name != "calibrated")


@dataclass(frozen=True)
class ChannelSetup:
    """A channel as the service runs it.

    Attributes:
        section: as configured.
        settings: for the health stages.
        map: the RMS map it is tracked on, or None.
        condition: where speed and load come from.
    """

    section: ChannelSection
    settings: ChannelSettings
    map: RmsMap | None
    condition: ConditionSettings = field(default_factory=ConditionSettings)


def source_spec(config: Config, source: SourceSection, path: str | None = None) -> SourceSpec:
    """Return the specification of a source; ``path`` takes the place of the configured URL.

    Raises:
        ConfigError: if there is neither.
    """
    url = path if path is not None else source.url
    if url is None:
        raise ConfigError(f"[[source]] {source.name}: url is missing, and no path was given in its place")
    channels = tuple(
        ChannelSpec(
            name=channel.name,
            column=channel.column,
            key=channel.key,
            unit=channel.unit,
            scale=channel.scale,
            sensitivity_mv_per_g=channel.sensitivity_mv_per_g,
        )
        for channel in config.channel
        if channel.source == source.name
    )
    return SourceSpec(
        name=source.name,
        url=url,
        start=None if source.start_utc is None else source.start_utc.timestamp(),
        block_s=source.block_s,
        format=source.format,
        rate=source.rate_hz,
        range_g=source.range_g,
        channels=(*channels, *config.operating.channel_specs()),
        timezone=config.machine.timezone,
        settle_s=source.settle_s,
        network=source.to_network(),
    )


def open_configured(config: Config, source: SourceSection, path: str | None = None) -> Source:
    """Open a source of the configuration.

    Raises:
        ConfigError: naming the source, what was expected and what was found.
    """
    try:
        return open_source(source_spec(config, source, path))
    except SourceError as error:
        raise ConfigError(str(error)) from None


def channel_setups(
    config: Config, source: SourceSection, maps: dict[str, RmsMap] | None = None
) -> dict[str, ChannelSetup]:
    """Return the channels of a source by name, their maps loaded.

    Args:
        config: the configuration.
        source: one of its sources.
        maps: maps by channel name that take the place of the configured files.

    Raises:
        ConfigError: a map cannot be read or does not fit the channel.
    """
    setups = {}
    for channel in config.channel:
        if channel.source != source.name:
            continue
        rms_map = (maps or {}).get(channel.name)
        if rms_map is None and channel.track and channel.map is not None:
            rms_map = _load(channel, channel.map)
        if rms_map is not None:
            _check_band(channel, rms_map)
            _check_origin(config, channel, rms_map)
        settings = _settings(config, source, channel, rms_map)
        setups[channel.name] = ChannelSetup(channel, settings, rms_map, config.operating.to_condition())
    return setups


def _load(channel: ChannelSection, path: Path) -> RmsMap:
    try:
        return load_map(path)
    except (MapError, FileNotFoundError) as error:
        hint = "" if path.exists() else "; make it with: spallwatch map build --out FILE"
        raise ConfigError(f"channel {channel.name!r}: map: {error}{hint}") from None


def _check_band(channel: ChannelSection, rms_map: RmsMap) -> None:
    """Refuse a map whose RMS was taken in another band than the recording's will be."""
    band = None if rms_map.rms_band is None else tuple(rms_map.rms_band)
    if band != channel.rms_band_hz:
        raise ConfigError(
            f"channel {channel.name!r}: rms_band_hz = {_words(channel.rms_band_hz)}, but its map was made for "
            f"{_words(band)}; both must be the same"
        )


def _check_origin(config: Config, channel: ChannelSection, rms_map: RmsMap) -> None:
    """Refuse a map that was made for another bearing or another rig: it would give volumes all the same."""
    plan, bearing = rms_map.plan, config.bearing_of(channel)
    clearance = next(b.clearance_um for b in config.bearing if b.name == channel.bearing) * 1e-6
    pairs = [(f"bearing {name}", getattr(plan.bearing, name), getattr(bearing, name)) for name in _GEOMETRY]
    rig = config.rig.to_rig()
    pairs += [(f"rig {name}", getattr(plan.rig, name), getattr(rig, name)) for name in _PARAMETERS]
    pairs.append(("clearance", plan.clearance, clearance))
    for name, of_map, configured in pairs:
        if of_map != configured and not math.isclose(of_map or 0.0, configured or 0.0, rel_tol=1e-6, abs_tol=1e-12):
            raise ConfigError(
                f"channel {channel.name!r}: its map was made for {name} = {of_map!r}, "
                f"configured is {configured!r} (SI); build it again with: spallwatch map build --config FILE"
            )


def _words(band: tuple[float, ...] | None) -> str:
    return "the full bandwidth" if band is None else f"[{band[0]:g}, {band[1]:g}] Hz"


def _settings(
    config: Config, source: SourceSection, channel: ChannelSection, rms_map: RmsMap | None
) -> ChannelSettings:
    absolute = channel.unit != "unknown"
    bearing = config.bearing_of(channel)
    nominal = None
    if source.block_s != "file" and source.rate_hz is not None:
        nominal = round(source.block_s * source.rate_hz)
    return ChannelSettings(
        name=channel.name,
        bearing=bearing,
        absolute=absolute,
        bands=None if channel.band_hz == "auto" else tuple(channel.band_hz),
        rms_band=channel.rms_band_hz,
        average_blocks=channel.average_blocks,
        signal_range=source.range_g * STANDARD_GRAVITY if source.range_g is not None and absolute else None,
        samples=nominal,
        speed=config.operating.speed_hz,
        load=config.operating.load_newton,
        detect=config.detect.to_settings(),
        track=channel.track,
        map_at=None if rms_map is None else map_lookup(rms_map),
        edv=EdvSettings(smoothing_blocks=config.track.smoothing_blocks),
        thresholds=config.forecast.thresholds,
    )


def map_lookup(rms_map: RmsMap) -> MapAt:
    """Return the function that gives the map at a load and speed, or ``outside_conditions``."""
    slices: dict[tuple[float, float], MapSlice] = {}

    def at(load: float | None, speed: float | None) -> tuple[MapSlice | None, EdvStatus | None]:
        if load is None or speed is None:
            return None, EdvStatus.OUTSIDE_CONDITIONS
        key = (load, speed)
        if key not in slices:
            if len(slices) >= 64:
                slices.clear()
            try:
                slices[key] = to_slice(rms_map, load, speed)
            except OutsideMapError:
                return None, EdvStatus.OUTSIDE_CONDITIONS
        return slices[key], None

    return at


def to_slice(rms_map: RmsMap, load: float, speed: float) -> MapSlice:
    """Return the map of one operating point as the tracker takes it, m/s2."""
    at = rms_map.slice_at(load, speed)
    return MapSlice(dphi_d=at.dphi_d, h_d=at.h_d, rms=at.rms, outer_race_radius=rms_map.outer_race_radius)
