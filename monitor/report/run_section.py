"""The section of one run: verdicts, findings, figures and tables, as the template takes them."""

from __future__ import annotations

import itertools
import math
import pkgutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from monitor.report import data_quality as quality
from monitor.report.figures.drawing import Picture, sparkline
from monitor.report.figures.map_path import hash_of, kept_map
from monitor.report.figures.spectrum import SpectrumView
from monitor.report.figures.speed import rotation_table, speed_picture, speed_words
from monitor.report.findings import findings
from monitor.report.options import PICTURES, Options
from monitor.report.readings import Finding, gears_table, is_calibrated
from monitor.report.runs import ABSENCE, Channel, Run
from monitor.report.statements import BearingStatement, bearing_parts, part_of, said_of, what_to_do
from monitor.report.tables import Column, Table, time_column
from monitor.report.verdict import (
    GRADES,
    ChannelContext,
    ChannelVerdict,
    interval_name,
    judge,
)
from monitor.words.events import event_text
from monitor.words.features import FEATURES
from monitor.words.numbers import Clock, count, duration, figure, floor_of_defect

_MAX_EVENTS = 200
_EVENT_NAMES = {
    "final_stage": "start of the final stage known",
    "final_stage_closed": "final stage closed again",
    "fault_changed": "another part named",
    "baseline_relearned": "baseline learned anew",
    "end_of_life": "end of life reached",
    "alarm_raised": "alarm",
    "alarm_cleared": "alarm over",
    "alarm_withdrawn": "alarm withdrawn",
    "condition": "condition",
}
_LEVELS = ("value_si", "level_si")
"""Left out of the text of an event where they are no numbers."""
_PROVENANCE = {
    "software_version": "software version",
    "schema_version": "record schema",
    "config_hash": "hash of the configuration",
    "map_hash": "hash of the RMS map",
    "bearing": "bearing to which each channel listens",
    "calibrated": "rig calibrated on this machine",
    "rms_band_hz": "band of RMS (Hz)",
    "velocity_sensors": "sensors of velocity",
    "iso_class": "class of the machine for the zones of velocity",
    "interference": "lines removed before the envelope",
    "track_method": "method of V_eq",
    "forecast_method": "method of TT",
    "interval_level": "level of intervals",
    "prior": "what intervals lean on",
    "library_hash": "hash of the library of simulated lives",
}
_DISCOVERY = frozenset(
    {"Conventions", "title", "summary", "keywords", "id", "machine", "source", "history", "processing_level"}
    | {"date_created", "product_version", "dated"}
)
"""Attributes that describe a file, not its provenance."""


@dataclass(frozen=True)
class ChannelPart:
    """A channel on the page: ``spark`` is RMS over time as inline SVG, ``anchor`` the id of its heading."""

    verdict: ChannelVerdict
    findings: tuple[Finding, ...]
    pictures: tuple[Picture, ...]
    spark: str
    level: str
    anchor: str

    @property
    def briefly(self) -> dict[str, str]:
        """The findings for a table by question, of several thresholds the first; "–" for none."""
        return {finding.question: finding.brief or "–" for finding in reversed(self.findings)}


@dataclass(frozen=True)
class RunPart:
    """A run on the page.

    Attributes:
        period, notes, offered, conditions: sentences on its length, the whole run, the ledger, and speed and load.
        channels: those with a value, the worst first; of equally bad ones those that their bearing agrees with.
        timeline: figure of data quality.
        speed: figure of the speeds of the shaft, None where its angle was never known.
        speeds: sentences on them; () where no angle was sought.
        bearings: what the channels of each say together; () for records that do not name their bearings.
        tables: "blocks"; "gaps" and "events" if there are any.
        provenance: labels and texts.
    """

    run: Run
    clock: Clock
    period: str
    notes: tuple[str, ...]
    channels: tuple[ChannelPart, ...]
    offered: str
    timeline: Picture | None
    speed: Picture | None
    speeds: tuple[str, ...]
    bearings: tuple[BearingStatement, ...]
    conditions: tuple[str, ...]
    tables: Mapping[str, Table]
    provenance: tuple[tuple[str, str], ...]


def part_of_run(
    run: Run,
    options: Options,
    views: Mapping[str, SpectrumView],
    pending: int,
    numbers: itertools.count[int],
    anchor: str,
) -> RunPart:
    """Judge and draw one run; arguments as in :func:`monitor.report.report.report_runs`.

    ``numbers`` are those of the figures of the page, ``anchor`` is a prefix of the ids of headings.
    """
    clock = Clock(run.dated, options.zone)
    bearings = bearing_parts(run)
    level_of = {name: bearing.verdict.level_of for bearing in bearings for name in bearing.verdict.channels}
    channels = []
    for place, channel in enumerate(run.channels.values(), start=1):
        verdict = judge(run, channel, clock, level_of.get(channel.name))
        context = ChannelContext(run, channel, verdict, clock, numbers, options, views.get(channel.name))
        part = _channel(context, f"{anchor}c{place}")
        said = said_of(run, channel, part_of(bearings, channel.name))
        channels.append(replace(part, findings=(what_to_do(said), *part.findings)))
    apart = {name for bearing in bearings for name in bearing.verdict.disagreement}
    channels.sort(key=lambda part: (GRADES.index(part.verdict.grade), part.verdict.channel in apart))
    tables = {"blocks": quality.statuses(run), "gaps": quality.gaps(run, clock), "events": _events(run, clock)}
    tables |= {"rotation": rotation_table(run), "gears": gears_table(run)}
    return RunPart(
        run=run,
        clock=clock,
        period=_period(run, clock),
        notes=tuple(_notes(run)),
        channels=tuple(channels),
        offered=quality.offered(run, pending),
        timeline=quality.timeline(run, clock, numbers) if options.holds("quality") else None,
        speed=speed_picture(run, clock, numbers) if options.holds("speed") else None,
        speeds=tuple(speed_words(run)),
        bearings=bearings,
        conditions=tuple(quality.condition_words(run)),
        tables={name: table for name, table in tables.items() if table is not None},
        provenance=tuple(_provenance(run)),
    )


def _period(run: Run, clock: Clock) -> str:
    times = run.time[np.isfinite(run.time)]
    blocks = count(run.time.size, "block")
    if not times.size:
        return f"{blocks}."
    first, last = float(times.min()), float(times.max())
    if run.dated:
        return f"{blocks} from {clock.moment(first)} to {clock.moment(last)}."
    return f"{blocks} over {duration(last - first)}, without a date." if last > first else f"{blocks}, without a date."


def _notes(run: Run) -> list[str]:
    channels = run.channels.values()
    notes = []
    if any((channel.word("edv_status") != "").any() and not is_calibrated(run, channel) for channel in channels):
        notes.append(
            "The model of the rig was not calibrated on this machine: V_eq and TT stand on the scale of the model. "
            "Their trend means something, their absolute value does not, so that V_eq is shown as a multiple of its "
            "first value."
        )
    if ABSENCE in run.attributes:
        notes.append(f"Records are missing in this report: {run.attributes[ABSENCE]}.")
    if run.attributes.get("prior"):
        notes.append(
            f"What is given as {interval_name(run)} leans on the bearing being one of these: {run.attributes['prior']}."
        )
    if any(channel.last_row("v_eq_true") is not None for channel in channels):
        notes.append(
            "These records come from a simulated rig, whose true V_eq and TT are drawn beside what was tracked."
        )
    return notes


def _channel(context: ChannelContext, anchor: str) -> ChannelPart:
    channel = context.channel
    return ChannelPart(
        verdict=context.verdict,
        findings=findings(context),
        pictures=tuple(pictures_of(context)),
        spark=sparkline(channel.time, channel.column("rms"), f"RMS of channel {channel.name} over time"),
        level=_level(channel),
        anchor=anchor,
    )


def pictures_of(context: ChannelContext) -> Iterator[Picture]:
    """Yield the pictures of a channel that are in the sections of its report."""
    for section, places in PICTURES.items():
        for place in places if context.options.holds(section) else ():
            found = pkgutil.resolve_name(f"monitor.report.figures.{place}")(context)
            yield from found if isinstance(found, list) else [found] if found is not None else []


def _level(channel: Channel) -> str:
    """Return the latest RMS and its ratio to the baseline."""
    row = channel.last_row("rms")
    if row is None:
        return "–"
    rms, learned = float(channel.column("rms")[row]), channel.baseline("rms")
    text = FEATURES["rms"].write(rms) if channel.has_level else figure(rms)
    return f"{text} ({figure(rms / learned, 2)}×)" if math.isfinite(learned) and learned > 0 else text


def _events(run: Run, clock: Clock) -> Table | None:
    """Return the table of the latest events of a run, None without any."""
    if not run.events:
        return None
    places = {
        (str(source), int(number)): at
        for source, number, at in zip(run.ledger["source"], run.ledger["sequence"], run.time, strict=True)
    }
    rows = []
    for whole in run.events[-_MAX_EVENTS:]:
        event = {key: value for key, value in whole.items() if key not in _LEVELS or isinstance(value, int | float)}
        kind, name = str(event.get("kind", "event")), str(event.get("channel", ""))
        block, channel = int(event.get("block", 0)), run.channels.get(name)
        text = event_text(event, absolute=channel is None or channel.has_level)
        at = float(places.get((str(event.get("source", "")), block), math.nan))
        title = _EVENT_NAMES.get(kind, quality.without_folders(kind))
        rows.append((block, at, name, title, quality.without_folders(text)))
    columns = (
        Column("block", "block", "1"),
        time_column("time", "time", clock),
        Column("channel", "channel"),
        Column("event", "event"),
        Column("details", "details"),
    )
    left = len(run.events) - len(rows)
    return Table("events", "Events", columns, rows, f"{left:,} earlier ones are in the records." if left else "")


def _provenance(run: Run) -> list[tuple[str, str]]:
    """Return labels and texts: versions, hashes, methods."""
    known = [(label, run.attributes[key]) for key, label in _PROVENANCE.items() if key in run.attributes]
    others = [
        (key, text)
        for key, text in sorted(run.attributes.items())
        if key not in _PROVENANCE and key not in _DISCOVERY and not key.startswith("time_coverage")
    ]
    rows = [(label, quality.without_folders(text) or "none") for label, text in (*known, *others)]
    return [*rows, *_floors(run), ("departures from the sources", "; ".join(_departures()))]


def _departures() -> Iterator[str]:
    """Yield by feature where it departs from what its source prints."""
    for feature in FEATURES.values():
        if feature.comment:
            yield f"{feature.label}: {feature.comment}"


def _floors(run: Run) -> list[tuple[str, str]]:
    """Return the floor of the defects in each RMS map that is kept."""
    found = {hash_of(run, channel) for channel in run.channels}
    maps = [kept for wanted in sorted(found) if (kept := kept_map(wanted)) is not None]
    return [("floor of the defects in the map", floor_of_defect(m.plan.floor.kind, m.plan.floor.sd)) for m in maps]
