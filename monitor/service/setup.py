"""From a validated configuration to the settings of the stages and the sources, in SI."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Generic, TypeVar

from models.lives.population import Population
from models.machine.bearing import Bearing, kinematics_uncertainty
from models.machine.rig import Calibration, RigParameters
from models.machine.scene import PARTS, Part
from models.maps.data import OutsideMapError, RmsMap
from models.maps.file import load_map
from models.maps.plan import MapError
from monitor.config.interference import removed_lines
from monitor.config.load import Config, ConfigError
from monitor.config.source import ChannelSection, SourceSection
from monitor.config.stages import method_or_best
from monitor.health.output import ChannelOutput
from monitor.health.rest.learned.model import LearnedModel
from monitor.health.size import EdvStatus, RemainingSettings
from monitor.health.size.edv import EdvSettings
from monitor.health.size.filter.particle_filter import FilterSettings
from monitor.health.size.filter.prior import GrowthPrior
from monitor.health.size.level_set import LevelMap
from monitor.health.size.library.forecaster import LibrarySettings
from monitor.health.size.library.model import Library
from monitor.health.state import ChannelSettings, SourceSettings
from monitor.health.tracker import DamageSettings, PartMap
from monitor.pipeline import Pipeline
from monitor.records.library_file import LearnedFileError, LibraryError, is_learned, load_learned, load_library
from monitor.service.summary import calibration_of
from monitor.words.zones import MACHINE_CLASSES
from streams.dates.dating import Dating
from streams.files.container import Files
from streams.open import open_source
from streams.recording.state import ReadingState
from streams.types.block import STANDARD_GRAVITY, VELOCITY, Block
from streams.types.source import Source
from streams.types.spec import ChannelSpec, SourceError, SourceSpec

Slice = TypeVar("Slice")

_SAME_OF_SOURCE = (
    *("block_s", "format", "range_g", "settle_s", "max_gap_blocks"),
    *("time_from", "time_name", "date_order", "pulses", "disregard", "files"),
)
_SAME_OF_CHANNEL = ("name", "column", "key", "unit", "scale", "sensitivity_mv_per_g")
"""Keys of the configuration that a specification has as they are."""
_MAX_SLICES = 64
_GEOMETRY = ("n_elements", "rows", "element_diameter", "pitch_diameter", "contact_angle", "outer_race_radius")
_CLAIMS = ("calibrated", "identification")


def source_spec(config: Config, source: SourceSection, path: str | None = None) -> SourceSpec:
    """Return the specification of a source at ``path`` or its configured URL; ConfigError where there is neither."""
    url = path if path is not None else source.url
    if url is None:
        raise ConfigError(f"[[source]] {source.name}: url is missing, and no path was given in its place")
    channels = tuple(
        ChannelSpec(**{name: getattr(channel, name) for name in _SAME_OF_CHANNEL})
        for channel in config.channel
        if channel.source == source.name
    )
    return SourceSpec(
        name=source.name,
        url=url,
        start=None if source.start_utc is None else source.start_utc.timestamp(),
        rate=source.rate_hz,
        channels=(*channels, *config.operating.channel_specs()),
        timezone=config.machine.timezone,
        network=source.to_network(),
        interval=source.interval_s,
        block_revolutions=None
        if source.block_revolutions is None
        else config.operating.to_block_revolutions(source.block_revolutions),
        **{name: getattr(source, name) for name in _SAME_OF_SOURCE},
    )


def only_source(config: Config, what: str) -> SourceSection:
    """Return the source of a machine that has one; ConfigError, which begins with ``what`` needs it, of another."""
    if len(config.source) != 1:
        raise ConfigError(f"{what} takes a configuration with one [[source]], this one has {len(config.source)}")
    return config.source[0]


def open_configured(
    config: Config,
    source: SourceSection,
    path: str | None = None,
    kept: Dating | None = None,
    begin: ReadingState | None = None,
    files: Files | None = None,
) -> Source:
    """Open a source of the configuration, or raise ConfigError; arguments as :func:`streams.open.open_source`."""
    try:
        return open_source(source_spec(config, source, path), kept, begin, files)
    except SourceError as error:
        raise ConfigError(str(error)) from None


def source_settings(
    config: Config,
    source: SourceSection,
    maps: Mapping[str, RmsMap] | None = None,
    libraries: Mapping[str, Library] | None = None,
) -> SourceSettings:
    """Return the settings of a source and its channels, their maps and libraries loaded.

    ``maps`` and ``libraries`` by channel take the place of the configured files.

    Raises:
        ConfigError: a map or a library cannot be read or does not fit the channel, or two maps are of one part.
    """
    channels = {}
    for channel in config.channel:
        if channel.source != source.name:
            continue
        given = (maps or {}).get(channel.name)
        own = [] if given is None else [given]
        if given is None and channel.track:
            own = [_load(channel, path) for path in channel.maps]
        by_part = _by_part(config, channel, own)
        library = (libraries or {}).get(channel.name)
        if library is None and channel.track and channel.library is not None:
            library = _load_library(channel, channel.library)
        if library is not None:
            _check_library(config, channel, library)
        channels[channel.name] = _channel_settings(config, source, channel, by_part, library)
    return SourceSettings(source.name, channels, source.rate_hz)


def accepted_blocks(
    config: Config, recording: str, what: str
) -> Iterator[tuple[Block, Mapping[str, ChannelOutput], Mapping[str, ChannelSettings]]]:
    """Yield the accepted blocks of a recording with what the stages make of their channels, and the settings of these.

    Raises:
        ConfigError: the machine has several sources, of which ``what`` takes one, or the recording does not fit it.
    """
    section = only_source(config, what)
    settings, source = source_settings(config, section), open_configured(config, section, recording)
    for block, output, _ in Pipeline({settings.name: settings}).play(source):
        if isinstance(block, Block) and output.channels:
            yield block, output.channels, settings.channels


def _by_part(config: Config, channel: ChannelSection, maps: Sequence[RmsMap]) -> dict[Part, RmsMap]:
    """Return the maps of a channel by their damaged part, each checked against the channel."""
    found: dict[Part, RmsMap] = {}
    for rms_map in maps:
        plan = rms_map.plan
        if plan.part in found:
            raise ConfigError(f"channel {channel.name!r}: map: two files are maps of the part {plan.part!r}")
        _check_band(channel, rms_map.rms_band, "map")
        _check_origin(config, channel, "map", (plan.bearing, plan.rig, plan.clearance), plan.part)
        found[plan.part] = rms_map
    return found


def _load(channel: ChannelSection, path: Path) -> RmsMap:
    try:
        return load_map(path)
    except (MapError, FileNotFoundError) as error:
        hint = "" if path.exists() else "; make it with: spallwatch map build --out FILE"
        raise ConfigError(f"channel {channel.name!r}: map: {error}{hint}") from None


def _load_library(channel: ChannelSection, path: Path) -> Library:
    try:
        return load_library(path)
    except LibraryError as error:
        hint = ""
        if is_learned(path):
            hint = '; it was learned from recorded runs: give it as library of [forecast], with method = "learned"'
        raise ConfigError(f"channel {channel.name!r}: library: {error}{hint}") from None


def learned_model(config: Config) -> LearnedModel:
    """Return what ``[forecast]`` has learned from recorded runs; without a file, the elapsed time alone.

    Raises:
        ConfigError: the file cannot be used.
    """
    if config.forecast.library is None:
        return LearnedModel()
    try:
        return load_learned(config.forecast.library)
    except LearnedFileError as error:
        raise ConfigError(f"[forecast] library: {error}") from None


def _check_library(config: Config, channel: ChannelSection, library: Library) -> None:
    """Refuse a library without the configured features or thresholds, or of another machine."""
    features = "+".join(config.track.features)
    try:
        library.fit_for(features)
        for threshold in config.forecast.thresholds:
            library.target(threshold)
    except ValueError as error:
        raise ConfigError(f"channel {channel.name!r}: library: {error}") from None
    if "population" in library.made_of:
        population = Population.from_json(json.dumps(library.made_of["population"]))
        _check_band(channel, population.rms_band, "library")
        _check_origin(config, channel, "library", (population.bearing, population.rig, population.clearance))


def _check_band(channel: ChannelSection, made_for: tuple[float, float] | None, kind: str) -> None:
    """Refuse a map or library with another RMS band than that of the channel."""
    band = None if made_for is None else tuple(made_for)
    if band != channel.rms_band_hz:
        raise ConfigError(
            f"channel {channel.name!r}: rms_band_hz = {_words(channel.rms_band_hz)}, but its {kind} was made for "
            f"{_words(band)}; both must be the same"
        )


def _check_origin(
    config: Config,
    channel: ChannelSection,
    kind: str,
    made_for: tuple[Bearing, RigParameters, float],
    part: Part = "outer",
) -> None:
    """Refuse a map or library of another bearing or rig, whose volumes would be wrong."""
    of_bearing, of_rig, of_clearance = made_for
    bearing, rig = config.bearing_of(channel), config.parameters_of(type(of_rig), config.entry_of(channel))
    clearance = next(b.clearance_um for b in config.bearing if b.name == channel.bearing) * 1e-6
    geometry = _GEOMETRY if part == "outer" else (*_GEOMETRY, "inner_race_radius")
    pairs = [(f"bearing {name}", getattr(of_bearing, name), getattr(bearing, name)) for name in geometry]
    names = [item.name for item in fields(of_rig) if item.name not in _CLAIMS]
    pairs += [(f"rig {name}", getattr(of_rig, name), getattr(rig, name)) for name in names]
    pairs.append(("clearance", of_clearance, clearance))
    for name, made, configured in pairs:
        if made != configured and not _close(made, configured):
            raise ConfigError(
                f"channel {channel.name!r}: its {kind} was made for {name} = {made!r}, "
                f"configured is {configured!r} (SI); build it again with: spallwatch {kind} build --config FILE"
            )


def _close(made: object, configured: object) -> bool:
    """Return whether two values are numbers that differ by rounding only; None counts as 0."""
    pair = [0.0 if value is None else value for value in (made, configured)]
    numbers = [value for value in pair if isinstance(value, int | float)]
    return len(numbers) == len(pair) and math.isclose(*numbers, rel_tol=1e-6, abs_tol=1e-12)


def _words(band: tuple[float, ...] | None) -> str:
    return "the full bandwidth" if band is None else f"[{band[0]:g}, {band[1]:g}] Hz"


def _channel_settings(
    config: Config,
    source: SourceSection,
    channel: ChannelSection,
    maps: Mapping[Part, RmsMap],
    library: Library | None,
) -> ChannelSettings:
    samples = signal_range = None
    if source.block_s != "file" and source.rate_hz is not None and source.block_revolutions is None:
        samples = round(source.block_s * source.rate_hz)
    calibrated = calibration_of(config, channel, maps.values(), library)
    absolute_volume = calibrated is not False or not channel.track or config.forecast.uncalibrated_threshold
    damage = _damage_settings(config, maps, library, calibrated) if channel.track else None
    if source.range_g is not None and channel.unit not in ("unknown", VELOCITY):
        signal_range = source.range_g * STANDARD_GRAVITY
    return ChannelSettings(
        name=channel.name,
        bearing=config.bearing_of(channel),
        listens_to=channel.bearing,
        uncertainty=kinematics_uncertainty(config.entry_of(channel)),
        unit=channel.unit,
        scale=1.0 if channel.scale is None else channel.scale,
        sensitivity_mv_per_g=channel.sensitivity_mv_per_g,
        signal_range=signal_range,
        velocity_limit=channel.velocity_limit,
        samples=samples,
        bands=None if channel.band_hz == "auto" else tuple(channel.band_hz),
        rms_band=channel.rms_band_hz,
        interference=removed_lines(config),
        average_blocks=channel.average_blocks,
        condition=config.operating.to_condition(pulses=source.pulses is not None),
        detect=config.detect.to_settings(),
        damage=damage,
        calibration=calibrated if damage is not None and damage.tracks_volume else None,
        map_hash="+".join(maps[part].hash for part in PARTS if part in maps) or None,
        alarms=config.alarms.to_settings(
            channel.name,
            config.detect.run_in_blocks,
            absolute_volume=absolute_volume,
            of_threshold=damage is None or not damage.uses_learned,
        ),
        trend=RemainingSettings(interval=config.forecast.interval),
        waterfall=config.machine.to_waterfall(),
        machine_class=MACHINE_CLASSES.get(config.machine.iso_class or ""),
        gears=None if config.gear is None else config.gear.to_settings(),
    )


def _damage_settings(
    config: Config, maps: Mapping[Part, RmsMap], library: Library | None, calibrated: Calibration
) -> DamageSettings:
    """Return how damage is tracked; without a configured method, by the library where there is one."""
    window = config.forecast.window_hours
    return DamageSettings(
        track_method=method_or_best(config.track.method, library),
        forecast_method=method_or_best(config.forecast.method, library),
        maps={
            part: part_map(rms_map, config.track.features, config.forecast.interval, config.track.growth)
            for part, rms_map in maps.items()
        },
        edv=EdvSettings(smoothing_blocks=config.track.smoothing_blocks),
        thresholds=config.forecast.thresholds,
        library=library,
        library_settings=LibrarySettings(
            features="+".join(config.track.features),
            interval=config.forecast.interval,
            window=None if window is None else window * 3600.0,
        ),
        calibrated=calibrated is not False,
        uncalibrated_threshold=config.forecast.uncalibrated_threshold,
        learned=learned_model(config),
        learned_settings=RemainingSettings(
            interval=config.forecast.interval, window=None if window is None else window * 3600.0
        ),
    )


def part_map(rms_map: RmsMap, features: Sequence[str], interval: float, growth: GrowthPrior | None = None) -> PartMap:
    """Return a map as the trackers take it.

    The filter uses the lines of the outer race only: blocks give the amplitudes of BPFO, those of the other parts not.
    """
    lines = FilterSettings.lines if "harmonics" in features and rms_map.part == "outer" else 0
    return PartMap(
        map_at=_Lookup(lambda load, speed: to_slice(rms_map, load, speed)),
        spread_at=_Lookup(rms_map.slice_at),
        filter=FilterSettings(rms_map.part_radius, lines=lines, interval=interval, growth=growth or GrowthPrior()),
        model=rms_map.plan.model,
    )


class _Lookup(Generic[Slice]):
    """Slices of a map by load and speed, each made once, or ``outside_conditions``.

    Trackers cache derived values by the object.
    """

    def __init__(self, make: Callable[[float, float], Slice]) -> None:
        self._make = make
        self._slices: dict[tuple[float, float], Slice] = {}

    def __call__(self, load: float | None, speed: float | None) -> tuple[Slice | None, EdvStatus | None]:
        if load is None or speed is None:
            return None, EdvStatus.OUTSIDE_CONDITIONS
        key = (load, speed)
        if key not in self._slices:
            if len(self._slices) >= _MAX_SLICES:
                self._slices.clear()
            try:
                self._slices[key] = self._make(load, speed)
            except OutsideMapError:
                return None, EdvStatus.OUTSIDE_CONDITIONS
        return self._slices[key], None


def to_slice(rms_map: RmsMap, load: float, speed: float) -> LevelMap:
    """Return the map of one operating point as the tracker takes it, m/s2."""
    at = rms_map.slice_at(load, speed)
    return LevelMap(dphi_d=at.dphi_d, h_d=at.h_d, rms=at.rms, part_radius=rms_map.part_radius)
