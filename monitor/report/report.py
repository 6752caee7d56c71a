"""The HTML report: one self-contained page for the engineer who decides whether to stop the machine."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment
from markupsafe import Markup

from monitor import __version__
from monitor.records.filesystem import replace_durably
from monitor.records.schema import FLAGS, REJECTIONS
from monitor.report import figures
from monitor.report.figures import SpectrumView
from monitor.report.reading import Channel, Records, ReportError, Run, read_runs
from monitor.report.verdict import Verdict, interval_name, judge, named_fault
from monitor.report.wording import STATUS_MEANINGS, count, duration, moment

__all__ = ["ReportError", "SpectrumView", "build_report"]

_SYMBOLS = {"good": "●", "watch": "▲", "bad": "■", "open": "○"}
_MOST_EVENTS = 200
_EVENT_NAMES = {
    "final_stage": "start of the final stage known",
    "end_of_life": "end of life reached",
}
_PROVENANCE = {
    "software_version": "software version",
    "schema_version": "record schema",
    "config_hash": "hash of the configuration",
    "map_hash": "hash of the RMS map",
    "calibrated": "map calibrated on this machine",
    "rms_band_hz": "band of RMS (Hz)",
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
"""Attributes that describe a file and say nothing of how its records were made."""

_FOLDERS = re.compile(r"(?<![\w.])/(?:[^\s/:'\"<>]+/)+")


def build_report(
    records: Records | Sequence[Records],
    out: Path,
    *,
    title: str | None = None,
    spectra: Mapping[str, SpectrumView | tuple[Any, ...]] | None = None,
    pending: int = 0,
    notes: Sequence[str] = (),
) -> Path:
    """Write a report of one or several runs.

    Args:
        records: datasets, stores, or paths, see :func:`monitor.report.reading.read_runs`.
        out: the HTML file, put in place at once when it is complete.
        title: of the page; by default it names the machines.
        spectra: an envelope spectrum worth drawing, by channel: :class:`SpectrumView` or a tuple of its fields
            (frequency in Hz, amplitude in g, fundamental of each family in Hz, label).
        pending: blocks offered but not judged yet, where there is one run.
        notes: sentences to say first.

    Returns:
        ``out``.

    Raises:
        ReportError: the records cannot be read, or the file cannot be written.
    """
    runs = read_runs(records)
    numbers = itertools.count(1)
    views = {
        name: view if isinstance(view, SpectrumView) else SpectrumView(*view) for name, view in (spectra or {}).items()
    }
    page = (
        _environment()
        .from_string(_template())
        .render(
            title=title or f"Bearing health: {', '.join(dict.fromkeys(run.machine for run in runs))}",
            written=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            version=__version__,
            notes=[_without_folders(note) for note in notes],
            symbols=_SYMBOLS,
            runs=[_run(run, views, pending if len(runs) == 1 else 0, numbers) for run in runs],
        )
    )
    out = Path(out)
    temporary = out.with_name(f".{out.name}.tmp")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_text(page, encoding="utf-8")
        replace_durably(temporary, out)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise ReportError(f"{out}: cannot be written: {error.strerror or error}") from error
    return out


def _environment() -> Environment:
    # Names of files, channels and reasons come from outside: everything is escaped.
    return Environment(autoescape=True, trim_blocks=False)


def _template() -> str:
    return resources.files("monitor.report").joinpath("templates/report.html.j2").read_text(encoding="utf-8")


def _run(run: Run, views: Mapping[str, SpectrumView], pending: int, numbers: itertools.count[int]) -> dict[str, Any]:
    """Return what the template says of one run."""
    channels = [_channel(run, channel, views.get(channel.name), numbers) for channel in run.channels.values()]
    events = [_event(event) for event in run.events]
    return {
        "machine": run.machine,
        "period": _period(run),
        "notes": _notes(run),
        "channels": channels,
        "blocks": _blocks(run, pending),
        "events": events[-_MOST_EVENTS:],
        "events_left_out": max(0, len(events) - _MOST_EVENTS),
        "provenance": _provenance(run),
    }


def _period(run: Run) -> str:
    times = run.time[np.isfinite(run.time)]
    blocks = count(run.time.size, "block")
    if not times.size:
        return f"{blocks}."
    first, last = float(times.min()), float(times.max())
    if not run.dated:
        return (
            f"{blocks} over {duration(last - first)}, without a date." if last > first else f"{blocks}, without a date."
        )
    return f"{blocks} from {moment(first, dated=True)} to {moment(last, dated=True)}."


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


def _channel(run: Run, channel: Channel, view: SpectrumView | None, numbers: itertools.count[int]) -> dict[str, Any]:
    verdict = judge(run, channel)
    drawn = (
        _trend_figure(run, channel, verdict, numbers),
        _spectrum_figure(channel, view, numbers),
        _damage_figure(run, channel, verdict, numbers),
    )
    return {"verdict": verdict, "figures": [figure for figure in drawn if figure is not None]}


def _trend_figure(
    run: Run, channel: Channel, verdict: Verdict, numbers: itertools.count[int]
) -> tuple[str, Markup, str] | None:
    svg = figures.trends(channel, verdict, dated=run.dated, numbers=numbers)
    if svg is None:
        return None
    caption = "Shaded: the learning window. Lines break where blocks are missing or were rejected."
    return "Vibration", Markup(svg), caption


def _spectrum_figure(
    channel: Channel, view: SpectrumView | None, numbers: itertools.count[int]
) -> tuple[str, Markup, str] | None:
    drawn = None if view is None else figures.spectrum(view, channel.name, numbers)
    if view is not None and drawn is not None:
        caption = (
            "Dotted: five orders of the kinematic frequency of each part; the marker is the highest point within 2 % "
            "of it. A marker alone names nothing: a part is named only where its lines stand clear of noise and others."
        )
        return f"Envelope spectrum{f', {view.label}' if view.label else ''}", Markup(drawn), caption
    row, _ = named_fault(channel)
    if row is None:
        return None
    svg = figures.recorded_lines(channel, row, numbers)
    if svg is None:
        return None
    heading = f"Fault lines of the envelope spectrum, block {channel.sequence[row]:,}"
    return (
        heading,
        Markup(svg),
        "Bars: the first five lines of each part. Black: the noise floor under each. Empty: not resolved.",
    )


def _damage_figure(
    run: Run, channel: Channel, verdict: Verdict, numbers: itertools.count[int]
) -> tuple[str, Markup, str] | None:
    svg = figures.damage(channel, verdict, dated=run.dated, numbers=numbers, interval=interval_name(run))
    if svg is None:
        return None
    caption = "Every forecast stands where it was issued, with what was known then. Vertical lines as above."
    if run.attributes.get("calibrated") != "yes":
        caption += " The model is not calibrated on this machine."
    return "Damaged volume and time to threshold", Markup(svg), caption


def _blocks(run: Run, pending: int) -> dict[str, Any]:
    """Return the ledger by status: accepted + rejected + pending = offered."""
    rejected = sum(number for status, number in run.counts.items() if status in REJECTIONS)
    total = sum(run.counts.values())
    order = {status: place for place, status in enumerate(("ok", *FLAGS, *REJECTIONS))}
    rows = []
    for status, number in sorted(run.counts.items(), key=lambda item: order[item[0]]):
        outcome = "rejected" if status in REJECTIONS else ("accepted" if status == "ok" else "accepted, flagged")
        example = ""
        places = np.flatnonzero(run.ledger["status"] == status)
        if places.size and status != "ok":
            place = places[0]
            name, reason = run.ledger["name"][place], run.ledger["reason"][place]
            example = _without_folders(f"{run.ledger['sequence'][place]:,}: {name}{f': {reason}' if reason else ''}")
        rows.append(
            {
                "status": status,
                "number": f"{number:,}",
                "outcome": outcome,
                "meaning": STATUS_MEANINGS[status],
                "example": example,
            }
        )
    return {
        "offered": count(total + pending, "block"),
        "accepted": f"{total - rejected:,}",
        "rejected": f"{rejected:,}",
        "pending": f"{pending:,}",
        "rows": rows,
    }


def _event(event: Mapping[str, Any]) -> dict[str, str]:
    shown = {"kind", "channel", "block", "source"}
    details = "; ".join(f"{key}: {_plain(value)}" for key, value in event.items() if key not in shown)
    kind = str(event.get("kind", "event"))
    return {
        "block": str(event.get("block", "")),
        "channel": str(event.get("channel", "")),
        "kind": _EVENT_NAMES.get(kind, kind),
        "details": _without_folders(details),
    }


def _plain(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _provenance(run: Run) -> list[tuple[str, str]]:
    known = [(label, run.attributes[key]) for key, label in _PROVENANCE.items() if key in run.attributes]
    others = [
        (key, text)
        for key, text in sorted(run.attributes.items())
        if key not in _PROVENANCE and key not in _DISCOVERY and not key.startswith("time_coverage")
    ]
    return [(label, _without_folders(text) or "none") for label, text in (*known, *others)]


def _without_folders(text: str) -> str:
    """Leave of every absolute path its last part: where files lie on a machine is nobody else's business."""
    return _FOLDERS.sub("", text)
