"""What of a configuration does not work, or less than it says: places, access, extras, damage, levels."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from monitor.config.load import Config, ConfigError
from monitor.config.outputs import is_loopback
from monitor.config.plausible import find_doubts
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import JudgedConfig, SourceFacts, place_of
from monitor.config.positions import Place
from monitor.config.source import ChannelSection, SourceSection
from monitor.config.stages import method_or_best
from monitor.desk.judge.sections import missing_extras, taken_families
from monitor.health.tracker import DamageSettings
from monitor.words.calibration import ASSUMED


def find_problems(config: Config, facts: Mapping[str, SourceFacts] | None = None) -> Iterator[Doubt]:
    """Yield what is doubtful in a configuration, and what keeps parts of it from working.

    Args:
        facts: what the files of its sources state, by name.
    """
    yield from find_doubts(config, facts)
    subject = JudgedConfig(config, facts or {})
    yield from _rig_claims(subject)
    for channel in config.channel:
        if channel.track:
            yield from _damage(subject, channel)
        if channel.track and channel.measures_velocity:
            place = place_of(config, "channel", channel.name, "track")
            came = "track = true, but its sensor measures a velocity: V_eq will answer velocity_sensor"
            yield subject.doubt("damage", "problem", place, "a sensor of acceleration", came)
        if channel.unit == "unknown":
            place = place_of(config, "channel", channel.name, "unit")
            if channel.track:
                came = "track = true, but its unit is unknown: V_eq will answer no_absolute_level"
                yield subject.doubt("damage", "problem", place, "g, m/s2 or V", came)
            came = "its unit is unknown: no end of life by peak acceleration"
            yield subject.doubt("unit_unknown", "warning", place, "g, m/s2 or V", came)
    yield from _speed(subject)
    yield from missing_extras(subject)
    yield from taken_families(subject)
    yield from _unlearned_levels(subject)
    for at, source in enumerate(config.source):
        yield from _access(subject, at, source)
        yield from _place_doubts(subject, at, source)


def is_recording(source: SourceSection) -> bool:
    """Return whether a source is one that only ``replay`` reads."""
    if source.url is None:
        return True
    scheme, colon, _ = source.url.partition(":")
    return "://" not in source.url and (not colon or scheme not in ("folder", "tcp", "mqtt"))


def _speed(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield that nothing gives a speed but, perhaps, the recording."""
    config = subject.config
    pulses = all(source.pulses is not None for source in config.source)
    if config.operating.speed_hz is not None or config.operating.to_condition(pulses=pulses).varies:
        return
    unstated = [name for name, found in subject.facts.items() if found.speed is None]
    place: Place = ("operating", "speed_hz")
    if unstated:
        came = (
            f"neither the configuration nor the first file of source {unstated[0]!r} states a speed: no part is named"
        )
        yield subject.doubt("no_speed", "problem", place, 'speed_hz, or speed = "estimate"', came)
    elif not subject.facts:
        came = "is not given: only recordings that state their speed can be monitored"
        yield subject.doubt("no_speed", "warning", place, 'speed_hz, or speed = "estimate"', came)


def _place_doubts(subject: JudgedConfig, at: int, source: SourceSection) -> Iterator[Doubt]:
    """Yield that a folder or recording is missing, empty, or nothing for the daemon."""
    url, place = source.url, ("source", at, "url")
    if url is None:
        return
    path = Path(url.removeprefix("folder:") if url.startswith("folder:") else url.split(":", 2)[-1])
    kind = "recording" if is_recording(source) else "folder" if url.startswith("folder:") else None
    if kind is not None and "://" not in url and not url.startswith("rig:") and not path.exists():
        came = f"{kind} {str(path)!r} does not exist (yet)"
        yield subject.doubt("place", "problem", place, f"a {kind} that exists", came)
    elif kind == "recording":
        came = f"url {url!r} is a recording: replay reads it, run refuses it"
        yield subject.doubt("place", "warning", place, "folder:PATH, tcp:// or mqtt:// for the daemon", came)
    elif kind is None:
        return
    elif path.is_dir() and not any(path.iterdir()):
        yield subject.doubt(
            "place", "warning", place, "files, or a logger that will write them", f"{str(path)!r} is empty"
        )


def _rig_claims(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield what ``[rig]`` claims beyond what it states: that it is calibrated, or by whom."""
    config = subject.config
    place: Place = ("rig", "calibrated")
    if config.rig.claim != config.rig.calibrated:
        came = 'true without identification (the hash that identify writes) counts as "declared"'
        yield subject.doubt("rig", "warning", place, "identification", came)
    named = config.rig.bearing or config.bearing[0].name
    element = next(section for section in config.bearing if section.name == named).to_bearing().element
    keys = config.rig.assumed_keys(geometric=element == "roller")
    if config.rig.claim is not False and keys:
        came = f"{json.dumps(config.rig.calibrated)}, but {', '.join(keys)}: {ASSUMED}"
        yield subject.doubt("rig", "warning", place, "all numbers of the model", came)


def _access(subject: JudgedConfig, at: int, source: SourceSection) -> Iterator[Doubt]:
    """Yield who could send without proof, or why no machine can at all."""
    from streams.link.peer import key_weakness, read_key, receiver_context
    from streams.types.spec import SourceError, parse_address

    url = source.url or ""
    if not url.startswith(("tcp://", "mqtt://")):
        return
    place: Place = ("source", at, "stream_key_file")
    try:
        address = parse_address(url, f"[[source]] {source.name}: url")
        if source.stream_key_file is not None:
            key = read_key(source.stream_key_file, f"[[source]] {source.name}: stream_key_file")
            weakness = key_weakness(source.stream_key_file, key)
            if weakness is not None:
                yield subject.doubt("access", "warning", place, "a key that only this computer knows", weakness)
        if source.tls_cert_file is not None and source.tls_key_file is not None:
            receiver_context(source.tls_cert_file, source.tls_key_file, f"[[source]] {source.name}")
    except SourceError as error:
        yield subject.doubt(
            "access", "problem", ("source", at, "url"), "an address and files that can be used", str(error)
        )
        return
    near = is_loopback(address.host)
    if address.scheme == "tcp" and source.stream_key_file is None:
        whose = "machines among peers may send" if source.peers else "other machines could send, so run refuses it,"
        came = f"{'every user of this computer may send' if near else whose} without a key; give stream_key_file"
        yield subject.doubt("access", "warning" if near or source.peers else "problem", place, "a key", came)
    if near:
        return
    if address.scheme == "mqtt" and source.username_file is None and source.cert_file is None:
        came = "nothing proves to the broker who publishes or reads; give username_file or cert_file"
        yield subject.doubt("access", "warning", ("source", at, "username_file"), "a proof of identity", came)
    if address.scheme == "mqtt" and source.password_file is not None and source.ca_file is None:
        came = "the password goes to the broker in the clear; give ca_file"
        yield subject.doubt("access", "warning", ("source", at, "ca_file"), "an encrypted connection", came)


def _unlearned_levels(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield the learned levels that were configured after the learning stage: they can never raise an alarm."""
    config = subject.config
    rules = {
        channel.name: [
            rule
            for rule in config.alarms.to_settings(channel.name, 0).rules
            if rule.feature != "rms"
            and any(level is not None and level.value is None for level in (rule.alert, rule.danger))
        ]
        for channel in config.channel
    }
    database = config.machine.state_dir / "state.db"
    if not any(rules.values()) or not database.exists():
        return
    from monitor.records.database import StoreError

    try:
        learned = _learned(config, database)
    except (StoreError, ValueError) as error:
        yield subject.doubt(
            "level_unlearned", "problem", ("machine", "state_dir"), "a store of this version", str(error)
        )
        return
    places = {level.rule_name: at for at, level in enumerate(config.alarms.level)}
    for channel, names in learned.items():
        for rule in rules[channel]:
            if rule.name not in names:
                came = (
                    f"channel {channel!r}: level {rule.name!r} has no effect: it was configured after the learning "
                    f"stage, when {rule.feature} was not learned; give it as a number"
                )
                place = ("alarms", "level", places[rule.name])
                yield subject.doubt("level_unlearned", "problem", place, "a level in numbers", came)


def _learned(config: Config, database: Path) -> dict[str, set[str]]:
    """Return the rules that have learned a level, by channel, without channels that are still learning.

    Raises:
        StoreError: the store cannot be read.
        ValueError: it was written by another version.
    """
    from monitor.health.alarms import AlarmState
    from monitor.health.state import ChannelState
    from monitor.records.store import Store

    with Store.open(database, read_only=True) as store:
        states = store.load_states()
    found: dict[str, set[str]] = {}
    for channel in config.channel:
        stored, alarms = (states.get(f"{kind}:{channel.source}:{channel.name}") for kind in ("channel", "alarms"))
        if stored is not None and ChannelState.from_dict(stored).detect.stage != "learning":
            rules = {} if alarms is None else AlarmState.from_dict(alarms).rules
            found[channel.name] = {name for name, rule in rules.items() if rule.baseline is not None or rule.learned}
    return found


def _damage(subject: JudgedConfig, channel: ChannelSection) -> Iterator[Doubt]:
    """Yield what a tracked channel lacks: its map, its library, or conditions that they do not cover."""
    from monitor.service.setup import source_settings
    from monitor.service.summary import channel_lines, uncalibrated_lines

    config = subject.config
    place = place_of(config, "channel", channel.name, "track")
    missing = list(_missing_files(subject, channel))
    yield from missing
    uncalibrated: list[str] = []
    damage: DamageSettings | None = None
    if missing and config.calibration_of(channel) is False:
        uncalibrated += channel_lines(config, channel)
    elif not missing and (channel.maps or channel.library is not None or config.forecast.library is not None):
        source = next(source for source in config.source if source.name == channel.source)
        try:
            found = source_settings(config, source).channels
        except ConfigError as error:
            yield subject.doubt("damage", "problem", place, "a map or library that fits", str(error))
            return
        uncalibrated += uncalibrated_lines(config, {channel.name: found[channel.name]})
        damage = found[channel.name].damage
    for line in uncalibrated:
        came = line.removeprefix(f"channel {channel.name!r}: ")
        yield subject.doubt("damage", "warning", place, "a calibrated rig", came)
    if damage is not None:
        yield from _coverage(subject, channel, damage)


def _coverage(subject: JudgedConfig, channel: ChannelSection, damage: DamageSettings) -> Iterator[Doubt]:
    """Yield which conditions and thresholds a map or a library does not cover."""
    operating, thresholds = subject.config.operating, subject.config.forecast.thresholds
    load, speed = operating.load_newton, operating.speed_hz
    place = place_of(subject.config, "channel", channel.name, "map")
    for part, rms_map in damage.maps.items():
        level_map = rms_map.map_at(load, speed)[0]
        if level_map is None:
            came = f"its map of the part {part!r} does not cover the configured load and speed"
            yield subject.doubt("damage", "problem", place, "a map of this load and speed", came)
            continue
        highest = float(level_map.part_radius * level_map.dphi_d[-1] * level_map.h_d[-1])
        if thresholds[-1] > highest:
            came = f"channel {channel.name!r}: {1e6 * thresholds[-1]:g} mm2 is never reached"
            expected = f"up to {1e6 * highest:.3g} mm2, the largest V_eq of its map of the part {part!r}"
            given = "threshold_mm2" in subject.config.forecast.model_fields_set
            severity = "problem" if given else "warning"
            yield subject.doubt("threshold", severity, ("forecast", "threshold_mm2"), expected, came)
    library = damage.library
    if library is not None and (load is None or speed is None or not library.covers_conditions(load, speed)):
        place = place_of(subject.config, "channel", channel.name, "library")
        came = "its library does not cover the configured load and speed"
        yield subject.doubt("damage", "problem", place, "a library of this load and speed", came)


def _missing_files(subject: JudgedConfig, channel: ChannelSection) -> Iterator[Doubt]:
    config = subject.config
    place = place_of(config, "channel", channel.name)
    track, forecast = methods(config, channel)
    learns = forecast in ("learned", "combined")
    if not channel.maps and track in ("thesis", "filter") and not (learns and config.track.method is None):
        came = "track = true, but no map is given: V_eq will answer no_map"
        yield subject.doubt("damage", "problem", (*place, "track"), "map", came)
    if learns and config.forecast.library is None:
        came = (
            f'method = "{forecast}" without a library of [forecast]: TT is as long again as it has lasted; '
            "learn from recorded runs with: spallwatch library learn RUNS... --out FILE"
        )
        yield subject.doubt("damage", "warning", ("forecast", "method"), "library", came)
    if channel.library is None and "library" in (track, forecast):
        came = 'method = "library", but no library is given: the answer will be no_library'
        yield subject.doubt("damage", "problem", (*place, "track"), "library", came)
    for kind, path in (*(("map", path) for path in channel.maps), ("library", channel.library)):
        if path is not None and not path.exists():
            came = f"{kind} {path.name} does not exist (yet); make it with: spallwatch {kind} build"
            yield subject.doubt("damage", "problem", (*place, kind), "a file that exists", came)
    if config.forecast.library is not None and not config.forecast.library.exists():
        came = f"library {config.forecast.library.name} does not exist (yet); make it with: spallwatch library learn"
        yield subject.doubt("damage", "problem", ("forecast", "library"), "a file that exists", came)


def methods(config: Config, channel: ChannelSection) -> tuple[str, str]:
    """Return the methods for V_eq and TT."""
    library = channel.library
    return method_or_best(config.track.method, library), method_or_best(config.forecast.method, library)
