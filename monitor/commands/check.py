"""``spallwatch check``: validate a configuration and list what would be monitored."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click

from models.machine.bearing import kinematics
from models.solve.registry import MODELS
from monitor.commands import option
from monitor.commands.check_sections import (
    interference_lines,
    missing_extras,
    proposal_words,
    propose_interference,
    tacho_words,
    taken_families,
)
from monitor.commands.common import read_config
from monitor.commands.model_parameters import effects_of
from monitor.commands.redate import DatingPreview, keep_previews, preview_dating
from monitor.config.load import Config, ConfigError
from monitor.config.outputs import is_loopback
from monitor.config.source import ChannelSection, SourceSection
from monitor.config.stages import method_or_best
from monitor.service.system import is_running
from monitor.words.calibration import ASSUMED, rig_words


@click.command("check")
@option.config
@click.option("--schema", is_flag=True, help="Print the JSON Schema of the configuration and stop.")
@click.option("--keep", is_flag=True, help="Keep what dates the blocks, as shown, before the first start.")
@click.option(
    "--recording",
    type=option.PLACE,
    help="Look at the first block of a recording for strong lines of other origin, and propose [[interference]].",
)
@option.output
def command(config_path: Path | None, schema: bool, keep: bool, recording: str | None) -> option.Result | None:
    """Validate a configuration and list what would be monitored.

    Whatever `run` would refuse is refused with exit code 2, and so is a folder of records that cannot be written.
    Other problems (a folder that does not exist yet) are listed and do not change the exit code.

    Nothing is written, but with --keep, while the daemon is stopped: then the choice that is shown is the one of the
    daemon, whatever files have come by its start. Only `redate` changes it.
    """
    if schema:
        click.echo(json.dumps(Config.model_json_schema(), indent=2))
        return None
    config = read_config(config_path)
    refuse_what_run_refuses(config)
    proposals = [] if recording is None else propose_interference(config, recording)
    dated = {source.name: found for source in config.source if (found := preview_dating(config, source)) is not None}
    if keep:
        dated = keep_previews(config, dated)
    problems = [
        *find_problems(config),
        *(f"source {n!r}: {text}" for n, found in dated.items() for text in found.problems),
    ]
    values = {
        **config.model_dump(mode="json"),
        "hash": config.hash,
        "dating": {name: _dating_values(found) for name, found in dated.items()},
        "tacho": {name: asdict(found.tacho) for name, found in dated.items() if found.tacho is not None},
        "levels": {channel: text for found in dated.values() for channel, text in found.levels.items()},
        "rigs": {source.name: simulated for source in config.source if (simulated := _rig_limits(source))},
        "interference_proposals": proposals,
        "problems": problems,
    }
    lines = [*_lines(config, problems, dated), *(proposal_words(found) for found in proposals)]
    return values, lines


def _rig_limits(source: SourceSection) -> list[str]:
    """Return in which ways a simulated rig differs from the bench of the thesis, or why it cannot be simulated."""
    if source.url is None or not source.url.startswith("rig:"):
        return []
    from streams.rig.bench import open_rig
    from streams.types.spec import SourceError

    try:
        return list(open_rig(source.url, source.name).limits)
    except SourceError as error:
        return [str(error)]


def refuse_what_run_refuses(config: Config) -> None:
    """Raise ConfigError with all reasons why a daemon cannot start with a configuration, or cannot publish.

    A source without a URL or with that of a recording is left to ``replay``.
    """
    from monitor.service.start import inspect, records_refusals, store_refusals

    sources = [source for source in config.source if not _is_recording(source)]
    found = inspect(config, sources, running=is_running(config.machine.state_dir))
    refusals = [*found.refusals, *store_refusals(config, found), *records_refusals(config)]
    if refusals:
        raise ConfigError("\n".join(dict.fromkeys(refusals)))


def _is_recording(source: SourceSection) -> bool:
    """Return whether a source is one that only ``replay`` reads."""
    if source.url is None:
        return True
    scheme, colon, _ = source.url.partition(":")
    return "://" not in source.url and (not colon or scheme not in ("folder", "tcp", "mqtt"))


def find_problems(config: Config) -> Iterator[str]:
    """Yield the problems that keep parts of the configuration from working."""
    if config.rig.claim != config.rig.calibrated:
        yield 'rig.calibrated = true without identification (the hash that identify writes) counts as "declared"'
    yield from _assumed(config)
    for channel in config.channel:
        name = f"channel {channel.name!r}"
        if channel.track:
            yield from _track_problems(config, channel)
        if channel.unit == "unknown":
            if channel.track:
                yield f"{name}: track = true, but its unit is unknown: V_eq will answer no_absolute_level"
            yield f"{name}: its unit is unknown: no end of life by peak acceleration"
    operating = config.operating
    pulses = all(source.pulses is not None for source in config.source)
    if operating.speed_hz is None and not operating.to_condition(pulses=pulses).varies:
        yield "operating.speed_hz is not given: only recordings that state their speed can be monitored"
    yield from missing_extras(config)
    yield from taken_families(config)
    yield from _unlearned_levels(config)
    for source in config.source:
        yield from _access_problems(source)
        if source.url is None:
            continue
        if _is_recording(source):
            yield f"source {source.name!r}: url {source.url!r} is a recording: replay reads it, run refuses it"
        place = source.url.removeprefix("folder:")
        if source.url.startswith("folder:") and not Path(place).exists():
            yield f"source {source.name!r}: folder {place!r} does not exist (yet)"


def _assumed(config: Config) -> Iterator[str]:
    """Yield which numbers of a rig that is said to be calibrated are nevertheless those of the default test bench."""
    named = config.rig.bearing or config.bearing[0].name
    element = next(section for section in config.bearing if section.name == named).to_bearing().element
    keys = config.rig.assumed_keys(geometric=element == "roller")
    if config.rig.claim is not False and keys:
        yield f"rig.calibrated = {json.dumps(config.rig.calibrated)}, but {', '.join(keys)}: {ASSUMED}"


def _access_problems(source: SourceSection) -> Iterator[str]:
    """Yield why other machines could send without proof, or no machine at all."""
    from streams.link.peer import key_weakness, read_key, receiver_context
    from streams.types.spec import SourceError, parse_address

    name, url = f"source {source.name!r}", source.url or ""
    if not url.startswith(("tcp://", "mqtt://")):
        return
    try:
        address = parse_address(url, f"[[source]] {source.name}: url")
        if source.stream_key_file is not None:
            key = read_key(source.stream_key_file, f"[[source]] {source.name}: stream_key_file")
            weakness = key_weakness(source.stream_key_file, key)
            if weakness is not None:
                yield f"{name}: {weakness}"
        if source.tls_cert_file is not None and source.tls_key_file is not None:
            receiver_context(source.tls_cert_file, source.tls_key_file, f"[[source]] {source.name}")
    except SourceError as error:
        yield str(error)
        return
    if is_loopback(address.host):
        return
    if address.scheme == "tcp" and source.stream_key_file is None:
        whose = "machines among peers may send" if source.peers else "other machines could send, so run refuses it,"
        yield f"{name}: {whose} without a key; give stream_key_file"
    if address.scheme == "mqtt" and source.username_file is None and source.cert_file is None:
        yield f"{name}: nothing proves to the broker who publishes or reads; give username_file or cert_file"


def _unlearned_levels(config: Config) -> Iterator[str]:
    """Yield the learned levels that were configured after the learning stage: they can never raise an alarm."""
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
        yield str(error)
        return
    for channel, names in learned.items():
        for rule in rules[channel]:
            if rule.name not in names:
                yield (
                    f"channel {channel!r}: level {rule.name!r} has no effect: it was configured after the learning "
                    f"stage, when {rule.feature} was not learned; give it as a number"
                )


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


def _track_problems(config: Config, channel: ChannelSection) -> Iterator[str]:
    """Yield what a tracked channel lacks: its map, its library, or conditions that they do not cover."""
    from monitor.service.setup import source_settings
    from monitor.service.summary import channel_lines, uncalibrated_lines

    missing = list(_missing_files(config, channel))
    yield from missing
    if missing and config.calibration_of(channel) is False:
        yield from channel_lines(config, channel)
    if missing or (not channel.maps and channel.library is None and config.forecast.library is None):
        return
    source = next(source for source in config.source if source.name == channel.source)
    try:
        found = source_settings(config, source).channels
    except ConfigError as error:
        yield str(error)
        return
    yield from uncalibrated_lines(config, {channel.name: found[channel.name]})
    damage = found[channel.name].damage
    load, speed = config.operating.load_newton, config.operating.speed_hz
    for part, rms_map in {} if damage is None else damage.maps.items():
        if rms_map.map_at(load, speed)[0] is None:
            yield f"channel {channel.name!r}: its map of the part {part!r} does not cover the configured load and speed"
    library = None if damage is None else damage.library
    if library is not None and (load is None or speed is None or not library.covers_conditions(load, speed)):
        yield f"channel {channel.name!r}: its library does not cover the configured load and speed"


def _missing_files(config: Config, channel: ChannelSection) -> Iterator[str]:
    name = f"channel {channel.name!r}"
    track, forecast = _methods(config, channel)
    learns = forecast in ("learned", "combined")
    if not channel.maps and track in ("thesis", "filter") and not (learns and config.track.method is None):
        yield f"{name}: track = true, but no map is given: V_eq will answer no_map"
    if learns and config.forecast.library is None:
        yield (
            f'{name}: method = "{forecast}" without a library of [forecast]: TT is as long again as it has lasted; '
            "learn from recorded runs with: spallwatch library learn RUNS... --out FILE"
        )
    if channel.library is None and "library" in (track, forecast):
        yield f'{name}: method = "library", but no library is given: the answer will be no_library'
    for kind, path in (*(("map", path) for path in channel.maps), ("library", channel.library)):
        if path is not None and not path.exists():
            yield f"{name}: {kind} {path.name} does not exist (yet); make it with: spallwatch {kind} build"
    if config.forecast.library is not None and not config.forecast.library.exists():
        yield (
            f"{name}: [forecast] library {config.forecast.library.name} does not exist (yet); make it with: "
            "spallwatch library learn"
        )


def _methods(config: Config, channel: ChannelSection) -> tuple[str, str]:
    """Return the methods for V_eq and TT."""
    library = channel.library
    return method_or_best(config.track.method, library), method_or_best(config.forecast.method, library)


def _lines(config: Config, problems: list[str], dated: Mapping[str, DatingPreview]) -> Iterator[str]:
    speed = config.operating.speed_hz
    yield f"machine {config.machine.name}" + (f", shaft {speed:g} Hz ({60 * speed:g} rpm)" if speed else "")
    for source in config.source:
        rate = "rate from the recording" if source.rate_hz is None else f"{source.rate_hz:g} Hz"
        block = "one block a file" if source.block_s == "file" else f"{source.block_s:g} s blocks"
        yield f"source {source.name}: {source.url or 'path given to replay'}, format {source.format}, {rate}, {block}"
        yield from (f"  simulated: {limit}" for limit in _rig_limits(source))
        if source.name in dated:
            yield from _dating_lines(dated[source.name])
            tacho = dated[source.name].tacho
            yield from () if tacho is None else (f"  {tacho_words(tacho)}",)
        levels = dated[source.name].levels if source.name in dated else {}
        for channel in config.channel:
            if channel.source == source.name:
                yield from _channel_lines(config, channel, speed)
                if channel.name in levels:
                    yield f"    level: {levels[channel.name]}"
    yield from _shaft_lines(config)
    yield from gear_lines(config)
    yield from interference_lines(config)
    detect = config.detect
    length = f"{detect.learn_hours:g} h" if detect.learn_hours else f"{detect.to_settings().learn_blocks} blocks"
    yield (
        f"detection: {detect.run_in_blocks} blocks run-in, {length} baseline, "
        f"alarm after {detect.persist_blocks} blocks over the threshold, at most "
        f"{detect.false_alarms_per_1000_blocks:g} in 1000 healthy blocks, closed again after {detect.close_blocks} "
        f"quiet ones; features {', '.join(detect.features)}; "
        f"end of life at {detect.end_of_life_peak_g:g} g in {detect.end_of_life_blocks} blocks"
    )
    yield from _alarm_lines(config)
    yield from (f"problem: {problem}" for problem in problems)


def gear_lines(config: Config) -> Iterator[str]:
    """Yield the pairs of ``[gear]`` with their mesh orders, one line each."""
    if config.gear is None:
        return
    settings = config.gear.to_settings()
    for pair in settings.pairs:
        driver, driven = settings.by_name[pair.driver], settings.by_name[pair.driven]
        yield (
            f"gears {driver.name} and {driven.name}, {driver.teeth}/{driven.teeth}: "
            f"mesh order {driver.mesh_order:.6g} of shaft {config.gear.speed_shaft}"
        )


def _shaft_lines(config: Config) -> Iterator[str]:
    """Yield what ``[shaft]`` and the axial load say, and which models take it."""
    for model, keys in config.shaft.used_by():
        claim = "" if config.shaft.calibrated is False else " (declared)"
        yield f"shaft, for {model}{claim}: " + ", ".join(f"{key} {getattr(config.shaft, key):g}" for key in keys)
    for name, (key, _) in config.scene_values().items():
        able = [model for model in MODELS if name in effects_of(model)]
        section, _, last = key.partition(".")
        yield f"{key} {getattr(getattr(config, section), last)}, taken by {', '.join(able) or 'no model'}"


def _dating_values(found: DatingPreview) -> dict[str, Any]:
    """Return a preview as plain values, without levels and tacho, which stand apart, and the choice as it is kept."""
    values = asdict(replace(found, levels={}))
    del values["levels"], values["choice"], values["tacho"]
    return values


def _dating_lines(found: DatingPreview) -> Iterator[str]:
    """Yield what dates the blocks of a source, with an example."""
    if found.kept:
        yield "  dates: this choice is kept, and changed by redate only"
    if found.file is None:
        yield f"  dates: {found.text}"
        return
    for place, words in zip(("first", "last"), found.ends, strict=False):
        yield f"  {place} file: {words}"
    when = found.time_utc or ("no date" if found.elapsed_s is None else f"{found.elapsed_s:g} s from the first block")
    yield f"  dates: {found.text}; {found.file}: {when}"


def _alarm_lines(config: Config) -> Iterator[str]:
    """Yield the alarm levels and the notification channels of a daemon."""
    for level in config.alarms.level:
        values = [
            " ".join([key.partition("_")[0], f"{value:g}", key.partition("_")[2]]).strip()
            for key, value in level
            if value is not None and key.startswith(("alert", "danger"))
        ]
        where = f" of {', '.join(level.channels)}" if level.channels else ""
        yield f"alarm {level.rule_name}: {level.feature}{where}, {', '.join(values)}"
    channels = [name for name in ("smtp", "webhook", "mqtt") if getattr(config.notify, name) is not None]
    if channels:
        yield f"notifications: {', '.join(channels)}, at most {config.notify.most_per_hour} messages an hour"
    if config.notify.heartbeat_url is not None:
        host = urlsplit(config.notify.heartbeat_url).hostname
        yield f"heartbeat: {host}, every {config.notify.heartbeat_interval_s:g} s"


def _channel_lines(config: Config, channel: ChannelSection, speed: float | None) -> Iterator[str]:
    bearing = config.bearing_of(channel)
    place: Any = channel.key or channel.column or channel.name
    bands = (
        "a band chosen on the first blocks"
        if channel.band_hz == "auto"
        else ", ".join(f"{low:g}-{high:g} Hz" for low, high in channel.band_hz)
    )
    yield f"  channel {channel.name} ({place}, {channel.unit}) on {bearing.designation}: envelope of {bands}"
    if speed is not None:
        lines = kinematics(bearing, speed)
        yield (f"    outer {lines.bpfo:.2f}, inner {lines.bpfi:.2f}, ball {2 * lines.bsf:.2f}, cage {lines.ftf:.2f} Hz")
    if channel.track:
        track, forecast = _methods(config, channel)
        thresholds = ", ".join(f"{v * 1e6:g}" for v in config.forecast.thresholds)
        yield f"    tracked: V_eq by {track}, TT by {forecast}, to {thresholds} mm3/mm"
        if config.calibration_of(channel) is not False:
            yield f"    rig {rig_words(config.rig_of(config.entry_of(channel)))}"
