"""What the page says of one run: verdicts, answers, figures and tables, as the template takes them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from monitor.report import data_quality as quality
from monitor.report.answers import Answer, answers
from monitor.report.figures.damage import damaged_volume, fitted_law
from monitor.report.figures.drawing import Picture
from monitor.report.figures.forecast import forecasts
from monitor.report.figures.map_path import map_of, map_path, posterior
from monitor.report.figures.sparkline import sparkline
from monitor.report.figures.spectrum import SpectrumView, before_and_after, recorded_lines, spectrum
from monitor.report.figures.trends import baseline, final_stage, trends
from monitor.report.figures.waterfall import waterfall
from monitor.report.options import Options
from monitor.report.run_tables import events_table, provenance
from monitor.report.runs import Channel, Run
from monitor.report.spectrum_views import views_of
from monitor.report.tables import Table
from monitor.report.verdict import Verdict, interval_name, judge, last_value, named_fault
from monitor.words.numbers import Clock, acceleration, count, duration, figure

_WORST = ("bad", "watch", "open", "good")


@dataclass(frozen=True)
class ChannelPart:
    """A channel on the page: what is said of it, and its figures."""

    verdict: Verdict
    answers: tuple[Answer, ...]
    pictures: tuple[Picture, ...]
    spark: str
    level: str
    anchor: str

    @property
    def briefly(self) -> dict[str, str]:
        """The answers for a table by question, of several thresholds the first; "–" where there is nothing to say."""
        return {answer.question: answer.brief or "–" for answer in reversed(self.answers)}


@dataclass(frozen=True)
class RunPart:
    """A run on the page.

    Attributes:
        run: its records.
        clock: writes its moments.
        period: one sentence on its length.
        notes: what has to be known of all of it.
        channels: the worst first.
        offered: the sum of the ledger.
        timeline: figure of data quality, or None.
        conditions: sentences on speed and load.
        tables: blocks, gaps, events; those that exist.
        provenance: how its records were made.
    """

    run: Run
    clock: Clock
    period: str
    notes: tuple[str, ...]
    channels: tuple[ChannelPart, ...]
    offered: str
    timeline: Picture | None
    conditions: tuple[str, ...]
    tables: Mapping[str, Table]
    provenance: tuple[tuple[str, str], ...]

    @property
    def leader(self) -> ChannelPart | None:
        """The channel in the worst state, or None where no channel has a value."""
        return self.channels[0] if self.channels else None


def part_of_run(
    run: Run,
    options: Options,
    views: Mapping[str, SpectrumView],
    pending: int,
    numbers: itertools.count[int],
    anchor: str = "",
) -> RunPart:
    """Judge and draw one run.

    Args:
        run: its records.
        options: of the report.
        views: an envelope spectrum by channel that only the caller still has.
        pending: blocks offered but not judged yet.
        numbers: of figures.
        anchor: begins the names of the places that the page links to.
    """
    clock = Clock(run.dated, options.zone)
    channels = [
        _channel(run, channel, options, views.get(channel.name), clock, numbers, f"{anchor}c{place}")
        for place, channel in enumerate(run.channels.values(), start=1)
    ]
    channels.sort(key=lambda part: _WORST.index(part.verdict.severity))
    tables: dict[str, Table] = {"blocks": quality.statuses(run)}
    missing = quality.gaps(run, clock)
    if missing is not None:
        tables["gaps"] = missing
    happened = events_table(run, clock)
    if happened is not None:
        tables["events"] = happened
    return RunPart(
        run=run,
        clock=clock,
        period=_period(run, clock),
        notes=tuple(_notes(run)),
        channels=tuple(channels),
        offered=quality.offered(run, pending),
        timeline=quality.timeline(run, clock, numbers) if options.holds("quality") else None,
        conditions=tuple(quality.condition_words(run)),
        tables=tables,
        provenance=tuple(provenance(run)),
    )


def _period(run: Run, clock: Clock) -> str:
    times = run.time[np.isfinite(run.time)]
    blocks = count(run.time.size, "block")
    if not times.size:
        return f"{blocks}."
    first, last = float(times.min()), float(times.max())
    if not run.dated:
        return (
            f"{blocks} over {duration(last - first)}, without a date." if last > first else f"{blocks}, without a date."
        )
    return f"{blocks} from {clock.moment(first)} to {clock.moment(last)}."


def _notes(run: Run) -> list[str]:
    tracked = any((channel.word("edv_status") != "").any() for channel in run.channels.values())
    notes = []
    if tracked and run.attributes.get("calibrated") != "yes":
        notes.append(
            "The model of the rig was not calibrated on this machine: V_eq and TT stand on the scale of the model. "
            "Their trend means something, their absolute value does not."
        )
    if run.attributes.get("prior"):
        notes.append(
            f"What is given as {interval_name(run)} leans on the bearing being one of these: {run.attributes['prior']}."
        )
    truth = any(np.isfinite(channel.numbers["v_eq_true"]).any() for channel in run.channels.values())
    if truth:
        notes.append(
            "These records come from a simulated rig, whose true V_eq and TT are drawn beside what was tracked."
        )
    return notes


def _channel(
    run: Run,
    channel: Channel,
    options: Options,
    view: SpectrumView | None,
    clock: Clock,
    numbers: itertools.count[int],
    anchor: str,
) -> ChannelPart:
    verdict = judge(run, channel, clock)
    pictures = (
        *_over_time(run, channel, verdict, options, clock, numbers),
        *_spectra(run, channel, verdict, options, view, clock, numbers),
        *_damage(run, channel, verdict, options, clock, numbers),
    )
    return ChannelPart(
        verdict=verdict,
        answers=answers(run, channel, verdict, clock),
        pictures=tuple(picture for picture in pictures if picture is not None),
        spark=sparkline(channel.time, channel.column("rms"), f"RMS of channel {channel.name} over time"),
        level=_level(channel),
        anchor=anchor,
    )


def _over_time(
    run: Run, channel: Channel, verdict: Verdict, options: Options, clock: Clock, numbers: itertools.count[int]
) -> Sequence[Picture | None]:
    return [
        trends(run, channel, verdict, clock, numbers) if options.holds("trends") else None,
        final_stage(run, channel, verdict, clock, numbers) if options.holds("final_stage") else None,
    ]


def _spectra(
    run: Run,
    channel: Channel,
    verdict: Verdict,
    options: Options,
    view: SpectrumView | None,
    clock: Clock,
    numbers: itertools.count[int],
) -> Sequence[Picture | None]:
    """Draw what spectra there are: the caller's, those of the store, else the lines that the records hold."""
    rows = run.spectra.get(channel.name, ())
    found: list[Picture | None] = []
    if options.holds("envelope"):
        pair = views_of(rows, channel, verdict, clock)
        drawn = before_and_after(pair, channel.name, verdict.fault, numbers) if len(pair) == 2 else None
        if view is None and drawn is None and pair:
            view = pair[-1]
        found.append(drawn)
        if view is not None:
            found.append(spectrum(view, channel.name, verdict.fault, numbers))
        row, _ = named_fault(channel)
        if not any(found) and row is not None:
            found.append(recorded_lines(channel, row, numbers))
    if options.holds("waterfall"):
        found.append(waterfall(rows, channel.name, verdict, clock, numbers))
    return found


def _damage(
    run: Run, channel: Channel, verdict: Verdict, options: Options, clock: Clock, numbers: itertools.count[int]
) -> Sequence[Picture | None]:
    found: list[Picture | None] = []
    if options.holds("damage"):
        found.append(damaged_volume(run, channel, verdict, clock, numbers))
    if options.holds("path"):
        rms_map = map_of(run, channel, options.map_for(channel.name))
        found.append(None if rms_map is None else map_path(run, channel, rms_map, numbers))
    particles = run.particles.get(channel.name)
    if options.holds("posterior") and particles is not None:
        found.append(posterior(channel, particles, numbers))
    if options.holds("law"):
        found.append(fitted_law(run, channel, verdict, clock, numbers))
    if options.holds("forecast"):
        found.extend(forecasts(run, channel, verdict, clock, numbers))
    return found


def _level(channel: Channel) -> str:
    """Return the latest RMS and how it stands to what was learned."""
    row = last_value(channel, "rms")
    if row is None:
        return "–"
    rms, learned = float(channel.column("rms")[row]), baseline(channel, "rms")
    text = acceleration(rms) if channel.has_level else figure(rms)
    return f"{text} ({figure(rms / learned, 2)}×)" if math.isfinite(learned) and learned > 0 else text
