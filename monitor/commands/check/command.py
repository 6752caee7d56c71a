"""``spallwatch check``: validate a configuration and list what would be monitored."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click

from models.machine.bearing import kinematics
from models.solve.registry import MODELS
from models.work.redact import redact
from monitor.commands import option
from monitor.commands.check.entries import (
    entries,
    invalid_entries,
    problem_lines,
    redacted,
    refused_doubts,
    run_refusals,
)
from monitor.commands.common import read_config
from monitor.commands.model_parameters import effects_of
from monitor.commands.redate import keep_previews
from monitor.config.load import Config, ConfigError
from monitor.config.source import ChannelSection, SourceSection
from monitor.desk.judge.dating import DatingPreview, preview_dating
from monitor.desk.judge.problems import find_problems, methods
from monitor.desk.judge.sections import interference_lines, proposal_words, propose_interference, tacho_words
from monitor.words.calibration import rig_words

_MAX_IGNORED = 5
"""Files that are not read of which each is said."""


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
def command(
    config_path: Path | None, schema: bool, keep: bool, recording: str | None, as_json: bool
) -> option.Result | None:
    """Validate a configuration, judge it and the files that wait, and list what would be monitored.

    Exit code 2 where something is a problem: results would be wrong, or absent though they are asked for. A warning
    does not change the exit code. Whatever `run` would refuse is refused, and a folder of records that cannot be
    written; with --json, the object lists that among its problems.

    Nothing is written, but with --keep, while the daemon is stopped: then the choice that is shown is the one of the
    daemon, whatever files have come by its start. Only `redate` changes it.
    """
    if schema:
        click.echo(json.dumps(Config.model_json_schema(), indent=2))
        return None
    path = config_path or Path("config.toml")
    try:
        config = read_config(config_path)
        refused = run_refusals(config)
        if refused and not as_json:
            raise ConfigError("\n".join(refused))
    except ConfigError as error:
        if not as_json or not path.is_file():
            raise
        return {"problems": invalid_entries(redact(str(error)), path)}, (), option.WRONG
    proposals = [] if recording is None else propose_interference(config, recording)
    dated = {} if refused else _previews(config)
    if keep and not refused:
        dated = keep_previews(config, dated)
    facts = {name: found.facts for name, found in dated.items() if found.file is not None}
    doubts = [
        *refused_doubts(config, refused),
        *find_problems(config, facts),
        *(doubt for found in dated.values() for doubt in found.doubts),
    ]
    problems = entries(doubts, path)
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
    lines = [
        *_lines(config, dated),
        *(proposal_words(found) for found in proposals),
        *problem_lines(problems),
    ]
    values = redacted(values) if refused else values
    return values, lines, option.WRONG if any(problem["severity"] == "problem" for problem in problems) else option.DONE


def _previews(config: Config) -> dict[str, DatingPreview]:
    """Return what dates the blocks of each source of files."""
    return {source.name: found for source in config.source if (found := preview_dating(config, source)) is not None}


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


def _lines(config: Config, dated: Mapping[str, DatingPreview]) -> Iterator[str]:
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
    values = asdict(replace(found, levels={}, doubts=()))
    del values["levels"], values["choice"], values["tacho"], values["doubts"], values["facts"]
    return {**values, "problems": [doubt.came for doubt in found.doubts]}


def _dating_lines(found: DatingPreview) -> Iterator[str]:
    """Yield what dates the blocks of a source, with an example."""
    if found.kept:
        yield "  dates: this choice is kept, and changed by redate only"
    if found.file is None:
        yield f"  dates: {found.text}"
        return
    for place, words in zip(("first", "last"), found.ends, strict=False):
        yield f"  {place} file: {words}"
    for name, reason in islice(found.ignored.items(), _MAX_IGNORED):
        yield f"  not read: {name}: {reason}"
    if len(found.ignored) > _MAX_IGNORED:
        yield f"  not read: {len(found.ignored) - _MAX_IGNORED} more, see ignored of --json"
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
        track, forecast = methods(config, channel)
        thresholds = ", ".join(f"{v * 1e6:g}" for v in config.forecast.thresholds)
        yield f"    tracked: V_eq by {track}, TT by {forecast}, to {thresholds} mm3/mm"
        if config.calibration_of(channel) is not False:
            yield f"    rig {rig_words(config.rig_of(config.entry_of(channel)))}"
