"""The HTML report: one self-contained page for the engineer who decides whether to stop the machine."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

from jinja2 import Environment, FunctionLoader
from markupsafe import Markup

from monitor import __version__
from monitor.report.batch.comparison import Comparison, compare
from monitor.report.batch.comparison_tables import laws, milestones, scores
from monitor.report.batch.summary import RunSummary, summarise
from monitor.report.data_quality import without_folders
from monitor.report.figures.spectrum import SpectrumView
from monitor.report.figures.zoom import policy_hash, zoom_json, zoom_script, zoom_style
from monitor.report.options import Options
from monitor.report.pdf import require_pdf, to_pdf
from monitor.report.run_section import RunPart, part_of_run
from monitor.report.runs import Records, ReportError, Run, read_runs
from monitor.report.tables import Table, write_tables, write_whole
from monitor.words.numbers import Clock

__all__ = ["Options", "ReportError", "SpectrumView", "build_report", "is_pdf", "render", "report_runs", "write_page"]

SYMBOLS = {"good": "●", "watch": "▲", "bad": "■", "open": "○"}
STATES = {"good": "no sign of damage", "watch": "damage", "bad": "end of life", "open": "no verdict"}
"""What a state is called where there is no room for a sentence."""


def build_report(
    records: Records | Sequence[Records],
    out: Path,
    *,
    title: str | None = None,
    spectra: Mapping[str, SpectrumView | tuple[Any, ...]] | None = None,
    pending: int = 0,
    notes: Sequence[str] = (),
    options: Options | None = None,
    tables: Path | None = None,
    pdf: bool = False,
) -> Path:
    """Write a report of one or several runs.

    Args:
        records: datasets, stores, or paths, see :func:`monitor.report.runs.read_runs`.
        out: the file, HTML or, where its name ends in .pdf, PDF; put in place at once when it is complete.
        title: of the page; by default it names the machines.
        spectra: an envelope spectrum worth drawing, by channel: :class:`SpectrumView` or a tuple of its fields
            (frequency in Hz, amplitude in g, fundamental of each family in Hz, label).
        pending: blocks offered but not judged yet, where there is one run.
        notes: sentences to say first.
        options: what the page holds and how it is written; by default everything, in UTC.
        tables: folder for every table of the page as CSV and netCDF, None for none.
        pdf: write it as PDF too, beside ``out``.

    Returns:
        ``out``.

    Raises:
        ReportError: the records cannot be read, a file cannot be written, or what a PDF needs is missing.
    """
    if pdf or is_pdf(Path(out)):
        require_pdf()
    options = options or Options()
    options = replace(options, title=title or options.title, notes=(*options.notes, *notes))
    views = {
        name: view if isinstance(view, SpectrumView) else SpectrumView(*view) for name, view in (spectra or {}).items()
    }
    return report_runs(read_runs(records), out, options=options, views=views, pending=pending, tables=tables, pdf=pdf)[
        0
    ]


def report_runs(
    runs: Sequence[Run],
    out: Path,
    *,
    options: Options,
    views: Mapping[str, SpectrumView] | None = None,
    pending: int = 0,
    tables: Path | None = None,
    pdf: bool = False,
) -> tuple[Path, list[RunSummary]]:
    """Write a report of runs that were read already; see :func:`build_report`.

    Args:
        runs: that were read.
        out: the page, HTML or, where the name ends in .pdf, PDF.
        options: of the page.
        views: an envelope spectrum worth drawing, by channel.
        pending: blocks offered but not judged yet, where there is one run.
        tables: folder for the tables, None for none.
        pdf: write it as PDF too, beside ``out``.

    Returns:
        The page, and what comparing its runs with others takes.
    """
    numbers = itertools.count(1)
    parts = [
        part_of_run(run, options, views or {}, pending if len(runs) == 1 else 0, numbers, anchor=f"r{place}")
        for place, run in enumerate(runs, start=1)
    ]
    summaries = [
        summarise(run, part, f"#run{place}", scored=options.holds("score"))
        for place, (run, part) in enumerate(zip(runs, parts, strict=True), start=1)
    ]
    compared = compare(summaries, options, numbers) if len(runs) > 1 and options.holds("comparison") else None
    alone = [] if compared is not None else _alone(summaries, options)
    write_page(
        Path(out),
        "report.html.j2",
        pdf=pdf,
        zoomed=any(picture.zoom for part in parts for channel in part.channels for picture in channel.pictures),
        title=options.title or f"Bearing health: {', '.join(dict.fromkeys(run.machine for run in runs))}",
        notes=[without_folders(note) for note in options.notes],
        runs=parts,
        compared=compared,
        scores=[table for table in alone if table.name == "scores"],
        options=options,
    )
    if tables is not None:
        write_tables([*alone, *tables_of(parts, compared)], tables, {"product_version": f"spallwatch {__version__}"})
    return Path(out), summaries


def _alone(summaries: Sequence[RunSummary], options: Options) -> list[Table]:
    """Return the tables over runs that say something of one run too."""
    found = [milestones(summaries, options.zone), laws(summaries), scores(summaries)]
    return [table for table in found if table is not None]


def tables_of(parts: Sequence[RunPart], compared: Comparison | None) -> list[Table]:
    """Return the tables of each run and those over runs, under names that no two share."""
    found = [] if compared is None else list(compared.tables)
    for place, part in enumerate(parts, start=1):
        prefix = f"run{place}-" if len(parts) > 1 else ""
        found += [replace(table, name=f"{prefix}{table.name}") for table in part.tables.values()]
    return found


def is_pdf(path: Path) -> bool:
    """Say whether a name asks for PDF."""
    return path.suffix.lower() == ".pdf"


def write_page(out: Path, template: str, *, pdf: bool = False, **values: Any) -> None:
    """Write a template as a page, HTML or PDF by the name's ending, and put it in place at once.

    Args:
        out: the file.
        template: its name.
        pdf: write it as PDF too, beside ``out``.
        values: that it uses.

    Raises:
        ReportError: a file cannot be written, or what a PDF needs is missing.
    """
    paper = out if is_pdf(out) else out.with_suffix(".pdf") if pdf else None
    path = out
    try:
        if paper is not None:
            path = paper
            write_whole(paper, to_pdf(render(template, bare=True, **values)))
        if not is_pdf(out):
            path = out
            write_whole(out, render(template, **values))
    except OSError as error:
        raise ReportError(f"{path}: cannot be written: {error.strerror or error}") from error


def render(template: str, *, bare: bool = False, zoomed: bool = False, **values: Any) -> str:
    """Return a template as a page; what comes from outside (names, reasons) is escaped everywhere.

    Args:
        template: its name.
        bare: for paper: without scripts and without the data of figures.
        zoomed: with the script that makes charts of the figures that can be zoomed.
        values: that it uses, beside those that every page has.
    """
    script = zoom_script() if zoomed and not bare else ""
    environment = Environment(autoescape=True, loader=FunctionLoader(_file), trim_blocks=True, lstrip_blocks=True)
    return environment.get_template(template).render(
        written=Clock(True, values["options"].zone).moment(float(int(datetime.now(UTC).timestamp()))),
        # Ours, not from outside: a style sheet has quotes and brackets that must stay.
        style=Markup(_file("report.css") + (_file("pdf.css") if bare else "") + (zoom_style() if script else "")),
        script=Markup(script),
        policy=Markup(policy_hash(script)),
        zoom_json=lambda data: Markup(zoom_json(data)),
        svg=Markup,
        version=__version__,
        symbols=SYMBOLS,
        states=STATES,
        bare=bare,
        **values,
    )


def _file(name: str) -> str:
    return resources.files("monitor.report").joinpath(f"templates/{name}").read_text(encoding="utf-8")
