"""``spallwatch replay``: the pipeline over a recording."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from monitor.commands import option
from monitor.commands.cluster_options import Sharing, sharing
from monitor.commands.common import InputError, progress_bar, read_config, say
from monitor.commands.shared_folders import hold_output
from monitor.words.advice import status_line
from monitor.words.numbers import duration, interval
from monitor.words.statuses import bearing_words, gears_line, named_words, speed_doubt, speed_words
from monitor.words.zones import zone_words
from streams.files.groups import FilesBeside
from streams.files.remote import bare, local_source
from streams.types.listing import shown

if TYPE_CHECKING:
    from monitor.commands.replay_many import ReplayRecording
    from monitor.service.replay import Replay

_MAX_IGNORED = 10


@click.command("replay")
@click.argument("paths", metavar="[PATH]...", nargs=-1, type=option.PLACE)
@option.config
@click.option(
    "--out", type=option.FOLDER, default="replay-out", help="Folder for the store, the records and the report."
)
@click.option("--pace", type=option.POSITIVE, help="Multiple of real time. Default: as fast as possible.")
@click.option("--limit", type=click.IntRange(min=1), help="Maximum number of blocks.")
@click.option("--report/--no-report", default=True, help="Write report.html under --out.")
@sharing("Processes for several PATHs")
@option.output
def command(
    paths: tuple[str, ...],
    config_path: Path | None,
    out: Path,
    pace: float | None,
    limit: int | None,
    report: bool,
    sharing: Sharing,
    quiet: bool,
) -> option.Result:
    """Replay a recording: PATH is a file, a folder, an archive or a source URL (rig:ferrara?seed=1, s3://BUCKET/RUN).

    Several PATHs, or one with --cluster, are replayed side by side, each into OUT/NAME. --resume continues the store
    under --out after its last block; of several, those that are complete and unchanged are kept.

    Exit code 1 where every block of a recording is rejected, or one of several failed.
    """
    from monitor.commands.replay_many import find_recordings
    from monitor.desk.judge.recordings import recording_doubts

    recordings = find_recordings(paths)
    if sharing.cluster is not None and not recordings:
        raise InputError("--cluster: expected the PATHs of recordings")
    if sharing.cluster is not None or len(recordings) > 1:
        if pace is not None:
            raise InputError("--pace: expected one PATH on this machine, got several or --cluster")
        read_config(config_path)
        replays = (config_path or Path("config.toml"), out, limit, report)
        return _replay_many(recordings, replays, sharing, quiet=quiet)
    from monitor.service.replay import is_all_rejected, replay

    if sharing.chunks is not None:
        raise InputError(
            "--chunks: expected several PATHs or --cluster; one recording is kept in its store under --out"
        )
    config = read_config(config_path)
    path = paths[0] if paths else None
    # Until the page is written, too.
    hold_output(out)
    section = config.source[0]
    beside = FilesBeside(section.pulses, section.files)
    with local_source(section.url if path is None else path, out / "fetched", beside) as source:
        for doubt in [] if quiet else recording_doubts(config, section, source):
            say(f"{doubt.severity}: {doubt.text}", quiet=quiet)
        result = replay(
            config,
            source,
            out,
            pace=pace,
            limit=limit,
            resume=sharing.resume,
            progress=progress_bar("replay", quiet=quiet),
        )
    if report:
        given = path or ""
        played = given if given.startswith("rig:") else shown(Path(bare(given)).name)
        page = write_report(result, out / "report.html", f"{config.machine.name}: {played}")
        say(f"report: {page}", quiet=quiet)
    for line in result.summary["warnings"]:
        say(f"warning: {line}", quiet=quiet)
    return result.summary, summary_lines(result.summary), is_all_rejected(result.summary)


def _replay_many(
    recordings: Sequence[ReplayRecording],
    replays: tuple[Path, Path, int | None, bool],
    sharing: Sharing,
    *,
    quiet: bool,
) -> option.Result:
    from monitor.commands import replay_many

    config_path, out, limit, report = replays
    settings = replay_many.Replays(config_path.absolute(), out.absolute(), limit, report, sharing.resume)
    began = time.perf_counter()
    # The stores are what is kept, rather than chunks.
    with replace(sharing, resume=False).open(out, quiet=quiet) as shared:
        outcomes = replay_many.replay_many(recordings, settings, shared.runner, elsewhere=sharing.cluster is not None)
    told = replay_many.values(outcomes, out)
    told |= {"seconds": time.perf_counter() - began, "cluster": shared.values()}
    return told, [*replay_many.lines(told), *shared.lines()], bool(told["failed"])


def write_report(result: Replay, out: Path, title: str, notes: tuple[str, ...] = ()) -> Path:
    """Write the page of a replay that has just ended, with its envelope spectra that are not in the store."""
    from monitor.report.report import build_report

    return build_report(
        result.store_path,
        out,
        title=title,
        spectra=result.spectra,
        pending=result.summary["pending"],
        notes=notes,
    )


def summary_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines for people of the summary of a replay."""
    counts = ", ".join(f"{number} {status}" for status, number in {**summary["flagged"], **summary["rejected"]}.items())
    yield (
        f"{summary['blocks']} blocks in {summary['seconds']:.2f} s: {summary['accepted']} accepted, "
        f"{sum(summary['rejected'].values())} rejected, {summary['pending']} pending"
        + (f" ({counts})" if counts else "")
    )
    if summary["ignored"]:
        number, names = summary["files"]["ignored"], list(summary["ignored"])[:_MAX_IGNORED]
        more = f" and {number - len(names)} more" if number > len(names) else ""
        reason = next(iter(summary["ignored"].values()))
        yield f"{number} {'file' if number == 1 else 'files'} ignored, {reason}: {', '.join(names)}{more}"
    yield from (f"folder {name} {reason}: its files are in no count" for name, reason in summary["closed"].items())
    if summary["condition"] is not None:
        yield summary["condition"]
    yield from (f"dates: {line}" for line in summary["dating"])
    yield from (f"first {status}, {reason}" for status, reason in summary["reasons"].items())
    for name, found in summary["bearings"].items():
        yield f"bearing {name}: {bearing_words(found)}"
    for name, channel in summary["channels"].items():
        yield f"{name}: {status_line(name, channel)}"
        if figures := ", ".join(_channel_words(channel)):
            yield f"{name}, in figures: {figures}"
    yield from summary["uncalibrated"]


def _channel_words(channel: Mapping[str, Any]) -> Iterator[str]:
    if channel["t_fs_block"] is not None:
        yield f"final stage since block {channel['t_fs_block']} (known at {channel['t_fs_known_block']})"
    for closed in channel["closed_episodes"]:
        yield f"final stage of block {closed['t_fs_block']} closed again at block {closed['closed_block']}"
    if channel["t_eol_block"] is not None:
        yield f"end of life at block {channel['t_eol_block']}"
    if gears := gears_line(channel):
        yield gears
    if channel["fault_snr"] is not None:
        part = named_words(channel["fault"], channel["fault_basis"])
        yield f"{part}, lines {channel['fault_snr']:.3g} times the floor"
        doubt = speed_doubt(channel["fault"], channel["fault_candidates"] or (), channel["speed_unverified"])
        if doubt is not None:
            yield doubt
    if channel["edv_status"] is not None:
        yield f"V_eq {''.join(_volume_words(channel))}{channel['edv_status']}"
    if channel["tt_status"] is not None:
        yield "TT " + "".join(_forecast_words(channel)) + channel["tt_status"]
    if channel["velocity_zone"] is not None:
        yield f"velocity {channel['velocity_rms_mm_s']:.3g} mm/s, {zone_words(channel['velocity_zone'])}"
    if (speeds := _speed_words(channel)) is not None:
        yield speeds
    if channel["tta_status"] not in (None, "learning", "not_final_stage"):
        yield "time to the alarm level " + "".join(_alarm_time_words(channel)) + channel["tta_status"]


def _speed_words(channel: Mapping[str, Any]) -> str | None:
    keys = ("rotation_status", "domain", "speed_min_hz", "speed_max_hz")
    return speed_words(*(channel[key] for key in keys))


def _alarm_time_words(channel: Mapping[str, Any]) -> Iterator[str]:
    """Yield the level as a multiple of the baseline, and the time to it where there is one."""
    if channel["tta_level_factor"] is not None:
        yield f"({channel['tta_level_source']}, {channel['tta_level_factor']:.3g} times the baseline) "
    if channel["tta_s"] is not None:
        upper = math.inf if channel["tta_upper_s"] is None else channel["tta_upper_s"]
        yield f"{duration(channel['tta_s'])}, interval {interval(channel['tta_lower_s'], upper, duration)}, "


def _volume_words(channel: Mapping[str, Any]) -> Iterator[str]:
    """Yield V_eq and its interval, as multiples of the first value where the rig is not calibrated."""
    found, low, high = (channel[f"v_eq{end}_mm2"] for end in ("", "_lower", "_upper"))
    factor, unit = 1.0, "mm3/mm"
    if channel["calibrated"] is False and found and channel["v_eq_relative"] is not None:
        factor, unit = channel["v_eq_relative"] / found, "times the first tracked value"
    if found is not None:
        yield f"{found * factor:.3g} {unit}, "
    if low is not None:
        yield f"interval {low * factor:.3g} to {high * factor:.3g}, "


def _forecast_words(channel: Mapping[str, Any]) -> Iterator[str]:
    if channel["tt_s"] is not None:
        yield f"{duration(channel['tt_s'])}, "
    if channel["tt_lower_s"] is not None:
        upper = math.nan if channel["tt_upper_s"] is None else channel["tt_upper_s"]
        yield f"interval {interval(channel['tt_lower_s'], upper, duration)}, "
    if channel["p_threshold"] is not None:
        yield f"probability of reaching the threshold within the maintenance window {channel['p_threshold']:.0%}, "
    if channel["p_no_growth"] is not None:
        yield f"probability of no growth {channel['p_no_growth']:.0%}, "
